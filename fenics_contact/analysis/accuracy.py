"""An accuracy that is wished: what is done until the error estimate is below it.

First, on the mesh as given, hinges get the compliance of point hinges (`hinges`). Where the other
part of the error is still too large, the displacements get degree 2, and then cells are refined.
What matters there are the elastic strains of the blocks: with K changed by dK, the load factor of a
state u changes by - z^T dK u, with z = A^-T f_L scaled to f_L.z = 1 (`adjoint_mode`). Both fields
are known to an error that recovered stresses tell. The product of both errors is the indicator of
a cell (R. Becker, R. Rannacher, Acta Numerica 10 (2001) 1).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from mpi4py import MPI

from fenics_contact.analysis.collapse_mode import adjoint_mode
from fenics_contact.analysis.load_case import LoadCase
from fenics_contact.analysis.mesh_error import MeshError, Pass
from fenics_contact.analysis.result import Collapse
from fenics_contact.discretization.stresses import recovery_energy
from fenics_contact.errors import SolverError
from fenics_contact.mesh import Array, Flags
from fenics_contact.refinement import refine
from fenics_contact.scene import Scene

_log = logging.getLogger("fenics_contact")


@dataclass(frozen=True)
class AccuracyOptions:
    """Numbers of the passes.

    Attributes:
        part: Cells to refine have this part of the sum of all indicators.
        meshes: So many are tried at most, that given and that with degree 2 among them.
        displacements: No mesh with more is tried.
        bisections: To find the cells.
    """

    part: float = 0.7
    meshes: int = 8
    displacements: int = 200_000
    bisections: int = 40


OPTIONS = AccuracyOptions()


def with_passes(
    end: Collapse, earlier: tuple[Pass, ...], scene: Scene, displacements: int, seconds: float
) -> Collapse:
    """The collapse to report of a mesh, and a row for each that was found on it.

    Args:
        end: Collapse on the mesh as it is, with its error estimate.
        earlier: Rows of the meshes before.
        scene: Its scene.
        displacements: Number of displacements.
        seconds: Wall time on this mesh.
    """
    error = end.mesh_error
    if error is None or end.status != "limit":
        return replace(end, passes=earlier)
    size = abs(end.load_factor) if end.certificate is None else end.certificate.size
    best, rest = end, error
    if end.other_hinges is not None:
        best = replace(end.other_hinges, other_hinges=None)
        rest = _remaining(error, best, size)
    algebraic = _algebraic_error(error, best.load_factor, earlier, scene.degree, size)
    error, rest = (replace(one, algebraic_error=algebraic) for one in (error, rest))

    def row(hinges: str, collapse: Collapse, error: MeshError) -> Pass:
        parts = error.hinge_error, error.algebraic_error, seconds
        return Pass(displacements, scene.degree, hinges, collapse.load_factor, *parts)

    rows = [row("mesh", end, error)]
    # Where finer meshes have another state, the errors are those of one that they do not have.
    if best is not end and (error.state_changes or not _below(rows[0], scene)):
        by_strength = math.isfinite(error.load_factor_hinges)
        rows.append(row("strength" if by_strength else "points", best, rest))
        end = replace(best, mesh_error=rest)
    else:
        end = replace(end, mesh_error=error)
    for one in rows:
        _log.info("pass: %s, estimate %.2g", one, one.estimate)
    return replace(end, passes=(*earlier, *rows))


def _algebraic_error(
    error: MeshError, load_factor: float, earlier: tuple[Pass, ...], degree: int, size: float
) -> float:
    """The algebraic error, not below the change from the mesh before; nan if not known.

    What degree 1 tells of the error of degree 2 may be too little by a factor of 5: without a mesh
    before it is not taken.
    """
    known = error.algebraic_error
    if known == 0.0:
        return known
    if earlier:
        change = abs(load_factor - earlier[-1].load_factor) / size
        return change if math.isnan(known) else max(known, change)
    return known if degree == 1 else math.nan


def _remaining(error: MeshError, best: Collapse, size: float) -> MeshError:
    """The error of a collapse with other hinges."""
    if math.isfinite(error.load_factor_hinges):
        return replace(error, hinge_length=error.contact_length, hinge_error=0.0)
    hinge_error = abs(error.load_factor_point_hinges - best.load_factor) / size
    return replace(error, hinge_length=0.0, hinge_error=hinge_error)


def _below(row: Pass, scene: Scene) -> bool:
    return scene.solve.accuracy is not None and row.estimate <= scene.solve.accuracy


def reached(ends: Iterable[Collapse], scene: Scene) -> bool:
    """Whether all ends of the range of load factors have the accuracy wished."""
    return all(end.passes and _below(end.passes[-1], scene) for end in ends)


def finer_scene(scene: Scene, displacements: int, meshes: int, cells: Flags | None) -> Scene | str:
    """The scene for the next mesh; the reason for people where there is none.

    Args:
        scene: That was solved.
        displacements: Its number of displacements.
        meshes: Number of meshes that were tried.
        cells: Those to refine; None: not known.
    """
    if meshes >= OPTIONS.meshes:
        return f"it was not reached on {meshes} meshes"
    if scene.degree == 1:
        if 4 * displacements > OPTIONS.displacements:
            return f"{OPTIONS.displacements} displacements do not suffice"
        return replace(scene, degree=2)
    if cells is None:
        return "the cells to refine are not known"
    mesh = refine(scene.mesh, cells)
    # About 8 displacements to a corner: middles of sides are three times as many.
    if 8 * mesh.domain.topology.index_map(0).size_global > OPTIONS.displacements:
        return f"{OPTIONS.displacements} displacements do not suffice"
    return replace(scene, mesh=mesh)


def cells_to_refine(case: LoadCase, end: Collapse) -> Flags:
    """This rank's cells whose refinement promises most for the load factor of a collapse."""
    comm = case.discretization.scene.comm
    value = _indicator(case, end)
    total = comm.allreduce(float(value.sum()))
    low, high = 0.0, comm.allreduce(float(value.max(initial=0.0)), MPI.MAX)
    for _ in range(OPTIONS.bisections):
        middle = 0.5 * (low + high)
        enough = comm.allreduce(float(value[value > middle].sum())) >= OPTIONS.part * total
        low, high = (middle, high) if enough else (low, middle)
    return np.asarray(value > low)


def _indicator(case: LoadCase, end: Collapse) -> Array:
    """Indicator of this rank's cells, not scaled."""
    whole, state = case.discretization, end.state
    if state is None:
        return np.ones(len(whole.scene.mesh.body))
    strains = recovery_energy(whole, state.elastic)
    try:
        kkt = case.coulomb(state.work, case.scales_at(state.work, abs(state.load_factor)))
        adjoint = case.problem.elastic_part(adjoint_mode(kkt, state))
    except SolverError as error:
        _log.info("  no adjoint mode: %s", error)
        return strains
    return np.sqrt(strains * recovery_energy(whole, adjoint))
