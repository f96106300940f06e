"""Exceptions of the package, and how all ranks of a communicator raise the same one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from mpi4py import MPI


#: Codes with which the program ends, by status of the result, and for other ends.
EXIT_CODES = {"limit": 0, "unbounded": 0, "unstable": 3, "no_equilibrium": 3, "not_converged": 4}
FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130


class ContactError(Exception):
    """Base of every exception this package raises on purpose; the program ends with its code."""

    exit_code = EXIT_CODES["not_converged"]


class InputError(ContactError):
    """The scene or its mesh is wrong; the message names the thing and what to do."""

    exit_code = BAD_INPUT


class OutputError(ContactError):
    """A file of the result cannot be written; the message names the folder and the reason."""


class SolverError(ContactError):
    """A solver stopped without an answer; the message names its reason and residual."""


class NoEquilibriumError(SolverError):
    """No state was found under the dead load alone; the message says what is known of it."""


class EffortError(SolverError):
    """A hard limit on the number of factorisations is reached."""


class Stopped(ContactError):
    """The run is to end: its time is over, or somebody asked for it; the message says which."""


def require(condition: bool, message: str, error: type[Exception] = InputError) -> None:
    """Raise an error with a message where a condition does not hold."""
    if not condition:
        raise error(message)


@contextmanager
def raised_together(comm: MPI.Comm) -> Iterator[None]:
    """Raise on all ranks the input or output error of the lowest rank that raised one inside.

    The block itself must not communicate after a place where it may raise: a rank that raises
    leaves it early.
    """
    failure = None
    try:
        yield
    except (InputError, OutputError) as error:
        failure = type(error), str(error)
    failures = [one for one in comm.allgather(failure) if one is not None]
    if failures:
        kind, message = failures[0]
        raise kind(message)
