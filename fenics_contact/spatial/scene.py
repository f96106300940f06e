"""A scene in space: rigid blocks with joint laws and loads; what a user describes."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.errors import InputError, checked, key_of, raised_together, require
from fenics_contact.geometry.mesh import Array
from fenics_contact.results.bounds import counted
from fenics_contact.scene.rules import (
    FINITE,
    NOT_NEGATIVE,
    POSITIVE,
    STRENGTH,
    Checked,
    listed,
    one_of,
    require_vector,
    rule,
    ruled,
)
from fenics_contact.scene.scene import JointLaw, OutputOptions, Seismic, check_inertia_forces
from fenics_contact.scene.toml_tables import from_table, read_toml, refuse_unknown
from fenics_contact.scene.units import Units
from fenics_contact.spatial.contacts import Contact, checked_contacts
from fenics_contact.spatial.loads import (
    DIRECTION,
    GRAVITY,
    NEAR,
    Floor,
    Load,
    Masses,
    Sides,
    Tie,
    Vector,
    surface_loads,
)
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from fenics_contact.spatial.structure import ContactLaw, Structure

#: Depth of the ground below a foundation, in parts of a typical block's size.
DEPTH = 0.1
#: Shapes of blocks, and how many corners they have: 0 for any number.
CORNERS = {"box": 2, "hexahedron": 8, "vertices": 0}
#: Name of the ground where none is given.
GROUND = "ground"
#: Its lower side, in parts of its upper one: pieces of ground touch what is above them alone.
NARROWER = 0.9


@dataclass(frozen=True)
class Material(Checked):
    """Weight, and stiffness of the joints.

    Attributes:
        density: kg/m3.
        young: Young's modulus, Pa, which turns movements and stiffnesses of ties into forces.
        compressive_strength: f_c, Pa, of joints between these blocks; None: they do not crush.
    """

    density: float = ruled(NOT_NEGATIVE, 0.0)
    young: float = ruled(POSITIVE, 5e9)
    compressive_strength: float | None = ruled(STRENGTH, None)


@dataclass(frozen=True)
class Plane(Checked):
    """A plane.

    Attributes:
        point: In it, m.
        normal: Across it, out of the ground.
    """

    point: tuple[float, float, float] = ruled(require_vector)
    normal: tuple[float, float, float] = ruled(DIRECTION, (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Foundation(JointLaw):
    """Joint law on rigid ground, and where that is.

    Attributes:
        z: Height of the ground, m; by default that of the lowest point of the blocks.
        plane: Surface of the ground, in place of `z`.
    """

    z: float | None = ruled(FINITE, None)
    plane: Plane | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.z is None or self.plane is None, "z: give either z or plane")
        require(
            self.between is None and self.acts, "a foundation is neither glued, off nor between"
        )


@dataclass(frozen=True)
class SolveOptions(Checked):
    """How to look for the limit load.

    Attributes:
        direction: Which end of the range of load factors: "positive", "negative" or "both".
        quick: Forces at the corners of contacts alone: torsion is not limited.
        gap: Largest gap of a load factor, relative.
        states: Report the "first" collapse state found, or the "lowest".
        lowest: Look for a lower collapse state than the first.
        time: After so many seconds what is known is the result; None: any time.
        fast: The load factor alone.
    """

    direction: str = one_of("positive", "negative", "both")
    quick: bool = False
    gap: float = ruled(rule(lambda v: 0.0 < v <= 0.1, "must lie in 0 ... 0.1"), 1e-3)
    states: str = one_of("first", "lowest")
    lowest: bool | None = None
    time: float | None = ruled(rule(lambda v: 0.0 < v < math.inf, "must be positive (s)"), None)
    fast: bool = False


@dataclass(frozen=True, kw_only=True)
class _Shared:
    """What a scene and its file have alike; see `Scene`."""

    materials: Mapping[str, Material] = field(default_factory=dict)
    joints: Mapping[str, JointLaw] = field(default_factory=dict)
    foundations: Mapping[str, Foundation] = field(default_factory=dict)
    sides: Mapping[str, Sides] = field(default_factory=dict)
    floors: Mapping[str, Floor] = field(default_factory=dict)
    ties: Mapping[str, Tie] = field(default_factory=dict)
    solve: SolveOptions = field(default_factory=SolveOptions)
    output: OutputOptions = field(default_factory=OutputOptions)
    seismic: Seismic | None = None
    tolerance: float | None = ruled(POSITIVE, None)
    title: str = ""


@dataclass(frozen=True, kw_only=True)
class Scene(Checked, _Shared):
    """Rigid blocks in space with their laws and loads.

    Attributes:
        blocks: At least one that moves.
        live: The load that is multiplied by the load factor.
        dead: The load that is not.
        materials: By group of blocks; "default" for all other groups.
        joints: Laws of contacts: of those between two groups or blocks (`between`), of those
            within the group of the same name, and "default" for all others.
        foundations: Rigid ground. Where there is none, nor a fixed block, it is below the lowest
            point, with the law of "default" joints.
        sides: Sides of blocks by names, for tractions and forces.
        floors: By any name.
        ties: Ties, anchors and cables by any name.
        solve: How to look for the limit load.
        output: What to write.
        seismic: What the seismic check of the mechanism needs.
        tolerance: Sides touch that are as near as this, m, and blocks may overlap by it; None: a
            part of their thickness.
        title: Of pictures and result.
    """

    blocks: tuple[Block, ...]
    live: Load = field(default_factory=Load)
    dead: Load = field(default_factory=Load)

    def __post_init__(self) -> None:
        super().__post_init__()
        require(any(not block.fixed for block in self.blocks), "blocks: there is none that moves")
        require(bool(self.materials), "materials is missing; give [materials.default]")
        for table, law in self.laws().items():
            require(law.gap == 0.0, f"{table}.gap: contacts in space are closed; leave it out")
            kept = f"{table}.opened: strengths are kept in space; leave it out"
            require(law.opened == "kept", kept)
            solid = f"{table}.glued: give blocks that move as one as pieces of one block"
            require(not law.glued, solid)
            places = any(not isinstance(end, str) for end in law.between or ())
            text = f"{table}.between = {list(law.between or ())} must be two groups or blocks"
            require(not places, text)
            crushing = law.tensile_strength > 0.0 and law.compressive_strength is not None
            text = f"{table}: joints that crush carry no tension; leave out one of the strengths"
            require(not crushing, text)
        unmultiplied = "the ground moves with the dead load; give it in loads.dead.movement"
        require(not self.live.movement, f"loads.live.movement: {unmultiplied}")
        text = "loads.dead.profile: a profile is of the live load; leave it out of the dead load"
        require(self.dead.profile == "uniform", text)
        bare = self.live.profile != "uniform" and not any(self.live.acceleration)
        require(not bare, "loads.live.profile acts on loads.live.body, which is zero; give it")
        if self.seismic is not None:
            check_inertia_forces(self.dead, self.live)
        require(
            self.output.capacity == 0, "output.capacity: there is no curve in space; leave it out"
        )

    def laws(self) -> dict[str, JointLaw]:
        """Laws of contacts by their keys in a scene file."""
        laws: dict[str, JointLaw] = {f"joints.{name}": law for name, law in self.joints.items()}
        return laws | {f"foundations.{name}": law for name, law in self.foundations.items()}

    def record(self) -> dict[str, Any]:
        """All but the blocks, with the names and values of a scene file."""
        shared = _Shared(**{name: getattr(self, name) for name in _Shared.__dataclass_fields__})
        loads = asdict(_LoadTables(self.live, self.dead))
        return {**asdict(shared, dict_factory=_named_by_keys), "loads": loads}

    @property
    def units(self) -> Units:
        """Units of what people read on the console: forces are of the whole structure."""
        return Units(self.output.units, 1.0)

    @classmethod
    @checked
    def from_file(
        cls, path: str | Path, comm: MPI.Comm | None = None, overrides: Sequence[str] = ()
    ) -> Scene:
        """Read a scene file and the blocks that it names.

        Args:
            path: The TOML file; a file of blocks is found relative to it.
            comm: By default, the communicator that PETSc was started with.
            overrides: Assignments "joints.default.friction=0.5" made on top of the file.

        Raises:
            InputError: On all ranks, if a file is missing or wrong.
        """
        comm = compat.default_comm() if comm is None else comm
        tables = read_toml(Path(path), comm, overrides)
        scene = None
        with raised_together(comm):
            if comm.rank == 0:
                scene = cls.from_tables(tables, Path(path).parent)
        return comm.bcast(scene)

    @classmethod
    @checked
    def from_tables(cls, given: Mapping[str, Any], folder: Path) -> Scene:
        """A scene from the tables of a file, and the folder in which its blocks are found.

        Raises:
            InputError: If a table is wrong.
        """
        tables = from_table(_SceneTables, given)
        shared = {name: getattr(tables, name) for name in _Shared.__dataclass_fields__}
        blocks = blocks_of_table(tables.blocks, folder)
        return cls(blocks=blocks, live=tables.loads.live, dead=tables.loads.dead, **shared)

    def structure(self) -> Structure:
        """The structure, ground with it, with contacts, laws and loads.

        Raises:
            InputError: If laws or loads do not fit the blocks.
        """
        size = float(np.median([b.volume for b in self.blocks if not b.fixed])) ** (1.0 / 3.0)
        near = max(NEAR * size, self.tolerance or 0.0)
        blocks = (*self.blocks, *self._ground(DEPTH * size, near))
        touching, warnings = checked_contacts(blocks, self.tolerance)
        laws = self._contact_laws(touching, blocks)
        acting = [k for k, law in enumerate(laws) if law is not None]
        require(bool(acting), "blocks: no two of them touch, so that nothing holds them")
        moving = [k for k, block in enumerate(blocks) if not block.fixed]
        masses = Masses.of_blocks(blocks, {k: self.material(blocks[k]).density for k in moving})
        floors = {n: f.masses(f"floors.{n}", blocks, near) for n, f in self.floors.items()}
        pushed = masses.with_(*(floors[n] for n, floor in self.floors.items() if floor.mass))
        foot = min(blocks[k].extent[0][2] for k in moving)
        factors = self.live.factors(pushed.position[:, 2] - foot, pushed.mass)
        dead = surface_loads("loads.dead", self.dead, blocks, self.sides, near)
        dead += masses.loads(blocks, self.dead.acceleration)
        for floor in floors.values():
            dead += floor.loads(blocks, np.array([0.0, 0.0, -GRAVITY]))
        live = surface_loads("loads.live", self.live, blocks, self.sides, near)
        live += pushed.loads(blocks, self.live.acceleration, factors)
        return Structure(
            blocks,
            tuple(touching[k] for k in acting),
            tuple(law for law in laws if law is not None),
            dead,
            live,
            self.solve.quick,
            tuple(tie.bar(f"ties.{name}", blocks, near) for name, tie in self.ties.items()),
            self._moved(blocks),
            max(material.young for material in self.materials.values()),
            warnings,
        )

    def material(self, block: Block) -> Material:
        """Material of a block.

        Raises:
            InputError: If it has none.
        """
        named = [name for name in (block.group, "default") if name in self.materials]
        cure = " or ".join(f"[materials.{name}]" for name in {block.group: 0, "default": 0})
        require(bool(named), f"block '{block.name}' has no material; give {cure}")
        return self.materials[named[0]]

    def _ground(self, depth: float, near: float) -> Iterator[Block]:
        """Fixed blocks below the sides of the others that lie on rigid ground."""
        given: Mapping[str, Any] = self.foundations
        if not given and not any(block.fixed for block in self.blocks):
            given = {GROUND: Foundation(friction=0.0)}  # its law is that of joints
        lowest = min(block.extent[0][2] for block in self.blocks)
        moving = [block for block in self.blocks if not block.fixed]
        for name, law in given.items():
            plane = law.plane or Plane((0.0, 0.0, lowest if law.z is None else law.z))
            down = -np.array(plane.normal) / np.linalg.norm(plane.normal)
            sides = Sides(normal=(down[0], down[1], down[2]), point=plane.point)
            tops = [corners for _, corners in sides.of(moving, near)]
            text = f"foundations.{name}: no block has a side on the ground; see its z or plane"
            require(bool(tops), text)
            lows = [t.mean(axis=0) * (1 - NARROWER) + t * NARROWER + depth * down for t in tops]
            bodies = [Polyhedron.hull(np.vstack(pair)) for pair in zip(tops, lows, strict=True)]
            yield Block(tuple(bodies), name, f"foundations.{name}", fixed=True)

    def _moved(self, blocks: Sequence[Block]) -> Array | None:
        """Motions of the ground, m and rad, shape (blocks, 6)."""
        moved = np.zeros((len(blocks), 6))
        fixed = {block.name: k for k, block in enumerate(blocks) if block.fixed}
        for name, movement in self.dead.movement.items():
            text = f"loads.dead.movement.{name}: '{name}' is neither a fixed block nor a foundation"
            require(name in fixed, f"{text}; there are {listed(sorted(fixed))}")
            moved[fixed[name]] = movement.motion
        return moved if self.dead.movement else None

    def _contact_laws(
        self, contacts: Sequence[Contact], blocks: Sequence[Block]
    ) -> list[ContactLaw | None]:
        """Laws of contacts; None for those that are off."""
        pairs = self._pairs()
        every = self.laws()
        laws: list[ContactLaw | None] = []
        for contact in contacts:
            ends = blocks[contact.first], blocks[contact.second]
            ground = [end.group for end in ends if end.group in every]
            names = [(end.name, end.group) for end in ends]
            both = [frozenset(pair) for pair in product(*names)]
            joints = [pairs[pair] for pair in both if pair in pairs]
            key = [*ground, *joints, "joints.default"][0]
            text = f"blocks '{ends[0].name}' and '{ends[1].name}' touch and have no law"
            require(key in every, f"{text}; give [joints.default]")
            strengths = [
                every[key].compressive_strength or self.material(end).compressive_strength
                for end in ends
                if not end.fixed
            ]
            known = min((one for one in strengths if one is not None), default=np.inf)
            law = every[key]
            shear = law.cohesion + (law.bound or 0.0)
            values = law.friction or 0.0, shear, law.dilation, law.tensile_strength, known
            laws.append(ContactLaw(*values, key) if law.acts else None)
        return laws

    def _pairs(self) -> dict[frozenset[str], str]:
        """Keys of joint laws by the two groups or blocks whose contacts have them."""
        groups = {block.group for block in self.blocks}
        known = groups | {block.name for block in self.blocks}
        pairs: dict[frozenset[str], str] = {}
        for name, law in self.joints.items():
            key = f"joints.{name}"
            ends = frozenset(map(str, law.between or (name,)))
            if name == "default":
                require(law.between is None, f"{key} takes no between; give it another name")
                continue
            for end in ends - known:
                text = f"{key}: there is no group or block '{end}' for its contacts; give between,"
                raise InputError(f"{text} of {listed(sorted(groups))}, or names of blocks")
            require(ends not in pairs, f"{key} and {pairs.get(ends)} are of the same contacts")
            pairs[ends] = key
        return pairs


# ---- what a scene file holds, table by table


def _require_places(name: str, value: Sequence[Vector]) -> None:
    """Refuse coordinates that are not finite."""
    for place in value:
        require_vector(name, place)


@dataclass(frozen=True)
class _Shape(Checked):
    """A convex body, in one of three ways; corners in m."""

    box: tuple[tuple[float, float, float], ...] | None = ruled(_require_places, None)
    hexahedron: tuple[tuple[float, float, float], ...] | None = ruled(_require_places, None)
    vertices: tuple[tuple[float, float, float], ...] | None = ruled(_require_places, None)
    faces: tuple[tuple[int, ...], ...] | None = None

    def polyhedron(self, key: str) -> Polyhedron:
        """The body.

        Raises:
            InputError: If it is given in none of the ways, or in more than one.
        """
        kinds = [kind for kind in CORNERS if getattr(self, kind) is not None]
        require(len(kinds) == 1, f"{key}: give one of {', '.join(CORNERS)}, pieces")
        kind = kinds[0]
        points = np.array(getattr(self, kind), dtype=float)
        wished = CORNERS[kind] or len(points)
        text = f"{key}: {kind} has {counted(len(points), 'corner')}; give {wished}"
        require(len(points) == wished, text)
        require(kind == "vertices" or self.faces is None, f"{key}: faces go with vertices")
        if kind == "box":
            return Polyhedron.box(points.min(axis=0), points.max(axis=0))
        if kind == "hexahedron":
            return Polyhedron.hexahedron(points)
        return Polyhedron.hull(points) if self.faces is None else Polyhedron(points, self.faces)


@dataclass(frozen=True)
class _Block(_Shape):
    """A table [blocks.NAME]."""

    pieces: tuple[_Shape, ...] | None = None
    group: str = "default"
    fixed: bool = False

    def block(self, name: str) -> Block:
        """The block, of its pieces or its own shape.

        Raises:
            InputError: If it is none.
        """
        key = f"blocks.{name}"
        own = [kind for kind in (*CORNERS, "faces") if getattr(self, kind) is not None]
        text = f"{key}: give either pieces or {', '.join(own)}"
        require(self.pieces is None or not own, text)
        pieces = self.pieces or ()
        bodies = [piece.polyhedron(f"{key}.pieces[{k}]") for k, piece in enumerate(pieces)]
        bodies += [self.polyhedron(key)] if self.pieces is None else []
        return Block(tuple(bodies), name, self.group, self.fixed)


@dataclass(frozen=True)
class _LoadTables:
    live: Load = field(
        metadata={"hint": ", or ask `fenics-contact stands` whether the dead load alone stands"}
    )
    dead: Load = field(default_factory=Load)


@dataclass(frozen=True, kw_only=True)
class _SceneTables(_Shared):
    loads: _LoadTables
    dimension: int = 3
    blocks: Mapping[str, Any] = field(default_factory=dict)


def _named_by_keys(values: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    return {key_of(name): value for name, value in values}


@dataclass(frozen=True)
class _Changes(Checked):
    """Patterns of names: of blocks that are fixed, and of those of groups."""

    fixed: tuple[str, ...] = ()
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def blocks_of_table(table: Mapping[str, Any], folder: Path) -> tuple[Block, ...]:
    """Blocks of the table [blocks]: of a file, of a builder, or one by one.

    Raises:
        InputError: If they are wrong.
    """
    require(bool(table), "blocks is missing; give file, builder, or [blocks.NAME]")
    if isinstance(table.get("file"), str) or isinstance(table.get("builder"), str):
        return _made(table, folder)
    shapes = {name: from_table(_Block, item, f"blocks.{name}") for name, item in table.items()}
    return tuple(shape.block(name) for name, shape in shapes.items())


def _made(table: Mapping[str, Any], folder: Path) -> tuple[Block, ...]:
    """Blocks of a file or builder; patterns of names say which are fixed, and their groups."""
    given = dict(table)
    changes = from_table(
        _Changes, {k: given.pop(k) for k in ("fixed", "groups") if k in given}, "blocks"
    )
    if "file" in given:
        refuse_unknown("blocks", given, {"file", "unit", "fixed", "groups"})
        readers = import_module("fenics_contact.spatial.readers")
        blocks = readers.blocks_from_file(folder / given["file"], given.get("unit"))
    else:
        blocks = _built(str(given.pop("builder")), given)
    names = [name for block in blocks for name in (block.name, block.group)]
    wished: list[tuple[str, dict[str, Any]]] = [
        (pattern, {"fixed": True}) for pattern in changes.fixed
    ]
    for group, patterns in changes.groups.items():
        wished += [(pattern, {"group": group}) for pattern in patterns]
    for pattern, change in wished:
        chosen = set(fnmatch.filter(names, pattern))
        first = listed(list(dict.fromkeys(names))[:6])
        text = f"blocks: no block or group is called '{pattern}'; the first ones are {first}"
        require(bool(chosen), text)
        blocks = tuple(replace(b, **change) if {b.name, b.group} & chosen else b for b in blocks)
    return blocks


def _built(name: str, given: Mapping[str, Any]) -> tuple[Block, ...]:
    """Blocks by a function of `builders`."""
    builders = import_module("fenics_contact.spatial.builders")
    known = {
        key: value
        for key, value in vars(builders).items()
        if getattr(value, "__module__", "") == builders.__name__ and key.islower() and key[0] != "_"
    }
    text = f"blocks.builder = '{name}' must be one of {listed(sorted(known))}"
    require(name in known, text)
    function = known[name]
    keys = set(function.__annotations__) - {"return"}
    refuse_unknown("blocks", given, keys)
    optional = getattr(function, "__wrapped__", function).__kwdefaults__ or {}
    missing = sorted(keys - set(optional) - set(given))
    text = f"blocks.{min(missing, default='')} is missing; the builder '{name}' needs it"
    require(not missing, text)
    try:
        return tuple(function(**given))
    except InputError as error:
        raise InputError(f"blocks.{error}") from None
