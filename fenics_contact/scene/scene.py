"""A scene: a mesh of blocks with materials, joints, supports and loads; what a user describes."""

from __future__ import annotations

import cmath
import copy
import math
import pickle
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, fields, is_dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Self

import numpy as np

from fenics_contact import compat
from fenics_contact.errors import (
    InputError,
    Vector,
    checked,
    key_of,
    require,
    shown,
    types_of,
)
from fenics_contact.geometry.gmsh_mesh import BLOCKS
from fenics_contact.geometry.mesh import BlockMesh
from fenics_contact.parallel import MPI
from fenics_contact.scene.rules import (
    DIRECTION,
    FINITE,
    MOST_TILT,
    NOT_NEGATIVE,
    POSITIVE,
    STRENGTH,
    Checked,
    is_of,
    listed,
    named,
    one_of,
    only,
    require_choice,
    require_fit,
    require_profile,
    require_size,
    require_vector,
    rule,
    ruled,
    within,
)
from fenics_contact.scene.toml_tables import assign, from_table, is_of_blocks, read_toml
from fenics_contact.scene.units import UNITS, Units
from fenics_contact.search_options import SEARCH

#: Values that strings of tables can have, by name of their key.
SUPPORTS = ("fixed", "roller")
PLANE = ("strain", "stress")
#: Value of `output.pictures` for more than the collapse.
ALL = "all"
FORMATS = ("png", "svg", "pdf")

#: Methods that solve for joint forces within given bounds.
BY_JOINT_FORCES = ("splitting", "active-set")
#: Those by the fixed point on the friction bound.
BY_FIXED_POINT = ("fixed-point", *BY_JOINT_FORCES)

#: What joints with a compressive strength are called.
CRUSHING = "joints that crush"

#: A UFL form, linear in the test function v, over the measures dx and ds of the blocks.
LoadForm = Callable[..., Any]

#: Stress, a symmetric 2 x 2 tensor of UFL, Pa, of a strain, a `Material` and, if there is a third
#: parameter, the place in UFL; linear in the strain.
StressLaw = Callable[..., Any]

#: Characters that a title can have.
LONGEST_TITLE = 1000
#: Relative difference up to which tangents of two angles are one: they are given to six digits.
SAME_ANGLE = 1e-5
#: Components of forces below this part of their size are rounding.
ROUNDING = 1e-9
#: Fields of scenes and their files that are not alike.
APART = (
    *("mesh", "blocks", "plane", "degree", "dimension", "thickness", "read", "notes", "mesh_size"),
    *("elastic", "loads", "live", "dead"),
)
#: 1 g, m/s2: of loads that are given by their direction, and of the mass of a floor.
GRAVITY = 9.81
#: Largest friction: programs for rigid blocks take coefficients up to 1e15.
MOST_FRICTION = 1e12
#: Largest height of soil and water, m, also in map coordinates.
HIGHEST = 1e9
LEVEL = within(-HIGHEST, HIGHEST, f"must lie in -{HIGHEST:g} ... {HIGHEST:g} m")
RATIO = rule(lambda v: -1.0 < v < 0.5, "must lie in (-1, 0.5)")
ANGLE = rule(lambda v: 0.0 <= v < 90.0, "must lie in 0 ... 90 degrees")
TURN = within(-360.0, 360.0, "must lie in -360 ... 360 degrees")


def function_name(function: Callable[..., Any] | None) -> str:
    """Name of a function of the user, for people; empty for None."""
    return getattr(function, "__qualname__", type(function).__name__) if function else ""


def _require_pickled(name: str, function: Callable[..., Any] | None) -> None:
    """Refuse to pickle a function that cannot be, with a message."""
    try:
        pickle.dumps(function)
    except Exception as error:  # pickle has no error of its own for everything
        raise InputError(
            f"{name}: the function '{function_name(function)}' cannot be pickled ({error}); define"
            " it at the top of a module, and make what it needs inside it"
        ) from None


@dataclass(frozen=True)
class Material(Checked):
    """Linear elasticity and weight.

    Attributes:
        young: Young's modulus, Pa. Of rigid blocks it is that of their joints, and turns movements
            and stiffnesses of ties into forces.
        poisson: Poisson's ratio.
        density: kg/m3.
        compressive_strength: f_c, Pa, of joints between these blocks; None: they do not crush.
        tensile_strength: Of the stone, Pa: `output.stress` warns of larger tensions.
    """

    young: float = ruled(
        rule(lambda v: 0.0 < v < math.inf, "must be a positive number (Pa)", require_size), 5e9
    )
    poisson: float = ruled(RATIO, 0.2, of="elastic")
    density: float = ruled(NOT_NEGATIVE, 0.0)
    compressive_strength: float | None = ruled(STRENGTH, None)
    tensile_strength: float | None = ruled(STRENGTH, None, of="space")


@dataclass(frozen=True)
class JointLaw(Checked):
    """What a joint carries besides pressure.

    Attributes:
        law: "coulomb" (shear up to cohesion + friction x pressure), "tresca" (up to a bound),
            "frictionless".
        friction: Coefficient of friction, for "coulomb".
        bound: Shear strength, Pa, for "tresca".
        cohesion: Shear strength without pressure, Pa, for "coulomb".
        compressive_strength: f_c, Pa, in place of that of the blocks' materials.
        gap: Facets of two blocks up to this far apart face each other, and their distance is an
            initial opening, m; 0: only those that touch.
        dilatancy: Angle at which a joint that slides opens, degrees, for "coulomb"; at most the
            angle of friction, with which slip is associative.
        tensile_strength: Tension that the joint carries, Pa.
        opened: Whether cohesion and tensile strength are "kept" or "lost" where the joint opens in
            a collapse.
        glued: The joint neither opens nor slides: the blocks that it joins are one. What else is
            given means nothing.
        off: The joint carries nothing: the blocks do not touch there.
        between: The joint is that of all contacts between blocks of two two-dimensional groups, or
            between the blocks at two places, m, whatever groups of edges they are in.
    """

    law: str = one_of("coulomb", "tresca", "frictionless")
    friction: float | None = ruled(NOT_NEGATIVE, None)
    bound: float | None = ruled(NOT_NEGATIVE, None)
    cohesion: float = ruled(NOT_NEGATIVE, 0.0)
    compressive_strength: float | None = ruled(STRENGTH, None)
    gap: float = ruled(NOT_NEGATIVE, 0.0)
    dilatancy: float = ruled(ANGLE, 0.0)
    tensile_strength: float = ruled(NOT_NEGATIVE, 0.0)
    opened: str = one_of("kept", "lost")
    glued: bool = False
    off: bool = False
    between: tuple[tuple[float, float] | str, ...] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        require(not (self.glued and self.off), "a joint is either glued or off")
        require(not (self.glued and self.gap), "a glued joint takes no gap; close it in the mesh")
        if self.between is not None:
            two = "must be two names of groups of blocks, or places [x, y] in blocks"
            require(len(self.between) == 2, f"between = {list(self.between)} {two}")
            require(self.gap == 0.0, "a joint with between takes no gap; give it by its edges")
        for name, owner in (("friction", "coulomb"), ("bound", "tresca")):
            given = getattr(self, name) is not None
            require(not given or self.law == owner, f"law '{self.law}' takes no {name}")
            needed = self.law == owner and self.acts
            require(given or not needed, f"law '{owner}' needs {name}")
        for name in ("cohesion", "dilatancy"):
            coulomb = self.law == "coulomb" or getattr(self, name) == 0.0
            require(coulomb, f"law '{self.law}' takes no {name}")
        friction = self.friction or 0.0
        rough = f"friction = {friction} must be at most {MOST_FRICTION:g}"
        require(friction <= MOST_FRICTION, rough)
        angle = f"{math.degrees(math.atan(friction)):.6g} degrees for friction = {friction:g}"
        text = f"dilatancy = {self.dilatancy} must not exceed the angle of friction, {angle}"
        slope = math.tan(math.radians(self.dilatancy))
        require(slope <= friction * (1.0 + SAME_ANGLE), text)
        least = friction * self.tensile_strength
        text = (
            f"tensile_strength = {self.tensile_strength:g} needs a cohesion of at least friction"
            f" times it, {least:g} Pa: shear is carried up to cohesion + friction x pressure"
        )
        require(self.cohesion >= least * (1.0 - SAME_ANGLE), text)
        open_at_first = self.gap > 0.0 and self.tensile_strength > 0.0
        require(not open_at_first, "a joint with a gap takes no tensile_strength")

    @property
    def acts(self) -> bool:
        """Whether it is a contact: neither glued nor off."""
        return not (self.glued or self.off)

    @property
    def loses(self) -> bool:
        """Whether there are strengths that are lost where the joint opens."""
        return self.opened == "lost" and self.cohesion + self.tensile_strength > 0.0

    @property
    def dilation(self) -> float:
        """Opening by slip, the tangent of the dilatancy angle; `friction` where the two agree."""
        slope = math.tan(math.radians(self.dilatancy))
        friction = self.friction or 0.0
        return friction if abs(slope - friction) <= SAME_ANGLE * friction else slope


def _require_width(name: str, value: float | tuple[float, float]) -> None:
    """Refuse widths below 0."""
    for one in np.atleast_1d(value).tolist():
        NOT_NEGATIVE(name, one)


@dataclass(frozen=True)
class Force(Checked):
    """A force: with a mesh on an edge, wherever nodes are; else on a block or on sides.

    Attributes:
        force: N, in the plane per metre of thickness.
        x: Place, m.
        y: Place, m; where left out, the highest edge above or below `x` that looks up. Without a
            mesh the highest side at `x`, in space at `x` and `y`, is meant.
        width: The force is spread evenly over so much of the edge, m; 0 for a point. Without a
            mesh around `x`, in space along x and along y, on the highest sides there.
        axles: Of a train whose first one is at `x`: how far behind, m, and their parts of the
            force; those beside the structure are left out.
        block: Name of the block that it acts on; by default the one at `at`.
        at: Where, m; by default the block's centroid.
        sides: Name of sides that it is spread over evenly, in place of a block.
    """

    force: Vector = ruled(require_vector)
    x: float | None = ruled(FINITE, None)
    y: float | None = ruled(FINITE, None)
    width: float | tuple[float, float] | None = ruled(_require_width, None)
    axles: tuple[tuple[float, float], ...] | None = only("blocks")
    block: str | None = only("blocks")
    at: Vector | None = ruled(require_vector, None, of="blocks")
    sides: str | None = only("blocks")

    def __post_init__(self) -> None:
        super().__post_init__()
        placed = self.block is not None or self.at is not None
        given = [self.x is not None, placed, self.sides is not None]
        text = "x is missing; with blocks in place of a mesh give either block or at, or sides"
        require(given.count(True) == 1, text)
        at_x = self.x is not None or not (self.axles or self.width)
        require(at_x, "axles and width need x, the place of the first axle or the middle")


#: Its name in scenes with a mesh.
EdgeForce = Force


@dataclass(frozen=True)
class EarthPressure(Checked):
    """Pressure of soil or water that grows with depth, with the shear of a rough wall.

    The pressure at height y is coefficient x (surcharge + unit_weight (level - y)), against the
    edge; below `level` only.

    Attributes:
        level: Height of the surface of the soil or water, m.
        unit_weight: N/m3.
        coefficient: Of lateral pressure, for example Rankine's tan^2(45 deg - phi / 2); 1 for
            water.
        surcharge: Vertical pressure on the surface, Pa.
        wall_friction: Angle between the force and the normal, degrees; soil that settles pulls
            the edge down.
    """

    level: float = ruled(LEVEL)
    unit_weight: float = ruled(NOT_NEGATIVE)
    coefficient: float = ruled(NOT_NEGATIVE, 1.0)
    surcharge: float = ruled(NOT_NEGATIVE, 0.0)
    wall_friction: float = ruled(
        rule(lambda v: abs(v) < 90.0, "must lie between -90 and 90 degrees"), 0.0
    )


def _require_small(name: str, value: float | tuple[float, ...]) -> None:
    """Refuse angles that are not small."""
    angles = value if isinstance(value, tuple) else (value,)
    text = f"{name} = {shown(value)} must lie in -{MOST_TILT:g} ... {MOST_TILT:g} degrees"
    require(all(abs(angle) <= MOST_TILT for angle in angles), text)


@dataclass(frozen=True)
class Movement(Checked):
    """A small movement of a support, a foundation or ground: settlement, spreading, tilt.

    Attributes:
        displacement: Of the middle of its edges, or of its centroid, m.
        rotation: About this point, degrees, anticlockwise; in space about three axes.
    """

    displacement: Vector = ruled(require_vector, (0.0, 0.0))
    rotation: float | tuple[float, float, float] = ruled(_require_small, 0.0)


@dataclass(frozen=True)
class Tie(Checked):
    """A bar that carries tension only, up to its yield: a tie, an anchor, a cable.

    Its tension is prestress + stiffness x elongation, but not below 0 and not above `yield_`.
    Forces are N, in the plane per metre of thickness.

    Attributes:
        from_: Where it begins: a place in a block, m, or the name of a one-dimensional group.
        yield_: Tension at which it yields.
        to: Where it ends, likewise, in another block.
        ground: The place in the ground where it ends, m, in place of `to`.
        stiffness: E A / L, N/m; None: it does not stretch until it yields; between rigid blocks it
            is as stiff as a typical point of the joints.
        prestress: Tension in the structure as drawn.
        spacing: Distance of such ties along the thickness, m: forces are then those of one tie, N,
            and the stiffness that of one, N/m.
        plate: Side of square anchor plates at ends in blocks, across the tie, m: all stones below
            share its forces by area. None: an end holds the block that it is in.
        line: Places that it passes from `from_` to `to`, m, perhaps none: it is fastened to every
            stone on this line, as a ring beam. None: it is free between its ends.
        group: It holds stones of this group alone, or the block of this name; an end that is in
            none of them holds the nearest one.
    """

    from_: Vector | str = ruled(require_vector)
    yield_: float = ruled(POSITIVE)
    to: Vector | str | None = ruled(require_vector, None)
    ground: Vector | None = ruled(require_vector, None)
    stiffness: float | None = ruled(POSITIVE, None)
    prestress: float = ruled(NOT_NEGATIVE, 0.0)
    spacing: float | None = ruled(POSITIVE, None, of="mesh")
    plate: float | None = ruled(POSITIVE, None, of="blocks")
    line: tuple[Vector, ...] | None = only("blocks")
    group: str | None = only("blocks")

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.line is None or self.plate is None, "line: give either line or plate")
        require(self.line is None or self.to is not None, "line: it ends at a place, to")
        require((self.to is None) != (self.ground is None), "to: give either to or ground")
        within = self.prestress <= self.yield_
        require(within, f"prestress = {self.prestress:g} must not exceed yield, {self.yield_:g}")

    @property
    def per_metre(self) -> float:
        """Ties per metre of thickness, 1 where forces are given so."""
        return 1.0 if self.spacing is None else 1.0 / self.spacing


def _require_range(name: str, value: float | tuple[float, float]) -> None:
    """Refuse a place that is not finite, or a range that does not rise."""
    ends = value if isinstance(value, tuple) else (value, math.inf)
    require(math.isfinite(ends[0]), f"{name} = {shown(value)} must be finite (m)")
    require(ends[0] < ends[1], f"{name} = {shown(value)} must rise, [from, to]")


@dataclass(frozen=True)
class Floor(Checked):
    """A floor or roof that lies on top sides of blocks; its weight is part of the dead load.

    On rigid blocks each top side gets weight by the area on which the floor lies on it.

    Attributes:
        force: Its weight per area of its plan, N/m2.
        at: Name of a one-dimensional group: it lies on those sides of it that look up.
        y: Height of the sides that it lies on, m, in place of a group; where blocks touch there,
            it lies on those below. In space from where to where it reaches.
        x: From where to where it reaches, m; by default as far as top sides at that height.
        mass: Whether the live body force acts on its mass, force / 9.81 m/s2, too.
        z: Height in space, m.
        group: Only blocks of this group carry it.
        thrust: Level force of a roof, along x and y, N per metre of the plan across it, in the
            plane along x; part of the dead load.
        span: Along which axis of the plan, "x" or "y", it goes from wall to wall: what is above no
            wall lies on the next one that way. None: all tops in the plan share it by area.
    """

    force: float = ruled(NOT_NEGATIVE)
    at: str | None = only("mesh")
    y: float | tuple[float, float] | None = ruled(_require_range, None)
    x: tuple[float, float] | None = ruled(_require_range, None)
    mass: bool = False
    z: float | None = ruled(FINITE, None, of="space")
    group: str | None = only("blocks")
    thrust: float | tuple[float, float] | None = ruled(
        rule(lambda v: bool(np.all(np.isfinite(v))), "must be finite (N/m)"), None, of="blocks"
    )
    span: str | None = ruled(rule(lambda v: v in ("x", "y"), "must be x or y"), None, of="space")

    def __post_init__(self) -> None:
        super().__post_init__()
        height = self.z is not None or isinstance(self.y, float)
        text = "at: give either at, a group of top sides, or a height: y, in space z"
        require(height != (self.at is not None), text)
        beside = self.at is not None and self.x is not None
        require(not beside, "x goes with y: give either at, a group of top sides, or y")

    @property
    def height(self) -> float | None:
        """Height of the sides that it lies on, m; None where a group is given."""
        return self.y if isinstance(self.y, float) else self.z

    @property
    def axis(self) -> str:
        """Name of the axis of its height."""
        return "y" if self.z is None else "z"


@dataclass(frozen=True)
class Soil(Checked):
    """Soil that lies against outer sides, and pushes back where these move into it.

    At depth z below its surface the vertical stress is s = surcharge + unit_weight z. The soil
    presses level on the sides with k_a s to k_p s: with k_a where they give way, with k_p where
    they move into it. W.J.M. Rankine, Phil. Trans. R. Soc. 147 (1857) 9; C.A. Coulomb (1776).

    Attributes:
        at: Name of a one-dimensional group of outer sides.
        level: Height of the surface, m.
        unit_weight: N/m3.
        friction_angle: Of the soil, degrees; gives the coefficients that are left out.
        wall_friction: Angle of friction on the wall, degrees, at most that of the soil, for the
            coefficients: 0 those of Rankine, tan^2(45 deg -+ phi / 2), above 0 the level part of
            those of Coulomb for an upright wall. The soil's shear on the wall is left out.
        surcharge: Vertical pressure on the surface, Pa.
        active: k_a.
        passive: k_p.
        weight: Whether the soil lies on the sides that look up, with s, as dead load.
    """

    at: str
    level: float = ruled(LEVEL)
    unit_weight: float = ruled(NOT_NEGATIVE)
    friction_angle: float | None = ruled(ANGLE, None)
    wall_friction: float = ruled(ANGLE, 0.0)
    surcharge: float = ruled(NOT_NEGATIVE, 0.0)
    active: float | None = ruled(NOT_NEGATIVE, None)
    passive: float | None = ruled(NOT_NEGATIVE, None)
    weight: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        known = self.friction_angle is not None or None not in (self.active, self.passive)
        require(known, "give friction_angle, or both active and passive")
        angle = self.friction_angle or 0.0
        rough = f"wall_friction = {self.wall_friction:g} must not exceed friction_angle, {angle:g}"
        require(self.wall_friction <= angle, rough)
        least, most = self.coefficients
        text = f"active = {least:.4g} must not exceed passive = {most:.4g}"
        require(least <= most * (1.0 + SAME_ANGLE), text)

    @property
    def coefficients(self) -> tuple[float, float]:
        """K_a and k_p: level pressure over vertical stress, least and largest."""
        phi = math.radians(self.friction_angle or 0.0)
        delta = math.radians(self.wall_friction)
        root = math.sqrt(math.sin(phi + delta) * math.sin(phi) / math.cos(delta))
        least, most = ((math.cos(phi) / (1.0 + sign * root)) ** 2 for sign in (1.0, -1.0))
        return (
            least if self.active is None else self.active,
            most if self.passive is None else self.passive,
        )


@dataclass(frozen=True)
class Load(Checked):
    """A body force, tractions, forces at places, earth pressure and movements of supports.

    Attributes:
        body: Acceleration, m/s2, times density.
        traction: Force per area, Pa, by name of a one-dimensional group.
        tilt: Angle by which `body` is turned, degrees, anticlockwise: a tilting table. True, of the
            live load only: `body` is that of the dead load turned by a right angle, so that the
            load factor is the tangent of the angle at which the tilted structure collapses.
        force: Forces at places, by any name.
        earth: Earth pressure by name of a one-dimensional group.
        movement: Of supports and foundations by their names; of the dead load only.
        profile: Factor on `body` over the height above the structure's foot, of the live load only:
            "uniform"; "triangular", which grows from 0 at the foot and leaves the total as it is;
            or pairs (height, factor), m and 1, with straight lines between, constant beyond.
        form: In Python only: a function (v, dx, ds) that returns a UFL form, linear in the test
            function v, N per metre of thickness. dx and ds take names of groups: `ds("back")`. It
            is called on all ranks, once for every mesh and degree, and adds to the other loads.
        direction: In place of `body`, which is then 9.81 m/s2 this way.
        angle: Direction of `body` in plan, degrees from x towards y, whatever that of `body` is; of
            9.81 m/s2 where that is zero.
    """

    body: Vector = ruled(require_vector, (0.0, 0.0))
    traction: Mapping[str, Vector] = named(require_vector)
    tilt: float | bool = ruled(TURN, 0.0, of="mesh")
    force: Mapping[str, Force] = named()
    earth: Mapping[str, EarthPressure] = named(of="mesh")
    movement: Mapping[str, Movement] = named()
    profile: tuple[tuple[float, float], ...] | str = ruled(require_profile, "uniform")
    form: LoadForm | None = only("mesh")
    direction: Vector | None = ruled(DIRECTION, None)
    angle: float | None = ruled(TURN, None, of="space")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.direction is not None and not any(self.body):
            share = GRAVITY / math.hypot(*self.direction)
            object.__setattr__(self, "body", tuple(share * part for part in self.direction))
            object.__setattr__(self, "given", self.direction)  # as messages name it
            object.__setattr__(self, "direction", None)
        if self.angle is not None:
            size = math.hypot(*self.body[:2])
            text = "angle is that of a level body force in plan, and body is upright"
            require(size > 0.0 or not any(self.body), text)
            way = cmath.rect(size or GRAVITY, math.radians(self.angle))
            object.__setattr__(self, "body", (way.real, way.imag, *(self.body[2:] or (0.0,))))

    def __getstate__(self) -> dict[str, Any]:
        _require_pickled("form", self.form)
        return self.__dict__

    def __deepcopy__(self, memo: dict[int, Any]) -> Load:
        names = [item.name for item in fields(self) if item.name != "form"]
        return replace(self, **{name: copy.deepcopy(getattr(self, name), memo) for name in names})

    @property
    def acceleration(self) -> Vector:
        """The body force per mass, tilted, m/s2."""
        if isinstance(self.tilt, bool) or not self.tilt:
            return self.body
        turned = complex(*self.body) * cmath.rect(1.0, math.radians(self.tilt))
        return turned.real, turned.imag

    @property
    def on_table(self) -> bool:
        """Whether it is the weight on a table that tilts."""
        return self.tilt is True


@dataclass(frozen=True)
class SolveOptions(Checked):
    """How to look for the limit load.

    Attributes:
        method: How states are found: by continuation of the central path ("auto"), by an interior
            point method with Coulomb friction in its equations ("monolithic"), or by the fixed
            point on the friction bound, with an interior point method ("fixed-point") or by joint
            forces, normal and shear in turn ("splitting") or both at once ("active-set").
        direction: Which end of the range of load factors: "positive", "negative" or "both".
        tolerance: On the load factor, relative.
        control: What is prescribed: the "work" of the live load, or the "load" factor, from zero.
        slip: Measured from the "stress-free" state, or in "load-steps" (with control = "load").
        states: Report the "first" collapse state found, or the "lowest" (with control = "work").
        lowest: Look for a lower collapse state than the first, by the face engine; None: yes, but
            not in sweeps, nor from 1 000 blocks on; of rigid blocks then from one start.
        range: Look for the range of load factors of the mechanism; None: yes, but not in sweeps.
        error: Look for the load factor with shorter hinges than those of the mesh: True, with up to
            3 times the work of the limit load, False, or None: with at most half of that work.
        accuracy: Relative change from one mesh to the next down to which the mesh is refined; None:
            it stays.
        peak: Look for the peak of the loading path before the collapse; None: with at most half the
            work of the limit load where there is no peak, and five times that where there is one.
        relaxation: omega of the fixed point on the friction bound, 0 to 2; None: by the changes.
        time: After so many seconds by the clock what is known is the result; None: any time.
        engine: What finds the load factor that is reported: the loading "path" of elastic blocks,
            the forces of their "faces" with a proved gap, "follow", the path by the kernel of
            faces, or "auto": the path below 100 blocks and where it soon comes to its end, else the
            faces.
        gap: Largest gap, relative, of a load factor by the faces; None: 1e-3, 5e-3 from 1 000
            blocks with a mesh on.
        fast: Load factor and bracket alone, verified: neither error estimate nor whatever else
            says more about them.
        distribute: Whether several ranks share out the mesh: False, or None where the mesh file is
            no larger than 250 MB: each holds the whole mesh, and they share the tasks. Of the
            command line; a scene made in Python shares its mesh as `BlockMesh` was given ranks.
        quick: Forces at the corners of contacts alone: torsion is not limited.
        beyond: Follow the collapse in large displacements until nothing is left; or a displacement
            of the control point, m, up to which.
        ties: Look for the collapse without ties, and for the yield at which a seismic demand is
            met; None: yes, but not in sweeps.
    """

    method: str = one_of("auto", "fixed-point", "monolithic", "splitting", "active-set", of="mesh")
    direction: str = one_of("positive", "negative", "both")
    tolerance: float = ruled(within(1e-12, 0.1, "must lie between 1e-12 and 0.1"), 1e-6, of="mesh")
    control: str = one_of("work", "load", of="mesh")
    slip: str = one_of("stress-free", "load-steps", of="mesh")
    states: str = one_of("first", "lowest")
    lowest: bool | None = None
    range: bool | None = only("mesh")
    error: bool | None = only("mesh")
    accuracy: float | None = ruled(
        within(1e-6, 0.5, "must lie between 1e-6 and 0.5"), None, of="mesh"
    )
    peak: bool | None = None
    time: float | None = ruled(rule(lambda v: 0.0 < v < math.inf, "must be positive (s)"), None)
    engine: str = one_of("auto", "path", "faces", "follow", of="mesh")
    gap: float | None = ruled(rule(lambda v: 0.0 < v <= 0.1, "must lie in 0 ... 0.1"), None)
    fast: bool = False
    distribute: bool | None = only("mesh")
    relaxation: float | None = ruled(
        rule(lambda v: 0.0 < v <= 2.0, "must lie in 0 ... 2"), None, of="mesh"
    )
    quick: bool = only("blocks", False)
    beyond: bool | float = ruled(
        rule(lambda v: 0.0 <= v < math.inf, "must be true, false or a displacement (m)"),
        False,
        of="blocks",
    )
    ties: bool | None = None

    @property
    def asked_gap(self) -> float:
        """Largest gap of a load factor of rigid blocks, relative."""
        return SEARCH.gap if self.gap is None else self.gap

    def __post_init__(self) -> None:
        super().__post_init__()
        refined = self.accuracy is not None
        by_load = self.control == "load"
        for given, text in (
            *((self.fast and getattr(self, name),
               f"{name} = true needs fast = false: fast leaves it out")
              for name in ("peak", "lowest", "range", "error", "beyond")),
            (self.fast and self.states == "lowest", "states = 'lowest' needs fast = false"),
            (self.relaxation is not None and self.method not in BY_FIXED_POINT,
             f"relaxation needs method = {' or '.join(map(repr, BY_FIXED_POINT))}"),
            (refined and self.error is False,
             "accuracy needs the error estimate: no error = false"),
            (refined and self.fast, "accuracy needs fast = false: fast estimates no error"),
            (refined and by_load, "accuracy needs control = 'work'"),
            (self.slip == "load-steps" and not by_load,
             "slip = 'load-steps' needs control = 'load'"),
            (self.states == "lowest" and by_load, "states = 'lowest' needs control = 'work'"),
            (self.engine in ("faces", "follow") and by_load,
             f"engine = {self.engine!r} needs control = 'work'"),
        ):  # fmt: skip
            require(not given, text)


@dataclass(frozen=True)
class OutputOptions(Checked):
    """What to write besides result.json.

    Attributes:
        paraview: ParaView files of fields and joints.
        pictures: The collapse mode as a picture; "all": scene, joint forces, lines of thrust and
            stresses too, which are drawn without it if there is a report, or later by
            `fenics-contact report`. The capacity curve is drawn if there is one.
        formats: Of the pictures: "png", "svg", "pdf".
        capacity: Number of points on the capacity curve, 0 for none.
        report: report.html, all of the result on one page.
        units: Of what people read: "SI": N, Pa and m on the console, kN, MPa and m in the report;
            "m": kN, MPa and m in both; "mm": likewise with lengths in mm. Files are in SI units.
        control: Place of the control point of `solve.beyond`, m; None: the highest corner that
            moves.
        stress: Stresses in the blocks under the forces of the collapse, by finite elements.
    """

    paraview: bool = True
    pictures: bool | str = True
    formats: tuple[str, ...] = ("png",)
    capacity: int = ruled(within(0, 1000, "must lie in 0 ... 1000"), 0)
    report: bool = False
    units: str = "SI"
    control: Vector | None = ruled(require_vector, None, of="blocks")
    stress: bool = only("space", False)

    def __post_init__(self) -> None:
        super().__post_init__()
        known = ", ".join(f"{name} ({units})" for name, units in UNITS.items())
        require(self.units in UNITS, f"units = '{self.units}' must be one of {known}")
        wrong = f"pictures = '{self.pictures}' must be true, false or \"{ALL}\""
        require(isinstance(self.pictures, bool) or self.pictures == ALL, wrong)
        for name in self.formats:
            require_choice("formats", name, FORMATS)
        require(len(self.formats) > 0, "formats is empty; use pictures = false for no pictures")


@dataclass(frozen=True)
class Seismic(Checked):
    """The spectral acceleration at which the collapse mechanism starts, of existing masonry.

    Circolare 21.01.2019 n. 7 C.S.LL.PP., C8.7.1.2.1; see docs/seismic.md.

    Attributes:
        confidence_factor: FC, by which the capacity is divided: 1.35, 1.2 or 1 for the levels of
            knowledge LC1, LC2 and LC3. Where crushing is left out it is that of LC1.
        demand: Spectral acceleration that the code asks for, m/s2; None: no verdict.
        nonlinear: Make the check by displacements, too, along `solve.beyond`.
        spectrum: On the ground: a_g over g, S, F0 and TC, s; or periods, s, and accelerations,
            m/s2, with 5 % damping, from T = 0 on.
        limit_state: "SLD", "SLV" or "SLC", of that check.
        period: T_0 of an element that vibrates freely before it rocks, s; None: it does not.
        lost: Displacement of the control point at which supports are lost, m.
    """

    confidence_factor: float = ruled(within(1.0, 10.0, "must lie in 1 ... 10"), 1.35)
    demand: float | None = ruled(POSITIVE, None)
    nonlinear: bool = only("blocks", False)
    spectrum: Mapping[str, float] | tuple[tuple[float, float], ...] | None = only("blocks")
    limit_state: str = one_of("SLV", "SLC", "SLD", of="blocks")
    period: float | None = ruled(POSITIVE, None, of="blocks")
    lost: float | None = ruled(POSITIVE, None, of="blocks")

    def __post_init__(self) -> None:
        super().__post_init__()
        spectrum = self.spectrum or ()
        require(not self.nonlinear or bool(spectrum), "nonlinear = true needs spectrum")
        keys = ("ag", "S", "F0", "TC")
        if isinstance(spectrum, Mapping):
            given = set(spectrum) == set(keys)
            require(given, f"spectrum = {dict(spectrum)} must have the keys {', '.join(keys)}")
            for key, value in spectrum.items():
                POSITIVE(f"spectrum.{key}", value)
            return
        for pair in spectrum:
            require_vector("spectrum", pair)
        rises = all(low[0] < high[0] for low, high in pairwise(spectrum))
        text = "spectrum must be pairs [period, acceleration] that rise from [0, above 0]"
        require(not spectrum or (rises and spectrum[0][0] == 0.0 < spectrum[0][1]), text)


class _Own:
    """What every scene has, in an order of its own."""

    materials: Mapping[str, Material]
    live: Load
    dead: Load
    thickness: float | None


@dataclass(frozen=True, kw_only=True)
class Shared(_Own):
    """What scenes with a mesh, scenes of rigid blocks and their files have alike; see `Scene`."""

    joints: Mapping[str, JointLaw] = field(default_factory=dict)
    foundations: Mapping[str, JointLaw] = field(default_factory=dict)
    ties: Mapping[str, Tie] = field(default_factory=dict)
    floors: Mapping[str, Floor] = field(default_factory=dict)
    seismic: Seismic | None = None
    title: str = ""
    solve: SolveOptions = field(default_factory=SolveOptions)
    output: OutputOptions = field(default_factory=OutputOptions)

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds that the scene is of, see `scene.rules.OF`."""
        return "mesh", "plane", "elastic"

    def check_parts(self) -> None:
        """Refuse what a scene of its kinds does not take."""
        Checked.__post_init__(self)  # type: ignore[arg-type]
        wide = self.thickness
        problem = f"plane.thickness = {wide} must be a number above 0 (m); leave it out for 1 m"
        require(wide is None or 0.0 < wide < math.inf, problem)
        require_size("plane.thickness", wide or 0.0)
        long = f"title has {len(self.title)} characters; give at most {LONGEST_TITLE}"
        require(len(self.title) <= LONGEST_TITLE, long)
        for key, load in (("loads.dead", self.dead), ("loads.live", self.live)):
            text = f"{key}.direction: give either body or direction"
            require(load.direction is None, text)
            require_fit(f"{key}.direction", vars(load).get("given"), Vector, self.kinds)
        for key, value in self._parts().items():
            require_fit(key, value, types_of(type(self)).get(key), self.kinds)
        unmultiplied = "supports move with the dead load; give it in loads.dead.movement"
        require(not self.live.movement, f"loads.live.movement: {unmultiplied}")

    def check_loads(self) -> None:
        """Refuse a profile, or a seismic check, without what it acts on."""
        text = "loads.dead.profile: a profile is of the live load; leave it out of the dead load"
        require(self.dead.profile == "uniform", text)
        bare = self.live.profile != "uniform" and not any(self.live.acceleration)
        require(not bare, "loads.live.profile acts on loads.live.body, which is zero; give it")
        if self.seismic is not None:
            check_inertia_forces(self.dead, self.live)

    def _parts(self) -> dict[str, Any]:
        """What the tables of a scene file hold, but mesh and blocks, by their keys."""
        given = {name: getattr(self, name) for name in _names(self)}
        return {**given, "loads.live": self.live, "loads.dead": self.dead}

    def tables(self) -> dict[str, Any]:
        """The scene as tables of a file, but for its mesh or blocks."""
        tables: dict[str, Any] = {}
        for key, value in as_tables(self._parts(), self.kinds).items():
            assign(tables, key, value)
        return tables

    def laws(self) -> dict[str, JointLaw]:
        """Laws of contacts by their keys in a scene file."""
        laws = {f"joints.{name}": law for name, law in self.joints.items()}
        return laws | {f"foundations.{name}": law for name, law in self.foundations.items()}


class OfFile(Shared, ABC):
    """What scenes have alike that are read from files; see `Scene`."""

    @classmethod
    @checked
    def from_file(
        cls, path: str | Path, comm: MPI.Comm | None = None, overrides: Sequence[str] = ()
    ) -> Self:
        """Read a scene file, and its mesh or blocks.

        Args:
            path: The TOML file; files that it names are found relative to it.
            comm: By default, the communicator that PETSc was started with.
            overrides: Assignments "joints.default.friction=0.5" made on top of the file.

        Raises:
            InputError: On all ranks, if a file is missing or wrong.
        """
        comm = compat.default_comm() if comm is None else comm
        return cls.of_tables(read_toml(Path(path), comm, overrides), Path(path).parent, comm)

    @classmethod
    @abstractmethod
    def of_tables(cls, tables: Mapping[str, Any], folder: Path, comm: MPI.Comm) -> Self:
        """A scene from the tables of a file in a folder, on all ranks.

        Raises:
            InputError: If a table, or a file that one names, is wrong.
        """


@dataclass(frozen=True)
class Scene(OfFile):
    """Blocks, what joins and holds them, and what loads them.

    Attributes:
        mesh: Blocks.
        materials: By name of a two-dimensional group; "default" for others.
        live: Load multiplied by the load factor.
        dead: Load that acts first and stays.
        joints: Law by name of a one-dimensional group where two blocks touch; "default" for others.
        foundations: Law by name of a one-dimensional group that stands on rigid ground.
        supports: "fixed" or "roller" by name of a one-dimensional group.
        ties: Ties, anchors and cables, by any name.
        floors: Floors and roofs that lie on the blocks, by any name.
        soil: Soil that pushes back on outer sides, by any name.
        seismic: The seismic check to make; None: none.
        plane: "strain" or "stress".
        thickness: Of the structure, m, for forces that people read; results are per metre of it.
        degree: Degree of the displacements, 1 or 2.
        stress: In Python only: a function (strain, material), or (strain, material, x) with the
            place in UFL, that returns the stress in the plane, Pa, as a symmetric UFL tensor,
            linear in the strain, in place of `young`, `poisson` and `plane`.
        title: For pictures.
        solve: How to look for the limit load.
        output: What to write.

    Raises:
        InputError: If a name is not in the mesh, or a group has two roles.
    """

    mesh: BlockMesh
    materials: Mapping[str, Material]
    live: Load
    dead: Load = field(default_factory=Load)
    plane: str = "strain"
    degree: int = 1
    thickness: float | None = None
    _: KW_ONLY
    supports: Mapping[str, str] = field(default_factory=dict)
    soil: Mapping[str, Soil] = field(default_factory=dict)
    stress: StressLaw | None = None

    def __post_init__(self) -> None:
        self.check_parts()
        require_choice("plane.state", self.plane, PLANE)
        require(self.degree in (1, 2), f"mesh.degree = {self.degree} must be 1 or 2")
        for name, kind in self.supports.items():
            require_choice(f"supports.{name}", kind, SUPPORTS)
        for name, law in self.foundations.items():
            needless = "takes no gap; rigid ground is where the edge is"
            require(law.gap == 0.0, f"foundations.{name} {needless}")
            held = f"foundations.{name}.glued: make the group a support, 'fixed'"
            require(not law.glued, held)
            free = (
                f"foundations.{name} takes neither off nor between; leave it out where it is free"
            )
            require(not law.off and law.between is None, free)
        for name, tie in self.ties.items():
            stretches = tie.stiffness is not None or tie.prestress == 0.0
            slack = "needs stiffness: a tie that does not stretch keeps no force"
            require(stretches, f"ties.{name}.prestress {slack}")
        self._check_names()
        require(not self.dead.on_table, "loads.dead.tilt = true: give an angle in degrees")
        if self.live.on_table:
            self._tilt_table()
        self._check_options()
        self.check_loads()

    def __getstate__(self) -> dict[str, Any]:
        _require_pickled("stress", self.stress)
        return self.__dict__

    @property
    def comm(self) -> MPI.Comm:
        """Communicator of the mesh."""
        return self.mesh.comm

    @property
    def units(self) -> Units:
        """Units of what people read on the console."""
        return Units(self.output.units, self.thickness)

    @classmethod
    def of_tables(cls, tables: Mapping[str, Any], folder: Path, comm: MPI.Comm) -> Scene:
        """See `OfFile`."""
        return cls.from_tables(
            tables, lambda file, blocks: BlockMesh.from_file(folder / file, comm, blocks)
        )

    @classmethod
    @checked
    def from_tables(cls, given: Mapping[str, Any], mesh: Callable[[str, str], BlockMesh]) -> Scene:
        """A scene from the tables of a file, and what makes the mesh of `mesh.file` and `.blocks`.

        Raises:
            InputError: If a table is wrong.
        """
        rigid = "a scene of rigid blocks: read it by Scene of fenics_contact.spatial"
        require(not is_of_blocks(given), rigid)
        tables = from_table(_SceneTables, given)
        for name, one in given["materials"].items():
            for key in ("young", "poisson"):
                require(key in one, f"materials.{name}.{key} is missing")
        return cls(
            mesh=mesh(tables.mesh.file, tables.mesh.blocks),
            plane=tables.plane.state,
            degree=tables.mesh.degree,
            **tables.given(),
        )

    def tables(self) -> dict[str, Any]:
        """The scene as tables of a file; the mesh has its source in place of a file."""
        return {
            "mesh": {"file": self.mesh.source, "degree": self.degree},
            "plane": as_tables({"state": self.plane, "thickness": self.thickness}, ()),
            **super().tables(),
        }

    def material(self, groups: Iterable[str]) -> Material:
        """Material of the cells in a set of groups."""
        return self.materials[self.material_name(groups)]

    def material_name(self, groups: Iterable[str]) -> str:
        """Name of the material of the cells in a set of groups."""
        return min(set(groups) & set(self.materials), default="default")

    def _check_names(self) -> None:
        source = self.mesh.source
        cells = self.mesh.cell_names
        facets = self.mesh.facet_names
        between = {name for name, law in self.joints.items() if law.between is not None}
        require("default" not in between, "joints.default takes no between; give it another name")
        for name in sorted(between):
            for block in self.joints[name].between or ():
                text = f"joints.{name}.between: {source} has no two-dimensional group '{block}'"
                there = not isinstance(block, str) or block in cells
                require(there, f"{text}; it has {listed(cells)}; or give a place in a block")
        for table, names, known, number in (
            ("materials", set(self.materials) - {"default"}, cells, "two"),
            ("joints", set(self.joints) - {"default"} - between, facets, "one"),
            ("foundations", self.foundations, facets, "one"),
            ("supports", self.supports, facets, "one"),
            ("loads.dead.traction", self.dead.traction, facets, "one"),
            ("loads.live.traction", self.live.traction, facets, "one"),
            ("loads.dead.earth", self.dead.earth, facets, "one"),
            ("loads.live.earth", self.live.earth, facets, "one"),
        ):
            for name in sorted(names):
                text = f"{table}.{name}: {source} has no {number}-dimensional group '{name}'"
                require(name in known, f"{text}; it has {listed(known)}")
        ends: dict[str, Any] = {f"floors.{n}.at": floor.at for n, floor in self.floors.items()}
        for name, tie in self.ties.items():
            ends |= {f"ties.{name}.from": tie.from_, f"ties.{name}.to": tie.to}
        for key, end in ends.items():
            text = f"{key} = '{end}': {source} has no one-dimensional group '{end}'"
            there = not isinstance(end, str) or end in facets
            require(there, f"{text}; it has {listed(facets)}; or give a place by x and y")
        for name, soil in self.soil.items():
            text = f"soil.{name}.at = '{soil.at}': {source} has no one-dimensional group"
            require(soil.at in facets, f"{text} '{soil.at}'; it has {listed(facets)}")
        held = sorted([*self.foundations, *self.supports])
        for name in sorted(self.dead.movement):
            text = f"loads.dead.movement.{name}: '{name}' is neither a support nor a foundation"
            require(name in held, f"{text}; those of this scene are {listed(held)}")
        roles = sorted([*self.joints, *held])
        for name, following in pairwise(roles):
            text = f"group '{name}' has two roles; it can be a joint, a foundation or a support"
            require(name != following or name == "default", text)

        for groups in self.mesh.cell_sets:
            materials = sorted(groups & set(self.materials))
            cure = f"add [materials.{min(groups)}] or [materials.default]"
            text = f"cells of {listed(sorted(groups))} have no material; {cure}"
            require(bool(materials) or "default" in self.materials, text)
            text = f"the groups {listed(materials)} share cells; give one material"
            require(len({self.materials[name] for name in materials}) <= 1, text)

    def _laws(self) -> dict[str, JointLaw]:
        """Laws of contacts that are neither glued nor off."""
        return {key: law for key, law in self.laws().items() if law.acts}

    @property
    def has_strength(self) -> bool:
        """Whether a compressive strength is given."""
        given: list[JointLaw | Material] = [*self._laws().values(), *self.materials.values()]
        return any(one.compressive_strength is not None for one in given)

    def _check_options(self) -> None:
        """Refuse laws, ties and options of which one does not know the other."""
        solve = self.solve
        laws = self._laws().items()
        dilating = ", ".join(f"{name}.dilatancy" for name, law in laws if law.dilatancy)
        bonded = ", ".join(f"{name}.tensile_strength" for name, law in laws if law.tensile_strength)
        losing = ", ".join(f"{name}.opened" for name, law in laws if law.loses)
        named = [*(f"ties.{n}" for n in self.ties), *(f"soil.{n}" for n in self.soil)]
        ties = ", ".join(named)
        method = f"solve.method = '{solve.method}' knows no"
        by_forces = solve.method in BY_JOINT_FORCES
        lost = f"{losing}: what is lost depends on the way of the load; it cannot be used with"
        for given, refused, text in (
            (dilating, by_forces, f"{method} {dilating}; use solve.method = 'auto'"),
            (dilating, solve.slip == "load-steps",
             f"solve.slip = 'load-steps' knows no {dilating}; use solve.slip = 'stress-free'"),
            (bonded, self.has_strength, f"{bonded}: {CRUSHING} carry no tension; leave out one"
             " of tensile_strength and compressive_strength"),
            (solve.engine == "path", self.has_strength, f"solve.engine = 'path' knows no {CRUSHING}"
             "; leave it out, or compressive_strength"),
            (losing, solve.control == "load", f"{lost} solve.control = 'load'"),
            (losing, solve.states == "lowest", f"{lost} solve.states = 'lowest'"),
            (losing, solve.accuracy is not None, f"{lost} solve.accuracy"),
            (losing, solve.peak is True, f"{lost} solve.peak = true"),
            (losing, self.output.capacity > 0, f"{lost} output.capacity"),
            (losing, self.has_strength, f"{lost} compressive_strength"),
            (ties, by_forces, f"{method} {ties}; use solve.method = 'auto'"),
        ):  # fmt: skip
            require(not (given and refused), text)

    def _tilt_table(self) -> None:
        """Take the dead body force, turned, as the live one; refuse what a tilt does not turn."""
        key = "loads.live.tilt = true"
        x, y = self.dead.acceleration
        require(x != 0.0 or y != 0.0, f"{key} turns the weight; give loads.dead.body")
        live = replace(self.live, body=(-y, x))
        given = self.live.body not in ((0.0, 0.0), live.body)
        require(not given, f"{key} takes the weight as the live load; leave out loads.live.body")
        object.__setattr__(self, "live", live)
        names = ("traction", "force", "earth", "form")
        others = [
            f"loads.{kind}.{name}"
            for kind, load in (("dead", self.dead), ("live", live))
            for name in names
            if getattr(load, name)
        ]
        others += ["loads.live.profile"] * (live.profile != "uniform")
        others += ["seismic"] * (self.seismic is not None)
        others += [f"ties.{name}" for name in self.ties] + [f"soil.{name}" for name in self.soil]
        strengths = ("cohesion", "bound", "tensile_strength", "compressive_strength")
        named: dict[str, Any] = {f"materials.{name}": one for name, one in self.materials.items()}
        others += [
            f"{name}.{strength}"
            for name, one in (named | self._laws()).items()
            for strength in strengths
            if getattr(one, strength, None)
        ]
        text = (
            f"{key}: {', '.join(others)} would not turn with the weight, so the angle would be"
            " wrong; leave it out, or give loads.live.body"
        )
        require(not others, text)

    def tilt_angle(self, load_factor: float) -> float | None:
        """Angle of a tilting table at a load factor, degrees; None where the load is another."""
        return math.degrees(math.atan(load_factor)) if self.live.on_table else None


def check_inertia_forces(dead: Any, live: Any) -> None:
    """Refuse live loads that are no inertia forces in proportion to the weights.

    Args:
        dead: The dead load of a scene, in the plane or in space.
        live: Its live load.

    Raises:
        InputError: The message names the key.
    """
    weight = [float(part) for part in dead.acceleration]
    push = [float(part) for part in live.acceleration]
    require(any(weight), "seismic needs weights; give loads.dead.body")
    require(any(push), "seismic needs inertia forces; give loads.live.body")
    for refused, key in (
        (live.profile != "uniform", "profile"),
        (bool(getattr(live, "earth", None)), "earth"),
        (getattr(live, "form", None) is not None, "form"),
    ):
        text = f"seismic: loads.live.{key} is not in proportion to the weights; leave it out"
        require(not refused, text)
    forces = {"body": push, **{f"traction.{name}": one for name, one in live.traction.items()}}
    forces |= {f"force.{name}": one.force for name, one in live.force.items()}
    for name, force in forces.items():
        least = ROUNDING * math.hypot(*force) * math.hypot(*weight)
        text = f"seismic: loads.live.{name} must be horizontal, across loads.dead.body"
        require(abs(sum(f * w for f, w in zip(force, weight, strict=True))) <= least, text)
        against = sum(f * p for f, p in zip(force, push, strict=True)) < 0.0
        require(not against, f"seismic: loads.live.{name} acts against loads.live.body")


def _names(scene: Shared) -> list[str]:
    """Names that fields of a scene and tables of its file have alike."""
    return [item.name for item in fields(scene) if item.name not in APART]


def as_tables(item: Any, scene: Collection[str]) -> Any:
    """Dataclasses, mappings and numpy's numbers as a file has them, without what is not given.

    Keys are those of scenes of some kinds.
    """
    if isinstance(item, (np.generic, np.ndarray)):
        return item.tolist()
    if callable(item):
        return item
    if is_dataclass(item):
        item = {one.name: getattr(item, one.name) for one in fields(item) if is_of(one, scene)}
    if not isinstance(item, Mapping):
        return item
    given = {key_of(name): value for name, value in item.items() if value is not None}
    return {key: as_tables(value, scene) for key, value in given.items()}


# ---- what a scene file holds, table by table


@dataclass(frozen=True)
class _LoadTables:
    live: Load = field(
        metadata={"hint": ", or ask `fenics-contact stands` whether the dead load alone stands"}
    )
    dead: Load = field(default_factory=Load)


@dataclass(frozen=True)
class PlaneTable:
    """The table [plane]."""

    state: str = only("mesh", "strain")
    thickness: float | None = None


@dataclass(frozen=True, kw_only=True)
class Tables(Shared):
    """The tables that files of all scenes have."""

    loads: _LoadTables
    dimension: int = 2
    materials: Mapping[str, Material] = field(default_factory=dict)
    plane: PlaneTable = field(default_factory=PlaneTable)

    def given(self) -> dict[str, Any]:
        """Arguments of a scene that every one takes."""
        return {
            "live": self.loads.live,
            "dead": self.loads.dead,
            "thickness": self.plane.thickness,
            **{name: getattr(self, name) for name in _names(self)},
        }


@dataclass(frozen=True)
class _MeshTable:
    file: str = ""
    degree: int = 1
    blocks: str = "connected"

    def __post_init__(self) -> None:
        require_choice("blocks", self.blocks, BLOCKS)
        require(bool(self.file), 'file is missing; give [mesh] file = "wall.msh", or [blocks]')


@dataclass(frozen=True, kw_only=True)
class _SceneTables(Tables):
    mesh: _MeshTable = field(default_factory=_MeshTable)
    supports: Mapping[str, str] = field(default_factory=dict)
    soil: Mapping[str, Soil] = field(default_factory=dict)
    stress: StressLaw | None = None

    def __post_init__(self) -> None:
        require(bool(self.materials), "materials is missing; give [materials.default]")
