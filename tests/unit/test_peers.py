"""Peer programs of benchmarks/peers.py: closed forms, and the files exchanged with them.

Programs that are not installed must say so; what they would have computed is then not tested.
"""

from __future__ import annotations

import re
import sys
import time

import numpy as np
import pytest

from benchmarks import peers
from fenics_contact import JointLaw
from fenics_contact.meshing import wall
from fenics_contact.discretization.discretization import Structure
from tests.helpers import coulomb, on_ground, tresca
from tests.regression.scenes import wall_scene, wedge_scene

B, H = 0.4, 1.0


def block(law: JointLaw, elements: int = 1) -> Structure:
    """A block B wide and H high on rigid ground, pushed by its weight."""
    return Structure.build(on_ground(wall([[1]], (B, H), elements), law))


def asked(peer: str, structure: Structure) -> peers.Answer:
    return peers.PEERS[peer].ask(structure, time.perf_counter() + 60.0)


@pytest.mark.parametrize("peer", peers.PEERS)
@pytest.mark.parametrize("friction", [0.3, 0.5])
def test_block_slides_or_tips(peer, friction):
    answer = asked(peer, block(coulomb(friction)))
    if not peers.PEERS[peer].version():
        assert peer in ("siconos", "calculix")
        assert answer.status == "not installed"
        return
    expected = min(friction, B / H)
    tolerance = max(answer.tolerance, 1e-6)
    assert answer.status == ("last converged" if peer == "calculix" else "limit")
    assert answer.load_factor == pytest.approx(expected, rel=tolerance)
    assert answer.tolerance <= 0.05


@pytest.mark.parametrize("peer", ["rigid-lp", "gilbert"])
def test_given_friction_is_one_program(peer):
    structure = block(tresca(1000.0))
    weight = structure.bodies.live[0, 0]
    answer = asked(peer, structure)
    assert answer.load_factor == pytest.approx(1000.0 * B / weight, rel=1e-9)


@pytest.mark.parametrize("peer", ["siconos", "calculix"])
def test_given_friction_is_not_asked_of_programs_without_it(peer):
    expected = "not applicable" if peers.PEERS[peer].version() else "not installed"
    assert asked(peer, block(tresca(1000.0))).status == expected


@pytest.mark.parametrize("peer", ["siconos", "calculix"])
def test_program_that_is_missing_says_so(peer, monkeypatch):
    monkeypatch.setattr(peers.shutil, "which", lambda name: None)
    monkeypatch.setitem(sys.modules, "siconos.numerics", None)
    assert asked(peer, block(coulomb(0.3))).status == "not installed"
    row = peers.run(peers.Task("wedge F=0.1", 2, peer, 1.0))
    assert (row.case, row.method, row.status) == ("wedge F=0.1", peer, "not installed")


@pytest.mark.parametrize("friction", [0.1, 0.2])
def test_gilbert_where_statics_decides(friction):
    exact = {0.1: 0.1549061349, 0.2: 0.4264946007}[friction]
    answer = asked("gilbert", Structure.build(wedge_scene(friction)))
    assert answer.status == "limit"
    assert answer.load_factor == pytest.approx(exact, rel=1e-6)


def test_gilbert_is_below_associative_friction():
    structure = Structure.build(wall_scene("W3", coulomb(0.65), elements=1))
    upper, answer = asked("rigid-lp", structure), asked("gilbert", structure)
    assert upper.load_factor == pytest.approx(0.40369, rel=1e-4)
    assert 0.35 < answer.load_factor < 0.99 * upper.load_factor


def test_gilbert_says_when_time_is_up():
    structure = Structure.build(wall_scene("W3", coulomb(0.65), elements=1))
    assert peers.gilbert(structure, time.perf_counter()).status == "time-out"


def test_gilbert_shows_how_far_load_factors_swing():
    program = peers.Gilbert(block(coulomb(0.3)))
    answer = program.restless([9.0] + 10 * [0.3, 0.5])
    assert (answer.status, answer.load_factor) == ("not_converged", pytest.approx(0.4))
    assert answer.residual == pytest.approx(0.25)


def test_deck_of_a_block_on_the_ground():
    structure = block(coulomb(0.3), elements=2)
    deck = peers.Deck(structure, top=0.5, spring=1.0).text()
    nodes = np.array(
        [line.split(",") for line in re.findall(r"^\d+,[^,\n]+,[^,\n]+,0\.$", deck, re.M)], float
    )
    assert list(nodes[:, 0]) == list(range(1, len(nodes) + 1))
    tables = re.findall(r"\*ELEMENT,TYPE=CPE(\d),ELSET=(\w+)\n((?:[\d,]+\n)+)", deck)
    assert {name for _, name, _ in tables} == {"CELLS0", "BELOW"}
    for width, name, rows in tables:
        cells = np.array([row.split(",") for row in rows.split()], int)
        assert cells.shape[1] == int(width) + 1
        corners = nodes[cells[:, 1:] - 1, 1:3]
        there = np.roll(corners, -1, axis=1)
        turn = corners[..., 0] * there[..., 1] - there[..., 0] * corners[..., 1]
        assert np.all(turn.sum(axis=1) > 0.0)
        assert (corners[..., 1].max() < 1e-12) == (name == "BELOW")
    loads = [
        np.array([line.split(",")[1:] for line in block.split()], float)
        for block in re.findall(r"\*CLOAD\n((?:[^*\n]+\n)+)", deck)
    ]
    weight = -loads[0][loads[0][:, 0] == 2, 1].sum()
    assert weight == pytest.approx(-structure.bodies.dead[0, 1])
    assert loads[1][loads[1][:, 0] == 1, 1].sum() == pytest.approx(0.5 * weight)


def test_deck_has_a_contact_pair_per_straight_face():
    structure = Structure.build(wall_scene("2x2", coulomb(0.3)))
    deck = peers.Deck(structure, top=0.5, spring=1.0)
    pairs = re.findall(r"\*CONTACT PAIR,.*\n(\w+),(\w+)\n", deck.text())
    assert len(pairs) == len(deck.faces.friction)
    assert all(deck.text().count(f"NAME={name},") == 1 for pair in pairs for name in pair)


STATUS = """\
SUMMARY OF JOB INFORMATION
  STEP      INC     ATT  ITRS     TOT TIME     STEP TIME      INC TIME
     1          1     1     4  0.100000E+01  0.100000E+01  0.100000E+01
"""


@pytest.mark.parametrize(
    ("rows", "reached"),
    [
        ("", 0.0),
        ("     2          1     1    12  0.102000E+01  0.200000E-01  0.200000E-01\n", 0.02),
        (
            "     2          1     1    12  0.102000E+01  0.200000E-01  0.200000E-01\n"
            "     2          2     1U   21  0.104000E+01  0.400000E-01  0.200000E-01\n",
            0.02,
        ),
    ],
)
def test_last_increment_that_converged(rows, reached):
    assert peers.converged_time(STATUS + rows) == reached


def test_dead_load_that_does_not_converge():
    failed = STATUS.replace(" 1     4", " 1U   21")
    assert np.isnan(peers.converged_time(failed))
    assert np.isnan(peers.converged_time(""))
