"""The measurements of benchmarks/run.py, and what benchmarks/report.py makes of them."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from mpi4py import MPI

from benchmarks import report, run
from benchmarks.run import AUTO, FIXED_POINT, PROGRAM, References, Row, Task

WALL = Row(
    "W4 F=0.65",
    elements=2,
    friction=0.65,
    dofs=1000,
    method="auto",
    tolerance=1e-6,
    status="limit",
    verified=True,
    seconds=2.0,
    bonded_solves=10.0,
    load_factor=0.5,
    reference=0.5,
    reference_kind="fixed-point to 1e-10",
    error=1e-8,
    machine="processor, 2 cores",
    versions="one 1.0, two 2.0",
)
PEER = replace(
    WALL, method="peer", verified=False, tolerance=math.nan, error=0.1, bonded_solves=math.nan
)


def same(first: Row, second: Row) -> bool:
    """Equality that takes nan for equal to nan."""
    return repr(first) == repr(second)


def test_rows_come_back_from_a_file(tmp_path):
    path = tmp_path / "rows.csv"
    rows = [WALL, PEER, Row("a, b", repeat=0)]
    for row in rows:
        run.append_row(path, row)
    assert all(same(*pair) for pair in zip(run.read_rows(path), rows, strict=True))


def test_file_with_other_columns_is_left_alone(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_text("scene,law\nW1,coulomb\n")
    with pytest.raises(ValueError, match="other columns"):
        run.append_row(path, WALL)
    assert path.read_text() == "scene,law\nW1,coulomb\n"


def test_medians_are_of_rows_that_count():
    rows = [
        replace(WALL, seconds=seconds, repeat=k + 1) for k, seconds in enumerate((3.0, 1.0, 2.0))
    ]
    rows += [
        replace(WALL, seconds=50.0, verified=False, status="not_converged"),
        replace(WALL, seconds=60.0, repeat=0),
        replace(WALL, seconds=7.0, ranks=2),
        PEER,
        replace(PEER, seconds=4.0),
        replace(PEER, method="silent peer", load_factor=math.nan),
    ]
    typical = run.medians(rows)
    found = [(row.method, row.ranks, row.seconds, row.repeat) for row in typical]
    assert found == [("auto", 1, 2.0, 3), ("auto", 2, 7.0, 1), ("peer", 1, 3.0, 2)]


def test_cases_are_told_apart_by_name_and_mesh():
    cases = run.cases()
    assert len({(case.name, case.elements) for case in cases}) == len(cases)
    for case in cases:
        assert isinstance(case.reference, float) or case.reference in (PROGRAM, FIXED_POINT, AUTO)
        assert not case.finest or run.case_named(case.name, case.finest)
    chosen = run.selected("w[23]*0.65", (4, 8))
    assert [(case.name, case.elements) for case in chosen] == [
        (name, elements) for name in ("W2 F=0.65", "W3 F=0.65") for elements in (4, 8)
    ]


def test_methods_take_turns():
    case = run.case_named("wedge F=0.2", 2)
    turns = run.tasks(case, ["auto", "monolithic"], [1e-6], [1, 2], 2)
    assert [(task.method, task.ranks, task.repeat) for task in turns] == [
        *[("auto", 1, 1), ("monolithic", 1, 1), ("auto", 2, 1), ("monolithic", 2, 1)],
        *[("monolithic", 2, 2), ("auto", 2, 2), ("monolithic", 1, 2), ("auto", 1, 2)],
    ]


def test_references_are_taken_from_earlier_rows():
    finest = run.SIZES[-1]
    rows = [WALL, replace(WALL, elements=finest, reference=0.4)]
    references = References(rows, time_out=0.0)
    row = references.compare(replace(WALL, load_factor=0.6), run.case_named("W4 F=0.65", 2))
    assert row.error == pytest.approx(0.2)
    assert (row.reference_finest, row.error_finest) == (0.4, pytest.approx(0.5))
    assert references.of(run.case_named("wedge F=0.2", 2)) == (
        pytest.approx(0.4264946007, rel=1e-9),
        "closed form",
    )
    value, kind = references.of(run.case_named("W1 F=0.65", 2))
    assert math.isnan(value)
    assert kind == "none"


def test_references_are_computed_once(monkeypatch):
    answers = {
        "fixed-point": replace(WALL, method="fixed-point", status="not_converged", verified=False),
        "auto": WALL,
    }
    monkeypatch.setattr(run, "run", lambda task, time_out: answers[task.method])
    made: list[Row] = []
    references = References([], 1.0, made.append)
    for _ in range(2):
        assert references.of(run.case_named("W4 F=0.65", 2)) == (0.5, "auto to 1e-10")
    assert [row.method for row in made] == ["fixed-point", "auto"]


def test_measured_row_is_verified():
    task = Task("wedge F=0.2", 2, "auto", 1e-6, MPI.COMM_WORLD.size)
    row = References([], 0.0).compare(run.measure(task), run.case_named(task.case, 2))
    assert row.counts
    assert row.status == "limit"
    assert row.error < 1e-6
    assert row.residual <= 1.0
    assert (row.bodies, row.ranks) == (3, task.ranks)
    assert min(row.dofs, row.joint_points, row.factorizations, row.peak_memory) > 0
    assert row.mode_factorizations == 0  # so few blocks need no modes
    assert row.bonded_solves == row.seconds / row.seconds_bonded
    assert "PETSc 3" in row.versions


@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="starts processes of its own")
def test_process_that_takes_too_long_is_a_row():
    row = run.run(Task("wedge F=0.2", 2, "auto", 1e-6), 0.01)
    assert (row.case, row.method, row.status) == ("wedge F=0.2", "auto", "time-out")
    assert not row.counts


def test_exponent_is_that_of_every_curve():
    curves = [
        [replace(WALL, dofs=n, seconds=factor * n**1.5) for n in (100, 1000, 5000)]
        for factor in (1.0, 7.0)
    ]
    assert report.exponent(curves) == pytest.approx(1.5)
    assert math.isnan(report.exponent([[WALL]]))


def test_panels_show_curves_and_other_programs():
    rows = [replace(WALL, case="10x10 F=0.4", tolerance=t) for t in (1e-3, 1e-6)]
    rows += [replace(WALL, elements=n, error_finest=1.0 / n) for n in (1, 2, 4)]
    rows += [PEER, replace(PEER, case="wedge F=0.2"), replace(WALL, case="arch")]
    shown = [(panel.title.split(",")[0], panel.over) for panel in report.panels(rows)]
    assert shown == [
        ("10x10 F=0.4", "tolerance"),
        ("W4 F=0.65", "elements"),
        ("wedge F=0.2", "tolerance"),
    ]
    exact = report.Panel("", rows, "tolerance").error(replace(WALL, error=0.0))
    assert exact == report.LEAST_ERROR


def test_table_has_ratios_and_statuses():
    slow = replace(WALL, method="fixed-point", seconds=8.0)
    late = replace(WALL, method="splitting", status="time-out", verified=False)
    lines = report.table([WALL, slow, late, PEER])
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    ratios = {row[4]: (row[7], row[-1]) for row in cells[2:]}
    assert len({len(row) for row in cells}) == 1
    assert ratios == {
        "auto": ("2", "1"),
        "fixed-point": ("8", "4"),
        "splitting": ("time-out", "\u2013"),
        "peer": ("2", "1"),
    }


@pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="draws on every rank")
def test_pictures_are_drawn(tmp_path):
    rows = [
        replace(WALL, elements=n, dofs=100 * n**2, method=method, ranks=ranks, error_finest=0.1 / n)
        for n in (1, 2, 4)
        for method in ("auto", "fixed-point")
        for ranks in (1, 2)
    ]
    report.draw_time_error([*rows, PEER], tmp_path / "time_error.png")
    report.draw_cost_size([*rows, PEER], tmp_path / "cost_size.png")
    report.draw_cost_size([WALL], tmp_path / "nothing.png")
    for name in ("time_error", "cost_size", "nothing"):
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
