"""The demos run and check their numbers, on one rank and on two."""

from __future__ import annotations

import sys

import pytest

from tests.system.program import ROOT, launcher, run_command

DEMOS = sorted((ROOT / "demos").glob("*.py"))


def test_there_are_demos():
    assert len(DEMOS) >= 4


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [1, 2])
@pytest.mark.parametrize("demo", DEMOS, ids=lambda path: path.stem)
def test_demo(demo, ranks, tmp_path):
    found = run_command([*launcher(ranks), sys.executable, str(demo)], tmp_path, time_out=300.0)
    assert found.code == 0, found.out + found.err
