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
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fenics_contact.errors import InputError
from fenics_contact.faces.model import FaceModel
from fenics_contact.geometry.mesh import Array
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.contacts import Contact
from fenics_contact.spatial.points import polygon_centroid
from fenics_contact.spatial.result import SpatialCollapse
from fenics_contact.spatial.structure import Structure

#: Pairs of programs at most.
ROUNDS = 12
#: Parts of the way to the boundary that Clarabel's steps go, the next one where it stalls.
STEPS = (0.99, 0.9, 0.8, 0.7)


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
        pairs = np.stack([reach[first], reach[second]], axis=1)
        apart = np.abs(np.linalg.det(pairs)) > 1e-9
        right = np.column_stack([distance[first], distance[second]])[apart]
        corners = np.linalg.solve(pairs[apart], right[:, :, None])[:, :, 0]
        touching = 0.5 * distance[:, None] / np.maximum(reach, 1e-9)
        halves = np.vstack([corners, touching])
        inside = np.all(halves @ reach.T <= distance * (1.0 + 1e-9), axis=1)
        inside &= np.all(halves > 0.0, axis=1)
        area = np.where(inside, np.prod(halves, axis=1), 0.0)
        if area.max() > np.prod(best) * (1.0 + 1e-9):
            best = halves[np.argmax(area)]
            axes = frame
    return middle, axes, 2.0 * best


@dataclass(frozen=True)
class Crushing:
    """Contacts with a compressive strength.

    Attributes:
        resultants: Of the units' pressing forces: N, and 2 S_1 / b, 2 S_2 / h, sparse, shape (3
            contacts, units).
        strength: f_c b h, N.
    """

    resultants: Any
    strength: Array

    @classmethod
    def of(cls, structure: Structure) -> Crushing:
        """Those of a structure."""
        from scipy.sparse import csr_matrix

        points = structure.points
        units = len(points.area) + len(structure.bars)
        rows = []
        strength = []
        for number, (contact, law) in enumerate(
            zip(structure.contacts, structure.laws, strict=True)
        ):
            if not np.isfinite(law.compressive_strength):
                continue
            middle, axes, sides = rectangle_of(contact)
            mine = np.flatnonzero(points.contact == number)
            place = (points.position[mine] - contact.corners[0]) @ contact.axes[1:].T - middle
            row = np.zeros((3, units))
            row[0, mine] = 1.0
            row[1:, mine] = 2.0 * (place @ axes.T / sides).T
            rows.append(csr_matrix(row))
            strength.append(law.compressive_strength * float(np.prod(sides)))
        from scipy.sparse import vstack

        return cls(vstack(rows).tocsr(), np.array(strength))

    def strengths(self, normal: Array) -> tuple[Array, Array]:
        """N of all contacts and what they carry at most, (f_c u v)^(1/3), N, by pressing forces."""
        force, first, second = (self.resultants @ normal).reshape(-1, 3).T
        sides = np.maximum(force - np.abs([first, second]), 0.0)
        return force, np.cbrt(self.strength * np.prod(sides, axis=0))

    def miss(self, normal: Array) -> float:
        """By how much N is too large at most, N: N^3 <= f_c u v; of pressing forces of units."""
        force, most = self.strengths(normal)
        return float(np.max(force - most))


@dataclass(frozen=True)
class CrushingPrograms:
    """Programs (a) and (b) of a model whose contacts crush."""

    model: FaceModel
    crushing: Crushing
    given: Array

    def solve(self, strength: Array, friction: Array, cost: Array) -> tuple[float, Array, Array]:
        """The least cost . n - lambda: lambda, forces of units, and the multipliers, motions.

        Raises:
            InputError: If clarabel is missing.
        """
        import scipy.sparse as sp

        try:
            import clarabel
        except ImportError:
            raise InputError(
                "compressive_strength in space needs clarabel: pip install clarabel; or leave out"
                " the compressive strengths"
            ) from None
        model = self.model
        size = model.force
        units = model.shape[0]
        count = len(self.crushing.strength)
        columns = 1 + 3 * units + 2 * count
        balance = sp.hstack(
            [
                sp.csc_matrix(model.live[:, None] / size),
                model.transposed,
                sp.csc_matrix((len(model.live), 2 * count)),
            ]
        )
        normal = sp.csr_matrix(
            (np.ones(units), (np.arange(units), 1 + 3 * np.arange(units))), (units, columns)
        )
        cone = sp.csr_matrix(
            (
                np.column_stack([friction, np.ones((units, 2))]).ravel(),
                (np.arange(3 * units), 1 + np.arange(3 * units)),
            ),
            (3 * units, columns),
        )
        bound = np.zeros((units, 3))
        bound[:, 0] = strength / size
        resultants = self.crushing.resultants @ normal
        offset = self.crushing.resultants @ self.given / size
        force, first, second = (resultants[k::3] for k in range(3))
        area = sp.csr_matrix(
            (
                np.ones(2 * count),
                (np.arange(2 * count), columns - 2 * count + np.arange(2 * count)),
            ),
            (2 * count, columns),
        )
        limits = [
            force + turn * moment - area[k * count : (k + 1) * count]
            for k, moment in enumerate((first, second))
            for turn in (-1.0, 1.0)
        ]
        at_rest = [
            offset[0::3] + turn * offset[k + 1 :: 3] for k in range(2) for turn in (-1.0, 1.0)
        ]
        power = sp.lil_matrix((4 * count, columns))
        power[0::4] = area[:count]
        power[1::4] = area[count:]
        power[3::4] = force
        right = np.zeros((count, 4))
        right[:, 2] = self.crushing.strength / size
        right[:, 3] = offset[0::3]
        presses = (friction == 0.0) | (strength > 0.0)  # else friction's cone says so
        normal = normal[presses]
        rows = sp.vstack([balance, -normal, *(-limit for limit in limits), -cone, -power.tocsr()])
        sides = np.concatenate(
            [-model.dead / size, np.zeros(normal.shape[0]), *at_rest, bound.ravel(), right.ravel()]
        )
        weights = np.zeros(columns)
        weights[0] = -1.0
        weights[1 : 1 + 3 * units : 3] = cost * size
        cones = [
            clarabel.ZeroConeT(len(model.live)),
            clarabel.NonnegativeConeT(normal.shape[0] + 4 * count),
            *(clarabel.SecondOrderConeT(3) for _ in range(units)),
            *(clarabel.GenPowerConeT([1 / 3, 1 / 3, 1 / 3], 1) for _ in range(count)),
        ]
        nothing = sp.csc_matrix((columns, columns))
        for fraction in STEPS:
            settings = clarabel.DefaultSettings()
            settings.verbose = False
            settings.max_threads = 1
            settings.max_step_fraction = fraction
            solver = clarabel.DefaultSolver(nothing, weights, rows.tocsc(), sides, cones, settings)
            found = solver.solve()
            usable = str(found.status) in ("Solved", "AlmostSolved")
            if usable:
                break
        unknowns = np.array(found.x)
        motion = np.array(found.z)[: len(model.live)] / size
        factor = float(unknowns[0]) if usable else np.nan
        return factor, unknowns[1 : 1 + 3 * units].reshape(-1, 3) * size, motion


def crushed_collapse(
    structure: Structure,
    start: SpatialCollapse,
    force: Array,
    asked: float,
    check_stop: Callable[[], None],
) -> SpatialCollapse:
    """The collapse with crushing, from one without and the engine's forces of its units.

    Raises:
        InputError: If clarabel is missing.
        Stopped: If the search is to end.
    """
    model = structure.face_model(start.sign)
    crushing = Crushing.of(structure)
    programs = CrushingPrograms(model, crushing, structure.given_force[:, 0])
    nothing = np.zeros(model.shape[0])
    best = replace(
        start,
        status="not_converged",
        load_factor=np.nan,
        gap=np.inf,
        reason="no state was found that does not crush",
    )
    for _ in range(ROUNDS):
        check_stop()
        own = model.own_strength(force)
        limit, _, motion = programs.solve(own, model.dilatancy, nothing)
        if not np.isfinite(limit):
            break
        motion = motion / float(model.live @ motion)
        slip = model.power(motion).slip
        pressed = limit - float(own @ slip) + float(model.dead @ motion)
        cost = model.free_friction * slip
        factor, force, _ = programs.solve(model.strength, model.friction, cost)
        if not np.isfinite(factor):
            break
        upper = float(model.own_strength(force) @ slip) + pressed - float(model.dead @ motion)
        gap = max(upper - factor, 0.0) / model.size(factor)
        if gap < best.gap:
            mode = np.zeros((len(structure.blocks), 6))
            mode[structure.number >= 0] = motion.reshape(-1, 6)
            mode[:, 3:] /= structure.size
            mode /= np.linalg.norm(mode[:, :3], axis=1).max(initial=1e-300)
            best = replace(
                start,
                status="limit" if gap <= max(asked, SEARCH.rough_gap) else "not_converged",
                load_factor=start.sign * factor,
                gap=gap,
                mode=mode,
                force=structure.point_forces(force),
                tension=structure.tensions(force),
                reason=f"the best state has a gap of {gap:.1e}",
                residuals={
                    "crushing": max(
                        crushing.miss(force[:, 0] + structure.given_force[:, 0]) / model.force, 0.0
                    )
                },
            )
        if gap <= min(asked, SEARCH.side_accuracy):
            break
    return replace(best, reason="") if best.status == "limit" else best
