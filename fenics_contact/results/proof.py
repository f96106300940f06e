"""Words on load factors that the forces of joint faces led to."""

from __future__ import annotations

import math

from fenics_contact.scene.units import rounded_alike

#: What is not known of such a load factor, and need not be.
WITHOUT_PATH = (
    "rigid blocks with elastic faces: no error by a mesh; what elastic blocks carry on the way to"
    " this collapse was not followed"
)
#: Of the lowest state, wherever it is told.
SELF_STRESS = "with any self-stress in the blocks"
NOT_FROM_REST = "blocks that are loaded from rest need not reach it"
#: Significant digits of such load factors, at least and at most.
DIGITS = (4, 8)


def proof(load_factor: float, limit: float, crushes: bool, searched: str) -> str:
    """What is proved of a state.

    Args:
        load_factor: Its own.
        limit: That which its friction forces allow.
        crushes: Whether joints have compressive strengths.
        searched: What was searched for, in words; empty for what a load leads to.
    """
    here, end = _apart(load_factor, limit)
    what = f"the {searched}, is at" if searched else "collapses at"
    inside = "the friction cone" + " and the compressive strengths" * crushes
    # Where the dead load drives the collapse these forces need so much of the live load.
    more = "more" if abs(limit) >= abs(load_factor) else "less"
    return (
        f"{what} {here}: there is an equilibrium inside {inside} at {here}, and with its friction"
        f" forces nothing carries {more} than {end}{f'; {NOT_FROM_REST}' * bool(searched)}"
    )


def _apart(load_factor: float, limit: float) -> list[str]:
    """Both with the digits that tell them apart; the limit is rounded away from the state."""
    size = abs(load_factor) or abs(limit) or 1.0
    apart = max(abs(limit - load_factor) / size, 1e-15)
    digits = min(max(1 + math.floor(-math.log10(apart)), DIGITS[0]), DIGITS[1])
    unit = 10.0 ** (math.floor(math.log10(size)) + 1 - digits)
    outward = math.ceil if abs(limit) >= abs(load_factor) else math.floor
    rounded = outward(round(abs(limit) / unit, 6)) * unit
    return rounded_alike([load_factor, math.copysign(rounded, limit)], digits)
