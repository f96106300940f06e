"""Facades, bridges and retaining walls: their blocks, areas and groups, and that they stand."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from fenics_contact import InputError
from fenics_contact.builders import bridge, facade, retaining_wall
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.geometry.gmsh_mesh import bodies_of_cells, extract
from fenics_contact.geometry.planar_cells import check_apart
from tests.drawing import area
from tests.helpers import cell_areas, coulomb, group_lengths, on_ground


def areas(drawing) -> dict[str, float]:
    """Area of every two-dimensional group, m2."""
    found: Counter[str] = Counter()
    for name, block in zip(drawing.names, drawing.blocks, strict=True):
        found[name] += area(block)
    return dict(found)


def check_mesh(drawing, size: float) -> None:
    """The mesh has the blocks, areas and sides of the drawing, side by side, with no gap."""
    drawn = extract(drawing.mesh(size), "drawing")
    body = bodies_of_cells(drawn)
    assert body.max() + 1 == len(drawing.blocks)
    check_apart(drawn.points, drawn.cells, body, "drawing")
    assert len(drawing.gaps()) == 0
    assert cell_areas(drawn).sum() == pytest.approx(sum(areas(drawing).values()), rel=1e-9)
    assert group_lengths(drawn) == pytest.approx(drawing.lengths(), rel=1e-9)


def stands(drawing) -> bool:
    """Whether rigid blocks with friction 0.7 stand on their base."""
    scene = on_ground(drawing.mesh(1.0), coulomb(0.7))
    with Discretization(scene) as blocks:
        return RigidBlocks.of(blocks).stands()


@pytest.mark.parametrize(("storeys", "bays", "sill"), [(2, 3, 0.75), (1, 1, 0.0)])
def test_facade(storeys, bays, sill):
    wide, high, pier, (length, course) = 1.0, 1.25, 1.0, (0.5, 0.25)
    drawing = facade(storeys, bays, (wide, high), pier, (length, course), sill)
    total = bays * (wide + pier) + pier
    storey = sill + high + 2 * course
    assert sum(areas(drawing).values()) == pytest.approx(
        storeys * (total * storey - bays * wide * high), rel=1e-12
    )
    lintel = wide + 2 * 0.25
    rest = total - bays * lintel
    expected = {
        "piers": storeys * ((bays + 1) * pier * high + rest * course),
        "lintels": storeys * bays * lintel * course,
        "floors": storeys * total * course,
    } | ({"spandrels": storeys * total * sill} if sill else {})
    assert areas(drawing) == pytest.approx(expected, rel=1e-12)
    count = Counter(drawing.names)
    assert (count["lintels"], count["floors"]) == (storeys * bays, storeys * bays)
    lengths = drawing.lengths()
    ground = total if sill else (bays + 1) * pier
    sides = {"base": ground, "top": total, "left": storeys * storey, "right": storeys * storey}
    assert lengths == pytest.approx(sides, rel=1e-9)
    check_mesh(drawing, 0.25)
    assert stands(drawing)


PLAIN = {"rings": 1, "pier": (1.5, 2.0), "cover": 0.3, "parapet": 0.0}


@pytest.mark.parametrize(
    ("span", "rise", "voussoirs", "spans", "parts"),
    [
        (6.0, 1.5, 15, 1, PLAIN),
        (6.0, 3.0, 14, 1, PLAIN),  # a semicircle: no skewbacks
        (6.0, 1.5, 9, 2, PLAIN | {"rings": 2, "parapet": 0.5}),
        (6.0, 2.0, 9, 3, PLAIN | {"pier": (1.5, 0.0), "cover": 0.5}),
    ],
)
def test_bridge(span, rise, voussoirs, spans, parts):
    ring = 0.4
    drawing = bridge(span, rise, ring, voussoirs, spans, **parts)
    radius = 0.5 * (0.25 * span**2 / rise + rise)
    half = np.arctan2(0.5 * span, radius - rise)
    step, thick = 2.0 * half / voussoirs, parts["rings"] * ring
    count, found = Counter(drawing.names), areas(drawing)
    assert count["voussoirs"] == spans * parts["rings"] * voussoirs
    ring_area = 0.5 * np.sin(step) * ((radius + thick) ** 2 - radius**2)
    assert found["voussoirs"] == pytest.approx(spans * voussoirs * ring_area, rel=1e-12)
    assert count["skewbacks"] == (0 if rise == 0.5 * span else spans + 1)
    wide, high = parts["pier"]
    assert found.get("piers", 0.0) == pytest.approx((spans + 1) * wide * high, rel=1e-12)
    total = spans * span + (spans + 1) * wide
    assert found.get("parapets", 0.0) == pytest.approx(total * parts["parapet"], rel=1e-12)
    crown = (radius + thick) * np.cos(0.5 * step * (voussoirs % 2)) - radius + rise
    opening = 0.5 * voussoirs * radius**2 * np.sin(step) - 0.5 * span * (radius - rise)
    box = total * (crown + parts["cover"] + parts["parapet"] + high) - spans * span * high
    assert sum(found.values()) == pytest.approx(box - spans * opening, rel=1e-12)
    lengths = drawing.lengths()
    chord = 2.0 * radius * np.sin(0.5 * step)
    assert lengths["intrados"] == pytest.approx(spans * voussoirs * chord, rel=1e-9)
    assert lengths["springings"] == pytest.approx(4 * spans * thick, rel=1e-9)  # both sides
    assert lengths["base"] == pytest.approx((spans + 1) * wide, rel=1e-9)
    assert ("rings" in lengths) == (parts["rings"] > 1)
    check_mesh(drawing, 0.4)
    assert stands(drawing)


@pytest.mark.parametrize(("courses", "stones"), [(8, 3), (1, 3), (5, 1), (6, 2)])
def test_retaining_wall(courses, stones):
    height, base, top = 2.4, 1.2, 0.6
    drawing = retaining_wall(height, base, top, courses, stones)
    assert sum(areas(drawing).values()) == pytest.approx(0.5 * (base + top) * height, rel=1e-12)
    extra = 1 if stones > 1 else 0  # in every second course
    below = courses - 1
    assert len(drawing.blocks) == below * stones + extra * (below // 2) + 1
    face = np.hypot(height, base - top)
    sides = {"base": base, "top": top, "back": height, "face": face}
    assert drawing.lengths() == pytest.approx(sides, rel=1e-9)
    check_mesh(drawing, 0.2)
    assert stands(drawing)


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda: facade(bays=0), "facade: .* one bay"),
        (lambda: facade(sill=-1.0), "facade: sizes"),
        (lambda: facade(block=(0.5, 0.0)), "facade: sizes"),
        (lambda: bridge(6.0, 3.1, 0.4), "bridge: 0 < rise"),
        (lambda: bridge(6.0, 1.5, 0.4, voussoirs=0), "bridge: give one"),
        (lambda: bridge(6.0, 1.5, 0.4, cover=0.0), "bridge: the cover"),
        (lambda: bridge(6.0, 1.5, 0.4, parapet=-1.0), "bridge: the parapet"),
        (lambda: bridge(6.0, 1.5, 1.0, spans=2), "bridge: piers must be 1.6 m wide"),
        (lambda: retaining_wall(2.0, 0.5, 0.6), "top at most base"),
        (lambda: retaining_wall(2.0, 1.0, 0.6, stones=0), "retaining_wall: give"),
    ],
)
def test_sizes_that_make_no_structure(draw, message):
    with pytest.raises(InputError, match=message):
        draw()
