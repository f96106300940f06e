"""What a scene does not need, decided once and said in the log and in result.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from fenics_contact.scene import Scene

if TYPE_CHECKING:
    from fenics_contact.analysis.coulomb import FixedPointHistory

FIXED_POINT = "fixed point on the friction bound"


@dataclass(frozen=True)
class Plan:
    """Work that a scene spares.

    Attributes:
        coulomb: Whether the bound on friction depends on the pressure; if not, one solve is enough.
        skipped: What is skipped and why, for people.
    """

    coulomb: bool
    skipped: tuple[str, ...]

    def after(self, histories: Sequence[FixedPointHistory]) -> Plan:
        """With what turned out not to be needed.

        Args:
            histories: Of the fixed point, over all T.
        """
        spared = all(history.at_once for history in histories)
        if not (self.coulomb and histories and spared):
            return self
        reason = "the monolithic step alone found the state"
        return replace(self, skipped=(*self.skipped, f"{FIXED_POINT}: {reason}"))


def make_plan(scene: Scene) -> Plan:
    """Decide what a scene needs."""
    laws = [*scene.joints.values(), *scene.foundations.values()]
    coulomb = any(law.law == "coulomb" and law.friction for law in laws)
    skipped = []
    if not coulomb:
        skipped.append(f"{FIXED_POINT}: no joint has Coulomb friction")
    if not any(law.law != "frictionless" and (law.friction or law.bound) for law in laws):
        skipped.append("shear forces: no joint has friction")
    for name, load in (("dead", scene.dead), ("live", scene.live)):
        if not load.traction:
            skipped.append(f"{name} tractions: none given")
        if not any(load.body):
            skipped.append(f"{name} body force: none given")
    if scene.solve.direction != "both":
        other = {"positive": "negative", "negative": "positive"}[scene.solve.direction]
        skipped.append(f"{other} direction: solve.direction = '{scene.solve.direction}'")
    if not scene.output.capacity:
        skipped.append("capacity curve: output.capacity = 0")
    if not scene.output.paraview:
        skipped.append("stress recovery and ParaView files: output.paraview = false")
    if not scene.output.pictures:
        skipped.append("pictures: output.pictures = false")
    return Plan(coulomb, tuple(skipped))
