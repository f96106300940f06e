"""Other programs on blocks whose load factor is known; those that are missing say so."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.peers import PEERS, peer, rigid_lp
from benchmarks.peers.blocks import Blocks
from benchmarks.scenes import arch_blocks, wall_blocks
from tests.bank import BANK, rectangle

SINGLE = [np.array(rectangle(0.0, 0.0, 0.4, 1.0))]


@pytest.mark.parametrize("name", PEERS)
@pytest.mark.parametrize("friction", [0.3, 0.5])
def test_block_slides_or_tips(name, friction):
    program = peer(name)
    if not program.version():
        pytest.skip(f"{name} is not installed")
    answer = program.solve(Blocks(SINGLE, friction, 0.2), program.RESOLUTIONS[-1])
    assert answer.status == ("last converged" if name == "calculix" else "limit")
    assert answer.load_factor == pytest.approx(min(friction, 0.4), rel=5e-3)


PROGRAMS = {f"{wall} bracket 0.65": wall_blocks(wall, 0.65) for wall in ("W1", "W3", "W4")}
PROGRAMS["arch 27 0.15"] = arch_blocks(27, 0.15, 1.0)


@pytest.mark.parametrize("name", PROGRAMS)
def test_associative_program(name):
    factor = rigid_lp.solve(PROGRAMS[name]).load_factor
    assert factor == pytest.approx(BANK[name].interval[1], abs=1e-5)


def test_gilbert_is_below_associative_friction():
    blocks = wall_blocks("W4", 0.65)
    upper, answer = rigid_lp.solve(blocks), peer("gilbert").solve(blocks)
    assert 0.3 < answer.load_factor < 0.97 * upper.load_factor
    assert peer("gilbert").solve(blocks, deadline=0.0).status == "time-out"
