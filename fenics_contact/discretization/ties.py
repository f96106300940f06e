"""Ties: bars between two places that carry tension only, up to their yield.

With the unit vector d from the first end to the second, a bar of the stiffness k = E A / L and the
prestress P has the elongation e and the tension t,

    e = d . (u_second - u_first),    t = P + k (e - e_p),    0 <= t <= Y,

and e_p grows only where t = Y, and falls only where t = 0: an elastic bar that yields at Y and goes
slack at 0. With t = Y/2 - r_T this is the law of a joint point without pressure whose shear force
has the given bound Y/2 (`joint_law`), that slides along the bar, under a force that belongs to the
dead load:

    B_T u = e,   |r_T| <= Y/2,   e_p = B_T u - o_T + r_T / k,   o_T = (Y/2 - P) / k,
    f_D' = f_D - B_T^T Y/2.

So ties are rows of B_T, after those of the joints, and their rows of B_N are zero. The plastic work
Y/2 |e_p'| of the point and the work Y/2 e_p' of the force are together Y max(e_p', 0).

An end is a place in a cell, where the shape functions of the cell give u, or a group of facets,
where u is their mean by length. A group on several blocks has a bar to each of them, which has the
part of the tie that the block has of the group's length.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from fenics_contact import compat
from fenics_contact.discretization.facets import GROUND, Boundary
from fenics_contact.discretization.mortar import NOTHING, SHARES, Stencil
from fenics_contact.errors import InputError
from fenics_contact.geometry.mesh import Array, BlockMesh, Indices, Labels
from fenics_contact.scene.scene import Scene, Tie

#: Places this far outside a block are in it, over the structure's size.
AT_BLOCK = 1e-6


@dataclass(frozen=True)
class Ties:
    """Bars, in the order of the scene's ties; the same on all ranks.

    Attributes:
        names: Of the scene's ties.
        tie: Number of the tie that every bar is of, shape (bars,).
        bodies: Bodies of the first and second end, `GROUND` for the ground, shape (bars, 2).
        sides: Places of the ends, m, shape (bars, 2, 2).
        stencil: How displacements of nodes give those of the ends.
        share: Part of its tie that a bar is, shape (bars,).
        yields: Y of the bars, N per metre of thickness.
        compliance: 1/k of the bars, m per N/m; 0 where they do not stretch.
        prestress: P of the bars, N per metre of thickness.
    """

    names: tuple[str, ...]
    tie: Indices
    bodies: Labels
    sides: Array
    stencil: Stencil
    share: Array
    yields: Array
    compliance: Array
    prestress: Array

    @property
    def name(self) -> npt.NDArray[np.str_]:
        """Names of the ties that the bars are of."""
        return np.array(self.names, dtype=str)[self.tie]

    @property
    def along(self) -> Array:
        """Bars from the first end to the second, m, shape (bars, 2)."""
        return np.asarray(self.sides[:, 1] - self.sides[:, 0])

    @property
    def length(self) -> Array:
        """Lengths of the bars, m."""
        return np.linalg.norm(self.along, axis=1)

    @property
    def direction(self) -> Array:
        """Unit vectors d, shape (bars, 2)."""
        return self.along / self.length[:, None]

    @property
    def origin(self) -> Array:
        """o_T, m."""
        return (0.5 * self.yields - self.prestress) * self.compliance

    def tensions(self, shear: Array) -> Array:
        """Tensions t = Y/2 - r_T, N per metre of thickness."""
        return 0.5 * self.yields - shear

    def elongations(self, slip: Array, shear: Array) -> Array:
        """Elongations e by e_p and r_T, m."""
        return slip + (self.tensions(shear) - self.prestress) * self.compliance


@dataclass(frozen=True)
class _End:
    """Where a bar begins or ends.

    Attributes:
        body: `GROUND` for the ground.
        place: m, shape (2,).
        nodes: Displacement nodes.
        weights: Their shares in the displacement of the place; the sum is 1.
        share: Part of the end of the tie.
    """

    body: int
    place: Array
    nodes: Indices
    weights: Array
    share: float = 1.0


def find_ties(scene: Scene, boundary: Boundary, space: Any) -> Ties:
    """Bars of the scene's ties. Collective.

    Raises:
        InputError: If an end is in no block, or on a joint, or both ends are in one block.
    """
    bars: list[tuple[int, _End, _End]] = []
    size = float(np.ptp(boundary.points.reshape(-1, 2), axis=0).max())
    for number, (name, tie) in enumerate(scene.ties.items()):
        key = f"ties.{name}"
        first = _ends(scene.mesh, boundary, space, tie.from_, f"{key}.from")
        if tie.ground is not None:
            # The ground is the first side, as below foundations.
            none = np.empty(0, dtype=np.int64)
            second = first
            first = [_End(GROUND, np.array(tie.ground), none, np.empty(0))]
        elif tie.to is not None:
            second = _ends(scene.mesh, boundary, space, tie.to, f"{key}.to")
        for start, end in product(first, second):
            _check_apart(start, end, key, size)
            bars.append((number, start, end))
    return _bars(scene, bars)


def _check_apart(start: _End, end: _End, key: str, size: float) -> None:
    x, y = end.place
    if start.body == end.body:
        raise InputError(
            f"{key}: both ends are in one block, at ({x:g}, {y:g}); tie it to another one, or to"
            " the ground"
        )
    if np.linalg.norm(end.place - start.place) <= AT_BLOCK * size:
        raise InputError(f"{key}: both ends are at ({x:g}, {y:g}); a tie needs a length")


def _bars(scene: Scene, bars: list[tuple[int, _End, _End]]) -> Ties:
    """Arrays of bars from their ends."""
    count = len(bars)
    number = np.array([tie for tie, _, _ in bars], dtype=np.int64)
    ends = [end for _, *both in bars for end in both]
    width = max((len(end.nodes) for end in ends), default=1)
    nodes = np.full((2 * count, width), GROUND)
    weights = np.zeros((2 * count, width))
    for row, end in enumerate(ends):
        nodes[row, : len(end.nodes)] = end.nodes
        weights[row, : len(end.nodes)] = end.weights
    share = np.array([start.share * end.share for _, start, end in bars])
    ties: list[Tie] = list(scene.ties.values())
    part = share * np.array([ties[tie].per_metre for tie in number])
    soft = [0.0 if tie.stiffness is None else 1.0 / tie.stiffness for tie in ties]
    return Ties(
        names=tuple(scene.ties),
        tie=number,
        bodies=np.array([end.body for end in ends], dtype=np.int32).reshape(count, 2),
        sides=np.array([end.place for end in ends]).reshape(count, 2, 2),
        stencil=Stencil(nodes.reshape(count, 2, width), weights.reshape(count, 2, width)),
        share=share,
        yields=part * np.array([ties[tie].yield_ for tie in number]),
        compliance=np.array([soft[tie] for tie in number]) / part,
        prestress=part * np.array([ties[tie].prestress for tie in number]),
    )


def _ends(
    mesh: BlockMesh, boundary: Boundary, space: Any, where: tuple[float, float] | str, key: str
) -> list[_End]:
    """Ends of the bars of a tie at one of its ends: one for every block of a group. Collective."""
    if isinstance(where, str):
        return _ends_at_group(boundary, where)
    return [_end_at_place(mesh, boundary, space, np.array(where), key)]


def _ends_at_group(boundary: Boundary, name: str) -> list[_End]:
    """Means over the facets of a group by length, block by block."""
    facets = np.flatnonzero(boundary.role([name]) == 0)
    share = boundary.length[facets][:, None] * SHARES[boundary.nodes.shape[1]]
    found = []
    for body in np.unique(boundary.body[facets]):
        mine = facets[boundary.body[facets] == body]
        weight = share[boundary.body[facets] == body]
        nodes, place = np.unique(boundary.nodes[mine], return_inverse=True)
        weights = np.bincount(place.ravel(), weight.ravel()) / weight.sum()
        middle = np.einsum("fn,fnk->k", weight, boundary.points[mine]) / weight.sum()
        part = float(weight.sum() / share.sum())
        found.append(_End(int(body), middle, nodes, weights, part))
    return found


def _end_at_place(mesh: BlockMesh, boundary: Boundary, space: Any, place: Array, key: str) -> _End:
    """The end at a place, from the rank that has a cell there. Collective.

    Raises:
        InputError: If no block or several blocks are there.
    """
    count = mesh.domain.topology.index_map(2).size_local
    distance = _distances(mesh, place)[:count]
    size = float(np.ptp(boundary.points.reshape(-1, 2), axis=0).max())
    here = np.flatnonzero(distance <= AT_BLOCK * size)
    found = None
    function = fem.Function(space)  # collective
    if len(here):
        cell = int(here[np.argmin(distance[here])])
        found = float(distance[cell]), *_shape_functions(function, cell, place)
    parts = mesh.comm.allgather((np.unique(mesh.body[here]).tolist(), found))
    bodies = sorted({body for part, _ in parts for body in part})
    x, y = place
    if not bodies:
        nearest = _nearest(boundary, place)
        raise InputError(
            f"{key}: there is no block at ({x:g}, {y:g}); the nearest is at"
            f" ({nearest[0]:g}, {nearest[1]:g})"
        )
    if len(bodies) > 1:
        listed = ", ".join(map(str, bodies))
        raise InputError(
            f"{key}: ({x:g}, {y:g}) is on a joint, of the blocks {listed}; move it into one of them"
        )
    _, nodes, weights = min((one for _, one in parts if one is not None), key=lambda one: one[0])
    return _End(bodies[0], place, nodes, weights)


def _distances(mesh: BlockMesh, place: Array) -> Array:
    """Distance of a place from this rank's cells, at most: 0 in a cell and below, m."""
    corners = mesh.domain.geometry.x[compat.geometry_dofs(mesh.domain)][:, :, :2]
    if corners.shape[1] == 4:  # row by row in dolfinx
        corners = corners[:, [0, 1, 3, 2]]
    sides = np.roll(corners, -1, axis=1) - corners
    arm = place - corners
    turn = np.sign(np.cross(sides[:, 0], sides[:, 1]))[:, None]
    outward = -turn * np.cross(sides, arm) / np.linalg.norm(sides, axis=2)
    return np.asarray(outward.max(axis=1, initial=-np.inf))


def _shape_functions(function: fem.Function, cell: int, place: Array) -> tuple[Indices, Array]:
    """Global nodes of a cell of this rank, and their shape functions at a place."""
    space = function.function_space
    dofs = compat.cell_dofs(space)[cell]
    at = np.append(place, 0.0)
    values = np.zeros(len(dofs))
    for number, dof in enumerate(dofs):
        function.x.array[:] = 0.0
        function.x.array[2 * dof] = 1.0
        values[number] = np.ravel(function.eval(at, np.array([cell], dtype=np.int32)))[0]
    nodes = space.dofmap.index_map.local_to_global(dofs.astype(np.int32))
    used = np.abs(values) > NOTHING
    return np.asarray(nodes)[used], values[used] / values[used].sum()


def _nearest(boundary: Boundary, place: Array) -> Array:
    """The place on the outlines of the blocks that is nearest to a place, m, shape (2,)."""
    first, second = boundary.points[:, :2].swapaxes(0, 1)
    along = second - first
    s = np.clip(np.sum((place - first) * along, axis=1) / boundary.length**2, 0.0, 1.0)
    at = first + s[:, None] * along
    return np.asarray(at[np.argmin(np.linalg.norm(at - place, axis=1))])
