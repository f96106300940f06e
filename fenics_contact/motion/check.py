"""The non-linear kinematic check of a mechanism, by the Italian code for existing masonry.

Circolare 21.01.2019 n. 7 C.S.LL.PP., C8.7.1.2.1.2 to .8. The load that is left, alpha, at the
displacement d_C of a control point is the capacity curve of an oscillator,

    a = alpha g / (e* FC)  [C8.7.1.3],   d = d_C sum P delta^2 / (delta_C sum P delta)  [C8.7.1.4],

P the weights that move and delta their displacements as the motion starts. With d_0 where nothing
is left, d_SLV = 0.4 d_0 and d_SLC = 0.6 d_0, and the periods

    T_SLV = 1.68 pi sqrt(d_SLV / a(d_SLV))   [C8.7.1.10],
    T_SLC = 1.56 pi sqrt(d_SLC / a(d_SLC))   [C8.7.1.11],

the mechanism stands the ground acceleration a_g for which the elastic spectrum of displacements,
S_De = S_e T^2 / (4 pi^2) (NTC 2018, 3.2.3.2), has that displacement at that period, with a damping
of 8 % (SLV) and 10 % (SLC). It starts to move, SLD, at a_0 = S_e(0) [C8.7.1.8]. An element that
vibrates freely first has the branch a = (2 pi / T_0)^2 d up to a_y [C8.7.1.6], and starts to rock
at a_y = S_e(T_0, 5 %) [C8.7.1.9]. This is the check of a mechanism that stands on the ground.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fenics_contact.geometry.mesh import Array

#: By limit state: part of d_0, factor of the period, damping in per cent.
LIMIT_STATES = {"SLV": (0.4, 1.68, 8.0), "SLC": (0.6, 1.56, 10.0)}
#: Steps of the iteration on T_D, which is 4 a_g / g + 1.6 s.
ITERATIONS = 60
#: Damping of the spectra of the code, per cent.
USUAL = 5.0


@dataclass(frozen=True)
class Spectrum:
    """The elastic spectrum on the ground, NTC 2018, 3.2.3.2.1, or one given by points.

    Attributes:
        ground: a_g of the place, m/s2.
        soil: S.
        amplification: F_0.
        corner: T_C, s.
        points: Periods, s, and accelerations with 5 % damping, m/s2, in place of S, F_0 and T_C.
    """

    ground: float
    soil: float = 1.0
    amplification: float = 2.5
    corner: float = 0.5
    points: tuple[tuple[float, float], ...] = ()

    @classmethod
    def of(cls, given: Mapping[str, float] | Sequence[Sequence[float]], gravity: float) -> Spectrum:
        """From the keys ag (of g), S, F0, TC; or from points, whose first one is at T = 0."""
        if isinstance(given, Mapping):
            return cls(given["ag"] * gravity, given["S"], given["F0"], given["TC"])
        points = tuple((float(period), float(value)) for period, value in given)
        return cls(points[0][1], points=points)

    def acceleration(self, period: float, damping: float, ground: float, gravity: float) -> float:
        """S_e, m/s2, at a period, s, with damping, per cent, for a ground acceleration, m/s2."""
        eta = max(math.sqrt(10.0 / (5.0 + damping)), 0.55)
        if self.points:
            periods, values = np.array(self.points).T
            return eta * float(np.interp(period, periods, values)) * ground / self.ground
        first, second, third = self.corner / 3.0, self.corner, 4.0 * ground / gravity + 1.6
        plateau = ground * self.soil * eta * self.amplification
        if period < first:
            rest = (1.0 - period / first) / (eta * self.amplification)
            return plateau * (period / first + rest)
        return plateau * min(1.0, second / period, second * third / period**2)

    def carried(self, value: float, period: float, damping: float, gravity: float) -> float:
        """Ground acceleration, m/s2, whose spectrum has a value, m/s2, at a period, s."""
        ground = gravity
        for _ in range(ITERATIONS):
            at = self.acceleration(period, damping, ground, gravity)
            ground *= value / at
        return ground


@dataclass(frozen=True)
class NonlinearCheck:
    """The check of one limit state.

    Attributes:
        limit_state: "SLD", "SLV" or "SLC".
        curve: d, m, and a, m/s2, of the oscillator.
        displacement: d_SLV or d_SLC, m; for SLD that at which rocking starts.
        acceleration: a there, m/s2.
        period: T, s.
        ground: a_g that it stands, m/s2.
        start: a_g at which it starts, m/s2; `ground` is not below it.
        demand: a_g of the place, m/s2.
        gravity: m/s2.
        remarks: What limits the check, in words.
    """

    limit_state: str
    curve: tuple[Array, Array]
    displacement: float
    acceleration: float
    period: float
    ground: float
    start: float
    demand: float
    gravity: float
    remarks: tuple[str, ...] = ()

    @property
    def zero(self) -> float:
        """d_0, m."""
        return float(self.curve[0][-1])

    @property
    def verdict(self) -> str:
        """What it stands, and whether that is enough, in words."""
        enough = "enough" if self.ground >= self.demand else "NOT enough"
        stands, asked = (f"{value / self.gravity:.4g} g" for value in (self.ground, self.demand))
        return f"{stands} on the ground ({asked} asked for: {enough})"

    @property
    def text(self) -> str:
        """What people are told."""
        at = f"d_{self.limit_state} {self.displacement:.4g} m, T {self.period:.4g} s: "
        stands = f"{at * (self.limit_state != 'SLD')}it stands a_g = {self.verdict}"
        return "; ".join([stands, *self.remarks])

    def record(self) -> dict[str, Any]:
        """For result.json; accelerations in m/s2."""
        shift, acceleration = self.curve
        return {
            "limit_state": self.limit_state,
            "d": shift.tolist(),
            "a": acceleration.tolist(),
            "d_0": self.zero,
            f"d_{self.limit_state}": self.displacement,
            "T": self.period,
            "a_g": self.ground,
            "a_g_start": self.start,
            "demand": self.demand,
            "verdict": "enough" if self.ground >= self.demand else "NOT enough",
            "remarks": self.remarks,
        }

    def table(self) -> list[tuple[str, str]]:
        """Names and values, in the order in which they follow from each other."""
        state = self.limit_state
        starts = f"{self.start / self.gravity:.4g} g"
        rows = [("displacement at which nothing is left, d_0", f"{self.zero:.4g} m")]
        if state in LIMIT_STATES:
            part, factor, damping = LIMIT_STATES[state]
            rows += [
                (f"d_{state} = {part} d_0 [C8.7.1.2.1.6]", f"{self.displacement:.4g} m"),
                (f"spectral acceleration there, a(d_{state})", f"{self.acceleration:.4g} m/s2"),
                (f"period T_{state} = {factor} pi sqrt(d / a)", f"{self.period:.4g} s"),
                ("damping", f"{damping:g} %"),
            ]
        rows.append(("ground acceleration at which it starts, a_g,SLD", starts))
        return [*rows, (f"ground acceleration that it stands, a_g,{state}", self.verdict)]


def nonlinear_check(
    shift: Array,
    acceleration: Array,
    spectrum: Spectrum,
    *,
    gravity: float,
    limit_state: str = "SLV",
    lost: float = math.inf,
    free: float | None = None,
    remarks: Sequence[str] = (),
) -> NonlinearCheck:
    """The check of an oscillator.

    Args:
        shift: d at rising displacements, m, up to d_0.
        acceleration: a, m/s2.
        spectrum: On the ground.
        gravity: m/s2.
        limit_state: "SLD", or a key of `LIMIT_STATES`.
        lost: d at which supports are lost, m.
        free: T_0 of an element that vibrates freely, s; None: it rocks from the start.
        remarks: What limits the check, in words.
    """
    shift, acceleration, first = _with_elastic(shift, acceleration, free)
    at, there, period = float(shift[first]), float(acceleration[first]), free or 0.0
    start = stands = spectrum.carried(there, period, USUAL, gravity)
    if limit_state in LIMIT_STATES:
        part, factor, damping = LIMIT_STATES[limit_state]
        at = min(part * float(shift[-1]), lost)
        there = float(np.interp(at, shift, acceleration))
        period = factor * math.pi * math.sqrt(at / there)
        asked = at * (2.0 * math.pi / period) ** 2
        stands = max(start, spectrum.carried(asked, period, damping, gravity))
    curve = shift, acceleration
    known = at, there, period, stands, start, spectrum.ground
    return NonlinearCheck(limit_state, curve, *known, gravity, tuple(remarks))


def _with_elastic(
    shift: Array, acceleration: Array, period: float | None
) -> tuple[Array, Array, int]:
    """A curve with the elastic branch of a free element, and the number of the point behind it."""
    if not period:
        return shift, acceleration, 0
    stiffness = (2.0 * math.pi / period) ** 2
    left = acceleration - stiffness * shift
    behind = int(np.argmax(left <= 0.0))
    before = behind - 1
    part = left[before] / (left[before] - left[behind])
    yields = shift[before] + part * (shift[behind] - shift[before])
    return (
        np.concatenate([[0.0, yields], shift[behind:]]),
        np.concatenate([[0.0, stiffness * yields], acceleration[behind:]]),
        1,
    )
