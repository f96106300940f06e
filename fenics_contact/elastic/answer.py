"""Stresses in blocks in space as an answer of a collapse: under the forces of its own state."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from operator import attrgetter
from pathlib import Path
from typing import Any, Self

import numpy as np

from fenics_contact.answers.question import Asked
from fenics_contact.elastic.files import draw_stresses, write_stresses
from fenics_contact.elastic.stresses import (
    BlockStresses,
    sorted_blocks,
    stressed_blocks,
)
from fenics_contact.output.folder import going_on
from fenics_contact.results.block_view import BlockView
from fenics_contact.results.result import Collapse, Table
from fenics_contact.results.values import listed_blocks
from fenics_contact.results.wording import Line, Wording
from fenics_contact.scene.scene import OutputOptions
from fenics_contact.scene.units import Units
from fenics_contact.spatial.question import BlockQuestion
from fenics_contact.workers import result_of, workers_of

#: Title of its table, and of its picture.
TITLE = "Stresses under the forces of this state"
#: What is told of a block.
KINDS = "pressure", "tension"
#: Digits of stresses: finite elements have no more.
DIGITS = 3
#: Rows of the table at most.
ROWS = 12
#: A block whose forces miss balance by more, over the largest, is not on its mesh.
UNBALANCED = 1e-2
#: What the numbers are.
NOTE = "Other forces may be in equilibrium, too; at sharp edges stresses grow as meshes get finer."


class StressAnswer(Asked):
    """Stresses in the blocks, a `BlockStresses`."""

    value: BlockStresses
    name = key = "stress"
    place = 10
    begins = "stresses"
    asks = BlockQuestion
    with_fast = True

    @classmethod
    def is_of(cls, end: Collapse) -> bool:
        """Also of states under given loads."""
        return end.status == "equilibrium" or super().is_of(end)

    @classmethod
    def concerns(cls, question: BlockQuestion) -> bool:
        """Whether the scene asks for it."""
        return bool(question.scene.output.stress) and question.end.force is not None

    @classmethod
    def run(cls, question: BlockQuestion) -> tuple[Self | None, Collapse]:
        """Stresses by finite elements; workers share the blocks."""
        scene, structure, end = question.scene, question.structure, question.end
        shapes = sorted_blocks(scene, structure)
        share = workers_of(question.workers) + 1
        parts = [[shape[k::share] for shape in shapes if shape[k:]] for k in range(share)]
        given = scene, structure, end
        tasks = [question.workers.submit(stressed_blocks, *given, part) for part in parts[1:]]
        found = [stressed_blocks(*given, parts[0])]
        found += [result_of(task, question.check_stop) for task in tasks]
        blocks = sorted((one for part in found for one in part.blocks), key=attrgetter("block"))
        missed = {name: why for part in found for name, why in part.missed.items()}
        off = [one.name for one in blocks if one.missing > UNBALANCED]
        missed |= dict.fromkeys(off, "its forces do not balance on its mesh")
        value = BlockStresses(tuple(one for one in blocks if one.name not in off), missed)
        return cls(value), end

    def lines(self, end: Collapse, words: Wording) -> list[Line]:
        """The largest pressure and tension, and what is not known."""
        told = [Line("warning:", text) for text in _warnings(self.value, words.units)]
        if not self.value.blocks:
            return [Line("stresses:", "not known"), *told]
        parts = []
        for kind in KINDS:
            most = max(self.value.blocks, key=attrgetter(kind))
            stress, place = getattr(most, kind)
            where = f"in '{most.name}' at {words.units.place(place)}"
            parts.append(f"{kind} up to {words.units.stress(stress, DIGITS)} {where}")
        return [Line("stresses:", f"{', '.join(parts)}, under these forces"), *told]

    def table(self, end: Collapse, words: Wording) -> Table:
        """The blocks that are pressed or pulled most."""
        value, units = self.value, words.units
        most = sorted(value.blocks, key=lambda one: -max(one.pressure, one.tension)[0])[:ROWS]
        rows: list[list[str]] = []
        for one in most:
            rows.append([one.name])
            for stress, place in (one.pressure, one.tension):
                rows[-1] += [units.stress(stress, DIGITS), units.place(place)]
        head = "block", "largest pressure", "where", "largest tension", "where"
        return Table(rows, TITLE, head, " ".join([*_warnings(value, units), NOTE]))

    def record(self) -> dict[str, Any]:
        """Largest pressures and tensions of the blocks, Pa, with their places, m."""
        told = attrgetter("name", *KINDS)
        blocks = [dict(zip(("name", *KINDS), told(one), strict=True)) for one in self.value.blocks]
        cracked = [one.name for one in self.value.cracked]
        return {"blocks": blocks, "cracked": cracked, "missed": self.value.missed}

    def seen(self, view: BlockView) -> BlockView:
        """Its viewer colours blocks by pressure and tension."""
        values = {kind: np.zeros(len(view.motion)) for kind in KINDS}
        for one, kind in product(self.value.blocks, KINDS):
            values[kind][one.block] = 1e-6 * getattr(one, kind)[0]
        return replace(view, stresses=values)

    def write(self, folder: Path, view: BlockView, output: OutputOptions) -> None:
        """Write what is asked for of stresses.vtu and stresses.png."""
        if output.paraview and self.value.blocks:
            write_stresses(self.value, folder / f"stresses{view.suffix}.vtu")
        if output.pictures and self.value.blocks:
            with going_on([]):
                draw_stresses(self.value, view, folder, output.formats)


def _warnings(value: BlockStresses, units: Units) -> Iterator[str]:
    """Tensions beyond the strength of the stone, and blocks without stresses, in words."""
    if cracked := value.cracked:
        names = listed_blocks([one.name for one in cracked], "crack")
        worst = max(cracked, key=lambda one: one.tension[0] / one.strength)
        above = f"is above the tensile strength of {units.stress(worst.strength)}"
        yield f"{names} without iron: a tension of {units.stress(worst.tension[0], DIGITS)} {above}"
    if value.missed:
        why = next(iter(value.missed.values()))
        yield f"{listed_blocks([*value.missed], 'lack')} stresses: {why}"
