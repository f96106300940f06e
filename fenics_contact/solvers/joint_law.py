"""The law of joint points: all that the program knows of opening, slip and friction.

With opening w_N = B_N u, slip w_T = B_T u and forces r_N, r_T (`problem`), a point obeys

    y = w_N - D |w_T| >= 0,   r_N >= 0,   y r_N = 0,
    |r_T| <= F r_N + c,       slip against r_T where it is at its bound, none where it is not.

F is Coulomb's coefficient of friction, c a given strength (Tresca's bound, cohesion), and D <= F
the tangent of the dilatancy angle: a joint that slides rides up on its teeth. y is its *clearance*.
With slip split into z1 towards negative and z2 towards positive values,

    y = w_N - D (z1 + z2),   w_T = z2 - z1,   s1 = F r_N + c - r_T,   s2 = F r_N + c + r_T,
    y r_N = 0,   s1 z1 = 0,   s2 z2 = 0,   all six >= 0.

The forces do the work -(r_N w_N + r_T w_T) = g |w_T| on joints, g = (F - D) r_N + c. With g given,
these are the optimality conditions of a convex problem: associative friction with the coefficient D
beside a strength g (A. Drescher, E. Detournay, Geotechnique 43 (1993) 443). With D = F the law
itself is of this kind, its slip is normal to Coulomb's cone; with D = 0 it is Coulomb's.

A joint with a tensile strength t carries r_N >= -t, and |r_T| <= F r_N + c0 with F t <= c0: the
tension cut-off of Coulomb's cone (P.B. Lourenco, J.G. Rots, J. Eng. Mech. 123 (1997) 660). With
r_N' = r_N + t that is the law above, c = c0 - F t, under forces -t on the joint that belong to the
dead load: a bond is a prestress that opening takes up. Everywhere in the solvers r_N is r_N'.

A tie is a point that slides only: its row of B_N is zero, and it is *apart* by a distance that
nothing changes, so that r_N = 0. With the yield Y its tension is Y/2 - r_T, |r_T| <= Y/2, under
forces Y/2 along B_T^T that belong to the dead load (`discretization.ties`).

Solvers, linear programs and certificates ask this module and have no law of their own. `laws.c`
says in C what `SmoothedLaws`, `LinearLaws` and `slacks_next_to` say here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fenics_contact.solvers.compiled_laws import Structure, compiled_laws

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

#: Steps at most to the state with given forces less displacements, and where they end: relative
#: changes of rounding.
P_STEPS = 60
P_ROUNDING = 1e-14


def _none() -> Array:
    return np.zeros(0)


@dataclass(frozen=True)
class PointLaws:
    """Constants of the law at some points, or at some straight faces; arrays (points,).

    Attributes:
        friction: Coulomb's coefficient F; 0 where the law is another.
        strength: c, N per metre of thickness.
        dilatancy: D, tangent of the dilatancy angle, at most F; zero where left out.
        bond: t, N per metre of thickness; zero where left out.
        slip_origin: B_T u from which slip is measured, m; zero: the stress-free state.
        opening_origin: B_N u from which openings are measured, m; below zero for initial gaps.
        apart: Opening of ties, m; zero at joints.
    """

    friction: Array
    strength: Array
    dilatancy: Array = field(default_factory=_none)
    bond: Array = field(default_factory=_none)
    slip_origin: Array = field(default_factory=_none)
    opening_origin: Array = field(default_factory=_none)
    apart: Array = field(default_factory=_none)

    def __post_init__(self) -> None:
        for name in ("dilatancy", "bond", "slip_origin", "opening_origin", "apart"):
            if len(getattr(self, name)) != len(self.friction):
                object.__setattr__(self, name, np.zeros(len(self.friction)))

    def bonded(self, bond: Array) -> PointLaws:
        """Laws with a tensile strength t; their strength is that at r_N = 0."""
        least = np.maximum(self.strength - self.friction * bond, 0.0)  # rounding
        return replace(self, strength=least, bond=bond)

    def each(self, of: Callable[[Array], Array]) -> PointLaws:
        """Laws with a function of every array in its place: of some points, or of all ranks."""
        return PointLaws(*(of(getattr(self, item.name)) for item in fields(self)))

    def at(self, points: npt.NDArray[np.integer]) -> PointLaws:
        """Laws of some points."""
        return self.each(lambda values: values[points])

    def homogeneous(self) -> PointLaws:
        """Laws that hold for every multiple of a state: without strengths, gaps and origins."""
        none = np.zeros_like(self.strength)
        return PointLaws(self.friction, none, self.dilatancy, apart=self.apart)

    def frictionless(self) -> PointLaws:
        """Laws by which joints carry no shear; ties stay."""
        none = np.zeros_like(self.friction)
        return replace(self, friction=none, strength=self.pull, dilatancy=none)

    def at_most(self, friction: float) -> PointLaws:
        """Laws with coefficients of friction of at most so much."""
        dilatancy = np.minimum(self.dilatancy, friction)
        return replace(self, friction=np.minimum(self.friction, friction), dilatancy=dilatancy)

    def times(self, part: float) -> PointLaws:
        """Laws with a part of the friction that depends on pressure."""
        return replace(self, friction=part * self.friction, dilatancy=part * self.dilatancy)

    @property
    def origins(self) -> Array:
        """Openings and slips at which the joints are as drawn, m, shape (2, points)."""
        return np.array([self.opening_origin, self.slip_origin])

    @property
    def pull(self) -> Array:
        """Tension Y/2 of ties that belongs to the dead load, N per metre of thickness."""
        return np.where(self.apart > 0.0, self.strength, 0.0)

    # ---- bounds

    @property
    def frictional(self) -> Flags:
        """Points that transmit shear."""
        return (self.friction > 0.0) | (self.strength > 0.0)

    @property
    def dissipative(self) -> Array:
        """Coefficient F - D of the friction that takes up power, 0 where slip is associative."""
        return self.friction - self.dilatancy

    def bound(self, pressure: Array) -> Array:
        """Bound F r_N + c on the shear forces for given normal forces."""
        return self.friction * pressure + self.strength

    def distances(self, pressure: Array, shear: Array) -> Array:
        """Distances of r_N and r_T from their bounds, r_N, F r_N + c -+ r_T, shape (3, points)."""
        bound = self.bound(pressure)
        return np.stack([pressure, bound - shear, bound + shear])

    def given(self, pressure: Array) -> Array:
        """Bound g = (F - D) r_N + c beside associative friction, for given normal forces."""
        return self.dissipative * pressure + self.strength

    def with_given(self, bound: Array) -> PointLaws:
        """Laws with associative friction D and a given bound g: those of a convex problem."""
        return replace(self, friction=self.dilatancy, strength=bound)

    # ---- kinematics

    def clearance(self, opening: Array, slip: Array) -> Array:
        """Clearance y of openings and slips, or its rate of theirs, m."""
        return opening - self.dilatancy * np.abs(slip)

    def dilation(self, lower: Array, upper: Array) -> Array:
        """Opening D (z1 + z2) by slip, m."""
        return self.dilatancy * (lower + upper)

    # ---- residuals

    def missed(
        self, opening: Array, slip: Array, pressure: Array, shear: Array
    ) -> dict[str, Array]:
        """What states miss of the law by name: forces, displacements or their products."""
        clearance = self.clearance(opening, slip)
        bound = self.bound(np.maximum(pressure, 0.0))
        return {
            "tension": -pressure,
            "penetration": -clearance,
            "complementarity": np.abs(clearance * pressure),
            "friction": np.abs(shear) - bound,
            "slip_direction": np.abs(bound * np.abs(slip) + shear * slip),
        }

    def dissipation(self, pressure: Array, slip_rate: Array) -> Array:
        """Power g |w_T| that every point takes up at given normal forces."""
        return self.given(np.maximum(pressure, 0.0)) * np.abs(slip_rate)

    # ---- smooth laws

    def smoothed(self, force: float, frictional: Flags, smallest: float) -> SmoothedLaws:
        """The laws with equal products, in units of a typical force."""
        numbers = self.friction, self.strength / force, self.dilatancy
        return SmoothedLaws(*numbers, frictional, smallest)


# ---- all products equal to mu: smooth functions of one number per point and side


@dataclass(frozen=True)
class JointStates:
    """States of joint points in typical units, or changes of them.

    Attributes:
        values: Clearance y, normal force r_N, slip w, shear force r_T and dilation D (z1 + z2),
            shape (5, points).
    """

    values: Array

    @property
    def p(self) -> Array:
        """r_N - y."""
        return np.asarray(self.values[1] - self.values[0])

    @property
    def q(self) -> Array:
        """r_T - w."""
        return np.asarray(self.values[3] - self.values[2])


@dataclass(frozen=True)
class SmoothedLaws:
    """Laws of some joint points with products mu: every p and q belong to one state.

        p = r_N - y   with   r_N y = mu,
        q = r_T - w   with   s1 z1 = s2 z2 = mu

    (B. Chen, P.T. Harker, SIAM J. Matrix Anal. Appl. 14 (1993) 1168; C. Kanzow, SIAM J. Matrix
    Anal. Appl. 17 (1996) 851). As mu falls to zero they become the laws.

    Attributes:
        friction: F.
        strength: c, in typical units.
        dilatancy: D.
        frictional: Points that transmit shear; the others slide freely.
        smallest: Size of p and q by which changes are measured, at least.
    """

    friction: Array
    strength: Array
    dilatancy: Array
    frictional: Flags
    smallest: float

    @property
    def carried(self) -> Array:
        """1 where there is a force, normal or shear, 0 where there is none, shape (2, points)."""
        return np.array([np.ones(len(self.frictional)), self.frictional])

    def states(self, p: Array, q: Array, mu: float) -> JointStates:
        """States that belong to p and q."""
        y, r = normal_law(p, mu)
        gamma = self._bound(r)
        near = distance_from_bound(np.abs(q), gamma, mu)
        shear = np.where(self.frictional, np.copysign(gamma - near, q), 0.0)
        dilation = self.dilatancy * (mu / near + mu / (2.0 * gamma - near))
        return JointStates(np.array([y, r, shear - q, shear, dilation]))

    def p_of(self, difference: Array, q: Array, mu: float) -> Array:
        """Value of p of states with given r_N - w_N and q: p = r_N - w_N + D (z1 + z2).

        The last term falls as p grows, so there is one: Newton's method, kept between two values
        that it lies between.
        """
        p = low = difference
        high = change = np.full_like(p, np.inf)
        for _ in range(P_STEPS):
            states, (by_p, _, _) = self.linearized(p, q, mu, newton_steps=6)
            beyond = difference + states.values[4]  # on the other side of the root
            rest = beyond - p
            low = np.maximum(low, np.minimum(p, beyond))
            high = np.minimum(high, np.maximum(p, beyond))
            new = p + rest / (1.0 - by_p[4])
            falls = np.abs(new - p) <= 0.5 * change
            new = np.where(falls & (new >= low) & (new <= high), new, 0.5 * (low + high))
            change = np.abs(new - p)
            p = new
            if not np.any(change > P_ROUNDING * (np.abs(p) + self.smallest)):
                break
        return np.asarray(p)

    def sizes(self, states: JointStates) -> Array:
        """Sizes of p and q of states, shape (2, points)."""
        y, r, w, _, _ = states.values
        return np.maximum(np.array([r + y, self._bound(r) + np.abs(w)]), self.smallest)

    def distances(self, states: JointStates, mu: float) -> Array:
        """Distances of any states from the states with equal p and q, relative to p and q.

        The larger of the differences of clearances and of slips, to six digits, shape (points,).
        """
        clearance, _, slip, _, _ = states.values
        y, r = normal_law(states.p, mu)
        q = states.q
        gamma = self._bound(r)
        near = distance_from_bound(np.abs(q), gamma, mu, newton_steps=4)
        w = np.copysign(gamma - near, q) - q
        of_p = np.abs(y - clearance) / np.maximum(r + y, self.smallest)
        of_q = np.abs(w - slip) / np.maximum(gamma + np.abs(w), self.smallest)
        return np.asarray(np.maximum(of_p, np.where(self.frictional, of_q, 0.0)))

    def linearized(
        self, p: Array, q: Array, mu: float, newton_steps: int = 4
    ) -> tuple[JointStates, Array]:
        """States that belong to p and q, by default to six digits, and their derivatives.

        These are by p, q and log mu, shape (3, 5, points).
        """
        none = np.zeros_like(p)
        y, r = normal_law(p, mu)
        root = y + r
        gamma = self._bound(r)
        r_p = r / root
        y_p = -y / root
        r_mu = mu / root
        # F(s, gamma, mu) = s - mu/s + mu/(2 gamma - s) - gamma + |q| = 0 is s(p, q, mu).
        near = distance_from_bound(np.abs(q), gamma, mu, newton_steps)
        far = 2.0 * gamma - near
        of_near = mu / near
        of_far = mu / far
        by_s = 1.0 + of_near / near + of_far / far
        by_gamma = -1.0 - 2.0 * of_far / far
        side = np.where(self.frictional, np.copysign(1.0, q), 0.0)
        shear = side * (gamma - near)
        shear_r = side * (1.0 + by_gamma / by_s) * self.friction
        shear_p = shear_r * r_p
        shear_q = np.where(self.frictional, 1.0 / by_s, 0.0)
        shear_mu = shear_r * r_mu + side * (of_far - of_near) / by_s
        # z1 + z2 = mu/s + mu/(2 gamma - s)
        slid = of_near + of_far
        slid_s = of_far / far - of_near / near
        slid_r = (-slid_s * by_gamma / by_s - 2.0 * of_far / far) * self.friction
        slid_q = np.copysign(1.0, q) * -slid_s / by_s
        slid_mu = slid_r * r_mu + slid_s * (of_near - of_far) / by_s + slid
        dilations = self.dilatancy * np.array([slid, slid_r * r_p, slid_q, slid_mu])
        by_p = np.array([y_p, r_p, shear_p, shear_p, dilations[1]])
        by_q = np.array([none, none, shear_q - 1.0, shear_q, dilations[2]])
        by_mu = np.array([r_mu, r_mu, shear_mu, shear_mu, dilations[3]])
        states = JointStates(np.array([y, r, shear - q, shear, dilations[0]]))
        return states, np.array([by_p, by_q, by_mu])

    def _bound(self, pressure: Array) -> Array:
        """Bound F r_N + c; 1 where there is none."""
        return np.where(self.frictional, self.friction * pressure + self.strength, 1.0)


def normal_law(p: Array, mu: float) -> tuple[Array, Array]:
    """Clearance and normal force with product mu and difference p: (sqrt(p^2 + 4 mu) -+ p) / 2."""
    large = 0.5 * (np.sqrt(p**2 + 4.0 * mu) + np.abs(p))
    small = mu / large
    return np.where(p > 0.0, small, large), np.where(p > 0.0, large, small)


def distance_from_bound(q: Array, gamma: Array, mu: float, newton_steps: int = 6) -> Array:
    """Distance s of the shear force from the bound that it is nearer to.

    Solves s - mu/s + mu/(2 gamma - s) = gamma - q for 0 < s <= gamma, with |q| as `q` and the bound
    gamma above 0. Six Newton steps leave nothing but rounding, four 1e-6 of s.
    """
    # Without the third term s is larger, and the first step goes too far: the left-hand side is
    # concave. From there Newton's method climbs to the solution and never passes it.
    rest = gamma - q
    large = 0.5 * (np.sqrt(rest**2 + 4.0 * mu) + np.abs(rest))
    s = np.minimum(np.where(rest > 0.0, large, mu / large), gamma)
    for _ in range(newton_steps):
        other = 2.0 * gamma - s
        near = mu / s
        far = mu / other
        s = s - (s - near + far - rest) / (1.0 + near / s + far / other)
    return np.asarray(np.minimum(s, gamma))


# ---- slacks, and the laws as springs of Newton's method


@dataclass(frozen=True)
class Slacks:
    """Variables of the law, or their changes, at this rank's points.

    Attributes:
        y: Clearances, m.
        pressure: r_N, N per metre of thickness.
        shear: r_T, likewise.
        s1: Distance of the shear force from its upper bound.
        s2: Distance from its lower bound.
        z1: Slip towards negative values, m.
        z2: Slip towards positive values, m.
    """

    y: Array
    pressure: Array
    shear: Array
    s1: Array
    s2: Array
    z1: Array
    z2: Array

    @property
    def slip(self) -> Array:
        """Slip z2 - z1, m."""
        return self.z2 - self.z1

    @property
    def positive(self) -> Array:
        """The six quantities that stay positive, shape (6 points,)."""
        return np.concatenate([self.y, self.pressure, self.s1, self.s2, self.z1, self.z2])


@dataclass(frozen=True)
class Units:
    """Units of displacement and force in which products are counted.

    Attributes:
        displacement: m.
        force: N per metre of thickness.
    """

    displacement: float
    force: float


def slacks_next_to(
    law: PointLaws,
    frictional: Flags,
    state: tuple[Array, Array, Array, Array],
    mu: float,
    units: Units,
    nearest: float = 0.0,
) -> Slacks:
    """Slacks with all products equal to mu next to a state: it keeps r_N - w_N and q.

    Args:
        law: The law.
        frictional: Points that transmit shear.
        state: Openings and slips, m, and normal and shear forces; these need not be admissible.
        mu: In units of force times displacement.
        units: Of displacement and force.
        nearest: Least distance of shear from its bound, in units of the bound.
    """
    d = units.displacement
    f = units.force
    opening, slip, pressure, shear = state
    q = shear / f - slip / d
    p = pressure / f - opening / d
    if np.any(law.dilatancy):
        p = law.smoothed(f, frictional, np.sqrt(mu)).p_of(p, q, mu)
    compiled = compiled_laws()
    if compiled is not None:
        found = np.empty((7, len(p)))
        laws = law.friction, law.strength, frictional.astype(float)
        compiled.slacks_of(len(p), mu, d, f, nearest, *laws, p, q, found)
        return Slacks(*found)
    y, pressure = normal_law(p, mu)
    y = y * d
    pressure = pressure * f
    gamma = np.where(frictional, law.bound(pressure) / f, 1.0)
    near = np.maximum(distance_from_bound(np.abs(q), gamma, mu), nearest * gamma)
    far = 2.0 * gamma - near
    s1 = np.where(q > 0.0, near, far) * f
    s2 = np.where(q > 0.0, far, near) * f
    shear = np.where(frictional, 0.5 * (s2 - s1), 0.0)
    return Slacks(y, pressure, shear, s1, s2, mu * f * d / s1, mu * f * d / s2)


@dataclass(frozen=True)
class Asked:
    """What a Newton step is to take from the linear conditions, and to add to the products.

    Attributes:
        opening: Residual y + D (z1 + z2) - w_N, m.
        slip: Residual z2 - z1 - w_T, m.
        products: Change of y r_N, s1 z1 and s2 z2, shape (3, points).
    """

    opening: Array
    slip: Array
    products: Array


@dataclass(frozen=True)
class LinearLaws:
    """Laws linearised at some slacks: joints as springs that the blocks feel.

    Let k_N = r_N / y, a = z1 / s1, b = z2 / s2, k_T = 1 / (a + b), and c_N, c_T a compliance of the
    point itself (`problem`). Changes of forces by those of openings and slips are

        dr_N = -normal (dw_N + slope dw_T),
        dr_T = -tangential dw_T - coupling (dw_N + slope dw_T),

        tangential = 1 / (a + b + c_T),               coupling = F (a - b) tangential normal,
        slope      = D (a - b) tangential,            normal   = k_N / (1 + (c_N + give) k_N),
        give       = D F (4 a b + c_T (a + b)) tangential.

    Without dilatancy slope and give are zero, with D = F they make the springs symmetric.

    Attributes:
        law: The law.
        at: The slacks.
        frictional: Points that transmit shear.
        compliance: c_N and c_T, m per N/m, shape (2, points).
        k_n: k_N, capped.
        k_t: k_T, capped; zero where no shear is transmitted.
        unit: Typical displacement over force: above it a side slides.
    """

    law: PointLaws
    at: Slacks
    frictional: Flags
    compliance: Array
    k_n: Array
    k_t: Array
    unit: float

    @classmethod
    def of(
        cls,
        law: PointLaws,
        at: Slacks,
        frictional: Flags,
        compliance: Array,
        largest: float,
        unit: float,
    ) -> LinearLaws:
        """Laws at some slacks, with springs of at most `largest`, N/m."""
        k_n = np.minimum(at.pressure / at.y, largest)
        k_t = np.minimum(1.0 / (at.z1 / at.s1 + at.z2 / at.s2), largest)
        return cls(law, at, frictional, compliance, k_n, np.where(frictional, k_t, 0.0), unit)

    @cached_property
    def rates(self) -> tuple[Array, Array]:
        """The rates a and b of both sides."""
        return self.at.z1 / self.at.s1, self.at.z2 / self.at.s2

    @cached_property
    def q(self) -> Array:
        """Change of r_T by one of r_N where nothing moves, F (a - b) k_T."""
        lower, upper = self.rates
        return self.law.friction * self.k_t * (lower - upper)

    @cached_property
    def slope(self) -> Array:
        """Opening by slip, D (a - b) tangential."""
        lower, upper = self.rates
        return self.law.dilatancy * (lower - upper) * (self.share_t * self.k_t)

    @cached_property
    def give(self) -> Array:
        """Opening by a normal force that lets slip, m per N/m."""
        lower, upper = self.rates
        both = 4.0 * lower * upper + self.compliance[1] * (lower + upper)
        return self.law.dilatancy * self.law.friction * both * (self.share_t * self.k_t)

    @cached_property
    def share_n(self) -> Array:
        """Part of an opening that is left to k_N."""
        return np.asarray(1.0 / (1.0 + (self.compliance[0] + self.give) * self.k_n))

    @cached_property
    def share_t(self) -> Array:
        """Part of a slip that is left to k_T."""
        return np.asarray(1.0 / (1.0 + self.compliance[1] * self.k_t))

    @cached_property
    def springs(self) -> tuple[Array, Array, Array]:
        """Springs normal, tangential and coupling, N/m."""
        normal = self.share_n * self.k_n
        return normal, self.share_t * self.k_t, self.share_t * self.q * normal

    def stiffness(self, free: float) -> tuple[Array, Array, Array | None, Array | None]:
        """Forces per motion that the blocks feel, N/m; `free` where no shear is transmitted.

        r_N by w_N, r_T by w_T, r_T by w_N and r_N by w_T, the last two None where they are zero.
        """
        normal, tangential, coupling = self.springs
        tangential = np.where(self.frictional, tangential + coupling * self.slope, free)
        coupled = bool(np.any(self.law.friction))
        dilates = bool(np.any(self.law.dilatancy))
        by_slip = normal * self.slope if dilates else None
        return normal, tangential, coupling if coupled else None, by_slip

    def forces(self, asked: Asked) -> tuple[Array, Array]:
        """Changes of r_N and r_T that a step asks for where nothing moves."""
        compiled = compiled_laws()
        if compiled is not None:
            found = np.empty((2, len(self.k_n)))
            given = asked.opening, asked.slip, asked.products
            compiled.asked_forces(self._structure, *given, found)
            return found[0], found[1]
        opening, drive = self._drives(asked)
        push = self.share_n * (asked.products[0] / self.at.y + self.k_n * opening)
        return push, self.share_t * (self.k_t * drive + self.q * push)

    def changes(self, asked: Asked, opening: Array, slip: Array) -> Slacks:
        """Changes of the slacks for openings and slips of the blocks: the eliminated equations."""
        compiled = compiled_laws()
        if compiled is not None:
            found = np.empty((7, len(self.k_n)))
            given = asked.opening, asked.slip, asked.products, opening, slip
            compiled.changes(self._structure, *given, found)
            return Slacks(*found)
        at = self.at
        c_n, c_t = self.compliance
        of_normal, of_lower, of_upper = asked.products
        asked_opening, drive = self._drives(asked)
        moved = opening + self.slope * slip
        pressure = self.share_n * (of_normal / at.y - self.k_n * (moved - asked_opening))
        stuck = np.where(self.frictional, drive - slip, 0.0)
        shear = self.share_t * (self.k_t * stuck + self.q * pressure)
        slip = slip + c_t * shear
        s1 = self.law.friction * pressure - shear
        s2 = self.law.friction * pressure + shear
        z1 = (of_lower - at.z1 * s1) / at.s1
        z2 = (of_upper - at.z2 * s2) / at.s2
        # Next to its bound the shear force has lost the digits that tell how far a point slides.
        slid = slip - asked.slip
        lower, upper = self.rates
        down = lower > np.maximum(upper, self.unit)
        up = upper > np.maximum(lower, self.unit)
        z1, z2 = np.where(down, z2 - slid, z1), np.where(up, z1 + slid, z2)
        s1 = np.where(down, (of_lower - at.s1 * z1) / at.z1, s1)
        s2 = np.where(up, (of_upper - at.s2 * z2) / at.z2, s2)
        s1, s2, z1, z2 = (np.where(self.frictional, part, 0.0) for part in (s1, s2, z1, z2))
        y = opening + c_n * pressure - asked.opening - self.law.dilation(z1, z2)
        return Slacks(y, pressure, shear, s1, s2, z1, z2)

    @cached_property
    def _structure(self) -> Structure | None:
        """The laws as the compiled ones take them; None where there are none."""
        compiled = compiled_laws()
        if compiled is None:
            return None
        names = "k_n", "k_t", "share_n", "share_t", "q", "slope", "compliance"
        fields = {name: getattr(self, name) for name in names}
        fields |= {name: getattr(self.at, name) for name in ("y", "s1", "s2", "z1", "z2")}
        fields["carried"] = self.frictional.astype(float)
        fields |= {"friction": self.law.friction, "dilatancy": self.law.dilatancy}
        return compiled.structure("linear", count=len(self.k_n), unit=self.unit, **fields)

    def _drives(self, asked: Asked) -> tuple[Array, Array]:
        """Openings and slips that the residuals and products ask for."""
        _, of_lower, of_upper = asked.products
        lower = of_lower / self.at.s1
        upper = of_upper / self.at.s2
        drive = np.where(self.frictional, upper - lower + asked.slip, 0.0)
        slid = self.law.dilation(lower, upper)
        return asked.opening + (slid + self.slope * drive), drive
