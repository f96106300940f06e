"""From a drawing to a load factor: gmsh models as users draw them, and DXF files."""

from __future__ import annotations

from pathlib import Path

import pytest

from fenics_contact.mesh import gmsh_session
from tests.system.program import changed, result, run_here, toml


def write_fragments(path: Path, *boxes: tuple[float, float, float, float]) -> None:
    """Draw rectangles (x, y, length, height) as gmsh surfaces that share curves; "base", "bed"."""
    with gmsh_session(MeshSizeMax=0.25) as gmsh:
        gmsh.model.add("fragments")
        occ = gmsh.model.occ
        occ.fragment([(2, occ.addRectangle(x, y, 0, a, b)) for x, y, a, b in boxes], [])
        occ.synchronize()
        surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
        gmsh.model.setPhysicalName(2, gmsh.model.addPhysicalGroup(2, surfaces), "blocks")
        for name, level in (("base", 0.0), ("bed", 0.5)):
            strip = (-1.0, level - 0.01, -1.0, 10.0, level + 0.01, 1.0)
            curves = [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*strip, dim=1)]
            gmsh.model.setPhysicalName(1, gmsh.model.addPhysicalGroup(1, curves), name)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(path))
        gmsh.model.remove()


#: Two blocks of 1 m x 0.5 m under a long one; the bed joint between them is the weakest.
TABLE = ((0, 0, 1, 0.5), (1, 0, 1, 0.5), (0, 0.5, 2, 0.5))
WEAK_BED = {"joints.bed": {"friction": 0.2}, "foundations.base.friction": 0.6}


@pytest.mark.parametrize(
    ("blocks", "code", "load_factor"), [("surfaces", 0, 0.2), ("connected", 2, None)]
)
def test_fragments_slide_on_the_joint_between_them(blocks, code, load_factor, folder, capsys):
    write_fragments(folder / "block.msh", *TABLE)
    scene = {**WEAK_BED, "mesh.blocks": blocks}
    (folder / "scene.toml").write_text(toml(changed(scene)))
    found = run_here(["solve", folder / "scene.toml", "-o", folder / "out"], capsys)
    assert found.code == code, found.err
    if load_factor:
        assert result(folder / "out")["load_factor"] == pytest.approx(load_factor, rel=1e-6)
    else:
        assert "group 'bed'" in found.err and 'mesh.blocks = "surfaces"' in found.err
