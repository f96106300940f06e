"""`fenics-contact sweep`: table, pictures, going on after a stop, several processes."""

from __future__ import annotations

import csv
import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from fenics_contact import InputError, sweep
from tests.quick import slow
from tests.system.program import (
    QUIET,
    command,
    environment,
    files,
    run,
    run_command,
    run_here,
    write_scene,
)
from tests.system.test_cannot_write import ON_A_FULL_DISK

BOTH = "joints.default.friction,foundations.base.friction"
NOT_REPEATED = "seconds"
FAST = QUIET | {"solve.fast": True}


def rows(folder: Path) -> list[dict[str, str]]:
    """Rows of the table without times."""
    with (folder / "sweep.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    return [{k: v for k, v in row.items() if k != NOT_REPEATED} for row in found]


def test_table_and_pictures(tmp_path, capsys):
    write_scene(tmp_path, {"title": "Block"})
    scene = tmp_path / "scene.toml"
    found = run_here(["sweep", scene, "--vary", f"{BOTH}=0.1:0.3:3", "--set", "title='A'"], capsys)
    assert (found.code, found.err) == (0, "")
    assert "3 of 3" in found.out and "lowest load factor 0.1" in found.out
    folder = tmp_path / "scene_sweep"
    assert files(folder) == {"sweep.csv", "sweep.json", "sweep.png"}
    table = rows(folder)
    assert [row["foundations.base.friction"] for row in table] == ["0.1", "0.2", "0.3"]
    assert [float(row["load_factor"]) for row in table] == pytest.approx([0.1, 0.2, 0.3], rel=1e-6)
    assert [float(row["upper"]) for row in table] == pytest.approx([0.1, 0.2, 0.3], rel=1e-6)
    assert {row["status"] for row in table} == {"limit"}
    assert min(int(row["displacements"]) for row in table) > 0
    again = run_here(["sweep", scene, "--vary", f"{BOTH}=0.1:0.3:3"], capsys)
    assert again.code == 0 and "3 of 3 points are there already" in again.out
    assert rows(folder) == table


def test_worst_place_of_a_load_is_drawn(tmp_path, capsys):
    write_scene(tmp_path)
    vary = ["--vary", "loads.live.body=[5,0]:[10,0]:2", "--vary", "solve.direction=positive,both"]
    found = run_here(["sweep", tmp_path / "scene.toml", *vary, "-o", tmp_path / "out"], capsys)
    assert found.code == 0
    assert files(tmp_path / "out") == {"sweep.csv", "sweep.json", "sweep.png", "worst.png"}
    assert [row["load_factor_negative"] != "" for row in rows(tmp_path / "out")] == [
        False,
        True,
    ] * 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--vary", "joints.default.fricton=1,2"], "unknown key 'joints.default.fricton'"),
        (["--vary", "joints.default.friction=1,x"], "joints.default.friction = 'x' must be a num"),
        (["--vary", "joints.default.friction"], "give both key and values"),
        (["--vary", "loads.live.traction.side=[0,1]"], "no one-dimensional group 'side'"),
        (["--vary", "mesh.file=block.msh,none.msh"], "none.msh' does not exist"),
        (["--vary", "loads.live.body=[0,0]"], "live load is zero"),
        (["--vary", f"{BOTH}=0.1,0.2", "--jobs", "0"], "jobs = 0 must be at least 1"),
        ([], "the following arguments are required: --vary"),
    ],
)
def test_wrong_input_writes_nothing(arguments, message, tmp_path, capsys):
    write_scene(tmp_path)
    before = files(tmp_path)
    found = run_here(["sweep", tmp_path / "scene.toml", *arguments], capsys)
    assert found.code == 2
    assert message in found.err
    assert files(tmp_path) == before


def test_folder_of_another_sweep_is_left_alone(tmp_path, capsys):
    write_scene(tmp_path)
    line = ["sweep", tmp_path / "scene.toml", "-q", "-o", tmp_path / "out", "--vary"]
    assert run_here([*line, f"{BOTH}=0.1,0.2"], capsys).code == 0
    table = rows(tmp_path / "out")
    for other in ([f"{BOTH}=0.1,0.3"], [f"{BOTH}=0.1,0.2", "--set", "materials.default.young=2e9"]):
        found = run_here([*line, *other], capsys)
        assert found.code == 2 and "has a sweep of another scene or other values" in found.err
    with pytest.raises(InputError, match="has a sweep of another scene"):
        sweep(tmp_path / "scene.toml", {BOTH: [0.1]}, tmp_path / "out")
    write_scene(tmp_path, mesh="wall")
    assert run_here([*line, f"{BOTH}=0.1,0.2"], capsys).code == 2  # another mesh
    assert rows(tmp_path / "out") == table


def test_exit_code_is_that_of_the_worst_point(tmp_path, capsys):
    write_scene(tmp_path, mesh="gentle")  # ground that falls by 0.2
    line = ["sweep", tmp_path / "scene.toml", "--vary", "foundations.base.friction=0.1,0.5"]
    assert run_here(line, capsys).code == 3
    table = rows(tmp_path / "scene_sweep")
    assert [row["status"] for row in table] == ["unstable", "limit"]
    assert "slides" in table[0]["reason"]


def test_half_a_line_is_dropped_and_found_again(tmp_path, capsys):
    write_scene(tmp_path, FAST)
    line = ["sweep", tmp_path / "scene.toml", "-o", tmp_path, "--vary", f"{BOTH}=0.1:0.3:3"]
    assert run_here(line, capsys).code == 0
    table, path = rows(tmp_path), tmp_path / "sweep.csv"
    text = path.read_text()
    for end in (len(text) - 1, text.rfind("\n0.3") + 5, text.index("\n0.2"), 10, 0):
        path.write_text(text[:end])
        found = run_here(line, capsys)
        assert found.code == 0
        assert rows(tmp_path) == table


def stopped(arguments: list[str], folder: Path, number: signal.Signals, points: int) -> str:
    """Run until so many points are printed, stop the program, and return what it printed."""
    with subprocess.Popen(
        command(arguments),
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        printed, seen = "", 0
        for text in process.stdout:
            printed += text
            seen += "load factor" in text
            if seen == points:
                process.send_signal(number)
                break
        printed += process.stdout.read()
    return printed


@pytest.mark.parametrize(
    ("number", "jobs"),
    [
        pytest.param(signal.SIGINT, "2", marks=pytest.mark.slow),
        (signal.SIGINT, "1"),
        pytest.param(signal.SIGTERM, "1", marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, "2", marks=pytest.mark.slow),
    ],
)
def test_ctrl_c_and_sigterm_keep_what_is_done(number, jobs, tmp_path, capsys):
    write_scene(tmp_path, FAST, "wall")
    line = ["sweep", "scene.toml", "-o", "out", "--vary", f"{BOTH}=0.2:0.6:12"]
    printed = stopped([*line, "--jobs", jobs], tmp_path, number, 2)
    assert "the same command goes on" in printed
    assert 2 <= len(rows(tmp_path / "out")) < 12
    line[1], line[3] = tmp_path / "scene.toml", tmp_path / "out"
    found = run_here(line, capsys)
    assert found.code == 0 and "points are there already" in found.out
    assert len(rows(tmp_path / "out")) == 12


@pytest.mark.slow
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_sweep_killed_five_times_gives_the_same_table(jobs, tmp_path):
    write_scene(tmp_path, mesh="wall")
    vary = ["--vary", f"{BOTH}=0.2:0.6:25"]
    assert run(["sweep", "scene.toml", "-o", "whole", *vary], tmp_path).code == 0
    line = ["sweep", "scene.toml", "-o", "killed", *vary, "--jobs", jobs]
    counts = []
    for _ in range(5):
        stopped(line, tmp_path, signal.SIGKILL, 2)
        counts.append(len(rows(tmp_path / "killed")))
    assert counts == sorted(set(counts)) and counts[-1] < 25
    assert run(line, tmp_path).code == 0
    assert rows(tmp_path / "killed") == rows(tmp_path / "whole")
    assert files(tmp_path / "killed") == files(tmp_path / "whole")


@pytest.mark.slow
def test_processes_and_ranks_give_the_same_table(tmp_path, capsys):
    """Processes or ranks: not both."""
    write_scene(tmp_path, FAST)
    line = ["sweep", tmp_path / "scene.toml", "--vary", f"{BOTH}=0.1,0.2", "-o"]
    assert run_here([*line, tmp_path / "one"], capsys).code == 0
    table = rows(tmp_path / "one")
    found = run_here([*line, tmp_path / "jobs", "--jobs", "2"], capsys)
    assert (found.code, found.err) == (0, "") and rows(tmp_path / "jobs") == table
    assert run([*line, "ranks"], tmp_path, 2).code == 0
    for row, one in zip(rows(tmp_path / "ranks"), table, strict=True):
        assert float(row["load_factor"]) == pytest.approx(float(one["load_factor"]), rel=1e-6)
    refused = run([*line, "other", "--jobs", "2"], tmp_path, 2)
    assert refused.code == 2 and refused.err.count("--jobs 2 under mpirun") == 1
    assert not (tmp_path / "other").exists()


def test_sweep_of_a_file_in_python(tmp_path):
    write_scene(tmp_path)
    found = sweep(tmp_path / "scene.toml", {BOTH: "0.1:0.2:2"}, tmp_path / "out")
    record = json.loads((tmp_path / "out" / "sweep.json").read_text())
    assert list(record["vary"].values()) == [[0.1, 0.2]]
    again = sweep(tmp_path / "scene.toml", {BOTH: [0.1, 0.2]}, tmp_path / "out")
    assert again.column("seconds").tolist() == found.column("seconds").tolist()


@pytest.fixture(scope="module")
def solved(tmp_path_factory) -> Path:
    """A folder with a scene and a sweep of it."""
    folder = tmp_path_factory.mktemp("solved")
    sweep(write_scene(folder), {BOTH: [0.1, 0.2]}, folder)
    return folder


@pytest.fixture
def again(solved, tmp_path) -> list[object]:
    """Arguments for the same sweep in a copy of its folder, which is `tmp_path`."""
    shutil.copytree(solved, tmp_path, dirs_exist_ok=True)
    return ["sweep", tmp_path / "scene.toml", "-o", tmp_path, "--vary", f"{BOTH}=0.1,0.2"]


def change(path: Path, column: str, text: str) -> None:
    """Another text in a column of the second row."""
    head, first, second = list(csv.reader(path.read_text().splitlines()))
    second[head.index(column)] = text
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([head, first, second])


@pytest.mark.parametrize(
    ("column", "text", "message"),
    [
        ("factorizations", "abc", "line 3, cannot be read: could not convert string to float"),
        ("load_factor", "0,3", "line 3, cannot be read"),
        ("factorizations", "inf", "line 3, cannot be read"),
        ("status", "solved", "line 3, cannot be read: unknown status 'solved'; remove the line"),
        ("load_factor", "0.3", "line 3, cannot be read: load factor 0.3 is outside its bracket"),
        ("load_factor", "0.1999", "load factor 0.1999 is outside its bracket, 0.2 to 0.2"),
        ("lower", "0.21", "load factor 0.2 is outside its bracket, 0.21 to 0.2"),
        ("load_factor", "", "status 'limit' with the load factor nan"),
        ("load_factor", "inf", "status 'limit' with the load factor inf"),
        ("status", "unbounded", "status 'unbounded' with the load factor 0.2"),
    ],
)
def test_table_that_was_touched_by_hand_is_refused(column, text, message, again, tmp_path, capsys):
    change(tmp_path / "sweep.csv", column, text)
    before = files(tmp_path), (tmp_path / "sweep.csv").read_text()
    found = run_here(again, capsys)
    assert (found.code, found.out, found.err.count("\n")) == (2, "", 1)
    assert message in found.err
    assert (files(tmp_path), (tmp_path / "sweep.csv").read_text()) == before


def test_whole_number_with_a_point_is_one(again, tmp_path, capsys):
    """As spreadsheets write them."""
    table = rows(tmp_path)
    change(tmp_path / "sweep.csv", "factorizations", f"{table[1]['factorizations']}.0")
    found = run_here(again, capsys)
    assert found.code == 0 and "2 of 2 points are there already" in found.out
    assert rows(tmp_path) == table


def test_table_of_other_columns_is_kept(again, tmp_path, capsys):
    path = tmp_path / "sweep.csv"
    path.write_text(path.read_text().replace(",", ";"))
    found = run_here(again, capsys)
    assert found.code == 2 and "has other columns than this sweep" in found.err
    assert path.read_text().count(";") > 20


@pytest.mark.parametrize("encoding", ["utf-8-sig", "latin-1", "utf-16", "cp037"])
def test_table_in_another_encoding(encoding, tmp_path, capsys):
    """With a mark at its beginning, as spreadsheets save UTF-8, it is read; others are named."""
    write_scene(tmp_path, FAST | {"title": "A"})
    vary = ["--vary", 'title="\u00e4","\u00f6"']
    line = ["sweep", tmp_path / "scene.toml", *vary, "-o", tmp_path / "out"]
    assert run_here(line, capsys).code == 0
    table = rows(tmp_path / "out")
    path = tmp_path / "out" / "sweep.csv"
    data = path.read_text(encoding="utf-8").encode(encoding)
    path.write_bytes(data)
    found = run_here(line, capsys)
    if encoding == "utf-8-sig":
        assert found.code == 0 and "2 of 2 points are there already" in found.out
        assert rows(tmp_path / "out") == table
        return
    assert (found.code, found.out, found.err.count("\n")) == (2, "", 1)
    assert "sweep.csv' is no table in UTF-8" in found.err and "save it as CSV" in found.err
    assert path.read_bytes() == data


def test_table_is_never_written_through_a_link(tmp_path, capsys):
    write_scene(tmp_path)
    folder = tmp_path / "scene_sweep"
    folder.mkdir()
    mine = tmp_path / "mine"
    mine.write_text("mine")
    names = ("sweep.csv", "sweep.png", ".sweep.csv.new", ".sweep.json.new")
    for name in names:
        (folder / name).symlink_to(mine)
    found = run_here(["sweep", tmp_path / "scene.toml", "--vary", f"{BOTH}=0.1,0.2"], capsys)
    assert (found.code, mine.read_text()) == (0, "mine")
    assert len(rows(folder)) == 2 and not (folder / "sweep.csv").is_symlink()


@pytest.mark.parametrize("size", [2000, *slow(0, 200)])
def test_full_disk_has_its_place_in_the_message(size, tmp_path):
    """Before the first row, within the table, and within the picture."""
    write_scene(tmp_path)
    values = ",".join(f"{0.1 + 0.001 * k:.3f}" for k in range(6))
    program = [sys.executable, "-c", ON_A_FULL_DISK, str(size)]
    line = [*program, "sweep", "scene.toml", "--vary", f"{BOTH}={values}", "-o", "out"]
    found = run_command(line, tmp_path)
    assert (found.code, found.err.count("\n")) == (4, 1)
    assert "cannot write to 'out': File too large; choose another folder" in found.err
    left = files(tmp_path / "out")
    assert left <= {"sweep.csv", "sweep.json"} and ("sweep.json" in left) == (size >= 2000)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "\xff"])
def test_broken_record_is_refused(text, again, tmp_path, capsys):
    (tmp_path / "sweep.json").write_bytes(text.encode("latin-1"))
    found = run_here(again, capsys)
    assert (found.code, found.out, found.err.count("\n")) == (2, "", 1)
    assert "sweep.json' cannot be read" in found.err and "choose another folder" in found.err


def test_too_many_points_are_refused_at_once(tmp_path, capsys):
    write_scene(tmp_path)
    vary = ["--vary", f"{BOTH}=0.1:0.9:100000", "--vary", "solve.tolerance=1e-7:1e-6:100000"]
    found = run_here(["sweep", tmp_path / "scene.toml", *vary], capsys)
    assert (found.code, found.err.count("\n")) == (2, 1)
    assert "the sweep has more than 100000 points" in found.err
    assert files(tmp_path) == {"scene.toml", "block.msh"}
