"""The seismic check of a collapse mechanism, by the Italian code for existing masonry.

Circolare 21.01.2019 n. 7 C.S.LL.PP., C8.7.1.2.1: a mechanism that starts at the multiplier alpha_0
of the weights starts at the spectral acceleration, [C8.7.1.3] and [C8.7.1.8],

    a_0* = alpha_0 g / (e* FC),   M* = (sum P_k d_k)^2 / (g sum P_k d_k^2),   e* = g M* / sum P_k,

where e* is [C8.7.1.5]. The sums go over the rigid parts that move: stones that move as one are one
part, however many there are. P_k are the weights whose inertia pushes part k, d_k is the
displacement in the mode of the centre of these forces, along them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from fenics_contact.answers.question import Asked, Question
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.results.block_view import AMPLITUDE, BlockView
from fenics_contact.results.result import Collapse, Table
from fenics_contact.results.wording import Line, Wording
from fenics_contact.results.words import MOVES
from fenics_contact.scene.scene import Seismic, Shared

#: Title of its table.
TITLE = "Seismic check of this mechanism (Circolare 7/2019, C8.7.1.2.1)"
#: Why there is no check by displacements without a way that was followed twice.
NOT_FOLLOWED = "the way was stopped; give more solve.time, or solve.beyond = a displacement"
#: Blocks whose joint opens or slides by less than this part of the largest speed move as one.
AS_ONE = 1e-3


@dataclass(frozen=True)
class SeismicCheck:
    """Spectral acceleration at which a mechanism starts, and what it comes of.

    Attributes:
        multiplier: alpha_0, horizontal forces over weights at the limit load.
        parts: Number of rigid parts that move.
        moving_mass: sum P_k / g, kg per metre of thickness.
        participating_mass: M*, kg per metre of thickness.
        mass_fraction: e* = M* / moving mass, at most 1.
        confidence_factor: FC.
        acceleration: a_0*, m/s2.
        acceleration_g: a_0* / g.
        demand: Spectral acceleration asked for, m/s2; None: not given.
        nonlinear: Check by displacements, a `motion.check.NonlinearCheck`; None: none was made.
        missing: Why none was made, where the scene asks for it; else empty.
    """

    multiplier: float
    parts: int
    moving_mass: float
    participating_mass: float
    mass_fraction: float
    confidence_factor: float
    acceleration: float
    acceleration_g: float
    demand: float | None = None
    nonlinear: Any = field(default=None, repr=False)
    missing: str = field(default="", repr=False)

    @property
    def value_and_verdict(self) -> str:
        """a_0*, and whether it reaches the demand where one is given."""
        value = f"{self.acceleration:.4g} m/s2 = {self.acceleration_g:.4g} g"
        if self.demand is None:
            return value
        ratio = self.acceleration / self.demand
        verdict = "enough" if ratio >= 1.0 else "NOT enough"
        return f"{value} ({ratio:.3g} times the {self.demand:.4g} m/s2 asked for: {verdict})"

    @classmethod
    def of(
        cls,
        multiplier: float,
        gravity: float,
        options: Seismic,
        parts: int,
        mass: Array,
        displacement: Array,
    ) -> Self:
        """The check of parts with some masses and displacements of their centres, see above."""
        moving_mass = float(mass.sum())
        participating = float(mass @ displacement) ** 2 / float(mass @ displacement**2)
        fraction = participating / moving_mass
        activation = multiplier * gravity / (fraction * options.confidence_factor)
        return cls(
            multiplier,
            parts,
            moving_mass,
            participating,
            fraction,
            options.confidence_factor,
            activation,
            activation / gravity,
            options.demand,
        )


class SeismicAnswer(Asked):
    """The check of every limit, a `SeismicCheck`, where the scene asks for it."""

    value: SeismicCheck
    name = key = "seismic"
    place = 7
    asks = Question
    by_direction = with_fast = True

    @classmethod
    def concerns(cls, question: Question) -> bool:
        """Whether the scene asks for the check."""
        return question.scene.seismic is not None

    @classmethod
    def asked_by(cls, scene: Shared) -> str:
        """The factor of the code, where the scene asks for the check."""
        asked = scene.seismic
        demand = f", demand {asked.demand:g} m/s2" if asked and asked.demand else ""
        return f"seismic check with FC = {asked.confidence_factor:g}{demand}" if asked else ""

    @classmethod
    def run(cls, question: Question) -> tuple[Self | None, Collapse]:
        """The check of a collapse."""
        scene, end = question.scene, question.end
        gravity, push = (math.hypot(*one.acceleration) for one in (scene.dead, scene.live))
        check = seismic_check(question.view, scene.seismic, end.load_factor, gravity, push)
        if check is not None and scene.seismic.nonlinear:  # until it is made
            check = replace(check, missing=NOT_FOLLOWED)
        return None if check is None else cls(check), end

    def record(self) -> dict[str, Any]:
        """The fields of the check, and the non-linear one where it was made."""
        further = self.value.nonlinear
        missing = {"nonlinear": None, "reason": self.value.missing} if self.value.missing else {}
        return super().record() | ({"nonlinear": further.record()} if further else missing)

    def lines(self, end: Collapse, words: Wording) -> list[Line]:
        """The acceleration, and what it comes of."""
        check = self.value
        mass = words.units.mass
        comes_of = (
            f"alpha0 = {check.multiplier:.4g}, e* = {check.mass_fraction:.4g}, FC ="
            f" {check.confidence_factor:.4g}, M* = {mass(check.participating_mass)} of"
            f" {mass(check.moving_mass)} that move in {check.parts} rigid"
            f" part{'s' * (check.parts != 1)}"
        )
        missing = f"not made: {check.missing}" * bool(check.missing)
        further = check.nonlinear.text if check.nonlinear else missing
        starts = "seismic check: it starts at a spectral acceleration a0* of"
        return [
            Line(starts, check.value_and_verdict),
            Line("a0* comes of", comes_of, verbose=True),
            *[Line("non-linear check:", further)] * bool(further),
        ]

    def table(self, end: Collapse, words: Wording) -> Table:
        """Names and values of its table."""
        check = self.value
        rows = [
            ("multiplier of the weights alpha0", f"{check.multiplier:.4g}"),
            ("rigid parts that move", f"{check.parts}"),
            ("mass that moves", words.units.mass(check.moving_mass)),
            ("participating mass M*", words.units.mass(check.participating_mass)),
            ("participating fraction e*", f"{check.mass_fraction:.4g}"),
            ("confidence factor FC", f"{check.confidence_factor:.4g}"),
            (
                "spectral acceleration at which it starts, a0* = alpha0 g / (e* FC)",
                check.value_and_verdict,
            ),
        ]
        return Table(rows + (check.nonlinear.table() if check.nonlinear else []), TITLE)


def seismic_check(
    view: BlockView, options: Seismic, load_factor: float, gravity: float, acceleration: float
) -> SeismicCheck | None:
    """The check of a collapse; None if no mass moves.

    Args:
        view: Of the collapse, with the live load as horizontal forces in proportion to weights.
        options: Confidence factor.
        load_factor: Of the live load, of either sign.
        gravity: Acceleration of the dead load, m/s2.
        acceleration: That of the live load, m/s2.
    """
    moving = (view.share > MOVES) & ~view.bodies.fixed
    part = rigid_parts(view)[moving]
    work = np.bincount(part, np.sum(view.live * view.motion, axis=1)[moving])
    force = np.bincount(part, np.linalg.norm(view.live[moving, :3], axis=1))
    pushed = force > 0.0
    if not gravity * acceleration or not np.any(pushed):
        return None
    return SeismicCheck.of(
        abs(load_factor) * acceleration / gravity,
        gravity,
        options,
        len(np.unique(part)),
        force[pushed] / acceleration,
        work[pushed] / force[pushed],
    )


def rigid_parts(view: BlockView) -> Indices:
    """Number of the rigid part of every block: blocks that touch and move as one share it."""
    parted = np.maximum(view.contacts.opening, view.contacts.slip)
    pairs = view.touching.pairs[parted <= AS_ONE * AMPLITUDE * view.size]
    return connected(pairs[np.all(pairs >= 0, axis=1)], len(view.motion))
