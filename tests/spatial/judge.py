"""A second program for structures in space, which shares no geometry with the first.

It builds bodies, contacts and equilibrium on its own (`judge_case`), asks Clarabel what can be
carried, and holds a result against that:

    python3 -m tests.spatial.judge --seeds 0-149

Of the result it takes the places and areas of points, once it found each inside a contact of its
own and each corner of its contacts among them; the forces there; and the motions of blocks.
"""

from __future__ import annotations

import argparse
import logging
import math
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import clarabel
import numpy as np
from scipy.sparse import coo_matrix, csc_matrix, diags, identity, vstack

from tests.spatial.judge_case import Array, Case, Points

#: Equilibrium and laws, in parts of the forces on a block.
FORCES = 1e-5
#: Closing of points in a mode, in parts of its largest relative motion.
CLOSING = 2e-5
#: Ends of programs agree, in parts of a load factor.
ENDS = 1e-5
#: What an upper end may be above the program's.
LOOSE = 1e-3
#: Rounds of given strengths by which a state of the dead load is looked for.
ROUNDS = 60
#: Strengths are those of the state's own pressures, in parts of the largest.
SETTLED = 1e-2


class Programs:
    """What points of a case carry: programs for Clarabel.

    Unknowns are a load factor, forces of points along normal and tangents, tensions of bars. Forces
    are in parts of `unit`, moments in parts of it times the size.
    """

    def __init__(self, case: Case, points: Points, held: Sequence[int] = ()) -> None:
        self.case, self.points = case, points
        laws = np.array([contact.law for contact in case.contacts]).reshape(-1, 4)[points.contact]
        self.friction, cohesion, self.dilatancy, tensile = laws.T
        self.axes = np.array([c.place.axes for c in case.contacts])[points.contact]
        ends = np.array([(c.first, c.second) for c in case.contacts])[points.contact]
        self.ends = np.vstack([ends, *(bar[0] for bar in case.bars)])
        lines = [np.diff(bar[1], axis=0)[0] for bar in case.bars]
        self.lines = np.array([line / np.linalg.norm(line) for line in lines]).reshape(-1, 3)
        self.places = [np.vstack([points.place, *(bar[1][e] for bar in case.bars)]) for e in (0, 1)]
        self.moving = [k for k in case.moving if k not in held]
        self.unit = max(float(np.abs(case.dead[:, :3]).max()), 1e-300)
        self.push = max(float(np.abs(case.live[:, :3]).max()), 1e-300)
        self.cohesion = cohesion * points.area / self.unit
        self.tensile = tensile * points.area / self.unit
        self.yields = np.array([bar[2] for bar in case.bars]) / self.unit
        self.count = len(points.area)
        self.matrix = self._equilibrium()

    def _equilibrium(self) -> Any:
        """Forces of points and bars to those on bodies that move."""
        count, bars = self.count, len(self.lines)
        row = np.full(len(self.case.bodies) + 1, -1)
        row[self.moving] = np.arange(len(self.moving))
        unknown = np.repeat(np.arange(count), 3) * 3 + np.tile(np.arange(3), count)
        unit = np.repeat(np.arange(count + bars), [3] * count + [1] * bars)
        unknown = np.append(unknown, 3 * count + np.arange(bars))
        way = np.vstack([self.axes.reshape(-1, 3), -self.lines])  # on the second end
        parts = []
        centroid = np.array([*(body.centroid for body in self.case.bodies), np.zeros(3)])
        for end, sign in ((0, -1.0), (1, 1.0)):
            body = self.ends[unit, end]
            arm = (self.places[end][unit] - centroid[body]) / self.case.size
            values = sign * np.hstack([way, np.cross(arm, way)])
            acts = row[body] >= 0
            index = 6 * row[body][acts, None] + np.arange(6)
            column = np.broadcast_to(unknown[acts, None], index.shape)
            parts.append((values[acts].ravel(), index.ravel(), column.ravel()))
        value, index, column = (np.concatenate(part) for part in zip(*parts, strict=True))
        return coo_matrix(
            (value, (index, column)), (6 * len(self.moving), 3 * count + bars)
        ).tocsc()

    def relative(self, motion: Array) -> Array:
        """Motions of second ends against first ones, m, shape (points + bars, 3).

        Along normal and tangents of points; of bars, that along them is first.
        """
        centroid = np.array([*(body.centroid for body in self.case.bodies), np.zeros(3)])
        moved = np.zeros((len(self.ends), 3))
        for end, sign in ((0, -1.0), (1, 1.0)):
            body = self.ends[:, end]
            arm = self.places[end] - centroid[body]
            moved += sign * (motion[body, :3] + np.cross(motion[body, 3:], arm))
        count = self.count
        found = np.zeros_like(moved)
        found[:count] = np.einsum("pki,pi->pk", self.axes, moved[:count])
        found[count:, 0] = np.einsum("bi,bi->b", self.lines, moved[count:])
        return found

    def scaled(self, load: Array, unit: float) -> Array:
        """A load of the bodies that move in the program's units."""
        return (load[self.moving] / (unit * np.repeat([1.0, self.case.size], 3))).ravel()

    def most(
        self, dead: Array, live: Array, strength: Array, slope: Array, cap: float = np.inf
    ) -> float:
        """The largest load factor, in units of `unit / push`; nan where nothing is carried."""
        cost = np.zeros(1 + self.matrix.shape[1])
        cost[0] = -1.0
        found = self._solve(0.0 * cost, cost, dead, live, strength, slope, cap)
        return found if isinstance(found, float) else float(found[0])

    def elastic(self, strength: Array, slope: Array, offset: Array) -> Array | None:
        """Forces of least energy under the dead load; None where there are none."""
        area = np.maximum(self.points.area, 1e-3 * max(self.points.area.max(), 1e-300))
        softness = np.median(area) / area
        bars = np.full(len(self.lines), 2.5)
        energy = np.concatenate([[1.0], np.outer(softness, [1.0, 2.5, 2.5]).ravel(), bars])
        cost = np.append(0.0, offset)
        none = np.zeros(self.matrix.shape[0])
        dead = self.scaled(self.case.dead, self.unit)
        found = self._solve(energy, cost, dead, none, strength, slope, 1.0)
        return None if isinstance(found, float) else found[1:]

    def _solve(
        self,
        energy: Array,
        cost: Array,
        dead: Array,
        live: Array,
        strength: Array,
        slope: Array,
        cap: float,
    ) -> Array | float:
        """Minimum of a cost over forces inside the cones; nan or infinity where there is none."""
        count, size = self.count, len(cost)
        every = identity(size, format="csr")
        normal, first, second = (every[1 + k : 1 + 3 * count : 3] for k in range(3))
        bars = every[1 + 3 * count :]
        rows = [vstack([csc_matrix(live).reshape(1, -1), self.matrix.T]).T, -normal, -bars, bars]
        most = [-dead, self.tensile, np.zeros(bars.shape[0]), self.yields]
        if math.isfinite(cap):
            rows.append(every[:1])
            most.append(np.array([cap]))
        signs = sum(len(part) for part in most[1:])
        cones = [clarabel.ZeroConeT(len(dead)), clarabel.NonnegativeConeT(signs)]
        still = (slope <= 0.0) & (strength <= 1e-12)
        if still.any():
            rows += [first[still], second[still]]
            most.append(np.zeros(2 * int(still.sum())))
            cones.append(clarabel.ZeroConeT(2 * int(still.sum())))
        free = np.flatnonzero(~still)
        if len(free):
            order = np.arange(3 * len(free)).reshape(3, -1).T.ravel()
            disc = vstack([-diags(slope[free]) @ normal[free], -first[free], -second[free]]).tocsr()
            rows.append(disc[order])
            most.append((strength[free, None] * [1.0, 0.0, 0.0]).ravel())
            cones += [clarabel.SecondOrderConeT(3)] * len(free)
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads, settings.max_iter = False, 1, 300
        for accuracy in (1e-10, 1e-8, 1e-6):
            for name in ("tol_gap_abs", "tol_gap_rel", "tol_feas"):
                setattr(settings, name, accuracy)
            found = clarabel.DefaultSolver(
                csc_matrix(diags(energy)),
                cost,
                csc_matrix(vstack(rows)),
                np.concatenate(most),
                cones,
                settings,
            ).solve()
            status = str(found.status)
            if status == "Solved":
                return np.array(found.x)
            if status in ("PrimalInfeasible", "DualInfeasible"):
                return np.nan if status == "PrimalInfeasible" else np.inf
        raise ArithmeticError(f"Clarabel: {status}")


@dataclass
class Verdict:
    """What is judged of one direction: what is wrong, or why there is no answer."""

    status: str
    load_factor: float
    wrong: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)
    none: str = ""

    @property
    def word(self) -> str:
        """In a word."""
        return "WRONG" if self.wrong else "none" if self.none else "right"


class Judge:
    """Judges the result of a scene's tables."""

    def __init__(self, tables: Mapping[str, Any], result: Any) -> None:
        self.case = case = Case(tables)
        self.structure = result.structure
        self.asked = tables.get("solve", {}).get("gap", 1e-3)
        points, self.unlike = case.points_of(self.structure)
        self.points = case.own_points() if np.any(points.contact < 0) else points
        self.alike = self.points is points
        self.programs = programs = Programs(case, self.points)
        self.dead = programs.scaled(case.dead, programs.unit)
        self.live = programs.scaled(case.live, programs.push)
        self.factor = programs.unit / programs.push
        self.known = {body.name: k for k, body in enumerate(case.bodies)}
        none = np.zeros_like(self.dead)
        laws = programs.cohesion, programs.friction
        self.falls = not programs.most(none, self.dead, *laws, cap=1.0) > 1.0 - 1e-6

    @cached_property
    def has_state(self) -> bool:
        """Whether a state of the dead load is found in which each friction is of its own pressure.

        States of least energy with strengths given by the one before, from that of free dilatancy.
        """
        programs = Programs(self.case, self.case.own_points())
        offset = self._offset(programs)
        free = programs.friction - programs.dilatancy

        def own(force: Array) -> Array:
            pressed = np.maximum(force[: 3 * programs.count : 3], -programs.tensile)
            return programs.cohesion + free * pressed

        force = programs.elastic(programs.cohesion, programs.friction, offset)
        if force is None:
            return False
        given = own(force)
        step = 1.0
        for _ in range(ROUNDS):
            after = own(force)
            if np.abs(after - given).max() < SETTLED * max(1.0, float(given.max())) and step < 1.0:
                return True
            tried = given + step * (after - given)
            found = programs.elastic(tried, programs.dilatancy, offset)
            if found is None:
                step *= 0.5
            else:
                given, force = tried, found
                step = min(0.5, 2.0 * step)
            if step < 1e-4:
                break
        return False

    def _offset(self, programs: Programs) -> Array:
        """Cost of forces where the ground moves: its work, in a unit that is as good as any."""
        moved = np.zeros((len(self.case.bodies) + 1, 6))
        for name, table in self.case.tables["loads"].get("dead", {}).get("movement", {}).items():
            turn = np.radians(table.get("rotation", np.zeros(3)))
            moved[self.known[name]] = np.append(table.get("displacement", np.zeros(3)), turn)
        young = max(m.get("young", 5e9) for m in self.case.tables["materials"].values())
        moving = [self.case.bodies[k].volume for k in self.case.moving]
        stiffness = young * np.median(programs.points.area) / np.mean(moving) ** (1.0 / 3.0)
        motion = programs.relative(moved)
        count = 3 * programs.count
        bars = motion[programs.count :, 0]
        return np.append(motion[: programs.count].ravel()[:count], bars) * stiffness / programs.unit

    def judged(self, found: Any) -> Verdict:
        """What is wrong with the result of one direction."""
        verdict = Verdict(found.status, found.load_factor)
        self.sign = found.sign
        verdict.wrong += self.unlike
        if not self.alike:
            verdict.doubts.append("judged with own points")
        if self.case.doubtful:
            verdict.doubts.append(f"{len(self.case.doubtful)} meetings of edges")
        if found.status in ("unstable", "no_equilibrium"):
            self._judge_fall(found, verdict)
        elif found.status in ("limit", "unbounded"):
            if self.falls:
                verdict.wrong.append("the dead load is not carried")
                return verdict
            if not self.has_state:
                verdict.wrong.append("nothing presses what would carry the dead load")
            self._judge_end(found, verdict)
        else:
            verdict.none = found.reason or found.status
            if self.falls:
                verdict.doubts.append("the dead load is not carried")
            else:
                end = self._associative()
                verdict.doubts.append(f"stands {self.has_state}, nothing above {end:.6g}")
        return verdict

    def judged_standing(self, found: Any) -> Verdict:
        """What is wrong with the state under the dead load alone."""
        verdict = Verdict(f"({found.status})", found.load_factor, list(self.unlike))
        if found.status in ("unstable", "no_equilibrium"):
            self._judge_fall(found, verdict)
        elif found.status != "equilibrium":
            verdict.none = found.reason
        elif self.falls or not self.has_state:
            verdict.wrong.append("it does not stand")
        elif self.alike:
            verdict.wrong += self._forces(found)
        return verdict

    def _associative(self) -> float:
        """The largest load factor with slip normal to the cones, in the direction asked."""
        programs = self.programs
        laws = programs.cohesion, programs.friction
        return self.factor * programs.most(self.dead, self.sign * self.live, *laws)

    def _judge_fall(self, found: Any, verdict: Verdict) -> None:
        """It falls, and the others stand where those that fall are held."""
        if not self.falls:
            if self.has_state:
                verdict.wrong.append("it stands under its dead load")
            else:
                verdict.doubts.append("carried by forces that nothing presses")
            return
        held = [self.known[self.structure.blocks[k].name] for k in found.falling]
        rest = Programs(self.case, self.points, held)
        if held and rest.moving:
            dead = rest.scaled(self.case.dead, rest.unit)
            part = rest.most(0.0 * dead, dead, rest.cohesion, rest.friction, cap=1.0)
            if not part > 1.0 - 1e-6:
                verdict.wrong.append("more blocks fall than are named")

    def _judge_end(self, found: Any, verdict: Verdict) -> None:
        """Upper end, forces, mode and gap."""
        end = self._associative()
        if found.status == "unbounded":
            if math.isfinite(end):
                verdict.wrong.append(f"nothing above {end:.6g}")
            return
        factor = self.sign * found.load_factor
        size = max(abs(factor), 1e-2 * self.factor)
        upper = self.sign * found.upper if math.isfinite(found.upper) else np.inf
        if factor < -max(self.asked, found.gap) * size:
            verdict.wrong.append("the load factor has the wrong sign")
        if factor > end + (ENDS + found.gap) * size:
            verdict.wrong.append(f"above what anything carries, {end:.7g}")
        if upper < end - ENDS * size:
            verdict.wrong.append(f"upper end {upper:.7g} is below {end:.7g}")
        elif upper > end + LOOSE * max(abs(end), 1e-2 * self.factor):
            verdict.doubts.append(f"upper end {upper:.6g} for {end:.6g}")
        if not math.isfinite(end):
            verdict.doubts.append("blocks wedge: no load is excluded")
        if self.alike:
            verdict.wrong += self._forces(found)
            verdict.wrong += self._mode(found, size)

    def _forces(self, found: Any) -> Iterator[str]:
        """What forces miss of equilibrium and laws, in parts of the forces on their bodies."""
        case, programs, count = self.case, self.programs, self.programs.count
        turned = [self.known[self.structure.blocks[c.first].name] for c in self.structure.contacts]
        given = self.structure.points.contact
        sign = np.where(np.array(turned)[given] == programs.ends[:count, 0], 1.0, -1.0)
        vectors = np.einsum("pk,pki->pi", found.force, self.structure.axes[:count])
        local = np.einsum("pki,pi->pk", programs.axes, sign[:, None] * vectors) / programs.unit
        self.normal = local[:, 0]
        shear = np.linalg.norm(local[:, 1:], axis=1)
        tension = found.tension / programs.unit
        unknown = np.append(local.ravel(), tension)
        loads = self.dead + found.load_factor / self.factor * self.live
        missing = np.abs(programs.matrix @ unknown + loads).reshape(-1, 6).max(axis=1)
        works = np.append(np.linalg.norm(local, axis=1), np.abs(tension))
        around = np.zeros(len(case.bodies) + 1)
        for end in (0, 1):
            np.add.at(around, programs.ends[:, end], works)
        each = np.abs(self.dead) + np.abs(found.load_factor / self.factor * self.live)
        around[programs.moving] += each.reshape(-1, 6)[:, :3].max(axis=1)
        around[[k for k, body in enumerate(case.bodies) if body.fixed]] = np.inf
        least = around[programs.ends[:count]].min(axis=1)
        for name, miss in {
            "equilibrium": missing / around[programs.moving],
            "pressure": (-self.normal - programs.tensile) / least,
            "friction": (shear - programs.cohesion - programs.friction * self.normal) / least,
            "ties": np.maximum(-tension, tension - programs.yields),
        }.items():
            if miss.max(initial=0.0) > FORCES:
                yield f"{name} missed by {miss.max():.1e}"

    def _mode(self, found: Any, size: float) -> Iterator[str]:
        """What the mode misses, and what can be carried with the friction of the state's forces."""
        programs, count = self.programs, self.programs.count
        motion = np.zeros((len(self.case.bodies) + 1, 6))
        for block, moved in zip(self.structure.blocks, found.mode, strict=True):
            motion[self.known[block.name]] = moved
        relative = programs.relative(motion)
        slip = np.linalg.norm(relative[:count, 1:], axis=1)
        opening = relative[:count, 0] - programs.dilatancy * slip
        own = programs.cohesion
        pressed = np.maximum(self.normal, -programs.tensile)
        own = own + (programs.friction - programs.dilatancy) * pressed
        power = own @ slip + programs.tensile @ np.maximum(opening, 0.0)
        power += programs.yields @ np.maximum(relative[count:, 0], 0.0)
        power -= float(np.vdot(self.case.dead, motion[:-1])) / programs.unit
        work = self.sign * float(np.vdot(self.case.live, motion[:-1])) / programs.push
        if -opening.min() > CLOSING * np.abs(relative).max():
            yield f"the mode closes by {-opening.min() / np.abs(relative).max():.1e}"
        if not work > 0.0:
            yield "the live load does no work"
        factor = self.sign * found.load_factor
        if not abs(self.factor * power / work - factor) < (found.gap + 1e-4) * size:
            yield f"power over work is {self.sign * self.factor * power / work:.7g}"
        most = self.factor * programs.most(
            self.dead, self.sign * self.live, own, programs.dilatancy
        )
        if not (most - factor) / size < found.gap * (1.0 + LOOSE) + ENDS:
            yield f"gap {found.gap:.1e} for {(most - factor) / size:.1e}"
        if most < factor - ENDS * size:
            yield f"its friction carries {self.sign * most:.7g} only"


def judge(tables: Mapping[str, Any]) -> tuple[dict[str, Verdict], float]:
    """Solve a scene and judge its directions; and the seconds that the solve took."""
    from fenics_contact.errors import InputError
    from fenics_contact.spatial import Scene, limit_load, standing

    start = time.perf_counter()
    try:
        scene = Scene.from_tables(tables, Path("."))
        result = limit_load(scene)
        state = standing(scene).ends["positive"]
    except InputError as error:
        return {"": Verdict("refused", np.nan, none=str(error))}, time.perf_counter() - start
    seconds = time.perf_counter() - start
    judging = Judge(tables, result)
    found = {name: judging.judged(end) for name, end in result.ends.items()}
    return found | {"stands": judging.judged_standing(state)}, seconds


def main() -> None:
    """Judge structures by their seeds, and print a table."""
    from tests.spatial.random_structures import structure

    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", default="0-149", help="FIRST-LAST, or seeds with commas")
    seeds = parser.parse_args().seeds
    first, _, last = seeds.partition("-")
    chosen = range(int(first), int(last) + 1) if last else map(int, seeds.split(","))
    logging.disable(logging.WARNING)
    words: Counter[str] = Counter()
    for seed in chosen:
        tables = structure(seed)
        start = time.perf_counter()
        try:
            found, seconds = judge(tables)
        except (ArithmeticError, AssertionError) as error:
            found, seconds = {"": Verdict("", np.nan, none=f"not judged: {error}")}, 0.0
        spent = time.perf_counter() - start - seconds
        for name, one in found.items():
            words[one.word] += 1
            told = "; ".join(filter(None, [*one.wrong, one.none, *(f"({d})" for d in one.doubts)]))
            head = f"{seed:4d} {tables['title']:8s} {name[:3]:3s} {one.status:14s}"
            row = f"{head} {one.load_factor:12.6g} {one.word:5s} {seconds:5.1f} {spent:4.1f} {told}"
            if name != "stands" or one.word != "right":
                print(row, flush=True)
    print(", ".join(f"{count} {word}" for word, count in sorted(words.items())))


if __name__ == "__main__":
    main()
