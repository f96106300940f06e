"""One step of a motion: the state of the blocks, and the way that they go.

A step does the work W of the live load. Its forces x and motion v, per unit of that work, are those
of the limit load of the present geometry in which units may close by their gaps g:

    (b)  min (g / W) . N + ((F - D) |v_T|) . N - lambda      over all states,
    (a)  v its mode:  f_L . v = 1,   g / W + v_N >= D |v_T|,

a quasi-static step of Moreau's (J.J. Moreau, Comput. Methods Appl. Mech. Eng. 177 (1999) 329) with
Coulomb's law and no dilatancy. Units that close within the step carry force at its end. Cohesion
and tensile strength are brittle: a contact as drawn loses both where a point of it parts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.faces.certificate import Certifier, FaceState
from fenics_contact.faces.kernel import FaceTolerances, Program, elastic_response, solve
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.system import Equations
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.motion.poses import Poses, TurningTies, loads_of
from fenics_contact.motion.touching import MovingSides, PointUnits
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.structure import FREE, SHEAR, Structure

#: States that a step may begin from, one after the other, until the gap is small enough.
ROUNDS = 8
#: A tie without stiffness is slack where it is shorter than it was by this, in block sizes.
SLACK = 1e-9
#: Points of contacts part by this, in block sizes.
PARTED = 1e-6


class Past(NamedTuple):
    """What the way until now has left.

    Attributes:
        longest: Lengths that ties have had, m.
        bonded: Which contacts as drawn have never parted.
    """

    longest: Array
    bonded: Flags


class MovingBlocks:
    """Blocks that move far: their sides, loads, ties, and freedoms.

    Attributes:
        structure: As drawn.
        driven: Velocities of ground that moves on, of all blocks, shape (blocks, 6): one unknown;
            the live load is then the unit force against it. None: the scene's live load.
        start: Poses as drawn.
        moves: Numbers of the blocks that move by unknowns of their own.
        size: Typical length of a block, m.
        freedoms: Unknowns to motions of all blocks and the ground beside them, m and rad, sparse,
            shape (6 (blocks + 1), unknowns). Rotations are in units of one over `size`.
    """

    def __init__(
        self, structure: Structure, driven: Array | None = None, sign: float = 1.0
    ) -> None:
        from scipy.sparse import csr_matrix, hstack

        self.structure = structure
        self.driven = driven
        self.start = Poses.drawn(structure)
        self.sides = MovingSides(structure, self.start)
        self.dead, self.live = loads_of(structure, sign)
        self.ties = TurningTies(structure.bars, self.start)
        self.moves = np.flatnonzero(structure.number >= 0)
        volumes = [structure.blocks[k].volume for k in self.moves]
        self.size = float(np.mean(volumes)) ** (1.0 / structure.dimension)
        self.past = Past(self.ties.drawn, np.ones(len(structure.contacts), dtype=bool))
        rows = (6 * self.moves[:, None] + FREE[structure.dimension]).ravel()
        scale = np.where(rows % 6 < 3, 1.0, 1.0 / self.size)
        shape = (6 * len(structure.blocks) + 6, len(rows))
        self.freedoms = csr_matrix((scale, (rows, np.arange(len(rows)))), shape)
        if driven is not None:
            ground = np.append(driven, np.zeros(6))
            self.freedoms = hstack([self.freedoms, csr_matrix(ground[:, None])]).tocsr()

    def motions(self, unknowns: Array) -> Array:
        """Of all blocks and the ground, m and rad, shape (blocks + 1, 6)."""
        return np.asarray(self.freedoms @ unknowns).reshape(-1, 6)

    def speed(self, unknowns: Array) -> Array:
        """Largest velocities of corners, about, by blocks."""
        motions = self.motions(unknowns)[:-1]
        turning = np.linalg.norm(motions[:, 3:], axis=1) * self.sides.reach
        return np.asarray(np.linalg.norm(motions[:, :3], axis=1) + turning)

    def dead_load(self, poses: Poses) -> Array:
        """Generalised forces."""
        return np.asarray(self.freedoms.T @ self.dead.at(poses).ravel())

    def live_load(self, poses: Poses) -> Array:
        """Generalised forces of the live load, or of a unit force against driven ground."""
        if self.driven is None:
            return np.asarray(self.freedoms.T @ self.live.at(poses).ravel())
        return np.append(np.zeros(self.freedoms.shape[1] - 1), -1.0)

    def work(self, poses: Poses) -> float:
        """Of the live load since the start, J; of the unit force against driven ground."""
        if self.driven is None:
            return self.live.work(self.start, poses)
        shift = (poses.centroid - self.start.centroid)[:-1]
        velocity = self.driven[:, :3]
        return -float(np.vdot(shift, velocity) / np.vdot(velocity, velocity))

    def stored(self, poses: Poses, past: Past) -> float:
        """Work against the dead load and into ties since the start, J."""
        return self.ties.stored(poses, past.longest) - self.dead.work(self.start, poses)

    def remembered(self, past: Past, poses: Poses) -> Past:
        """What the way until some poses has left."""
        place = [poses.placed(block, arm) for block, arm in self._drawn_points]
        parted = np.linalg.norm(place[1] - place[0], axis=1) > PARTED * self.size
        bonded = past.bonded.copy()
        bonded[self.structure.points.contact[parted]] = False
        return Past(np.maximum(past.longest, self.ties.lines(poses)[2]), bonded)

    @property
    def _drawn_points(self) -> list[tuple[Indices, Array]]:
        """Blocks of points as drawn, and their arms, m: on the first and on the second blocks."""
        count = len(self.structure.points.contact)
        return [(block[:count], arm[:count]) for _, block, arm in self.structure.ends]

    def relative_motion(self, units: PointUnits, poses: Poses) -> Any:
        """H: unknowns to the motions of points against planes, and then along ties.

        Sparse, shape ((units + ties) d, unknowns).
        """
        from scipy.sparse import csr_matrix

        place, axes, _ = units.at(poses)
        ends, line, _ = self.ties.lines(poses)
        along = np.zeros((len(line), 3, 3))
        along[:, 1] = line
        every = np.concatenate([axes, along])[:, : self.structure.dimension]
        row = np.arange(every.shape[0] * every.shape[1]).reshape(*every.shape[:2], 1)
        shape = (row.size, self.freedoms.shape[0])
        found = csr_matrix(shape)
        for end, own, sign in ((0, units.plane, -1.0), (1, units.point, 1.0)):
            block = np.append(own, self.ties.block[:, end])
            arm = np.vstack([place, ends[:, end]]) - poses.centroid[block]
            moves = sign * np.concatenate([every, np.cross(arm[:, None], every)], axis=2)
            column = 6 * (block % len(poses.centroid))[:, None, None] + np.arange(6)
            index = [np.broadcast_to(part, moves.shape).ravel() for part in (row, column)]
            found += csr_matrix((moves.ravel(), index), shape)
        return (found @ self.freedoms).tocsr()

    def strengths(self, units: PointUnits, poses: Poses, past: Past) -> tuple[Array, Array]:
        """Cohesion and tensile strength of units by the points as drawn, N, shape (units,)."""
        structure = self.structure
        (first, arm), (second, _) = self._drawn_points
        whole = past.bonded[structure.points.contact]
        values = [
            structure.of_points(name) * structure.points.area
            for name in ("cohesion", "tensile_strength")
        ]
        found = np.zeros((len(units), 2))
        whole &= np.any(values, axis=0)
        if whole.any():
            first, second, arm = first[whole], second[whole], arm[whole]
            point, unit = nearest(units, poses, poses.placed(first, arm), first, second)
            np.add.at(found, unit, np.transpose(values)[whole][point])
        return found[:, 0], found[:, 1]


@dataclass(frozen=True)
class Scenery:
    """Units in some poses as the engine sees them.

    Attributes:
        poses: Of the blocks.
        units: Points and planes; ties are behind them in the model.
        model: Of the engine.
        given: The part of forces that the model counts to the dead load, N: pressing forces are
            more by the tensile strength, ties less by half of the yield, or with a stiffness by
            their tension, shape (units + ties, d).
    """

    poses: Poses
    units: PointUnits
    model: FaceModel
    given: Array

    @classmethod
    def of(
        cls,
        bodies: MovingBlocks,
        units: PointUnits,
        poses: Poses,
        past: Past,
        held: bool = False,
    ) -> Scenery:
        """Units at some poses; where ties are held, any tension up to the yield is a state."""
        dimension = bodies.structure.dimension
        ties = bodies.ties
        count = len(units)
        motion = bodies.relative_motion(units, poses)
        taut = ties.lines(poses)[2] >= past.longest - SLACK * bodies.size
        half = 0.5 * ties.yields * np.where(ties.elastic, held, taut)
        pull = half + (0.0 if held else ties.tension(poses, past.longest))
        cohesion, tension = bodies.strengths(units, poses, past)
        none = np.zeros(count + len(half))
        given = np.zeros((len(none), dimension))
        given[:count, 0] = -tension
        given[count:, 1] = -pull
        dead = bodies.dead_load(poses)
        model = FaceModel(
            motion=motion,
            pressing=1,
            dead=dead + np.asarray(motion.T @ given.ravel()),
            live=bodies.live_load(poses),
            strength=np.append(np.maximum(cohesion - units.friction * tension, 0.0), half),
            friction=np.append(units.friction, np.zeros(len(half))),
            dilatancy=none,
            compliance=np.tile([1.0] + [1.0 / SHEAR] * (dimension - 1), (len(none), 1)),
            kappa=none,
            components=3 if dimension == 3 and bodies.driven is None else 1,
            weights=dead,
        )
        return cls(poses, units, model, given)

    def carried(
        self, place: Array, first: Indices, second: Indices, force: Array, tension: Array
    ) -> Array:
        """Forces of points of contacts and of ties as the engine's forces.

        Args:
            place: Of the points in these poses, m, shape (points, 3).
            first: Blocks on which the reverse of the forces acts.
            second: Blocks on which they act.
            force: N, shape (points, 3).
            tension: Of ties, N.
        """
        _, axes, _ = self.units.at(self.poses)
        point, unit = nearest(self.units, self.poses, place, first, second)
        sign = np.where(self.units.point[unit] == second[point], 1.0, -1.0)
        local = np.einsum("uki,ui->uk", axes[unit], sign[:, None] * force[point])
        found = np.zeros(self.given.shape)
        np.add.at(found, unit, local[:, : found.shape[1]])
        found[len(self.units) :, 1] = -tension
        found -= self.given
        found[len(self.units) :][self.model.strength[len(self.units) :] == 0.0] = 0.0
        return found


def nearest(
    units: PointUnits, poses: Poses, place: Array, first: Indices, second: Indices
) -> tuple[Indices, Indices]:
    """Points between two blocks, and the units of these blocks that are nearest to them."""
    from scipy.spatial import cKDTree

    there, _, _ = units.at(poses)
    apart = 1e3 * float(np.abs(place).max(initial=1e-9))  # those of other blocks are farther

    def between(places: Array, *blocks: Indices) -> Array:
        return np.column_stack([places, apart * np.sort(np.array(blocks), axis=0).T])

    tree = cKDTree(between(there, units.plane, units.point))
    away, unit = tree.query(between(place, first, second))
    known = np.flatnonzero(away < 0.5 * apart)
    return known, unit[known]


def state_of(
    model: FaceModel, gaps: Array | None, begin: Array | None, asked: float, sign: float
) -> FaceState:
    """The state and mode of a step.

    Args:
        model: Units in the present poses.
        gaps: Of the units, over the work of the step, m/J; None: all are closed.
        begin: Forces to begin from, those of the step before; None: from an elastic state.
        asked: Gap of the load factor that is enough.
        sign: Of the work of the live load.

    Raises:
        SolverError: If no state was found.
    """
    certifier = Certifier(model, Equations(model), sign, asked, gaps)
    best: FaceState | None = None
    for start in (begin, None):
        found = None if start is None else certifier.of(start)
        if start is None and (best is None or best.gap > asked):
            found = _from_springs(certifier)
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
    certifier = Certifier(model, Equations(model), sign)
    mode = certifier.mode(force)
    if mode is None:
        return None
    without = model.missing(force, 0.0)
    load_factor = -float(without @ model.live) / float(model.live @ model.live)
    missing = float(np.abs(model.missing(force, load_factor)).max()) / model.force
    given = replace(mode, force=force, load_factor=load_factor, missing=missing)
    state = certifier.state(given, mode.motion)
    return state if state is not None and abs(state.gap) < SEARCH.gap else None


def _from_springs(certifier: Certifier) -> FaceState | None:
    """The state near an elastic one, in which units have springs and open gaps."""
    model = certifier.model
    work = SEARCH.first_work * elastic_response(model, certifier.equations).work
    offset = np.zeros(model.shape)
    offset[:, 0] = 0.0 if certifier.gaps is None else certifier.gaps * work
    sprung = replace(model, offset=offset)
    laws = model.strength, model.friction, model.dilatancy
    program = Program(sprung, certifier.equations, *laws, certifier.sign * work, elastic=True)
    elastic = solve(program, tolerances=FaceTolerances(1e-3, 1e-5, 1e-3))
    return certifier.near(elastic, work)[0]
