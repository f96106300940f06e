"""The benchmarks' processes, tables and pictures."""

from __future__ import annotations

from dataclasses import asdict
from fnmatch import fnmatch
from pathlib import Path

import pytest
from mpi4py import MPI

from benchmarks import cost_page, published, run
from benchmarks.worker import Worker

alone = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts processes of its own")


@alone
def test_worker_answers_and_survives():
    worker = Worker()
    arguments = {
        "task": asdict(run.Task("time_error", "arch of 15 friction 1", "auto")),
        "time_out": 60.0,
    }
    row = worker.call("benchmarks.run:measure", 60.0, **arguments)
    scene = {"scene": "arch of 15 friction 1"}
    assert (row["status"], run.error({**scene, **row}) < 1e-2) == ("limit", True)
    assert worker.call("benchmarks.run:nothing", 60.0) == {"status": "AttributeError"}
    assert worker.call("benchmarks.run:measure", 0.0, **arguments) == {"status": "time-out"}
    worker.close()


def test_page_of_costs_has_the_tables_of_the_rows():
    results = Path(__file__).parents[2] / "benchmarks" / "results"
    rows = {name: run.read(results / f"{name}.csv") for name in run.TABLES}
    pages = [path.read_text() for path in cost_page.PAGES]
    assert [cost_page.page(text, rows) for text in pages] == pages
    marks = [f"<!-- {name}: begin -->" for name in cost_page.SECTIONS]
    assert [mark for mark in marks if mark not in "".join(pages)] == []


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
