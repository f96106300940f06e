"""Collapse of structures whose contacts crush: the programs of `faces.certificate` by power cones.

A rectangular contact b x h with a compressive strength f_c carries the force N at an eccentricity
if a rectangular stress block carries it (the biaxial form of J. Heyman, The masonry arch (1982),
section 2.4):

    N^3 <= f_c u v,   u <= b N - 2 |S_1|,   v <= h N - 2 |S_2|,

S the moments of the pressing forces about the middle, u v / N^2 the area of the block. That is a
power cone and four inequalities for a contact. Any other contact has the block within the largest
rectangle about its centroid along one of its sides, which is on the safe side. The programs are
solved by Clarabel (P.J. Goulart, Y. Chen, arXiv:2405.12762), in turn, as in `faces.certificate`:

    (a) the limit with the strengths of a state; its multipliers are a mode,
    (b) the state of least gap for a mode.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from fenics_contact.errors import InputError, SolverError
from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.model import FaceModel, FurtherLaw
from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.contacts import Contact
from fenics_contact.spatial.points import polygon_centroid

#: Pairs of programs at most.
ROUNDS = 12
#: Strengths of contacts over a typical force that programs know at most: beyond it digits are lost.
STRONG = 1e7
#: Parts of the way to the boundary that Clarabel's steps go, the next one where it stalls.
STEPS = (0.99, 0.9, 0.8, 0.7)

NO_CLARABEL = (
    "compressive_strength in space needs clarabel: pip install clarabel; or leave out the"
    " compressive strengths"
)


def rectangle_of(contact: Contact) -> tuple[Array, Array, Array]:
    """The largest rectangle about the centroid of a contact along one of its sides.

    Returns:
        Its middle, shape (2,), unit vectors along its sides, (2, 2), and their lengths, m; all in
        the contact's plane.
    """
    polygon = contact.in_plane
    middle = polygon_centroid(polygon)
    edges = np.roll(polygon, -1, axis=0) - polygon
    along = edges / np.linalg.norm(edges, axis=1)[:, None]
    outwards = np.column_stack([along[:, 1], -along[:, 0]])
    distance = np.einsum("ei,ei->e", outwards, polygon - middle)
    first, second = np.triu_indices(len(polygon), 1)
    best = np.zeros(2)
    axes = np.eye(2)
    for tangent in along:
        frame = np.array([tangent, [-tangent[1], tangent[0]]])
        reach = np.abs(outwards @ frame.T)  # reach . half sides <= distance
        lines = np.column_stack([reach, -distance])
        with np.errstate(divide="ignore", invalid="ignore"):  # parallel lines have no corner
            corners = np.cross(lines[first], lines[second])
            touching = 0.5 * distance[:, None] / reach
            halves = np.vstack([corners[:, :2] / corners[:, 2:], touching])
            inside = np.all(halves @ reach.T <= distance * (1.0 + 1e-9), axis=1)
        inside &= np.all(halves > 0.0, axis=1)
        area = np.where(inside, np.prod(halves, axis=1), 0.0)
        if area.max() > np.prod(best) * (1.0 + 1e-9):
            best = halves[np.argmax(area)]
            axes = frame
    return middle, axes, 2.0 * best


@dataclass(frozen=True)
class Crushing(FurtherLaw):
    """The law of contacts with a compressive strength.

    Attributes:
        resultants: Of the points' pressing forces: N, and 2 S_1 / b, 2 S_2 / h, sparse, shape (3
            contacts, points).
        strength: f_c b h, N.
        given: Pressing forces of points that the engine counts to the dead load, N.
    """

    resultants: Any
    strength: Array
    given: Array
    #: What it is called as a residual.
    key: ClassVar[str] = "crushing"

    @classmethod
    def of(cls, structure: Any) -> Crushing:
        """That of a `Structure`."""
        from scipy.sparse import csr_matrix, vstack

        points = structure.points
        rows = []
        strength = []
        for number in np.flatnonzero(structure.limited).tolist():
            contact = structure.contacts[number]
            middle, axes, sides = rectangle_of(contact)
            mine = points.contact == number
            place = (points.position - contact.corners[0]) @ contact.axes[1:].T - middle
            moments = 2.0 * (place @ axes.T / sides).T
            rows.append(csr_matrix(mine * np.vstack([np.ones(len(mine)), moments])))
            strength.append(structure.laws[number].compressive_strength * float(np.prod(sides)))
        given = structure.point_forces(np.zeros_like(structure.given_force))[:, 0]
        return cls(vstack(rows).tocsr(), np.array(strength), given)

    def at_strength(self, normal: Array, part: float, nothing: float) -> Flags:
        """Which contacts carry a part of what they can, and more than next to nothing."""
        force, *sides = self._sides(normal)
        most = np.cbrt(self.strength * np.prod(np.maximum(sides, 0.0), axis=0))
        return np.asarray((force > part * most) & (force > nothing * force.max()))

    def _sides(self, normal: Array) -> tuple[Array, Array, Array]:
        """N of all contacts, and the largest u and v over b and h, times N; by pressing forces."""
        force, first, second = (self.resultants @ normal).reshape(-1, 3).T
        return force, force - np.abs(first), force - np.abs(second)

    def miss(self, normal: Array) -> float:
        """The least d with N^3 <= f_c b h (u + d) (v + d) on all contacts, N; of points' forces.

        By so much moments over half sides are too large: near an edge the force itself says little.
        """
        force, u, v = self._sides(normal)
        least = np.hypot(u - v, 2.0 * np.sqrt(np.maximum(force, 0.0) ** 3 / self.strength))
        return float(np.max(0.5 * (least - u - v)))

    def limit(
        self, model: FaceModel, strength: Array, friction: Array, cost: Array
    ) -> tuple[float, Array, Array, float]:
        """The least cost . n - lambda of a model.

        Unknowns are forces of the live load and of units, u and v, over the typical force.

        Returns:
            Lambda, forces of units, the multipliers of equilibrium, which are motions, and the most
            that they leave to lambda - cost . n.

        Raises:
            InputError: If clarabel is missing.
            SolverError: If it finds none.
        """
        import scipy.sparse as sp

        try:
            import clarabel
        except ImportError:
            raise InputError(NO_CLARABEL) from None
        size = model.force
        unit = size / model.load  # of lambda
        units = model.shape[0]
        count = len(self.strength)
        each = sp.identity(count)
        pressing = sp.kron(sp.identity(units, format="csr"), [[1.0, 0.0, 0.0]], "csr")
        resultants = self.resultants @ pressing[: len(self.given)]
        offset = self.resultants @ self.given / size
        force, first, second = (resultants[k::3] for k in range(3))
        at_rest, *turned = (offset[k::3] for k in range(3))
        presses = (friction == 0.0) | (strength > 0.0)  # else friction's cone says so
        disc = sp.diags(np.column_stack([friction, np.ones((units, 2))]).ravel())
        corner = np.eye(4)[:, :, None]
        rows = [
            [model.live[:, None] / model.load, model.transposed, None, None],
            [None, -pressing[presses], None, None],
            *([None, -force - turn * first, each, None] for turn in (-1.0, 1.0)),
            *([None, -force - turn * second, None, each] for turn in (-1.0, 1.0)),
            [None, -disc, None, None],
            [None, -sp.kron(force, corner[3]), *(-sp.kron(each, corner[k]) for k in (0, 1))],
        ]
        bound = np.outer(strength / size, [1.0, 0.0, 0.0])
        most = np.minimum(self.strength / size, STRONG)
        power = np.outer(most, corner[2]) + np.outer(at_rest, corner[3])
        sides = [
            -model.dead / size,
            np.zeros(np.count_nonzero(presses)),
            *(at_rest + turn * moment for moment in turned for turn in (-1.0, 1.0)),
            bound.ravel(),
            power.ravel(),
        ]
        weights = np.zeros(1 + 3 * units + 2 * count)
        weights[0] = -1.0
        weights[1 : 1 + 3 * units : 3] = cost * size / unit
        cones = [
            clarabel.ZeroConeT(len(model.live)),
            clarabel.NonnegativeConeT(np.count_nonzero(presses) + 4 * count),
            *(clarabel.SecondOrderConeT(3) for _ in range(units)),
            *(clarabel.GenPowerConeT([1 / 3, 1 / 3, 1 / 3], 1) for _ in range(count)),
        ]
        quadratic = sp.csc_matrix((len(weights),) * 2)
        program = (quadratic, weights, sp.bmat(rows, "csc"), np.concatenate(sides), cones)
        for fraction in STEPS:
            settings = clarabel.DefaultSettings()
            settings.verbose = False
            settings.max_threads = 1
            settings.max_step_fraction = fraction
            found = clarabel.DefaultSolver(*program, settings).solve()
            if str(found.status) in ("Solved", "AlmostSolved"):
                unknowns = np.array(found.x)
                forces = unknowns[1 : 1 + 3 * units].reshape(-1, 3) * size
                motion = np.array(found.z)[: len(model.live)] / model.load
                return unit * float(unknowns[0]), forces, motion, -unit * float(found.obj_val_dual)
        raise SolverError(f"Clarabel ended with {found.status}")

    def part(self, model: FaceModel, given_force: Array) -> tuple[float, Array, Array]:
        """The largest part of the live load of a model; forces at all of it, and the motion.

        The part is what the motion proves at most. Forces are shares of those of that part: without
        loads there are `given_force`s alone.

        Raises:
            InputError: If clarabel is missing.
            SolverError: If it finds none.
        """
        none = np.zeros(len(model.strength))
        part, force, motion, most = self.limit(model, model.strength, model.friction, none)
        share = 1.0 / max(part, 1e-300)
        return most, share * force - (1.0 - share) * given_force, motion

    def state(
        self, model: FaceModel, state: FaceState, asked: float, check: Callable[[], None]
    ) -> FaceState | None:
        """The state of least gap with this law, from the state without; None without one.

        The mode of that bounds it, too: the gap has what crushing takes away, where no mode is
        found.

        Args:
            model: The points.
            state: Without this law.
            asked: Largest gap, relative.
            check: Called between programs; may raise `Stopped`.

        Raises:
            InputError: If clarabel is missing.
        """
        best: FaceState | None = None
        force = state.force
        with suppress(SolverError):
            for _ in range(ROUNDS):
                check()
                own = model.own_strength(force)
                none = np.zeros(len(own))
                try:
                    _, _, motion, limit = self.limit(model, own, model.dilatancy, none)
                    motion = motion / float(model.live @ motion)
                except SolverError:
                    if best is not None or state.sign < 0.0:
                        raise
                    motion, limit = state.mode, model.power(state.mode).bound(own)
                slip = model.power(motion).slip
                cost = model.free_friction * slip
                factor, force, _, _ = self.limit(model, model.strength, model.friction, cost)
                upper = limit + float((model.own_strength(force) - own) @ slip)
                gap = max(upper - factor, 0.0) / model.size(factor)
                if best is None or gap < best.gap:
                    known = {"load_factor": factor, "force": force, "mode": motion}
                    best = replace(state, **known, upper=upper, gap=gap)
                if gap <= min(asked, SEARCH.side_accuracy):
                    break
        return best
