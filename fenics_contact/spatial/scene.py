"""A scene in space: rigid blocks with joint laws and loads; what a user describes."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.errors import InputError, checked, raised_together, require
from fenics_contact.geometry.mesh import Array
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
from fenics_contact.scene.scene import JointLaw, OutputOptions, Seismic
from fenics_contact.scene.toml_tables import from_table, read_toml, refuse_unknown
from fenics_contact.scene.units import Units
from fenics_contact.spatial.contacts import Contact, contacts_of
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
    summed,
    surface_loads,
)
from fenics_contact.spatial.polyhedra import Block, Polyhedron
from fenics_contact.spatial.structure import ContactLaw, Structure

#: Depth of the ground below a foundation, in parts of a typical block's size.
DEPTH = 0.1
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
        require(self.output.capacity == 0, "output.capacity: there is no curve in space; leave it")

    def laws(self) -> dict[str, JointLaw]:
        """Laws of contacts by their keys in a scene file."""
        laws: dict[str, JointLaw] = {f"joints.{name}": law for name, law in self.joints.items()}
        return laws | {f"foundations.{name}": law for name, law in self.foundations.items()}

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
        near = NEAR * size
        blocks = (*self.blocks, *self._ground(size))
        contacts, laws = self._contacts(blocks)
        moving = [k for k, block in enumerate(blocks) if not block.fixed]
        masses = Masses.of_blocks(blocks, {k: self.material(blocks[k]).density for k in moving})
        lying = {n: f.masses(f"floors.{n}", blocks, near) for n, f in self.floors.items()}
        dead = surface_loads("loads.dead", self.dead, blocks, self.sides, near)
        live = surface_loads("loads.live", self.live, blocks, self.sides, near)
        for floor in lying.values():
            weight = floor.forces(np.array([0.0, 0.0, -GRAVITY]))
            dead += summed(blocks, floor.block, floor.position, weight)
        weight = masses.forces(self.dead.acceleration)
        dead += summed(blocks, masses.block, masses.position, weight)
        every = masses.with_(*(lying[n] for n, floor in self.floors.items() if floor.mass))
        foot = min(blocks[k].extent[0][2] for k in moving)
        factors = self.live.factors(every.position[:, 2] - foot, every.mass)
        push = every.forces(self.live.acceleration, factors)
        live += summed(blocks, every.block, every.position, push)
        bars = tuple(tie.bar(f"ties.{name}", blocks, near) for name, tie in self.ties.items())
        young = max(material.young for material in self.materials.values())
        return Structure(
            blocks,
            contacts,
            laws,
            dead,
            live,
            self.solve.quick,
            bars,
            self._moved(blocks),
            young,
            every,
        )

    def _moved(self, blocks: Sequence[Block]) -> Array | None:
        """Motions of the ground, m and rad, shape (blocks, 6)."""
        moved = np.zeros((len(blocks), 6))
        fixed = {block.name: k for k, block in enumerate(blocks) if block.fixed}
        for name, movement in self.dead.movement.items():
            text = f"loads.dead.movement.{name}: '{name}' is neither a fixed block nor a foundation"
            require(name in fixed, f"{text}; there are {listed(sorted(fixed))}")
            moved[fixed[name]] = movement.motion
        return moved if self.dead.movement else None

    def material(self, block: Block) -> Material:
        """Material of a block."""
        material = self.materials.get(block.group) or self.materials.get("default")
        if material is None:
            cure = f"give [materials.{block.group}] or [materials.default]"
            raise InputError(
                f"block '{block.name}' of group '{block.group}' has no material; {cure}"
            )
        return material

    def _ground(self, size: float) -> Iterator[Block]:
        """Fixed blocks below the sides of the others that lie on rigid ground."""
        given: Mapping[str, Any] = self.foundations
        if not given and not any(block.fixed for block in self.blocks):
            given = {GROUND: Foundation(friction=0.0)}  # its law is that of joints
        lowest = min(block.extent[0][2] for block in self.blocks)
        moving = [block for block in self.blocks if not block.fixed]
        for name, law in given.items():
            plane = law.plane or Plane((0.0, 0.0, lowest if law.z is None else law.z))
            down = -np.array(plane.normal) / np.linalg.norm(plane.normal)
            below = Sides(normal=(down[0], down[1], down[2]), point=plane.point).of(
                moving, NEAR * size
            )
            pieces = tuple(_below(corners, DEPTH * size * down) for _, corners in below)
            text = f"foundations.{name}: no block has a side on the ground; see its z or plane"
            require(bool(pieces), text)
            yield Block(pieces, name, f"foundations.{name}", fixed=True)

    def _contacts(
        self, blocks: Sequence[Block]
    ) -> tuple[tuple[Contact, ...], tuple[ContactLaw, ...]]:
        """Contacts of blocks, without those that are off, and their laws."""
        pairs = self._pairs()
        kept = []
        laws = []
        for contact in contacts_of(blocks):
            first = blocks[contact.first]
            second = blocks[contact.second]
            key, law = self._law(pairs, first, second)
            if law.acts:
                strengths = [law.compressive_strength]
                if law.compressive_strength is None:
                    here = [block for block in (first, second) if not block.fixed]
                    strengths = [self.material(block).compressive_strength for block in here]
                known = [strength for strength in strengths if strength is not None]
                kept.append(contact)
                laws.append(
                    ContactLaw(
                        law.friction or 0.0,
                        law.cohesion + (law.bound or 0.0),
                        law.dilation,
                        law.tensile_strength,
                        min(known, default=np.inf),
                        key,
                    )
                )
        return tuple(kept), tuple(laws)

    def _pairs(self) -> dict[frozenset[str], str]:
        """Names of joint laws by the two groups or blocks whose contacts have them."""
        groups = {block.group for block in self.blocks}
        known = groups | {block.name for block in self.blocks}
        pairs: dict[frozenset[str], str] = {}
        for name, law in self.joints.items():
            if name == "default":
                require(law.between is None, "joints.default takes no between; give another name")
                continue
            text = f"joints.{name}: there is no group '{name}'; give between, or one of"
            require(law.between is not None or name in groups, f"{text} {listed(sorted(groups))}")
            between = law.between or (name, name)
            for end in between:
                text = f"joints.{name}.between: there is no group or block '{end}'; groups are"
                require(end in known, f"{text} {listed(sorted(groups))}")
            pair = frozenset(map(str, between))
            text = f"joints.{name} and joints.{pairs.get(pair)} are of the same contacts; give one"
            require(pair not in pairs, text)
            pairs[pair] = name
        return pairs

    def _law(
        self, pairs: Mapping[frozenset[str], str], first: Block, second: Block
    ) -> tuple[str, JointLaw]:
        """Key and law of the contact of two blocks."""
        for block in (first, second):
            table, _, name = block.group.partition(".")
            if table == "foundations" and name in self.foundations:
                return block.group, self.foundations[name]
        for a, b in (
            (first.name, second.name),
            (first.name, second.group),
            (first.group, second.name),
            (first.group, second.group),
        ):
            name = pairs.get(frozenset((a, b)), "")
            if name:
                return f"joints.{name}", self.joints[name]
        text = f"blocks '{first.name}' and '{second.name}' touch and have no law"
        require("default" in self.joints, f"{text}; give [joints.default]")
        return "joints.default", self.joints["default"]


def _below(corners: Array, down: Array) -> Polyhedron:
    """Ground below a polygon, whose corners are counterclockwise seen from below."""
    count = len(corners)
    middle = corners.mean(axis=0)
    low = middle + NARROWER * (corners - middle) + down
    following = [(k + 1) % count for k in range(count)]
    sides = [tuple(range(count))[::-1], tuple(range(count, 2 * count))]
    sides += [(k, n, count + n, count + k) for k, n in enumerate(following)]
    return Polyhedron(np.vstack([corners, low]), tuple(sides))


# ---- what a scene file holds, table by table


@dataclass(frozen=True)
class _Shape(Checked):
    """A convex body, in one of three ways; corners in m."""

    box: tuple[Vector, ...] | None = None
    hexahedron: tuple[Vector, ...] | None = None
    vertices: tuple[Vector, ...] | None = None
    faces: tuple[tuple[int, ...], ...] | None = None

    def polyhedron(self) -> Polyhedron:
        """The body.

        Raises:
            InputError: If it is none.
        """
        if self.box is not None:
            require(len(self.box) == 2, f"box has {len(self.box)} corners; give the two farthest")
            low, high = np.array(self.box)
            require(
                bool(np.all(low < high)),
                "box: the second corner must be above the first in x, y, z",
            )
            return Polyhedron.box(low, high)
        if self.hexahedron is not None:
            count = len(self.hexahedron)
            require(count == 8, f"hexahedron has {count} corners; give 8")
            return Polyhedron.hexahedron(np.array(self.hexahedron))
        corners = np.array(self.vertices)
        require(self.faces is not None, "give box, hexahedron, or vertices with faces, or pieces")
        outside = sorted({k for loop in self.faces or () for k in loop} - set(range(len(corners))))
        require(
            not outside, f"faces: there is no corner {outside[:1]} of {len(corners)}; count from 0"
        )
        return Polyhedron(corners, self.faces or ())


@dataclass(frozen=True)
class _Block(_Shape):
    """A table [blocks.NAME]."""

    pieces: tuple[_Shape, ...] | None = None
    group: str = "default"
    fixed: bool = False

    def block(self, name: str) -> Block:
        """The block.

        Raises:
            InputError: If its shape is none.
        """
        shapes = self.pieces if self.pieces is not None else (self,)
        return Block(tuple(shape.polyhedron() for shape in shapes), name, self.group, self.fixed)


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
    blocks = []
    for name, item in table.items():
        key = f"blocks.{name}"
        one = from_table(_Block, item, key)
        try:
            blocks.append(one.block(name))
        except InputError as error:
            raise InputError(f"{key}: {error}") from None
    return tuple(blocks)


def _made(table: Mapping[str, Any], folder: Path) -> tuple[Block, ...]:
    """Blocks of a file or builder; patterns of names say which are fixed, and their groups."""
    given = dict(table)
    changes = from_table(
        _Changes, {k: given.pop(k) for k in ("fixed", "groups") if k in given}, "blocks"
    )
    if "file" in given:
        readers = import_module("fenics_contact.spatial.readers")
        refuse_unknown("blocks", given, {"file", "unit", "fixed", "groups"})
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
