"""Exceptions of the package, and how all ranks of a communicator raise the same one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mpi4py import MPI


class ContactError(Exception):
    """Base of every exception this package raises on purpose."""


class InputError(ContactError):
    """The scene or its mesh is wrong; the message names the thing and what to do."""


class SolverError(ContactError):
    """A solver stopped without an answer; the message names its reason and residual."""


@contextmanager
def raised_together(comm: MPI.Comm) -> Iterator[None]:
    """Raise on all ranks the `InputError` of the lowest rank that raised one inside the block.

    The block itself must not communicate: a rank that raises leaves it early.
    """
    message = None
    try:
        yield
    except InputError as error:
        message = str(error)
    messages = [m for m in comm.allgather(message) if m is not None]
    if messages:
        raise InputError(messages[0])
