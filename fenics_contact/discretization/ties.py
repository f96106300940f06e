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
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from fenics_contact import compat
from fenics_contact.discretization.facets import (
    GROUND,
    NO_NODE,
    NOTHING,
    SHARES,
    Boundary,
    Stencil,
    reference_places,
    shape_functions,
)
from fenics_contact.errors import InputError, Vector
from fenics_contact.geometry.mesh import Array, BlockMesh, Flags, Indices, Labels
from fenics_contact.scene.scene import JointLaw, Scene

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
        soils: How many of the last names are of soil (`soil`).
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
    soils: int = 0

    @property
    def keys(self) -> tuple[str, ...]:
        """Names as a scene file has them."""
        first = len(self.names) - self.soils
        kinds = ["ties"] * first + ["soil"] * self.soils
        return tuple(f"{kind}.{name}" for kind, name in zip(kinds, self.names, strict=True))

    def joined(self, more: Ties) -> Ties:
        """These bars, and then others."""
        arrays = ("bodies", "sides", "share", "yields", "compliance", "prestress")
        return Ties(
            names=(*self.names, *more.names),
            tie=np.concatenate([self.tie, len(self.names) + more.tie]),
            stencil=Stencil.joined([self.stencil, more.stencil]),
            soils=self.soils + more.soils,
            **{name: np.concatenate([getattr(self, name), getattr(more, name)]) for name in arrays},
        )

    def part(self, soil: bool) -> tuple[Flags, Ties]:
        """Bars of soil, or all others: which they are, and they alone."""
        first = len(self.names) - self.soils
        mine = (self.tie >= first) == soil
        arrays = ("bodies", "sides", "share", "yields", "compliance", "prestress")
        return mine, Ties(
            names=self.names[first:] if soil else self.names[:first],
            tie=self.tie[mine] - first * soil,
            stencil=Stencil(self.stencil.nodes[mine], self.stencil.weights[mine]),
            soils=self.soils * soil,
            **{name: getattr(self, name)[mine] for name in arrays},
        )

    @property
    def laws(self) -> tuple[JointLaw, ...]:
        """Laws of all names, |r_T| <= Y/2."""
        half = 0.5 * np.bincount(self.tie, self.yields, len(self.names))
        return tuple(JointLaw("tresca", bound=float(bound)) for bound in half)

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


#: Where a bar begins or ends: the body (`GROUND` for the ground), the place, m, displacement nodes
#: and their weights, whose sum is 1, and the part of the end of the tie.
_End: TypeAlias = tuple[int, Array, Indices, Array, float]


def find_ties(scene: Scene, boundary: Boundary, space: Any) -> Ties:
    """Bars of the scene's ties. Collective.

    Raises:
        InputError: If an end is in no block, or on a joint, or both ends are in one block.
    """
    bars: list[tuple[int, _End, _End]] = []
    size = float(np.ptp(boundary.points.reshape(-1, 2), axis=0).max())
    for index, (name, tie) in enumerate(scene.ties.items()):
        key = f"ties.{name}"
        first = _ends(scene.mesh, boundary, space, tie.from_, f"{key}.from")
        if tie.ground is not None:
            # The ground is the first side, as below foundations.
            none = np.empty(0, dtype=np.int64)
            second = first
            first = [(GROUND, np.array(tie.ground), none, np.empty(0), 1.0)]
        elif tie.to is not None:
            second = _ends(scene.mesh, boundary, space, tie.to, f"{key}.to")
        for start, end in product(first, second):
            x, y = end[1]
            if start[0] == end[0]:
                raise InputError(
                    f"{key}: both ends are in one block, at ({x:g}, {y:g}); tie it to another one,"
                    " or to the ground"
                )
            if np.linalg.norm(end[1] - start[1]) <= AT_BLOCK * size:
                raise InputError(f"{key}: both ends are at ({x:g}, {y:g}); a tie needs a length")
            bars.append((index, start, end))
    ends = [end for _, *both in bars for end in both]
    shape = len(bars), 2, max((len(nodes) for _, _, nodes, _, _ in ends), default=1)
    nodes = np.full((2 * len(bars), shape[2]), NO_NODE)
    weights = np.zeros(nodes.shape)
    for row, (_, _, at, parts, _) in enumerate(ends):
        nodes[row, : len(at)] = at
        weights[row, : len(at)] = parts
    number = np.array([tie for tie, _, _ in bars], dtype=np.int64)
    share = np.array([part for *_, part in ends]).reshape(-1, 2).prod(axis=1)
    # The ties' thickness, yield, prestress and compliance.
    soft = [0.0 if tie.stiffness is None else 1.0 / tie.stiffness for tie in scene.ties.values()]
    given = [(tie.per_metre, tie.yield_, tie.prestress) for tie in scene.ties.values()]
    per_metre, yields, prestress = np.array(given, dtype=float).reshape(-1, 3)[number].T
    part = share * per_metre
    return Ties(
        names=tuple(scene.ties),
        tie=number,
        bodies=np.array([body for body, *_ in ends], dtype=np.int32).reshape(-1, 2),
        sides=np.array([place for _, place, *_ in ends]).reshape(-1, 2, 2),
        stencil=Stencil(nodes.reshape(shape), weights.reshape(shape)),
        share=share,
        yields=part * yields,
        compliance=np.array(soft)[number] / part,
        prestress=part * prestress,
    )


def _ends(
    mesh: BlockMesh, boundary: Boundary, space: Any, where: Vector | str, key: str
) -> list[_End]:
    """Ends of the bars of a tie at one of its ends. Collective.

    At a group they are means over its facets by length, block by block.

    Raises:
        InputError: If no block or several blocks are at a place.
    """
    if not isinstance(where, str):
        return [_end_at_place(mesh, boundary, space, np.array(where), key)]
    facets = np.flatnonzero(boundary.role([where]) == 0)
    share = boundary.length[facets][:, None] * SHARES[boundary.nodes.shape[1]]
    found: list[_End] = []
    for body in np.unique(boundary.body[facets]):
        mine = facets[boundary.body[facets] == body]
        weight = share[boundary.body[facets] == body]
        nodes, place = np.unique(boundary.nodes[mine], return_inverse=True)
        weights = np.bincount(place.ravel(), weight.ravel()) / weight.sum()
        middle = np.einsum("fn,fnk->k", weight, boundary.points[mine]) / weight.sum()
        found.append((int(body), middle, nodes, weights, float(weight.sum() / share.sum())))
    return found


def _end_at_place(mesh: BlockMesh, boundary: Boundary, space: Any, place: Array, key: str) -> _End:
    """The end at a place, from the rank that has the nearest cell there. Collective."""
    corners = mesh.domain.geometry.x[compat.geometry_dofs(mesh.domain)][:, :, :2]
    if corners.shape[1] == 4:  # row by row in dolfinx
        corners = corners[:, [0, 1, 3, 2]]
    # Distance from the cells, at most: 0 in a cell and below.
    sides = np.roll(corners, -1, axis=1) - corners
    turn = np.sign(np.cross(sides[:, 0], sides[:, 1]))[:, None]
    outward = -turn * np.cross(sides, place - corners) / np.linalg.norm(sides, axis=2)
    distance = outward.max(axis=1, initial=-np.inf)[: mesh.domain.topology.index_map(2).size_local]
    size = float(np.ptp(boundary.points.reshape(-1, 2), axis=0).max())
    here = np.flatnonzero(distance <= AT_BLOCK * size)
    found = None
    if len(here):
        cell = int(here[np.argmin(distance[here])])
        corners = mesh.domain.geometry.x[compat.geometry_dofs(mesh.domain)[cell], :2]
        at = reference_places(corners[None], (place - corners[0])[None, None])
        values = shape_functions(space, at)[0, 0]
        dofs = compat.cell_dofs(space)[cell].astype(np.int32)
        used = np.abs(values) > NOTHING
        nodes = np.asarray(space.dofmap.index_map.local_to_global(dofs))[used]
        found = float(distance[cell]), nodes, values[used] / values[used].sum()
    parts = mesh.comm.allgather((np.unique(mesh.body[here]).tolist(), found))
    bodies = sorted({body for part, _ in parts for body in part})
    x, y = place
    if not bodies:
        at = boundary.nearest(place)
        nearest = at[np.argmin(np.linalg.norm(at - place, axis=1))]
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
    return bodies[0], place, nodes, weights, 1.0
