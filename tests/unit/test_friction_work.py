"""The work of friction by group of joints, against two blocks that slide, by hand."""

from __future__ import annotations

import pytest

from fenics_contact import OutputOptions, SolveOptions, limit_load
from fenics_contact.meshing import polygons
from fenics_contact.output.files import result_record
from tests.drawing import rectangle
from tests.helpers import coulomb, on_ground


def test_two_blocks_that_slide_share_the_work():
    """Blocks of one weight on frictions .2 and .4: one third and two thirds."""
    groups = {"smooth": [((0, 0), (1, 0))], "rough": [((1, 0), (2, 0))]}
    model = polygons([rectangle(0, 0, 1, 0.5), rectangle(1, 0, 2, 0.5)], 0.5, groups=groups)
    scene = on_ground(
        model,
        coulomb(0.0),
        foundations={"smooth": coulomb(0.2), "rough": coulomb(0.4)},
        solve=SolveOptions(fast=True),
        output=OutputOptions(paraview=False, pictures=False),
    )
    result = limit_load(scene)
    assert result.load_factor == pytest.approx(0.3, rel=1e-6)
    exact = {"rough": 2.0 / 3.0, "smooth": 1.0 / 3.0}
    assert result.friction_work == pytest.approx(exact, rel=1e-6)
    assert list(result.friction_work) == ["rough", "smooth"]
    assert "work of friction: rough 66.7 %, smooth 33.3 %" in result.summary(verbose=True)
    record = result_record(result)
    assert record["friction_work"] == result.friction_work
    rows = dict(record["directions"]["positive"]["tables"][0]["rows"])
    assert rows["work of friction"] == "rough 66.7 %, smooth 33.3 %"
