"""The demos run and check their numbers, on one rank and on two."""

from __future__ import annotations

import json
import re
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests.helpers import notebook_picture
from tests.system.program import ROOT, launcher, run_command

DEMOS = sorted((ROOT / "demos").glob("[0-9]*.py"))

#: Demos that are quick on two ranks.
PARALLEL = [
    path
    for path in DEMOS
    if path.stem[:2] in ("01", "02", "06", "07", "14", "15", "16", "17", "19")
]


def test_there_are_demos():
    assert len(DEMOS) >= len(PARALLEL) >= 4


def test_a_problem_from_matrices(tmp_path):
    found = run_command([sys.executable, str(ROOT / "demos" / "own_matrices.py")], tmp_path)
    assert found.code == 0, found.err
    assert found.out.splitlines() == [
        "load factor 60.000000, shear [-50. -10.] N",
        "load factor 80.000000, shear [-50. -30.] N",
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("demo", "ranks"),
    [(path, 1) for path in DEMOS] + [(path, 2) for path in PARALLEL],
    ids=lambda value: getattr(value, "stem", value),
)
def test_demo(demo, ranks, tmp_path):
    start = time.time()
    found = run_command([*launcher(ranks), sys.executable, str(demo)], tmp_path, time_out=300.0)
    assert found.code == 0, found.out + found.err
    said = re.findall(rf"{ROOT}/demos/output/[\w-]+", found.out.splitlines()[-1])
    pictures = [path for folder in said for path in Path(folder).rglob("*.png")]
    assert any(path.stat().st_mtime >= start for path in pictures), found.out


def test_notebook(monkeypatch, capsys):
    """Its code cells run one after the other, in the folder of the demos, and show a picture."""
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    monkeypatch.chdir(ROOT / "demos")
    notebook = json.loads((ROOT / "demos" / "13_wall_w3.ipynb").read_text())
    cells = ["".join(c["source"]) for c in notebook["cells"] if c["cell_type"] == "code"]
    names: dict[str, Any] = {}
    for cell in cells:
        exec(compile(cell, "13_wall_w3.ipynb", "exec"), names)
    pyplot.close("all")
    assert abs(names["result"].load_factor - 0.35582) < 1e-4
    assert notebook_picture(names["result"]).startswith(b"\x89PNG")
    ground, loads = (
        [float(x) for x in re.findall(r"[-+.\de]+", line.split(":")[1])]
        for line in capsys.readouterr().out.splitlines()
        if "N/m" in line
    )
    assert ground == pytest.approx(loads, rel=1e-5)
