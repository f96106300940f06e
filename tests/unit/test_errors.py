"""Exceptions: one kind per cause, the same on all ranks."""

from __future__ import annotations

import pytest
from mpi4py import MPI

from fenics_contact import ContactError, InputError, SolverError
from fenics_contact.errors import raised_together

COMM = MPI.COMM_WORLD
LAST = COMM.size - 1


def test_all_errors_are_contact_errors_and_of_two_kinds():
    assert issubclass(InputError, ContactError) and issubclass(SolverError, ContactError)
    assert not issubclass(InputError, SolverError) and not issubclass(SolverError, InputError)


def test_error_of_one_rank_is_raised_on_all():
    with pytest.raises(InputError, match=f"^rank {LAST} has no mesh$"), raised_together(COMM):
        if COMM.rank == LAST:
            raise InputError(f"rank {LAST} has no mesh")


def test_error_of_the_lowest_rank_wins():
    with pytest.raises(InputError, match=r"^rank 0 has no mesh$"), raised_together(COMM):
        raise InputError(f"rank {COMM.rank} has no mesh")


def test_no_error_passes():
    done = False
    with raised_together(COMM):
        done = True
    assert done


def test_other_errors_pass_unchanged():
    with pytest.raises(SolverError, match="no answer"), raised_together(MPI.COMM_SELF):
        raise SolverError("no answer")
