"""Programs that need one solve: upper ends, loads beyond strengths, elastic states at a given load.

With dilatancy F slip is normal to Coulomb's cone and the program is convex: a mode v that opens by
F |v_T| at least proves that nothing carries more than

    (c . |v_T| + sigma - f_D . v) / f_L . v

(D.C. Drucker, J. Appl. Mech. 21 (1954) 71). The kernel's multipliers are inside
the cones, so that its modes open a little more, once the rest of their equation is small enough:
`proved_end` judges them with all rounding against them.

The elastic state of faces under the dead load and a given multiple of the live load has no load
factor among its unknowns: min 1/2 x . C x under equilibrium and the cones of Coulomb's law, without
dilatancy. Where that stalls, the loads are asked for a multiple of them that does a work.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.faces.cones import TINY, Array
from fenics_contact.faces.kernel import (
    FaceIterate,
    FaceTolerances,
    Program,
    Row,
    elastic_response,
    solve,
)
from fenics_contact.faces.model import FaceModel, pressing_power
from fenics_contact.faces.system import Equations
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.search_options import SEARCH

#: Relative rounding.
EPS = float(np.finfo(float).eps)


def associative_state(model: FaceModel, equations: Equations) -> FaceIterate:
    """The state of the largest load factor; near it where blocks are many."""
    program = Program(model, equations, model.strength, model.friction, model.friction)
    many = model.has_many_blocks
    return solve(program, tolerances=FaceTolerances(SEARCH.rough_gap, 1e-7, 1e-4) if many else None)


def associative_end(model: FaceModel) -> float | None:
    """Load factor that nothing exceeds, proved by an admissible mode; None if none was found.

    All rounding is against it. Where the kernel comes to no end, it begins again from the live
    load that it has reached: the modes are of other loads then, but each of them proves an end.

    Args:
        model: The faces; slip is taken to be associative, with the dilatancy F.
    """
    firm = replace(SEARCH, regularization=SEARCH.decade * SEARCH.digits)
    many = model.has_many_blocks
    close = 5.0 * SEARCH.part_gap * SEARCH.gap if many else SEARCH.rounding
    friction = model.friction
    loaded, carried = model, 0.0
    end: float | None = None
    stands = False
    inside: list[tuple[Array, Array, float]] = []  # modes, their openings and ends

    def near(iterate: FaceIterate) -> bool:
        nonlocal end, stands
        stands = stands or iterate.missing <= 10.0 * SEARCH.digits
        work = float(model.live @ iterate.motion)
        if not work > 0.0:
            return False
        mode = iterate.motion / work
        _, opening = _least_opening(model, mode)
        found = proved_end(model, mode)
        if found is not None:
            inside.append((mode, opening, found))
        elif inside:
            lacks = np.maximum(-opening, 0.0)
            parts = [float(np.max(lacks / (lacks + other[1] + TINY))) for other in inside]
            least = int(
                np.argmin([part * other[2] for part, other in zip(parts, inside, strict=True)])
            )
            part = min(1.0, (1.0 + 1e-3) * parts[least])
            found = proved_end(model, (1.0 - part) * mode + part * inside[least][0])
        if found is not None and (end is None or found < end):
            end = found
        reached = carried + iterate.load_factor
        if end is None or (iterate.missing > 10.0 * SEARCH.digits and not many):
            return False
        return abs(end - reached) <= close * model.size(reached)

    for _ in range(SEARCH.works):
        program = Program(loaded, Equations(loaded), model.strength, friction, friction)
        found = solve(program, enough=near, tolerances=FaceTolerances(1e-12), options=firm)
        carried += found.load_factor
        if (
            stands
            and end is not None
            and end - carried <= max(close, SEARCH.agrees) * model.size(carried)
        ):
            return end
        if end is None and (joined := _joined(model, found.motion)) is not None:
            return associative_end(joined)
        loaded = replace(model, dead=model.dead + carried * model.live)
    return end if stands else None


def _joined(model: FaceModel, mode: Array) -> FaceModel | None:
    """The model with those blocks as one whose faces close in a mode by next to nothing.

    Faces of two blocks that face each other, as of a slot, or lock by friction leave them no
    relative motion but 0, and that with no room for rounding. None where there are no such blocks.
    """
    from scipy.linalg import null_space
    from scipy.sparse import block_diag

    if model.block is None:
        return None
    unit, column = model.motion.nonzero()
    unit //= model.shape[1]
    pair = np.tile([[len(model.dead)], [-1]], len(model.strength))
    np.minimum.at(pair[0], unit, model.block[column])
    np.maximum.at(pair[1], unit, model.block[column])
    pairs, of_unit = np.unique(pair, axis=1, return_inverse=True)
    moved = np.abs(model.relative(mode)).max(axis=1)
    largest, least = np.zeros((2, len(pairs[0])))
    np.maximum.at(largest, of_unit, moved)
    np.minimum.at(least, of_unit, _least_opening(model, mode)[1].min(axis=1))
    joined = (least < 0.0) & (largest <= SEARCH.verified * moved.max()) & (pairs[1] >= 0)
    if not np.any(joined):
        return None
    part = connected(pairs[:, joined].T, int(model.block.max()) + 1)
    ends = part[np.clip(pair, 0, len(part) - 1)]
    closed = joined[of_unit] | (pair[0] < pair[1]) & (ends[0] == ends[1])
    kept = model.of_units(~closed)
    order = np.argsort(part[model.block], kind="stable")
    rows = model.motion[np.repeat(closed, model.shape[1])][:, order]
    first = np.repeat(ends[0, closed], model.shape[1])
    count = np.bincount(part[model.block])
    bases = []
    for k, end in enumerate(np.cumsum(count)):  # a row of zeros where nothing is closed
        held = np.pad(rows[first == k][:, end - count[k] : end].toarray(), ((1, 0), (0, 0)))
        bases.append(null_space(held, SEARCH.digits) if count[k] else np.zeros((0, 0)))
    motions = block_diag(bases, "csr")[np.argsort(order)]
    block = np.repeat(np.arange(len(bases)), [basis.shape[1] for basis in bases])
    loads = {name: motions.T @ getattr(model, name) for name in ("dead", "live")}
    alone = replace(kept, weights=None, motion=kept.motion @ motions, components=1, block=block)
    return replace(alone, **loads)


def proved_end(model: FaceModel, mode: Array) -> float | None:
    """What a mode proves with associative friction, rounded upwards; None if it proves nothing."""
    slip, opening = _least_opening(model, mode)
    limited = model.kappa > 0.0
    works = model.live * mode
    if np.any(opening[~limited] < 0.0):
        return None
    pressed = pressing_power(opening[limited], model.kappa[limited])
    most = 4.0 * np.abs(opening[limited]).sum(axis=1) / model.kappa[limited]  # of its terms
    shares = np.concatenate([model.strength * slip, pressed, -model.dead * mode])
    rounding = (len(shares) + 16) * EPS
    power = float(shares.sum() + rounding * np.abs(shares).sum() + 16.0 * EPS * most.sum())
    work = float(works.sum())
    error = rounding * float(np.abs(works).sum())
    if work <= 2.0 * error:
        return None
    return float(np.nextafter(power / (work - np.copysign(error, power)), np.inf))


def _least_opening(model: FaceModel, mode: Array) -> tuple[Array, Array]:
    """|v_T| at most and v_N - F |v_T| at least, of all units; ties may close: 0."""
    count = model.pressing
    moved = model.relative(mode)
    terms = int(np.diff(model.motion.indptr).max(initial=0)) + 2
    error = (terms * EPS) * (abs(model.motion) @ np.abs(mode)).reshape(moved.shape)
    slip = np.linalg.norm(np.abs(moved[:, count:]) + error[:, count:], axis=1) * (1.0 + 8.0 * EPS)
    lifted = (1.0 + 4.0 * EPS) * model.friction * slip
    opening = moved[:, :count] - error[:, :count] - lifted[:, None]
    opening -= 4.0 * EPS * np.abs(opening)
    opening[model.tensile] = 0.0
    return slip, opening


def motion_under(model: FaceModel, load_factor: float) -> Array | None:
    """Motion under lambda of the live load that no forces inside the cones resist; or None.

    All rounding is against it. The largest part of these loads with an equilibrium is looked for.
    """
    return _carried(model, load_factor)[1]


def proved_fall(model: FaceModel, load_factor: float) -> Array | None:
    """Motion under lambda of the live load; None if an equilibrium proves that it is carried.

    Raises:
        SolverError: If neither is found.
    """
    carried, motion = _carried(model, load_factor)
    if motion is None and not carried:
        raise SolverError("face forces: whether the loads stand is not known")
    return motion


def _carried(model: FaceModel, load_factor: float) -> tuple[bool, Array | None]:
    """Whether an equilibrium under loads was found; else their motion, None if none was found."""
    loads = model.dead + load_factor * model.live
    whole = replace(model, dead=np.zeros_like(loads), live=loads, dilatancy=model.friction)
    if not np.any(loads):
        return True, None

    def enough(iterate: FaceIterate) -> bool:
        return iterate.load_factor >= 1.0 and iterate.missing < 1e-9

    # Twice the loads at most: where nothing limits them equilibrium would come late.
    most = Row(np.zeros(model.shape[0]), -1.0, -2.0)
    laws = model.strength, model.friction, model.friction
    found = solve(Program(whole, Equations(whole), *laws, rows=(most,)), enough=enough)
    work = float(loads @ found.motion)
    if enough(found) or work <= 0.0:
        return enough(found), None
    motion = found.motion / work
    power = whole.power(motion)
    # What forces as large as the loads, or within rounding of equilibrium, may do in it.
    doubt = power.closing.sum() * np.abs(loads).sum()
    doubt += SEARCH.digits * model.force * np.abs(motion).sum()
    return False, motion if power.bound(model.strength) + doubt < 1.0 else None


def widest_motion(model: FaceModel, load_factor: float) -> Array | None:
    """Motion v in which loads that are not carried do most work, |v| <= 1; None if none was found.

    It is that of the least missing forces: every `shears` components of v get a brake, whose force
    |t| <= N costs N. What need not move for others to fall stays, but for rounding.
    """
    from scipy.sparse import csr_matrix, vstack

    loads = model.dead + load_factor * model.live
    component = np.arange(len(loads))
    brake, along = np.divmod(component, model.shears)
    count = int(brake[-1]) + 1
    width = model.shape[1]
    entries = np.ones(len(loads)), (brake * width + model.pressing + along, component)
    brakes = csr_matrix(entries, (count * width, len(loads)))
    braked = replace(
        model,
        motion=vstack([model.motion, brakes]).tocsr(),
        dead=loads,
        live=np.zeros_like(loads),
        compliance=np.vstack([model.compliance, *[np.median(model.compliance, axis=0)] * count]),
        kappa=np.append(model.kappa, np.zeros(count)),
    )
    friction = np.append(model.friction, np.ones(count))
    strength = np.append(model.strength, np.zeros(count))
    found = solve(Program(braked, Equations(braked), strength, friction, friction))
    small = SEARCH.small_factor
    near = found.within(small, missing_motion=small) and float(loads @ found.motion) > 0.0
    return found.motion if near else None


def state_under(model: FaceModel, load_factor: float) -> FaceIterate | None:
    """The state at a load factor; None if none was found.

    It is in equilibrium and within friction. Where its gap is not zero, some joints slip, or open,
    by a little more than their forces allow.
    """
    loads = model.dead + load_factor * model.live
    given = replace(model, dead=loads, live=np.zeros_like(loads))
    try:
        found = _state(given, Equations(given), 1.0) or _by_work(given)
    except SolverError:  # faces do not hold the blocks
        return None
    return None if found is None else replace(found, load_factor=load_factor)


def _by_work(model: FaceModel) -> FaceIterate | None:
    """The state under the dead load as a part of that in which this load does some work.

    Without given strengths all conditions are homogeneous. Where the load does that work with a
    factor of 0, blocks move as a mechanism, which says nothing.
    """
    if np.any(model.strength) or np.any(model.kappa) or not np.any(model.dead):
        return None
    alone = replace(model, dead=np.zeros_like(model.dead), live=model.dead)
    equations = Equations(alone)
    work = elastic_response(alone, equations).work
    found = _state(alone, equations, work)
    if found is None or found.load_factor < SEARCH.small_factor:
        return None
    part = found.load_factor
    return replace(found, motion=found.motion / part, force=found.force / part)


def _state(model: FaceModel, equations: Equations, work: float) -> FaceIterate | None:
    """The elastic state in which the live load, if there is one, does some work.

    Where products are too small for the digits of motions, the iterate before is the state.
    """
    near: list[FaceIterate] = []

    def kept(iterate: FaceIterate) -> bool:
        if iterate.within(SEARCH.rough_gap, SEARCH.digits, 10.0 * SEARCH.verified):
            near.append(iterate)
        return False

    laws = model.strength, model.friction, model.dilatancy
    kept(solve(Program(model, equations, *laws, work, elastic=True), enough=kept))
    return min(near, key=lambda iterate: iterate.gap) if near else None


def state_alone(model: FaceModel) -> FaceIterate | None:
    """The state under the live load alone; None if none was found.

    Far along the live load, the dead load, given strengths and faces with them are nothing beside
    it: all conditions are homogeneous, and every multiple of a state is one.
    """
    kept = model.of_units(model.kappa == 0.0)
    if not kept.shape[0]:
        return None
    nothing = {"dead": np.zeros_like(model.dead), "strength": np.zeros(len(kept.strength))}
    return state_under(replace(kept, **nothing), 1.0)


def stiffness_alone(model: FaceModel) -> float | None:
    """How stiff faces are against the live load alone, of any size; None without such a state.

    In units of the stiffness with all faces closed.
    """
    found = state_alone(model)
    if found is None:
        return None
    moved = float(model.live @ found.motion)
    return elastic_response(model, Equations(model)).work / moved if moved > 0.0 else None
