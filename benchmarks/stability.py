"""Numerical stress tests: scenes that are easy to state and hard on the arithmetic.

    python3 benchmarks/stability.py [--only PATTERNS] [--method NAME] [--csv FILE]

One row per case, compared with a closed form, with the linear program of rigid blocks,
or with the scene that it is a variant of. The verdict "WRONG", a limit load that is claimed and is
not the limit load, is the one that must never occur.

Closed forms are those of rigid blocks on plane joints with all resultants known from statics: a
block slides at F and tips at width / height, a stack of n at width / (n height), an incline of
angle a takes cos a (F - tan a) of the weight down the slope. Elasticity does not enter where a
mechanism of rigid blocks decides (R.K. Livesley, Int. J. Numer. Meth. Eng. 12 (1978) 1853).
"""

from __future__ import annotations

import argparse
import gc
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.scenes import matching
from benchmarks.worker import Worker, save
from fenics_contact import LimitLoad, limit_load
from fenics_contact.meshing import wall
from tests import bank
from tests.bank import PLAIN, Recipe, Variant, coulomb, outlined, rectangle, wall_recipe

PROGRAM, BRACKET = "linear program", "bracket"  # references that are computed with the case
VERDICTS = ("WRONG", "not converged", "unstable", "ok")  # the worst first
TRESCA, USUAL = bank.tresca(2000.0), coulomb(0.65)
Recipes, Pair = Callable[[float], Recipe], tuple[float, float]  # by friction; width and height


@dataclass(frozen=True)
class Case:
    """A scene, or several that must give the same, and what is known of the load factor.

    Attributes:
        name: Topic and values.
        recipe: Makes the scene.
        reference: Load factor, `PROGRAM` (upper end of the bracket), `BRACKET` (anything verified
            between both ends), the name of the case that this one is a variant of, infinite where
            nothing limits the load, nan where the dead load cannot stand.
        variants: Ways to write it; the row shows the worst of them.
        tolerance: On the load factor, relative to the reference or `size`, whichever is larger.
        size: Typical load factor of cases whose reference nearly vanishes.
    """

    name: str
    recipe: Recipe
    reference: float | str = BRACKET
    variants: Sequence[Variant] = (PLAIN,)
    tolerance: float = 1e-6
    size: float = 0.0

    @property
    def status(self) -> str:
        """What `limit_load` must say."""
        exact = 0.0 if isinstance(self.reference, str) else self.reference
        return "unstable" if math.isnan(exact) else "unbounded" if math.isinf(exact) else "limit"


def slide_or_tip(
    name: str, recipe: Recipes, tips: float, frictions: Sequence[float] = (0.1, 0.7), **rest: Any
) -> Iterator[Case]:
    """Cases that slide at the friction or tip at a load factor, whichever is less."""
    for friction in frictions:
        yield Case(f"{name} F={friction:g}", recipe(friction), min(friction, tips), **rest)


# Scenes


def blocks(outlines: Sequence[Any], friction: float, size: float = 0.1, **parts: Any) -> Recipe:
    """Blocks by their corners."""
    return outlined(list(outlines), coulomb(friction), size, **parts)


def block(width: float, height: float) -> Recipes:
    """One block: min(F, width / height)."""
    return partial(blocks, [rectangle(0.0, 0.0, width, height)])


def stack(count: int, friction: float, width: float = 0.5, **parts: Any) -> Recipe:
    """Blocks on top of each other, irregular cells: min(F, width / (0.2 count))."""
    levels = [rectangle(0.0, 0.2 * k, width, 0.2 * (k + 1)) for k in range(count)]
    return blocks(levels, friction, 0.5 * width, **parts)


def regular(count: int, size: Pair, elements: int, scale: Pair) -> Recipes:
    """Blocks with regular cells on top of each other, stretched along the axes."""
    draw, change = partial(wall, [[1.0]] * count, size, elements), partial(bank.stretched, *scale)
    return lambda friction: Recipe(lambda n, quads: draw(quads), coulomb(friction), change=change)


def pier(side: float, friction: float) -> Recipe:
    """A unit block on one square stone under its middle."""
    stone = rectangle(0.5 * (1.0 - side), 0.0, 0.5 * (1.0 + side), side)
    return blocks([stone, rectangle(0.0, side, 1.0, 1.0 + side)], friction)


def tipping(side: float, arm: float) -> float:
    """Tipping of unit block and square foot; `arm` of the block's centre about the corner."""
    return (arm + 0.5 * side**3) / (0.5 + side + 0.5 * side**3)


# Cases


def contrast_cases() -> Iterator[Case]:
    """Blocks of very different stiffness."""
    for ratio in (1e-6, 1e-3, 1e3, 1e6):
        name = f"contrast {ratio:g}"
        stacks, triliths = partial(bank.stack_recipe, 5), partial(blocks, bank.TRILITH)
        for label, plain, tips in (("stack", stacks, 0.5), ("trilith", triliths, 0.3)):
            for friction in (0.1, 0.7):
                recipe = bank.contrasted(plain(friction), ratio)
                yield Case(f"{name} {label} F={friction}", recipe, min(friction, tips))
        for label in ("W1", "W3", "W4"):
            recipe = bank.contrasted(wall_recipe(label, TRESCA), ratio)
            yield Case(f"{name} {label} Tresca", recipe, PROGRAM)
        yield Case(f"{name} W1 F=0.65", bank.contrasted(wall_recipe("W1", USUAL), ratio))


def poisson_cases() -> Iterator[Case]:
    """Nearly incompressible blocks."""
    values = [("strain", nu) for nu in (0.0, 0.3, 0.49, 0.499, 0.4999)]
    for plane, nu in [*values, ("stress", 0.2), ("stress", 0.4999)]:
        name, variants = f"nu={nu:g} plane {plane}", (Variant(plane=plane, poisson=nu),)
        yield from slide_or_tip(f"{name} block", block(0.4, 1.0), 0.4, variants=variants)
        yield Case(f"{name} W1 Tresca", wall_recipe("W1", TRESCA), PROGRAM, variants)
        yield Case(f"{name} W1 F=0.65", wall_recipe("W1", USUAL), variants=variants)


def friction_cases() -> Iterator[Case]:
    """From no friction to more than walls can use."""
    values = (0.0, 1e-6, 0.1, 1.0, 10.0)
    # What matters of a tiny load factor is its size against tipping.
    yield from slide_or_tip("friction block", block(0.4, 1.0), 0.4, values, size=1e-3)
    yield from slide_or_tip("friction stack", partial(stack, 5), 0.5, values, size=1e-3)
    more = {"W1": (0.65, *values), "W2": (1.0, 10.0), "W3": values, "W4": (0.3, 0.5, 0.8)}
    for name, frictions in more.items():
        for friction in frictions:
            yield Case(f"friction {name} F={friction:g}", wall_recipe(name, coulomb(friction)))


def aspect_cases() -> Iterator[Case]:
    """Flat slabs, slender columns, needle cells."""
    plain = (1.0, 1.0)
    for name, recipe, tips, frictions in (
        ("slab 100:1", block(10.0, 0.1), 100.0, (0.5, 200.0)),
        ("column 1:100", block(0.1, 10.0), 0.01, (0.005, 0.5)),
        ("slab of cells 1000:1", regular(1, (2000.0, 1.0), 1, plain), 2000.0, (0.5, 4000.0)),
        ("flat cells 1000:1", regular(1, (1.0, 500.0), 1, (1.0, 2e-3)), 1.0, (0.5, 2.0)),
        ("tall cells 1000:1", regular(1, (1000.0, 2.0), 500, (1e-3, 0.5)), 1.0, (0.5, 2.0)),
        ("5 slabs 1000:1", regular(5, (1000.0, 1.0), 1, plain), 200.0, (0.1, 300.0)),
    ):
        yield from slide_or_tip(f"aspect {name}", recipe, tips, frictions)


def small_joint_cases() -> Iterator[Case]:
    """Joints much shorter than blocks, and stones much smaller than others."""
    for side in (1e-2, 1e-3, 1e-4):
        recipe = partial(blocks, bank.feet(side))
        yield from slide_or_tip(f"small feet {side:g}", recipe, tipping(side, 0.5), (0.5, 2.0))
        tips = tipping(side, 0.5 * side)
        for friction in (0.5 * tips, 0.5):
            name = f"small pier {side:g} F={friction:.3g}"
            yield Case(name, pier(side, friction), min(friction, tips))
    for side in (1e-2, 1e-3):
        stone = rectangle(0.5, 1.0, 0.5 + side, 1.0 + 2.0 * side)
        recipe = partial(blocks, [rectangle(0.0, 0.0, 1.0, 1.0), stone])
        yield from slide_or_tip(f"small stone {side:g} on block", recipe, 0.5, (0.3, 0.7))


UNITS = ("mm, N", "um, N", "um, uN", "km, N", "km, GN", "m, GN")
SIZES = {"um": 1e-6, "mm": 1e-3, "m": 1.0, "km": 1e3, "uN": 1e-6, "N": 1.0, "GN": 1e9}

TURNS = {f"turned {angle:g}": Variant(angle=angle) for angle in (0.0, 17.0, 45.0, 90.0, 123.0)}


def invariance_cases() -> Iterator[Case]:
    """What must not change a load factor: units, angles, numbers, nodes."""
    seeds = range(20)
    for law, label in ((TRESCA, "W1 Tresca"), (USUAL, "W1 F=0.65")):
        recipe, plain = wall_recipe("W1", law), f"plain {label}"
        yield Case(plain, recipe, PROGRAM if law is TRESCA else BRACKET)
        changes = {name: (variant,) for name, variant in TURNS.items() if variant.angle}
        for unit in UNITS:
            length, force = (SIZES[part] for part in unit.split(", "))
            changes[f"units {unit}"] = (Variant(length=length, force=force),)
        changes["20 numberings"] = tuple(Variant(seed=seed) for seed in seeds)
        for name, variants in changes.items():
            yield Case(f"{name} {label}", recipe, plain, variants)
        moved, tolerance = [Variant(shaken=seed) for seed in seeds], 1e-6 if law is TRESCA else 5e-3
        yield Case(f"20 moved nodes {label}", recipe, plain, moved, tolerance)
    for name, variant in TURNS.items():
        single, several = block(0.4, 1.0), partial(stack, 5)
        yield from slide_or_tip(f"{name} block", single, 0.4, variants=(variant,))
        yield from slide_or_tip(f"{name} stack", several, 0.5, variants=(variant,))


def verge_cases() -> Iterator[Case]:
    """Dead loads that barely stand or barely do not; wedges that nearly lock."""
    slope = 17.0
    a, down = math.radians(slope), bank.on_slope(slope, (-bank.GRAVITY, 0.0))
    for margin in (1e-3, -1e-3, 1e-6, -1e-6):
        friction, width = math.tan(a) * (1.0 + margin), 0.4 * math.tan(a) * (1.0 + margin)
        exact = math.sin(a) * margin  # cos a F - sin a; the same about the lower corner
        shift = 0.5 * (1.0 - margin)
        slabs = [rectangle(0.0, 0.0, 1.0, 0.5), rectangle(shift, 0.5, 1.0 + shift, 1.0)]
        hangs = blocks(slabs, 1.0, 0.25, groups={"base": [((0.0, 0.0), (1.0, 0.0))]})
        turned = Variant(angle=slope)
        for name, recipe, factor, variant in (
            (f"incline 1 blocks F {margin:+g}", stack(1, friction, **down), exact, turned),
            (f"incline 2 blocks F {margin:+g}", stack(2, friction, **down), exact, turned),
            (f"leaning stack width {margin:+g}", stack(2, 0.7, width, **down), exact, turned),
            (f"overhang {-margin:+g}", hangs, 2.0 * margin, PLAIN),  # arm 0.5 margin, height 0.25
        ):
            factor = factor if margin > 0.0 else math.nan
            yield Case(f"verge {name}", recipe, factor, (variant,), size=1e-3)
    for friction in (0.5, 0.57, 0.577, 0.5778, 0.6):
        exact = bank.wedge_factor(friction)
        yield Case(f"verge wedge F={friction}", bank.wedge_recipe(friction), exact)


def arrangement_cases() -> Iterator[Case]:
    """Many blocks, blocks that meet at a point, bodies that stand apart."""
    tower = partial(bank.stack_recipe, 200)
    yield from slide_or_tip("tower of 200", tower, 0.0125, (0.01, 0.7))
    bond = Recipe(partial(wall, [[1.0, 1.0]] * 2, (0.4, 0.2)), TRESCA)
    yield Case("2 x 2 stack bond Tresca", bond, PROGRAM)
    for friction in (0.2, 0.65, 1.0, 10.0):
        yield Case(f"2 x 2 stack bond F={friction}", replace(bond, law=coulomb(friction)))
    apart = [rectangle(0.0, 0.0, 0.4, 1.0), rectangle(2.0, 0.0, 2.3, 1.0)]
    groups = {"base": [((0.0, 0.0), (0.4, 0.0))], "held": [((2.0, 0.0), (2.3, 0.0))]}
    held = partial(blocks, apart, groups=groups, supports={"held": "fixed"})
    yield from slide_or_tip("held body apart", held, 0.4)
    both = partial(blocks, apart, groups={"base": [((0.0, 0.0), (2.3, 0.0))]})
    yield from slide_or_tip("two structures", both, 0.3)


TOPICS = (
    *(contrast_cases, poisson_cases, friction_cases, aspect_cases),
    *(small_joint_cases, invariance_cases, verge_cases, arrangement_cases),
)

CASES = {case.name: case for topic in TOPICS for case in topic()}


# Running


def measure(name: str, method: str) -> dict[str, Any]:
    """The row of a case: the worst of its variants."""
    case, start = CASES[name], time.perf_counter()
    rows = [judged(case, method, variant) for variant in case.variants]
    worst = min(rows, key=lambda row: (VERDICTS.index(row["verdict"]), -row["error"]))
    return {**worst, "s": time.perf_counter() - start}


def judged(case: Case, method: str, variant: Variant) -> dict[str, Any]:
    """The row of one scene."""
    gc.collect()
    result = limit_load(case.recipe.scene(variant=variant, method=method))
    value, inside = reference(case, method, result)
    error = 0.0 if result.load_factor == value else abs(result.load_factor - value)
    error /= max(abs(value), case.size, 1e-300)
    certificate = None if result.collapse is None else result.collapse.certificate
    return {
        "status": result.status,
        "factor": result.load_factor,
        "reference": value,
        "error": error,
        "residual": max(certificate.residuals.values()) if certificate else math.nan,
        "factoris.": result.factorizations,
        "verdict": verdict(case.status, result.status, inside and not error > case.tolerance),
    }


def reference(case: Case, method: str, result: LimitLoad) -> tuple[float, bool]:
    """What the load factor must be, nan if that is not known; whether it is in its bracket."""
    bounds, exact = result.bounds, case.reference
    upper = math.inf if bounds is None or bounds.upper is None else bounds.upper
    lower = -math.inf if bounds is None or bounds.lower is None else bounds.lower
    inside = lower - 1e-6 <= result.load_factor <= upper * (1.0 + 1e-6) + 1e-9
    if isinstance(exact, str):
        computed = {PROGRAM: upper, BRACKET: math.nan}
        exact = computed[exact] if exact in computed else plain_factor(exact, method)
    return exact, inside or case.status != "limit"


@cache
def plain_factor(name: str, method: str) -> float:
    """Load factor of another case; nan if it was not found."""
    result = limit_load(CASES[name].recipe.scene(method=method))
    return result.load_factor if result.status == "limit" else math.nan


def verdict(expected: str, status: str, right: bool) -> str:
    """What to think of a result; `right` is whether the number is."""
    if status == "not_converged":
        return "not converged"
    if status == "unstable" != expected:
        return "unstable"
    return "ok" if status == expected and (right or status == "unstable") else "WRONG"


COLUMNS = "{:38} {:13} {:>13} {:>13} {:>8} {:>8} {:>9} {:>6} {}"
FORMS = {"factor": ".8g", "reference": ".8g", "error": ".1e", "residual": ".1e", "s": ".1f"}
MISSING = dict.fromkeys(FORMS, math.nan) | {"factoris.": 0, "verdict": VERDICTS[1]}
NAMES = ("status", "factor", "reference", "error", "residual", "factoris.", "s", "verdict")


def main() -> int:
    """Run the table; exit code 1 if anything is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="*", metavar="PATTERNS", help="of the shell, by commas")
    parser.add_argument("--method", default="auto", help="as in the scene file")
    parser.add_argument("--time-out", type=float, default=60.0, metavar="S", help="per case")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the table there too")
    options = parser.parse_args()
    print(COLUMNS.format("case", *NAMES))
    worker, rows = Worker(), []
    for name in matching(CASES, options.only):
        task = {"name": name, "method": options.method}
        row = worker.call("benchmarks.stability:measure", options.time_out, **task)
        rows.append({**MISSING, **task, **row})
        shown = [format(rows[-1][key], FORMS.get(key, "")) for key in NAMES]
        print(COLUMNS.format(name, *shown).replace("nan", "  -"), flush=True)
    worker.close()
    counts = Counter(row["verdict"] for row in rows)
    print(", ".join(f"{counts[name]} {name}" for name in VERDICTS), "of", len(rows))
    if options.csv:
        save(options.csv, rows)
    return int(any(row["verdict"] == "WRONG" for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
