"""What tells each number of `SearchOptions` from its absence: the table of benchmarks/README.md.

    python3 benchmarks/search_options.py                 # all numbers, minutes
    python3 benchmarks/search_options.py --only path_    # those whose names begin so
    python3 benchmarks/search_options.py --write         # all, and the table there

Every number is made much larger, and then much smaller, while a fixed set of scenes is solved, the
cheapest first, among those that read it at all. It is told by the first scene whose status, load
factor, cost or words change; the table names that scene and the change.
"""

from __future__ import annotations

import argparse
import re
import signal
import sys
import textwrap
import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from fenics_contact import OutputOptions, Scene, limit_load
from fenics_contact.console import summary
from fenics_contact.search_options import SEARCH, SearchOptions
from tests.bank import arch_recipe, coulomb, tresca, wall_recipe
from tests.property.scenes import Draw

PAGE = Path(__file__).parents[1] / "benchmarks" / "README.md"
MARKS = "<!-- search options: begin -->", "<!-- search options: end -->"
QUIET = OutputOptions(pictures=False)
#: Seconds of processor time for one changed number.
SECONDS = 1.5
#: And of one scene at most: changed numbers may never come to an end.
LONGEST = 15


@dataclass(frozen=True)
class Row:
    """What a scene says: status, load factor, factorisations and the summary's words."""

    status: str
    load_factor: float
    factorizations: int
    words: str = ""

    def change(self, other: Row) -> str:
        """What another row has differently, in words; empty where nothing."""
        if self.status != other.status:
            return f"{self.status} -> {other.status}"
        moved = abs(self.load_factor - other.load_factor)
        if moved > 1e-9 * max(1.0, abs(self.load_factor)):
            return f"by {moved:.1e}"
        if self.factorizations != other.factorizations:
            return f"{self.factorizations} -> {other.factorizations}"
        return "words" if self.words != other.words else ""


def wall(name: str, friction: float = 0.65, **solve: Any) -> Callable[[], Scene]:
    """A wall with two elements along half a block, by name."""
    solve.setdefault("fast", False)
    return lambda: wall_recipe(name, coulomb(friction)).scene(2, **solve)


def drawn(seed: int) -> Callable[[], Scene]:
    """A random scene of the tests."""

    def scene() -> Scene:
        draw = Draw.of_seed(seed)
        return draw.recipe().scene(draw.elements, fast=False)

    return scene


SCENES: dict[str, Callable[[], Scene]] = {
    **{
        f"{name} {friction:g}{' fast' if fast else ''}": wall(name, friction, fast=fast)
        for name in ("W1", "W2", "W3", "W4")
        for friction in (0.65, 1.0)
        for fast in (True, False)
    },
    **{
        f"random {seed}": drawn(seed)
        for seed in (16, 149, 141, 101, 253, 259, 17, 157, 44, 125, 207, 47, 119, 272, 112, 148, 23)
    },
    "arch of 9": lambda: arch_recipe(9, 0.15).scene(3, fast=False),
    "arch of 15": lambda: arch_recipe(15, 0.12).scene(2, fast=False),
    "W1 Tresca": lambda: wall_recipe("W1", tresca(5e3)).scene(2, fast=True),
    "W1 fixed point": wall("W1", method="fixed-point", fast=True),
    "W1 splitting": wall("W1", method="splitting", fast=True),
    "W1 active set": wall("W1", method="active-set", fast=True),
    "W1 monolithic": wall("W1", method="monolithic", fast=True),
    "W1 rising load": wall("W1", control="load", fast=True),
    "W3 by faces": wall("W3", engine="faces", fast=True),
    "W4 by faces, lowest": wall("W4", engine="faces", states="lowest"),
    "W4 1, all asked": wall("W4", 1.0, peak=True, error=True, lowest=True),
    "W1, accuracy": wall("W1", accuracy=0.05),
    "10x10 0.75": wall("10x10", 0.75, fast=True),
    "20x20 by faces": wall("20x20", 0.75, engine="faces", fast=True),
}


def row(scene: Scene) -> Row:
    """The limit load of a scene as a row."""
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        result = limit_load(replace(scene, output=QUIET))
    except Exception as error:  # a change may break what it is held against
        return Row(type(error).__name__, 0.0, 0)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    words = "\n".join(
        re.sub(r"\d+\.\d+(e[-+]\d+)?", lambda number: f"{float(number[0]):.3g}", line)
        for line in summary(result, verbose=True).split("\n")
        if "factorisations" not in line and "verified" not in line
    )
    count = result.factorizations + result.mode_factorizations
    factor = result.load_factor if result.load_factor is not None else 0.0
    return Row(result.status, factor, count, words)


def too_long(*_: object) -> None:
    """Raise where a scene takes too long."""
    raise TimeoutError


class Reads:
    """Names of the numbers that a scene reads, noted by properties in their place."""

    def __enter__(self) -> set[str]:
        found: set[str] = set()
        for field in fields(SearchOptions):
            setattr(SearchOptions, field.name, self._noted(field.name, found))
        return found

    def __exit__(self, *_: object) -> None:
        for field in fields(SearchOptions):
            setattr(SearchOptions, field.name, field.default)

    @staticmethod
    def _noted(name: str, found: set[str]) -> property:
        def get(self: SearchOptions) -> Any:
            if sys._getframe(1).f_globals["__name__"] != "dataclasses":
                found.add(name)
            return vars(self)[name]

        return property(get, lambda self, value: vars(self).__setitem__(name, value))


def changed(value: Any) -> tuple[Any, Any]:
    """A number ten times as large and as small; parts of one: ten times as near, and as far."""
    if isinstance(value, int):
        return 10 * value, max(value // 10, 1)  # some loops never end with none
    if 0.5 < value < 1.0:
        return 1.0 - 0.1 * (1.0 - value), max(1.0 - 10.0 * (1.0 - value), 0.1 * value)
    return 10.0 * value, 0.1 * value


def told_by(name: str, scenes: dict[str, Scene], before: dict[str, Row]) -> str:
    """What a number's change to larger, or else to smaller, does first; empty where nothing."""
    value = getattr(SEARCH, name)
    for way, other in zip(("larger", "smaller"), changed(value), strict=True):
        start = time.process_time()
        object.__setattr__(SEARCH, name, other)
        try:
            for key, scene in scenes.items():
                change = before[key].change(row(scene))
                if change:
                    return f"{way}, {key}: {change}"
                if time.process_time() - start > SECONDS:
                    break
        finally:
            object.__setattr__(SEARCH, name, value)
    return ""


def main() -> None:
    """Solve, change, print, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="*", default=[""], help="beginnings of names")
    parser.add_argument("--part", default="0/1", help="a share of the numbers, as 0/2 and 1/2")
    parser.add_argument("--write", action="store_true", help="the table into benchmarks/README.md")
    options = parser.parse_args()
    signal.signal(signal.SIGPROF, too_long)
    scenes = {name: make() for name, make in SCENES.items()}
    row(next(iter(scenes.values())))  # compiles what is compiled once
    before: dict[str, Row] = {}
    seconds: dict[str, float] = {}
    reads: dict[str, set[str]] = {}
    for name, scene in scenes.items():
        start = time.process_time()
        before[name] = row(scene)
        seconds[name] = time.process_time() - start
        with Reads() as found:
            row(scene)
        reads[name] = found
    print(f"one pass: {sum(seconds.values()):.1f} s", flush=True)
    part, parts = map(int, options.part.split("/"))
    names = [one.name for one in fields(SearchOptions) if one.name.startswith(tuple(options.only))]
    lines = ["| number | value | told by |", "|---|---|---|"]
    untold = []
    for name in names[part::parts]:
        readers = sorted((one for one in scenes if name in reads[one]), key=seconds.__getitem__)
        change = told_by(name, {one: scenes[one] for one in readers}, before)
        value = f"{getattr(SEARCH, name):g}"
        if change:
            lines.append(f"| `{name}` | {value} | {change} |")
        else:
            untold.append(f"`{name}`")
        print(lines[-1] if change else untold[-1], flush=True)
    print(f"{len(lines) - 2} of {len(names[part::parts])} told")
    if untold:
        rest = f"Not told by these scenes: {', '.join(untold)}."
        lines += ["", *textwrap.wrap(rest, 118, break_long_words=False, break_on_hyphens=False)]
    if options.write:
        text = PAGE.read_text()
        first, last = text.index(MARKS[0]) + len(MARKS[0]), text.index(MARKS[1])
        PAGE.write_text(text[:first] + "\n\n" + "\n".join(lines) + "\n\n" + text[last:])


if __name__ == "__main__":
    main()
