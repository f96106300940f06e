"""Exceptions: one kind per cause, the same on all ranks."""

from __future__ import annotations

import pytest
from mpi4py import MPI

from fenics_contact import InputError
from fenics_contact.errors import raised_together

COMM = MPI.COMM_WORLD
LAST = COMM.size - 1


def test_error_of_one_rank_is_raised_on_all():
    with pytest.raises(InputError, match=f"^rank {LAST} has no mesh$"), raised_together(COMM):
        if COMM.rank == LAST:
            raise InputError(f"rank {LAST} has no mesh")


def test_error_of_the_lowest_rank_wins():
    with pytest.raises(InputError, match=r"^rank 0 has no mesh$"), raised_together(COMM):
        raise InputError(f"rank {COMM.rank} has no mesh")
