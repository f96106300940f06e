"""Text for people at the console: what is in a scene, how a solve goes on, what it found."""

from __future__ import annotations

import logging
import math
import re
import shutil
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

from fenics_contact.discretization.layout import Layout
from fenics_contact.discretization.loads import floor_strips
from fenics_contact.results.bounds import LimitBounds, counted
from fenics_contact.results.history import CapacityPoint, Step, TracePoint
from fenics_contact.results.result import NOT_KNOWN, Answer, ByDirection, Collapse
from fenics_contact.results.values import soil_forces
from fenics_contact.results.wording import DEAD, Line, Wording, state_in_words
from fenics_contact.scene.scene import Shared
from fenics_contact.scene.units import Units
from fenics_contact.scene.words import (
    floor_text,
    law_text,
    material_text,
    movement_text,
    tie_ends,
    tie_text,
)

#: Back to the start of a line of a terminal, and what is on it is gone.
OVER = "\r\033[K"


class Progress:
    """How a solve goes on, in lines: for `-v`.

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
            self._write(f"{name}\n")

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
        text = f"load factor {point.load_factor:.6g}{bound}  displacement {moved}"
        self._show(direction, min(max(share, 0.0), 1.0), text, f"{point.phase}  {text}")

    def step(self, direction: str, step: Step) -> None:
        """Show one pass of the fixed point."""
        self._count = self._count + 1 if direction == self._name else 1
        gained = min(max(-math.log10(max(step.bound_change, 1e-300)), 0.0), self._digits)
        sign = -1.0 if direction == "negative" else 1.0
        text = f"load factor {sign * step.load_factor:.8g}"
        known = math.isfinite(step.contraction)
        contraction = f"  contraction {step.contraction:.2f}" if known else ""
        more = (
            f"pass {self._count:3d}  {text}  change of the bound {step.bound_change:.1e}"
            f"{contraction}  factorisations {step.factorizations}"
        )
        self._show(direction, gained / self._digits, text, more)

    def point(self, done: int, total: int, point: CapacityPoint) -> None:
        """Show one point of the capacity curve."""
        text = f"{done} of {total}  {point.load_factor:.6g}"
        self._show("capacity", done / total, text, text)

    def _show(self, name: str, share: float, text: str, more: str) -> None:
        """Show how far the solve is: a share of a part with a name, in few words and in all."""
        self._name = name
        self._write(f"{name}: {more}\n")

    def _write(self, text: str) -> None:
        sys.stdout.write(text)
        self._flushed = time.monotonic()
        sys.stdout.flush()

    def close(self) -> None:
        """Leave the console clean."""

    def of_worker(self) -> Progress | None:
        """Lines by another process stand between these; nobody draws into the line below."""
        return self if type(self) is Progress else None


class ProgressLine(Progress):
    """One line on a terminal, written over itself, and gone at the end.

    Its share grows as the load factor nears the upper end of its bracket, then as the change of the
    friction bound falls from 1 to the tolerance.
    """

    pause = 0.1
    _shares: ClassVar[Mapping[str, str]] = {"positive": "", "negative": "live load reversed  "}
    _share = 0.0

    def __init__(self, tolerance: float) -> None:
        """Make room for messages, too."""
        super().__init__(tolerance)
        logging.getLogger("fenics_contact").addFilter(self._make_room)

    def _make_room(self, record: logging.LogRecord) -> bool:
        self._write(OVER)
        return True

    def phase(self, name: str) -> None:
        """Show what begins."""
        self._over(name)

    def _show(self, name: str, share: float, text: str, more: str) -> None:
        self._share = max(share, self._share) if name == self._name else share
        self._name = name
        self._over(f"{self._share:4.0%}  {self._shares.get(name, f'{name} ')}{text}")

    def _over(self, text: str) -> None:
        """Write over what is there; a line that is too long would leave its first part."""
        self._write(f"{OVER}{text[: shutil.get_terminal_size().columns - 1]}")

    def close(self) -> None:
        """Leave the terminal clean."""
        logging.getLogger("fenics_contact").removeFilter(self._make_room)
        self._write(OVER)


class SweepProgress:
    """A line for every one of many limit loads, with the time that is left."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._before = 0

    def __call__(self, done: int, total: int, found: Any) -> None:
        """Show the `line` of a point of a sweep, or of a mechanism.

        None tells how many are there before any is solved.
        """
        if found is None:
            self._start = time.perf_counter()
            self._before = done
            text = f"{done} of {counted(total, 'point')} are there already" if done else ""
        else:
            passed = time.perf_counter() - self._start
            left = passed * (total - done) / max(done - self._before, 1)
            text = f"{done:{len(str(total))}d} of {total}  {found.line}   ({left:.0f} s left)"
        if text:
            sys.stdout.write(text + "\n")
            sys.stdout.flush()


#: Parts of a reason that say what was tried: they are for `-v`.
TRIED = re.compile(" search |no state|the path |allowed")


def summary(result: ByDirection, verbose: bool = False) -> str:
    """What was found, in some five lines; with all that is known of it, if that is wished."""
    found, more = answer(result, result.wording)
    lines = [*found, *more]
    if verbose:
        lines += ["", *_details(result, result.wording)]
        for name, told in result.mechanisms().items():
            lines.append(f"{f'mechanism {result.wording.way(name)}'.rstrip()}: {told}")
    return "\n".join(lines)


def answer(result: ByDirection, words: Wording) -> tuple[list[str], list[str]]:
    """What was found, in lines for everybody.

    Returns:
        The collapse, or why none is known; other states, ranges, and what else was asked.
    """
    if not result.ends:
        return [state_in_words("unstable", DEAD, result.reason(), proved=True)], []
    limits = result.limits
    amounts: dict[str, list[str]] = {}
    for name, end in limits.items():
        head = f"{end.searched}:" if end.searched else "it collapses at"
        drawn = " as drawn, but blocks roll" if end.rolling else ""
        form = f"{head} {{}} (verified{drawn})"
        amounts.setdefault(form, []).append(words.amount(end.load_factor, name, end.digits))
    found = [form.format(", ".join(known)) for form, known in amounts.items()]
    others = {name: end for name, end in result.ends.items() if name not in limits}
    lost = (_without_limit(end, result.reason(end), words, name) for name, end in others.items())
    found += dict.fromkeys(lost)
    told: list[tuple[str, Line]] = []
    for name, end in result.ends.items():
        answers = [line for answer in end.told for line in answer.lines(end, words)]
        mine = [line for line in answers if not line.verbose]
        if name in limits:
            mine += _bracket(end, words, alone=not any(line.states for line in mine))
            mine += result.own_lines(end, words)
        told += [(name, line) for line in mine]
    return found, words.together(told, limits or others) + result.remarks


def _without_limit(end: Collapse, reason: str, words: Wording, direction: str) -> str:
    """What is known where no limit load was found, in a sentence."""
    way = f" {words.way(direction)}".rstrip()
    if end.status == "unbounded":
        first, _, blocks = reason.partition(": ")
        return f"{first}{way}: {blocks}; if it really acts so, give a compressive_strength"
    at = words.under(end.given or 0.0)
    if end.given is not None and end.status != "no_equilibrium":
        return state_in_words(end.status, at, reason, proved=True)
    clauses = [part for part in reason.split("; ") if part != NOT_KNOWN and not TRIED.search(part)]
    because = "; ".join(part for part in clauses if not part.startswith("try "))
    because += ": " if because else ""
    if end.status == "no_equilibrium":
        return f"{because}{state_in_words(end.status, at, '', proved=False)}"
    parts = [f"{because}no collapse was found{way}"]
    known = end.bounds.lower, end.bounds.upper
    if not end.changes_blocks and any(one is not None and math.isfinite(one) for one in known):
        ends = [
            None if one is None or math.isinf(one) else words.number(one, end.sign)
            for one in known[:: 1 if end.sign > 0.0 else -1]
        ]
        told = LimitBounds(ends[0], ends[1]).told("{:.3g}".format)
        told = f"all collapse states are at {ends[1]:.4g}" if end.bounds.meet else f"it is {told}"
        parts.append(f"{told} {words.unit}")
    return "; ".join([*parts, *(part for part in clauses if part.startswith("try "))])


def _bracket(end: Collapse, words: Wording, alone: bool) -> Iterator[Line]:
    """What the bracket says of a limit load; with its lower end, where no state is told of."""
    bounds = end.bounds
    if end.changes_blocks or end.rolling or not end.in_bracket:
        return
    if bounds.meet:
        yield Line("no other collapse state exists", states=True)
        return
    lower, upper = [bounds.lower, bounds.upper][:: 1 if end.sign > 0.0 else -1]
    if alone and lower:
        least = words.beside(lower, end.load_factor, end.sign, -1)
        yield Line("no collapse state is below", least, states=True)
    if bounds.reason:
        yield Line(f"whether other collapse states are lower is {bounds.reason}", states=True)
    if upper is not None and math.isfinite(upper):
        most = words.beside(upper, end.load_factor, end.sign, 1)
        times = " times" * words.forces  # beside the force itself
        yield Line("nothing carries more than", f"{most}{times}", states=True)


def _details(result: ByDirection, words: Wording) -> list[str]:
    """Brackets, residuals, what is not known and why, work and time."""
    lines = []
    for direction, end in result.ends.items():
        reversed_load = " (live load reversed)" if direction == "negative" else ""
        lines += _end_lines(f"load factor{reversed_load}", end, result.reason(end), words)
        if end.status != "limit":
            ties = [(direction, line) for line in result.own_lines(end, words)]
            lines += words.merged(ties, [direction])
        lines += [
            f"tried: {one.name}: {one.outcome}, {counted(one.factorizations, 'factorisation')}"
            for one in end.attempts
        ]
    total = result.seconds.get("total", 0.0)
    work = counted(result.factorizations, "factorisation")
    return [*lines, *result.details, f"{work}, {total:.2f} s"]


def state_lines(
    status: str, load_factor: float, reason: str, residuals: Mapping[str, float]
) -> list[str]:
    """A state at a given load factor, and its verification."""
    because = f": {reason}" if reason else ""
    lines = [f"{status.replace('_', ' ')} at load factor {load_factor:.8g}{because}"]
    if status == "equilibrium":
        found = ", ".join(f"{name} {value + 0.0:.0e}" for name, value in residuals.items())
        lines.append(f"verified: {found}")
    return lines


def _end_lines(name: str, end: Collapse, reason: str, words: Wording) -> list[str]:
    """One end of the range of load factors, and its verification."""
    if end.status == "unbounded":
        return [f"{name}: unbounded, {reason}"]
    if end.given is not None:
        return state_lines(end.status, end.given, reason, end.residuals)
    status = end.status.replace("_", " ")
    listed = reason.replace("; ", "\n  ")  # what was tried in lines of their own
    certificate = end.certificate
    if certificate is None or math.isnan(end.load_factor) or end.status == "no_equilibrium":
        known = end.bounds.lower is not None or end.bounds.upper is not None
        bracket = [f"bracket: {end.bounds}, whatever was found"] if known else []
        return [f"{name}: {status}, {listed}", *bracket]
    first = f"{name} = {end.load_factor:.8g}   bracket: {end.bounds}"
    if end.status != "limit":
        return [first, f"{status}: this is not a limit load; {listed}"]
    equilibrium, friction = (certificate.residuals[law] for law in ("equilibrium", "friction"))
    answers = [line for answer in end.told for line in answer.lines(end, words)]
    return [
        first,
        *filter(None, [end.proof]),
        f"verified: equilibrium {equilibrium:.0e}, friction {friction:.0e}, gap"
        f" {certificate.gap:.0e} to the limit load for the friction of this state",
        *(f"{line.head} {line.text}" for line in answers if line.verbose),
    ]


def description(layout: Layout, verbose: bool = False) -> str:
    """Blocks, joints, supports and loads of a scene with a mesh, in lines.

    With unknowns and joint points, if that is wished.
    """
    scene = layout.scene
    units = scene.units
    bodies = layout.bodies
    boundary = layout.boundary
    count = scene.mesh.body_count
    cells = scene.mesh.domain.topology.index_map(2).size_global
    floating = int(bodies.floating.sum())
    blocks = (
        f"blocks: {count} ({floating} floating, {count - floating} held by supports),"
        f" {f'{cells} cells, {layout.size} displacements, ' * verbose}"
        f"area {layout.bodies_area():.6g} m2"
    )
    touching = {}
    for row in law_contacts(layout):
        points = f"{row['points']} points, " * verbose
        key = f"{row['kind']}s.{row['group']}"
        touching[key] = f"{points}length {units.length(row['length'])}"
    strips = floor_strips(scene, boundary).items()
    lies = {name: f"on {units.length(one.length(boundary).sum())}" for name, one in strips}
    more = []
    for one in soil_forces(layout, None):
        soil = scene.soil[one.name]
        least, most = soil.coefficients
        more.append(
            f"soil {one.name}: on {soil.at}, surface at {units.length(soil.level)},"
            f" k_a {least:.4g}, k_p {most:.4g}, presses with {units.force(one.active)} to"
            f" {units.force(one.passive)}"
        )
    for name, kind in scene.supports.items():
        length = boundary.length[boundary.in_group(name)].sum()
        more.append(f"support {name}: {kind}, length {units.length(length)}")
    loads = {"dead": bodies.dead, "live": bodies.live}
    resultants = {name: force[:, :2].sum(axis=0) for name, force in loads.items()}
    return "\n".join(scene_lines(scene, units, [blocks], touching, lies, more, resultants))


def law_contacts(layout: Layout) -> list[dict[str, Any]]:
    """Where the laws of a scene with a mesh act: group, kind, number of points, and length, m."""
    joints = layout.joints.without_ties()
    found = []
    for number, key in enumerate(layout.scene.laws()):
        kind, _, name = key.partition("s.")
        mine = joints.law == number
        length = float(joints.length[mine].sum())
        row = {"group": name, "kind": kind, "points": int(mine.sum()), "length": length}
        found.append(row)
    return found


def scene_lines(
    scene: Shared,
    units: Units,
    blocks: Sequence[str],
    touching: Mapping[str, str],
    lies: Mapping[str, str],
    more: Sequence[str],
    resultants: Mapping[str, Sequence[float]],
) -> list[str]:
    """What is in a scene, in lines.

    Args:
        scene: With a mesh or of rigid blocks.
        units: In which it is told.
        blocks: Lines on its blocks.
        touching: Number and size of the contacts of each law, by its key.
        lies: On what each floor lies, by name.
        more: Lines behind ties and floors.
        resultants: Of the loads, N (per metre of thickness), by name.
    """
    tables = scene.tables()
    lines = [scene.title or "(no title)", *blocks]
    gravity = math.hypot(*scene.dead.acceleration)
    for name, material in tables["materials"].items():
        lines.append(f"material {name}: {material_text(material, gravity, units)}")
    for key, law in scene.laws().items():
        kind, _, name = key.partition(".")
        where = f", {touching[key]}" if law.acts else ""
        lines.append(f"{kind[:-1]} {name}: {law_text(vars(law), units)}{where}")
    for name, tie in tables["ties"].items():
        lines.append(f"tie {name}: {tie_ends(tie, units)}, {tie_text(tie, units)}")
    for name, floor in tables["floors"].items():
        lines.append(f"floor {name}: {floor_text(floor, units)}, {lies[name]}")
    for name, movement in scene.dead.movement.items():
        lines.append(f"{name} {movement_text(vars(movement), units)}")
    lines += more
    for name, force in resultants.items():
        lines.append(f"{name} load: resultant {units.forces(force)}")
    profile = scene.live.profile
    if profile != "uniform":
        if not isinstance(profile, str):
            profile = ", ".join(f"{factor:g} at {height:g} m" for height, factor in profile)
        lines.append(f"live body force over the height: {profile}")
    return lines + [text for kind in Answer.kinds.values() if (text := kind.asked_by(scene))]
