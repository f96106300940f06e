"""Walls, arches and rings with a published value: the table of docs/published.md.

    python3 benchmarks/published.py                    # all rows: half a minute
    python3 benchmarks/published.py --only "W1*"       # those whose name fits; --list names them

The published values are of rigid blocks. Blocks are elastic here, which moves a load factor with
Coulomb friction a little: collapse forces depend on stiffness where friction is not associative.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fenics_contact import Scene, limit_load
from fenics_contact.meshing import arch
from tests.bank import ARCH_SOURCE, BANK, PLAIN, WALL_SOURCE, Recipe, arch_recipe, coulomb

#: Relative difference of two values between which a least value is.
CLOSE = 4e-6
NAFEMS = "NAFEMS, benchmark CGS-4"
OPPENHEIM = "I.J. Oppenheim, Earthq. Eng. Struct. Dyn. 21 (1992) 1005-1017"
HEAD = "| problem | published | here | difference | source |\n|---|---|---|---|---|"


@dataclass(frozen=True)
class Published:
    """A published value and how it is found here.

    Attributes:
        name: What it is.
        value: As published, with its digits.
        source: Where.
        find: Finds it.
    """

    name: str
    value: str
    source: str
    find: Callable[[], float]

    def row(self) -> str:
        """The row of the table, found anew."""
        found = self.find()
        digits = max(5, len(self.value.partition(".")[2]))
        difference = f"{found / float(self.value) - 1.0:+.2%}".replace("-0.00%", "+0.00%")
        return f"| {self.name} | {self.value} | {found:.{digits}f} | {difference} | {self.source} |"


def load_factor(scene: Scene) -> float:
    """Load factor of a scene, which must have a limit."""
    result = limit_load(scene)
    if result.status != "limit":
        raise RuntimeError(f"{result.status}: {result.reason()}")
    return result.load_factor


def least(recipe: Callable[[float], Recipe], about: float) -> float:
    """Least value with which a structure stands under its dead load, by halving 4 % about one."""
    low = 0.98 * about
    high = 1.02 * about
    if stands(recipe(low)) or not stands(recipe(high)):
        raise RuntimeError(f"no least value within 2 % of {about}")
    while high - low > CLOSE * about:
        middle = 0.5 * (low + high)
        if stands(recipe(middle)):
            high = middle
        else:
            low = middle
    return 0.5 * (low + high)


def stands(recipe: Recipe) -> bool:
    """Whether a structure stands under its dead load."""
    return limit_load(recipe.scene(1, None, PLAIN, fast=True)).status != "unstable"


def of_bank(name: str) -> Callable[[], float]:
    """The load factor of a scene of the bank."""
    return lambda: load_factor(BANK[name].scene(fast=True))


def thickness(voussoirs: int, friction: float, about: float) -> Callable[[], float]:
    """The least thickness of a semicircular arch, over its mean radius."""
    return lambda: least(lambda t: arch_recipe(voussoirs, t, friction), about)


def friction(voussoirs: int, thick: float, about: float) -> Callable[[], float]:
    """The least friction with which an arch of a thickness stands."""
    return lambda: least(lambda f: arch_recipe(voussoirs, thick, f), about)


def ring() -> float:
    """Horizontal acceleration over gravity that begins to move a ring of 7 voussoirs."""
    law = coulomb(0.7)
    draw = lambda n, quads: arch(7, 0.15, 1.0, 157.5, n, quads)  # noqa: E731
    recipe = Recipe(draw, law, {"foundations": {"springings": law}})
    return load_factor(recipe.scene(2, None, PLAIN, fast=True))


def table() -> list[Published]:
    """All rows."""
    found = [
        Published("W1, 33 blocks, friction 0.65: load factor", "0.63982", WALL_SOURCE,
                  of_bank("W1 coulomb 0.65")),
        Published("W2, 55 blocks, friction 0.65: load factor", "0.56262", WALL_SOURCE,
                  of_bank("W2 coulomb 0.65")),
        Published("ring of 157.5 degrees, t/R 0.15, 7 voussoirs: acceleration / g", "0.37",
                  OPPENHEIM, ring),
        Published("block pushed up an incline, friction 0.3: force / weight", "0.4123711", NAFEMS,
                  of_bank("block pushed up an incline")),
    ]  # fmt: skip
    rough = {7: "0.095703", 11: "0.104589", 17: "0.105462", 27: "0.106721", 51: "0.107357"}
    for count, value in rough.items():
        name = f"semicircle, {count} voussoirs, friction 1: least t/R"
        found.append(Published(name, value, ARCH_SOURCE, thickness(count, 1.0, float(value))))
    for factor, value in {0.36: "0.140890", 0.34: "0.161766", 0.32: "0.183845"}.items():
        name = f"semicircle, 27 voussoirs, friction {factor}: least t/R"
        found.append(Published(name, value, ARCH_SOURCE, thickness(27, factor, float(value))))
    return [
        *found,
        Published("semicircle, any thickness: least friction (here 44 voussoirs, t/R 0.25)",
                  "0.3092", ARCH_SOURCE, friction(44, 0.25, 0.3092)),
        Published("semicircle: friction from which hinges decide (here 27 voussoirs)",
                  "0.3958", ARCH_SOURCE, friction(27, 0.106723, 0.3958)),
    ]  # fmt: skip


def main() -> None:
    """Print the table."""
    as_written = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=as_written)
    parser.add_argument("--only", default="*", help="rows by name, with * and ?; case is no matter")
    parser.add_argument("--list", action="store_true", help="print the names alone")
    options = parser.parse_args()
    chosen = [one for one in table() if fnmatchcase(one.name.lower(), options.only.lower())]
    if not chosen:
        parser.error(f"no row has a name like '{options.only}'; --list names all")
    if options.list:
        print("\n".join(one.name for one in chosen))
        return
    print(HEAD)
    for published in chosen:
        print(published.row(), flush=True)


if __name__ == "__main__":
    main()
