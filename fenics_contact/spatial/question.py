"""What is asked of a collapse of blocks without a mesh; its answers register themselves."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field

from fenics_contact.answers.question import Question
from fenics_contact.faces.follow import Followed
from fenics_contact.faces.limit import FaceSearch
from fenics_contact.results.block_view import BlockView
from fenics_contact.spatial.structure import Structure
from fenics_contact.spatial.view import view_of
from fenics_contact.workers import InPlace


@dataclass(frozen=True, kw_only=True)
class BlockQuestion(Question):
    """A collapse of rigid blocks.

    Attributes:
        structure: The blocks.
        search: What led to the collapse.
        check_stop: May raise `Stopped`.
        workers: Do tasks beside this process.
    """

    structure: Structure
    search: FaceSearch
    check_stop: Callable[[], None] = lambda: None
    workers: Executor = field(default_factory=InPlace)

    @property
    def view(self) -> BlockView:
        """What blocks and contacts do in the collapse."""
        return view_of(self.structure, self.end)

    @property
    def stopped(self) -> str:
        """Why the run is to end, in words; empty while it goes on."""
        return self.end.stopped

    @property
    def path(self) -> Followed | None:
        """The loading path that led to the collapse; None if another way did."""
        by_path = self.search.way == "follow" and self.search.model.further is None
        return self.search.path if by_path else None
