"""What ties of rigid blocks bring, see `answers.without_ties`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from fenics_contact.answers.without_ties import WithoutTiesAnswer
from fenics_contact.errors import Stopped, require
from fenics_contact.spatial.limit import searched_for
from fenics_contact.spatial.other_states import LowestOfBlocks
from fenics_contact.spatial.question import BlockQuestion
from fenics_contact.spatial.ties import part_of


class WithoutTiesOfBlocks(WithoutTiesAnswer):
    """The same of blocks without a mesh."""

    asks = BlockQuestion
    unless = ()
    lower = LowestOfBlocks

    @classmethod
    def with_yields(cls, question: Any, factor: float) -> Any:
        """The collapse with yields and prestresses that are multiplied; without ties for 0."""
        structure, end = question.structure, question.end
        bars = [replace(bar, tie=part_of(bar.tie, factor)) for bar in structure.bars if factor]
        structure = replace(structure, bars=tuple(bars))
        asked = question.options.asked_gap
        found, search = searched_for(structure, end.sign, asked, question.check_stop)
        require(not found.stopped, found.stopped, Stopped)
        search = search or question.search
        return replace(question, structure=structure, end=found, search=search)
