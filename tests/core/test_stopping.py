"""Runs that are stopped: what is known by then is the result."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from mpi4py import MPI

from fenics_contact import InputError, OutputOptions, SolveOptions, equilibrium, limit_load
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.limit_load import Monitor
from fenics_contact.results.history import CapacityPoint
from tests.bank import coulomb, wall_recipe
from tests.core.problems import BOND


class Asked:
    """Somebody who asks to stop when asked for the n-th time."""

    def __init__(self, patience: int) -> None:
        self.left = patience

    def __call__(self) -> str:
        self.left -= 1
        return "a test" if self.left < 0 else ""


class Interrupting(Monitor):
    """Asks to stop after a point of the capacity curve."""

    def __init__(self, asked: Asked, last: int) -> None:
        self.asked, self.last = asked, last

    def point(self, done: int, total: int, point: CapacityPoint) -> None:
        if done == self.last:
            self.asked.left = 0


def stopped_after(factorizations: int, **options):
    recipe = wall_recipe("W1", coulomb(0.65))
    scene = replace(recipe.scene(1), solve=SolveOptions(**options))
    return limit_load(scene, stop=Asked(factorizations))


def test_stopped_before_any_state():
    found = stopped_after(0)
    assert found.status == "not_converged" and np.isnan(found.load_factor)
    assert found.reason() == "stopped by a test, before any state was looked for"
    assert found.stopped == "stopped by a test"
    assert found.factorizations == 0


def test_stopped_on_the_path():
    found = stopped_after(8)
    end = found.collapse
    assert (found.status, found.factorizations) == ("not_converged", 8)
    assert found.reason().startswith("stopped by a test; the path (block modes, rising work)")
    assert end.load_factor == end.trace[-1].load_factor == end.state.load_factor
    assert end.attempts[-1].outcome.endswith("stopped by a test")
    assert not end.attempts[-1].found
    # The best point shows how the blocks begin to move, and lies in the bracket's numbers.
    with Discretization(found.scene) as made:
        work = made.elasticity.live @ end.mode
    assert work == pytest.approx(1.0)
    assert "not verified" in found.plot().get_title()
    assert "not verified" in found.plot_forces().get_title()
    assert end.bounds.lower == 0.0 and end.bounds.upper == pytest.approx(0.642857, rel=1e-5)


def test_what_is_left_of_a_verified_load_factor_is_not_known():
    whole = stopped_after(10**9, fast=True)
    found = stopped_after(whole.factorizations)
    assert found.status == "limit" and found.stopped == "stopped by a test"
    assert found.load_factor == pytest.approx(whole.load_factor, rel=1e-9)
    end = found.collapse
    assert (end.peak.status, end.lowest.status) == ("not_known", "not_known")
    assert end.peak.reason == end.lowest.reason == end.hinges.reason == "stopped by a test"
    assert np.isnan(end.hinges.points) and end.range.status == "known"
    assert found.reason() == ""


def test_stopped_in_the_second_direction():
    whole = stopped_after(10**9, fast=True)
    found = stopped_after(whole.factorizations + 3, fast=True, direction="both")
    assert found.positive.status == "limit" and found.negative.status == "not_converged"
    assert found.positive.load_factor == pytest.approx(whole.load_factor, rel=1e-9)
    assert found.status == "not_converged" and "stopped by a test" in found.reason()


def test_time_is_over():
    found = stopped_after(10**9, time=1e-3)
    assert found.status == "not_converged"
    assert found.reason().startswith("stopped after 0.001 s (solve.time)")


def test_time_is_over_for_equilibrium():
    scene = wall_recipe("W1", coulomb(0.65)).scene(1)
    found = equilibrium(replace(scene, solve=SolveOptions(time=1e-6)), 0.5)
    assert (found.status, found.state) == ("not_converged", None)
    assert found.reason == "stopped after 1e-06 s (solve.time)"


def test_a_curve_that_is_stopped_keeps_its_points():
    scene = BOND.scene(1)
    found = limit_load(replace(scene, solve=SolveOptions(fast=True)))
    whole = found.trace_capacity(points=4)
    asked = Asked(10**9)
    listener = Interrupting(asked, 2)
    assert found.trace_capacity(listener, points=4, stop=asked) == whole[:2]
    assert found.trace_capacity(points=4, stop=Asked(0)) == ()


@pytest.mark.parametrize("seconds", [0.0, -1.0, float("inf")])
def test_time_must_be_positive(seconds):
    with pytest.raises(InputError, match="time = "):
        SolveOptions(time=seconds)


def test_load_factor_alone():
    none = {"error": False, "peak": False, "lowest": False}
    whole, fast = stopped_after(10**9, **none), stopped_after(10**9, fast=True)
    assert fast.load_factor == whole.load_factor
    assert fast.factorizations == whole.factorizations
    assert fast.collapse.hinges is None
    assert (fast.collapse.peak.status, fast.collapse.lowest) == ("not_known", None)
    assert any(text.endswith("solve.fast = true") for text in fast.skipped)


def test_no_accuracy_without_estimate():
    with pytest.raises(InputError, match="fast = false"):
        SolveOptions(fast=True, accuracy=0.01)


@pytest.mark.parametrize(
    "more", [{"peak": True}, {"lowest": True}, {"error": True}, {"states": "lowest"}]
)
def test_what_fast_leaves_out_cannot_be_asked_for(more):
    with pytest.raises(InputError, match="needs fast = false"):
        SolveOptions(fast=True, **more)


def engine_stopped_after(asks: int, name: str = "W3", gap: float = 1e-12):
    """A search of the face engine for a gap that it never reaches, stopped in the end."""
    scene = wall_recipe(name, replace(coulomb(0.65), compressive_strength=1e6)).scene(1)
    options = SolveOptions(fast=True, engine="faces", gap=gap)
    output = OutputOptions(pictures=False)
    return limit_load(replace(scene, solve=options, output=output), stop=Asked(asks))


def test_the_best_certified_state_is_the_result_of_a_stopped_search(folder):
    """However late it is stopped: first there is none, then always one."""
    gaps = []
    for asks in (0, 2, 4, 8, 16):
        found = engine_stopped_after(asks)
        assert found.stopped == "stopped by a test"
        found.write(folder / str(asks))
        record = json.loads((folder / str(asks) / "result.json").read_text())
        assert (record["status"], record["stopped"]) == (found.status, "stopped by a test")
        if found.status == "limit":
            end = found.positive
            assert end.engine == "faces" and end.certificate.passed
            assert record["load_factor"] == found.load_factor
            gaps.append(end.gap)
        else:
            assert not gaps and record["load_factor"] is None
            assert found.reason().startswith("stopped by a test")
    assert len(gaps) >= 2 and gaps == sorted(gaps, reverse=True) and max(gaps) <= 1e-2


@pytest.mark.mpi
def test_ranks_are_stopped_together_with_a_state():
    found = engine_stopped_after(8)
    assert (found.status, found.stopped) == ("limit", "stopped by a test")
    assert len(set(MPI.COMM_WORLD.allgather(repr(found.load_factor)))) == 1


def test_time_is_over_for_the_face_engine():
    scene = wall_recipe("W3", coulomb(0.65)).scene(1)
    options = SolveOptions(fast=True, engine="faces", time=1e-3)
    found = limit_load(replace(scene, solve=options))
    assert found.status == "not_converged"
    assert found.reason().startswith("stopped after 0.001 s (solve.time)")
