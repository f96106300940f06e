"""Text for people at the console: what is in a scene, how a solve goes on, what it found."""

from __future__ import annotations

import math
import sys
import time
from typing import Any

import numpy as np

from fenics_contact.discretization.joints import GROUND
from fenics_contact.discretization.layout import Layout
from fenics_contact.discretization.loads import floor_strips
from fenics_contact.results.bounds import WITHOUT_PATH, counted
from fenics_contact.results.history import CapacityPoint, Step, TracePoint
from fenics_contact.results.result import Answer, Collapse, Result, skipped
from fenics_contact.results.values import NamedArrays, TieState, tie_arrays
from fenics_contact.scene.scene import JointLaw, Tie
from fenics_contact.scene.units import Units


class Progress:
    """The load factor along the path, and digits gained by the fixed point, in lines.

    Attributes:
        pause: Least time between two lines of a path, s.
        long: Time without a line after which what begins is shown, s.
    """

    pause, long = 1.0, 5.0

    def __init__(self, tolerance: float) -> None:
        """Count digits down to the change of the friction bound at which a solve ends."""
        self._digits = -math.log10(tolerance)
        self._name, self._count = "", 0
        self._last = self._flushed = time.monotonic()

    def phase(self, name: str) -> None:
        """Show what begins, unless something was shown just before.

        mpirun ends a run whose output nobody reads once some ten pieces of it were lost.
        """
        if time.monotonic() - self._flushed >= self.long:
            sys.stdout.write(f"{name}\n")
            self._flush()

    def passed(self, direction: str, point: TracePoint, upper: float | None) -> None:
        """Show a point of the path against the end of the bracket."""
        if time.monotonic() - self._last < self.pause:
            return
        self._last = time.monotonic()
        known = upper is not None and math.isfinite(upper) and upper != 0.0
        share = point.load_factor / upper if upper and known else 0.0
        bound = f" of at most {upper:.6g}" if known else ""
        size = abs(point.displacement)
        moved = f"{1e3 * point.displacement:.3g} mm" if size < 1.0 else "above 1 km"
        moved = f"{point.displacement:.3g} m" if 1.0 <= size < 1e3 else moved
        text = f"{point.phase}  load factor {point.load_factor:.6g}{bound}  displacement {moved}"
        self._show(direction, min(max(share, 0.0), 1.0), text)

    def step(self, direction: str, step: Step) -> None:
        """Show one fixed-point iteration."""
        self._count = self._count + 1 if direction == self._name else 1
        gained = min(max(-math.log10(max(step.bound_change, 1e-300)), 0.0), self._digits)
        sign = -1.0 if direction == "negative" else 1.0
        text = (
            f"iteration {self._count:3d}  load factor {sign * step.load_factor:.8g}"
            f"  change of friction {step.bound_change:.1e}  factorisations {step.factorizations}"
        )
        self._show(direction, gained / self._digits, text)

    def point(self, done: int, total: int, point: CapacityPoint) -> None:
        """Show one point of the capacity curve."""
        self._show("capacity", done / total, f"{done} of {total}  {point.load_factor:.6g}")

    def _show(self, name: str, share: float, text: str) -> None:
        self._name = name
        sys.stdout.write(f"{name}: {text}\n")
        self._flush()

    def _flush(self) -> None:
        self._flushed = time.monotonic()
        sys.stdout.flush()

    def close(self) -> None:
        """Leave the console clean."""

    def of_worker(self) -> Progress | None:
        """Lines by another process stand between these; nobody draws into a bar."""
        return self if type(self) is Progress else None


class ProgressBar(Progress):
    """A bar that fills as the load factor nears the upper end of its bracket.

    Then it fills as the change of the friction bound falls from 1 to the tolerance.
    """

    pause = 0.1
    _bar: Any = None

    def phase(self, name: str) -> None:
        """Show what begins beside the bar, if there is one."""
        if self._bar is not None:
            self._bar.set_postfix_str(name)

    def _show(self, name: str, share: float, text: str) -> None:
        if name != self._name:
            self.close()
            self._name = name
        if self._bar is None:
            from tqdm import tqdm

            form = "{desc}: {percentage:3.0f}%|{bar:20}| {postfix}"
            self._bar = tqdm(total=1.0, desc=name, bar_format=form, file=sys.stdout)
        self._bar.n = max(self._bar.n, round(share, 2))
        self._bar.set_postfix_str(text)

    def close(self) -> None:
        """Leave the terminal clean."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


class SweepProgress:
    """A line for every point of a sweep, with the time that is left."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._before = 0

    def __call__(self, done: int, total: int, point: Any) -> None:
        """Show a `sweeps.points.Point`; None tells how many are there before any is solved."""
        if point is None:
            self._start = time.perf_counter()
            self._before = done
            text = f"{done} of {counted(total, 'point')} are there already" if done else ""
        else:
            values = ", ".join(
                f"{key} = {f'{value:.6g}' if isinstance(value, float) else value}"
                for key, value in point.values.items()
            )
            passed = time.perf_counter() - self._start
            left = passed * (total - done) / max(done - self._before, 1)
            both = (point.load_factor, point.load_factor_negative)
            factors = " and ".join(f"{factor:.8g}" for factor in both if not math.isnan(factor))
            found = f"load factor {factors}" if point.solved else point.reason
            text = (
                f"{done:{len(str(total))}d} of {total}  {values}: {point.status}, {found}"
                f"   ({left:.0f} s left)"
            )
        if text:
            sys.stdout.write(text + "\n")
            sys.stdout.flush()


def summary(result: Result) -> str:
    """Load factor, bracket and verification of a result, in a few lines."""
    if result.status == "unstable":
        return f"unstable: {result.reason()}"
    lines = []
    units = result.scene.units
    for direction, end in result.ends.items():
        reversed_load = " (live load reversed)" if direction == "negative" else ""
        lines += _end_lines(f"load factor{reversed_load}", end, result.reason(end), units)
        lines += tilt_lines(result, end)
        lines += tension_lines(tie_arrays(result.layout, end.joints), units)
    lines += [WITHOUT_PATH] if any(end.proof for end in result.ends.values()) else []
    lines += [str(result.curve_end)] if result.curve_end else []
    for one in result.passes:  # on the way to the accuracy wished
        hinges = ", point hinges" if one.hinges == "points" else ""
        estimate = "not known" if np.isnan(one.estimate) else f"{one.estimate:.1e}"
        lines.append(
            f"accuracy: {one.displacements} displacements of degree {one.degree}{hinges}:"
            f" load factor {one.load_factor:.6g}, error {estimate}"
        )
    if result.inaccurate:
        lines.append(f"the accuracy wished is NOT REACHED: {result.inaccurate}")
    seconds = result.seconds
    lines.append(f"{result.factorizations} factorisations, {seconds['total']:.2f} s")
    return "\n".join(lines)


def tilt_lines(result: Result, end: Collapse) -> list[str]:
    """The angle at which a structure on a tilting table collapses."""
    angle = result.scene.tilt_angle(end.load_factor)
    if angle is None or end.status != "limit":
        return []
    side = "right" if angle * result.scene.live.body[0] >= 0.0 else "left"
    return [f"it collapses at a tilt of {abs(angle):.6g} degrees, down to the {side}"]


def tension_lines(ties: NamedArrays, units: Units) -> list[str]:
    """Forces of ties, one by one."""
    if "state" not in ties:
        return []
    texts = []
    for name, force, state in zip(ties["name"], ties["force"], ties["state"], strict=True):
        carried = f" {units.force(force, 4)}" if state != TieState.SLACK else ""
        texts.append(f"{name}{carried} ({TieState(state).name.lower()})")
    return [f"ties: {', '.join(texts)}"]


def _end_lines(name: str, end: Collapse, reason: str, units: Units) -> list[str]:
    """One end of the range of load factors, and its verification."""
    if end.status == "unbounded":
        return [f"{name}: unbounded, {reason}"]
    status = end.status.replace("_", " ").upper()
    listed = reason.replace("; ", "\n  ")  # what was tried in lines of their own
    found = end.state is not None and not np.isnan(end.load_factor)
    if end.certificate is None or not found or end.status == "no_equilibrium":
        known = end.bounds.lower is not None or end.bounds.upper is not None
        bracket = [f"bracket: {end.bounds}, whatever was found"] if known else []
        return [f"{name}: {status}, {listed}", *bracket]
    first = f"{name} = {end.load_factor:.8g}   bracket: {end.bounds}"
    certificate = end.certificate
    if end.status != "limit":
        return [first, f"{status}: this is not a limit load; {listed}"]
    equilibrium, friction = (certificate.residuals[law] for law in ("equilibrium", "friction"))
    if end.bounds.meet and not end.changes_blocks and not end.rolling:
        first += "; no other collapse state exists"
    return [
        first,
        *filter(None, [end.proof]),
        f"verified{' as drawn, but blocks roll' if end.rolling else ''}: equilibrium"
        f" {equilibrium:.0e}, friction {friction:.0e}, gap {certificate.gap:.0e} to the limit load"
        " for the friction of this state",
        *(line for answer in end.told for line in answer.lines(end, units)),
        *(f"warning: {text}" for text in (end.pressed, end.contradiction) if text),
    ]


def description(layout: Layout) -> str:
    """Blocks, joints, supports and loads of a scene, and what will be skipped, in lines."""
    scene = layout.scene
    units = scene.units
    bodies = layout.bodies
    boundary = layout.boundary
    mesh = scene.mesh
    cells = mesh.domain.topology.index_map(2).size_global
    floating = int(bodies.floating.sum())
    lines = [
        scene.title or "(no title)",
        f"blocks: {mesh.body_count} ({floating} floating, {mesh.body_count - floating} held by"
        f" supports), {cells} cells, {layout.size} displacements,"
        f" area {layout.bodies_area():.6g} m2",
    ]
    joints = layout.joints.without_ties()
    for number, (name, law) in enumerate(zip(joints.names, joints.laws, strict=True)):
        mine = joints.law == number
        if not law.acts:
            what = (
                "glued: the blocks on both sides are one" if law.glued else "off: carries nothing"
            )
            lines.append(f"joint {name}: {what}")
            continue
        kind = "foundation" if np.any(joints.bodies[mine, 0] == GROUND) else "joint"
        lines.append(
            f"{kind} {name}: {_law_text(law, units)}, {int(mine.sum())} points,"
            f" length {units.length(joints.length[mine].sum())}"
        )
    lines += [f"tie {name}: {_tie_text(tie, units)}" for name, tie in scene.ties.items()]
    for name, kind in scene.supports.items():
        length = boundary.length[boundary.in_group(name)].sum()
        lines.append(f"support {name}: {kind}, length {units.length(length)}")
    for name, forces in (("dead", bodies.dead), ("live", bodies.live)):
        lines.append(f"{name} load: resultant {units.forces(forces[:, :2].sum(axis=0))}")
    profile = scene.live.profile
    if profile != "uniform":
        if not isinstance(profile, str):
            profile = ", ".join(f"{factor:g} at {height:g} m" for height, factor in profile)
        lines.append(f"live body force over the height: {profile}")
    lines += [text for kind in Answer.kinds.values() if (text := kind.asked_by(scene))]
    for name, strips in floor_strips(scene, boundary).items():
        floor = scene.floors[name]
        lies = f"{units.text(floor.force, 'N/m2')} on {units.length(strips.length(boundary).sum())}"
        lines.append(f"floor {name}: {lies}{', with its mass' if floor.mass else ''}")
    for name, movement in scene.dead.movement.items():
        by = units.place(movement.displacement, 6)
        lines.append(f"{name} moves by {by}, turns by {movement.rotation:g} degrees")
    lines += [f"skipped: {item}" for item in skipped(scene)]
    return "\n".join(lines)


def _law_text(law: JointLaw, units: Units) -> str:
    """Friction, strengths and gaps of a joint, as given."""
    text = "frictionless"
    if law.law == "tresca":
        text = f"shear strength {units.stress(law.bound or 0.0)}"
    elif law.law == "coulomb":
        text = f"Coulomb friction {law.friction:g}"
        text += f", cohesion {units.stress(law.cohesion)}" if law.cohesion else ""
        text += f", dilatancy {law.dilatancy:g} degrees" if law.dilatancy else ""
    strength = law.tensile_strength
    text += f", tensile strength {units.stress(strength)}" if strength else ""
    text += ", strength lost where it opens" * law.loses
    return text + (f", gaps up to {units.length(law.gap)}" if law.gap else "")


def _tie_text(tie: Tie, units: Units) -> str:
    """Ends of a tie, and what it carries, as given."""
    ends = [
        units.place(end, 6).removesuffix(" m") if isinstance(end, tuple) else f"{end}"
        for end in (tie.from_, tie.ground or tie.to)
    ]
    per = "N" if tie.spacing else "N/m"
    text = f"from {ends[0]} to {'the ground at ' if tie.ground else ''}{ends[1]}"
    text += f", yield {units.text(tie.yield_, per)}"
    text += f", stiffness {units.text(tie.stiffness, per)}/m" if tie.stiffness else ""
    text += f", prestress {units.text(tie.prestress, per)}" if tie.prestress else ""
    return text + (f", every {units.length(tie.spacing)}" if tie.spacing else "")
