"""Stresses in blocks in space against closed solutions, statics and the planar program."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import ufl

from fenics_contact import Scene as MeshScene
from fenics_contact import compat
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.materials import cell_field, lame_numbers
from fenics_contact.elastic.body import ElasticBody
from fenics_contact.elastic.means import Surface, means
from fenics_contact.elastic.shapes import Placed
from fenics_contact.elastic.stresses import (
    at_nodes,
    forces_on_blocks,
    sorted_blocks,
    stressed_blocks,
)
from fenics_contact.elastic.tetrahedra import tetrahedra
from fenics_contact.errors import InputError, SolverError
from fenics_contact.geometry.gmsh_mesh import gmsh_session
from fenics_contact.meshing import polygons
from fenics_contact.output.fields import cell_stresses
from fenics_contact.results.result import Collapse
from fenics_contact.scene.scene import JointLaw
from fenics_contact.spatial import Load, Material, Scene, standing
from fenics_contact.spatial.contacts import Contact, frame
from fenics_contact.spatial.loads import Sides
from fenics_contact.spatial.points import points_of
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from tests.helpers import mesh_of

WEIGHT = Load(body=(0.0, 0.0, -10.0))
STONE = Material(young=1e9, poisson=0.2, density=2000.0)
LAWS = {"default": JointLaw(friction=0.7)}
PRESSURE = 1e5


def box(low: Any, high: Any, name: str, fixed: bool = False) -> Block:
    return Block((Polyhedron.box(low, high),), name, fixed=fixed)


def prism(outline: Any, low: float, top: Any, name: str) -> Block:
    """A body between the plane z = low and the heights `top` of the corners of its outline."""
    flat = np.array(outline, dtype=float)
    ends = np.insert(flat, 2, low, axis=1), np.column_stack([flat, np.full(len(flat), top)])
    return Block((Polyhedron.hull(np.vstack(ends)),), name)


def scene_of(*blocks: Block, **options: Any) -> Scene:
    parts = {"materials": {"default": STONE}, "joints": LAWS, "dead": WEIGHT}
    return Scene(blocks=blocks, **(parts | options))


def body_of(block: Block, size: float, degree: int, stone: Material = STONE) -> ElasticBody:
    def law(domain: Any) -> Any:
        count = domain.topology.index_map(3).size_local
        return tuple(cell_field(domain, "law", np.full(count, v)) for v in lame_numbers(stone))

    return ElasticBody(*tetrahedra(block, size), law, degree)


SQUARE = [(0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.0, 0.5)]
HEXAGON = [(np.cos(a), np.sin(a)) for a in np.pi / 3.0 * np.arange(6)]
SKEW = [(0.0, 0.0), (0.6, 0.1), (0.7, 0.5), (0.1, 0.4)]
TRIANGLE = [(0.0, 0.0), (0.6, 0.1), (0.1, 0.5)]


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("outline", [SQUARE, HEXAGON, SKEW, TRIANGLE], ids=str)
def test_means_of_rigid_motions_are_their_values_at_points(outline, degree):
    """B R = H, on a mesh that knows nothing of the contact."""
    body = body_of(box((-1.5, -1.5, 0.0), (1.5, 1.5, 1.0), "wide"), 0.6, degree)
    corners = np.insert(np.array(outline), 2, 1.0, axis=1)
    contact = Contact(0, 1, frame(np.array([0.0, 0.0, 1.0]), corners[1] - corners[0]), corners)
    position, areas = points_of(contact)
    table = means(body, Surface(corners, contact.axes, 1.0, areas))
    np.testing.assert_allclose(table @ np.ones(len(body.nodes)), 1.0, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(table @ body.nodes, position, rtol=0.0, atol=3e-12)


def uniform(scene: Scene) -> Collapse:
    """Forces at points of a pressure along z that is the same everywhere."""
    structure = scene.structure()
    axes = structure.axes[: len(structure.points.area)]
    push = PRESSURE * axes[:, :1, 2:] * axes[:, :, 2:]  # n_z e_z on the second block
    force = structure.points.area[:, None] * push[:, :, 0]
    return Collapse(load_factor=0.0, force=force, tension=np.zeros(0))


def column(outline: Any, slope: float) -> Scene:
    """Two blocks on the ground, with an inclined joint, pressed from above."""
    flat = np.array(outline, dtype=float)
    joint = 1.0 + slope * flat[:, 0]
    low = prism(outline, 0.0, joint, "low")
    ends = np.column_stack([flat, joint]), np.insert(flat, 2, 2.2, axis=1)
    high = Block((Polyhedron.hull(np.vstack(ends)),), "high")
    dead = Load(traction={"top": (0.0, 0.0, -PRESSURE)})
    return scene_of(
        low, high, dead=dead, sides={"top": Sides(block="high", normal=(0.0, 0.0, 1.0))}
    )


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("slope", [0.0, 0.3])
@pytest.mark.parametrize("outline", [SQUARE, HEXAGON], ids=["square", "hexagon"])
def test_uniform_pressure_passes_through_meshes_that_do_not_match(outline, slope, degree):
    scene = column(outline, slope)
    structure = scene.structure()
    acts = forces_on_blocks(structure, uniform(scene))
    for number, size in ((0, 0.31), (1, 0.23)):
        body = body_of(structure.blocks[number], size * np.ptp(outline), degree)
        placed = Placed(number, number, np.eye(3), np.zeros(3))
        force = at_nodes(body, placed, acts[number], {}).reshape(-1, 1)
        whole = np.abs(force).sum()
        np.testing.assert_allclose(body.balanced(force), force, atol=1e-12 * whole)
        u = body.displacements(body.balanced(force))
        np.testing.assert_allclose(body.stiffness @ u, force, atol=1e-13 * whole)
        found = body.stresses(u[:, 0])
        expected = np.diag([0.0, 0.0, -PRESSURE])
        np.testing.assert_allclose(found - expected, 0.0, atol=5e-12 * PRESSURE)


def stressed(scene: Scene, end: Collapse) -> dict[str, Any]:
    """Stresses of blocks by name."""
    structure = scene.structure()
    found = stressed_blocks(scene, structure, end, sorted_blocks(scene, structure))
    assert not found.missed
    return {one.name: one for one in found.blocks}


def stands(scene: Scene, load_factor: float = 0.0) -> Collapse:
    end = standing(scene, load_factor).positive
    assert end is not None and end.status == "equilibrium"
    return end


def test_block_is_pressed_by_what_is_above():
    """sigma_zz = -w (H - z) where springs press evenly."""
    scene = scene_of(box((0.0, 0.0, 0.0), (0.5, 0.4, 3.0), "pier"), mesh_size=0.25)
    one = stressed(scene, stands(scene))["pier"]
    expected = -2e4 * (3.0 - one.points[:, 2])
    np.testing.assert_allclose(one.stress[:, 2, 2], expected, atol=1e-5 * 6e4)
    np.testing.assert_allclose(one.stress[:, :2], 0.0, atol=1e-5 * 6e4)
    assert one.pressure[0] == pytest.approx(6e4, rel=1e-5)
    assert one.pressure[1][2] == pytest.approx(0.0, abs=1e-12)


def test_pier_is_a_cantilever():
    """N, M, the tip by S.P. Timoshenko, stresses by Navier; it is pushed by 2 % of its weight."""
    b, t, h, w, push = 0.5, 0.4, 3.0, 2e4, 0.02
    live = Load(body=(10.0, 0.0, 0.0))
    scene = scene_of(box((0, 0, 0), (b, t, h), "pier"), live=live, mesh_size=0.25)
    end = stands(scene, push)
    q, inertia, shear = push * w * b * t, t * b**3 / 12.0, STONE.young / 2.4
    normal, place = np.asarray(end.force)[:, 0], scene.structure().points.position
    assert normal.sum() == pytest.approx(w * b * t * h, rel=1e-6)
    assert normal @ (place[:, 0] - 0.5 * b) == pytest.approx(0.5 * q * h**2, rel=1e-6)
    one = stressed(scene, end)["pier"]
    foot, top = (np.abs(one.points[:, 2] - z) < 1e-9 for z in (0.0, h))
    arms = one.points[foot] - one.points[foot].mean(axis=0)
    turn = (arms[:, 0] @ one.displacement[foot, 2]) / (arms[:, 0] @ arms[:, 0])  # about -y
    tip = (one.displacement[top, 0].mean() - one.displacement[foot, 0].mean()) + h * turn
    exact = q * h**4 / (8.0 * STONE.young * inertia) + 1.2 * q * h**2 / (2.0 * shear * b * t)
    assert tip == pytest.approx(exact, rel=0.01)
    mid = (one.points[:, 2] > 0.75) & (one.points[:, 2] < 2.25)
    x, _, z = one.points[mid].T
    bending = q * (h - z) ** 2 / 2.0 * (x - 0.5 * b) / inertia
    sigma = -w * (h - z) - bending
    missed = one.stress[mid, 2, 2] - sigma
    assert np.linalg.norm(missed) < 0.01 * np.linalg.norm(sigma)


def lintel(width: float) -> Scene:
    """A beam over an opening of 1.6 m, on two supports of 0.2 m."""
    blocks = [box((0.0, 0.0, 0.0), (2.0, width, 0.3), "lintel")]
    for k, x in enumerate((0.0, 1.8)):
        blocks.append(box((x, -0.1, -0.5), (x + 0.2, width + 0.1, 0.0), f"support_{k}", True))
    return scene_of(*blocks, mesh_size=0.1)


def test_lintel_bends_as_a_beam():
    """M of its weight and of the forces that it stands on, stresses by Navier at midspan."""
    scene = lintel(0.25)
    end = stands(scene)
    points, normal = scene.structure().points.position, np.abs(np.asarray(end.force)[:, 0])
    weight = 2e4 * 0.25 * 0.3
    left = points[:, 0] < 1.0
    moment = normal[left] @ (1.0 - points[left, 0]) - 0.5 * weight
    one = stressed(scene, end)["lintel"]
    x, _, z = one.points.T
    mid = (np.abs(x - 1.0) < 0.3) & (z < 1e-9)
    bending = moment - 0.5 * weight * (x[mid] - 1.0) ** 2
    expected = bending * 6.0 / (0.25 * 0.3**2)
    missed = one.stress[mid, 0, 0] - expected
    assert np.linalg.norm(missed) < 0.02 * np.linalg.norm(expected)
    assert one.tension[0] == pytest.approx(moment * 6.0 / (0.25 * 0.3**2), rel=0.02)
    assert one.tension[1][0] == pytest.approx(1.0, abs=0.15)


def test_lintel_of_one_element_is_in_plane_stress():
    """Against the planar program on its own mesh, under the same forces."""
    width = 0.05
    scene = lintel(width)
    structure = scene.structure()
    area = structure.points.area
    up = np.sign(structure.axes[0, 0, 2]) * 2e4 * width * 2.0 * 0.3 / area.sum()
    axes = structure.axes[: len(area)]
    second = np.array([one.second for one in structure.contacts])[structure.points.contact]
    sign = np.where(second == 0, 1.0, -1.0)[:, None]  # force on the second block
    force = sign * area[:, None] * abs(up) * axes[:, :, 2]
    one = stressed(scene, Collapse(load_factor=0.0, force=force, tension=np.zeros(0)))["lintel"]
    press = 2e4 * 2.0 * 0.3 / 0.4  # Pa, under both ends
    outline = [(0.0, 0.0), (0.2, 0.0), (1.8, 0.0), (2.0, 0.0), (2.0, 0.3), (0.0, 0.3)]
    ends = {"ends": [((0.0, 0.0), (0.2, 0.0)), ((1.8, 0.0), (2.0, 0.0))]}
    mesh = mesh_of(polygons([outline], 0.1, groups=ends))

    def forces(v: Any, dx: Any, ds: Any) -> Any:
        return -2e4 * v[1] * dx + press * v[1] * ds("ends")

    parts = {"plane": "stress", "degree": 2, "foundations": {"ends": JointLaw(friction=0.7)}}
    planar = MeshScene(mesh, {"default": STONE}, Load(form=forces), **parts)
    with Discretization(planar) as made:
        table = made.elasticity.stiffness.convert("dense").getDenseArray()
        u = np.linalg.lstsq(table, made.elasticity.live, rcond=1e-12)[0]
        sigma = cell_stresses(made.layout, u)[:, 0]
        cells = compat.geometry_dofs(mesh.domain)
        middle = mesh.domain.geometry.x[cells].mean(axis=1)
    low = (np.abs(middle[:, 0] - 1.0) < 0.3) & (middle[:, 1] < 0.1)
    x, y, *_ = middle[low].T
    slope = np.linalg.lstsq(
        np.column_stack([np.ones(len(x)), y, (x - 1.0) ** 2]), sigma[low], rcond=None
    )[0]
    mid = (np.abs(one.points[:, 0] - 1.0) < 0.3) & (one.points[:, 2] < 1e-9)
    x = one.points[mid, 0]
    expected = slope[0] + slope[2] * (x - 1.0) ** 2
    missed = one.stress[mid, 0, 0] - expected
    assert np.linalg.norm(missed) < 0.02 * np.linalg.norm(expected)


def test_blocks_that_are_turned_share_a_mesh():
    """Stresses of turned blocks are those of the first one, turned with it."""
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    outline = [(0.0, 0.0), (0.6, 0.0), (0.5, 0.4), (0.0, 0.3)]
    first = prism(outline, 0.0, 0.7, "first")
    other = Polyhedron(first.pieces[0].corners @ turn.T + [3.0, 1.0, 0.0], first.pieces[0].sides)
    scene = scene_of(first, Block((other,), "other"))
    structure = scene.structure()
    shapes = sorted_blocks(scene, structure)
    assert [len(shape) for shape in shapes] == [2]
    found = stressed(scene, stands(scene))
    one, two = found["first"], found["other"]
    np.testing.assert_allclose(two.points, one.points @ turn.T + [3.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(two.principal, one.principal, atol=2e-3 * 1.4e4)


def isotropic(strain: Any, material: Material) -> Any:
    first, shear = lame_numbers(material)
    return 2.0 * shear * strain + first * ufl.tr(strain) * ufl.Identity(3)


def by_place(strain: Any, material: Material, x: Any) -> Any:
    """Isotropic, ten times as stiff behind y = 10, where no block is."""
    return ufl.conditional(ufl.lt(x[1], 10.0), 1.0, 10.0) * isotropic(strain, material)


def oblique(strain: Any, material: Material) -> Any:
    """Twice as stiff along x."""
    along = ufl.as_matrix([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    return isotropic(strain, material) + material.young * strain[0, 0] * along


@pytest.mark.parametrize("law", [isotropic, by_place])
def test_law_of_the_user_is_that_of_the_material(law):
    scene = lintel(0.25)
    end = stands(scene)
    usual, given = (stressed(one, end)["lintel"] for one in (scene, replace(scene, stress=law)))
    np.testing.assert_allclose(given.stress, usual.stress, atol=1e-9 * np.abs(usual.stress).max())


def test_law_of_the_user_changes_strains():
    scene = lintel(0.25)
    end = stands(scene)
    usual, given = (stressed(one, end)["lintel"] for one in (scene, replace(scene, stress=oblique)))
    sag, less = (np.ptp(one.displacement[:, 2]) for one in (usual, given))
    assert 0.5 * sag < less < 0.56 * sag  # shear is as before


def test_what_is_no_law_is_refused():
    scene = replace(lintel(0.25), stress=lambda strain, material: ufl.tr(strain))
    with pytest.raises(InputError, match=r"law of material 'default' fails: .* symmetric 3 x 3"):
        stressed(scene, stands(scene))


def test_sliver_is_told_by_name():
    thin = box((0.0, 0.0, 0.3), (2.0, 2.0, 0.3005), "sheet")
    scene = scene_of(box((0.0, 0.0, 0.0), (2.0, 2.0, 0.3), "base"), thin)
    structure = scene.structure()
    shapes = sorted_blocks(scene, structure)
    found = stressed_blocks(scene, structure, uniform(scene), shapes)
    assert [one.name for one in found.blocks] == ["base"]
    assert set(found.missed) == {"sheet"}
    with pytest.raises(SolverError, match="tetrahedra"):
        tetrahedra(thin, 1e-4)


def test_pieces_of_a_block_are_one_body():
    """An L: two pieces that touch in a part of a side."""
    pieces = Polyhedron.box((0, 0, 0), (1, 1, 0.5)), Polyhedron.box((0.0, 0.2, 0.5), (0.5, 1, 1))
    scene = scene_of(Block(pieces, "L"), mesh_size=0.3)
    one = stressed(scene, stands(scene))["L"]
    high = one.points[:, 2] > 1.0 - 1e-9
    assert np.abs(one.stress[high, 2]).max() < 0.1 * one.pressure[0]
    assert one.missing < 1e-9


def test_tetrahedra_of_a_file_are_those_of_its_blocks(tmp_path):
    """Two cubes, meshed together by gmsh, one of them in shape of the other."""
    path = tmp_path / "cubes.msh"
    with gmsh_session(MeshSizeMax=0.4) as gmsh:
        gmsh.model.add("cubes")
        cubes = [(3, gmsh.model.occ.addBox(0.0, 0.0, z, 1.0, 1.0, 1.0)) for z in (0.0, 1.0)]
        gmsh.model.occ.fragment(cubes, [])
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(3)
        counts = [gmsh.model.mesh.getElements(3, tag)[1][0].size for _, tag in cubes]
        gmsh.write(str(path))
        gmsh.model.remove()
    scene = Scene.from_tables(
        {
            "dimension": 3,
            "blocks": {"file": "cubes.msh"},
            "materials": {"default": {"density": 2000.0}},
            "joints": {"default": {"friction": 0.7}},
            "loads": {"dead": {"body": [0.0, 0.0, -10.0]}, "live": {"body": [1.0, 0.0, 0.0]}},
        },
        tmp_path,
    )
    found = stressed(scene, stands(scene))
    assert [len(one.cells) for one in found.values()] == counts
    low = min(found.values(), key=lambda one: one.points[:, 2].min())
    middle = np.abs(low.points[:, 2] - 0.5) < 0.2
    expected = -2e4 * (2.0 - low.points[middle, 2])
    np.testing.assert_allclose(low.stress[middle, 2, 2], expected, atol=0.01 * 4e4)
    coarse = stressed(replace(scene, mesh_size=1.0), stands(scene))
    assert [len(one.cells) for one in coarse.values()] != counts
