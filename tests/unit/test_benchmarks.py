"""The benchmarks' processes, tables and pictures."""

from __future__ import annotations

from dataclasses import asdict
from fnmatch import fnmatch
from pathlib import Path

import pytest
from mpi4py import MPI

from benchmarks import compare, pictures, published, run
from benchmarks.scenes import COST_SIZE, TIME_ERROR, comparison, matching
from benchmarks.worker import Worker

alone = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts processes of its own")


@alone
def test_worker_answers_and_survives():
    worker = Worker()
    arguments = {"task": asdict(run.Task("methods", "wedge 0.2", "auto")), "time_out": 60.0}
    row = worker.call("benchmarks.run:measure", 60.0, **arguments)
    assert (row["status"], run.error({"scene": "wedge 0.2", **row}) < 1e-6) == ("limit", True)
    assert worker.call("benchmarks.run:nothing", 60.0) == {"status": "AttributeError"}
    assert worker.call("benchmarks.run:measure", 0.0, **arguments) == {"status": "time-out"}
    worker.close()


def test_tables_name_scenes_that_exist():
    for table in run.TABLES:
        rows = list(run.tasks(table))
        assert len({(task.curve, task.scene, task.resolution) for task in rows}) == len(rows)
    assert len(matching(comparison(), "W[1-4] 0.65 *")) == 16
    assert len(comparison()) == 184 + 70
    assert len(matching(comparison(), "facade*")) == 30


def test_comparison_says_what_is_slower_and_what_differs():
    before = {"status": "limit", "load_factor": 0.5, "structure": 20, "cpu": 1.0}
    pairs = {
        "slower": [before, before | {"cpu": 4.0}],
        "other": [before, before | {"load_factor": 0.4}],
        "lost": [before, {"status": "time-out"}],
    }
    factors, seconds, others = compare.summary(pairs, 1e-6)
    assert "mean 1.000 of 2" in factors
    assert "mean 2.000 of 2; worst slower: 4.00" in seconds
    assert others.endswith(": other, lost")


NUMBERS = ("resolution", "displacements", "seconds", "error")


@alone
def test_pictures_are_drawn(tmp_path):
    row = {"method": "auto", "ranks": 1.0, "degree": 1.0, "status": "limit", "load_factor": 0.5}
    row |= {"bonded_seconds": 0.1, "made_with": "program; machine"}
    for name, scenes in {"time_error": TIME_ERROR, "cost_size": COST_SIZE}.items():
        sizes = (dict.fromkeys(NUMBERS, n) for n in (1.0, 2.0, 4.0))
        rows = [{**row, **size, "scene": scene} for size in sizes for scene in scenes]
        pictures.draw(name, rows, tmp_path)
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")


@alone
@pytest.mark.parametrize("name", ["W1, *", "ring *", "block *"])
def test_page_has_the_rows_that_the_command_prints(name):
    page = (Path(__file__).parents[2] / "docs" / "published.md").read_text().splitlines()
    (row,) = [row for row in published.table() if fnmatch(row.name, name)]
    assert row.row() in page


def test_page_has_all_published_values():
    page = (Path(__file__).parents[2] / "docs" / "published.md").read_text()
    for row in published.table():
        assert f"| {row.name} | {row.value} | " in page
    assert page.count("\n| ") == len(published.table()) + 1


def test_rows_are_chosen_by_names_in_any_case(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["published.py", "--list", "--only", "w?,*"])
    published.main()
    names = [row.name for row in published.table() if row.name.startswith("W")]
    assert capsys.readouterr().out.splitlines() == names
    monkeypatch.setattr("sys.argv", ["published.py", "--only", "W7*"])
    with pytest.raises(SystemExit):
        published.main()
    assert "no row has a name like 'W7*'; --list names all" in capsys.readouterr().err
