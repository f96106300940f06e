"""Structures in space under their weight and a push, for tests and benchmarks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fenics_contact.spatial import builders
from fenics_contact.spatial.contacts import Contact, checked_contacts
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from fenics_contact.spatial.structure import ContactLaw, Structure

Array = npt.NDArray[np.float64]

#: N / m3.
UNIT_WEIGHT = 2e4


@dataclass(frozen=True)
class Pushed:
    """A structure under its weight, and a live load in parts of the weight.

    Attributes:
        make: Its blocks.
        friction: Of all contacts.
        direction: Of the live load, parts of the weight.
        twist: Moment about z of every block, parts of its weight times 1 m.
        where: Which blocks the live load acts on, by their centroids; None for all.
        down: Direction of the weight.
        heavier: Factors on the weights of blocks, by groups.
    """

    make: Callable[[], builders.Blocks]
    friction: float
    direction: tuple[float, float, float] = (0.0, 0.0, 0.0)
    twist: float = 0.0
    where: Callable[[Array], bool] | None = None
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)
    heavier: Mapping[str, float] = field(default_factory=dict)

    @cached_property
    def blocks(self) -> tuple[Block, ...]:
        """All of them."""
        return self.make()

    @cached_property
    def contacts(self) -> tuple[Contact, ...]:
        """Where they touch."""
        return checked_contacts(self.blocks)[0]

    def structure(self, quick: bool = False) -> Structure:
        """Blocks with contacts, laws and loads."""
        dead = np.zeros((len(self.blocks), 6))
        live = np.zeros_like(dead)
        for number, block in enumerate(self.blocks):
            weight = UNIT_WEIGHT * block.volume * self.heavier.get(block.group, 1.0)
            dead[number, :3] = weight * np.array(self.down)
            if self.where is None or self.where(block.centroid):
                live[number, :3] = weight * np.array(self.direction)
                live[number, 5] = weight * self.twist
        laws = (ContactLaw(self.friction),) * len(self.contacts)
        return Structure(self.blocks, self.contacts, laws, dead, live, quick)


def towards(degrees: float, rise: float = 0.0) -> tuple[float, float, float]:
    """A unit vector at an angle from x in plan, and an angle above it."""
    plan, up = np.radians([degrees, rise])
    across = float(np.cos(up))
    return across * float(np.cos(plan)), across * float(np.sin(plan)), float(np.sin(up))


def moved(block: Block, matrix: Array, shift: Array) -> Block:
    """A block whose corners are turned, mirrored or made larger, and shifted."""
    mirrored = np.linalg.det(matrix) < 0.0
    pieces = tuple(
        Polyhedron(
            piece.corners @ matrix.T + shift,
            tuple(side[::-1] for side in piece.sides) if mirrored else piece.sides,
        )
        for piece in block.pieces
    )
    return Block(pieces, block.name, block.group, block.fixed)


def barrel(strips: int) -> builders.Blocks:
    """A vault of 25 voussoirs, whose load factor under a push across is 0.30776.

    Its arch is that of G. Cocchetti, E. Rizzi, Frattura ed Integrita Strutturale 51 (2020) 356.
    """
    springing = np.radians(6.667)
    return builders.barrel_vault(
        span=2.0 * 0.317 * float(np.cos(springing)),
        rise=0.317 * (1.0 - float(np.sin(springing))),
        thickness=0.0563,
        length=0.2,
        voussoirs=25,
        strips=strips,
    )


def extruded(courses: Sequence[Sequence[float]], thickness: float) -> builders.Blocks:
    """A planar wall along x, by lengths of bricks of courses; negative ones are left out."""
    length, height = 0.4, 0.175
    longest = length * max(np.abs(course).sum() for course in courses)
    boxes = {"ground": ([-0.5, -0.5, -0.2], [longest + 0.5, thickness + 0.5, 0.0])}
    for number, course in enumerate(courses):
        ends = length * np.cumsum([0.0, *np.abs(course)])
        for place, part in enumerate(course):
            if part > 0.0:
                low = [ends[place], 0.0, height * number]
                high = [ends[place + 1], thickness, height * (number + 1)]
                boxes[f"wall_{number + 1}_{place + 1}"] = (low, high)
    return tuple(
        Block((Polyhedron.box(*box),), name, fixed=name == "ground") for name, box in boxes.items()
    )
