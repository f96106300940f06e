"""What the fixed point of Mihai and Ainsworth costs on W1 to W4 over the size of the elements.

    python3 benchmarks/fixed_point.py [--time-out 100] [--write]

Prints the table of docs/fixed_point.md; with --write puts it between the page's marks. A row is a
wall, `splitting` is left out beyond a mesh on which it took longer than the time-out allows.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fenics_contact import LimitLoad, limit_load
from tests.bank import coulomb, wall_recipe

PAGE = Path(__file__).resolve().parents[1] / "docs" / "fixed_point.md"
MARKS = "<!-- passes: begin -->", "<!-- passes: end -->"
WALLS, ELEMENTS, FRICTION = ("W1", "W2", "W3", "W4"), (1, 2, 4, 8), 0.65
HEAD = (
    "| wall | elements | load factor | passes | contraction | factorisations | seconds"
    " | `splitting`: passes | contraction | pairs of programs | all at once | seconds |"
)


def solved(wall: str, elements: int, method: str) -> tuple[LimitLoad, float]:
    """A wall by a method, and CPU seconds."""
    scene = wall_recipe(wall, coulomb(FRICTION)).scene(elements, method=method, fast=True)
    start = time.process_time()
    return limit_load(scene), time.process_time() - start


def contraction(result: LimitLoad) -> str:
    """Mean factor by which the change of the bound fell per pass, over all of them."""
    changes = [step.bound_change for one in result.positive.history[-1:] for step in one.steps]
    return f"{(changes[-1] / changes[0]) ** (1.0 / (len(changes) - 1)):.2f}"


def rows(time_out: float) -> list[str]:
    """The rows of the table."""
    solved("W1", 1, "splitting")  # compiles what is compiled once
    made = []
    for wall in WALLS:
        took = 0.0
        for elements in ELEMENTS:
            result, seconds = solved(wall, elements, "fixed-point")
            passes = sum(len(one.steps) for one in result.positive.history)
            cells = [wall, elements, f"{result.load_factor:.6f}", passes, contraction(result)]
            cells += [result.factorizations, f"{seconds:.1f}"]
            if 8.0 * took <= time_out:
                split, took = solved(wall, elements, "splitting")
                assert np.isclose(split.load_factor, result.load_factor, rtol=1e-4)
                counts = split.positive.splitting
                passes = sum(len(one.steps) for one in split.positive.history)
                cells += [passes, contraction(split), counts.sweeps, counts.joint_steps]
                cells += [f"{took:.1f}"]
            else:
                took = np.inf
                cells += ["-"] * 5
            made.append(f"| {' | '.join(map(str, cells))} |")
            print(made[-1], flush=True)
    return made


def main() -> None:
    """Solve, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--time-out", type=float, default=100.0, help="s, for `splitting`")
    parser.add_argument("--write", action="store_true", help="the table into docs/fixed_point.md")
    options = parser.parse_args()
    lines = [HEAD, "|---" * HEAD.count(" | ") + "|---|", *rows(options.time_out)]
    if options.write:
        text = PAGE.read_text()
        first, last = text.index(MARKS[0]) + len(MARKS[0]), text.index(MARKS[1])
        PAGE.write_text(f"{text[:first]}\n\n" + "\n".join(lines) + f"\n\n{text[last:]}")


if __name__ == "__main__":
    main()
