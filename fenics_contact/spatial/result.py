"""The limit load of rigid blocks without a mesh, in the plane or in space: data and words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fenics_contact.console import summary
from fenics_contact.faces.limit import LED
from fenics_contact.results.history import CapacityPoint
from fenics_contact.results.result import ANOTHER, ByDirection, Collapse
from fenics_contact.results.values import listed_blocks
from fenics_contact.results.wording import Line, Wording, wording_of
from fenics_contact.scene.units import Units
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.structure import Structure

#: What forces at the corners of contacts leave out.
QUICK = "torsion is not limited: contacts have forces at their corners alone (solve.quick)"
#: Tensions over the yield of ties below and above which these are slack and yield.
SLACK, YIELDS = 1e-6, 0.999


@dataclass(frozen=True, repr=False)
class SpatialLimit(ByDirection):
    """Limit loads of rigid blocks.

    Attributes:
        scene: What was asked for; None for a structure alone.
        structure: Its blocks, contacts and loads.
        ends: Collapse by direction, "positive" first.
        seconds: By what they were spent on.
        ranks: How many ranks shared the tasks.
    """

    scene: Any
    structure: Structure
    ends: Mapping[str, Collapse]
    seconds: Mapping[str, float] = field(default_factory=dict)
    ranks: int = 1

    @property
    def factorizations(self) -> int:  # type: ignore[override]
        """Of face systems."""
        return sum(collapse.factorizations for collapse in self.ends.values())

    @property
    def capacity(self) -> tuple[CapacityPoint, ...]:  # type: ignore[override]
        """Points of the capacity curve of the first direction."""
        return next(iter(self.ends.values())).curve

    @property
    def stopped(self) -> str:  # type: ignore[override]
        """Why the run was ended early; empty where it was not."""
        return next((c.stopped for c in self.ends.values() if c.stopped), "")

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is legal in the scene and probably meant otherwise."""
        return self.structure.warnings

    @property
    def wording(self) -> Wording:
        """How its load factors are told."""
        resultant = self.structure.told(self.structure.live[:, :3].sum(axis=0)).tolist()
        if self.scene is None:
            return Wording(Units("SI", 1.0), load=math.hypot(*resultant), both=len(self.ends) > 1)
        return wording_of(self.scene, resultant, both=len(self.ends) > 1)

    def summary(self, verbose: bool = False) -> str:
        """The answer in three to five lines; with all that is known of it, if that is wished."""
        return summary(self, verbose)

    def ties_of(self, end: Collapse) -> dict[str, Any]:
        """Names, forces, yields and states (`TieState`) of ties; empty without ties or forces."""
        return ties_of(self.structure, end)

    def own_lines(self, end: Collapse, words: Wording) -> list[Line]:
        """Another state, blocks that wedge, strengths that are exceeded, and ties."""
        lines = []
        for one in end.states[1:]:
            apart = abs(one.load_factor - end.load_factor) > ANOTHER * abs(end.load_factor)
            if apart and one.start in LED.values() and not end.searched:
                text = words.beside(one.load_factor, end.load_factor, end.sign)
                lines.append(Line("also found:", text, states=True))
        if end.falling:
            blocks = named(self.structure, end.falling, "wedge")
            lines.append(Line("no load is excluded:", blocks, states=True))
        beyond = end.residuals.get("crushing", 0.0)
        if beyond > SEARCH.verified:
            text = f"a contact exceeds its strength by {beyond:.0e} of the largest load on a block"
            lines.append(Line("crushing:", text))
        return lines + super().own_lines(end, words)

    @property
    def remarks(self) -> list[str]:
        """Whether the curve is complete, and what the model leaves out."""
        return super().remarks + [QUICK] * (self.structure.quick and bool(self.limits))


def ties_of(structure: Structure, end: Collapse) -> dict[str, Any]:
    """Names, forces, yields and states (`TieState`) of bars; empty without forces of any."""
    if end.tension is None or not len(end.tension):
        return {}
    limit = structure.yields
    state = np.digitize(end.tension / limit, [SLACK, YIELDS])
    names = np.array([bar.key.partition(".")[2] for bar in structure.bars])
    return {"name": names, "force": end.tension, "yield": limit, "state": state}


def named(structure: Structure, numbers: Sequence[int], does: str) -> str:
    """Blocks by name, as far as a line has room, and what they do."""
    return listed_blocks([structure.blocks[k].name or str(k) for k in numbers], does)
