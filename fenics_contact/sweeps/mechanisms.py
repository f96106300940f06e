"""The table of mechanisms: the limit load of every part and direction, each with its proof.

A part is pushed by its own weight; then what moved with it is pushed, too: its inertia is part of
the mechanism. Of the whole, what moved is repaired, and the next mechanism is looked for.
"""

from __future__ import annotations

import csv
import json
import logging
import math
import re
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, replace
from fnmatch import filter as fnfilter
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.errors import NoEquilibriumError, Stopped, checked, require
from fenics_contact.geometry.mesh import Flags
from fenics_contact.output.folder import filled_at_once, writing
from fenics_contact.parallel import MPI
from fenics_contact.results.block_view import ContactState
from fenics_contact.results.result import Collapse
from fenics_contact.results.values import TieState, tension_lines
from fenics_contact.scene.scene import GRAVITY
from fenics_contact.scene.units import Units
from fenics_contact.spatial.limit import solved, standing
from fenics_contact.spatial.picture import draw_collapse
from fenics_contact.spatial.record import BlockLimitLoad, result_record
from fenics_contact.spatial.scene import BlockScene
from fenics_contact.spatial.structure import ContactLaw
from fenics_contact.spatial.view import views_of
from fenics_contact.sweeps.parts import ABOVE, PushedPart, parts_of
from fenics_contact.sweeps.points import in_words, moving, seismic_check
from fenics_contact.workers import InPlace, asked_to_stop, last_result_of, result_of

_log = logging.getLogger("fenics_contact")

#: Mechanisms of the whole in one direction, each with those before it repaired, and their name.
MOST, NEXT = 2, ", next"
#: Strength of repaired contacts: all of them together could carry so many times the dead load.
REPAIR, REPAIRED = 10.0, "repaired"
#: Tensions below this part of a tie's yield are not told.
ROUNDING = 1e-3
#: The record, written last, and the columns of the table in mechanisms.csv.
RECORD = "mechanisms.json"
COLUMNS = (
    *("part", "way", "also", "status", "load_factor", "a0", "over_demand", "moves"),
    *("ties", "gap", "pushed_blocks", "repaired_blocks", "picture"),
)
#: What the record has of one of a limit load, for the assumptions.
ASSUMED = ("title", "version", "date", "dimension", "mesh", "scene", "acceleration", "warnings")
#: Why a search ended early.
OVER = "stopped: the time is over (solve.time)"


def _moving(result: BlockLimitLoad) -> Flags:
    """Which blocks move; none without a limit."""
    return moving(views_of(result)["positive"]) & (result.status == "limit")


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A row of the table.

    Attributes:
        part: What is pushed, with what moves with it.
        way: Where to, in words.
        result: The limit load, with its proof.
        pushed: Which blocks are pushed, shape (blocks,).
        repaired: Which ones are repaired.
        also: Parts and ways that have led to the same mechanism.
    """

    part: str
    way: str
    result: BlockLimitLoad
    pushed: Flags
    repaired: Flags
    also: tuple[str, ...] = ()

    @property
    def end(self) -> Collapse:
        """The collapse."""
        return self.result.ends["positive"]

    @property
    def check(self) -> Any:
        """The seismic check, a `SeismicCheck`; None if there is none."""
        return seismic_check(self.end)

    @property
    def moves(self) -> str:
        """What moves, and how, in words; without a limit why."""
        limits = self.result.limits
        return in_words(views_of(self.result)["positive"]) if limits else self.end.reason

    @property
    def line(self) -> str:
        """What is pushed, where to, and what was found."""
        found = f"{self.end.load_factor:.4g} g" if self.end.status == "limit" else "no limit"
        seismic = f"  a0* = {self.check.value_and_verdict}" if self.check else ""
        return f"{self.part} {self.way}: {found}{seismic}"

    @property
    def rank(self) -> tuple[bool, float]:
        """Its place in the table: the worst first, what has no limit last."""
        value = self.check.acceleration if self.check else self.end.load_factor
        return self.end.status != "limit", value

    def record(self) -> dict[str, Any]:
        """The row as files have it; numbers are None where there is no limit."""
        end, check = self.end, self.check
        found = end.status == "limit"
        return {
            "part": self.part,
            "way": self.way,
            "line": self.line,
            "also": "; ".join(self.also),
            "status": end.status,
            "load_factor": end.load_factor if found else None,
            "a0": check.acceleration if check else None,
            "over_demand": check.acceleration / check.demand if check and check.demand else None,
            "moves": self.moves,
            "ties": self._ties(self.result.wording.units),
            "ties_in_report": self._ties(self.result.wording.units.of_report),
            "pushed_blocks": int(self.pushed.sum()),
            "repaired_blocks": int(self.repaired.sum()),
            "gap": end.gap if found else None,
            "direction": list(self.result.scene.live.acceleration),
            "proof": end.proof,
            "residuals": end.residuals,
        }

    def _ties(self, units: Units) -> str:
        """What ties carry of which an end moves, beyond rounding."""
        view = views_of(self.result)["positive"]
        if "state" not in view.ties:
            return ""
        moves = np.append(_moving(self.result), False)  # the ground, -1, does not
        names, force = view.ties["name"], view.ties["force"]
        mine = np.isin(names, names[moves[view.tie_blocks].any(axis=1)])
        mine &= (force > ROUNDING * view.ties["yield"]) | (view.ties["state"] == TieState.SLACK)
        (line,) = tension_lines({key: values[mine] for key, values in view.ties.items()}, units)
        return line.text


@dataclass(frozen=True, eq=False)
class Mechanisms:
    """The table of mechanisms.

    Attributes:
        scene: What was asked for.
        rows: One for each mechanism, the worst first: by a0* where it is asked for, else by load
            factor.
        stopped: Why the search ended early; empty where it did not.
    """

    scene: BlockScene
    rows: Sequence[Mechanism]
    stopped: str = ""

    def __repr__(self) -> str:
        """The table as text, each row with what moves below it."""
        lines = []
        for number, row in enumerate(self.rows, 1):
            one = row.record()
            lines.append(f"{number:3}  {row.line}")
            also, ties = (f"{key}: {one[key]}" * bool(one[key]) for key in ("also", "ties"))
            lines += [f"       {text}" for text in (one["moves"], also, ties) if text]
        return "\n".join(lines)

    def write(self, folder: Path) -> None:
        """Write mechanisms.csv, mechanisms.json and a picture of every row into a folder.

        Raises:
            OutputError: If a file cannot be written; the folder is then as it was.
        """
        with filled_at_once(folder, RECORD, MPI.COMM_SELF) as hidden, writing(MPI.COMM_SELF):
            records = [row.record() for row in self.rows]
            for number, (row, one) in enumerate(zip(self.rows, records, strict=True), 1):
                output = replace(self.scene.output, formats=("png",))
                if _moving(row.result).any() and self.scene.output.pictures:
                    one["picture"] = f"{number:02}_{re.sub('[^A-Za-z0-9.+-]+', '_', one['part'])}"
                    one["picture"] += f"_{row.way.replace(' ', '_')}.png"
                    draw_collapse(row.result, hidden, output)
                    (hidden / "collapse.png").rename(hidden / one["picture"])
            with (hidden / "mechanisms.csv").open("w", encoding="utf-8", newline="") as file:
                table = csv.DictWriter(file, COLUMNS, extrasaction="ignore", lineterminator="\n")
                table.writeheader()
                table.writerows(records)
            given = result_record(BlockLimitLoad(self.scene, self.scene.structure(), {}))
            remarks = list(dict.fromkeys(text for row in self.rows for text in row.result.remarks))
            record = {key: given[key] for key in ASSUMED} | {"stopped": self.stopped}
            text = json.dumps({**record, "remarks": remarks, "rows": records}, indent=1)
            (hidden / RECORD).write_text(text + "\n", encoding="utf-8")


@checked
def mechanisms(
    scene: BlockScene,
    exclude: Sequence[str] = (),
    *,
    angles: Sequence[float] = (),
    stop: Callable[[], str] = asked_to_stop,
    beside: Executor | None = None,
    tell: Callable[[int, int, Mechanism | None], None] = lambda done, total, row: None,
) -> Mechanisms:
    """Find the mechanisms of the parts of a structure and of the whole.

    Args:
        scene: Rigid blocks; of the live load the size of `body` counts, not its direction.
        exclude: Parts, groups or blocks that are repaired: their contacts are stronger than any
            load; `*` stands for anything.
        angles: Directions in plan in which the whole is pushed, degrees from x towards y; by
            default along the axes.
        stop: Asked now and then who wants the search to end, in words; empty while nobody does.
        beside: Does whole tasks beside this process, see `fenics_contact.workers`.
        tell: Told how many searches are done, of how many, and of every row as it is found; of
            None at first.

    Returns:
        The table; of what was found by then where it is stopped or `solve.time` is over.

    Raises:
        InputError: If the scene has loads that are no weights, or a name is wrong.
        NoEquilibriumError: If the dead load has no state.
    """
    live = scene.live
    text = (
        "mechanisms are pushed by weights, on ground at rest: leave out loads.live.traction, .force"
    )
    text += " and loads.dead.movement; a mass on the walls is [floors.NAME] with mass = true"
    require(not (live.traction or live.force or scene.dead.movement), text)
    turned = [one for one in angles if isinstance(one, (int, float)) and math.isfinite(one)]
    require(len(turned) == len(angles), f"angles = {list(angles)} must be numbers, degrees")
    require(scene.dimension == 3 or not turned, "angles are in plan, of structures in space")
    rest = standing(scene)
    if rest.status != "equilibrium":
        raise NoEquilibriumError(f"the dead load has no equilibrium: {rest.reason()}")
    for text in rest.warnings:
        _log.warning("warning: %s", text)
    whole, *parts = parts_of(views_of(rest)["positive"], _floors(scene), angles)
    repaired = np.isin(np.arange(len(whole.blocks)), _named(scene, parts, exclude))
    deadline = time.monotonic() + (scene.solve.time or math.inf)
    search = _Search(scene, repaired, deadline)
    executor = beside or InPlace()
    rows: list[Mechanism] = []
    stopped, done = "", 0
    left = [part for part in parts if np.any(part.blocks & ~repaired)]
    total = sum(len(part.ways) for part in (whole, *left))

    def check_stop() -> None:
        if reason := search.over() or stop():
            raise Stopped(reason)

    def run(task: Callable[..., list[Mechanism]], orders: Iterable[tuple[Any, ...]]) -> None:
        """Add the rows of tasks; those found by then once the search is to end."""
        nonlocal stopped, done
        for one in [executor.submit(task, *order) for order in orders]:
            try:
                check_stop()
                found = result_of(one, check_stop)
            except Stopped as end:
                stopped = f"{end}; parts that were not asked may be worse"
                found = last_result_of(one, executor) or []
            done += bool(found)
            for row in found:
                tell(done, total, row)
            rows.extend(found)

    tell(0, total, None)
    run(search.of_whole, [(whole, way) for way in whole.ways])
    none = np.zeros(len(repaired), dtype=bool)
    first = {row.way: _moving(row.result) for row in reversed(rows)}
    orders = [(part, way, first.get(way.split()[-1], none)) for part in left for way in part.ways]
    likes = [(_alike(moves, part), way.split()[-1]) for part, way, moves in orders if moves.any()]
    most = {axis: like for like, axis in sorted(likes)}  # the largest one of each
    orders = [
        (part, way, moves if _alike(moves, part) == most.get(way.split()[-1]) else none)
        for part, way, moves in orders
    ]
    run(search.of_part, orders)
    return Mechanisms(scene, _once(sorted(rows, key=lambda row: row.rank)), stopped)


def _once(rows: Iterable[Mechanism]) -> list[Mechanism]:
    """One row for each mechanism, of rows with the worst first: the others are named in it.

    The next mechanism of the whole is none where a part that has its blocks collapses before, the
    same way, by what is not repaired.
    """
    found: dict[tuple[Any, ...], Mechanism] = {}
    for row in rows:
        pushes = tuple(np.round(row.result.scene.live.body, 6))
        same = pushes, row.moves if row.result.limits else row.part
        moves = _moving(row.result)
        before = [one for (way, _), one in found.items() if way == pushes]
        have = [_moving(one.result) for one in before if np.all(one.pushed[moves])]
        if twin := found.get(same):
            found[same] = replace(twin, also=(*twin.also, f"{row.part} {row.way}"))
        elif not (row.part.endswith(NEXT) and np.any([one & ~row.repaired for one in have])):
            found[same] = row
    return list(found.values())


def _alike(moves: Flags, part: PushedPart) -> float:
    """The share of the blocks that move, or are a part's, of which both holds."""
    return float(np.sum(moves & part.blocks) / np.sum(moves | part.blocks))


def _floors(scene: BlockScene) -> list[float]:
    """Heights of floors below the top, m."""
    moving = [block for block in scene.blocks if not block.fixed]
    tops = [float(block.extent[1][2]) for block in moving if block.group == "floors"]
    given = [floor.height for floor in scene.floors.values() if floor.height is not None]
    top = max(float(block.extent[1][2]) for block in moving)
    return [round(level, 3) for level in (*tops, *given) if level < top - ABOVE]


def _named(scene: BlockScene, parts: Sequence[PushedPart], names: Sequence[str]) -> list[int]:
    """Numbers of the blocks of parts, groups or blocks with these names.

    Raises:
        InputError: If there are none of a name; the message has all such names.
    """
    called = {
        number: {block.name, block.group, *(part.name for part in parts if part.blocks[number])}
        for number, block in enumerate(scene.blocks)
        if not block.fixed
    }
    mine = {n: [k for k, own in called.items() if fnfilter(own, n)] for n in names}
    wrong = ", ".join(f"'{name}'" for name, those in mine.items() if not those)
    known = ", ".join(f"'{part.name}'" for part in parts)
    text = f"exclude: there is no part, group or block {wrong}; the parts are {known}"
    require(not wrong, f"{text}; * stands for anything")
    return [number for those in mine.values() for number in those]


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for mechanisms of parts; its tasks return what was found before they were stopped.

    Attributes:
        scene: What is searched.
        repaired: Blocks that are repaired from the beginning, shape (blocks,).
        deadline: When it ends, by the monotonic clock, s.
    """

    scene: BlockScene
    repaired: Flags
    deadline: float

    def over(self) -> str:
        """Why it is to end; empty while it may go on."""
        return OVER if time.monotonic() > self.deadline else asked_to_stop()

    def check_stop(self) -> None:
        """Raise `Stopped` once it is to end."""
        require(not self.over(), self.over(), Stopped)

    def row(
        self, part: PushedPart, way: str, pushed: Flags, repaired: Flags, quick: bool
    ) -> Mechanism:
        """The limit load of a part with some blocks pushed, and some repaired.

        The contacts of repaired blocks are stronger than any load: what stands without that does so
        with it.

        Raises:
            Stopped: If the search is to end.
        """
        scene = self.scene
        size = math.hypot(*scene.live.acceleration) or GRAVITY
        body = size * part.ways[way][:: 4 - scene.dimension]
        options: dict[str, Any] = {"direction": "positive", "states": "first", "beyond": False}
        options |= {"time": None, "fast": True, "lowest": None, "peak": None, "quick": quick}
        scene = replace(
            scene,
            live=replace(scene.live, body=tuple(body.tolist()), angle=None),
            solve=replace(scene.solve, **options),
            title=f"{scene.title}: {part.name} {way}".removeprefix(": "),
            output=replace(scene.output, capacity=0),
            seismic=scene.seismic and replace(scene.seismic, nonlinear=False),
        )
        whole = scene.structure()
        areas = [contact.area for contact in whole.contacts]
        strength = REPAIR * np.abs(whole.dead[:, :3]).sum() / np.median(areas)
        strong = ContactLaw(1.0, strength, tensile_strength=strength, key=REPAIRED)
        glued = [repaired[[one.first, one.second]].any() for one in whole.contacts]
        laws = tuple(strong if g else law for g, law in zip(glued, whole.laws, strict=True))
        live = np.where(pushed[:, None], whole.live, 0.0)
        require(bool(np.any(live)), f"{part.name}: no block of it has a weight that pushes")
        structure = replace(whole, laws=laws, live=live)
        end = solved(structure, scene, "positive", self.check_stop, stands=True)
        require(not end.stopped, end.stopped, Stopped)
        result = BlockLimitLoad(scene, structure, {"positive": end})
        return Mechanism(part.name, way, result, pushed, repaired)

    def of_whole(self, whole: PushedPart, way: str) -> list[Mechanism]:
        """Mechanisms under the weight of all blocks, each with those before it repaired.

        One that breaks what is repaired says how strong that was taken, and is none.
        """
        rows: list[Mechanism] = []
        repaired, quick = self.repaired, self.scene.solve.quick
        with suppress(Stopped):
            while len(rows) < MOST:
                row = self.row(whole, way, whole.blocks, repaired, quick)
                moves = _moving(row.result)
                parts = views_of(row.result)["positive"].contacts.state != ContactState.STICK
                glued = np.array([law.key == REPAIRED for law in row.result.structure.laws])
                if rows and (not moves.any() or np.any(parts & glued)):
                    break
                rows.append(replace(row, part=row.part + NEXT * bool(rows)))
                repaired = repaired | moves
        return rows

    def of_part(self, part: PushedPart, way: str, moves: Flags) -> list[Mechanism]:
        """The mechanism of a part that is pushed with what moves with it.

        Args:
            part: Which one.
            way: Where to.
            moves: Blocks of the first mechanism of the whole this way, where it is most like that
                of this part: it is pushed with these, too, and the worse one counts.
        """
        quick = self.scene.solve.quick
        mine = part.blocks
        with suppress(Stopped):
            own = self.row(part, way, mine, self.repaired, True)

            def row(pushed: Flags) -> Mechanism:
                known = quick and np.array_equal(pushed, mine)
                return own if known else self.row(part, way, pushed, self.repaired, quick)

            rows = [row(mine | _moving(own.result))]
            if moves.any() and np.any((mine | moves) != rows[0].pushed):
                rows.append(row(mine | moves))
            rows = [one for one in rows if np.any(_moving(one.result) & mine)] or [row(mine)]
            return [min(rows, key=lambda one: (one.end.status != "limit", one.end.load_factor))]
        return []
