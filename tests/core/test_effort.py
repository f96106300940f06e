"""Counts and limits of factorisations."""

import pytest

from fenics_contact.errors import EffortError, Stopped
from fenics_contact.solvers.effort import Effort, Tally


def test_costs_are_summed_over_tallies():
    effort = Effort()
    structure, modes = Tally(effort=effort), Tally(cost=0.2, effort=effort)
    for tally in (structure, modes, modes):
        tally.add()
    assert (structure.count, modes.count) == (1, 2)
    assert effort.spent == pytest.approx(1.4)


def test_limits_nest_and_the_tightest_counts():
    effort = Effort()
    tally = Tally(effort=effort)
    with effort.at_most(3.0):
        with effort.at_most(10.0):
            for _ in range(3):
                tally.add()
            with pytest.raises(EffortError, match="limit of 3 factorisations"):
                tally.add()
        assert effort.left == pytest.approx(0.0)
    tally.add()
    assert tally.count == 4
    with effort.at_most(1.0):
        tally.add()
        with pytest.raises(EffortError, match="limit of 1 factorisations"):
            tally.add()


def test_a_watch_stops_a_run_before_the_next_factorisation():
    def time_is_over():
        raise Stopped("30 s are over")

    effort = Effort()
    tally = Tally(effort=effort)
    effort.watch = time_is_over
    with pytest.raises(Stopped, match="30 s"):
        tally.add()
    assert tally.count == 0
