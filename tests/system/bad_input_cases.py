"""A table of wrong input: scene files, meshes, arguments, with what the message must name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tests.system.program import LEFT_OUT

NAN, INF = float("nan"), float("inf")


@dataclass(frozen=True)
class Wrong:
    """A wrong scene.

    Attributes:
        names: What the message must contain.
        changes: Of the scene, by dotted key.
        mesh: Its mesh.
        files: Written over or besides scene and mesh; None takes a file away, {} makes a folder.
        arguments: More arguments.
    """

    names: tuple[str, ...]
    changes: Mapping[str, Any] = field(default_factory=dict)
    mesh: str = "block"
    files: Mapping[str, str | bytes | dict | None] = field(default_factory=dict)
    arguments: tuple[str, ...] = ()


def value(key: str, wrong: Any, *names: str) -> Wrong:
    """A wrong value, whose key the message must name."""
    return Wrong((key, *names), {key: wrong})


def no_group(table: str, wrong: Any) -> Wrong:
    """A group that the mesh lacks; the message names its table and the mesh."""
    return Wrong((f"{table}.nowhere", "block.msh"), {f"{table}.nowhere": wrong})


def law(key: str, *names: str, **table: Any) -> Wrong:
    """A wrong law of all joints, of which the message must name a key."""
    return Wrong((f"joints.default{key and '.'}{key}", *names), {"joints.default": table})


METHODS = ("auto", "monolithic", "splitting", "active-set")
STEEL = {"young": 1.0, "poisson": 0.2}
CUT_SHORT = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n"
ROUGH = {"friction": 0.5}

FILES = {
    "missing scene": Wrong(("scene.toml", "does not exist"), files={"scene.toml": None}),
    "scene not TOML": Wrong(("scene.toml", "TOML", "line 1"), files={"scene.toml": "[mesh\n"}),
    "scene not text": Wrong(("scene.toml", "TOML"), files={"scene.toml": "\x00\x01"}),
    "missing mesh": Wrong(("block.msh", "does not exist"), files={"block.msh": None}),
    "mesh cut short": Wrong(("block.msh", "gmsh"), files={"block.msh": CUT_SHORT}),
    "mesh not gmsh": Wrong(("block.msh", "gmsh"), files={"block.msh": "solid block\n"}),
    "no surface group": Wrong(("no_surface_group.msh", "two-dimensional"), mesh="no_surface_group"),
    "no mesh named": value("mesh.file", LEFT_OUT),
    **{f"{len(text)} bytes of dots": Wrong(("scene.toml", "20 tables"), files={"scene.toml": text})
       for text in (f"{'a.' * 3000}a = 1", f"[{'a . ' * 200_000}a]")},
}  # fmt: skip

KEYS = {
    "unknown table": value("material", {}, "materials"),
    "unknown material key": value("materials.default.yung", 1.0, "young"),
    "unknown load": value("loads.wind", {}),
    "no young": value("materials.default.young", LEFT_OUT),
    "no material": value("materials", LEFT_OUT),
    "no friction": law("", "friction"),
}

GROUPS = {
    "materials": no_group("materials", STEEL),
    "joints": no_group("joints", ROUGH),
    "foundations": no_group("foundations", ROUGH),
    "supports": no_group("supports", "fixed"),
    "dead traction": no_group("loads.dead.traction", [1.0, 0.0]),
    "live traction": no_group("loads.live.traction", [1.0, 0.0]),
    "movement": Wrong(
        ("loads.dead.movement.nowhere", "'base'"), {"loads.dead.movement.nowhere.rotation": 1.0}
    ),
    "live movement": Wrong(
        ("loads.live.movement", "loads.dead.movement"), {"loads.live.movement.base.rotation": 1.0}
    ),
    "cells without material": Wrong(("'high'",), {"materials": {"low": STEEL}}, "stack"),
    "group of two roles": Wrong(("'base'",), {"supports.base": "fixed"}),
}

VALUES = {
    **{f"young {x}": value("materials.default.young", x) for x in (0.0, -1.0e9, NAN, INF)},
    **{f"friction {x}": value("joints.default.friction", x) for x in (-0.1, NAN, INF)},
    "friction 1e30": value("joints.default.friction", 1e30, "at most 1e+12"),
    **{f"degree {x}": value("mesh.degree", x) for x in (0, 3)},
    **{f"method {x!r}": value("solve.method", x, f"'{x}'", *METHODS)
       for x in ("", "Splitting", "active_set", "monolithic ")},
    "path where joints crush": Wrong(
        ("solve.engine", "compressive_strength"),
        {"solve.engine": "path", "materials.default.compressive_strength": 1e6},
    ),
    "blocks": value("mesh.blocks", "all", "'all'", "connected, surfaces"),
    "plane": value("plane.state", "bent", "bent", "strain"),
    "no thickness": value("plane.thickness", 0.0, "plane.thickness = 0.0 must be a number above 0"),
    "thickness without number": value("plane.thickness", "thin"),
    "units": value("output.units", "inch", "one of SI (N, Pa, m), m (kN, MPa, m), mm"),
    "support": value("supports.left", "glued", "glued", "roller"),
    "young too long": value("materials.default.young", 10**400),
}  # fmt: skip

TYPES = {
    "string for number": value("materials.default.young", "stiff"),
    "number for table": value("materials.default", 1.0),
    "number for text": value("mesh.file", 3),
    "number for support": value("supports.left", 1),
    "number for flag": value("output.paraview", 1),
    "picture format": value("output.formats", ["jpg"]),
    "no picture format": value("output.formats", []),
}

FIXED_AND_PUSHED = {"foundations": {}, "supports.base": "fixed",
                    "loads.live": {"traction": {"side": [1000.0, 0.0]}}}  # fmt: skip
LOADS = {
    "no live load": value("loads.live", LEFT_OUT),
    "empty live load": Wrong(("loads.live", "zero"), {"loads.live": {}}),
    "live load zero": Wrong(("loads.live", "zero"), {"loads.live.body": [0.0, 0.0]}),
    "live load on no weight": Wrong(("loads.live", "zero"), {"materials.default.density": 0.0}),
    "live load on a fixed block": Wrong(("loads.live", "zero", "free"), FIXED_AND_PUSHED, "stack"),
    "dead body of three": value("loads.dead.body", [0.0, -9.81, 0.0]),
    "body not finite": value("loads.live.body", [NAN, 0.0]),
    "earth too high": value("loads.dead.earth.left", {"level": 1e308, "unit_weight": 1}, "level"),
    "floor without a name": value("floors.force", 8e3, "[floors.NAME]"),
    "floor without weight": Wrong(("floors.one.force is missing",), {"floors.one.at": "top"}),
    "floor on no group": value(
        "floors.one", {"force": 8e3, "at": "TOP"}, "one-dimensional group 'TOP'; it has", "x and y"
    ),
    "floor with an unknown key": value("floors.one", {"force": 1.0, "weight": 2.0}, "weight"),
    "traction not finite": value("loads.live.traction.left", [INF, 0.0]),
}

CONTACT = {
    "no facet opposite": Wrong(("'top'", "no facet opposite"), {"joints.top": ROUGH}),
    "on nothing": Wrong(("block.msh", "[supports]", "[foundations]"), {"foundations": {}}),
    "on rollers alone": Wrong(
        ("can move all together even with closed joints",),
        {"foundations": {}, "supports.base": "roller"},
        "stack",
    ),
    "block in the air": Wrong(("apart.msh", "(0.5, 1.25)"), mesh="apart"),
    "no joint law": Wrong(("[joints.default]", "0.5)"), {"joints": {}}, "stack"),
    "blocks almost touch": Wrong(("apart by", "0.003", ", 1)", "'bed'"), mesh="almost"),
    "blocks of a group almost touch": Wrong(
        ("apart by", "0.003", "'bed'"), {"joints.bed": ROUGH}, "almost"
    ),
    "foundation in a joint": Wrong(("'bed'",), {"foundations.bed": ROUGH}, "stack"),
}


def only_mesh(text: str | bytes, *names: str) -> Wrong:
    """A wrong mesh file, which the message must name."""
    return Wrong(("block.msh", *names), files={"block.msh": text})


Rows = Sequence[Sequence[object]]
#: A block of 1 m x 0.5 m of two triangles, and its base.
CORNERS: Rows = ((0, 0), (1, 0), (1, 0.5), (0, 0.5))
HALVES: Rows = ((1, 2, 3), (1, 3, 4))


def msh(points: Rows = CORNERS, cells: Rows = HALVES, name: str = "base") -> str:
    """A gmsh file of triangles or quadrilaterals, with the line from the first to the second node.

    Nodes are numbered from 1 on; coordinates are written as they are.
    """
    rows = [f"{k} {' '.join(map(str, (*p, 0)[:3]))}" for k, p in enumerate(points, 1)]
    elements = [(1, (1, 2), 1), *((len(c) - 1, c, 2) for c in cells)]
    lines = [
        f"{k} {kind} 2 {group} {group} {' '.join(map(str, nodes))}"
        for k, (kind, nodes, group) in enumerate(elements, 1)
    ]
    names = [f'1 1 "{name}"', '2 2 "blocks"']
    parts = {"PhysicalNames": names, "Nodes": rows, "Elements": lines}
    tables = [f"${n}\n{len(t)}\n{chr(10).join(t)}\n$End{n}\n" for n, t in parts.items()]
    return "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n" + "".join(tables)


def times(factor: float, points: Rows = CORNERS) -> Rows:
    """Corners of a larger or smaller block."""
    return [[factor * float(str(x)) for x in point] for point in points]


def at(x: float, y: float, wide: float = 1.0, high: float = 0.5) -> Rows:
    """The block on the ground, and another one somewhere."""
    second = [(x, y), (x + wide, y), (x + wide, y + high), (x, y + high)]
    return [*CORNERS, *second]


TWO_BLOCKS: Rows = (*HALVES, (5, 6, 7), (5, 7, 8))
FIRST = {x: ((x, 0), *CORNERS[1:]) for x in ("nan", "inf", "-inf", "1e308", "-1e308", "1e100")}
CELLS = {
    **{f"coordinate {x}": only_mesh(msh(points), "place" if "n" in x else "coordinate")
       for x, points in FIRST.items()},
    **{f"coordinates times {x:g}": only_mesh(msh(times(x)), "in m")
       for x in (1e100, 1e-100, 1e300, 1e-320, 1e12, 1e-12)},
    "coordinate no number": only_mesh(msh((("x", 0), *CORNERS[1:])), "gmsh"),
    "not planar": only_mesh(msh((*CORNERS[:3], (0, 0.5, 0.1))), "planar"),
    "cells twice": only_mesh(msh(cells=[*HALVES, HALVES[0]]), "twice", "(0.666667"),
    "cells twice, turned": only_mesh(msh(cells=[*HALVES, (3, 2, 1)]), "twice"),
    "all cells twice": only_mesh(msh(cells=[*HALVES, *HALVES]), "2 cells", "twice"),
    "two cells on one side of a facet": only_mesh(msh(cells=[(1, 2, 3), (1, 2, 4)]), "overlap"),
    "three cells on a facet": only_mesh(
        msh((*CORNERS, (0.2, 0.4)), [*HALVES, (1, 3, 5)]), "overlap"),
    "cell of a node": only_mesh(msh(cells=[*HALVES, (1, 1, 1)]), "no area"),
    "cell with a node twice": only_mesh(msh(cells=[*HALVES, (1, 2, 2)]), "no area"),
    "nodes in a line": only_mesh(msh((*CORNERS, (2, 0)), [*HALVES, (1, 2, 5)]), "no area"),
    "concave": only_mesh(
        msh(((0, 0), (1, 0), (0.2, 0.1), (0, 0.5)), [(1, 2, 3, 4)]), "convex", "(0.3"),
    "crossed sides": only_mesh(
        msh(((0, 0), (1, 0), (0, 0.5), (0.8, 0.6)), [(1, 2, 3, 4)]), "convex"),
    "triangle for a quadrilateral": only_mesh(
        msh(((0, 0), (1, 0), (1, 0.5), (1, 0.5)), [(1, 2, 3, 4)]), "convex"),
    "two kinds": only_mesh(msh((*CORNERS, (2, 0)), [(1, 2, 3, 4), (2, 5, 3)]), "Quadrilateral"),
    "node missing": only_mesh(msh(cells=[*HALVES, (1, 2, 77)]), "gmsh"),
    "blocks share a node": only_mesh(
        msh((*CORNERS, (2, 0.5), (2, 1)), [*HALVES, (3, 5, 6)]), "share single nodes"),
    **{f"blocks overlap {name}": only_mesh(msh(points, TWO_BLOCKS), "overlap")
       for name, points in {
           "in one place": at(0, 0), "by half": at(0, 0.25), "beside": at(0.5, 0),
           "by a corner": at(0.9, 0.45), "crosswise": at(0.4, -0.5, 0.2, 2.0), "inside":
           at(0.4, 0.1, 0.1, 0.1), "by 2 mm": at(0, 0.498)}.items()},
}  # fmt: skip

SOUND = msh()
#: The block as two surfaces that share the nodes of the diagonal.
TWO_SURFACES = SOUND.replace("3 2 2 2 2 1 3 4", "3 2 2 2 3 1 3 4")
#: Two blocks, one on the other; the side of the lower one in their joint is the group "bed0".
TWO_BEDS = msh(at(0, 0.5), TWO_BLOCKS)
TWO_BEDS = TWO_BEDS.replace("Names\n2", 'Names\n3\n1 3 "bed0"').replace(
    "Elements\n5", "Elements\n6\n6 1 2 3 3 3 4"
)
MESH_FILES = {
    "empty": only_mesh("", "gmsh"),
    "of zeros": only_mesh(bytes(1000), "gmsh"),
    "a folder": Wrong(("block.msh", "folder"), files={"block.msh": {}}),
    "header alone": only_mesh(SOUND[:40], "block.msh"),
    "a million nodes": only_mesh(SOUND.replace("$Nodes\n4", "$Nodes\n1000000"), "gmsh"),
    "too many nodes": only_mesh(SOUND.replace("$Nodes\n4", f"$Nodes\n{10**18}"), "gmsh"),
    "fewer than no nodes": only_mesh(SOUND.replace("$Nodes\n4", "$Nodes\n-4")),
    "no elements": only_mesh(SOUND[: SOUND.index("$Elements")], "block.msh"),
    "element of no kind": only_mesh(SOUND.replace("2 2 2 2 2 1 2 3", "2 999 2 2 2 1 2 3"), "gmsh"),
    "version 9": only_mesh(SOUND.replace("2.2 0 8", "9.9 0 8")),
    "said to be binary": only_mesh(SOUND.replace("2.2 0 8", "2.2 1 8")),
    "Latin-1 in a name": only_mesh(msh(name="b\xe4se").encode("latin-1"), "group 1", "UTF-8"),
    "long name": only_mesh(msh(name=100 * "x"), 100 * "x"),
    "name with a line's end": Wrong(("line\\nend",), {"mesh.file": "line\nend"}),
    "name with a NUL": Wrong(("nul\\x00l",), {"mesh.file": "nul\0l"}),
    "name too long": Wrong(("File name too long",), {"mesh.file": 5000 * "x"}),
    "in a file": Wrong(("does not exist",), {"mesh.file": "scene.toml/block.msh"}),
    "device": Wrong(("/dev/zero", "device"), {"mesh.file": "/dev/zero"}),
    "current folder": Wrong(("folder",), {"mesh.file": "."}),
}


def only_scene(text: str | bytes, *names: str) -> Wrong:
    """A wrong scene file, which the message must name."""
    return Wrong(("scene.toml", *names), files={"scene.toml": text})


SCENE_FILES = {
    "empty": Wrong(("loads is missing",), files={"scene.toml": ""}),
    "UTF-16": only_scene("title = 'wall'".encode("utf-16"), "UTF-8"),
    "Latin-1": only_scene("title = 'B\xf6gen'".encode("latin-1"), "UTF-8", "byte 10"),
    "not UTF-8 at the end": only_scene(b"title = '' # \xff", "UTF-8"),
    "two marks": only_scene("\ufeff\ufefftitle = ''", "TOML"),
    "a folder": only_scene({}, "folder"),
    "too long": only_scene(32 * 10**6 * " " + "a", "32000000"),
    "lists in lists": only_scene("a = " + 5000 * "[", "20"),
    "few lists in lists": only_scene(f"a = {30 * '['}{30 * ']'}", "20"),
    "tables in tables": only_scene("a" + 3000 * ".a" + " = 1", "20"),
    "key twice": only_scene("title = ''\ntitle = ''", "TOML"),
    "number too long for Python": only_scene(f"a = {5000 * '1'}", "TOML"),
    "long line": only_scene("x" * 10**5, "TOML"),
    "key with a line's end": Wrong(("'a\\nb'",), files={"scene.toml": '"a\\nb" = 1\n'}),
    "long key": Wrong(("unknown key", "..."), files={"scene.toml": 10**5 * "x" + " = 1"}),
    "long title": value("title", 10**5 * "x", "100000"),
    "long number": value("mesh.file", 10**4000, "a string", "..."),
    "long string for a number": value("materials.default.young", 10**4 * "x", "..."),
}

EXTREME = (1e308, -1e308, 1e-320, 1e31, 1e-31)
SIZES = {
    f"{key} {x:g}": value(key, x)
    for x in EXTREME
    for key in ("materials.default.young", "materials.default.density", "joints.default.friction",
                "foundations.base.friction")
} | {
    f"{key} {x:g}": value(key, [x, 0.0])
    for x in EXTREME
    for key in ("loads.live.body", "loads.dead.body", "loads.dead.traction.left")
}  # fmt: skip

SETS = {
    f"set {assignment[:30]!r}": Wrong(names, arguments=("--set", assignment))
    for assignment, names in {
        "friction": ("--set", "friction"),
        "=3": ("--set", "=3"),
        "": ("--set",),
        "title=one\ntwo": ("--set", "one\\ntwo"),
        "title=1\nmesh.file=2": ("--set", "line"),
        "mesh.file=nul\0": ("--set", "nul\\x00"),
        "mesh.file.x=1": ("--set", "mesh.file.x"),
        f"a{5000 * '.a'}=1": ("--set", "20"),
        f"a={5000 * '['}": ("unknown key 'a'",),
        f"a={30 * '['}{30 * ']'}": ("--set", "20"),
        "joints.default.mu=1": ("joints.default.mu",),
        "joints.default=[1]": ("joints.default", "table"),
        "joints=0.5": ("joints", "table"),
        "joints={friction=0.5}": ("[joints] has no name", "[joints.NAME] or [joints.default]"),
        "foundations={friction=0.5}": ("[foundations] has no name", "give [foundations.NAME]"),
        "materials.young=1e9": ("materials.young = 1000000000.0", "[materials.default]"),
        "output.units=kN": ("output.units = 'kN'", "m (kN, MPa, m)"),
        "materials.default={young=1e9}": ("materials.default.poisson is missing",),
        "materials.default.young=soft": ("materials.default.young",),
        "materials.default.young=1,5": ("materials.default.young",),
        "materials.default.young=1979-05-27": ("materials.default.young", "number"),
        "loads.live.body=[1e999,0]": ("loads.live.body",),
        f"mesh.file=0x{9999 * 'f'}": ("mesh.file", "a string"),
        "solve.control=force": ("solve.control", "'force'"),
    }.items()
}

OUTPUT = {
    "output is a file": Wrong(("occupied",), files={"occupied": ""}, arguments=("-o", "occupied")),
    "output in a file": Wrong(
        ("occupied",), files={"occupied": ""}, arguments=("-o", "occupied/of/ours")
    ),
    "output with a long name": Wrong(("too long",), arguments=("-o", 5000 * "x")),
    "output with a NUL": Wrong(("cannot write", "nul"), arguments=("-o", "nul\0")),
}

TRACTIONS = {
    f"{kind} traction on both sides of a joint": Wrong(
        (f"loads.{kind}.traction.bed", "both sides"),
        {f"loads.{kind}.traction": {"bed": [0.0, -1.0]}}, "stack",
    )
    for kind in ("dead", "live")
}  # fmt: skip

ALL = (
    FILES | KEYS | GROUPS | VALUES | TYPES | LOADS | CONTACT | CELLS
    | {f"mesh file: {name}": case for name, case in MESH_FILES.items()}
    | {f"scene file: {name}": case for name, case in SCENE_FILES.items()}
    | SIZES | SETS | OUTPUT | TRACTIONS
)  # fmt: skip
