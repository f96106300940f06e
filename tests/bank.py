"""The bank: scenes whose load factors are known, shared by tests and benchmarks.

    from tests.bank import BANK, known
    scene = BANK["W1 coulomb 0.65"].scene(elements=2, method="auto")

The load factor multiplies the weight of every block, acting to the right, unless an entry says
otherwise. Forces are per unit of thickness.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from mpi4py import MPI

from fenics_contact import BlockMesh, EdgeForce, JointLaw, Load, Material, Scene, SolveOptions
from fenics_contact.meshing import arch, buttress, default_size, polygons, running_bond, wall, wedge
from tests import structures
from tests.drawing import Drawing, rectangle, turned

GRAVITY = 9.81
STONE = Material(1e9, 0.2, 1.0e4 / GRAVITY)  # unit weight 10 kN/m3
WEIGHT = Load((0.0, -GRAVITY))
PUSH = Load((GRAVITY, 0.0))  # the weight, to the right

WALL_SOURCE = "M.C. Ferris, F. Tin-Loi, Int. J. Mech. Sci. 43 (2001) 209-224"
PROGRAM = "linear program of rigid blocks with associative friction, solved with HiGHS"
PROTOTYPE = "independent elastic fixed point: linear triangles, E = 1 GPa, nu = 0.2"
ARCH_SOURCE = "G. Cocchetti, E. Rizzi, Frattura ed Integrita Strutturale 51 (2020) 356-375"
STATICS = "closed form: all resultants are known from statics"

E, U = [0.5, 1, 1, 1, 1, 0.5], [1, 1, 1, 1, 1]
W3 = {"E": [1, 1, 1, 1], "U": [0.5, 1, 1, 1, 0.5], "e": [1, 0.5, -1, 0.5, 1]}
W3["u"] = [0.5, 1, -1, 1, 0.5]
W4 = {"E": E, "U": U, "u": [1, -1, 1, -1, 1], "e": [0.5, 0.5, -1, 0.5, 0.5, -1, 0.5, 0.5]}

#: Courses of the walls from the bottom, lengths in blocks of 0.4 m x 0.175 m, voids negative.
WALLS: dict[str, list[list[float]]] = {
    "W1": [E, U] * 3,
    "W2": [E, U] * 5,
    "W3": [W3[course] for course in "EUEueueuEUE"],
    "W4": [W4[course] for course in "EUEueueuEUE"],
}


def coulomb(friction: float) -> JointLaw:
    """Coulomb's law."""
    return JointLaw("coulomb", friction=friction)


def tresca(bound: float) -> JointLaw:
    """A given shear strength, Pa."""
    return JointLaw("tresca", bound=bound)


@dataclass(frozen=True)
class Variant:
    """Another way to write the same scene, which must not change its load factor.

    Attributes:
        young: Factor on the modulus of elasticity.
        length: Unit of length in m.
        force: Unit of force in N.
        seed: Renumber nodes and cells at random; None leaves the numbers.
        mirrored: Mirror the scene and its loads left to right.
        angle: Turn the scene and its loads, degrees.
        degree: Of the displacements.
        quadrilaterals: Quadrilateral cells in place of triangles.
        shaken: Move nodes, but no side of a block, at random; None leaves them.
        one_by_one: Mesh every block by itself, with sizes drawn from this seed; None leaves them.
        plane: "strain" or "stress".
        poisson: Poisson's ratio; None leaves it.
    """

    young: float = 1.0
    length: float = 1.0
    force: float = 1.0
    seed: int | None = None
    mirrored: bool = False
    angle: float = 0.0
    degree: int = 1
    quadrilaterals: bool = False
    shaken: int | None = None
    one_by_one: int | None = None
    plane: str = "strain"
    poisson: float | None = None

    @property
    def stress(self) -> float:
        """What a stress of 1 Pa is in the new units."""
        return self.length**2 / self.force

    def drawing(self, drawn: Drawing) -> Drawing:
        """Nodes and numbers."""
        drawn = drawn if self.shaken is None else drawn.shaken(self.shaken)
        drawn = drawn if self.one_by_one is None else drawn.one_by_one(self.one_by_one)
        points = turned(drawn.points, self.angle) / self.length
        if self.mirrored:
            points = points * [-1.0, 1.0]
        drawn = replace(drawn, points=points)
        return drawn if self.seed is None else drawn.renumbered(self.seed)

    def vector(self, components: tuple[float, float]) -> tuple[float, float]:
        """A direction turned and mirrored."""
        x, y = turned(components, self.angle).tolist()
        return (-x, y) if self.mirrored else (x, y)

    def load(self, load: Load) -> Load:
        """A load."""
        scaled = {n: (self.stress * x, self.stress * y) for n, (x, y) in load.traction.items()}
        traction = {name: self.vector(value) for name, value in scaled.items()}
        forces = {name: self.edge_force(one) for name, one in load.force.items()}
        return Load(self.vector(load.body), traction, force=forces)

    def edge_force(self, given: EdgeForce) -> EdgeForce:
        """A force at a place; turned ones need both coordinates."""
        x, y = self.vector((given.x / self.length, (given.y or 0.0) / self.length))
        unit = self.stress / self.length
        force = self.vector((unit * given.force[0], unit * given.force[1]))
        return EdgeForce(force, x, None if given.y is None else y, given.width / self.length)

    def law(self, law: JointLaw) -> JointLaw:
        """A joint law."""
        names = "bound", "compressive_strength", "cohesion"
        given = {name: getattr(law, name) for name in names if getattr(law, name) is not None}
        return replace(law, **{name: value * self.stress for name, value in given.items()})

    def material(self, material: Material) -> Material:
        """A material; accelerations keep their numbers, so that densities change like weights."""
        return Material(
            material.young * self.young * self.stress,
            material.poisson if self.poisson is None else self.poisson,
            material.density * self.length * self.stress,
            material.compressive_strength and material.compressive_strength * self.stress,
        )


PLAIN = Variant()

#: Options about more than the load factor.
BESIDE = {"accuracy", "error", "lowest", "peak", "states"}


@dataclass(frozen=True)
class Recipe:
    """How a scene is made.

    Attributes:
        draw: Makes a gmsh model from the number of elements and whether they are quadrilaterals.
        law: Of all joints, and of the rigid ground "base", where `parts` name no others.
        parts: Arguments of `Scene`.
        change: Of the drawing.
    """

    draw: Callable[[int, bool], Any]
    law: JointLaw = field(default_factory=lambda: JointLaw("frictionless"))
    parts: Mapping[str, Any] = field(default_factory=dict)
    change: Callable[[Drawing], Drawing] | None = None

    def scene(
        self,
        elements: int = 2,
        comm: MPI.Comm | None = None,
        variant: Variant = PLAIN,
        **solve: Any,
    ) -> Scene:
        """Make the scene.

        Args:
            elements: Elements along half a block, or through the thickness of an arch.
            comm: Communicator; all ranks when not given.
            variant: How it is written.
            solve: Arguments of `SolveOptions`. What is said of a collapse beside its load factor
                is left out if none of it is named.
        """
        solve.setdefault("fast", not BESIDE & set(solve))
        parts = {
            "materials": {"default": STONE},
            "live": PUSH,
            "dead": WEIGHT,
            "joints": {"default": self.law},
            "foundations": {"base": self.law},
        }
        parts |= self.parts
        changes: dict[str, Callable[[Any], Any]] = {
            "materials": variant.material,
            "joints": variant.law,
            "foundations": variant.law,
        }
        for name, change in changes.items():
            parts[name] = {group: change(item) for group, item in parts[name].items()}
        parts |= {name: variant.load(parts[name]) for name in ("dead", "live")}
        drawn = Drawing.of(self.draw(elements, variant.quadrilaterals))
        drawn = drawn if self.change is None else self.change(drawn)
        mesh = BlockMesh.from_model(variant.drawing(drawn).model(), comm or MPI.COMM_WORLD)
        return Scene(
            mesh, plane=variant.plane, degree=variant.degree, solve=SolveOptions(**solve), **parts
        )


@dataclass(frozen=True)
class Known:
    """A scene and what is known of its load factor.

    Attributes:
        name: What it is.
        recipe: How the scene is made.
        expected: Load factor; lower and upper end where only these are known; infinite where
            nothing limits the live load; nan where the dead load cannot stand.
        source: Where that comes from.
        tags: Kinds of scenes, for `known`: "wall" (W1 ... W4) or "bond" with "tresca", "coulomb" or
            "bracket" (only bounds are known); "closed-form", "wedge"; "arch", "least" (thickness);
            "hard" (on the arithmetic); "real" (as people draw); "slow" (over 5 s); "open" (not
            solved reliably: `not_converged` is an answer).
        tolerance: On the load factor, relative to `size`.
        size: Typical load factor; that expected where not given.
        elements: For which mesh this holds.
        solve: Arguments of `SolveOptions` it holds for.
    """

    name: str
    recipe: Recipe
    expected: float | tuple[float, float]
    source: str
    tags: frozenset[str] = frozenset()
    tolerance: float = 1e-6
    size: float | None = None
    elements: int = 2
    solve: Mapping[str, Any] = field(default_factory=dict)

    def scene(
        self,
        elements: int | None = None,
        comm: MPI.Comm | None = None,
        variant: Variant = PLAIN,
        **solve: Any,
    ) -> Scene:
        """Make the scene; see `Recipe.scene`."""
        solve = {**self.solve, **solve}
        return self.recipe.scene(elements or self.elements, comm, variant, **solve)

    @property
    def interval(self) -> tuple[float, float]:
        """Lower and upper end of the load factors that are right."""
        exact = self.expected
        return exact if isinstance(exact, tuple) else (exact, exact)

    @property
    def status(self) -> str:
        """What `limit_load` must answer."""
        upper = self.interval[1]
        return "unstable" if math.isnan(upper) else "unbounded" if math.isinf(upper) else "limit"

    def error(self, load_factor: float) -> float:
        """Distance of a load factor from those that are right, relative to their size."""
        lower, upper = self.interval
        if self.status != "limit":  # nan is not equal to nan
            return 0.0 if str(load_factor) == str(upper) else math.inf
        beyond = max(lower - load_factor, load_factor - upper, 0.0)
        return beyond / (self.size or abs(upper))

    def right(self, status: str, load_factor: float) -> bool:
        """Whether an answer is right."""
        return status == self.status and self.error(load_factor) <= self.tolerance


# Recipes


def wall_recipe(name: str, law: JointLaw) -> Recipe:
    """A wall "W1" ... "W4", or "10x10": bricks and courses of a running bond."""
    if name in WALLS:
        return Recipe(lambda n, quads: wall(WALLS[name], elements=n, quadrilaterals=quads), law)
    bricks, courses = map(int, name.split("x"))
    return Recipe(lambda n, quads: running_bond(bricks, courses, (0.4, 0.2), n, quads), law)


def outlined(
    outlines: Sequence[Any],
    law: JointLaw,
    size: float,
    names: Sequence[str] | None = None,
    groups: Mapping[str, Any] | None = None,
    **parts: Any,
) -> Recipe:
    """Blocks by their corners, with cells of a size for two elements; see `polygons`."""

    def draw(elements: int, quads: bool) -> Any:
        return polygons(outlines, 2.0 * size / elements, names, groups, quads)

    return Recipe(draw, law, parts)


def sides(**ends: tuple[float, float, float, float]) -> dict[str, Any]:
    """Groups of one side each, by x and y of both its ends."""
    return {name: [((x0, y0), (x1, y1))] for name, (x0, y0, x1, y1) in ends.items()}


def block_recipe(width: float, height: float, friction: float, **parts: Any) -> Recipe:
    """A block on the ground: min(F, width / height)."""
    size = 0.25 * min(width, height)
    return outlined([rectangle(0.0, 0.0, width, height)], coulomb(friction), size, **parts)


def stack_recipe(
    count: int, friction: float, block: tuple[float, float] = (0.5, 0.2), **parts: Any
) -> Recipe:
    """Blocks on top of each other: min(F, width / (count height))."""
    return Recipe(lambda n, quads: wall([[1.0]] * count, block, n, quads), coulomb(friction), parts)


TRILITH = [rectangle(0, 0, 0.3, 1), rectangle(1, 0, 1.3, 1), rectangle(0, 1, 1.3, 1.3)]


def arch_recipe(voussoirs: int, thickness: float, friction: float = 1.0) -> Recipe:
    """A semicircle of radius 1 on rigid ground."""
    return Recipe(
        lambda n, quads: arch(voussoirs, thickness, elements=n, quadrilaterals=quads),
        coulomb(friction),
        {"foundations": {"springings": coulomb(friction)}},
    )


def wedge_recipe(friction: float, half_angle: float = 30.0) -> Recipe:
    """A weightless wedge pressed down between two blocks, with the weight of one of them."""
    height, length = 0.5, 3.0
    half = height * math.tan(math.radians(half_angle))
    weight = 1000.0 * GRAVITY * (length * height - 0.5 * half * height)
    parts = {
        "materials": {"blocks": Material(1e9, 0.2, 1000.0), "wedge": Material(1e9, 0.2)},
        "live": Load(traction={"top": (0.0, -0.5 * weight / half)}),
    }
    return Recipe(
        lambda n, quads: wedge(half_angle, height, length, 0.5 / n, quads), coulomb(friction), parts
    )


def wedge_factor(friction: float, half_angle: float = 30.0) -> float:
    """P / W = 2 F / (cot(a + phi) - F), P the force on the wedge and W a block's weight."""
    slope = 1.0 / math.tan(math.radians(half_angle) + math.atan(friction))
    return 2.0 * friction / (slope - friction) if slope > friction else math.inf


def on_slope(degrees: float, live: tuple[float, float]) -> dict[str, Load]:
    """Weight and a live load on ground that rises to the right, along and across that ground."""
    x, y = turned((0.0, -GRAVITY), -degrees).tolist()
    return {"dead": Load((x, y)), "live": Load(live)}


def contrasted(recipe: Recipe, ratio: float) -> Recipe:
    """Every second block `ratio` times as stiff as the others."""
    materials = {"even": STONE, "odd": replace(STONE, young=ratio * STONE.young)}
    return replace(recipe, parts={**recipe.parts, "materials": materials}, change=odd_and_even)


def odd_and_even(drawing: Drawing) -> Drawing:
    """Every second block in a group of its own."""
    return drawing.odd_and_even()


def stretched(x: float, y: float, drawing: Drawing) -> Drawing:
    """Stretched along the axes."""
    return drawing.moved(lambda points: points * [x, y])


def drawn_recipe(draw: Callable[[], Any], law: JointLaw, **parts: Any) -> Recipe:
    """A `fenics_contact.drawing.Drawing`, with cells of the usual size for two elements."""

    def mesh(elements: int, quads: bool) -> Any:
        drawing = draw()
        return drawing.mesh(default_size(drawing.blocks) * 2.0 / elements, quads)

    return Recipe(mesh, law, parts)


#: Two ties through the facade: forces at their four ends, N/m.
TIES = {
    f"{side} {level:g}": EdgeForce((force, 0.0), x, level, 0.4)
    for level in (3.5, 5.8)
    for side, x, force in (("left", 0.0, 5.0e4), ("right", 8.0, -5.0e4))
}


#: Pushed to the left in place of to the right.
LEFTWARDS = Load((-GRAVITY, 0.0))
FACADE_STONE = Material(3e9, 0.2, 2000.0)


def real_recipes(friction: float, live: Load = PUSH) -> dict[str, Recipe]:
    """Structures as they are drawn."""
    law = coulomb(friction)
    sticky = replace(law, cohesion=2e4)
    pushed = {"live": live}
    stone = {"materials": {"default": FACADE_STONE}, **pushed}
    tied = {"dead": replace(WEIGHT, force=TIES), **stone}
    return {
        "facade": drawn_recipe(structures.facade, law, **stone),
        "facade with ties": drawn_recipe(structures.facade, law, **tied),
        "facade with cohesion": drawn_recipe(structures.facade, sticky, **stone),
        "arch wall": drawn_recipe(structures.arch_wall, law, **pushed),
        "gable": Recipe(
            lambda n, quads: wall(structures.gable(), (0.4, 0.2), n, quads), law, pushed
        ),
        "buttressed wall": Recipe(
            lambda n, quads: buttress(12, 0.6, 1.2, 0.4, 0.4 / n, quads), law, pushed
        ),
        "rubble": drawn_recipe(structures.rubble, law, **pushed),
    }


# What is known


def tags(names: str) -> frozenset[str]:
    """Tags from one string."""
    return frozenset(names.split())


def wall_entries() -> Iterator[Known]:
    """The walls W1 ... W4, and walls in running bond."""
    given = {  # by strength in kPa: W1 ... W4
        0.5: (0.04762, 0.02857, 0.02930, 0.02810),
        2.0: (0.19048, 0.11429, 0.11722, 0.11241),
        8.0: (0.76190, 0.45714, 0.44984, 0.40938),
    }
    digits = {"tolerance": 5.1e-6, "size": 1.0}
    for strength, factors in given.items():
        for name, factor in zip(WALLS, factors, strict=True):
            recipe = wall_recipe(name, tresca(1e3 * strength))
            source = f"{PROGRAM}, |T| <= bound x length, on the walls of {WALL_SOURCE}"
            label = f"{name} tresca {strength:g} kPa"
            yield Known(label, recipe, factor, source, tags("wall tresca"), **digits)
    associative = {  # by friction: W1 ... W4
        0.3: (0.30000, 0.30000, 0.30000, 0.26572),
        0.5: (0.50000, 0.50000, 0.37270, 0.29679),
        0.65: (0.64286, 0.58000, 0.40369, 0.33195),
        0.8: (0.70735, 0.64851, 0.45850, 0.36281),
        1.0: (1.00000, 1.00000, 0.50778, 0.40976),
        10.0: (1.90476, 1.14286, 0.68335, 0.45714),
    }
    about = tags("wall bracket")
    for friction, factors in associative.items():
        for name, factor in zip(WALLS, factors, strict=True):
            recipe, label = wall_recipe(name, coulomb(friction)), f"{name} bracket {friction:g}"
            source = f"upper end: {PROGRAM}, on the walls of {WALL_SOURCE}"
            hard = tags("slow open" * (friction == 10.0))
            yield Known(label, recipe, (0.0, factor), source, about | hard, **digits)
    rigid = (
        f"{PROTOTYPE}, on the walls of {WALL_SOURCE}: 0.63982 for rigid blocks of W1, 0.56262 of W2"
    )
    for elements, factors, tolerance in (
        (2, (0.63997, 0.56288, 0.35582, 0.26374), 2e-4),
        (4, (0.63997, 0.56288, 0.35582, 0.26691), 5e-3),  # other diagonals than the prototype's
    ):
        for name, factor in zip(WALLS, factors, strict=True):
            label, recipe = f"{name} coulomb 0.65", wall_recipe(name, coulomb(0.65))
            label, about = label + " fine" * (elements == 4), tags("wall coulomb")
            yield Known(label, recipe, factor, rigid, about, tolerance, elements=elements)
    for name, friction, elements, factor, tolerance, also in (
        ("4x5", 0.40, 2, 0.4, 1e-5, ""),
        ("4x5", 0.75, 2, 0.6, 1e-5, ""),
        ("4x6", 0.75, 2, 11.0 / 19.0, 1e-5, ""),
        ("10x10", 0.75, 2, 0.523474, 2e-4, ""),
        ("10x10", 0.75, 4, 0.523384, 5e-3, ""),
        ("20x20", 0.40, 2, 0.3817, 1e-2, "slow"),
        ("20x20", 0.75, 2, 0.472, 1e-2, "slow"),
    ):
        label = f"{name} coulomb {friction:g}" + " fine" * (elements == 4)
        recipe, about = wall_recipe(name, coulomb(friction)), tags(f"bond coulomb {also}")
        yield Known(label, recipe, factor, PROTOTYPE, about, tolerance, elements=elements)


def closed_form_entries() -> Iterator[Known]:
    """Blocks whose load factor is known from statics."""
    form = tags("closed-form")
    for friction in (0.0, 0.05, 0.2, 0.39, 0.41, 0.7, 5.0):
        recipe, size = block_recipe(0.4, 1.0, friction), 1e-3 if friction == 0.0 else None
        exact = min(friction, 0.4)
        yield Known(f"block {friction:g}", recipe, exact, STATICS, form, size=size)
    for count in (2, 5):
        for friction in (0.1, 0.7):
            recipe, exact = stack_recipe(count, friction), min(friction, 2.5 / count)
            yield Known(f"stack of {count} {friction:g}", recipe, exact, STATICS, form)
    for friction in (0.1, 0.7):
        recipe = outlined(TRILITH, coulomb(friction), 0.1)
        yield Known(f"trilith {friction:g}", recipe, min(friction, 0.3), STATICS, form)
    for slope in (16.0, 17.5):
        a, stands = math.radians(slope), 0.3 > math.tan(math.radians(slope))
        exact = 0.3 * math.cos(a) - math.sin(a) if stands else math.nan
        recipe = block_recipe(1.0, 0.2, 0.3, **on_slope(slope, (-GRAVITY, 0.0)))
        yield Known(f"tilting table {slope:g}", recipe, exact, STATICS, form)
    slope = math.degrees(math.atan(0.1))
    push = turned(PUSH.body, -slope).tolist()
    recipe, exact = block_recipe(1.0, 0.2, 0.3, **on_slope(slope, push)), 0.4 / (1.0 - 0.3 * 0.1)
    source = "NAFEMS, benchmark CGS-4: (tan a + F) / (1 - F tan a)"
    yield Known("block pushed up an incline", recipe, exact, source, form)
    for friction in (0.1, 0.2, 0.3, 0.8):
        recipe, exact = wedge_recipe(friction), wedge_factor(friction)
        about = form | tags("wedge" + " slow" * (friction == 0.8))
        yield Known(f"wedge {friction:g}", recipe, exact, STATICS, about, 1e-8)
    law = coulomb(0.5)
    recipe = Recipe(lambda n, quads: buttress(6, 1.0, 1.5, 0.5, 0.5 / n, quads), law)
    # Pushed to the left the wall tips alone, at width / height, and leaves the buttress.
    left = replace(recipe, parts={"live": Load((-GRAVITY, 0.0))})
    yield Known("buttress from behind", left, 1.0 / 3.0, STATICS, form)


def arch_entries() -> Iterator[Known]:
    """Semicircular arches of trapezoidal voussoirs."""
    source = f"{PROGRAM}; exact, as friction 1 lets hinges open only"
    for voussoirs, thickness, factor in (
        *((7, 0.15, 0.17072), (15, 0.15, 0.15047), (27, 0.15, 0.14534), (51, 0.15, 0.14502)),
        *((7, 0.20, 0.30182), (15, 0.20, 0.28636), (27, 0.20, 0.28434)),
    ):
        name, recipe = f"arch {voussoirs} {thickness:g}", arch_recipe(voussoirs, thickness)
        yield Known(name, recipe, factor, source, tags("arch"), 5.1e-6, 1.0)
    # By voussoirs at friction 1, and by friction with 27: from 0.3958 on it does not matter.
    rough = {7: 0.095703, 11: 0.104589, 17: 0.105462, 27: 0.106721, 51: 0.107357}
    smoother = {0.396: 0.106721, 0.36: 0.140890, 0.34: 0.161766, 0.32: 0.183845}
    for voussoirs, friction, least, also in (
        *((count, 1.0, least, "") for count, least in rough.items()),
        *((27, friction, least, "slow") for friction, least in smoother.items()),
    ):
        name = f"arch {voussoirs} {friction:g} least thickness"
        thin, thick = (arch_recipe(voussoirs, least * x, friction) for x in (0.99998, 1.00002))
        about = tags("arch least")
        yield Known(f"{name} less", thin, math.nan, ARCH_SOURCE, about, elements=1)
        about |= tags(also)
        # What is left of the thickness carries next to nothing.
        little = {"expected": (0.0, 2e-5), "tolerance": 0.0, "elements": 1}
        yield Known(f"{name} more", thick, source=ARCH_SOURCE, tags=about, **little)
    for friction, thickness in ((0.395, 0.106723), (0.3091, 0.25), (0.3091, 0.5), (0.3091, 1.5)):
        voussoirs = 27 if friction > 0.39 else 44  # one of these has a joint where that slides
        name = f"arch {voussoirs} {friction:g} {thickness:g}"
        recipe, about = arch_recipe(voussoirs, thickness, friction), tags("arch least")
        yield Known(name, recipe, math.nan, ARCH_SOURCE, about, elements=1)
    recipe, about = arch_recipe(44, 0.25, 0.3093), tags("arch least slow")
    yield Known("arch 44 0.3093 0.25", recipe, (0.0, 1e-3), ARCH_SOURCE, about, 0.0, elements=1)


def hard_entries() -> Iterator[Known]:
    """Scenes that are easy to state and hard on the arithmetic."""
    about = tags("hard")
    for ratio in (1e-6, 1e-3, 1e3, 1e6):
        for friction in (0.1, 0.7):
            recipe = contrasted(stack_recipe(5, friction), ratio)
            name = f"contrast {ratio:g} stack {friction}"
            yield Known(name, recipe, min(friction, 0.5), STATICS, about)
        recipe = contrasted(wall_recipe("W1", tresca(2e3)), ratio)
        yield Known(f"contrast {ratio:g} W1", recipe, 0.19048, PROGRAM, about, 5.1e-6, 1.0)
    for friction in (1e-6, 10.0):
        recipe = stack_recipe(5, friction)
        name = f"stack friction {friction:g}"
        yield Known(name, recipe, min(friction, 0.5), STATICS, about, size=1e-3)
    for width, height, friction in ((10.0, 0.1, 0.5), (10.0, 0.1, 200.0), (0.1, 10.0, 0.005)):
        recipe, exact = block_recipe(width, height, friction), min(friction, width / height)
        name = f"block {width:g} x {height:g} {friction:g}"
        also = tags("slow open" * (friction == 200.0))
        yield Known(name, recipe, exact, STATICS, about | also, elements=1)
    for kind, count, length, friction in (
        *(("cells", 1, 2000.0, friction) for friction in (0.5, 4000.0)),
        *(("slabs", 5, 1000.0, friction) for friction in (0.1, 300.0)),
    ):
        recipe, exact = stack_recipe(count, friction, (length, 1.0)), min(friction, length / count)
        yield Known(f"{kind} of 1000 to 1 {friction:g}", recipe, exact, STATICS, about, elements=1)
    for side in (1e-2, 1e-3, 1e-4):
        for friction in (0.5, 2.0):
            name, recipe = (
                f"feet of {side:g} {friction:g}",
                outlined(feet(side), coulomb(friction), 0.1),
            )
            tips = (0.5 + 0.5 * side**3) / (0.5 + side + 0.5 * side**3)
            yield Known(name, recipe, min(friction, tips), STATICS, about)
        stone = rectangle(0.5, 1.0, 0.5 + side, 1.0 + 2.0 * side)
        recipe = outlined([rectangle(0.0, 0.0, 1.0, 1.0), stone], coulomb(0.7), 0.1)
        name, open_ = f"stone of {side:g} on a block", tags("open" if side < 1e-3 else "")
        yield Known(name, recipe, 0.5, STATICS, about | open_)
    yield from verge_entries(about)
    recipe = stack_recipe(200, 0.7)
    yield Known("tower of 200", recipe, 0.0125, STATICS, about | {"slow"})
    one, other = rectangle(0.0, 0.0, 0.4, 1.0), rectangle(2.0, 0.0, 2.3, 1.0)
    for friction in (0.1, 0.7):
        recipe = outlined([one, other], coulomb(friction), 0.1, groups=sides(base=(0, 0, 2.3, 0)))
        yield Known(f"two structures {friction}", recipe, min(friction, 0.3), STATICS, about)
        groups = sides(base=(0, 0, 0.4, 0), held=(2, 0, 2.3, 0))
        held = {"groups": groups, "supports": {"held": "fixed"}}
        recipe = outlined([one, other], coulomb(friction), 0.1, **held)
        yield Known(f"held body apart {friction}", recipe, min(friction, 0.4), STATICS, about)


def feet(side: float) -> list[Any]:
    """A unit block on two square feet under its corners."""
    one, other = rectangle(0, 0, side, side), rectangle(1 - side, 0, 1, side)
    return [one, other, rectangle(0, side, 1, 1 + side)]


def verge_entries(about: frozenset[str]) -> Iterator[Known]:
    """Dead loads that barely stand or barely do not; wedges that nearly lock."""
    slope = 17.0
    a = math.radians(slope)
    for margin in (1e-3, -1e-3, 1e-6, -1e-6):
        stands = margin > 0.0
        friction, width = math.tan(a) * (1.0 + margin), 0.4 * math.tan(a) * (1.0 + margin)
        down = on_slope(slope, (-GRAVITY, 0.0))
        slides = stack_recipe(2, friction, **down)
        leans = stack_recipe(2, 0.7, (width, 0.2), **down)
        exact = math.cos(a) * friction - math.sin(a)
        shift = 0.5 * (1.0 - margin)
        slabs = [rectangle(0.0, 0.0, 1.0, 0.5), rectangle(shift, 0.5, 1.0 + shift, 1.0)]
        hangs = outlined(slabs, coulomb(1.0), 0.25, groups=sides(base=(0, 0, 1, 0)))
        for name, recipe, factor in (
            ("sliding stack", slides, exact),
            ("leaning stack", leans, exact),
            ("overhang", hangs, 2.0 * margin),  # arm 0.5 margin, height 0.25
        ):
            known_factor = factor if stands else math.nan
            yield Known(f"{name} {margin:+g}", recipe, known_factor, STATICS, about, size=1e-3)
    for friction in (0.5, 0.57, 0.577, 0.5778, 0.6):
        name, exact = f"wedge {friction:g} near locking", wedge_factor(friction)
        yield Known(name, wedge_recipe(friction), exact, STATICS, about)


def real_entries() -> Iterator[Known]:
    """Structures as they are drawn, with friction 0.6."""
    uppers = {  # pushed to the right, to the left
        "facade": (0.43729, 0.42464),
        "facade with ties": (0.48123, 0.47728),
        "facade with cohesion": (0.63570, 0.61080),
        "arch wall": (0.25900, 0.25900),
        "gable": (0.55117, 0.55117),
        "buttressed wall": (0.33590, 0.16303),
        "rubble": (0.20465, 0.23198),
    }
    source = f"upper end: {PROGRAM}"
    for way, live, number in (("right", PUSH, 0), ("left", LEFTWARDS, 1)):
        for name, recipe in real_recipes(0.6, live).items():
            about = tags("real" + " slow" * (name[:6] in ("facade", "rubble")))
            label, upper = f"{name} 0.6 to the {way}", uppers[name][number]
            in_time: dict[str, Any] = {}
            if name == "facade with cohesion":
                about, in_time = about | {"open"}, {"time": 120.0}
            yield Known(label, recipe, (0.0, upper), source, about, 5.1e-6, 1.0, solve=in_time)


BANK: dict[str, Known] = {
    entry.name: entry
    for entries in (
        wall_entries,
        closed_form_entries,
        arch_entries,
        hard_entries,
        real_entries,
    )
    for entry in entries()
}


def known(*with_tags: str, without: tuple[str, ...] = ()) -> list[Known]:
    """Entries that have all tags of the first kind and none of the second."""
    wanted, unwanted = set(with_tags), set(without)
    return [e for e in BANK.values() if wanted <= e.tags and not unwanted & e.tags]
