"""A scene of rigid blocks, in space or in the plane: joint laws and loads a user describes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.errors import InputError, checked, key_of, raised_together, require
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
from fenics_contact.scene.scene import JointLaw, OutputOptions, Seismic, check_inertia_forces
from fenics_contact.scene.toml_tables import as_mapping, from_table, read_toml
from fenics_contact.scene.units import Units
from fenics_contact.spatial import plane
from fenics_contact.spatial.block_tables import ReadBlocks, blocks_of_table
from fenics_contact.spatial.contacts import Contact, Doubt, checked_contacts
from fenics_contact.spatial.ground import ground_below, lowest
from fenics_contact.spatial.loads import (
    DIRECTION,
    GRAVITY,
    NEAR,
    SAME_DIRECTION,
    Floor,
    Load,
    Masses,
    Sides,
    Tie,
    surface_loads,
    total,
)
from fenics_contact.spatial.polyhedra import Block
from fenics_contact.spatial.structure import ContactLaw, Structure

#: Depth of the ground below a foundation, in parts of a typical block's size.
DEPTH = 0.1
#: Widths, m, and mass, kg, of blocks beyond which they are probably of another unit.
SMALLEST, WIDEST, HEAVIEST = 5e-3, 50.0, 1e9
#: Name of the ground where none is given.
GROUND = "ground"


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
        z: Height of the ground, m; by default below the lowest point of the blocks, along x or y
            where the dead load acts along these.
        plane: Surface of the ground, in place of `z`.
    """

    z: float | None = ruled(FINITE, None)
    plane: Plane | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.z is None or self.plane is None, "z: give either z or plane")
        acts = self.between is None and self.acts
        require(acts, "a foundation is neither glued, off nor between")


@dataclass(frozen=True)
class SolveOptions(Checked):
    """How to look for the limit load.

    Attributes:
        direction: Which end of the range of load factors: "positive", "negative" or "both".
        quick: Forces at the corners of contacts alone: torsion is not limited.
        gap: Largest gap of a load factor, relative.
        states: Report the "first" collapse state found, or the "lowest".
        lowest: Look for a lower collapse state than the first, from several starts; None: from one,
            but with `fast`; False: for no other.
        peak: Tell the most that the loading path carries; None: yes, but with `fast`.
        time: After so many seconds what is known is the result; None: any time.
        fast: The load factor alone.
    """

    direction: str = one_of("positive", "negative", "both")
    quick: bool = False
    gap: float = ruled(rule(lambda v: 0.0 < v <= 0.1, "must lie in 0 ... 0.1"), 1e-3)
    states: str = one_of("first", "lowest")
    lowest: bool | None = None
    peak: bool | None = None
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
        dimension: 3, or 2: of blocks that are prisms a metre deep, moving in the plane x-z.
        thickness: Of a structure in the plane, m, for forces that people read; see `Units`.
        read: How many blocks a file names, how many were read.
        notes: What of a file was left out, or taken otherwise than written.
    """

    blocks: tuple[Block, ...]
    live: Load = field(default_factory=Load)
    dead: Load = field(default_factory=Load)
    dimension: int = ruled(rule(lambda d: d in (2, 3), "must be 2 or 3"), 3)
    thickness: float | None = ruled(POSITIVE, None)
    read: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        dead = self.dead
        live = self.live
        bare = live.profile != "uniform" and not any(live.acceleration)
        refused = [
            ("blocks", all(block.fixed for block in self.blocks), "there is none that moves"),
            ("materials is missing", not self.materials, "give [materials.default]"),
            ("loads.live.movement", live.movement, "the ground moves with loads.dead; see there"),
            ("loads.dead.profile", dead.profile != "uniform", "it is of the live load; leave it"),
            ("loads.live.profile", bare, "it acts on loads.live.body, which is zero; give it"),
        ]
        for key, law in self.laws().items():
            places = any(not isinstance(end, str) for end in law.between or ())
            crushes = law.tensile_strength > 0.0 and law.compressive_strength is not None
            refused += [
                (f"{key}.gap", law.gap, "contacts in space are closed; leave it out"),
                (f"{key}.opened", law.opened != "kept", "strengths are kept in space; leave it"),
                (f"{key}.glued", law.glued, "give blocks that move as one as pieces of one block"),
                (f"{key}.between", places, "must be two groups or blocks"),
                (f"{key}.tensile_strength", crushes, "joints that crush carry none; leave it out"),
            ]
        for key, wrong, text in refused:
            require(not wrong, f"{key}: {text}")
        if self.seismic is not None:
            check_inertia_forces(dead, live)

    def laws(self) -> dict[str, JointLaw]:
        """Laws of contacts by their keys in a scene file."""
        laws: dict[str, JointLaw] = {f"joints.{name}": law for name, law in self.joints.items()}
        return laws | {f"foundations.{name}": law for name, law in self.foundations.items()}

    def record(self) -> dict[str, Any]:
        """All but the blocks, with the names and values of a scene file."""
        shared = _Shared(**{name: getattr(self, name) for name in _Shared.__dataclass_fields__})
        loads = asdict(_LoadTables(self.live, self.dead))
        tables = {**asdict(shared, dict_factory=_by_keys), "loads": loads}
        return plane.in_plane(tables) if self.dimension == 2 else tables

    @property
    def units(self) -> Units:
        """Units of what people read on the console: in space, forces of the whole structure."""
        return Units(self.output.units, 1.0 if self.dimension == 3 else self.thickness)

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
    def from_tables(cls, given: Mapping[str, Any], folder: Path, known: Any = None) -> Scene:
        """A scene from the tables of a file, and the folder in which its blocks are found.

        Where these are `known`, as `ReadBlocks`, they are not read again.

        Raises:
            InputError: If a table is wrong.
        """
        in_plane = given.get("dimension", 2) == 2
        tables = from_table(_SceneTables, plane.in_space(given) if in_plane else given)
        shared = {name: getattr(tables, name) for name in _Shared.__dataclass_fields__}
        read = known or read_blocks(given, folder)
        lines = {name: Sides(lines=lines) for name, lines in read.sides.items()}
        shared["sides"] = {**lines, **tables.sides}
        return cls(
            blocks=read.blocks,
            live=tables.loads.live,
            dead=tables.loads.dead,
            dimension=2 if in_plane else 3,
            thickness=tables.plane.thickness,
            read=read.told,
            notes=read.notes,
            **shared,
        )

    def structure(self) -> Structure:
        """The structure, ground with it, with contacts, laws and loads.

        Raises:
            InputError: If laws or loads do not fit the blocks.
        """
        size = float(np.median([b.volume for b in self.blocks if not b.fixed])) ** (1.0 / 3.0)
        near = max(NEAR * size, self.tolerance or 0.0)
        depth = DEPTH * size
        blocks, touching, warnings = _standing(
            self.blocks, tuple(self._grounds()), depth, self.tolerance, self.dimension
        )
        acting = list(self._acting(touching, blocks))
        text = "blocks: no two of them touch, so that nothing holds them"
        require(bool(acting), "; ".join([text, *warnings]))
        contacts, laws = zip(*acting, strict=True)
        moving = [k for k, block in enumerate(blocks) if not block.fixed]
        masses = Masses.of_blocks(blocks, {k: self.material(blocks[k]).density for k in moving})
        floors = {n: f.masses(f"floors.{n}", blocks, near) for n, f in self.floors.items()}
        pushed = masses.with_(*(floors[n][0] for n, floor in self.floors.items() if floor.mass))
        foot = min(lowest(blocks[k], self._up) for k in moving)
        factors = self.live.factors(pushed.position @ self._up - foot, pushed.mass)
        dead = dict(surface_loads("loads.dead", self.dead, blocks, self.sides, near))
        down = np.array([0.0, 0.0, -GRAVITY])
        dead |= {f"floors.{n}": mass.acting(down, on=on) for n, (mass, on) in floors.items()}
        live = dict(surface_loads("loads.live", self.live, blocks, self.sides, near))
        given = {**dead, **live}
        dead["loads.dead.body"] = masses.acting(self.dead.acceleration)
        live["loads.live.body"] = pushed.acting(self.live.acceleration, factors)
        return Structure(
            blocks,
            contacts,
            laws,
            total("loads.dead", blocks, dead),
            total("loads.live", blocks, live),
            self.solve.quick,
            tuple(tie.bar(f"ties.{name}", blocks, near) for name, tie in self.ties.items()),
            self._moved(blocks),
            max(material.young for material in self.materials.values()),
            (*self.notes, *self._odd_sizes(), *warnings),
            tuple(text for text in warnings if isinstance(text, Doubt)),
            acting=given,
            dimension=self.dimension,
        )

    def _odd_sizes(self) -> Iterator[str]:
        """Blocks of a size that is probably that of another unit."""
        odd = []
        for block in (block for block in self.blocks if not block.fixed):
            width = float(np.ptp(block.extent, axis=0).max())
            mass = block.volume * self.material(block).density
            if not SMALLEST <= width <= WIDEST:
                odd.append(f"block '{block.name}' is {width:.3g} m wide")
            elif mass > HEAVIEST:
                odd.append(f"block '{block.name}' weighs {1e-3 * mass:.3g} t")
        if odd:
            more = f" (and {len(odd) - 1} more)" if odd[1:] else ""
            yield f"{odd[0]}{more}: are the numbers in m? A file has blocks.unit"

    def material(self, block: Block) -> Material:
        """Material of a block.

        Raises:
            InputError: If it has none.
        """
        named = dict.fromkeys((block.group, "default"))
        cure = " or ".join(f"[materials.{name}]" for name in named)
        found = [self.materials[name] for name in named if name in self.materials]
        require(bool(found), f"block '{block.name}' has no material; give {cure}")
        return found[0]

    @property
    def _up(self) -> Array:
        """Unit vector against the dead load where that acts along x or y; else z."""
        weight = self.dead.acceleration
        axis = int(np.argmax(np.abs(weight)))
        along = abs(weight[axis]) > SAME_DIRECTION * np.linalg.norm(weight)
        return -np.sign(weight[axis]) * np.eye(3)[axis] if axis < 2 and along else np.eye(3)[2]

    def _grounds(self) -> Iterator[tuple[str, tuple[float, ...], float]]:
        """Names of rigid grounds, unit vectors out of them, and their levels, m."""
        given: Mapping[str, Any] = self.foundations
        if not given and not any(block.fixed for block in self.blocks):
            given = {GROUND: Foundation(friction=0.0)}  # its law is that of joints
        for name, law in given.items():
            up = self._up if law.z is None else np.eye(3)[2]
            level = min(lowest(b, up) for b in self.blocks) if law.z is None else law.z
            if law.plane is not None:
                up = np.array(law.plane.normal) / np.linalg.norm(law.plane.normal)
                level = float(up @ law.plane.point)
            yield name, tuple(up.tolist()), level

    def _moved(self, blocks: Sequence[Block]) -> Array | None:
        """Motions of the ground, m and rad, shape (blocks, 6)."""
        moved = np.zeros((len(blocks), 6))
        fixed = {block.name: k for k, block in enumerate(blocks) if block.fixed}
        for name, movement in self.dead.movement.items():
            text = f"loads.dead.movement.{name}: '{name}' is neither a fixed block nor a foundation"
            require(name in fixed, f"{text}; there are {listed(sorted(fixed))}")
            moved[fixed[name]] = movement.motion
        return moved if self.dead.movement else None

    def _acting(
        self, contacts: Sequence[Contact], blocks: Sequence[Block]
    ) -> Iterator[tuple[Contact, ContactLaw]]:
        """Contacts that are not off, with their laws."""
        pairs = self._pairs()
        every = self.laws()
        for contact in contacts:
            ends = blocks[contact.first], blocks[contact.second]
            ground = [end.group for end in ends if end.group in every]
            named = product(*((end.name, end.group) for end in ends))
            joints = [pairs[frozenset(pair)] for pair in named if frozenset(pair) in pairs]
            key = [*ground, *joints, "joints.default"][0]
            text = f"blocks '{ends[0].name}' and '{ends[1].name}' touch and have no law"
            require(key in every, f"{text}; give [joints.default]")
            law = every[key]
            strengths = [
                law.compressive_strength or self.material(end).compressive_strength or np.inf
                for end in ends
                if not end.fixed
            ]
            shear = law.cohesion + (law.bound or 0.0)
            values = law.friction or 0.0, shear, law.dilation, law.tensile_strength
            if law.acts:
                yield contact, ContactLaw(*values, min(strengths), key)

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


def read_blocks(tables: Mapping[str, Any], folder: Path) -> ReadBlocks:
    """The blocks of the tables of a scene file.

    Raises:
        InputError: If they are wrong.
    """
    require(bool(tables.get("blocks")), "blocks is missing; give file, builder, or [blocks.NAME]")
    read = plane.blocks_of_table if tables.get("dimension", 2) == 2 else blocks_of_table
    return read(as_mapping("blocks", tables["blocks"]), folder)


@lru_cache(maxsize=1)
def _standing(
    blocks: tuple[Block, ...],
    grounds: tuple[tuple[str, tuple[float, ...], float], ...],
    depth: float,
    tolerance: float | None,
    dimension: int,
) -> tuple[tuple[Block, ...], tuple[Contact, ...], tuple[str, ...]]:
    """Blocks with fixed ones below what lies on rigid ground, or nearly does; contacts; warnings.

    They are kept for the next scene: in a sweep the blocks are often the same.
    """
    moving = [block for block in blocks if not block.fixed]
    for name, up, level in grounds:
        key = f"foundations.{name}"
        bodies = ground_below(key, moving, (np.array(up), level), depth, tolerance)
        blocks = (*blocks, Block(bodies, name, key, fixed=True))
    contacts, warnings = checked_contacts(blocks, tolerance)
    if dimension == 2:
        contacts = tuple(plane.upright(contact) for contact in contacts)
    return blocks, contacts, warnings


# ---- what a scene file holds, table by table


@dataclass(frozen=True)
class _LoadTables:
    live: Load = field(
        metadata={"hint": ", or ask `fenics-contact stands` whether the dead load alone stands"}
    )
    dead: Load = field(default_factory=Load)


@dataclass(frozen=True)
class _PlaneTable(Checked):
    thickness: float | None = ruled(POSITIVE, None)


@dataclass(frozen=True, kw_only=True)
class _SceneTables(_Shared):
    loads: _LoadTables
    dimension: int = 2
    blocks: Mapping[str, Any] = field(default_factory=dict)
    plane: _PlaneTable = field(default_factory=_PlaneTable)


def _by_keys(values: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    return {key_of(name): value for name, value in values}
