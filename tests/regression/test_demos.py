"""The demos run and check their numbers, on one rank and on two."""

from __future__ import annotations

import sys

import pytest

from tests.system.program import ROOT, launcher, run_command

DEMOS = sorted((ROOT / "demos").glob("[0-9]*.py"))

#: Demos that are quick on two ranks.
PARALLEL = [path for path in DEMOS if path.stem[:2] in ("01", "02", "06", "07")]


def test_there_are_demos():
    assert len(DEMOS) >= len(PARALLEL) >= 4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("demo", "ranks"),
    [(path, 1) for path in DEMOS] + [(path, 2) for path in PARALLEL],
    ids=lambda value: getattr(value, "stem", value),
)
def test_demo(demo, ranks, tmp_path):
    found = run_command([*launcher(ranks), sys.executable, str(demo)], tmp_path, time_out=300.0)
    assert found.code == 0, found.out + found.err
