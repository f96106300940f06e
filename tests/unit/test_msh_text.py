"""Text files of gmsh: what is read without it, as gmsh reads it, and what is left to it."""

from __future__ import annotations

from pathlib import Path

import gmsh
import numpy as np
import pytest

from fenics_contact.geometry.gmsh_mesh import GmshContents, gmsh_session, read, text_contents
from fenics_contact.meshing import arch, buttress, running_bond, wall
from tests.quick import slow, some

DRAWN = {
    "wall with an opening": lambda: wall([[1.0, -1.0, 1.0], [1.5, 1.5]]),
    "quadrilaterals": lambda: running_bond(2, 2, quadrilaterals=True),
    "arch": lambda: arch(5, 0.3),
    "several materials": lambda: buttress(2),
}


def written(path: Path, draw, **options: float) -> Path:
    with gmsh_session(**options):
        draw()
        gmsh.write(str(path))
    return path


def rectangles() -> None:
    """Two rectangles by gmsh's own geometry, of which one has no group and one edge is reversed."""
    gmsh.model.add("rectangles")
    for x in (0.0, 3.0):
        gmsh.model.occ.addRectangle(x, 0.0, 0.0, 2.0, 1.0)
    gmsh.model.occ.synchronize()
    for dim, entities, tag in ((2, [1], 7), (1, [-1, 2], 9), (0, [1], 4)):
        gmsh.model.addPhysicalGroup(dim, entities, tag)
    gmsh.model.setPhysicalName(2, 7, "stone, dressed")
    gmsh.model.setPhysicalName(0, 4, "corner")
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(int(gmsh.option.getNumber("Mesh.ElementOrder")))


def assert_same(found: GmshContents | None, expected: GmshContents) -> None:
    assert found is not None
    assert list(found.groups.items()) == list(expected.groups.items())
    assert found.kinds == expected.kinds
    np.testing.assert_array_equal(found.tags, expected.tags)
    np.testing.assert_array_equal(found.coordinates, expected.coordinates)
    assert [entity[:3] for entity in found.elements] == [entity[:3] for entity in expected.elements]
    for (*_, mine), (*_, theirs) in zip(found.elements, expected.elements, strict=True):
        np.testing.assert_array_equal(mine, theirs)
        assert mine.dtype == theirs.dtype


@pytest.mark.parametrize("name", some([*DRAWN], 2))
def test_is_read_as_gmsh_reads_it(name, tmp_path):
    path = written(tmp_path / "drawn.msh", DRAWN[name])
    assert_same(text_contents(path), read(path))


@pytest.mark.parametrize("everything", [1.0, *slow(0.0)])
def test_groups_without_names_and_reversed_edges(everything, tmp_path):
    path = written(tmp_path / "drawn.msh", rectangles, SaveAll=everything)
    assert_same(text_contents(path), read(path))


@pytest.mark.parametrize(
    "options", [{"Binary": 1.0}, *slow({"MshFileVersion": 2.2}, {"ElementOrder": 2.0})]
)
def test_other_formats_are_left_to_gmsh(options, tmp_path):
    path = written(tmp_path / "drawn.msh", rectangles, **options)
    assert text_contents(path) is None
    assert read(path).groups[2, 7] == "stone, dressed"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("4.1 0 8", "4.1 0 4"),
        ("$EndNodes\n", ""),
        ("$Nodes\n", "$Nodes\nx "),
        ("$Nodes\n", "$Nodes\n1 "),
        ("$Elements\n", "$NodeData\n1\n$EndNodeData\n$Elements\n"),
        ("0.4 0.6", "nan 0.6"),
        ("0.4 0.6", "1e999 0.6"),
        ("\n1\n2\n3\n", "\n1\n2\n2\n"),
        ("\n1\n2\n3\n", "\n1\n2.5\n3\n"),
        ("\n1\n2\n3\n", "\n1\n2\n777\n"),
        ('"base"', "base"),
        ('"base"', '"ba\u0007se"'),
        ("$EndElements\n", "$EndElements\nmore\n"),
    ],
)
def test_what_is_not_well_formed_is_left_to_gmsh(old, new, tmp_path):
    path = written(tmp_path / "drawn.msh", lambda: wall([[1.0], [1.0], [1.0], [1.0]], (0.4, 0.2)))
    text = path.read_text()
    assert old in text
    assert text_contents(path) is not None
    path.write_text(text.replace(old, new, 1))
    assert text_contents(path) is None
