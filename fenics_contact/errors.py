"""Exceptions of the package, and how all ranks of a communicator raise the same one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpi4py import MPI


class ContactError(Exception):
    """Base of every exception this package raises on purpose."""


class InputError(ContactError):
    """The scene or its mesh is wrong; the message names the thing and what to do."""


class SolverError(ContactError):
    """A solver stopped without an answer; the message names its reason and residual."""


@contextmanager
def raised_together(comm: MPI.Comm) -> Iterator[None]:
    """Turn an `InputError` raised by some ranks inside the block into the same one on all ranks.

    The block itself must not communicate: a rank that raises leaves it early.

    Args:
        comm: Communicator of the ranks that enter the block together.

    Raises:
        InputError: On every rank, the one of the lowest rank that raised.
    """
    message = None
    try:
        yield
    except InputError as error:
        message = str(error)
    messages = [m for m in comm.allgather(message) if m is not None]
    if messages:
        raise InputError(messages[0])
