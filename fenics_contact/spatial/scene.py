"""A scene of rigid blocks, in space or in the plane: joint laws and loads a user describes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.discretization.warnings import unusual_values
from fenics_contact.errors import InputError, Vector, checked, raised_together, require
from fenics_contact.geometry.mesh import Array
from fenics_contact.parallel import MPI
from fenics_contact.results.bounds import counted
from fenics_contact.results.values import NAMED
from fenics_contact.scene.rules import (
    DIRECTION,
    FINITE,
    POSITIVE,
    Checked,
    listed,
    only,
    require_fit,
    require_vector,
    rule,
    ruled,
)
from fenics_contact.scene.scene import (
    GRAVITY,
    JointLaw,
    Load,
    Material,
    OfFile,
    StressLaw,
    Tables,
)
from fenics_contact.scene.toml_tables import as_mapping, from_table
from fenics_contact.scene.units import Units
from fenics_contact.spatial.block_tables import blocks_of_table
from fenics_contact.spatial.contacts import Contact, Doubt, checked_contacts
from fenics_contact.spatial.ground import ground_below, lowest
from fenics_contact.spatial.loads import (
    NEAR,
    SAME_DIRECTION,
    UP,
    Masses,
    Sides,
    factors_of,
    lifted,
    masses_of_floor,
    motion_of,
    surface_loads,
    total,
)
from fenics_contact.spatial.polyhedra import Block, ReadBlocks
from fenics_contact.spatial.structure import ContactLaw, Structure
from fenics_contact.spatial.ties import bars_of

#: Depth of the ground below a foundation, in parts of a typical block's size.
DEPTH = 0.1
#: Widths, m, and mass, kg, of blocks beyond which they are probably of another unit.
SMALLEST, WIDEST, HEAVIEST = 5e-3, 50.0, 1e9
#: Sine of the slope from which on a contact holds a block up.
UPHOLDS = 0.1
#: Name of the ground where none is given.
GROUND = "ground"


@dataclass(frozen=True)
class Plane(Checked):
    """A plane.

    Attributes:
        point: In it, m.
        normal: Across it, out of the ground; by default upwards.
    """

    point: Vector = ruled(require_vector)
    normal: Vector | None = ruled(DIRECTION, None)


@dataclass(frozen=True)
class Foundation(JointLaw):
    """Joint law on rigid ground, and where that is.

    Attributes:
        z: Height of the ground in space, m; by default below the lowest point of the blocks, along
            x or y where the dead load acts along these.
        y: Likewise in the plane.
        plane: Surface of the ground, in place of its height.
    """

    z: float | None = ruled(FINITE, None, of="space")
    y: float | None = ruled(FINITE, None, of="plane")
    plane: Plane | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        name = "z" if self.y is None else "y"
        require(self.height is None or self.plane is None, f"{name}: give either {name} or plane")
        acts = self.between is None and self.acts
        require(acts, "a foundation is neither glued, off nor between")

    @property
    def height(self) -> float | None:
        """Height of the ground, m."""
        return self.y if self.z is None else self.z


@dataclass(frozen=True, kw_only=True)
class BlockScene(OfFile):
    """Rigid blocks, in space or in the plane, with their laws and loads.

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
        mesh_size: In space length of edges of tetrahedra, for stresses, m, `blocks.size` in files;
            None: half of a block's thickness.
        elastic: In space: blocks strain in the search for the collapse, `blocks.elastic` in files.
        stress: In space, and in Python only: see `scene.scene.Scene`.
        title: Of pictures and result.
        dimension: 3, or 2: of blocks that are prisms a metre deep, moving in the plane x-z.
        thickness: Of a structure in the plane, m, for forces that people read; see `Units`.
        read: How many blocks a file names, how many were read.
        notes: What of a file was left out, or taken otherwise than written.
    """

    blocks: tuple[Block, ...]
    live: Load = field(default_factory=Load)
    dead: Load = field(default_factory=Load)
    materials: Mapping[str, Material] = field(default_factory=dict)
    foundations: Mapping[str, Foundation] = field(default_factory=dict)  # type: ignore[assignment]
    sides: Mapping[str, Sides] = field(default_factory=dict)
    tolerance: float | None = ruled(POSITIVE, None)
    mesh_size: float | None = ruled(POSITIVE, None, of="space")
    elastic: bool = only("space", False)
    stress: StressLaw | None = only("space")
    dimension: int = ruled(rule(lambda d: d in (2, 3), "must be 2 or 3"), 3)
    thickness: float | None = None
    read: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.check_parts()
        require(not all(block.fixed for block in self.blocks), "blocks: there is none that moves")
        require(bool(self.materials), "materials is missing; give [materials.default]")
        for key, law in self.laws().items():
            places = any(not isinstance(end, str) for end in law.between or ())
            crushes = law.tensile_strength > 0.0 and law.compressive_strength is not None
            for name, wrong, text in (
                ("gap", law.gap, "contacts of rigid blocks are closed; leave it out"),
                ("opened", law.opened != "kept", "rigid blocks keep strengths; leave it"),
                ("glued", law.glued, "give blocks that move as one as pieces of one block"),
                ("between", places, "must be two groups or blocks"),
                ("tensile_strength", crushes, "joints that crush carry none; leave it out"),
            ):
                require(not wrong, f"{key}.{name}: {text}")
        quick = self.strained and self.solve.quick
        require(not quick, f"{self.strained}: needs forces all over contacts; no solve.quick")
        text = "blocks.elastic: is of scenes in space; blocks with a [mesh] strain in the plane"
        require(not (self.elastic and "plane" in self.kinds), text)
        self.check_loads()

    @property
    def strained(self) -> str:
        """Keys by which blocks have finite elements; empty where they have none."""
        asked = {"output.stress": self.output.stress, "blocks.elastic": self.elastic}
        return ", ".join(key for key, given in asked.items() if given)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds that the scene is of, see `scene.rules.OF`."""
        return ("blocks", "plane") if self.dimension == 2 else ("blocks", "space", "elastic")

    @property
    def units(self) -> Units:
        """Units of what people read on the console: in space, forces of the whole structure."""
        return Units(self.output.units, 1.0 if self.dimension == 3 else self.thickness)

    @classmethod
    def of_tables(cls, tables: Mapping[str, Any], folder: Path, comm: MPI.Comm) -> BlockScene:
        """See `OfFile`."""
        scene = None
        with raised_together(comm):
            if comm.rank == 0:
                scene = cls.from_tables(tables, folder)
        return comm.bcast(scene)

    @classmethod
    @checked
    def from_tables(cls, given: Mapping[str, Any], folder: Path, known: Any = None) -> BlockScene:
        """A scene from the tables of a file, and the folder in which its blocks are found.

        Where these are `known`, as `ReadBlocks`, they are not read again.

        Raises:
            InputError: If a table is wrong.
        """
        tables = from_table(_SceneTables, given)
        require_fit("plane", tables.plane, None, ("blocks",))
        read = known or read_blocks(given, folder)
        shared = tables.given()
        lines = {name: Sides(lines=lines) for name, lines in read.sides.items()}
        shared["sides"] = {**lines, **tables.sides}
        return cls(
            blocks=read.blocks,
            dimension=tables.dimension,
            read=read.told,
            notes=read.notes,
            mesh_size=read.size,
            elastic=read.elastic,
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
        pairs = self._pairs()
        between = ((one, (blocks[one.first], blocks[one.second])) for one in touching)
        acting = [(one, law) for one, ends in between if (law := self._law_of(pairs, ends))]
        text = "blocks: no two of them touch, so that nothing holds them"
        require(bool(acting), "; ".join([text, *warnings]))
        contacts, laws = zip(*acting, strict=True)
        moving = [k for k, block in enumerate(blocks) if not block.fixed]
        masses = Masses.of_blocks(blocks, {k: self.material(blocks[k]).density for k in moving})
        floors = {
            name: masses_of_floor(f"floors.{name}", floor, blocks, near)
            for name, floor in self.floors.items()
        }
        pushed = masses.with_(*(floors[n][0] for n, floor in self.floors.items() if floor.mass))
        foot = min(lowest(blocks[k], self._up) for k in moving)
        factors = factors_of(self.live, pushed.position @ self._up - foot, pushed.mass)
        dead = dict(surface_loads("loads.dead", self.dead, blocks, self.sides, near))
        for name, (mass, thrust) in floors.items():
            weight = mass.acting(-GRAVITY * UP, on=thrust.on)
            dead[f"floors.{name}"] = replace(weight, sides=thrust.sides)
            if np.any(thrust.force):
                dead[f"floors.{name}.thrust"] = thrust
        live = dict(surface_loads("loads.live", self.live, blocks, self.sides, near))
        dead["loads.dead.body"] = masses.acting(lifted(self.dead.acceleration))
        live["loads.live.body"] = pushed.acting(lifted(self.live.acceleration), factors)
        pushes = total("loads.live", blocks, live)
        if not np.any(pushes):
            warnings = (*warnings, "loads.live pushes nothing")
        hanging = self._without_ground(blocks, contacts, near)
        return Structure(
            blocks,
            contacts,
            laws,
            total("loads.dead", blocks, dead),
            pushes,
            self.solve.quick,
            bars_of(self.ties, blocks, near),
            self._moved(blocks),
            max(material.young for material in self.materials.values()),
            (*self.notes, *self._odd_sizes(), *warnings, *hanging, *self._odd_values(laws)),
            tuple(text for text in warnings if isinstance(text, Doubt)),
            acting={**dead, **live},
            dimension=self.dimension,
            law_of=partial(self._law_between, pairs, blocks),
        )

    def _without_ground(
        self, blocks: Sequence[Block], contacts: Sequence[Contact], near: float
    ) -> Iterator[str]:
        """Blocks that the default ground would carry, were no other block fixed."""
        levels = np.array([np.inf if b.fixed else lowest(b, self._up) for b in blocks])
        hangs = levels <= levels.min() + near
        for one in contacts:
            slope = float(one.axes[0] @ self._up)
            hangs[one.second] &= not blocks[one.first].fixed and slope < UPHOLDS
            hangs[one.first] &= not blocks[one.second].fixed and slope > -UPHOLDS
        if np.any(hangs) and not self.foundations:
            lowest_ones = _counted([blocks[k] for k in np.flatnonzero(hangs)])
            cure = "since other blocks are fixed: give [foundations.NAME]"
            yield f"no ground is below {lowest_ones} at the lowest level, {cure}"

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

    def _odd_values(self, used: Sequence[ContactLaw]) -> Iterator[str]:
        """Values that are probably in another unit; blocks without weight, laws without contact."""
        materials = {f"materials.{name}": material for name, material in self.materials.items()}
        yield from unusual_values({**materials, **self.laws()})
        light = [b for b in self.blocks if not (b.fixed or self.material(b).density)]
        if light:
            yield f"{_counted(light)} without weight: their material has no density"
        arches = {"voussoirs", "vault"} & {block.group for block in self.blocks}
        loaded = self.live.force or self.live.traction
        if arches and loaded and all(law.compressive_strength == np.inf for law in used):
            cure = "give materials.default.compressive_strength, Pa"
            yield f"the arches do not crush and may carry too much: {cure}"
        keys = {law.key for law in used}
        for key, law in self.laws().items():
            if law.acts and key not in {*keys, "joints.default"}:
                yield f"{key} is the law of no contact"

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
        weight = lifted(self.dead.acceleration)
        axis = int(np.argmax(np.abs(weight)))
        along = abs(weight[axis]) > SAME_DIRECTION * np.linalg.norm(weight)
        return -np.sign(weight[axis]) * np.eye(3)[axis] if axis < 2 and along else UP

    def _grounds(self) -> Iterator[tuple[str, tuple[float, ...], float]]:
        """Names of rigid grounds, unit vectors out of them, and their levels, m."""
        given: Mapping[str, Any] = self.foundations
        if not given and not any(block.fixed for block in self.blocks):
            given = {GROUND: Foundation(friction=0.0)}  # its law is that of joints
        for name, law in given.items():
            up = self._up if law.height is None else UP
            level = law.height
            if law.plane is not None:
                normal = lifted(law.plane.normal or tuple(UP))
                up = normal / np.linalg.norm(normal)
                level = float(up @ lifted(law.plane.point))
            elif level is None:
                level = min(lowest(b, up) for b in self.blocks)
            yield name, tuple(up.tolist()), level

    def _moved(self, blocks: Sequence[Block]) -> Array | None:
        """Motions of the ground, m and rad, shape (blocks, 6)."""
        moved = np.zeros((len(blocks), 6))
        fixed = {block.name: k for k, block in enumerate(blocks) if block.fixed}
        for name, movement in self.dead.movement.items():
            text = f"loads.dead.movement.{name}: '{name}' is neither a fixed block nor a foundation"
            require(name in fixed, f"{text}; there are {listed(sorted(fixed))}")
            moved[fixed[name]] = motion_of(movement)
        return moved if self.dead.movement else None

    def _law_of(self, pairs: dict[frozenset[str], str], ends: Sequence[Block]) -> ContactLaw | None:
        """Law of a contact between two blocks; None where it is off.

        Raises:
            InputError: If there is none.
        """
        every = self.laws()
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
        return ContactLaw(*values, min(strengths), key) if law.acts else None

    def _law_between(
        self, pairs: dict[frozenset[str], str], blocks: Sequence[Block], first: int, second: int
    ) -> ContactLaw | None:
        """Law of blocks by their numbers, also of those that do not touch as drawn.

        Where none is given for them they have no friction.
        """
        try:
            return self._law_of(pairs, (blocks[first], blocks[second]))
        except InputError:
            return ContactLaw(0.0)

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


def _counted(blocks: Sequence[Block]) -> str:
    """How many blocks there are, and the names of the first."""
    names = listed(block.name for block in blocks[:NAMED])
    return f"{counted(len(blocks), 'block')} ({names}{', ...' * (len(blocks) > NAMED)})"


def read_blocks(tables: Mapping[str, Any], folder: Path) -> ReadBlocks:
    """The blocks of the tables of a scene file.

    Raises:
        InputError: If they are wrong.
    """
    require(bool(tables.get("blocks")), "blocks is missing; give file, builder, or [blocks.NAME]")
    table = as_mapping("blocks", tables["blocks"])
    return blocks_of_table(table, folder, tables.get("dimension", 2))


def upright(contact: Contact) -> Contact:
    """A contact with its first tangent in the plane, the second one along y."""
    normal = contact.axes[0]
    across = np.array([0.0, 1.0, 0.0])
    return replace(contact, axes=np.array([normal, np.cross(across, normal), across]))


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
    axis = "xyz"[dimension - 1]
    for name, up, level in grounds:
        key = f"foundations.{name}"
        bodies = ground_below(key, moving, (np.array(up), level), depth, tolerance, axis)
        blocks = (*blocks, Block(bodies, name, key, fixed=True))
    contacts, warnings = checked_contacts(blocks, tolerance)
    if dimension == 2:
        contacts = tuple(upright(contact) for contact in contacts)
    return blocks, contacts, warnings


# ---- what a scene file holds, table by table


@dataclass(frozen=True, kw_only=True)
class _SceneTables(Tables):
    blocks: Mapping[str, Any] = field(default_factory=dict)
    foundations: Mapping[str, Foundation] = field(default_factory=dict)  # type: ignore[assignment]
    sides: Mapping[str, Sides] = field(default_factory=dict)
    tolerance: float | None = None
