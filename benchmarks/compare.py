"""Two checkouts of the program on the same scenes, in turns.

    python3 benchmarks/compare.py BEFORE AFTER [--only "W4*,10x10*"] [--repeat 2] [--csv FILE]

BEFORE and AFTER are folders with a package fenics_contact. Each has a process of its own; on every
scene they take turns (A B A B), so that a slow moment of the machine is not one version's alone.
Shown are status, load factor, factorisations (of the structure + of the blocks' modes) and the
least processor time; at the end the geometric mean and the worst of the ratios AFTER / BEFORE.
Scenes are files, which old versions read too. Those of minutes are run where a pattern names them,
as in --only "40x40 0.4 4"; --only mixed takes 40 scenes of all kinds.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.scenes import LARGE, MIXED, comparison, matching, write_scene
from benchmarks.worker import Worker, save

LINE = "{:22} {:>13} {:>11} {:>9} {:>7} | {:>13} {:>11} {:>9} {:>7}"


def cells(row: dict[str, Any]) -> list[str]:
    """One version's columns."""
    if "cpu" not in row:
        return [row["status"], "-", "-", "-"]
    factors = f"{row['structure']}+{row['modes']}"
    return [row["status"], f"{row['load_factor']:.7g}", factors, f"{row['cpu']:.2f}"]


def summary(pairs: dict[str, list[dict[str, Any]]], tolerance: float) -> list[str]:
    """Geometric means and worst ratios AFTER / BEFORE, and scenes with other results."""
    lines, others = [], []
    both = {name: pair for name, pair in pairs.items() if all("cpu" in row for row in pair)}
    for what in ("structure", "cpu") if both else ():
        found = {n: max(b[what], 1e-3) / max(a[what], 1e-3) for n, (a, b) in both.items()}
        mean = np.exp(np.mean(np.log(list(found.values()))))
        worst = sorted(found, key=lambda name: -found[name])[:5]
        listed = ", ".join(f"{name}: {found[name]:.2f}" for name in worst)
        lines.append(f"{what}: geometric mean {mean:.3f} of {len(found)}; worst {listed}")
    for name, (a, b) in pairs.items():
        one, other = (row.get("load_factor", np.nan) for row in (a, b))
        apart = abs(one - other) > 10.0 * tolerance * max(abs(one), abs(other))
        others += [name] * bool(a["status"] != b["status"] or apart)
    return [*lines, f"other status or load factor: {', '.join(others) or 'none'}"]


def main() -> int:
    """Compare; exit code 1 if a scene that was solved before is not solved after."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    parser.add_argument("--only", default="", metavar="PATTERNS", help="of the shell, by commas")
    parser.add_argument("--method", default="auto")
    parser.add_argument("--tolerance", type=float, default=1e-6, metavar="X")
    parser.add_argument("--effort", default="default", choices=("default", "fast"))
    parser.add_argument("--repeat", type=int, default=1, metavar="N")
    parser.add_argument("--time-out", type=float, default=300.0, metavar="S", help="per solve")
    parser.add_argument("--csv", type=Path, metavar="FILE")
    choice = parser.parse_args()
    large = [] if choice.only else matching(comparison(), LARGE)
    choice.only = MIXED if choice.only == "mixed" else choice.only
    names = [name for name in matching(comparison(), choice.only or "*") if name not in large]
    workers = [Worker(root=root) for root in (choice.before, choice.after)]
    rest = {key: getattr(choice, key) for key in ("effort", "method", "tolerance")}
    pairs = {}
    folder = Path(tempfile.mkdtemp())
    warm = write_scene(*comparison()["W1 0.65 2"], folder / "warm.toml")
    print(LINE.format("scene", *("status", "factor", "factoris.", "cpu s") * 2))
    for name in names:
        file = write_scene(*comparison()[name], folder / "scene.toml")
        files = {"path": str(file), "warm": str(warm)}
        found: list[dict[str, Any]] = [{}, {}]
        for side, worker in list(enumerate(workers)) * choice.repeat:
            row = {"version": worker.root.resolve().name}
            row |= worker.call("benchmarks.worker:solve_file", choice.time_out, **files, **rest)
            if not found[side] or row.get("cpu", np.inf) < found[side].get("cpu", np.inf):
                found[side] = row
        pairs[name] = found
        print(LINE.format(name, *cells(found[0]), *cells(found[1])), flush=True)
    for worker in workers:
        worker.close()
    shutil.rmtree(folder)
    print("\n".join(summary(pairs, choice.tolerance)))
    if choice.csv:
        save(choice.csv, [{"scene": name, **row} for name, pair in pairs.items() for row in pair])
    solved = ("limit", "unbounded", "unstable")
    return int(any(a["status"] in solved and b["status"] not in solved for a, b in pairs.values()))


if __name__ == "__main__":
    raise SystemExit(main())
