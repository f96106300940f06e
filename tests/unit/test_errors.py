"""Exceptions: one kind per cause, the same on all ranks; and what a scene refuses."""

from __future__ import annotations

import math

import pytest
from mpi4py import MPI

from fenics_contact import (
    BlockMesh,
    ContactError,
    InputError,
    JointLaw,
    Load,
    Material,
    OutputOptions,
    Scene,
    SolveOptions,
    SolverError,
)
from fenics_contact.errors import raised_together
from fenics_contact.meshing import polygons, wall
from tests.helpers import PUSH, STONE, coulomb, mesh_of, rectangle

COMM = MPI.COMM_WORLD
LAST = COMM.size - 1


def test_all_errors_are_contact_errors():
    assert issubclass(InputError, ContactError)
    assert issubclass(SolverError, ContactError)
    assert not issubclass(InputError, SolverError)
    assert not issubclass(SolverError, InputError)


def test_error_of_one_rank_is_raised_on_all():
    with pytest.raises(InputError, match=f"^rank {LAST} has no mesh$"), raised_together(COMM):
        if COMM.rank == LAST:
            raise InputError(f"rank {LAST} has no mesh")


def test_error_of_the_lowest_rank_wins():
    with pytest.raises(InputError, match=r"^rank 0 has no mesh$"), raised_together(COMM):
        raise InputError(f"rank {COMM.rank} has no mesh")


def test_no_error_passes():
    done = False
    with raised_together(COMM):
        done = True
    assert done


def test_other_errors_pass_unchanged():
    with pytest.raises(SolverError, match="no answer"), raised_together(MPI.COMM_SELF):
        raise SolverError("no answer")


# ---- scenes


@pytest.fixture(scope="module")
def mesh() -> BlockMesh:
    return mesh_of(wall([[1], [1]], elements=1))


def scene(mesh: BlockMesh, **changes) -> Scene:
    return Scene(**({"mesh": mesh, "materials": {"default": STONE}, "live": PUSH} | changes))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ((0.0, 0.2), "young"),
        ((-1.0, 0.2), "young"),
        ((math.nan, 0.2), "young"),
        ((math.inf, 0.2), "young"),
        ((1e9, 0.5), "poisson"),
        ((1e9, -1.0), "poisson"),
        ((1e9, math.nan), "poisson"),
        ((1e9, 0.2, -1.0), "density"),
        ((1e9, 0.2, math.nan), "density"),
    ],
)
def test_material(values, message):
    with pytest.raises(InputError, match=message):
        Material(*values)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (("sticky",), "law = 'sticky' must be one of coulomb, tresca, frictionless"),
        (("coulomb",), "law 'coulomb' needs friction"),
        (("tresca",), "law 'tresca' needs bound"),
        (("coulomb", -0.1), "friction = -0.1 must be finite and >= 0"),
        (("coulomb", math.nan), "friction = nan"),
        (("coulomb", 0.5, 1.0), "law 'coulomb' takes no bound"),
        (("tresca", 0.5, 1.0), "law 'tresca' takes no friction"),
        (("tresca", None, -1.0), "bound = -1.0 must be finite and >= 0"),
        (("frictionless", 0.5), "law 'frictionless' takes no friction"),
    ],
)
def test_joint_law(values, message):
    with pytest.raises(InputError, match=message):
        JointLaw(*values)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (((1.0, 2.0, 3.0),), "body"),
        (((1.0, math.nan),), "body"),
        (((0.0, 0.0), {"top": (math.inf, 0.0)}), r"traction\.top"),
        (((0.0, 0.0), {"top": (1.0,)}), r"traction\.top"),
    ],
)
def test_load(values, message):
    with pytest.raises(InputError, match=rf"{message} = .* must be two finite numbers"):
        Load(*values)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "newton"}, "method = 'newton' must be one of auto, fixed-point"),
        ({"direction": "up"}, "direction = 'up' must be one of positive, negative, both"),
        ({"tolerance": 0.0}, "tolerance = 0.0 must lie between"),
        ({"tolerance": 0.5}, "tolerance = 0.5 must lie between"),
        ({"tolerance": math.nan}, "tolerance = nan must lie between"),
    ],
)
def test_solve_options(options, message):
    with pytest.raises(InputError, match=message):
        SolveOptions(**options)


@pytest.mark.parametrize("capacity", [-1, 1001])
def test_output_options(capacity):
    with pytest.raises(InputError, match=f"capacity = {capacity} must lie in"):
        OutputOptions(capacity=capacity)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"plane": "shell"}, "plane.state = 'shell'"),
        ({"degree": 3}, "mesh.degree = 3"),
        ({"supports": {"base": "glued"}}, "supports.base = 'glued' must be one of fixed, roller"),
        ({"materials": {"brick": STONE}}, "materials.brick: .* no two-dimensional group 'brick'"),
        ({"joints": {"mortar": coulomb(0.5)}}, "joints.mortar: .* no one-dimensional group"),
        ({"foundations": {"rock": coulomb(0.5)}}, "foundations.rock: .* it has 'bed', 'base'"),
        ({"supports": {"rock": "fixed"}}, "supports.rock"),
        ({"dead": Load(traction={"roof": (0.0, -1.0)})}, "loads.dead.traction.roof"),
        ({"live": Load(traction={"roof": (0.0, -1.0)})}, "loads.live.traction.roof"),
        (
            {"joints": {"base": coulomb(0.5)}, "foundations": {"base": coulomb(0.5)}},
            "group 'base' has two roles",
        ),
        (
            {"foundations": {"base": coulomb(0.5)}, "supports": {"base": "fixed"}},
            "group 'base' has two roles",
        ),
        (
            {"joints": {"bed": coulomb(0.5)}, "supports": {"bed": "fixed"}},
            "group 'bed' has two roles",
        ),
        ({"materials": {}}, r"cells of 'blocks' have no material; add \[materials.blocks\]"),
    ],
)
def test_scene(mesh, changes, message):
    with pytest.raises(InputError, match=message):
        scene(mesh, **changes)


def test_material_goes_by_group_and_then_by_default():
    drawing = polygons([rectangle(0, 0, 1, 1), rectangle(2, 0, 3, 1)], 1.0, names=["sill", "post"])
    other = Material(1e10, 0.1)
    made = scene(mesh_of(drawing), materials={"default": STONE, "post": other})
    assert made.material({"post"}) is other
    assert made.material({"sill"}) is STONE


def test_cells_with_two_materials():
    model = wall([[1]], elements=1)
    (dim, entity), *_ = model.getEntities(2)
    model.setPhysicalName(dim, model.addPhysicalGroup(dim, [entity]), "again")
    other = Material(1e10, 0.1)
    mesh = mesh_of(model)
    with pytest.raises(InputError, match="'again', 'blocks' share cells"):
        scene(mesh, materials={"blocks": STONE, "again": other})
    assert scene(mesh, materials={"blocks": STONE, "again": STONE}).material(["again"]) is STONE
