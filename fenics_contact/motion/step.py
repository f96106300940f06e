"""One step of a motion: the state of the blocks, and the way that they go.

A step does the work W of the live load. Its forces x and motion v, per unit of that work, are those
of the limit load of the present geometry in which units may close by their gaps g:

    (b)  min (g / W) . N + ((F - D) |v_T|) . N - lambda      over all states,
    (a)  v its mode:  f_L . v = 1,   g / W + v_N >= D |v_T|,

a quasi-static step of Moreau's (J.J. Moreau, Comput. Methods Appl. Mech. Eng. 177 (1999) 329) with
Coulomb's law and no dilatancy. PointUnits that close within the step carry force at its end.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.faces.certificate import Certifier, FaceState
from fenics_contact.faces.kernel import FaceTolerances, Program, elastic_response, solve
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.system import Equations
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.motion.poses import Poses, TurningTies, loads_of
from fenics_contact.motion.touching import MovingSides, PointUnits
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.structure import FREE, SHEAR, Structure

#: States that a step may begin from, one after the other, until the gap is small enough.
ROUNDS = 8
#: A tie without stiffness is slack where it is shorter than it was by this, in block sizes.
SLACK = 1e-9
#: Points and units this near to each other are one, in block sizes.
NEAR = 1e-2


@dataclass(frozen=True)
class MovingBlocks:
    """Blocks that move far: their sides, loads, ties, and freedoms.

    Attributes:
        structure: As drawn.
        driven: Velocities of ground that moves on, of all blocks, shape (blocks, 6): one unknown;
            the live load is then the unit force against it. None: the scene's live load.
        sign: Of the live load.
    """

    structure: Structure
    driven: Array | None = None
    sign: float = 1.0

    @cached_property
    def start(self) -> Poses:
        """As drawn."""
        return Poses.drawn(self.structure)

    @cached_property
    def sides(self) -> MovingSides:
        """Of all pieces."""
        return MovingSides(self.structure, self.start)

    @cached_property
    def loads(self) -> Any:
        """Dead and live load."""
        return loads_of(self.structure, self.sign)

    @cached_property
    def ties(self) -> TurningTies:
        """Bars."""
        return TurningTies(self.structure.bars, self.start)

    @cached_property
    def moves(self) -> Indices:
        """Numbers of the blocks that move by unknowns of their own."""
        return np.flatnonzero(self.structure.number >= 0)

    @cached_property
    def size(self) -> float:
        """Typical length of a block, m."""
        dimension = self.structure.dimension
        return float(np.mean([self.structure.blocks[k].volume for k in self.moves])) ** (
            1.0 / dimension
        )

    @cached_property
    def freedoms(self) -> Any:
        """Unknowns to motions of all blocks, m and rad, sparse, shape (6 blocks, unknowns).

        Rotations are in units of one over `size`.
        """
        from scipy.sparse import csr_matrix, hstack

        count = 6 * len(self.structure.blocks)
        rows = (6 * self.moves[:, None] + FREE[self.structure.dimension]).ravel()
        scale = np.where(rows % 6 < 3, 1.0, 1.0 / self.size)
        own = csr_matrix((scale, (rows, np.arange(len(rows)))), (count, len(rows)))
        if self.driven is None:
            return own
        return hstack([own, csr_matrix(self.driven.reshape(-1, 1))]).tocsr()

    def motions(self, unknowns: Array) -> Array:
        """Of all blocks, m and rad, shape (blocks, 6)."""
        return np.asarray(self.freedoms @ unknowns).reshape(-1, 6)

    def speed(self, unknowns: Array) -> float:
        """Largest velocity of a corner, about."""
        motions = self.motions(unknowns)
        turning = np.linalg.norm(motions[:, 3:], axis=1) * self.sides.reach
        return float((np.linalg.norm(motions[:, :3], axis=1) + turning).max())

    def dead(self, poses: Poses) -> Array:
        """Generalised forces of dead load and ties."""
        whole = self.loads["dead"].at(poses) + self.ties.load(poses)
        return np.asarray(self.freedoms.T @ whole.ravel())

    def live(self, poses: Poses) -> Array:
        """Generalised forces of the live load, or of a unit force against driven ground."""
        if self.driven is None:
            return np.asarray(self.freedoms.T @ self.loads["live"].at(poses).ravel())
        against = np.zeros(self.freedoms.shape[1])
        against[-1] = -1.0
        return against

    def stored(self, poses: Poses) -> float:
        """Work against the dead load and into ties since the start, J."""
        return self.ties.energy(poses) - self.loads["dead"].work(self.start, poses)

    def relative_motion(self, units: PointUnits, poses: Poses) -> Any:
        """H: unknowns to the motions of points against planes, and then along ties without springs.

        Sparse, shape ((units + ties) d, unknowns).
        """
        place, axes, _ = units.at(poses)
        line, _, arms = self.ties.lines(poses)
        plastic = self.ties.plastic
        along = np.zeros((len(plastic), 3, 3))
        along[:, 1] = line[plastic]
        every = np.concatenate([axes, along])[:, : self.structure.dimension]
        blocks = [
            np.append(units.point, self.ties.block[plastic, 1]),
            np.append(units.plane, self.ties.block[plastic, 0]),
        ]
        leads = [
            np.vstack([place - poses.centroid[block[: len(place)]], arms[plastic, end]])
            for block, end in zip(blocks, (1, 0), strict=True)
        ]
        motions = [
            sign * _rows(every, arm, block, len(self.structure.blocks))
            for sign, arm, block in zip((1.0, -1.0), leads, blocks, strict=True)
        ]
        return ((motions[0] + motions[1]) @ self.freedoms).tocsr()


def _rows(axes: Array, arm: Array, block: Indices, count: int) -> Any:
    """Motions of all blocks to velocities of places along axes, sparse, (d places, 6 blocks)."""
    from scipy.sparse import csr_matrix

    moves = np.concatenate([axes, np.cross(arm[:, None], axes)], axis=2)
    moves[block < 0] = 0.0
    row = np.arange(axes.shape[0] * axes.shape[1]).reshape(axes.shape[:2])[:, :, None]
    column = 6 * (block % count)[:, None, None] + np.arange(6)
    places = [np.broadcast_to(index, moves.shape).ravel() for index in (row, column)]
    return csr_matrix((moves.ravel(), places), (row.size, 6 * count))


def face_model(bodies: MovingBlocks, units: PointUnits, poses: Poses, longest: Array) -> FaceModel:
    """Units at some poses as the engine sees them; `longest`: lengths that ties have had, m."""
    structure = bodies.structure
    ties = bodies.ties
    plastic = ties.plastic
    dimension = structure.dimension
    motion = bodies.relative_motion(units, poses)
    length = ties.lines(poses)[1]
    taut = length >= longest - SLACK * bodies.size
    half = 0.5 * np.where(taut, ties.yields, 0.0)[plastic]
    area = np.maximum(units.area, 1e-3 * np.median(units.area))
    springs = np.outer(bodies.size / area, [1.0] + [1.0 / SHEAR] * (dimension - 1))
    typical = np.median(springs, axis=0)
    none = np.zeros(len(units.area) + len(plastic))
    friction = none.copy()
    friction[: len(units.area)] = units.friction
    strength = none.copy()
    strength[len(units.area) :] = half
    given = np.zeros((len(none), dimension))
    given[len(units.area) :, 1] = -half
    dead = bodies.dead(poses)
    return FaceModel(
        motion=motion,
        pressing=1,
        dead=dead + np.asarray(motion.T @ given.ravel()),
        live=bodies.live(poses),
        strength=strength,
        friction=friction,
        dilatancy=none,
        compliance=np.vstack([springs, *[typical] * len(plastic)]),
        kappa=none,
        components=3 if dimension == 3 and bodies.driven is None else 1,
        weights=dead,
    )


def state_of(
    model: FaceModel,
    gaps: Array,
    work: float,
    before: Array | None,
    asked: float,
    sign: float,
) -> FaceState:
    """The state and mode of a step of some work.

    Args:
        model: Units in the present poses.
        gaps: Of the units, m.
        work: W, J.
        before: Forces to begin from, those of the step before; None: from an elastic state.
        asked: Gap of the load factor that is enough.
        sign: Of the work of the live load.

    Raises:
        SolverError: If no state was found.
    """
    equations = Equations(model)
    certifier = Certifier(model, equations, sign, asked, gaps / work)
    best: FaceState | None = None
    for start in (before, None):
        found = None if start is None else certifier.of(start)
        if start is None and (best is None or best.gap > asked):
            found = _from_springs(model, equations, certifier, gaps / work)
        for _ in range(ROUNDS):
            if found is None or (best is not None and found.gap > 0.9 * best.gap):
                break
            best = found
            if best.gap < asked:
                return best
            found = certifier.of(best.force)
    if best is None:
        raise SolverError("no state was found")
    return best


def given_state(model: FaceModel, force: Array, sign: float) -> FaceState | None:
    """The state of some forces, with the mode of its strengths; None if it is none."""
    slacks = model.slacks(force, model.strength, model.friction)
    inside = min(float(part.min(initial=0.0)) for part in _margins(slacks))
    certifier = Certifier(model, Equations(model), sign)
    mode = certifier.mode(force) if inside > -SEARCH.verified * model.force else None
    if mode is None:
        return None
    without = model.missing(force, 0.0)
    load_factor = -float(without @ model.live) / float(model.live @ model.live)
    missing = float(np.abs(model.missing(force, load_factor)).max()) / model.force
    given = replace(mode, force=force, load_factor=load_factor, missing=missing)
    state = certifier.state(given, mode.motion)
    return state if state is not None and state.gap < SEARCH.gap else None


def _margins(slacks: tuple[Array, ...]) -> Iterator[Array]:
    """Of pressing forces, and of friction in one dimension or on a disc."""
    yield slacks[0]
    if len(slacks) > 1:
        yield slacks[1][:, 0] - np.linalg.norm(slacks[1][:, 1:], axis=1)


def _from_springs(
    model: FaceModel, equations: Equations, certifier: Certifier, gaps: Array
) -> FaceState | None:
    """The state near an elastic one, in which units have springs and open gaps."""
    work = SEARCH.first_work * elastic_response(model, equations).work
    offset = np.zeros(model.shape)
    offset[:, 0] = gaps * work
    sprung = replace(model, offset=offset)
    laws = model.strength, model.friction, model.dilatancy
    program = Program(sprung, equations, *laws, certifier.sign * work, elastic=True)
    elastic = solve(program, tolerances=FaceTolerances(1e-3, 1e-5, 1e-3))
    return certifier.near(elastic, work)[0]


def forces_as(structure: Structure, force: Array, tension: Array, bodies: MovingBlocks) -> Any:
    """Forces of a collapse of the structure as drawn, as those of units in the same poses.

    Args:
        structure: As drawn.
        force: Of its points along axes of contacts, on the second blocks, N, shape (points, 3).
        tension: Of bars, N.
        bodies: Its blocks.

    Returns:
        A function of units and poses: forces, shape (units, d), to begin a path from.
    """
    points = structure.points
    axes = structure.axes[: len(force)]
    vectors = np.einsum("pk,pki->pi", force, axes)
    blocks = structure.ends[1][1][: len(force)]
    others = structure.ends[0][1][: len(force)]

    def begin(units: PointUnits, poses: Poses) -> Array:
        dimension = structure.dimension
        place, along, _ = units.at(poses)
        found = np.zeros((len(place), dimension))
        for k, (point, plane) in enumerate(zip(units.point, units.plane, strict=True)):
            same = (blocks == point) & (others == plane)
            opposite = (blocks == plane) & (others == point)
            mine = np.flatnonzero(same | opposite)
            if len(mine):
                near = mine[np.linalg.norm(points.position[mine] - place[k], axis=1).argmin()]
                if np.linalg.norm(points.position[near] - place[k]) < NEAR * bodies.size:
                    pull = vectors[near] * (1.0 if same[near] else -1.0)
                    found[k] = along[k, :dimension] @ pull
        plastic = bodies.ties.plastic
        bars = np.zeros((len(plastic), dimension))
        bars[:, 1] = bodies.ties.yields[plastic] / 2.0 - tension[plastic]
        return np.vstack([found, bars])

    return begin
