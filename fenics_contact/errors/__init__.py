"""Exceptions of the package; `checks` raises them for arguments of a wrong type."""

from fenics_contact.errors.exceptions import (
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
