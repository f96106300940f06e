"""Public examples of other programs that can be drawn by hand, and what is known of them.

    python3 benchmarks/public_cases.py          # the rows of docs/verification.md: seconds

compas_cra, docs/examples/00_simple_cube.py, 04_stacks.py, tests/test_rbe.py; compas_dem, docs/
examples/dem_stack.py; compas_assembly, docs/examples/arch; Itasca's 3DEC, verification problems
Sliding_Wedge and Falling_Wedge. Known values are by hand, or by a linear program of the joints of
the arch (HiGHS). Shapes are drawn here from the numbers of the examples; no file of them is read.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import HalfspaceIntersection
from shapely.geometry import LineString, MultiPoint

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.known_answers import Array, Figure, mesh_of
from fenics_contact import JointLaw, Load, Material
from fenics_contact import Scene as PlanarScene
from fenics_contact import limit_load as planar_limit_load
from fenics_contact.meshing import polygons
from fenics_contact.spatial import Scene, limit_load, standing

CRA = "compas_cra"
DEM = "compas_dem, dem_stack"
ARCH = "compas_assembly"
ITASCA = "3DEC"
#: Coefficient of friction of compas_cra's examples.
CRA_FRICTION = 0.84
UP, ACROSS, ALONG = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)

Blocks = Mapping[str, Mapping[str, Any]]


def scene(blocks: Blocks, friction: float, live: Sequence[float] = ACROSS) -> Scene:
    """Blocks under their weight; the live load is the weight another way."""
    tables = {
        "dimension": 3,
        "blocks": blocks,
        "materials": {"default": {"density": 2000.0}},
        "joints": {"default": {"friction": friction}},
        "loads": {"dead": {"body": [0.0, 0.0, -9.81]}, "live": {"direction": list(live)}},
    }
    return Scene.from_tables(tables, Path("."))


def factor(blocks: Blocks, friction: float, live: Sequence[float] = ACROSS) -> float:
    """The load factor; nan where there is no limit."""
    found = limit_load(scene(blocks, friction, live)).ends["positive"]
    return found.load_factor if found.status == "limit" else math.nan


def stands(blocks: Blocks, friction: float) -> bool:
    """Whether there is an equilibrium under the weight."""
    return standing(scene(blocks, friction)).ends["positive"].status == "equilibrium"


def least(holds: Callable[[float], bool], low: float, high: float) -> float:
    """Where it begins to hold, to 1e-4 of the interval; nan if not within."""
    if holds(low) or not holds(high):
        return math.nan
    for _ in range(12):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if holds(middle) else (middle, high)
    return 0.5 * (low + high)


def cube(low: Sequence[float], fixed: bool = False) -> dict[str, Any]:
    """A unit cube."""
    corner = np.array(low, dtype=float)
    return {"box": [corner.tolist(), (corner + 1.0).tolist()], "fixed": fixed}


def body(points: Any, fixed: bool = False) -> dict[str, Any]:
    """The hull of points."""
    return {"vertices": np.asarray(points, dtype=float).tolist(), "fixed": fixed}


def prism(profile: Any, fixed: bool = False, y: tuple[float, float] = (0.0, 1.0)) -> dict[str, Any]:
    """A profile in x and z between two y."""
    return body([(a, b, c) for b in y for a, c in profile], fixed)


# ---- cubes


def cubes(count: int) -> Blocks:
    """Cubes on each other; the lowest is ground."""
    return {f"cube{k}": cube((0.0, 0.0, k), k == 0) for k in range(count)}


def shifted_cube(shift: float) -> Blocks:
    """A cube on a cube of ground, shifted."""
    return {"support": cube((0.0, 0.0, 0.0), True), "free": cube((shift, 0.0, 1.0))}


def tower_of_lire(scale: float) -> Blocks:
    """Four cubes of which the k-th from the top overhangs by scale / 2 k."""
    found = {"table": {"box": [[-4.0, 0.0, -1.0], [1.0, 1.0, 0.0]], "fixed": True}}
    ends = 1.0 + 0.5 * scale * np.cumsum([1.0 / (4 - k) for k in range(4)])
    return found | {f"cube{k}": cube((end - 1.0, 0.0, k)) for k, end in enumerate(ends)}


def turned_stack() -> list[Array]:
    """Corners of ten cubes, shifted by up to 0.1 and turned by 5 degrees either way."""
    random = np.random.default_rng(1)
    corners = np.array(list(product((0.0, 1.0), repeat=3)))
    found = []
    for level in range(10):
        shift = random.choice([-0.1, 0.1], 2) * random.random(2)
        turn = math.radians(random.choice([-5.0, 5.0]))
        c, s = math.cos(turn), math.sin(turn)
        found.append(
            corners @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + [*shift, level]
        )
    return found


def turned_stack_by_hand() -> float:
    """The least way of the weight above a contact to its outline, over the height."""
    stack = turned_stack()
    centroids = np.array([points.mean(axis=0) for points in stack])
    found = []
    for level in range(1, len(stack)):
        both = (MultiPoint(stack[k][:, :2]).convex_hull for k in (level - 1, level))
        middle = centroids[level:].mean(axis=0)
        ray = LineString([middle[:2], middle[:2] + np.array([5.0, 0.0])])
        below, above = both
        found.append(below.intersection(above).intersection(ray).length / (middle[2] - level))
    return min(found)


# ---- arch


def voussoirs(rise: float = 5.0, thickness: float = 0.7, count: int = 40) -> list[Array]:
    """Trapezoids of a semicircle, its centre at the origin, from the right."""
    turns = np.linspace(0.0, np.pi, count + 1)
    rays = np.column_stack([np.cos(turns), np.sin(turns)])
    return [
        np.array([rise * a, (rise + thickness) * a, (rise + thickness) * b, rise * b])
        for a, b in pairwise(rays)
    ]


def arch_by_program(friction: float) -> float:
    """Load factor of the voussoirs between the first and the last one: forces at joints' corners.

    Of associative slip, which is that of Coulomb's law where the collapse has hinges alone.
    """
    stones = voussoirs()[1:-1]
    count = len(stones)
    forces = 4 * (count + 1)  # of each joint: normal and shear at two corners
    equal = np.zeros((3 * count, forces + 1))
    right = np.zeros(3 * count)
    for k, stone in enumerate(stones):
        x, y = stone.T
        twice = x * np.roll(y, -1) - np.roll(x, -1) * y
        area = 0.5 * twice.sum()
        centroid = ((stone + np.roll(stone, -1, axis=0)) * twice[:, None]).sum(axis=0) / (
            6.0 * area
        )
        for joint, corners, sign in ((k, stone[:2], 1.0), (k + 1, stone[3:1:-1], -1.0)):
            along = (corners[1] - corners[0]) / np.linalg.norm(corners[1] - corners[0])
            normal = np.array([-along[1], along[0]])
            for n, corner in enumerate(corners):
                for part, way in enumerate((normal, along)):
                    arm = corner - centroid
                    moment = arm[0] * way[1] - arm[1] * way[0]
                    column = 4 * joint + 2 * n + part
                    equal[3 * k : 3 * k + 3, column] += sign * np.array([*way, moment])
        equal[3 * k, -1] = area
        right[3 * k + 1] = area
    most = np.zeros((2 * (count + 1), forces + 1))
    for joint in range(count + 1):
        pressed = slice(4 * joint, 4 * joint + 4, 2)
        sheared = slice(4 * joint + 1, 4 * joint + 4, 2)
        for row, sign in ((2 * joint, 1.0), (2 * joint + 1, -1.0)):
            most[row, pressed] = -friction
            most[row, sheared] = sign
    bounds = [*[(0, None), (None, None)] * (2 * (count + 1)), (None, None)]
    cost = np.zeros(forces + 1)
    cost[-1] = -1.0
    return float(-linprog(cost, most, np.zeros(len(most)), equal, right, bounds).fun)


def arch() -> Blocks:
    """The arch with a depth of 0.5 m; its first and last stones are ground."""
    stones = voussoirs()
    ends = (0, len(stones) - 1)
    return {f"v{k}": prism(stone, k in ends, (0.0, 0.5)) for k, stone in enumerate(stones)}


def planar_arch() -> float:
    """Load factor of the arch in the plane."""
    stones = voussoirs()[1:-1]
    sides = {"base": [stones[0][:2], stones[-1][2:]]}
    mesh = mesh_of(polygons(stones, 0.4, None, sides))
    return planar_factor(mesh, CRA_FRICTION)


def planar_factor(mesh: Any, friction: float) -> float:
    """Load factor of blocks in the plane that stand on `base`, pushed to the right."""
    law = JointLaw(friction=friction)
    found = planar_limit_load(
        PlanarScene(
            mesh,
            {"default": Material(5e9, 0.2, 2000.0)},
            dead=Load((0.0, -9.81)),
            live=Load((9.81, 0.0)),
            joints={"default": law},
            foundations={"base": law},
        )
    )
    return found.load_factor


# ---- wedges and grooves


def half_spaces(normals: Array, levels: Array, inside: Array) -> Array:
    """Corners of a body n . x <= level."""
    found = HalfspaceIntersection(np.column_stack([normals, -levels]), inside).intersections
    return np.unique(np.round(found, 9), axis=0)


def upwards(dip: float, direction: float) -> Array:
    """Upward normal of a plane by dip and dip direction, degrees; x east, y north."""
    dip, direction = math.radians(dip), math.radians(direction)
    level = math.sin(dip)
    return np.array([level * math.sin(direction), level * math.cos(direction), math.cos(dip)])


#: Planes of the sliding wedge, and the line in which they meet, downwards.
PLANES = np.array([upwards(40.0, 130.0), upwards(60.0, 220.0)])
LINE = np.cross(*PLANES) * -np.sign(np.cross(*PLANES)[2])
LINE = LINE / np.linalg.norm(LINE)


def sliding_wedge() -> Blocks:
    """A wedge on two planes, which are sides of fixed blocks."""
    front = np.array([*LINE[:2], 0.0]) / np.linalg.norm(LINE[:2])
    normals = np.vstack([-PLANES, UP, front])
    inside = 0.2 * PLANES.sum(axis=0) - 0.2 * LINE
    corners = half_spaces(normals, np.array([0.0, 0.0, 1.0, 0.4]), inside)
    found = {"wedge": body(corners)}
    for name, normal in zip("AB", PLANES, strict=True):
        side = corners[np.abs(corners @ normal) < 1e-6]
        larger = side.mean(axis=0) + 1.2 * (side - side.mean(axis=0))
        found[name] = body(np.vstack([larger, larger - 0.3 * normal]), True)
    return found


def wedge_reactions() -> float:
    """Sum of the reactions of both planes, over the weight, as the wedge slides along the line."""
    return float(np.linalg.solve(np.column_stack([*PLANES, LINE]), UP)[:2].sum())


def falling_wedge() -> Blocks:
    """A wedge 1 m high in a roof, between three planes that dip 60 degrees."""
    planes = np.array([upwards(60.0, direction) for direction in (30.0, 150.0, 270.0)])
    apex = np.array(UP)
    levels = planes @ apex
    corners = half_spaces(np.vstack([planes, [0.0, 0.0, -1.0]]), np.append(levels, 0.0), 0.3 * apex)
    found = {"wedge": body(corners)}
    for k, (normal, level) in enumerate(zip(planes, levels, strict=True)):
        side = corners[np.abs(corners @ normal - level) < 1e-6]
        larger = side.mean(axis=0) + 1.2 * (side - side.mean(axis=0))
        found[f"rock{k}"] = body(np.vstack([larger, larger + 0.3 * normal]), True)
    return found


def groove() -> Blocks:
    """A cube, its edge along y down, in a groove of 90 degrees."""
    square = [(0.0, 0.0), (1.0, 1.0), (0.0, 2.0), (-1.0, 1.0)]
    sides = {"right": [(0.0, 0.0), (1.5, 1.5), (1.5, -0.5), (0.0, -0.5)]}
    sides["left"] = [(-x, z) for x, z in sides["right"]]
    found = {name: prism(side, True, (-0.5, 2.0)) for name, side in sides.items()}
    return found | {"cube": prism(square, y=(0.0, math.sqrt(2.0)))}


def planar_groove() -> float:
    """Load factor of the square across the groove, in the plane."""
    square = np.array([(0.0, 0.0), (1.0, 1.0), (0.0, 2.0), (-1.0, 1.0)])
    sides = {"base": [square[:2], square[[3, 0]]]}
    return planar_factor(mesh_of(polygons([square], 0.25, None, sides)), 0.3)


# ---- edges and corners


def ladder_profile(lean: float = 60.0, length: float = 2.0, thickness: float = 0.1) -> Array:
    """A plank that touches z = 0 with an edge and x = 0 with another."""
    turn = math.radians(lean)
    matrix = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    rim = np.array([(0.0, 0.0), (length, 0.0), (length, thickness), (0.0, thickness)]) @ matrix.T
    return rim - [rim[:, 0].max(), rim[:, 1].min()]


def ladder() -> Blocks:
    """A plank that leans on a wall at 60 degrees."""
    found = {
        "floor": {"box": [[-3.0, -1.0, -0.3], [0.0, 2.0, 0.0]], "fixed": True},
        "wall": {"box": [[0.0, -1.0, -0.3], [0.3, 2.0, 3.0]], "fixed": True},
    }
    return found | {"plank": prism(ladder_profile())}


def ladder_by_hand() -> float:
    """Least friction: both ends slide, N_wall = F N_floor, and moments about the foot vanish."""
    rim = ladder_profile()
    foot, head = rim[rim[:, 1].argmin()], rim[rim[:, 0].argmax()]
    arm = rim.mean(axis=0)[0] - foot[0]
    reach, height = head - foot

    rest = reach - arm  # rest F^2 + height F = arm
    return float((math.sqrt(height**2 + 4.0 * arm * rest) - height) / (2.0 * rest))


def knife_edges() -> Blocks:
    """A beam across two ridges."""
    beam = {"box": [[-1.0, 0.0, 0.5], [1.0, 0.4, 0.8]]}
    found: dict[str, Any] = {"beam": beam}
    for name, x in (("left", -0.7), ("right", 0.6)):
        found[name] = prism([(x - 0.2, 0.0), (x + 0.2, 0.0), (x, 0.5)], True, (-0.5, 1.0))
    return found


def three_points() -> Blocks:
    """A cube on the tips of three pyramids."""
    found = {"cube": cube((-0.5, -0.5, 0.3))}
    for k, (x, y) in enumerate([(0.3, -0.3), (0.3, 0.3), (-0.4, 0.0)]):
        base = [(x + a, y + b, 0.0) for a, b in product((-0.1, 0.1), repeat=2)]
        found[f"tip{k}"] = body([*base, (x, y, 0.3)], True)
    return found


def figures() -> dict[str, Callable[[], Figure]]:
    """Rows by names: what is known, what is found, and the source in the name."""
    tangent = math.tan(math.radians(40.0))
    return {
        "cube on a cube": lambda: Figure(
            f"cube on a cube, friction {CRA_FRICTION} ({CRA} 00)",
            CRA_FRICTION,
            factor(cubes(2), CRA_FRICTION),
            1e-6,
        ),
        "shifted cube": lambda: Figure(
            "shift at which it falls (tests/test_rbe.py: 0.75)",
            0.5,
            least(lambda shift: not stands(shifted_cube(shift), CRA_FRICTION), 0.4, 0.55),
            1e-4,
        ),
        "stack of cubes": lambda: Figure(
            f"two cubes on it ({CRA} 04)", 0.5, factor(cubes(3), CRA_FRICTION), 1e-6
        ),
        "turned stack": lambda: Figure(
            f"ten cubes, shifted, turned ({DEM})",
            turned_stack_by_hand(),
            factor({f"c{k}": body(c, k == 0) for k, c in enumerate(turned_stack())}, CRA_FRICTION),
            1e-5,
        ),
        "arch": lambda: Figure(
            f"semicircle of 40, 5 m, thickness 0.7 m ({ARCH})",
            arch_by_program(CRA_FRICTION),
            factor(arch(), CRA_FRICTION),
            1e-3,
        ),
        "arch in the plane": lambda: Figure(
            "the same in the plane", arch_by_program(CRA_FRICTION), planar_arch(), 1e-3
        ),
        "tower": lambda: Figure(
            "overhang of four cubes (P.B. Johnson, Am. J. Phys. 23 (1955) 240)",
            25.0 / 24.0,
            25.0 / 24.0 * least(lambda part: not stands(tower_of_lire(part), 0.6), 0.9, 1.05),
            1e-4,
        ),
        "sliding wedge, pushed": lambda: Figure(
            f"sliding wedge, 40 degrees, pushed down ({ITASCA}; Hoek and Bray)",
            tangent * wedge_reactions() + LINE[2],
            factor(sliding_wedge(), tangent, LINE.tolist()),
            2e-3,
        ),
        "groove across": lambda: Figure(
            "cube across a groove of 90 degrees, friction 0.3: tan(45 + phi)",
            1.3 / 0.7,
            factor(groove(), 0.3),
            1e-6,
        ),
        "groove along": lambda: Figure(
            "along it: F / sin(45)",
            0.3 * math.sqrt(2.0),
            factor(groove(), 0.3, ALONG),
            1e-4,
        ),
        "groove in the plane": lambda: Figure(
            "across, in the plane", 1.3 / 0.7, planar_groove(), 1e-6
        ),
        "ladder": lambda: Figure(
            "plank leaning at 60 degrees: least friction",
            ladder_by_hand(),
            least(lambda friction: stands(ladder(), friction), 0.2, 0.4),
            1e-4,
        ),
        "knife edges": lambda: Figure(
            "beam on knife edges, friction 0.4",
            0.4,
            factor(knife_edges(), 0.4),
            1e-6,
        ),
        "three points": lambda: Figure(
            "cube on three tips: way / height",
            0.3 / 0.5,
            factor(three_points(), 0.9),
            1e-6,
        ),
    }


def rows() -> Iterator[str]:
    """Rows of the page: problem, known, found."""
    for make in figures().values():
        figure = make()
        missed = "" if figure.passed else " **missed**"
        yield f"| {figure.name} | {figure.known:.6g} | {figure.found:.6g}{missed} |"


if __name__ == "__main__":
    print(*rows(), sep="\n")
