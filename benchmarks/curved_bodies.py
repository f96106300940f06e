"""Two bodies with curved faces pressed together: Hertz, and Cattaneo and Mindlin.

Sources: H. Hertz, J. reine angew. Math. 92 (1882) 156; R.D. Mindlin, J. Appl. Mech. 16 (1949) 259;
K.L. Johnson, Contact Mechanics, Cambridge 1985, sections 4.2 and 7.2. Problem CGS-1: NAFEMS,
Benchmark Tests for Finite Element Modelling of Contact, Gapping and Sliding, R0081, 2001.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.known_answers import Array, Figure, Profile, mesh_of
from fenics_contact import BlockMesh, Equilibrium, JointLaw, Load, Material, Scene
from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.collapse.service_state import service_state
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.geometry.gmsh_mesh import gmsh_session


@dataclass(frozen=True)
class Sizes:
    """Sizes of elements around the middle of a contact, the origin.

    Attributes:
        least: Up to the distance `near`, m.
        near: m.
        largest: Far away, m.
        growth: Of the size with the distance in between.
    """

    least: float
    near: float
    largest: float
    growth: float = 0.25

    def face(self, end: float) -> Array:
        """Positions of the nodes of a face, from 0 to `end`, m."""
        x = [0.0]
        while x[-1] < end:
            size = self.least + self.growth * max(x[-1] - self.near, 0.0)
            x.append(x[-1] + min(size, self.largest))
        if end - x[-2] < 0.5 * (x[-1] - x[-2]):
            x.pop()
        return np.array([*x[:-1], end])

    def apply(self, gmsh: Any) -> None:
        """Make these the sizes of the model's mesh."""
        field = gmsh.model.mesh.field
        ball, over = field.add("Ball"), (self.largest - self.least) / self.growth
        values = {"VIn": self.least, "VOut": self.largest, "Radius": self.near, "Thickness": over}
        for name, value in values.items():
            field.setNumber(ball, name, value)
        field.setAsBackgroundMesh(ball)


@dataclass(frozen=True)
class Body:
    """A rectangle with a face at y = 0.

    Attributes:
        x: Nodes of the face, m, ascending.
        far: y of the far side.
        name: Of its group, and the start of those of its facets: "name face", "name far",
            "name left", "name right", and "name anchor", a piece in the middle of the far side.
    """

    x: Array
    far: float
    name: str

    def draw(self, model: Any, piece: float) -> None:
        """Draw the body, with an anchor of a given length."""
        geo, middle = model.geo, 0.5 * (self.x[0] + self.x[-1])
        along = [self.x[-1], middle + 0.5 * piece, middle - 0.5 * piece, self.x[0]]
        corners = [*((x, 0.0) for x in self.x), *((x, self.far) for x in along)]
        points = [geo.addPoint(x, y, 0.0) for x, y in corners]
        pairs = zip(points, [*points[1:], points[0]], strict=True)
        *face, right, far, anchor, rest, left = lines = [geo.addLine(*pair) for pair in pairs]
        for line in face:
            geo.mesh.setTransfiniteCurve(line, 2)
        surface = geo.addPlaneSurface([geo.addCurveLoop(lines)])
        geo.synchronize()
        model.setPhysicalName(2, model.addPhysicalGroup(2, [surface]), self.name)
        sides = {"face": face, "right": [right], "left": [left], "anchor": [anchor]}
        for side, tags in (sides | {"far": [far, anchor, rest]}).items():
            model.setPhysicalName(1, model.addPhysicalGroup(1, tags), f"{self.name} {side}")


def mesh_of_bodies(bodies: Sequence[Body], sizes: Sizes) -> BlockMesh:
    """Triangles that grow with the distance from the contact; faces have the bodies' nodes."""
    options = {"MeshSizeExtendFromBoundary": 0, "MeshSizeFromPoints": 0}
    with gmsh_session(**options, MeshSizeMax=sizes.largest) as gmsh:
        gmsh.model.add("bodies")
        for body in bodies:
            body.draw(gmsh.model, 0.5 * sizes.largest)
        sizes.apply(gmsh)
        gmsh.model.mesh.generate(2)
        return mesh_of(gmsh.model)


class WithGap(Discretization):
    """Bodies drawn with flat faces that have an initial gap g between them.

    Where the bodies move by u, the faces are apart by B_N u + g. Let w be displacements of the face
    of the upper body with B_N w = g. Then u + w has no gap, K (u + w) = f + K w + B_N^T r_N, and
    K w is one more dead load.
    """

    def __init__(self, scene: Scene, gap: Callable[[Array], Array]) -> None:
        super().__init__(scene)
        made = self.elasticity
        place = made.arm + made.centre[made.node_body]
        upper = (made.centre[made.node_body][:, 1] > 0.0) & (np.abs(place[:, 1]) < 1e-9)
        lifted = np.zeros_like(place)
        lifted[upper, 1] = gap(place[upper, 0])
        first = made.space.dofmap.index_map.local_range[0]
        load = self.problem.stiffness @ self.supports.to_supports(lifted.ravel(), first)
        self.problem = replace(self.problem, dead=self.problem.dead + load)


def pressed(scene: Scene, contact: HertzContact) -> Profile:
    """State of bodies with the gap of a contact, as values along it."""

    def gap(x: Array) -> Array:
        return 0.5 * contact.curvature * np.minimum(np.abs(x), FAR * contact.half_width) ** 2

    with WithGap(scene, gap) as made:
        bonded = made.bonded()
        case = LoadCase.of(made, bonded, 1.0, lambda step: None)
        found = service_state(case, 1.0)
    return Profile.of(
        Equilibrium(**vars(found), layout=made.layout, factorizations=made.factorizations())
    )


@dataclass(frozen=True)
class HertzContact:
    """Contact of two cylinders without friction, by Hertz; a plane has an infinite radius.

    Attributes:
        radius: Of the two bodies, m.
        young: Their moduli, Pa.
        poisson: Of both.
        force: That presses them together, N per metre.
    """

    radius: tuple[float, float]
    young: tuple[float, float]
    poisson: float
    force: float

    @property
    def curvature(self) -> float:
        """1 / R1 + 1 / R2, 1/m."""
        return sum(1.0 / radius for radius in self.radius)

    @property
    def modulus(self) -> float:
        """E* in plane strain, Pa."""
        return 1.0 / sum((1.0 - self.poisson**2) / young for young in self.young)

    @property
    def half_width(self) -> float:
        """Half width a of the contact, m."""
        return math.sqrt(4.0 * self.force / (math.pi * self.modulus * self.curvature))

    @property
    def peak(self) -> float:
        """Pressure in the middle, Pa."""
        return math.sqrt(self.force * self.modulus * self.curvature / math.pi)

    def pressure(self, x: Array) -> Array:
        """Pressure at a distance from the middle, Pa."""
        return self.peak * np.sqrt(np.maximum(1.0 - (x / self.half_width) ** 2, 0.0))


#: Cylinder of steel on a block of aluminium (NAFEMS CGS-1), and two equal cylinders.
CGS1 = HertzContact((0.05, math.inf), (210e9, 70e9), 0.3, 35e6)
EQUAL = HertzContact((0.05, 0.05), (200e9, 200e9), 0.3, 1e6)

#: Cattaneo and Mindlin: friction, and part of the limiting tangential force that acts.
FRICTION, TANGENTIAL = 0.3, 0.5

#: Gaps do not grow further from this distance on, in units of the half width. They stay open.
FAR = 5.0

#: Bodies above and below the contact.
SIDES = ((1.0, "upper"), (-1.0, "lower"))


def cattaneo_shear(x: Array) -> Array:
    """Shear of two equal cylinders with a tangential force after the normal one, Pa."""
    a, c = EQUAL.half_width, EQUAL.half_width * math.sqrt(1.0 - TANGENTIAL)
    inner = np.sqrt(np.maximum(1.0 - (x / c) ** 2, 0.0))
    return FRICTION * (EQUAL.pressure(x) - c / a * EQUAL.peak * inner)


def element(contact: HertzContact, elements: int) -> float:
    """Size of elements, a little less than asked for so that no node is at the contact's end, m."""
    return contact.half_width / (elements + 0.4)


def hertz(elements: int = 20, degree: int = 2) -> Profile:
    """Right half of a cylinder on a block, with a number of elements in its half of the contact."""
    a, side = CGS1.half_width, 2.0 * CGS1.radius[0]
    sizes = Sizes(element(CGS1, elements), 1.5 * a, 0.1 * side)
    x = sizes.face(side)
    bodies = [Body(x, sign * side, name) for sign, name in SIDES]
    upper, lower = (Material(young, CGS1.poisson) for young in CGS1.young)
    scene = Scene(
        mesh_of_bodies(bodies, sizes),
        {"upper": upper, "lower": lower},
        live=Load(traction={"upper far": (0.0, -0.5 * CGS1.force / side)}),
        joints={"default": JointLaw("frictionless")},
        supports={"upper left": "roller", "lower left": "roller", "lower far": "roller"},
        degree=degree,
    )
    return pressed(scene, CGS1)


def cattaneo(elements: int = 20, degree: int = 2) -> Profile:
    """Two equal cylinders, pressed together, then pushed along each other.

    Loads act on the far sides of both bodies, and shear on their other sides keeps their moment
    about the contact zero; a short piece of the lower far side holds the whole, without force.
    """
    half, normal = 0.5 * EQUAL.radius[0], EQUAL.force / EQUAL.radius[0]
    near = 1.3 * EQUAL.half_width
    sizes = Sizes(element(EQUAL, elements), near, half / 8.0)
    right = sizes.face(half)
    x = np.concatenate([-right[:0:-1], right])
    push = TANGENTIAL * FRICTION * normal
    pushed = {f"{name} far": (sign * push, 0.0) for sign, name in SIDES}
    for _, name in SIDES:
        pushed |= {f"{name} left": (0.0, -push), f"{name} right": (0.0, push)}
    scene = Scene(
        mesh_of_bodies([Body(x, sign * half, name) for sign, name in SIDES], sizes),
        {"default": Material(EQUAL.young[0], EQUAL.poisson)},
        dead=Load(traction={f"{name} far": (0.0, -sign * normal) for sign, name in SIDES}),
        live=Load(traction=pushed),
        joints={"default": JointLaw(friction=FRICTION)},
        supports={"lower anchor": "fixed"},
        degree=degree,
    )
    return pressed(scene, EQUAL)


def hertz_figures(profile: Profile, elements: int) -> list[Figure]:
    """Peak pressure and half width."""
    size, pressure = element(CGS1, elements), profile.values["pressure"]
    half = profile.half_width(profile.closed)
    missed = profile.l2_error("pressure", CGS1.pressure(profile.x))
    return [
        Figure("peak pressure, Pa", CGS1.peak, pressure.max(), 0.005),
        Figure("half width, m", CGS1.half_width, half, size, True),
        Figure("error of the pressure, L2", 0.0, missed, 0.02, True),
    ]


def cattaneo_figures(profile: Profile, elements: int) -> list[Figure]:
    """Peak pressure, half widths of contact and stick, and the shear."""
    a, size = EQUAL.half_width, element(EQUAL, elements)
    missed = profile.l2_error("shear", cattaneo_shear(profile.x))
    peak, inner = profile.values["pressure"].max(), a * math.sqrt(1.0 - TANGENTIAL)
    stick = profile.half_width(profile.sticks)
    return [
        Figure("peak pressure, Pa", EQUAL.peak, peak, 0.005),
        Figure("half width, m", a, profile.half_width(profile.closed), size, True),
        Figure("half width of stick, m", inner, stick, size, True),
        Figure("error of the shear, L2", 0.0, missed, 0.02, True),
    ]
