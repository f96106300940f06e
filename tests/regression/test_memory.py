"""Solving many scenes, one after the other, keeps the memory flat."""

from __future__ import annotations

import sys

import pytest

from tests.system.program import run_command

PROGRAM = """
import os
from pathlib import Path
from fenics_contact import limit_load
from tests.bank import BANK

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

for number in range(1, 61):
    assert limit_load(BANK["W1 bracket 0.5"].scene()).status == "limit"
    if number in (20, 60):
        print(resident())
"""


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_60_solves_take_no_more_memory_than_20(tmp_path):
    found = run_command([sys.executable, "-c", PROGRAM], tmp_path, time_out=300.0)
    early, late = map(int, found.out.split())
    assert late <= 1.02 * early, f"{early / 1e6:.0f} MB, then {late / 1e6:.0f} MB"
