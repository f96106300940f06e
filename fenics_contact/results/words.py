"""Numbers in words, as all answers tell them."""

from __future__ import annotations

from fenics_contact.scene.units import rounded_alike


def alike(value: float | None, leading: float | None) -> str:
    """A load factor rounded to the decimals of the leading one; "not known" for none and nan."""
    if value is None or value != value:
        return "not known"
    return rounded_alike([leading if leading else value, value])[1]


def counted(number: int, noun: str) -> str:
    """A number with its noun, in the plural where that is due."""
    return f"{number} {noun}{'s' * (number != 1)}"
