"""Elastic blocks with contact by penalty, load steps until Newton's method diverges: CalculiX.

Stands for general finite element programs. Refined by the elements along half a brick (through the
thickness of an arch), four-node plane strain elements. Nothing tells a collapse from a failure of
Newton's method; every increment that converged is an equilibrium, so the last one is the answer.

Settings that suit it, found on walls with known load factors (stricter ones take 100 s on 33
blocks): node-to-surface contact, LINEAR pressure-overclosure with 1e7 kPa/m and sigma_inf 1e-3 kPa,
stick slope a tenth of that; NLGEOM; step 1 the weight, step 2 the live load up to twice the
associative limit load, in increments of at most 2 % that are cut where Newton's method fails.
Four elements along a brick and two across (resolution 2) are a good mesh. Units kN, m.
"""

from __future__ import annotations

import contextlib
import math
import os
import re
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.peers import rigid_lp
from benchmarks.peers.blocks import GROUND, Answer, Blocks

Array = npt.NDArray[np.float64]

RESOLUTIONS = (1, 2, 4)
YOUNG, POISSON, UNIT_WEIGHT = 1e6, 0.2, 10.0  # kPa, -, kN/m3
SPRING, STICK, RESIDUAL_PRESSURE = 1e7, 1e6, 1e-3  # kPa/m, kPa/m, kPa
INCREMENT, LEAST_INCREMENT, TOP = 0.02, 1e-4, 2.0  # of step 2; live load over associative limit


def version() -> str:
    """Version of the program; empty where there is none."""
    if shutil.which("ccx") is None:
        return ""
    answer = subprocess.run(["ccx", "-v"], capture_output=True, text=True, check=False)
    found = re.search(r"[Vv]ersion\s+(\S+)", answer.stdout)
    return f"CalculiX {found[1] if found else ''}".strip()


class Mesh:
    """Quadrilaterals on blocks with four corners, a size for the length of their sides."""

    def __init__(self, size: float) -> None:
        """Start without blocks."""
        self.size = size
        self.points = np.empty((0, 2))
        self.cells = np.empty((0, 4), dtype=np.int64)
        #: Of every block: cell and side of its outer facets, and their middles.
        self.facets: list[tuple[npt.NDArray[np.int64], Array]] = []

    def add(self, corners: Array) -> None:
        """Divide a block."""
        lengths = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        nx, ny = (max(1, round(max(lengths[k], lengths[k + 2]) / self.size)) for k in (0, 1))
        x, y = np.meshgrid(np.linspace(0.0, 1.0, nx + 1), np.linspace(0.0, 1.0, ny + 1))
        shape = np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y], axis=-1)
        grid = len(self.points) + np.arange(x.size).reshape(x.shape)
        cell = len(self.cells) + np.arange(nx * ny).reshape(ny, nx)
        quads = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=-1)
        self.points = np.concatenate([self.points, (shape @ corners).reshape(-1, 2)])
        self.cells = np.concatenate([self.cells, quads.reshape(-1, 4)])
        outer = list(enumerate((cell[0], cell[:, -1], cell[-1], cell[:, 0])))
        facets = np.array([(number, side) for side, cells in outer for number in cells])
        ends = self.cells[facets[:, :1], np.column_stack([facets[:, 1], (facets[:, 1] + 1) % 4])]
        self.facets.append((facets, self.points[ends].mean(axis=1)))

    def on(self, body: int, ends: Array) -> npt.NDArray[np.int64]:
        """Cell and side of a block's facets on a segment."""
        facets, middle = self.facets[body]
        way, from_start = ends[1] - ends[0], middle - ends[0]
        along, across = from_start @ way, from_start @ [way[1], -way[0]]
        square = way @ way
        return facets[(0.0 < along) & (along < square) & (np.abs(across) < 1e-6 * square)]


def deck(blocks: Blocks, elements: int, top: float) -> str:
    """CalculiX' input file; `top` is the load factor at the end of step 2.

    The ground is a held block under every face that stands on it.
    """
    mesh, contact = Mesh(blocks.unit / elements), []
    for outline in blocks.outlines:
        mesh.add(outline)
    cells, points = len(mesh.cells), len(mesh.points)
    pairs = zip(blocks.faces.bodies, blocks.faces.ends, strict=True)
    for face, ((first, second), ends) in enumerate(pairs):
        if first == GROUND:
            first = len(mesh.facets)
            (x0, y), (x1, _) = ends
            low = y - blocks.unit
            mesh.add(np.array([[x0, low], [x1, low], [x1, y], [x0, y]]))
        for name, body in (("S", second), ("M", first)):
            contact.append(f"*SURFACE,NAME={name}{face},TYPE=ELEMENT")
            contact += [f"{cell + 1},S{side + 1}" for cell, side in mesh.on(body, ends)]
        contact += ["*CONTACT PAIR,INTERACTION=DRY,TYPE=NODE TO SURFACE", f"S{face},M{face}"]
    lines = [
        "*NODE,NSET=ALL",
        *(f"{k + 1},{x:.12g},{y:.12g},0." for k, (x, y) in enumerate(mesh.points)),
        "*ELEMENT,TYPE=CPE4,ELSET=ALL",
        *(",".join(map(str, (k + 1, *(cell + 1)))) for k, cell in enumerate(mesh.cells)),
        *("*ELSET,ELSET=BLOCKS,GENERATE", f"1,{cells}"),
        *("*ELSET,ELSET=PUSHED,GENERATE", f"1,{cells}"),
        *("*NSET,NSET=GROUND,GENERATE", f"{points + 1},{len(mesh.points)}"),
        *("*MATERIAL,NAME=STONE", "*ELASTIC", f"{YOUNG},{POISSON}", "*DENSITY", "1."),
        *("*SOLID SECTION,ELSET=ALL,MATERIAL=STONE", "1.", "*BOUNDARY", "GROUND,1,2"),
        *("*SURFACE INTERACTION,NAME=DRY", "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR"),
        *(f"{SPRING},{RESIDUAL_PRESSURE}", "*FRICTION", f"{blocks.friction},{STICK}"),
        *contact,
        *("*STEP,NLGEOM,INC=1000", "*STATIC", "0.25,1.,1e-3,1.", "*DLOAD"),
        *(f"BLOCKS,GRAV,{UNIT_WEIGHT},0.,-1.,0.", "*END STEP"),
        *("*STEP,NLGEOM,INC=10000", "*STATIC", f"{INCREMENT},1.,{LEAST_INCREMENT},{INCREMENT}"),
        *("*DLOAD", f"PUSHED,GRAV,{top * UNIT_WEIGHT:.12g},1.,0.,0.", "*END STEP", ""),
    ]
    return "\n".join(lines)


def converged_time(status_file: str) -> float:
    """Time of the last increment of step 2 that converged; nan if step 1, the dead load, did not.

    Args:
        status_file: Text of CalculiX' .sta file; attempts that failed are marked by U.
    """
    rows = [line.split() for line in status_file.splitlines()[2:]]
    rows = [row for row in rows if len(row) == 7 and not row[2].endswith("U")]
    first = max((float(row[5]) for row in rows if row[0] == "1"), default=math.nan)
    if not first >= 1.0 - 1e-6:
        return math.nan
    return max((float(row[5]) for row in rows if row[0] == "2"), default=0.0)


def solve(blocks: Blocks, resolution: float = 2, deadline: float = math.inf) -> Answer:
    """Raise the live load until no increment converges."""
    bound = rigid_lp.solve(blocks)
    if bound.status != "limit":
        return bound
    top = TOP * bound.load_factor
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "scene.inp").write_text(deck(blocks, int(resolution), top))
        with contextlib.suppress(subprocess.TimeoutExpired):
            subprocess.run(
                ["ccx", "-i", "scene"],
                cwd=folder,
                env={**os.environ, "OMP_NUM_THREADS": "1", "CCX_NPROC_EQUATION_SOLVER": "1"},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=None if deadline == math.inf else max(deadline - time.perf_counter(), 0.1),
                check=False,
            )
        reached = converged_time("".join(p.read_text() for p in Path(folder).glob("*.sta")))
    late = "time-out" if time.perf_counter() > deadline else ""
    return Answer(late or ("last converged" if reached >= 0.0 else "not converged"), reached * top)
