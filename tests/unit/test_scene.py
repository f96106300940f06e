"""What a scene refuses, and how tables of a file become checked objects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from mpi4py import MPI

from fenics_contact import (
    BlockMesh,
    InputError,
    JointLaw,
    Load,
    Material,
    OutputOptions,
    Scene,
    SolveOptions,
    limit_load,
)
from fenics_contact.meshing import polygons, wall
from fenics_contact.scene.toml_tables import from_table, read_toml
from tests.bank import wall_recipe
from tests.helpers import PUSH, STONE, coulomb, mesh_of, rectangle

NAN, INF = math.nan, math.inf


@pytest.fixture(scope="module")
def mesh() -> BlockMesh:
    return mesh_of(wall([[1], [1]], elements=1))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        *((lambda x=x: Material(x, 0.2), "young = ") for x in (0.0, -1.0, NAN, INF)),
        *((lambda x=x: Material(1e9, x), "poisson = ") for x in (0.5, -1.0, NAN)),
        *((lambda x=x: Material(1e9, 0.2, x), "density = ") for x in (-1.0, NAN)),
        *((lambda x=x: Material(1e9, 0.2, 0.0, x), "compressive_strength = .* must be a positive")
          for x in (0.0, -1.0, NAN)),
        (lambda: Material(1e9, 0.2, 0.0, INF), "compressive_strength = inf must be finite"),
        (lambda: JointLaw("frictionless", compressive_strength=-1.0), "strength = -1.0 must be"),
        (lambda: JointLaw("sticky"), "law = 'sticky' must be one of coulomb, tresca, frictionless"),
        (lambda: JointLaw("coulomb"), "law 'coulomb' needs friction"),
        (lambda: JointLaw("tresca"), "law 'tresca' needs bound"),
        (lambda: JointLaw("coulomb", -0.1), "friction = -0.1 must be finite and >= 0"),
        (lambda: JointLaw("coulomb", NAN), "friction = nan"),
        (lambda: JointLaw("coulomb", 0.5, 1.0), "law 'coulomb' takes no bound"),
        (lambda: JointLaw("tresca", 0.5, 1.0), "law 'tresca' takes no friction"),
        (lambda: JointLaw("tresca", None, -1.0), "bound = -1.0 must be finite and >= 0"),
        (lambda: JointLaw("frictionless", 0.5), "law 'frictionless' takes no friction"),
        *((lambda x=x: Load(x), "body = .* must be two finite numbers")
          for x in ((-INF, 2.0), (1.0, NAN))),
        *((lambda x=x: Load(traction={"top": x}), r"traction\.top = .* must be two finite numbers")
          for x in ((INF, 0.0), (NAN, 1.0))),
        (lambda: Load(traction={"top": 1.0}), r"traction\.top = 1.0 must be two numbers, \[x, y\]"),
        (lambda: Load(traction=[0.0, 1.0]), r"traction = .* must be a table, \[traction\]"),
        (lambda: Material("5e9", 0.2), "young = '5e9' must be a number"),
        (lambda: Material(5e9, None), "poisson = None must be a number"),
        (lambda: JointLaw(friction="0.5"), "friction = '0.5' must be a number"),
        (lambda: JointLaw(0.5), "law = 0.5 must be a string"),
        (lambda: OutputOptions(capacity=2.5), "capacity = 2.5 must be a whole number"),
        (lambda: SolveOptions(error=1), "error = 1 must be true or false"),
        (lambda: SolveOptions(method="newton"), "method = 'newton' must be one of auto, fixed-poi"),
        (lambda: SolveOptions(direction="up"), "'up' must be one of positive, negative, both"),
        *((lambda x=x: SolveOptions(tolerance=x), f"tolerance = {x} must lie between")
          for x in (0.0, 0.5, NAN)),
        (lambda: SolveOptions(slip="load-steps"), "slip = 'load-steps' needs control = 'load'"),
        (lambda: SolveOptions(control="load", states="lowest"), "'lowest' needs control = 'work'"),
        (lambda: SolveOptions(control="load", engine="faces"), "'faces' needs control = 'work'"),
        *((lambda x=x: OutputOptions(capacity=x), f"capacity = {x} must lie in")
          for x in (-1, 1001)),
    ],
)  # fmt: skip
def test_value_is_refused(build, message):
    with pytest.raises(InputError, match=message):
        build()


def test_whole_numbers_are_taken_as_floats():
    """An array of joints with friction 1 was one of whole numbers, of which no solver knew."""
    law = JointLaw("coulomb", 1, gap=0)
    load = Load((0, -10), traction={"top": [1, 2]}, profile=[(0, 1), (2, 3)])
    found = (law.friction, law.gap, *load.body, *load.traction["top"], load.profile[1][1])
    assert [type(number) for number in found] == 7 * [float]
    assert load == Load(
        (0.0, -10.0), traction={"top": (1.0, 2.0)}, profile=((0.0, 1.0), (2.0, 3.0))
    )
    by_law = [
        limit_load(wall_recipe("W1", JointLaw(friction=one)).scene(1, fast=True)).load_factor
        for one in (1, 1.0)
    ]
    assert by_law[0] == by_law[1]


ROUGH = coulomb(0.5)
ON_ROOF = Load(traction={"roof": (0.0, -1.0)})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"plane": "shell"}, "plane.state = 'shell'"),
        ({"degree": 3}, "mesh.degree = 3"),
        ({"supports": {"base": "glued"}}, "supports.base = 'glued' must be one of fixed, roller"),
        ({"materials": {"brick": STONE}}, "materials.brick: .* no two-dimensional group 'brick'"),
        ({"joints": {"mortar": ROUGH}}, "joints.mortar: .* no one-dimensional group"),
        ({"foundations": {"rock": ROUGH}}, "foundations.rock: .* it has 'bed', 'base'"),
        ({"supports": {"rock": "fixed"}}, "supports.rock"),
        ({"dead": ON_ROOF}, "loads.dead.traction.roof"),
        ({"live": Load((1.0, 2.0, 3.0))}, r"loads.live.body = \[1.0, 2.0, 3.0\] must be two numb"),
        ({"solve": SolveOptions(quick=True)}, "solve.quick is of scenes of rigid blocks"),
        ({"live": ON_ROOF}, "loads.live.traction.roof"),
        ({"joints": {"base": ROUGH}, "foundations": {"base": ROUGH}}, "group 'base' has two roles"),
        ({"foundations": {"base": ROUGH}, "supports": {"base": "fixed"}}, "'base' has two roles"),
        ({"joints": {"bed": ROUGH}, "supports": {"bed": "fixed"}}, "group 'bed' has two roles"),
        ({"materials": {}}, r"cells of 'blocks' have no material; add \[materials.blocks\]"),
    ],
)
def test_scene_is_refused(mesh, changes, message):
    with pytest.raises(InputError, match=message):
        Scene(**({"mesh": mesh, "materials": {"default": STONE}, "live": PUSH} | changes))


def test_material_goes_by_group_and_then_by_default():
    drawing = polygons([rectangle(0, 0, 1, 1), rectangle(2, 0, 3, 1)], 1.0, names=["sill", "post"])
    other = Material(1e10, 0.1)
    made = Scene(mesh_of(drawing), {"default": STONE, "post": other}, PUSH)
    assert made.material({"post"}) is other
    assert made.material({"sill"}) is STONE


def test_cells_with_two_materials():
    model = wall([[1]], elements=1)
    (dim, entity), *_ = model.getEntities(2)
    model.setPhysicalName(dim, model.addPhysicalGroup(dim, [entity]), "again")
    mesh = mesh_of(model)
    with pytest.raises(InputError, match="'again', 'blocks' share cells"):
        Scene(mesh, {"blocks": STONE, "again": Material(1e10, 0.1)}, PUSH)
    assert Scene(mesh, {"blocks": STONE, "again": STONE}, PUSH).material(["again"]) is STONE


# ---- tables of any dataclasses


@dataclass(frozen=True)
class Wheel:
    spokes: int
    place: tuple[float, float] = (0.0, 0.0)
    load: float | None = None

    def __post_init__(self) -> None:
        if self.spokes < 3:
            raise InputError(f"spokes = {self.spokes} must be 3 or more")


@dataclass(frozen=True)
class Bell:
    tone: str = "a"


@dataclass(frozen=True)
class Cart:
    wheels: Mapping[str, Wheel]
    bell: Bell = field(default_factory=Bell)
    painted: bool = False


def test_table_becomes_dataclasses_with_their_defaults():
    wheels = {"left": {"spokes": 8, "place": [1, 2.5]}, "right": {"spokes": 9, "load": 3}}
    expected = {"left": Wheel(8, (1.0, 2.5)), "right": Wheel(9, load=3.0)}
    assert from_table(Cart, {"wheels": wheels, "painted": True}) == Cart(expected, painted=True)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "^wheels is missing$"),
        ({"wheels": {}, "bel": {}}, "^unknown key 'bel'; did you mean 'bell'"),
        ({"wheels": {"a": {"colour": 1}}}, r"^unknown key 'wheels\.a\.colour'; known: load, place"),
        ({"wheels": {"a": {}}}, r"^wheels\.a\.spokes is missing$"),
        ({"wheels": {"a": {"spokes": 2}}}, r"^wheels\.a\.spokes = 2 must be 3 or more$"),
        ({"wheels": {"a": {"spokes": True}}}, r"spokes = True must be a whole number"),
        ({"wheels": {"a": {"spokes": 3, "load": "1"}}}, r"load = '1' must be a number"),
        ({"wheels": {"a": {"spokes": 3, "place": [1]}}}, r"place = \[1\] must be two numbers"),
        ({"wheels": 1}, r"^wheels = 1 must be a table, \[wheels\], in Python a dict$"),
        ({"wheels": {}, "bell": {"tone": 1}}, r"^bell\.tone = 1 must be a string$"),
        ({"wheels": {}, "painted": 1}, "^painted = 1 must be true or false$"),
    ],
)
def test_table_is_refused(table, message):
    with pytest.raises(InputError, match=message):
        from_table(Cart, table)


def test_assignments_change_the_file(tmp_path):
    comm = MPI.COMM_WORLD
    path = comm.bcast(Path(tmp_path)) / "cart.toml"
    if comm.rank == 0:
        path.write_text("painted = false\n[wheels.a]\nspokes = 3\n")
    comm.barrier()
    changes = ["painted=true", "wheels.a.spokes = 4", "bell.tone=c sharp"]
    expected = {"painted": True, "wheels": {"a": {"spokes": 4}}, "bell": {"tone": "c sharp"}}
    assert read_toml(path, comm, changes) == expected
