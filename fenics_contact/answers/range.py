"""The range of load factors that one mechanism allows, whatever the mesh and the stiffness.

Of a collapse state keep only what its joints do: open, slide one way, or stick. With forces n_1 and
n_2 at the two ends of every straight face and t along it, find

    min, max lambda   subject to   G^T (f_D + lambda f_L + B^T (n_1, n_2, t)) = 0,   n_1, n_2 >= 0,
    n = 0 at ends that open,   t = -sign (F (n_1 + n_2) + c) on faces that slide,
    |t| <= F (n_1 + n_2) + c on all others,

G the rigid motions of the blocks; of many blocks those that move together are one, and what stands
is left out, which widens the range.
Every mesh, any stiffness of the blocks and any length of the hinges has its forces among these, as
long as the mechanism stays. Another mechanism has a range of its own: this is no bound for it, as
the bracket is. Where both ends are one load factor, statics alone give it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from fenics_contact.answers.question import Asked, MeshQuestion
from fenics_contact.collapse.rigid_blocks.model import BlockModel, LinearProgram
from fenics_contact.faces.planar import PlanarFaces
from fenics_contact.geometry.mesh import Flags
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.results.bounds import MEET, NOT_AT_THIS_SIZE, LimitBounds
from fenics_contact.results.result import Answer, Collapse
from fenics_contact.results.values import JointValues
from fenics_contact.results.wording import Line, Wording

#: Part of the largest joint force by which a face is pressed between its ends.
PRESSED = 1e-3
#: Blocks from which on those that move together are one part: fewer unknowns, a wider range.
ONE_BY_ONE = 200


@dataclass(frozen=True)
class MechanismRange:
    """Load factors that a mechanism allows.

    Attributes:
        status: "known" or "not_known".
        ends: The least and the largest one; infinite where nothing limits them.
        reason: Why they are not known, for people.
    """

    status: str
    ends: LimitBounds = field(default_factory=lambda: LimitBounds(None, None))
    reason: str = ""

    @property
    def lower(self) -> float | None:
        """The least load factor."""
        return self.ends.lower

    @property
    def upper(self) -> float | None:
        """The largest load factor."""
        return self.ends.upper

    @property
    def limits(self) -> bool:
        """Whether the mechanism limits the load factor at all."""
        return any(end is not None and math.isfinite(end) for end in (self.lower, self.upper))

    @property
    def is_one(self) -> bool:
        """Whether statics alone give the load factor, whatever the mesh and the stiffness."""
        return self.ends.meet


class RangeAnswer(Asked):
    """The range of a mechanism, a `MechanismRange`; None where joints have a strength."""

    value: MechanismRange
    name = key = seconds = "range"
    place = 5
    unless = ((MeshQuestion.has_many_blocks, f"it is {NOT_AT_THIS_SIZE}"),)

    @classmethod
    def concerns(cls, question: MeshQuestion) -> bool:
        """Unless joints have a compressive strength: that limits forces, too."""
        return question.end.joints is not None and not question.case.blocks.has_strength

    @classmethod
    def not_known(cls, reason: str) -> Self:
        """That it is not known."""
        return cls(MechanismRange("not_known", reason=reason))

    @classmethod
    def run(cls, question: MeshQuestion) -> tuple[Self | None, Collapse]:
        """The range of the mechanism of a collapse, which rank 0 solves for."""
        case = question.case
        end = question.end
        values = end.joints
        found = (math.nan, math.nan)
        if values is not None and case.problem.comm.rank == 0:
            found = mechanism_range(case.blocks.model, values)
        lower, upper = case.problem.comm.bcast(found)
        near = max(10.0 * MEET, question.options.tolerance) * end.size  # digits of the state
        if not lower - near <= end.load_factor <= upper + near:
            return cls.not_known("joints move as no exact state does, within its gap"), end
        ends = LimitBounds(min(lower, end.load_factor), max(upper, end.load_factor))
        return cls(MechanismRange("known", ends)), end

    def in_bracket(self, end: Collapse) -> Answer:
        """The range without what is outside the bracket: there is no collapse state."""
        lower, upper = (self.value.lower, self.value.upper)
        bounds = end.bounds
        if lower is None or upper is None or not end.in_bracket:
            return self
        if bounds.lower is not None:
            lower = min(max(lower, bounds.lower), end.load_factor)
        if bounds.upper is not None:
            upper = max(min(upper, bounds.upper), end.load_factor)
        return replace(self, value=replace(self.value, ends=LimitBounds(lower, upper)))

    def record(self) -> Any:
        """Both ends."""
        value = self.value
        ends = {"lower": value.lower, "upper": value.upper}
        return {"status": value.status, **ends, "reason": value.reason or None}

    def lines(self, end: Collapse, words: Wording) -> list[Line]:
        """The range in a line."""
        if self.value.status == "not_known":
            reason = f"its range of load factors is not known, {self.value.reason}"
            return [Line("this mechanism:", reason, verbose=True)]
        if self.value.is_one:
            none = (
                "the load factor does not depend on the mesh, nor on the stiffness of the blocks,"
                " as long as this mechanism stays"
            )
            return [Line("mesh:", none, verbose=True)]
        if not self.value.limits:
            text = (
                "nothing limits its load factor, whatever the mesh and the stiffness of the blocks"
            )
            return [Line("this mechanism:", text, verbose=True)]
        stays = " while this mechanism stays"
        points = end.hinges.points if end.hinges else math.nan
        if points < (self.value.lower or -math.inf) or points > (self.value.upper or math.inf):
            stays += "; with shorter hinges another mechanism"
        return [Line("mesh and stiffness:", self._ends(end, words), stays)]

    def _ends(self, end: Collapse, words: Wording) -> str:
        """Both ends along the load, as far as they are limited."""
        given = [self.value.lower, self.value.upper][:: 1 if end.sign > 0.0 else -1]
        least, most = (
            words.beside(value, end.load_factor, end.sign, outward)
            if value is not None and math.isfinite(value)
            else ""
            for value, outward in zip(given, (-1, 1), strict=True)
        )
        if least and most:
            return f"{least} to {most}"
        return f"at least {least}" if least else f"at most {most}"


def mechanism_range(blocks: BlockModel, values: JointValues) -> tuple[float, float]:
    """Least and largest load factor of a mechanism; on this rank alone.

    Args:
        blocks: Rigid blocks with the friction and the strengths of the scene.
        values: What the joint points do in the mechanism, of all points.

    Returns:
        Both ends, infinite where nothing limits them; nan where no forces fit the mechanism.
    """
    faces = blocks.planar.faces
    at_ends = faces.ends.T
    force = values.normal_force
    total = np.bincount(faces.of_point, force, len(faces.ends))
    ends_alone = np.where(at_ends[0] == at_ends[1], total, force[at_ends].sum(axis=0))
    # Pressed between its ends, it is closed: elastic motions that are left in the mode open it.
    closed = total - ends_alone > PRESSED * np.abs(force).max(initial=0.0)
    opens = (values.opens[at_ends] & ~closed).ravel()
    fastest = np.abs(values.slip_rate[at_ends]).argmax(axis=0)
    point = np.take_along_axis(at_ends, fastest[None], axis=0)[0]
    slides = np.where(values.slips[point], np.sign(values.slip_rate[point]), 0.0)
    program = blocks.largest()
    # Of Coulomb's cone, a face that slides forwards keeps the edge with shear backwards.
    rough = np.tile(blocks.friction > 0.0, 2)
    direction = np.tile(slides, 2)
    none = np.concatenate([opens | (rough & (direction > 0.0)), (opens | (direction < 0.0))[rough]])
    given, pressing, shear = np.split(program.ends, [1, 1 + len(none)])
    pressing = np.where(none[:, None], 0.0, pressing)
    bound = shear[:, 1] * np.where(slides == 0.0, 1.0, -slides)
    shear = np.column_stack([np.where(slides == 0.0, -bound, bound), bound])
    rows = program.columns
    right = program.right
    if len(blocks.planar.bodies.centre) > ONE_BY_ONE:
        moves = np.bincount(faces.of_point, values.opens | values.slips, len(slides)) > 0.0
        motions = _motions_of_parts(blocks.planar, moves)
        rows = motions.T @ rows
        right = motions.T @ right
    found = []
    for sense in (1.0, -1.0):
        ends = np.concatenate([given, pressing, shear])
        asked = LinearProgram(-sense * program.cost, rows, right, ends)
        answers = (asked.answer(method) for method in ("highs-ds", "highs-ipm"))
        answer = next((each for each in answers if each.status in (0, 3)), None)
        if answer is None:
            found.append(math.nan)
        else:
            unlimited = answer.status == 3
            found.append(-sense * math.inf if unlimited else answer.x[0] * blocks.load)
    return found[0], found[1]


def _motions_of_parts(planar: PlanarFaces, moves: Flags) -> Any:
    """Motions of the parts in those of the model: blocks are one that faces join without moving.

    Blocks that supports leave a part of their motions stay for themselves, and those that stand
    have none.
    """
    from scipy.sparse import csr_matrix

    bodies = planar.bodies
    count = len(bodies.centre)
    free = np.append(np.all(bodies.free == np.eye(3), axis=(1, 2)), True)
    held = np.append(~bodies.floating, True)
    sides = planar.joints.bodies[planar.faces.ends[:, 0]]
    sides = np.where(held[sides], count, sides)  # -1 is the ground, the last one
    part = connected(sides[~moves & np.all(free[sides], axis=1)], count + 1)
    mobile = np.flatnonzero((part[:count] != part[count]) & bodies.floating)
    _, of_part, blocks = np.unique(part[mobile], return_inverse=True, return_counts=True)
    centre = np.stack([np.bincount(of_part, x) for x in bodies.centre[mobile].T], axis=1)
    arm = (bodies.centre[mobile] - (centre / blocks[:, None])[of_part]) / bodies.size
    motion = np.tile(np.eye(3), (len(mobile), 1, 1))
    motion[:, 0, 2] = -arm[:, 1]
    motion[:, 1, 2] = arm[:, 0]
    rows = np.broadcast_to((3 * mobile[:, None] + np.arange(3))[:, :, None], motion.shape)
    columns = np.broadcast_to((3 * of_part[:, None] + np.arange(3))[:, None, :], motion.shape)
    entries = motion.ravel(), (rows.ravel(), columns.ravel())
    return csr_matrix(entries, (3 * count, 3 * len(blocks)))[planar.used]
