"""One interior point method for all programs on face forces.

    min  1/2 x . C x + w . N - W lambda
    H^T x + f_D + lambda f_L = 0,          multiplier: motions d
    n_i - kappa N^2 >= 0,                  multiplier: y
    (b + f_u N, t) in the friction cone,   multiplier: z
    r . N + rho lambda >= r_0              for a few rows r, multiplier: p

Stationarity is asked with f_s in place of f_u, so that friction need not be associated:

    H d + e + C x + w a - G_s(x)^T (y, z) - (r . p) a = 0,     f_L . d = W + rho . p,

G_s the derivatives of slacks with f_s, a = dN/dx, and e the springs' offset. The elastic state
with Coulomb's law under the work W has f_u = F, f_s = D; programs have f_u = f_s, and no e.
Newton's step, with the springs M = C + G_s^T W^-2 G_u of each unit, is

    A dd = ... ,   A = H^T M^-1 H,

bordered by lambda and the rows; A + S, and S d in equilibrium, where motions strain the blocks.
Predictor and corrector by S. Mehrotra, SIAM J. Optim. 2 (1992) 575, the weight of the corrector by
M. Colombo, J. Gondzio, Comput. Optim. Appl. 41 (2008) 277, further correctors by J. Gondzio,
Comput. Optim. Appl. 6 (1996) 137.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.faces.cones import Array, Positive, times, transposed_times
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.system import Equations, Springs
from fenics_contact.search_options import SEARCH, SearchOptions

#: By cones.
Arrays = tuple[Array, ...]


@dataclass(frozen=True)
class Row:
    """r . N + rho lambda >= r_0."""

    pressing: Array
    factor: float
    least: float


@dataclass(frozen=True)
class FaceTolerances:
    """What ends the method: relative gap, equilibrium, and motions."""

    gap: float = field(default_factory=lambda: SEARCH.face_gap)
    equilibrium: float = field(default_factory=lambda: SEARCH.digits)
    motion: float = field(default_factory=lambda: SEARCH.verified)


@dataclass(frozen=True)
class Program:
    """A program on the face forces of a model; see above.

    Attributes:
        model: The units of contact.
        equations: Of the model.
        strength: b, shape (units,).
        friction: f_u.
        dilatancy: f_s.
        work: W; its sign is that of the load factor that is sought.
        cost: w; None for 0.
        elastic: Whether C is the compliance of the model, or 0.
        rows: Few.
    """

    model: FaceModel
    equations: Equations
    strength: Array
    friction: Array
    dilatancy: Array
    work: float = 1.0
    cost: Array | None = None
    elastic: bool = False
    rows: tuple[Row, ...] = ()


@dataclass(frozen=True)
class FacePoint:
    """Unknowns of a program, or a change of them to first order.

    Attributes:
        motion: d.
        load_factor: lambda.
        force: x, shape (units, m).
        duals: (y, z) by cones, then p.
        slacks: Likewise; those of the rows last.
    """

    motion: Array
    load_factor: float
    force: Array
    duals: Arrays
    slacks: Arrays

    def plus(self, other: FacePoint, weight: float = 1.0) -> FacePoint:
        """The sum with a multiple of another one."""
        return FacePoint(
            self.motion + weight * other.motion,
            self.load_factor + weight * other.load_factor,
            self.force + weight * other.force,
            tuple(a + weight * b for a, b in zip(self.duals, other.duals, strict=True)),
            tuple(a + weight * b for a, b in zip(self.slacks, other.slacks, strict=True)),
        )


@dataclass(frozen=True)
class FaceIterate(FacePoint):
    """A point, and how near it is to the solution.

    Attributes:
        mu: Mean product of slacks and multipliers.
        gap: Sum of the products over |lambda W|.
        missing: Of equilibrium, over the largest force.
        missing_motion: Of stationarity, over the typical displacement.
        solved: Whether it is within the tolerances, or was stopped as good enough.
    """

    mu: float = np.inf
    gap: float = np.inf
    missing: float = np.inf
    missing_motion: float = np.inf
    solved: bool = False

    def within(self, gap: float, missing: float = 1e-7, missing_motion: float = 1e-4) -> bool:
        """Whether it is as near as that."""
        near = self.gap < gap and self.missing < missing
        return near and self.missing_motion < missing_motion


#: Whether an iterate is good enough.
Enough = Callable[[FaceIterate], bool]


def solve(
    program: Program,
    start: FaceIterate | None = None,
    tolerances: FaceTolerances | None = None,
    mu: float | None = None,
    enough: Enough = lambda iterate: False,
    options: SearchOptions = SEARCH,
) -> FaceIterate:
    """The best iterate that steps from a start lead to.

    Args:
        program: What to solve.
        start: Where from; by default a point far from all boundaries.
        tolerances: What ends the steps; those of `SearchOptions` by default.
        mu: Least product at a given start.
        enough: Ends the steps, too.
        options: Numbers of the method.
    """
    tolerances = tolerances or FaceTolerances()
    if program.model.has_many_blocks:
        options = _patient(options)
    with np.errstate(all="ignore"):  # what is not finite ends the steps
        method = Method(program, options)
        point = method.cold(mu) if start is None else method.inside(start, mu)
        best: FaceIterate | None = None
        least = np.inf
        best_step = 0
        short = 0
        for step in range(options.interior_steps + 1):
            here = Newton(method, point)
            iterate = here.iterate
            score = max(
                iterate.gap / tolerances.gap,
                iterate.missing / tolerances.equilibrium,
                iterate.missing_motion / tolerances.motion,
            )
            if best is None or score < least:
                best = iterate
                least = score
                best_step = step
            if score < 1.0 or enough(iterate):
                return replace(iterate, solved=True)
            if step == options.interior_steps or step > best_step + options.face_stale:
                break
            try:
                point, length = here.advanced()
            except SolverError:
                break
            short = short + 1 if length < options.face_short else 0
            if length < 1e-7 or short >= options.no_progress:
                break
        return best or iterate


def _patient(options: SearchOptions) -> SearchOptions:
    """Options for many blocks: products are smaller, forces range wider, single steps are short."""
    patience = options.many_patience
    return replace(
        options,
        regularization=min(options.regularization, options.digits),
        interior_steps=patience * options.interior_steps,
        face_stale=patience * options.face_stale,
        no_progress=patience * options.no_progress,
        face_short=options.face_short / patience,
    )


class Method:
    """Sizes of one program, and where to start."""

    def __init__(self, program: Program, options: SearchOptions) -> None:
        model = program.model
        self.program = program
        self.model = model
        self.options = options
        self.given = not np.any(model.live)  # the load factor is none of the unknowns
        self.displacement = abs(program.work) / model.load
        self.work_size = abs(program.work)
        if self.given:
            self.displacement = model.force * float(np.median(model.compliance))
            self.work_size = model.force * self.displacement
        self.strength = np.maximum(program.strength, 1e-9 * model.unit_sizes[:, 0])
        count = model.shape[0]
        cost = np.zeros(count) if program.cost is None else program.cost
        self.cost = cost + np.where(model.tensile, self.displacement, 0.0)
        self.pressing = np.zeros(model.shape[1])
        self.pressing[: model.pressing] = 1.0
        self.rows = np.array([row.pressing for row in program.rows]).reshape(-1, count)
        self.factors = np.array([row.factor for row in program.rows])
        self.least = np.array([row.least for row in program.rows])
        self.compliance = model.compliance if program.elastic else np.zeros(model.shape)
        self.offset: Any = 0.0 if model.offset is None or not program.elastic else model.offset
        self.symmetric = np.array_equal(program.friction, program.dilatancy)
        self.curved = bool(np.any(model.kappa))
        self.direct = len(model.cones) > 1 and not self.curved  # pressing forces are slacks
        self.cones = (*model.cones, Positive())
        self.springs: Springs | None = None

    def slacks(self, force: Array) -> Arrays:
        """Slacks of the forces by cones."""
        return self.model.slacks(force, self.strength, self.program.friction)

    def row_values(self, force: Array, load_factor: float) -> Array:
        """Values r . N + rho lambda - r_0 of the rows."""
        normal = self.model.normal(force)
        return np.asarray(self.rows @ normal + self.factors * load_factor - self.least)

    def cold(self, mu: float | None) -> FacePoint:
        """A point far from all boundaries: pressed by the dead load and a typical force."""
        model = self.model
        shift = self.displacement * (model.force / model.unit_sizes)  # products are alike
        response = elastic_response(model, self.program.equations)
        force = np.zeros(model.shape)
        pressed = np.maximum(response.dead_force[:, : model.pressing], 0.0) + 0.3 * model.unit_sizes
        beyond = model.kappa * pressed.sum(axis=1) > 0.1
        safe = np.where(beyond, model.kappa, 1.0)
        pressed = np.where(beyond[:, None], (0.05 / safe)[:, None], pressed)
        force[:, : model.pressing] = pressed
        motion = np.zeros(len(model.live))
        if self.program.elastic and not self.given:
            motion = response.live * (self.program.work / response.work)
        slacks = self.slacks(force)
        duals = tuple(
            shift * cone.identity(slack) for cone, slack in zip(model.cones, slacks, strict=True)
        )
        return self._with_rows(FacePoint(motion, 0.0, force, duals, slacks), 1.0, mu)

    def inside(self, start: FacePoint, mu: float | None) -> FacePoint:
        """A start moved away from boundaries, with products of mu at least; rows begin anew."""
        model = self.model
        cones = model.cones
        count = model.pressing
        start = replace(start, duals=start.duals[: len(cones)], slacks=())
        start = self._with_rows(start, 0.1, mu)
        force = start.force.copy()
        duals = start.duals[:-1]
        margin = min(
            float(cone.margin(slack).min(initial=np.inf))
            for cone, slack in zip(cones, self.slacks(force), strict=True)
        )
        if margin > 0.0 and mu is None:
            return start
        least = (model.kappa * model.normal(force) ** 2)[:, None]
        size = model.unit_sizes
        low = force[:, :count] - least <= 1e-6 * size
        force[:, :count] = np.where(low, least + 1e-3 * size, force[:, :count])
        bound = self.strength + self.program.friction * model.normal(force)
        most = np.minimum(np.maximum(0.95 * bound, bound - 0.02 * size[:, 0]), 0.999 * bound)
        size = np.linalg.norm(force[:, count:], axis=1)
        force[:, count:] *= np.minimum(1.0, most / np.maximum(size, 1e-300))[:, None]
        if mu is not None:
            raised = zip(cones, self.slacks(force), duals, strict=True)
            duals = tuple(cone.raised(slack, dual, mu) for cone, slack, dual in raised)
        return replace(start, force=force, duals=(*duals, start.duals[-1]))

    def _with_rows(self, start: FacePoint, part: float, mu: float | None) -> FacePoint:
        """A start with slacks of the rows, at least a part of their terms' sizes."""
        model = self.model
        size = np.abs(self.factors) + np.abs(self.rows).max(axis=1, initial=0.0) * model.force
        slack = np.maximum(self.row_values(start.force, start.load_factor), part * size)
        product = self.displacement * model.force if mu is None else mu
        dual = product / np.maximum(slack, 1e-300)
        return replace(start, slacks=(*start.slacks, slack), duals=(*start.duals, dual))


class Newton:
    """A program at a point: slacks, residuals, Newton's matrix, and the step.

    Attributes:
        iterate: The point with its residuals.
    """

    def __init__(self, method: Method, point: FacePoint, slacks: Arrays | None = None) -> None:
        model = method.model
        program = method.program
        self.method = method
        self.slacks = slacks or (*method.slacks(point.force), point.slacks[-1])
        self.gradients = model.derivatives(point.force, program.dilatancy)  # G_s
        pairs = zip(self.slacks, point.duals, strict=True)
        products = sum(float(np.vdot(slack, dual)) for slack, dual in pairs)
        self.degree = sum(
            cone.degree(slack) for cone, slack in zip(method.cones, self.slacks, strict=True)
        )
        self.equilibrium = model.missing(point.force, point.load_factor)
        if model.stiffness is not None:
            self.equilibrium -= model.stiffness @ point.motion
        # H d + e + C x + w a - G_s^T (y, z) - (r . p) a
        stationary = model.relative(point.motion) + method.offset
        stationary += method.compliance * point.force
        for gradient, dual in zip(self.gradients, point.duals, strict=False):
            stationary -= transposed_times(gradient, dual)
        row_duals = point.duals[-1]
        pressed = method.cost - method.rows.T @ row_duals
        self.stationary = stationary + pressed[:, None] * method.pressing
        self.row_missing = method.row_values(point.force, point.load_factor) - point.slacks[-1]
        self.work = 0.0
        work = method.work_size
        size = work
        if not method.given:
            self.work = program.work + float(method.factors @ row_duals - model.live @ point.motion)
            size = work * max(abs(point.load_factor), 1e-3 * model.force / model.load)
        scale = max(1.0, float(np.abs(method.least).max(initial=0.0)))
        motions = (
            np.abs(self.stationary).max(initial=0.0) / method.displacement,
            abs(self.work) / work,
            10.0 * np.abs(self.row_missing).max(initial=0.0) / scale,
        )
        self.iterate = FaceIterate(
            point.motion,
            point.load_factor,
            point.force,
            point.duals,
            self.slacks,
            mu=products / self.degree,
            gap=products / size,
            missing=float((np.abs(self.equilibrium) / model.sizes).max(initial=0.0))
            / max(1.0, abs(point.load_factor) * model.load / model.force),
            missing_motion=float(max(motions)),
        )

    def advanced(self) -> tuple[FacePoint, float]:
        """The point after one step, and the step's length.

        Raises:
            SolverError: If Newton's matrix cannot be factored.
        """
        self.factor()
        iterate = self.iterate
        mu = iterate.mu
        curved = self.method.curved
        predictor = self.direction([-one.products for one in self.scaled], 1.0)
        length = self._length(predictor, 1.0)
        moved = iterate.plus(predictor, length)
        pairs = zip(moved.slacks, moved.duals, strict=True)
        after = sum(float(np.vdot(slack, dual)) for slack, dual in pairs) / self.degree
        centring = float(np.clip((abs(after) / mu) ** 3, 1e-5, 0.9))
        if iterate.missing > 1e-2 or iterate.missing_motion > 1e-2:
            centring = max(centring, 0.1)
        target = centring * mu
        corrector = self.direction(self._second_order(predictor, target), 0.0)
        step = predictor.plus(corrector)
        if not curved:
            step = self._pushed(self._weighted(predictor, corrector, length), target)
        length = self._length(step, self.method.options.step_fraction)
        if length < 0.1:
            equal = zip(self.method.cones, self.scaled, strict=True)
            goal = 0.7 * mu
            centred = [goal * cone.identity(one.products) - one.products for cone, one in equal]
            again = self.direction(centred, 1.0)
            longer = self._length(again, 0.98)
            if longer > length:
                return iterate.plus(again, longer), longer
        return iterate.plus(step, length), length

    def factor(self) -> None:
        """Newton's matrix A = H^T M^-1 H, factored, and its border of lambda and the rows."""
        method = self.method
        model = method.model
        point = self.iterate
        cones = zip(method.cones, self.slacks, point.duals, strict=True)
        self.scaled = [cone.scaled(slack, dual) for cone, slack, dual in cones]
        self.right = self.gradients  # G_u
        if not method.symmetric:
            self.right = model.derivatives(point.force, method.program.friction)
        near = min(1.0, max(point.gap, 1e-3))
        shift = method.options.regularization * method.displacement / model.force * near
        weights = [one.weights for one in self.scaled[:-1]] + [method.compliance + shift]
        if method.direct:  # squares of the same vectors are one
            weights[-1] = weights[-1] + np.pad(weights.pop(0), ((0, 0), (0, model.shears)))
        if method.curved:
            weights.append(model.curvature(point.duals)[:, None])
        self.inverse = self._springs().inverse(np.hstack(weights))
        self.solver = method.program.equations.factored(
            self.inverse, 0.0 if method.symmetric else 1e-3
        )
        columns = [times(self.inverse, row[:, None] * method.pressing) for row in method.rows]
        borders = [model.live, *(model.transposed @ column.ravel() for column in columns)]
        self.border = self.solver(np.column_stack(borders))
        self.changed = [-times(self.inverse, model.relative(one)) for one in self.border.T]
        for row, column in enumerate(columns):
            self.changed[1 + row] += column
        duals = point.duals[-1]
        matrix = np.zeros((1 + len(duals), 1 + len(duals)))
        matrix[0] = model.live @ self.border
        matrix[0, 1:] -= method.factors
        if method.given:
            matrix[0, 0] = 1.0
        if len(duals):
            normals = np.column_stack([model.normal(one) for one in self.changed])
            matrix[1:] = duals[:, None] * (method.rows @ normals)
            matrix[1:, 0] += duals * method.factors
            matrix[1:, 1:] += np.diag(self.slacks[-1])
        self.matrix = matrix

    def _springs(self) -> Springs:
        """Springs of the vectors; they stay where neither cones nor strengths turn them."""
        method = self.method
        fixed = not method.curved and all(one.frame is None for one in self.scaled)
        if method.springs is None or not fixed:
            units, size = method.model.shape
            last = [np.broadcast_to(np.eye(size), (units, size, size))]
            if method.curved:
                last.append(np.broadcast_to(method.pressing, (units, 1, size)))

            def framed(gradients: Arrays) -> Array:
                """Vectors of the squares of W^-2, in terms of the forces."""
                vectors = [
                    g if one.frame is None else np.matmul(one.frame, g)
                    for one, g in zip(self.scaled, gradients, strict=False)
                ]
                return np.concatenate([*vectors[int(method.direct) :], *last], axis=1)

            left = framed(self.gradients)
            method.springs = Springs(left, left if method.symmetric else framed(self.right))
        return method.springs

    def correction(self) -> FacePoint:
        """The step that takes away residuals, at the load factor and the products of the point."""
        nothing = [np.zeros_like(slack) for slack in self.slacks[:-1]]
        motion, force, shifts = self._held(nothing, 1.0)
        return self._step(motion, 0.0, force, shifts)

    def tangent(self) -> FacePoint:
        """The change of the point with its load factor."""
        nothing = [np.zeros_like(slack) for slack in self.slacks[:-1]]
        return self._step(self.border[:, 0], 1.0, self.changed[0], nothing)

    def _step(
        self, motion: Array, load_factor: float, force: Array, shifts: list[Array]
    ) -> FacePoint:
        """A change of the forces with those of slacks and multipliers; without rows."""
        slacks = [times(gradient, force) for gradient in self.right]
        triples = zip(shifts, self.scaled[:-1], slacks, strict=True)
        duals = [shift - one.stretch(ds) for shift, one, ds in triples]
        none = np.zeros(0)
        return FacePoint(motion, load_factor, force, (*duals, none), (*slacks, none))

    def _held(self, changes: Sequence[Array], residuals: float) -> tuple[Array, Array, list[Array]]:
        """Motions and forces of a direction at a given load factor; shifts of the multipliers."""
        method = self.method
        model = method.model
        pairs = zip(self.scaled[:-1], changes, strict=False)
        shifts = [one.shift(change) for one, change in pairs]
        wanted = -residuals * self.stationary
        for gradient, shift in zip(self.gradients, shifts, strict=True):
            wanted += transposed_times(gradient, shift)
        right = residuals * self.equilibrium
        right = right + model.transposed @ times(self.inverse, wanted).ravel()
        motion = self.solver(right)
        return motion, times(self.inverse, wanted - model.relative(motion)), shifts

    def direction(self, changes: Sequence[Array], residuals: float) -> FacePoint:
        """The direction that changes the products, and takes away a part of the residuals."""
        method = self.method
        model = method.model
        motion, force, shifts = self._held(changes, residuals)
        missing = np.empty(1 + len(method.rows))
        missing[0] = residuals * self.work - model.live @ motion
        normal = method.rows @ model.normal(force) + residuals * self.row_missing
        missing[1:] = changes[-1] - self.iterate.duals[-1] * normal
        try:
            border = np.linalg.solve(self.matrix, missing)
        except np.linalg.LinAlgError as error:
            raise SolverError(f"face forces: {error}") from None
        for part, change in zip(border, self.changed, strict=True):
            force += part * change
        slacks = [times(gradient, force) for gradient in self.right]
        triples = zip(shifts, self.scaled[:-1], slacks, strict=True)
        duals = [shift - one.stretch(ds) for shift, one, ds in triples]
        rows = method.rows @ model.normal(force) + method.factors * border[0]
        rows = rows + residuals * self.row_missing
        motion = motion + self.border @ border
        return FacePoint(motion, float(border[0]), force, (*duals, border[1:]), (*slacks, rows))

    def _second_order(self, step: FacePoint, target: float) -> list[Array]:
        """Changes of the products that the corrector aims at."""
        most = 5.0 * self.iterate.mu if self.method.curved else np.inf
        parts = zip(self.method.cones, self.scaled, step.slacks, step.duals, strict=True)
        return [
            target * cone.identity(ds) - np.maximum(np.minimum(one.cross(ds, dz), most), -most)
            for cone, one, ds, dz in parts
        ]

    def _weighted(self, predictor: FacePoint, corrector: FacePoint, length: float) -> FacePoint:
        """Predictor and corrector with the weight that allows the longest step."""
        best = predictor.plus(corrector)
        longest = self._straight(best)
        for weight in np.linspace(1.0, length**2, 5).tolist()[1:] if longest < 0.9 else ():
            step = predictor.plus(corrector, weight)
            found = self._straight(step)
            if found > longest:
                best = step
                longest = found
        return best

    def _pushed(self, step: FacePoint, target: float) -> FacePoint:
        """A step with outlying products pushed back, as long as that makes it longer."""
        decade = self.method.options.decade
        length = self._straight(step)
        for _ in range(self.method.options.pushes if length < 0.9 else 0):
            tried = min(1.0, 1.3 * min(length, 1.0) + 0.1)
            aim = max(target, 0.3 * self.iterate.mu * (1.0 - tried))
            changes = []
            parts = zip(self.method.cones, self.scaled, step.slacks, step.duals, strict=True)
            for cone, one, ds, dz in parts:  # (l + a W^-1 ds) o (l + a W dz)
                after = one.products + tried * one.linear(ds, dz) + tried**2 * one.cross(ds, dz)
                changes.append(cone.pushed(after, aim * decade, aim / decade))
            more = step.plus(self.direction(changes, 0.0))
            longer = self._straight(more)
            if longer < 1.02 * length:
                break
            step = more
            length = longer
        return step

    def _straight(self, step: FacePoint, first: int = 0) -> float:
        """The longest step to first order; of the slacks, from a cone on."""
        cones = self.method.cones
        duals = zip(cones, self.iterate.duals, step.duals, strict=True)
        slacks = zip(cones[first:], self.slacks[first:], step.slacks[first:], strict=True)
        return min(cone.longest(place, change) for cone, place, change in (*duals, *slacks))

    def _length(self, step: FacePoint, part: float) -> float:
        """The length of a step that stays inside all boundaries, by a part of the way to them."""
        method = self.method
        if not method.curved:
            return min(1.0, part * self._straight(step))
        cones = method.model.cones
        length = min(1.0 / part, self._straight(step, len(cones)))
        for _ in range(40):
            slacks = method.slacks(self.iterate.force + length * step.force)
            places = list(zip(cones, slacks, self.slacks, strict=False))
            left = min(
                float(np.min(cone.margin(new) / cone.margin(old), initial=1.0))
                for cone, new, old in places
            )
            if left > 0.3 * (1.0 - part):
                break
            if left > 0.0:
                length *= part
                break
            secant = min(cone.longest(old, (new - old) / length) for cone, new, old in places)
            length = min(0.9999 * length, 0.99999 * secant)
        return min(1.0, part * length)


@dataclass(frozen=True)
class Response:
    """Of blocks on their faces' springs, all closed and stuck.

    Attributes:
        live: Motions by the live load of factor 1.
        work: f_L . d of these.
        dead_force: Face forces by the dead load, shape (units, m).
        dead_work: f_D . d by that load.
    """

    live: Array
    work: float
    dead_force: Array
    dead_work: float


def elastic_response(model: FaceModel, equations: Equations) -> Response:
    """The response of a model, solved for once.

    Raises:
        SolverError: If the faces do not hold the blocks.
    """
    if equations.response is None:
        size = model.shape[1]
        inverse = np.zeros((*model.shape, size))
        inverse[:, np.arange(size), np.arange(size)] = 1.0 / model.compliance
        solver = equations.factored(inverse, 0.0)
        with np.errstate(all="ignore"):  # blocks that faces do not hold move without end
            live = solver(model.live)
            dead = solver(model.dead)
            force = -model.relative(dead) / model.compliance
            work = float(np.sum(model.compliance * force**2))
            if model.stiffness is not None:
                work += float(dead @ (model.stiffness @ dead))
            equations.response = Response(live, float(model.live @ live), force, work)
    return equations.response
