"""What the blocks' own stiffness does to a collapse: the one of the same blocks, rigid."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from fenics_contact.answers.question import Asked
from fenics_contact.results.result import Collapse
from fenics_contact.results.wording import Line, Wording
from fenics_contact.spatial.limit import searched_for
from fenics_contact.spatial.question import BlockQuestion


@dataclass(frozen=True)
class RigidBlocks:
    """The collapse of the same blocks, rigid; fields as those of `Collapse`."""

    status: str
    load_factor: float
    way: str


class RigidAnswer(Asked):
    """The collapse of rigid blocks beside that of blocks that strain, a `RigidBlocks`."""

    value: RigidBlocks
    name = key = "rigid_blocks"
    place = 5
    begins = "the collapse of rigid blocks"
    asks = BlockQuestion
    by_direction = True

    @classmethod
    def concerns(cls, question: BlockQuestion) -> bool:
        """Whether blocks strain."""
        return question.structure.strained is not None

    @classmethod
    def run(cls, question: BlockQuestion) -> tuple[Self | None, Collapse]:
        """The load factor of rigid blocks on springs."""
        structure, end = replace(question.structure, strained=None), question.end
        asked = question.options.asked_gap
        found, _ = searched_for(structure, end.sign, asked, question.check_stop, stands=True)
        spent = end.factorizations + found.factorizations
        value = RigidBlocks(found.status, found.load_factor, found.way)
        return cls(value), replace(end, factorizations=spent)

    def lines(self, end: Collapse, words: Wording) -> list[Line]:
        """How much the load factor changes by strains of the blocks."""
        rigid = self.value
        if rigid.status != "limit":
            return [Line("rigid blocks:", "not known")]
        other = words.beside(rigid.load_factor, end.load_factor, end.sign)
        part = round(end.load_factor / rigid.load_factor - 1.0, 4) + 0.0  # no -0
        text = f"{other} {words.unit}; the blocks' own stiffness changes it by {part:+.1%}"
        return [Line("rigid blocks:", text)]
