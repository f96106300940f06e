"""One interior point method for all programs on face forces.

    min  1/2 x . C x + w . N - W lambda
    H^T x + f_D + lambda f_L = 0,          multiplier: motions d
    n_i - kappa N^2 >= 0,                  multiplier: y
    (b + f_u N, t) in the friction cone,   multiplier: z
    r . N + rho lambda >= r_0              for a few rows r, multiplier: p

Stationarity is asked with f_s in place of f_u, so that friction need not be associated:

    H d + C x + w a - G_s(x)^T (y, z) - (r . p) a = 0,     f_L . d = W + rho . p,

G_s the derivatives of slacks with f_s, and a = dN/dx. The elastic state with Coulomb's law under
the work W has f_u = F, f_s = D; programs have f_u = f_s. Newton's step, with the springs M = C +
G_s^T W^-2 G_u of each unit, is

    A dd = ... ,   A = H^T M^-1 H,

bordered by lambda and the rows. Predictor and corrector by S. Mehrotra, SIAM J. Optim. 2 (1992)
575, the weight of the corrector by M. Colombo, J. Gondzio, Comput. Optim. Appl. 41 (2008) 277,
further correctors by J. Gondzio, Comput. Optim. Appl. 6 (1996) 137.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from fenics_contact.errors import SolverError
from fenics_contact.faces.cones import Array, Scaled
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.springs import Springs
from fenics_contact.faces.system import Equations


@dataclass(frozen=True)
class KernelOptions:
    """Numbers of the interior point method.

    Attributes:
        steps: At most.
        short: A step below this is short.
        patience: Short steps in a row that end it.
        stale: Steps without a better iterate that end it.
        back: Of the way to the boundary that a step takes.
        proximal: Added to M, in units of displacement over force, times the relative gap.
        pushes: Further correctors at most.
        band: Of products, in units of those aimed at, into which they push.
    """

    steps: int = 60
    short: float = 0.2
    patience: int = 6
    stale: int = 12
    back: float = 0.995
    proximal: float = 1e-7
    pushes: int = 2
    band: tuple[float, float] = (0.1, 10.0)


OPTIONS = KernelOptions()


@dataclass(frozen=True)
class Row:
    """r . N + rho lambda >= r_0."""

    pressing: Array
    factor: float
    least: float


@dataclass(frozen=True)
class Tolerances:
    """What ends the method: relative gap, equilibrium, and motions."""

    gap: float = 1e-7
    equilibrium: float = 1e-9
    motion: float = 1e-6


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
class Iterate:
    """Unknowns of a program, and how near they are to its solution.

    Attributes:
        motion: d.
        load_factor: lambda.
        force: x, shape (units, m).
        duals: (y, z) by cones.
        row_duals: p, shape (rows,).
        row_slacks: Of the rows.
        mu: Mean product of slacks and multipliers.
        gap: Sum of the products over |lambda W|.
        missing: Of equilibrium, over the largest force.
        missing_motion: Of stationarity, over the typical displacement.
        solved: Whether it is within the tolerances, or was stopped as good enough.
        early: The first iterate with a gap below the one asked for.
    """

    motion: Array
    load_factor: float
    force: Array
    duals: tuple[Array, ...]
    row_duals: Array = field(default_factory=lambda: np.zeros(0))
    row_slacks: Array = field(default_factory=lambda: np.zeros(0))
    mu: float = np.inf
    gap: float = np.inf
    missing: float = np.inf
    missing_motion: float = np.inf
    solved: bool = False
    early: Iterate | None = None

    def within(self, gap: float, missing: float = 1e-7, missing_motion: float = 1e-4) -> bool:
        """Whether it is as near as that."""
        near = self.gap < gap and self.missing < missing
        return near and self.missing_motion < missing_motion


#: What ends a program unless something else is asked for.
EXACT = Tolerances()

#: Whether an iterate is good enough.
Enough = Callable[[Iterate], bool]


def _never(iterate: Iterate) -> bool:
    return False


def solve(
    program: Program,
    start: Iterate | None = None,
    tolerances: Tolerances = EXACT,
    mu: float | None = None,
    keep: float = 0.0,
    enough: Enough = _never,
    options: KernelOptions = OPTIONS,
) -> Iterate:
    """The best iterate that steps from a start lead to.

    Args:
        program: What to solve.
        start: Where from; by default a point far from all boundaries.
        tolerances: What ends the steps.
        mu: Least product at a given start.
        keep: Gap of the iterate to be kept as `early`.
        enough: Ends the steps, too.
        options: Numbers of the method.
    """
    with np.errstate(all="ignore"):  # what is not finite ends the steps
        return _solve(_Method(program, options), start, tolerances, mu, keep, enough)


def _solve(
    method: _Method,
    start: Iterate | None,
    tolerances: Tolerances,
    mu: float | None,
    keep: float,
    enough: Enough,
) -> Iterate:
    """See `solve`."""
    options = method.options
    iterate = method.cold(mu) if start is None else method.inside(start, mu)
    best = _Best(tolerances)
    early: Iterate | None = None
    short = 0
    for step in range(options.steps + 1):
        iterate = method.measured(iterate)
        if early is None and step and iterate.gap < keep:
            early = iterate
        if best.take(iterate, step) or enough(iterate):
            return replace(iterate, solved=True, early=early)
        if step == options.steps or step > best.step + options.stale:
            break
        try:
            iterate, length = method.advanced(iterate)
        except SolverError:
            break
        short = short + 1 if length < options.short else 0
        if length < 1e-7 or short >= options.patience:
            break
    return replace(best.iterate or iterate, early=early)


class _Best:
    """The best iterate so far."""

    def __init__(self, tolerances: Tolerances) -> None:
        self._tolerances = tolerances
        self.iterate: Iterate | None = None
        self.step = 0
        self._score = np.inf

    def take(self, iterate: Iterate, step: int) -> bool:
        """Take one if it is the best; whether it is within the tolerances."""
        asked = self._tolerances
        score = max(
            iterate.gap / asked.gap,
            iterate.missing / asked.equilibrium,
            iterate.missing_motion / asked.motion,
        )
        if self.iterate is None or score < self._score:
            self.iterate = iterate
            self.step = step
            self._score = score
        return bool(score < 1.0)


@dataclass(frozen=True)
class _Step:
    """A direction, and how slacks change along it to first order."""

    motion: Array
    load_factor: float
    force: Array
    duals: tuple[Array, ...]
    row_duals: Array
    row_slacks: Array
    slacks: tuple[Array, ...]

    def plus(self, other: _Step, weight: float = 1.0) -> _Step:
        """The sum with a multiple of another one."""
        return _Step(
            self.motion + weight * other.motion,
            self.load_factor + weight * other.load_factor,
            self.force + weight * other.force,
            tuple(a + weight * b for a, b in zip(self.duals, other.duals, strict=True)),
            self.row_duals + weight * other.row_duals,
            self.row_slacks + weight * other.row_slacks,
            tuple(a + weight * b for a, b in zip(self.slacks, other.slacks, strict=True)),
        )


class _Method:
    """Starts, residuals and steps of one program."""

    def __init__(self, program: Program, options: KernelOptions) -> None:
        model = program.model
        self._program = program
        self._model = model
        self.options = options
        self._given = not np.any(model.live)
        self._displacement = abs(program.work) / model.load
        self._work_size = abs(program.work)
        if self._given:  # the load factor is none of the unknowns
            self._displacement = model.force * float(np.median(model.compliance))
            self._work_size = model.force * self._displacement
        self._strength = np.maximum(program.strength, 1e-9 * model.force)
        count = model.shape[0]
        self._cost = np.zeros(count) if program.cost is None else program.cost
        self._cost = self._cost + np.where(model.tensile, self._displacement, 0.0)
        self._pressing = np.zeros(model.shape[1])
        self._pressing[: model.pressing] = 1.0
        self._rows = np.array([row.pressing for row in program.rows]).reshape(-1, count)
        self._factors = np.array([row.factor for row in program.rows])
        self._least = np.array([row.least for row in program.rows])
        self._compliance = model.compliance if program.elastic else np.zeros(model.shape)
        self._symmetric = np.array_equal(program.friction, program.dilatancy)
        self._curved = bool(np.any(model.crushing))
        self._springs: Springs | None = None

    # ---- starts

    def cold(self, mu: float | None) -> Iterate:
        """A point far from all boundaries: pressed by the dead load and a typical force."""
        model, shift = self._model, self._displacement
        response = elastic_response(model, self._program.equations)
        force = np.zeros(model.shape)
        pressed = np.maximum(response.dead_force[:, : model.pressing], 0.0) + 0.3 * model.force
        crushed = model.crushing * pressed.sum(axis=1) > 0.1
        safe = np.where(crushed, model.crushing, 1.0)
        pressed = np.where(crushed[:, None], (0.05 / safe)[:, None], pressed)
        force[:, : model.pressing] = pressed
        motion = np.zeros(len(model.live))
        if self._program.elastic and not self._given:
            motion = response.live * (self._program.work / response.work)
        slacks = model.slacks(force, self._strength, self._program.friction)
        duals = tuple(
            shift * cone.identity(slack) for cone, slack in zip(model.cones, slacks, strict=True)
        )
        return self._with_rows(Iterate(motion, 0.0, force, duals), 1.0, mu)

    def inside(self, start: Iterate, mu: float | None) -> Iterate:
        """A start moved away from boundaries, with products of mu at least."""
        model = self._model
        force = start.force.copy()
        if len(start.row_duals) != len(self._rows):
            start = self._with_rows(start, 0.1, mu)
        slacks = model.slacks(force, self._strength, self._program.friction)
        margin = min(
            float(cone.margin(slack).min(initial=np.inf))
            for cone, slack in zip(model.cones, slacks, strict=True)
        )
        if margin > 0.0 and mu is None:
            return start
        count = model.pressing
        normal = model.normal(force)
        least = (model.crushing * normal**2)[:, None]
        low = force[:, :count] - least <= 1e-6 * model.force
        force[:, :count] = np.where(low, least + 1e-3 * model.force, force[:, :count])
        bound = self._strength + self._program.friction * model.normal(force)
        most = np.minimum(np.maximum(0.95 * bound, bound - 0.02 * model.force), 0.999 * bound)
        size = np.linalg.norm(force[:, count:], axis=1)
        force[:, count:] *= np.minimum(1.0, most / np.maximum(size, 1e-300))[:, None]
        duals = start.duals
        if mu is not None:
            slacks = model.slacks(force, self._strength, self._program.friction)
            duals = tuple(
                cone.raised(slack, dual, mu)
                for cone, slack, dual in zip(model.cones, slacks, duals, strict=True)
            )
        return replace(start, force=force, duals=duals)

    def _with_rows(self, start: Iterate, part: float, mu: float | None) -> Iterate:
        """A start with slacks of the rows, at least a part of their terms' sizes."""
        model = self._model
        size = np.abs(self._factors) + np.abs(self._rows).max(axis=1, initial=0.0) * model.force
        value = self._row_values(start.force, start.load_factor)
        slack = np.maximum(value, part * size)
        product = self._displacement * model.force if mu is None else mu
        return replace(start, row_slacks=slack, row_duals=product / np.maximum(slack, 1e-300))

    def _row_values(self, force: Array, load_factor: float) -> Array:
        normal = self._model.normal(force)
        return np.asarray(self._rows @ normal + self._factors * load_factor - self._least)

    # ---- residuals

    def measured(self, iterate: Iterate) -> Iterate:
        """An iterate with its residuals; they are kept for the next step."""
        model, program = self._model, self._program
        self._slacks = model.slacks(iterate.force, self._strength, program.friction)
        self._directions = model.derivatives(iterate.force, program.dilatancy)
        products = sum(
            float(np.vdot(slack, dual))
            for slack, dual in zip(self._slacks, iterate.duals, strict=True)
        )
        products += float(iterate.row_duals @ iterate.row_slacks)
        degree = len(self._rows) + sum(
            cone.degree(slack) for cone, slack in zip(model.cones, self._slacks, strict=True)
        )
        self._equilibrium = model.missing(iterate.force, iterate.load_factor)
        self._stationary = self._stationarity(iterate)
        self._work = 0.0
        if not self._given:
            own = self._factors @ iterate.row_duals - model.live @ iterate.motion
            self._work = program.work + float(own)
        self._row_missing = (
            self._row_values(iterate.force, iterate.load_factor) - iterate.row_slacks
        )
        work = self._work_size
        forces = max(model.force, abs(iterate.load_factor) * model.load)
        size = work
        if not self._given:
            size = work * max(abs(iterate.load_factor), 1e-3 * model.force / model.load)
        scale = max(1.0, float(np.abs(self._least).max(initial=0.0)))
        motions = (
            np.abs(self._stationary).max(initial=0.0) / self._displacement,
            abs(self._work) / work,
            10.0 * np.abs(self._row_missing).max(initial=0.0) / scale,
        )
        return replace(
            iterate,
            mu=products / degree,
            gap=products / size,
            missing=float(np.abs(self._equilibrium).max(initial=0.0)) / forces,
            missing_motion=float(max(motions)),
            early=None,
        )

    def _stationarity(self, iterate: Iterate) -> Array:
        """H d + C x + w a - G_s^T (y, z) - (r . p) a, shape (units, m)."""
        model = self._model
        residual = model.relative(iterate.motion) + self._compliance * iterate.force
        for direction, dual in zip(self._directions, iterate.duals, strict=True):
            residual -= _transposed(direction, dual)
        pressed = self._cost - self._rows.T @ iterate.row_duals
        return residual + pressed[:, None] * self._pressing

    # ---- steps

    def advanced(self, iterate: Iterate) -> tuple[Iterate, float]:
        """The iterate after one step, and the step's length.

        Raises:
            SolverError: If Newton's matrix cannot be factored.
        """
        newton = self._newton(iterate)
        mu = iterate.mu
        nothing = _Targets(tuple(-one.products for one in newton.scaled), -newton.row_products)
        predictor = newton.direction(nothing, 1.0)
        length = self._length(iterate, predictor, 1.0)
        after = self._products_after(iterate, predictor, length)
        centring = float(np.clip((abs(after) / mu) ** 3, 1e-5, 0.9))
        if iterate.missing > 1e-2 or iterate.missing_motion > 1e-2:
            centring = max(centring, 0.1)
        target = centring * mu
        corrector = newton.direction(self._second_order(newton, predictor, target, mu), 0.0)
        step = predictor.plus(corrector)
        if not self._curved:
            step = self._weighted(iterate, predictor, corrector, length)
            step = self._pushed(iterate, newton, step, target)
        length = self._length(iterate, step, self.options.back)
        if length < 0.1:
            again = newton.direction(self._centred(newton, 0.7 * mu), 1.0)
            longer = self._length(iterate, again, 0.98)
            if longer > length:
                step = again
                length = longer
        return _moved(iterate, step, length), length

    def _newton(self, iterate: Iterate) -> _Newton:
        """Newton's matrix at an iterate, factored."""
        model, program = self._model, self._program
        scaled = tuple(
            cone.scaled(slack, dual)
            for cone, slack, dual in zip(model.cones, self._slacks, iterate.duals, strict=True)
        )
        right = self._directions
        if not self._symmetric:
            right = model.derivatives(iterate.force, program.friction)
        near = min(1.0, max(iterate.gap, 1e-3))
        shift = self.options.proximal * self._displacement / model.force * near
        weights = [one.weights for one in scaled] + [self._compliance + shift]
        if self._curved:
            weights.append(model.curvature(iterate.duals)[:, None])
        inverse = self._inverse(scaled, right).inverse(np.hstack(weights))
        solver = program.equations.factored(inverse, self._symmetric)
        return _Newton(self, iterate, scaled, right, inverse, solver)

    def _inverse(self, scaled: Sequence[Scaled], right: tuple[Array, ...]) -> Springs:
        """Springs of the vectors; they stay where neither cones nor crushing turn them."""
        fixed = not self._curved and all(one.frame is None for one in scaled)
        if self._springs is None or not fixed:
            units, size = self._model.shape
            last = [np.broadcast_to(np.eye(size), (units, size, size))]
            if self._curved:
                last.append(np.broadcast_to(self._pressing, (units, 1, size)))
            lefts = [_framed(one, g) for one, g in zip(scaled, self._directions, strict=True)]
            left = np.concatenate(lefts + last, axis=1)
            both = left
            if not self._symmetric:
                rights = [_framed(one, g) for one, g in zip(scaled, right, strict=True)]
                both = np.concatenate(rights + last, axis=1)
            self._springs = Springs(left, both)
        return self._springs

    def _second_order(self, newton: _Newton, step: _Step, target: float, mu: float) -> _Targets:
        """Changes of the products that the corrector aims at."""
        most = 5.0 * mu if self._curved else np.inf
        cones, duals, slacks = self._model.cones, step.duals, step.slacks
        changes = []
        for cone, one, ds, dz in zip(cones, newton.scaled, slacks, duals, strict=True):
            cross = np.maximum(np.minimum(one.cross(ds, dz), most), -most)
            changes.append(target * cone.identity(ds) - cross)
        cross = np.maximum(np.minimum(step.row_duals * step.row_slacks, most), -most)
        return _Targets(tuple(changes), target - cross)

    def _centred(self, newton: _Newton, target: float) -> _Targets:
        """Changes of the products to equal ones."""
        cones = zip(self._model.cones, newton.scaled, strict=True)
        changes = tuple(target * cone.identity(one.products) - one.products for cone, one in cones)
        return _Targets(changes, target - newton.row_products)

    def _weighted(
        self, iterate: Iterate, predictor: _Step, corrector: _Step, length: float
    ) -> _Step:
        """Predictor and corrector with the weight that allows the longest step."""
        best = predictor.plus(corrector)
        longest = self._straight(iterate, best)
        for weight in np.linspace(1.0, length**2, 5).tolist()[1:] if longest < 0.9 else ():
            step = predictor.plus(corrector, weight)
            found = self._straight(iterate, step)
            if found > longest:
                best = step
                longest = found
        return best

    def _pushed(self, iterate: Iterate, newton: _Newton, step: _Step, target: float) -> _Step:
        """A step with outlying products pushed back, as long as that makes it longer."""
        low, high = self.options.band
        length = self._straight(iterate, step)
        for _ in range(self.options.pushes if length < 0.9 else 0):
            tried = min(1.0, 1.3 * min(length, 1.0) + 0.1)
            aim = max(target, 0.3 * iterate.mu * (1.0 - tried))
            changes = []
            for cone, one, ds, dz in zip(
                self._model.cones, newton.scaled, step.slacks, step.duals, strict=True
            ):
                after = newton.products_after(one, ds, dz, tried)
                changes.append(cone.pushed(after, low * aim, high * aim))
            slacks = iterate.row_slacks + tried * step.row_slacks
            rows = np.multiply(slacks, iterate.row_duals + tried * step.row_duals)
            pushed = self._model.cones[0].pushed(rows, low * aim, high * aim)
            more = step.plus(newton.direction(_Targets(tuple(changes), pushed), 0.0))
            longer = self._straight(iterate, more)
            if longer < 1.02 * length:
                break
            step = more
            length = longer
        return step

    def _straight(self, iterate: Iterate, step: _Step) -> float:
        """The longest step to first order."""
        lengths = [self._dual_length(iterate, step)]
        for cone, slack, change in zip(self._model.cones, self._slacks, step.slacks, strict=True):
            lengths.append(cone.longest(slack, change))
        return min(lengths)

    def _dual_length(self, iterate: Iterate, step: _Step) -> float:
        """The longest step for multipliers and rows."""
        cones = self._model.cones
        lengths = [
            cone.longest(dual, change)
            for cone, dual, change in zip(cones, iterate.duals, step.duals, strict=True)
        ]
        lengths.append(cones[0].longest(iterate.row_duals, step.row_duals))
        lengths.append(cones[0].longest(iterate.row_slacks, step.row_slacks))
        return min(lengths)

    def _length(self, iterate: Iterate, step: _Step, part: float) -> float:
        """The length of a step that stays inside all boundaries, by a part of the way to them."""
        if not self._curved:
            return min(1.0, part * self._straight(iterate, step))
        length = min(1.0 / part, self._dual_length(iterate, step))
        model = self._model
        for _ in range(40):
            force = iterate.force + length * step.force
            slacks = model.slacks(force, self._strength, self._program.friction)
            left = min(
                float(np.min(cone.margin(new) / cone.margin(old), initial=1.0))
                for cone, new, old in zip(model.cones, slacks, self._slacks, strict=True)
            )
            if left > 0.3 * (1.0 - part):
                break
            if left > 0.0:
                length *= part
                break
            secant = min(
                cone.longest(old, (new - old) / length)
                for cone, new, old in zip(model.cones, slacks, self._slacks, strict=True)
            )
            length = min(0.9999 * length, 0.99999 * secant)
        return min(1.0, part * length)

    def _products_after(self, iterate: Iterate, step: _Step, length: float) -> float:
        """Mean product after a step, to first order in the slacks."""
        total = float(
            (iterate.row_duals + length * step.row_duals)
            @ (iterate.row_slacks + length * step.row_slacks)
        )
        degree = len(self._rows)
        for cone, slack, ds, dual, dz in zip(
            self._model.cones, self._slacks, step.slacks, iterate.duals, step.duals, strict=True
        ):
            total += float(np.vdot(slack + length * ds, dual + length * dz))
            degree += cone.degree(slack)
        return total / degree


@dataclass(frozen=True)
class _Targets:
    """Changes of the products wished for, by cones and of the rows."""

    cones: tuple[Array, ...]
    rows: Array


class _Newton:
    """Newton's matrix at an iterate: directions for changes of the products."""

    def __init__(
        self,
        method: _Method,
        iterate: Iterate,
        scaled: tuple[Scaled, ...],
        right: tuple[Array, ...],
        inverse: Array,
        solver: Callable[[Array], Array],
    ) -> None:
        self.scaled = scaled
        self.row_products = iterate.row_duals * iterate.row_slacks
        self._method = method
        self._iterate = iterate
        self._right = right
        self._inverse = inverse
        self._solver = solver
        model, rows = method._model, method._rows
        self._pressed = [_times(inverse, r[:, None] * method._pressing) for r in rows]
        borders = [model.live, *(model.transposed @ p.ravel() for p in self._pressed)]
        self._border = solver(np.column_stack(borders))
        moved = [model.relative(column) for column in self._border.T]
        changed = [-_times(inverse, column) for column in moved]
        for row, pressed in enumerate(self._pressed):
            changed[1 + row] += pressed
        self._changed = changed
        self._matrix = self._bordered([model.normal(one) for one in changed])

    def _bordered(self, normals: list[Array]) -> Array:
        """The matrix of lambda and the rows' multipliers."""
        method, iterate = self._method, self._iterate
        count = len(method._rows)
        matrix = np.zeros((1 + count, 1 + count))
        matrix[0] = method._model.live @ self._border
        matrix[0, 1:] -= method._factors
        if method._given:
            matrix[0, 0] = 1.0
        if count:
            matrix[1:] = iterate.row_duals[:, None] * (method._rows @ np.column_stack(normals))
            matrix[1:, 0] += iterate.row_duals * method._factors
            matrix[1:, 1:] += np.diag(iterate.row_slacks)
        return matrix

    def products_after(self, scaled: Scaled, ds: Array, dz: Array, length: float) -> Array:
        """(l + a W^-1 ds) o (l + a W dz)."""
        first = scaled.linear(ds, dz)
        return np.asarray(scaled.products + length * first + length**2 * scaled.cross(ds, dz))

    def direction(self, targets: _Targets, residuals: float) -> _Step:
        """The direction that changes the products, and takes away a part of the residuals."""
        method, iterate = self._method, self._iterate
        model, rows = method._model, method._rows
        shifts = tuple(
            one.shift(change) for one, change in zip(self.scaled, targets.cones, strict=True)
        )
        wanted = -residuals * method._stationary
        for direction, shift in zip(method._directions, shifts, strict=True):
            wanted += _transposed(direction, shift)
        right = residuals * method._equilibrium
        right = right + model.transposed @ _times(self._inverse, wanted).ravel()
        first = self._solver(right)
        force = _times(self._inverse, wanted - model.relative(first))
        missing = np.empty(1 + len(rows))
        missing[0] = residuals * method._work - model.live @ first
        normal = rows @ model.normal(force) + residuals * method._row_missing
        missing[1:] = targets.rows - iterate.row_duals * normal
        try:
            border = np.linalg.solve(self._matrix, missing)
        except np.linalg.LinAlgError as error:
            raise SolverError(f"face forces: {error}") from None
        for part, change in zip(border, self._changed, strict=True):
            force += part * change
        slacks = tuple(_along(g, force) for g in self._right)
        duals = tuple(
            shift - one.stretch(ds)
            for shift, one, ds in zip(shifts, self.scaled, slacks, strict=True)
        )
        moved = rows @ model.normal(force) + method._factors * border[0]
        return _Step(
            first + self._border @ border,
            float(border[0]),
            force,
            duals,
            border[1:],
            moved + residuals * method._row_missing,
            slacks,
        )


@dataclass(frozen=True)
class Response:
    """Of blocks on their faces' springs, all closed and stuck.

    Attributes:
        live: Motions by the live load of factor 1.
        work: f_L . d of these.
        dead_force: Face forces by the dead load, shape (units, m).
    """

    live: Array
    work: float
    dead_force: Array


def elastic_response(model: FaceModel, equations: Equations) -> Response:
    """The response of a model, solved for once.

    Raises:
        SolverError: If the faces do not hold the blocks.
    """
    if equations.response is None:
        size = model.shape[1]
        inverse = np.zeros((*model.shape, size))
        inverse[:, np.arange(size), np.arange(size)] = 1.0 / model.compliance
        solver = equations.factored(inverse, True)
        live, dead = solver(model.live), solver(model.dead)
        force = -model.relative(dead) / model.compliance
        equations.response = Response(live, float(model.live @ live), force)
    return equations.response


def _moved(iterate: Iterate, step: _Step, length: float) -> Iterate:
    return Iterate(
        iterate.motion + length * step.motion,
        iterate.load_factor + length * step.load_factor,
        iterate.force + length * step.force,
        tuple(a + length * b for a, b in zip(iterate.duals, step.duals, strict=True)),
        iterate.row_duals + length * step.row_duals,
        iterate.row_slacks + length * step.row_slacks,
    )


def _times(matrix: Array, vector: Array) -> Array:
    """Products of small matrices and vectors."""
    return np.asarray(np.matmul(matrix, vector[:, :, None])[:, :, 0])


def _along(derivative: Array, force: Array) -> Array:
    """Change of slacks with forces."""
    return np.asarray(np.matmul(derivative, force[:, :, None])[:, :, 0])


def _transposed(direction: Array, dual: Array) -> Array:
    """G^T z."""
    return np.asarray(np.matmul(dual[:, None, :], direction)[:, 0])


def _framed(scaled: Scaled, derivative: Array) -> Array:
    """Vectors of the squares of W^-2, in terms of the forces."""
    return derivative if scaled.frame is None else np.asarray(np.matmul(scaled.frame, derivative))
