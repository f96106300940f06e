"""What the fixed point of Mihai and Ainsworth costs on W1 to W4 over the size of the elements.

    python3 benchmarks/fixed_point.py [--time-out 100] [--write]

Prints a table of benchmarks/README.md; with --write puts it between the page's marks. A finer mesh
is left out where it would take longer than the time-out, by the time on the mesh before.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from fenics_contact import limit_load
from tests.bank import coulomb, wall_recipe

PAGE = Path(__file__).resolve().with_name("README.md")
MARKS = "<!-- passes: begin -->", "<!-- passes: end -->"
WALLS = "W1", "W2", "W3", "W4"
METHODS = "fixed-point", "splitting"
ELEMENTS = 1, 2, 4, 8
FRICTION = 0.65


def cell(wall: str, elements: int, method: str) -> tuple[str, float]:
    """Passes, their mean contraction and CPU seconds, in words, and the seconds."""
    scene = wall_recipe(wall, coulomb(FRICTION)).scene(elements, method=method, fast=True)
    start = time.process_time()
    found = limit_load(scene)
    seconds = time.process_time() - start
    if found.status != "limit":
        return found.status, seconds
    changes = [step.bound_change for step in found.positive.history[-1].steps]
    contraction = (changes[-1] / changes[0]) ** (1.0 / (len(changes) - 1))
    passes = sum(len(one.steps) for one in found.positive.history)
    return f"{passes}, {contraction:.2f}, {seconds:.1f} s", seconds


def rows(time_out: float) -> list[str]:
    """The rows of the table."""
    cell("W1", 1, "splitting")  # compiles what is compiled once
    made = []
    for wall in WALLS:
        for method in METHODS:
            cells, took = [wall, f"`{method}`"], 0.0
            for elements in ELEMENTS:
                text = "-"
                if 8.0 * took <= time_out:
                    text, took = cell(wall, elements, method)
                cells.append(text)
            made.append(f"| {' | '.join(cells)} |")
            print(made[-1], flush=True)
    return made


def main() -> None:
    """Solve, print and write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--time-out", type=float, default=100.0, help="s, for one run")
    parser.add_argument("--write", action="store_true", help="the table into benchmarks/README.md")
    options = parser.parse_args()
    head = f"| wall | method | {' | '.join(map(str, ELEMENTS))} |"
    lines = [head, "|---" * (2 + len(ELEMENTS)) + "|", *rows(options.time_out)]
    if options.write:
        text = PAGE.read_text()
        first, last = text.index(MARKS[0]) + len(MARKS[0]), text.index(MARKS[1])
        PAGE.write_text(f"{text[:first]}\n\n" + "\n".join(lines) + f"\n\n{text[last:]}")


if __name__ == "__main__":
    main()
