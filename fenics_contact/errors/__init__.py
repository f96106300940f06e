"""Exceptions of the package; `checks` raises them for arguments of a wrong type."""

from fenics_contact.errors.exceptions import (
    BAD_INPUT,
    EXIT_CODES,
    FAILED,
    INTERRUPTED,
    ContactError,
    EffortError,
    InputError,
    NoEquilibriumError,
    OutputError,
    SolverError,
    Stopped,
    raised_together,
    require,
)

__all__ = [
    "BAD_INPUT",
    "EXIT_CODES",
    "FAILED",
    "INTERRUPTED",
    "ContactError",
    "EffortError",
    "InputError",
    "NoEquilibriumError",
    "OutputError",
    "SolverError",
    "Stopped",
    "raised_together",
    "require",
]
