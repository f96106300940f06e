"""Other programs and methods on the scenes of benchmarks/run.py.

    python3 benchmarks/peers.py [--only PATTERN] [--elements 2,4] [--peers a,b] [--repeat 3]
        [--time-out 300] [--csv FILE]

A row per case, peer and run with the columns of run.py, in the same file if it is given. Errors are
against run.py's references, computed if the file has none yet. Seconds are the peer's own: from
joints and loads that are known, with the writing of its input. Each run has a process of its own;
runs that take more than half a minute are not repeated. What a peer cannot model is not asked of
it: "not applicable".

rigid-lp   Another problem: rigid blocks, associative friction (slip opens the joint), by one linear
           program of scipy's HiGHS. An upper bound; exact for given friction.
gilbert    Rigid blocks without dilation: M. Gilbert, C. Casapulla, H.M. Ahmed, Computers &
           Structures 84 (2006) 873. Linear programs in which every joint has a fictitious cohesion
           and a shallower friction angle, which give the shear strength of Coulomb's law at the
           normal force of the program before. Load factors of joint forces that are not unique:
           what it ends in depends on which of them the program returns. Where the load factor does
           not stand still, the row has the mean of the last ones, and half their range as residual.
siconos    Rigid blocks without dilation: from rest, the nonsmooth Gauss-Seidel method finds the
           contact forces and the blocks' motion at a given load factor; the largest one at which
           none moves, by bisection below the associative bound. Its tolerance is the bracket's
           width. An end above which the method gave up, not the blocks, is "not_converged".
calculix   Elastic blocks on the same mesh, plane elements, surface-to-surface contact by penalty
           springs, dead load, then live load in steps until Newton's method diverges: the last step
           that converged ("last converged"), the step size as tolerance. Nothing tells a collapse
           from a failure of Newton's method, which depends on the springs; every step that
           converged is an equilibrium, so the highest of three stiffnesses counts, at the time of
           all three. Stands for general finite element programs.

rigid-lp and gilbert need scipy alone. The others, on Debian 12 (calculix-ccx 2.20, python3-siconos
4.4.0), are "not installed" where they are missing:

    apt-get install --no-install-recommends calculix-ccx python3-siconos

Siconos brings OpenBLAS with threads, which becomes the BLAS of all programs unless another one is
chosen by `update-alternatives --config libblas.so.3-x86_64-linux-gnu` (liblapack.so.3 likewise):
times taken before and after do not compare.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy
from mpi4py import MPI
from scipy.optimize import linprog
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix, diags, hstack, identity, vstack

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.run import (
    HEAD,
    Case,
    References,
    Row,
    case_named,
    line,
    listed,
    medians,
    selected,
)
from benchmarks.stability import Process, relative_error
from fenics_contact import compat
from fenics_contact.analysis.rigid_blocks import Faces, RigidBlocks, straight_faces
from fenics_contact.discretization.joints import GROUND
from fenics_contact.discretization.discretization import Structure

Array = npt.NDArray[np.float64]

#: Runs that took more seconds are not repeated; seconds beyond the time-out for all the rest.
ONCE, GRACE = 30.0, 60.0

INSTALL = "on Debian: apt-get install --no-install-recommends calculix-ccx python3-siconos"

#: Gilbert's iteration: least fraction of the friction that is left to the slope (halved from 1 on),
#: change of the load factor at which it stands still, linear programs at most, those after which
#: normal forces are averaged with the ones before, and those whose mean is shown if it does not.
SLOPE, STILL, PROGRAMS, PLAIN, LAST = 1e-3, 1e-6, 100, 50, 20

#: Siconos: width of the bracket, unbalanced force at which a block moves (in weights of the
#: heaviest one), its solver's tolerance, its sweeps in a round, rounds.
BRACKET, MOVES, GAUSS_SEIDEL, SWEEPS, ROUNDS = 1e-3, 1e-4, 1e-10, 5000, 120

#: CalculiX: live load at the end in units of the associative bound; first, least and largest step
#: as a fraction of it; springs in units of modulus over facet; tangential over normal springs.
TOP, FIRST_STEP, LEAST_STEP, STEP = 1.05, 0.02, 1e-4, 0.02
SPRINGS, TANGENTIAL = (0.1, 0.3, 1.0), 0.1


@dataclass(frozen=True)
class Answer:
    """What a peer says.

    Attributes:
        status: "limit", "unbounded", "unstable", "not_converged", "last converged", "time-out",
            "not applicable", "not installed" or the name of an exception.
        load_factor: nan if there is none.
        tolerance: Relative.
        residual: Of the peer's own measure of convergence, where it has one.
    """

    status: str
    load_factor: float = math.nan
    tolerance: float = math.nan
    residual: float = math.nan


class Blocks:
    """Rigid blocks and the contacts between them: two points on every straight face.

    Equations of equilibrium are those of the motions that supports leave free, forces in units of
    the heaviest block's weight.
    """

    def __init__(self, structure: Structure) -> None:
        self.joints, bodies = structure.joints, structure.bodies
        self.faces: Faces = straight_faces(self.joints, self.joints.shear_strength)
        self.bodies = bodies
        self.used = np.any(bodies.free != 0.0, axis=1).ravel()
        self.force = float(np.abs(bodies.dead).max()) or 1.0
        self.dead = self._free(bodies.dead)
        self.live = self._free(bodies.live)
        self.strength = self.faces.strength / self.force
        self.upper = RigidBlocks(self.joints, bodies, MPI.COMM_SELF).limit()

    def _free(self, load: Array) -> Array:
        return np.einsum("bmk,bm->bk", self.bodies.free, load).ravel()[self.used] / self.force

    def forces(self, points: npt.NDArray[np.int64], direction: Array) -> csr_matrix:
        """Forces and moments on the blocks of unit forces at joint points, a column per point."""
        rows, columns, values = [], [], []
        for side, sign in ((0, -1.0), (1, 1.0)):
            kept = np.flatnonzero(self.joints.bodies[points, side] != GROUND)
            body = self.joints.bodies[points[kept], side]
            arm = self.joints.position[points[kept]] - self.bodies.centre[body]
            force = sign * direction[points[kept]]
            moment = (arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]) / self.bodies.size
            general = np.column_stack([force, moment])
            general = np.einsum("nmk,nm->nk", self.bodies.free[body], general)
            rows.append((3 * body[:, None] + np.arange(3)).ravel())
            columns.append(np.repeat(kept, 3))
            values.append(general.ravel())
        place = (np.concatenate(rows), np.concatenate(columns))
        shape = (len(self.used), len(points))
        return coo_matrix((np.concatenate(values), place), shape).tocsr()[self.used]


# Rigid blocks, linear programs


def rigid_lp(structure: Structure, deadline: float) -> Answer:
    """The associative program, as in the bracket of every result."""
    del deadline
    program = RigidBlocks(structure.joints, structure.bodies, MPI.COMM_SELF)
    factor = program.limit()
    if factor is None:
        return Answer("unstable")
    if math.isinf(factor):
        return Answer("unbounded", math.inf)
    return Answer("limit", factor, 1e-10)


class Gilbert:
    """Linear programs with |r_T| <= c + xi F r_N, c = (1 - xi) F r_N of the program before.

    Variables: load factor, normal forces at both ends and shear force of every face.
    """

    def __init__(self, structure: Structure) -> None:
        blocks = Blocks(structure)
        self.upper = blocks.upper
        self.friction, self.strength = blocks.faces.friction, blocks.strength
        self.count = len(self.friction)
        first, last = blocks.faces.ends.T
        joints = blocks.joints
        self.equilibrium = hstack(
            [
                csr_matrix(blocks.live[:, None]),
                blocks.forces(first, joints.normal),
                blocks.forces(last, joints.normal),
                blocks.forces(first, joints.tangent),
            ]
        ).tocsr()
        self.dead = blocks.dead

    def solve(self, deadline: float) -> Answer:
        """Iterate until the load factor stands still."""
        if self.upper is None or math.isinf(self.upper):
            return Answer("unstable" if self.upper is None else "unbounded")
        normal, slope, factors = np.zeros(self.count), 1.0, [math.inf]
        while len(factors) <= PROGRAMS:
            if time.perf_counter() > deadline:
                return Answer("time-out")
            found = self._program(slope, normal)
            if found is None:
                return Answer("not_converged")
            first, last, _ = found[1:].reshape(3, -1)
            weight = 1.0 if len(factors) <= PLAIN else 0.5
            normal = weight * (first + last) + (1.0 - weight) * normal
            factors.append(float(found[0]))
            change = relative_error(factors[-1], factors[-2], 0.0)
            if slope == SLOPE and change <= STILL:
                return Answer("limit", factors[-1], STILL, change)
            slope = max(0.5 * slope, SLOPE)
        return self.restless(factors[1:])

    def _program(self, slope: float, normal: Array) -> Array | None:
        """The variables at the largest load factor; None if the program is not solved."""
        cohesion = self.strength + (1.0 - slope) * self.friction * normal
        column, inclined = csr_matrix((self.count, 1)), -diags(slope * self.friction)
        shear = identity(self.count)
        rows = [hstack([column, inclined, inclined, sign * shear]) for sign in (1.0, -1.0)]
        cost = np.zeros(1 + 3 * self.count)
        cost[0] = -1.0
        free, compressed = (None, None), (0.0, None)
        answer = linprog(
            cost,
            vstack(rows).tocsr(),
            np.tile(cohesion, 2),
            self.equilibrium,
            -self.dead,
            [free] + [compressed] * (2 * self.count) + [free] * self.count,
            "highs-ds",
        )
        return answer.x if answer.status == 0 else None

    def restless(self, factors: Sequence[float]) -> Answer:
        """Mean and half range of the last load factors."""
        last = np.array(factors[-LAST:])
        mean = float(last.mean())
        half = 0.5 * float(np.ptp(last)) / max(abs(mean), 1e-300)
        return Answer("not_converged", mean, half, half)


def gilbert(structure: Structure, deadline: float) -> Answer:
    """Gilbert's iteration from the associative program."""
    return Gilbert(structure).solve(deadline)


# Rigid blocks, Siconos


class Siconos:
    """Contact forces r and accelerations at rest: v = W r + q, W = H^T M^-1 H, Coulomb's law.

    Only equilibrium is asked for, so that any masses will do: M is the diagonal of H H^T.
    """

    def __init__(self, structure: Structure) -> None:
        import siconos.numerics

        self.library = siconos.numerics
        self.blocks = blocks = Blocks(structure)
        points = blocks.faces.ends.ravel()
        self.count = len(points)
        self.friction = np.repeat(blocks.faces.friction, 2)
        order = np.arange(2 * self.count).reshape(2, -1).T.ravel()  # normal, shear, normal, ...
        normal = blocks.forces(points, blocks.joints.normal)
        shear = blocks.forces(points, blocks.joints.tangent)
        self.h = hstack([normal, shear]).tocsc()[:, order].tocsr()
        self.mass = np.asarray(self.h.multiply(self.h).sum(axis=1)).ravel()
        compliance = csc_matrix(self.h.T @ diags(1.0 / self.mass) @ self.h)
        compliance.indices = compliance.indices.astype(np.int64)
        compliance.indptr = compliance.indptr.astype(np.int64)
        # The block matrix belongs to the library's other objects: keep all of them.
        _, self.block_matrix = self.library.SBM_from_csparse(2, compliance)
        size = 2 * self.count
        self.matrix = self.library.NM_new_SBM(size, size, self.block_matrix)
        self.forces = np.zeros(size)

    def stands(self, factor: float, deadline: float) -> tuple[bool, bool, float]:
        """Whether no block moves, whether that is sure, the largest unbalanced force.

        Forces that nearly balance the load settle it; motion is sure once the solver converged.
        """
        library, blocks = self.library, self.blocks
        load = blocks.dead + factor * blocks.live
        free = self.h.T @ (load / self.mass)
        problem = library.FrictionContactProblem(2, self.matrix, free, self.friction)
        options = library.SolverOptions(library.SICONOS_FRICTION_2D_NSGS)
        options.iparam[library.SICONOS_IPARAM_MAX_ITER] = SWEEPS
        options.dparam[library.SICONOS_DPARAM_TOL] = GAUSS_SEIDEL
        forces, unbalanced = self.forces.copy(), math.inf
        for _ in range(ROUNDS):
            failed = library.fc2d_driver(problem, forces, np.zeros_like(forces), options)
            unbalanced = float(np.abs(load + self.h @ forces).max())
            if unbalanced < MOVES:
                self.forces = forces  # start from here next time
                return True, True, unbalanced
            if failed == 0 or time.perf_counter() > deadline:
                return False, failed == 0, unbalanced
        return False, False, unbalanced

    def solve(self, deadline: float) -> Answer:
        """Bisect between no live load and the associative bound."""
        upper = self.blocks.upper
        if upper is None or math.isinf(upper):
            return Answer("unstable" if upper is None else "unbounded", upper or math.nan)
        stands, sure, residual = self.stands(0.0, deadline)
        if not stands:
            return Answer("unstable" if sure else "not_converged", residual=residual)
        lower, moves = 0.0, True
        while upper - lower > BRACKET * upper:
            middle = 0.5 * (lower + upper)
            stands, sure, unbalanced = self.stands(middle, deadline)
            if time.perf_counter() > deadline:
                return Answer("time-out")
            if stands:
                lower, residual = middle, unbalanced
            else:
                upper, moves = middle, sure
        status = "limit" if moves else "not_converged"
        return Answer(status, lower, (upper - lower) / upper, residual)


def siconos(structure: Structure, deadline: float) -> Answer:
    """Bisection by Siconos' nonsmooth Gauss-Seidel method."""
    if any(law.law == "tresca" for law in structure.joints.laws):
        return Answer("not applicable")
    return Siconos(structure).solve(deadline)


def siconos_version() -> str:
    """Version of the library; empty where there is none."""
    try:
        import siconos.numerics  # noqa: F401
    except ImportError:
        return ""
    try:
        command = ["dpkg-query", "-W", "-f=${Version}", "python3-siconos"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


# Elastic blocks, CalculiX


class Deck:
    """CalculiX' input: the mesh, rigid ground under foundations, contact pairs, two steps."""

    def __init__(self, structure: Structure, top: float, spring: float) -> None:
        """Number everything.

        Args:
            structure: Blocks on foundations, without supports, with linear displacements.
            top: Live load factor at the end of the second step.
            spring: Contact springs in units of modulus over facet.
        """
        self.structure, self.top, self.spring = structure, top, spring
        joints = structure.joints
        space = structure.elasticity.space
        self.points = space.tabulate_dof_coordinates()[:, :2]
        self.cells = self._anticlockwise(np.asarray(compat.cell_dofs(space)))
        self.width = self.cells.shape[1]
        self.faces = straight_faces(joints, joints.shear_strength)
        ends = joints.position[joints.segments]
        self.facet = float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).mean())
        grounded = np.flatnonzero(joints.bodies[:, 0] == GROUND)
        self.ground = {int(p): len(self.points) + 2 * k for k, p in enumerate(grounded)}

    def _anticlockwise(self, cells: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        if cells.shape[1] == 4:
            cells = cells[:, [0, 1, 3, 2]]  # from the order of a tensor product
        here = self.points[cells]
        there = np.roll(here, -1, axis=1)
        area = np.sum(here[..., 0] * there[..., 1] - there[..., 0] * here[..., 1], axis=1)
        return np.where(area[:, None] > 0.0, cells, cells[:, ::-1])

    def text(self) -> str:
        """The input file."""
        problem = self.structure.problem
        dead, live = problem.dead.array_r, problem.live.array_r
        lines = [*self._mesh(), *self._contact(), *self._materials()]
        if self.ground:
            lines += ["*BOUNDARY", "GROUND,1,2"]
        lines += self._step("0.25,1.,1e-3,1.", dead)
        steps = f"{FIRST_STEP},1.,{LEAST_STEP},{STEP}"
        lines += self._step(steps, dead + self.top * live)
        return "\n".join(lines) + "\n"

    def _mesh(self) -> list[str]:
        joints, plane = self.structure.joints, self.structure.scene.plane
        kind = "CPE" if plane == "strain" else "CPS"
        lines = ["*NODE,NSET=BLOCKS", *map(_node, range(len(self.points)), self.points)]
        scene = self.structure.scene
        for group in range(len(scene.mesh.cell_sets)):
            mine = np.flatnonzero(scene.mesh.cell_groups == group)
            lines.append(f"*ELEMENT,TYPE={kind}{self.width},ELSET=CELLS{group}")
            lines += [_numbers(c, *self.cells[c]) for c in mine]
        if not self.ground:
            return lines
        lines.append("*NODE,NSET=GROUND")
        for point, number in self.ground.items():
            top = joints.position[point]
            lines += [_node(number, top)]
            lines += [_node(number + 1, top - self.facet * joints.normal[point])]
        lines.append(f"*ELEMENT,TYPE={kind}4,ELSET=BELOW")
        lines += [_numbers(number, *nodes) for number, nodes in self._below.values()]
        return lines

    @cached_property
    def _below(self) -> dict[int, tuple[int, list[int]]]:
        """Ground element, and its nodes, of every facet on a foundation."""
        joints, table = self.structure.joints, {}
        for facet, (a, b) in enumerate(joints.segments):
            if int(a) not in self.ground:
                continue
            along = joints.position[b] - joints.position[a]
            left = along[0] * joints.normal[a][1] - along[1] * joints.normal[a][0]
            if left > 0.0:  # the block is to the left, so ground is to the right
                a, b = b, a
            first, last = self.ground[int(a)], self.ground[int(b)]
            number = len(self.cells) + len(table)
            table[facet] = number, [first, last, last + 1, first + 1]
        return table

    def _contact(self) -> list[str]:
        """A pair of surfaces per straight face, with its friction."""
        joints = self.structure.joints
        side = {}
        for cell, nodes in enumerate(self.cells):
            for k in range(self.width):
                side[frozenset((nodes[k], nodes[(k + 1) % self.width]))] = cell, k
        surfaces: dict[int, tuple[list[str], list[str]]] = {}
        for facet, points in enumerate(joints.segments):
            pair = surfaces.setdefault(int(self.faces.of_point[points[0]]), ([], []))
            for which, nodes in enumerate(joints.nodes[points].T):
                if nodes[0] == GROUND:
                    element, k = self._below[facet][0], 0
                else:
                    element, k = side[frozenset(nodes.tolist())]
                pair[which].append(f"{element + 1},S{k + 1}")
        young = min(material.young for material in self.structure.scene.materials.values())
        spring = self.spring * young / self.facet
        lines = []
        for face, (first, second) in surfaces.items():
            friction = self.faces.friction[face]
            lines += [f"*SURFACE,NAME=FIRST{face},TYPE=ELEMENT", *first]
            lines += [f"*SURFACE,NAME=SECOND{face},TYPE=ELEMENT", *second]
            lines += [f"*SURFACE INTERACTION,NAME=DRY{face}"]
            lines += ["*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR", f"{spring:g}"]
            if friction > 0.0:
                lines += ["*FRICTION", f"{friction:.12g},{TANGENTIAL * spring:g}"]
            lines += [f"*CONTACT PAIR,INTERACTION=DRY{face},TYPE=SURFACE TO SURFACE"]
            lines += [f"SECOND{face},FIRST{face}"]
        return lines

    def _materials(self) -> list[str]:
        scene = self.structure.scene
        materials = [scene.material(groups) for groups in scene.mesh.cell_sets]
        names = [f"CELLS{group}" for group in range(len(materials))]
        if self.ground:
            materials, names = [*materials, materials[0]], [*names, "BELOW"]
        lines = []
        for name, material in zip(names, materials, strict=True):
            lines += [f"*MATERIAL,NAME=OF{name}", "*ELASTIC"]
            lines += [f"{material.young:.12g},{material.poisson:.12g}"]
            lines += [f"*SOLID SECTION,ELSET={name},MATERIAL=OF{name}", "1."]
        return lines

    def _step(self, increments: str, load: Array) -> list[str]:
        forces = load.reshape(-1, 2)
        loaded = np.argwhere(forces != 0.0)
        lines = ["*STEP,INC=100000", "*STATIC", increments, "*CLOAD"]
        lines += [f"{node + 1},{d + 1},{forces[node, d]:.12g}" for node, d in loaded]
        return [*lines, "*NODE FILE,FREQUENCY=1000000", "U", "*END STEP"]


def _node(number: int, point: Array) -> str:
    return f"{number + 1},{point[0]:.12g},{point[1]:.12g},0."


def _numbers(*numbers: int) -> str:
    return ",".join(str(number + 1) for number in numbers)


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


def calculix(structure: Structure, deadline: float) -> Answer:
    """Raise the live load in CalculiX until it diverges."""
    scene = structure.scene
    tresca = any(law.law == "tresca" for law in scene.joints.values())
    upper = RigidBlocks(structure.joints, structure.bodies, MPI.COMM_SELF).limit()
    if tresca or scene.supports or scene.degree > 1 or upper is None or math.isinf(upper):
        return Answer("not applicable")
    top, best = TOP * upper, math.nan
    for spring in SPRINGS:
        reached = run_calculix(Deck(structure, top, spring).text(), deadline)
        best = float(np.fmax(best, reached))
    if time.perf_counter() > deadline:
        return Answer("time-out")
    if math.isnan(best):
        return Answer("not_converged")
    return Answer("no limit found" if best >= 1.0 else "last converged", best * top, STEP * TOP)


def run_calculix(deck: str, deadline: float) -> float:
    """What `converged_time` finds in the end."""
    threads = {"OMP_NUM_THREADS": "1", "CCX_NPROC_EQUATION_SOLVER": "1"}
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "scene.inp").write_text(deck)
        with contextlib.suppress(subprocess.TimeoutExpired):
            subprocess.run(
                ["ccx", "-i", "scene"],
                cwd=folder,
                env={**os.environ, **threads},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=max(deadline - time.perf_counter(), 0.1),
                check=False,
            )
        status_file = Path(folder, "scene.sta")
        return converged_time(status_file.read_text() if status_file.exists() else "")


def calculix_version() -> str:
    """Version of the program; empty where there is none."""
    if shutil.which("ccx") is None:
        return ""
    answer = subprocess.run(["ccx", "-v"], capture_output=True, text=True, check=False)
    found = re.search(r"[Vv]ersion\s+(\S+)", answer.stdout)
    return found[1] if found else "unknown"


# All


@dataclass(frozen=True)
class Peer:
    """A program to compare with.

    Attributes:
        solve: Its answer for a structure, by a time on the clock of `time.perf_counter`.
        version: Its version; empty where it is not installed.
        residual: What the residual of its answers is.
        program: The program that does the work.
    """

    solve: Callable[[Structure, float], Answer]
    version: Callable[[], str]
    residual: str = ""
    program: str = "scipy"

    def ask(self, structure: Structure, deadline: float) -> Answer:
        """The answer, or that there is no one to ask."""
        return self.solve(structure, deadline) if self.version() else Answer("not installed")


def scipy_version() -> str:
    """Version of scipy, whose HiGHS solves the linear programs."""
    return scipy.__version__


PEERS: Mapping[str, Peer] = {
    "rigid-lp": Peer(rigid_lp, scipy_version),
    "gilbert": Peer(gilbert, scipy_version, "change of load factor"),
    "siconos": Peer(siconos, siconos_version, "unbalanced force", "Siconos"),
    "calculix": Peer(calculix, calculix_version, program="CalculiX"),
}

#: Statuses that are nobody's failure.
EXCUSED = ("not applicable", "not installed")


@dataclass(frozen=True)
class Task:
    """One run."""

    case: str
    elements: int
    peer: str
    time_out: float
    repeat: int = 1

    def row(self) -> Row:
        """Its row before it is run."""
        case = case_named(self.case, self.elements)
        return replace(case.row(), method=self.peer, repeat=self.repeat)


def measure(task: Task) -> Row:
    """Ask a peer and say what it took."""
    case, peer = case_named(task.case, task.elements), PEERS[task.peer]
    if peer.program != "CalculiX":  # load what it needs; CalculiX starts anew anyway
        peer.ask(Structure.build(case.small()), time.perf_counter() + task.time_out)
    structure = Structure.build(case.make())
    upper = RigidBlocks(structure.joints, structure.bodies, MPI.COMM_SELF).limit()
    start = time.perf_counter()
    answer = peer.ask(structure, start + task.time_out)
    seconds = time.perf_counter() - start
    kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return replace(
        task.row(),
        dofs=int(structure.problem.dead.getSize()),
        bodies=len(structure.bodies.centre),
        joint_points=len(structure.joints.length),
        tolerance=answer.tolerance,
        status=answer.status,
        seconds=math.nan if answer.status in EXCUSED else seconds,
        seconds_solve=math.nan if answer.status in EXCUSED else seconds,
        load_factor=answer.load_factor,
        upper_bound=math.nan if upper is None else upper,
        residual=answer.residual,
        residual_name=peer.residual,
        peak_memory=math.nan if peer.program == "CalculiX" else kilobytes / 1024.0,
        versions=f"{peer.program} {peer.version()}",
    )


def serve(task: Task) -> Row | str:
    """What `measure` finds, or the name of the exception."""
    try:
        return measure(task)
    except Exception as error:  # one row must not stop the table
        print(f"{task}: {error}", file=sys.stderr)
        return type(error).__name__


def run(task: Task) -> Row:
    """The row of a task, measured in a process of its own."""
    if not PEERS[task.peer].version():
        return replace(task.row(), status="not installed")
    process = Process(serve)
    row = process.run(task, 2.0 * task.time_out + GRACE)
    process.stop()
    return replace(task.row(), status=row) if isinstance(row, str) else row


def compared(row: Row, case: Case, references: References) -> Row:
    """A row with its errors; the finest mesh is none of a peer's, so it is not solved for one."""
    if (case.name, case.finest) not in references.known:
        case = replace(case, finest=0)
    return references.compare(row, case)


def shown(row: Row) -> str:
    """A line of the table; peers' results are what they are, verified or not."""
    return line(replace(row, verified=True))


def arguments() -> argparse.Namespace:
    """What was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="*", metavar="PATTERN", help="cases whose name holds it")
    parser.add_argument("--elements", default="2,4", metavar="N,M", help="these meshes alone")
    parser.add_argument("--peers", default=",".join(PEERS), metavar="A,B", help="these alone")
    parser.add_argument("--repeat", type=int, default=3, metavar="N", help="runs of each kind")
    parser.add_argument("--time-out", type=float, default=300.0, metavar="S", help="per run")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="rows are added there")
    choice = parser.parse_args()
    for peer in listed(choice.peers):
        if peer not in PEERS:
            parser.error(f"there is no peer '{peer}'; there are {', '.join(PEERS)}")
    return choice


def main() -> int:
    """Run what was asked for; exit code 1 if a peer that was asked has no load factor."""
    choice = arguments()
    references = References.of_file(choice.csv, choice.time_out)
    rows = []
    print(HEAD)
    for case in selected(choice.only, listed(choice.elements, int)):
        for peer in listed(choice.peers):
            for number in range(1, choice.repeat + 1):
                task = Task(case.name, case.elements, peer, choice.time_out, number)
                row = compared(run(task), case, references)
                references.record(row)
                rows.append(row)
                print(shown(row), flush=True)
                if not row.seconds <= ONCE:
                    break
    print(f"\nmedians\n{HEAD}")
    for row in medians(rows):
        print(shown(row))
    missing = sorted({row.method for row in rows if row.status == "not installed"})
    if missing:
        print(f"\nnot installed: {', '.join(missing)}; {INSTALL}")
    return 0 if all(row.counts or row.status in EXCUSED for row in rows) else 1


if __name__ == "__main__":
    raise SystemExit(main())
