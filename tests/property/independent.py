"""An independent judge of limit loads: programs of rigid blocks, and written files read again.

Nothing here uses the package's joints, matrices, programs or verification: blocks, faces and loads
are read off the scene's cells, groups and laws. The programs are in normal and shear forces (n, t)
at both ends of every facet, with |t| <= F n + g as inequalities.

Bounds. With associative friction the program gives an upper bound on all load factors. With F = 0,
and given strengths kept, it gives a lower bound: let v be the collapse mode, r* the forces of the
program and lambda* its value. Then lambda* f_L.v + f_D.v <= sum g |slip of v| over joints of a
given strength, which is at most what friction dissipates too: lambda f_L.v + f_D.v. (D.C. Drucker,
J. Appl. Mech. 21 (1954) 71; D. Radenkovic, C. R. Acad. Sci. 252 (1961) 4103.)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog
from scipy.sparse import coo_matrix, csr_matrix, diags, hstack, identity, vstack
from scipy.spatial import cKDTree

from fenics_contact import JointLaw, Scene
from tests.vtu import values_of

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

GROUND = -1

#: HiGHS' primal and dual tolerance, forces in units of the largest load of a block.
FEASIBLE = 1e-10

#: A dead load stands if the blocks miss no more of equilibrium than this part of their weights.
STANDS = 1e-6

#: Sides of a cell by its number of nodes, in dolfinx's order.
CELL_SIDES = {3: [(0, 1), (1, 2), (2, 0)], 4: [(0, 1), (1, 3), (3, 2), (2, 0)]}

#: Corners of the triangles that make a cell, likewise.
CELL_TRIANGLES = {3: [(0, 1, 2)], 4: [(0, 1, 3), (0, 3, 2)]}


class ProgramError(RuntimeError):
    """HiGHS gives no answer."""


@dataclass(frozen=True)
class Contacts:
    """Points at which blocks exchange forces.

    Attributes:
        bodies: First and second block, `GROUND` for rigid ground, shape (points, 2).
        position: m, shape (points, 2).
        normal: Unit normal from the first block to the second, shape (points, 2).
        friction: Coulomb's coefficient, 0 for other laws, shape (points,).
        strength: Given bound on the shear force, N/m, 0 for other laws, shape (points,).
    """

    bodies: Indices
    position: Array
    normal: Array
    friction: Array
    strength: Array

    @property
    def tangent(self) -> Array:
        """Normals turned anticlockwise, shape (points, 2)."""
        return np.column_stack([-self.normal[:, 1], self.normal[:, 0]])


@dataclass(frozen=True)
class Blocks:
    """Rigid blocks, what they weigh, and where they touch; units as in the scene.

    Attributes:
        centre: Of gravity, shape (blocks, 2).
        size: Largest extension of the blocks, which moments are divided by.
        dead: Forces and moment / size of the dead load on every block, shape (blocks, 3).
        live: Likewise.
        faces: Both ends of all facets that touch another block or the ground, one after the other.
        held: Blocks, places and directions of the reactions of supports: (block, x, y, dx, dy).
    """

    centre: Array
    size: float
    dead: Array
    live: Array
    faces: Contacts
    held: Array

    @property
    def force(self) -> float:
        """Largest load of a block, dead or, without that, live."""
        return float(np.abs(self.dead).max()) or float(np.abs(self.live).max()) or 1.0

    @property
    def typical(self) -> float:
        """Load factor at which the live load is as large as the dead load."""
        live = float(np.abs(self.live).sum())
        return (float(np.abs(self.dead).sum()) or live) / live

    def columns(self, block: Indices, position: Array, force: Array) -> csr_matrix:
        """Forces and moments on all blocks of forces on some, shape (3 blocks, forces)."""
        kept = np.flatnonzero(block != GROUND)
        of, along = block[kept], force[kept]
        arm = position[kept] - self.centre[of]
        moment = (arm[:, 0] * along[:, 1] - arm[:, 1] * along[:, 0]) / self.size
        values = np.column_stack([along, moment]).ravel()
        rows = (3 * of[:, None] + np.arange(3)).ravel()
        shape = (3 * len(self.centre), len(block))
        return coo_matrix((values, (rows, np.repeat(kept, 3))), shape).tocsr()

    def pairs(self, contacts: Contacts, direction: Array) -> csr_matrix:
        """Those of unit forces on second blocks, and their opposites on first ones."""
        first, second = contacts.bodies.T
        on_first = self.columns(first, contacts.position, -direction)
        return on_first + self.columns(second, contacts.position, direction)

    @cached_property
    def reactions(self) -> csr_matrix:
        """Those of unit reactions of all supports."""
        return self.columns(self.held[:, 0].astype(int), self.held[:, 1:3], self.held[:, 3:])

    def largest(self, contacts: Contacts | None = None) -> float | None:
        """Largest load factor with equilibrium; infinite, or None if there is none at all."""
        contacts = contacts or self.faces
        equilibrium, laws, bounds, limits = self._program(contacts)
        cost = np.zeros(equilibrium.shape[1])
        cost[0] = -1.0
        try:
            answer = _solved(cost, laws, bounds, equilibrium, self._right, [(None, None), *limits])
        except ProgramError:
            if self._least(contacts, (None, None)) <= STANDS:
                raise
            return None  # HiGHS does not always tell that a program has no solution
        return {0: -answer.fun if answer.status == 0 else None, 2: None, 3: math.inf}[answer.status]

    def violation(self, contacts: Contacts | None = None) -> float:
        """Least part of the dead load without equilibrium: the sum over blocks, over their own.

        This program always has a solution.
        """
        return self._least(contacts or self.faces, (0.0, 0.0))

    def _least(self, contacts: Contacts, factors: tuple[float | None, float | None]) -> float:
        """Least violation of equilibrium with load factors between two limits."""
        equilibrium, laws, bounds, limits = self._program(contacts)
        own = np.abs(self.dead).max(axis=1)
        own = np.where(own > 0.0, own, 1e-3 * own.max() or 1.0) / self.force
        slack = diags(np.repeat(own, 3))
        count = slack.shape[0]
        answer = _solved(
            np.concatenate([np.zeros(equilibrium.shape[1]), np.ones(2 * count)]),
            hstack([laws, csr_matrix((laws.shape[0], 2 * count))]),
            bounds,
            hstack([equilibrium, slack, -slack]),
            self._right,
            [factors, *limits, *[(0.0, None)] * (2 * count)],
        )
        if answer.status != 0:
            raise ProgramError(f"least violation: {answer.message}")
        return float(answer.fun)

    @property
    def _right(self) -> Array:
        """The dead load, on the other side of the equations."""
        return -self.dead.ravel() / self.force

    def _program(self, contacts: Contacts) -> tuple[Any, Any, Array, list[Any]]:
        """Equilibrium and joint laws in load factor, normal and shear forces and reactions.

        The limits are those of all forces, without the load factor's.
        """
        count, held = len(contacts.bodies), len(self.held)
        live = csr_matrix(self.live.reshape(-1, 1) / self.force)
        normal, shear = (self.pairs(contacts, d) for d in (contacts.normal, contacts.tangent))
        one, friction = identity(count), diags(contacts.friction)
        first, last = csr_matrix((count, 1)), csr_matrix((count, held))
        laws = [hstack([first, -friction, sign * one, last]) for sign in (1.0, -1.0)]
        strength = np.tile(contacts.strength / self.force, 2)
        limits = [(0.0, None)] * count + [(None, None)] * (count + held)
        return hstack([live, normal, shear, self.reactions]), vstack(laws), strength, limits


def _solved(
    cost: Array, laws: Any, bounds: Array, equilibrium: Any, right: Array, limits: list[Any]
) -> Any:
    """HiGHS' answer: optimal (0), infeasible (2) or unbounded (3)."""
    names = "primal_feasibility_tolerance", "dual_feasibility_tolerance"
    # HiGHS may answer "status 15, unknown" one way, and solve the program in another.
    for method, tolerance, presolve in (
        ("highs-ds", FEASIBLE, True),
        ("highs-ipm", 1e-9, True),
        ("highs-ds", FEASIBLE, False),
        ("highs-ds", 1e-7, True),
    ):
        options: dict[str, Any] = {**dict.fromkeys(names, tolerance), "presolve": presolve}
        program = cost, laws.tocsr(), bounds, equilibrium.tocsr(), right, limits
        answer = linprog(*program, method=method, options=options)
        if answer.status in (0, 2, 3):
            return answer
    raise ProgramError(answer.message)


def frictionless(contacts: Contacts) -> Contacts:
    """Contacts without friction; given strengths stay."""
    return replace(contacts, friction=np.zeros_like(contacts.friction))


# Reading a scene, on one rank


@dataclass(frozen=True)
class Sides:
    """Sides of cells that are the boundary of blocks.

    Attributes:
        ends: Corners, shape (sides, 2, 2), m.
        body: Block, shape (sides,).
        outward: Unit normal, shape (sides, 2).
        groups: Names of groups of every side.
    """

    ends: Array
    body: Indices
    outward: Array
    groups: list[frozenset[str]]

    @property
    def length(self) -> Array:
        """Length of every side, m."""
        return np.linalg.norm(self.ends[:, 1] - self.ends[:, 0], axis=1)

    def named(self, name: str) -> Indices:
        """Sides of a group."""
        return np.flatnonzero([name in names for names in self.groups])


def cells_of(scene: Scene) -> tuple[Array, Indices]:
    """Points and their numbers in all cells."""
    geometry = scene.mesh.domain.geometry
    flat = np.asarray(getattr(geometry.dofmap, "array", geometry.dofmap))
    return geometry.x[:, :2], flat.reshape(len(scene.mesh.body), -1).astype(np.int64)


def boundary_of(scene: Scene) -> Sides:
    """Sides that belong to one cell only."""
    points, cells = cells_of(scene)
    local = np.array(CELL_SIDES[cells.shape[1]])
    sides = cells[:, local].reshape(-1, 2)
    cell = np.repeat(np.arange(len(cells)), len(local))
    _, index, count = np.unique(
        np.sort(sides, axis=1), axis=0, return_index=True, return_counts=True
    )
    sides, cell = sides[index[count == 1]], cell[index[count == 1]]
    ends = points[sides]
    way = ends[:, 1] - ends[:, 0]
    normal = np.column_stack([way[:, 1], -way[:, 0]]) / np.linalg.norm(way, axis=1)[:, None]
    inward = points[cells[cell]].mean(axis=1) - ends[:, 0]
    normal *= -np.sign(np.sum(normal * inward, axis=1))[:, None]
    given = np.asarray(scene.mesh.domain.geometry.input_global_indices)[sides]
    names = {
        tuple(nodes): scene.mesh.facet_sets[group]
        for nodes, group in zip(scene.mesh.facets.tolist(), scene.mesh.facet_groups, strict=True)
    }
    groups = [names.get(tuple(sorted(pair)), frozenset()) for pair in given.tolist()]
    return Sides(ends, scene.mesh.body[cell].astype(np.int64), normal, groups)


def read(scene: Scene) -> Blocks:
    """The rigid blocks of a scene."""
    sides = boundary_of(scene)
    centre, weights = _weights(scene)
    size = float(np.ptp(sides.ends, axis=(0, 1)).max())
    held = [
        (sides.body[side], *end, *direction)
        for name, kind in scene.supports.items()
        for side in sides.named(name)
        for end in sides.ends[side]
        for direction in (np.eye(2) if kind == "fixed" else sides.outward[side][None])
    ]
    blank = np.zeros((len(centre), 3))
    faces = faces_of(scene, sides)
    blocks = Blocks(centre, size, blank, blank, faces, np.array(held).reshape(-1, 5))
    loads = {}
    for name, load in (("dead", scene.dead), ("live", scene.live)):
        total = np.zeros((len(centre), 3))
        total[:, :2] = weights[:, None] * np.array(load.body)
        for group, traction in load.traction.items():
            which = sides.named(group)
            force = sides.length[which, None] * np.array(traction)
            middle = sides.ends[which].mean(axis=1)
            columns = blocks.columns(sides.body[which], middle, force)
            total += np.asarray(columns.sum(axis=1)).reshape(-1, 3)
        loads[name] = total
    return replace(blocks, **loads)


def _weights(scene: Scene) -> tuple[Array, Array]:
    """Centre of gravity and mass (or area, if there is none) of every block."""
    points, cells = cells_of(scene)
    density = [scene.material(groups).density for groups in scene.mesh.cell_sets]
    count, body = scene.mesh.body_count, scene.mesh.body
    mass, area, moment = np.zeros(count), np.zeros(count), np.zeros((count, 2))
    for corners in CELL_TRIANGLES[cells.shape[1]]:
        a, b, c = (points[cells[:, k]] for k in corners)
        (x1, y1), (x2, y2) = (b - a).T, (c - a).T
        part = 0.5 * np.abs(x1 * y2 - y1 * x2)
        np.add.at(area, body, part)
        np.add.at(mass, body, part * np.array(density)[scene.mesh.cell_groups])
        np.add.at(moment, body, part[:, None] * (a + b + c) / 3.0)
    # Every block is of one material, so that the centre of its area is that of gravity.
    return moment / area[:, None], mass


def faces_of(scene: Scene, sides: Sides) -> Contacts:
    """Both ends of all sides that touch another block, or stand on the ground, one by one."""
    middle = sides.ends.mean(axis=1)
    found: list[tuple[int, int, JointLaw]] = []
    near = 1e-8 * float(np.ptp(sides.ends, axis=(0, 1)).max())
    for one, other in sorted(cKDTree(middle).query_pairs(near)):
        if sides.body[one] != sides.body[other]:
            names = (sides.groups[one] | sides.groups[other]) & set(scene.joints)
            found.append((one, other, scene.joints[min(names, default="default")]))
    for name, law in scene.foundations.items():
        found += [(GROUND, side, law) for side in sides.named(name).tolist()]
    first, second = np.array([pair[:2] for pair in found], dtype=np.int64).reshape(-1, 2).T
    laws = [law for *_, law in found]
    half = 0.5 * sides.length[second]
    below = np.where(first == GROUND, GROUND, sides.body[first])
    return Contacts(
        np.repeat(np.column_stack([below, sides.body[second]]), 2, axis=0),
        sides.ends[second].reshape(-1, 2),
        np.repeat(-sides.outward[second], 2, axis=0),
        np.repeat([law.friction or 0.0 for law in laws], 2),
        np.repeat(half * [law.bound or 0.0 for law in laws], 2),
    )


# Checking written files


@dataclass(frozen=True)
class Written:
    """What the files of a result say.

    Attributes:
        load_factor: From result.json.
        contacts: Joint points with their blocks and laws.
        normal: Normal forces of the joint points, positive in compression, N/m, shape (points,).
        shear: Shear forces on second blocks along tangents, N/m, likewise.
        values: Other columns of joints.vtu.
        motion: Displacements and collapse mode at the nodes of every block: (places, u, v).
    """

    load_factor: float
    contacts: Contacts
    normal: Array
    shear: Array
    values: Mapping[str, Array]
    motion: list[tuple[Array, Array, Array]]


def read_vtu(path: Path) -> dict[str, Array]:
    """Arrays of a VTK file of one piece by name, that of the points as "points"."""
    found: dict[str, Array] = {}
    piece = ElementTree.parse(path).getroot().find("UnstructuredGrid/Piece")
    assert piece is not None
    for section in piece:
        for item in section.iter("DataArray"):
            name = "points" if section.tag == "Points" else str(item.get("Name"))
            found[name] = values_of(item)
    return found


def read_written(folder: Path, blocks: Blocks, load_factor: float) -> Written:
    """The files of a result in a folder, written by one rank."""
    file = read_vtu(folder / "joints.vtu")
    lines = file["connectivity"].astype(int).reshape(-1, 2)
    position, normal = file["points"][:, :2], file["normal"][:, :2]
    faces = blocks.faces
    # A line of the file is a facet: its middle tells which blocks meet there.
    middle = 0.5 * (faces.position[::2] + faces.position[1::2])
    near, which = cKDTree(middle).query(position[lines].mean(axis=1))
    if len(which) != len(middle) or near.max(initial=0.0) > 1e-6 * blocks.size:
        raise AssertionError("joints.vtu does not show the facets of the scene's joints")
    face = np.zeros(len(position), dtype=np.int64)
    strength = np.zeros(len(position))
    for end in (0, 1):
        face[lines[:, end]] = 2 * which
        np.add.at(strength, lines[:, end], faces.strength[2 * which])
    same = np.sum(normal * faces.normal[face], axis=1) > 0.0
    bodies = np.where(same[:, None], faces.bodies[face], faces.bodies[face][:, ::-1])
    contacts = Contacts(bodies, position, normal, faces.friction[face], strength)
    force = file["force"][:, :2]
    return Written(
        load_factor,
        contacts,
        np.sum(force * normal, axis=1),
        np.sum(force * contacts.tangent, axis=1),
        file,
        _motion(read_vtu(next(folder.glob("blocks_p0_*.vtu")))),
    )


def _motion(file: Mapping[str, Array]) -> list[tuple[Array, Array, Array]]:
    """Places, displacements and mode at the nodes of every block."""
    ends = file["offsets"].astype(int)
    cell = np.repeat(np.arange(len(ends)), np.diff(ends, prepend=0))
    body = file["body"][cell].astype(int)
    nodes = file["connectivity"].astype(int)
    found = []
    for one in range(body.max() + 1):
        mine = np.unique(nodes[body == one])
        place, u, v = (file[name][mine, :2] for name in ("points", "displacement", "collapse_mode"))
        found.append((place, u, v))
    return found


#: Digits of joint forces, relative to the largest.
ROUNDING = 1e-11


def unbalanced(blocks: Blocks, written: Written) -> Array:
    """Force that every block misses of equilibrium, over the forces on it, shape (blocks,).

    Rounding of the largest joint force of all is no miss.
    """
    contacts = written.contacts
    loads = blocks.dead + written.load_factor * blocks.live
    rest, size = loads.copy(), np.abs(loads)
    for force, direction in (
        (written.normal, contacts.normal),
        (written.shear, contacts.tangent),
    ):
        part = blocks.pairs(contacts, force[:, None] * direction)
        rest += np.asarray(part.sum(axis=1)).reshape(-1, 3)
        size += np.asarray(abs(part).sum(axis=1)).reshape(-1, 3)
    if len(blocks.held):
        react = blocks.reactions.toarray()
        rest = rest.ravel() - react @ np.linalg.lstsq(react, rest.ravel(), rcond=None)[0]
        rest = rest.reshape(-1, 3)
    largest = size.max(axis=1)
    missed = np.maximum(np.abs(rest).max(axis=1) - ROUNDING * written.normal.max(initial=0.0), 0.0)
    return missed / np.where(largest > 0.0, largest, 1.0)


def misses(blocks: Blocks, written: Written) -> dict[str, float]:
    """What the files miss of being a collapse state; relative, 0 if they are exactly one.

    "rigid" is the difference of the load factor and the program's with the bounds on shear forces
    that the state has, over the load factor or a thousandth of the typical one. The program's is
    the largest load factor, or the least one where the live load does negative work in the mode.
    """
    contacts, normal, shear = written.contacts, written.normal, written.shear
    gap, slip = written.values["gap"], written.values["slip"]
    force = float(np.abs(normal).max()) or 1.0
    far = max(float(np.abs(u).max()) for _, u, _ in written.motion) or 1.0
    bound = contacts.friction * np.maximum(normal, 0.0) + contacts.strength
    sizes = {
        "equilibrium": unbalanced(blocks, written),
        "tension": -normal / force,
        "friction": (np.abs(shear) - bound) / force,
        "penetration": -gap / far,
        "open under pressure": np.abs(gap * normal) / (far * force),
        "slip along shear": slip * shear / (far * force),
        "slip below the bound": np.abs(slip) * (bound - np.abs(shear)) / (far * force),
    }
    found = {name: max(float(np.max(values)), 0.0) for name, values in sizes.items()}
    given = replace(contacts, friction=np.zeros_like(bound), strength=bound)
    mode, live_work = mode_misses(blocks, written)
    sign = math.copysign(1.0, live_work)
    rigid = replace(blocks, live=sign * blocks.live).largest(given)
    size = max(abs(written.load_factor), 1e-3 * blocks.typical)
    found["rigid"] = math.inf if rigid is None else abs(sign * rigid - written.load_factor) / size
    return found | mode


def mode_misses(blocks: Blocks, written: Written) -> tuple[dict[str, float], float]:
    """What the written mode misses of a motion of rigid blocks that needs the loads' power.

    Also the live load's work in it.
    """
    contacts = written.contacts
    fast = max(float(np.abs(v).max()) for *_, v in written.motion) or 1.0
    power, strain, live_work = 0.0, 0.0, 0.0
    for block, (place, _, velocity) in enumerate(written.motion):
        arm = place - blocks.centre[block]
        basis = np.zeros((*arm.shape, 3))
        basis[:, 0, 0] = basis[:, 1, 1] = 1.0
        basis[:, 0, 2], basis[:, 1, 2] = -arm[:, 1] / blocks.size, arm[:, 0] / blocks.size
        flat = basis.reshape(-1, 3)
        rigid = np.linalg.lstsq(flat, velocity.ravel(), rcond=None)[0]
        strain = max(strain, float(np.abs(flat @ rigid - velocity.ravel()).max()) / fast)
        loads = blocks.dead[block] + written.load_factor * blocks.live[block]
        power += float(loads @ rigid)
        live_work += float(blocks.live[block] @ rigid)
    bound = contacts.friction * np.maximum(written.normal, 0.0) + contacts.strength
    spent = float(bound @ np.abs(written.values["slip_rate"]))
    size = float((np.abs(blocks.dead) + abs(written.load_factor) * np.abs(blocks.live)).sum())
    return {
        "mode strains blocks": strain,
        "mode penetrates": max(-float(written.values["opening_rate"].min()) / fast, 0.0),
        "mode power": abs(power - spent) / (size * fast),
    }, live_work


# Judging

STATUSES = ("limit", "unbounded", "unstable", "no_equilibrium", "not_converged")

#: By how much a load factor may leave its bracket, relative to itself and to the typical one.
OUTSIDE, OUTSIDE_TYPICAL = 1e-5, 1e-7

#: What written files may miss, by the names of `misses`.
TOLERANCES: Mapping[str, float] = {
    "equilibrium": 1e-6,
    "tension": 1e-6,
    "friction": 1e-5,
    "penetration": 1e-5,
    "open under pressure": 1e-5,
    "slip along shear": 1e-5,
    "slip below the bound": 1e-5,
    "rigid": 1e-4,
    "mode strains blocks": 1e-4,
    "mode penetrates": 1e-5,
    "mode power": 1e-4,
}

#: What is claimed without a proof, but may be right: joints with friction are not associative.
UNPROVED = "unstable, but it stands with associative friction"


def faults(blocks: Blocks, status: str, load_factor: float) -> list[str]:
    """What is wrong with an answer, by the programs of rigid blocks alone.

    `not_converged` claims nothing, so that nothing is wrong with it, and `no_equilibrium` only that
    none was found.
    """
    if status not in STATUSES:
        return [f"status {status}"]
    if status == "not_converged":
        return []
    missed = blocks.violation()
    if status == "unstable":
        return [] if missed > STANDS else [UNPROVED]
    if status == "no_equilibrium" and missed <= STANDS:
        return []
    if missed > STANDS:
        return [f"the dead load does not stand: {missed:.3g} of the weights is not carried"]
    upper = blocks.largest()
    if status == "unbounded":
        return [] if upper == math.inf else [f"unbounded, but at most {upper}"]
    lower = blocks.largest(frictionless(blocks.faces))
    lower = -math.inf if lower is None else lower
    upper = math.inf if upper is None else upper
    near = OUTSIDE * abs(load_factor) + OUTSIDE_TYPICAL * blocks.typical
    inside = lower - near <= load_factor <= upper + near
    return [] if inside else [f"{load_factor} is outside {lower} ... {upper}"]


def written_faults(blocks: Blocks, folder: Path, load_factor: float) -> list[str]:
    """What is wrong with the written files of a limit load."""
    found = misses(blocks, read_written(folder, blocks, load_factor))
    wrong = {name: value for name, value in found.items() if not value <= TOLERANCES[name]}
    return [f"{name} {value:.1e}" for name, value in wrong.items()]
