"""Limit programs of face forces by other solvers than the engine's own: HiGHS, Clarabel.

    max sign lambda,   H^T x + f_D + lambda f_L = 0,   n_i >= kappa N^2,   |t| <= g + D N

(`FaceModel`). HiGHS where all of it is linear; else Clarabel, with second-order cones: N^2 kappa <=
n is |(2 N sqrt(kappa), 1 - n)| <= 1 + n.
"""

from __future__ import annotations

from typing import Any

import clarabel
import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog
from scipy.sparse import csc_matrix, csr_matrix, diags, hstack, identity, kron, vstack

from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.model import FaceModel

Array = npt.NDArray[np.float64]


def own_limit(model: FaceModel, state: FaceState) -> float:
    """The largest load factor with the strengths of a state; the least one for the sign -1."""
    pressed = state.force[:, : model.pressing].sum(axis=1)
    own = model.strength + (model.friction - model.dilatancy) * np.maximum(pressed, 0.0)
    return limit(model, own, model.dilatancy, state.sign)


def limit(model: FaceModel, strength: Array, friction: Array, sign: float = 1.0) -> float:
    """The largest load factor with given g and D, the least one for the sign -1.

    Infinite, with that sign, where nothing limits it; nan where nothing has equilibrium.
    """
    unit = model.force / model.load
    equal = hstack([csr_matrix(model.live[:, None] / model.load), model.motion.T]).tocsc()
    right = -model.dead / model.force
    cost = np.zeros(equal.shape[1])
    cost[0] = -sign
    if model.shape[1] - model.pressing == 1 and not np.any(model.kappa):
        return unit * _by_highs(model, cost, equal, right, strength, friction)
    return unit * _by_clarabel(model, cost, equal, right, strength, friction)


def _by_highs(
    model: FaceModel, cost: Array, equal: Any, right: Array, strength: Array, friction: Array
) -> float:
    pressing, normal, shear = _parts(model)
    bound = diags(friction) @ normal
    rows = vstack([-pressing, shear - bound, -shear - bound])
    own = strength / model.force
    most = np.concatenate([np.zeros(pressing.shape[0]), own, own])
    found = linprog(cost, rows, most, equal, right, (None, None), "highs")
    assert found.status in (0, 2, 3), found.message
    ends = {2: np.nan, 3: -np.inf * cost[0]}
    return ends[found.status] if found.status in ends else float(found.x[0])


def _by_clarabel(
    model: FaceModel, cost: Array, equal: Any, right: Array, strength: Array, friction: Array
) -> float:
    """A x + s = b, s in a product of cones."""
    pressing, normal, shear = _parts(model)
    units, shears = model.shape[0], model.shape[1] - model.pressing
    blocks = [(equal, right, [clarabel.ZeroConeT(len(right))])]
    blocks.append(
        (-pressing, np.zeros(pressing.shape[0]), [clarabel.NonnegativeConeT(pressing.shape[0])])
    )
    disc = _interleaved([-diags(friction) @ normal, *(-shear[k::shears] for k in range(shears))])
    bound = np.zeros((units, 1 + shears))
    bound[:, 0] = strength / model.force
    blocks.append((disc, bound.ravel(), [clarabel.SecondOrderConeT(1 + shears)] * units))
    crushes = np.flatnonzero(model.kappa)
    root = diags(2.0 * np.sqrt(model.kappa[crushes] * model.force))
    for end in range(model.pressing):
        own = pressing[end :: model.pressing][crushes]
        rows = _interleaved([-own, own, -root @ normal[crushes]])
        cones = [clarabel.SecondOrderConeT(3)] * len(crushes)
        blocks.append((rows, np.tile([1.0, 1.0, 0.0], len(crushes)), cones))
    matrix = csc_matrix(vstack([rows for rows, _, _ in blocks]))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    for name in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
        setattr(settings, name, 1e-10)
    found = clarabel.DefaultSolver(
        csc_matrix((len(cost), len(cost))),
        cost,
        matrix,
        np.concatenate([most for _, most, _ in blocks]),
        [cone for _, _, cones in blocks for cone in cones],
        settings,
    ).solve()
    status = str(found.status)
    ends = {"PrimalInfeasible": np.nan, "DualInfeasible": -np.inf * cost[0]}
    assert status in ("Solved", "AlmostSolved", *ends), status
    return ends[status] if status in ends else float(found.x[0])


def _parts(model: FaceModel) -> tuple[Any, Any, Any]:
    """Pressing forces, N of the units and shear forces as rows of the unknowns (lambda, x)."""
    units, size = model.shape
    every = identity(units * size, format="csr")
    component = np.arange(units * size) % size
    summed = kron(identity(units), np.ones((1, model.pressing)), format="csr")
    pressing = every[component < model.pressing]
    parts = pressing, summed @ pressing, every[component >= model.pressing]
    first = [csr_matrix((part.shape[0], 1)) for part in parts]
    none, normal, shear = (hstack(pair).tocsr() for pair in zip(first, parts, strict=True))
    return none, normal, shear


def _interleaved(parts: list[Any]) -> Any:
    """First rows of all parts, then their second rows and so on."""
    count = parts[0].shape[0]
    order = np.arange(len(parts) * count).reshape(len(parts), count).T.ravel()
    return vstack(parts).tocsr()[order]


def misses(model: FaceModel, state: FaceState) -> dict[str, float]:
    """By how much a state and its mode miss what they promise; forces over the largest load."""
    count = model.pressing
    pressed, shear = state.force[:, :count], state.force[:, count:]
    normal = pressed.sum(axis=1)
    largest = max(model.force, abs(state.load_factor) * model.load)
    loads = model.dead + state.load_factor * model.live
    relative = (model.motion @ state.mode).reshape(model.shape)
    slip = np.linalg.norm(relative[:, count:], axis=1)
    closed = (model.dilatancy * slip)[:, None] - relative[:, :count]
    closed = closed[(model.kappa == 0.0) & ~model.tensile]
    beyond = np.linalg.norm(shear, axis=1) - model.strength - model.friction * normal
    crushed = (model.kappa * normal**2)[:, None] - pressed
    return {
        "equilibrium": float(np.abs(model.motion.T @ state.force.ravel() + loads).max()) / largest,
        "friction": float(beyond.max()) / largest,
        "pressing": float(crushed.max()) / largest,
        "work": abs(float(model.live @ state.mode) - state.sign),
        "closing": float(closed.max(initial=0.0)) / float(np.abs(relative).max()),
    }
