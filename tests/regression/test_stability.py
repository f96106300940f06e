"""Quick subset of the numerical stress tests in benchmarks/stability.py."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import pytest


def load_script():
    """The script as a module, with its dataclasses' module known."""
    path = Path(__file__).parents[2] / "benchmarks" / "stability.py"
    spec = importlib.util.spec_from_file_location("stability", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


stability = load_script()


@pytest.fixture(scope="module")
def runner():
    return stability.Runner()


@pytest.mark.parametrize("case", stability.selected(quick=True), ids=lambda case: case.name)
def test_quick_case(runner, case):
    row = runner.run(case)
    assert row.verdict == "ok", stability.line(row)


def test_verdicts_tell_wrong_from_not_converged():
    verdict = stability.verdict
    assert verdict("limit", "limit", True) == "ok"
    assert verdict("limit", "limit", False) == "WRONG"
    assert verdict("limit", "unbounded", True) == "WRONG"
    assert verdict("unstable", "limit", True) == "WRONG"
    assert verdict("limit", "not_converged", True) == "not converged"
    assert verdict("limit", "unstable", False) == "unstable"
    assert verdict("unstable", "unstable", False) == "ok"


def test_moved_nodes_leave_the_blocks_alone():
    """Areas of the blocks and lengths of the joints stay, nodes do not."""
    model = stability.wall_model("W3")
    before, cells, facets = stability.arrays(model)
    after, _, _ = stability.shaken(1, before, cells, facets)
    assert 0.0 < abs(after - before).max() < 0.05
    for points in (before, after):
        corners = points[cells["blocks"]]
        first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
        assert area.min() > 0.0
        if points is before:
            total = area.sum()
    assert area.sum() == pytest.approx(total, rel=1e-12)
