"""The sign of the live load on results: load factors are multiples of the live load as given.

A collapse under the reversed live load is found as one under a live load of its own. Once it is
made, its load factors get their sign: fields of the type `LoadFactor`, in whatever record they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

from fenics_contact.results.bounds import LimitBounds
from fenics_contact.solvers.problem import State

#: A number that has the sign of the live load.
LoadFactor = float


def signed(record: Any, sign: float) -> Any:
    """A record with all its load factors times a sign."""
    if sign > 0.0:
        return record
    if isinstance(record, tuple):
        return tuple(signed(item, sign) for item in record)
    if isinstance(record, Mapping):
        return {name: signed(item, sign) for name, item in record.items()}
    if isinstance(record, LimitBounds):
        return record.opposite()
    if isinstance(record, State):
        return replace(record, load_factor=-record.load_factor, work=-record.work)
    if not is_dataclass(record) or isinstance(record, type):
        return record
    values = {item.name: getattr(record, item.name) for item in fields(record)}
    marked = {item.name for item in fields(record) if item.type == "LoadFactor"}
    changed = {
        name: 0.0 - value if name in marked else signed(value, sign)
        for name, value in values.items()
    }
    return replace(record, **changed)
