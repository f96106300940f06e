"""An accuracy that is wished: what is done until the error estimate is below it.

On every mesh hinges become points by their compliance (`hinges`). Where the error that is left is
too large, the displacements get degree 2. Then cells are refined whose displacements are farthest
from linear ones, in the norm of the strain energy: the hierarchical surplus (R.E. Bank, R.K. Smith,
SIAM J. Numer. Anal. 30 (1993) 921). How the blocks strain decides how the joints share the load.
"""

from __future__ import annotations

import itertools
import logging
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from dolfinx import fem

from fenics_contact import compat
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.stress_law import mean_shear_modulus
from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.geometry.refinement import refine
from fenics_contact.results.mesh_error import MeshError, Pass
from fenics_contact.results.result import Result
from fenics_contact.scene.scene import Scene

_log = logging.getLogger("fenics_contact")
Found = TypeVar("Found", bound=Result)

#: Corners at the ends of the sides of a cell of degree 2, by its number of nodes.
SIDES = {6: [[1, 2], [0, 2], [0, 1]], 9: [[0, 1], [0, 2], [1, 3], [2, 3]]}


@dataclass(frozen=True)
class AccuracyOptions:
    """Limits of the passes.

    Attributes:
        meshes: So many are tried at most, that given and that with degree 2 among them.
        displacements: No mesh with more, about, is tried.
        falls: An error is held to be at least this part of that on the mesh before: load factors
            that agree may do so by chance.
    """

    meshes: int = 8
    displacements: int = 200_000
    falls: float = 0.25


OPTIONS = AccuracyOptions()


def to_accuracy(result: Found, solve: Callable[[Scene], Found]) -> Found:
    """The limit load on a mesh that is fine enough for the accuracy that its scene wishes.

    Where there is none, `inaccurate` says so.

    Args:
        result: On the mesh given, with status "limit".
        solve: Finds it for a scene with another mesh.
    """
    for meshes in itertools.count(1):
        _report_most_accurate(result)
        wished = result.scene.solve.accuracy
        last = {row.direction: row for row in result.passes}
        if wished is None or all(row.estimate <= wished for row in last.values()):
            return result
        # Finer cells do not help where it is not known what short hinges do.
        known = all(row.hinge_error <= wished for row in last.values())
        finer = None
        if meshes < OPTIONS.meshes and (known or result.scene.degree == 1):
            finer = _finer(result)
        if finer is None:
            size = result.discretization.size
            result.inaccurate = f"not with {meshes} meshes of up to {size} displacements"
            result.inaccurate += "" if known else "; what short hinges do is not known"
            break
        new = solve(finer)
        if new.status != "limit":
            _add_costs(result, new)
            result.inaccurate = new.stopped or f"no limit load was found on mesh {meshes + 1}"
            break
        _add_costs(new, result)
        new.passes = result.passes
        result = new
    if result.scene.comm.rank == 0:
        _log.warning("warning: the accuracy wished is not reached: %s", result.inaccurate)
    return result


def _add_costs(result: Result, other: Result) -> None:
    """Add the time and the factorisations of another result to those of one."""
    result.factorizations += other.factorizations
    result.mode_factorizations += other.mode_factorizations
    for name, value in other.seconds.items():
        result.seconds[name] = result.seconds.get(name, 0.0) + value


def _report_most_accurate(result: Result) -> None:
    """Put collapses with point hinges in place of others, and add rows for what was found."""
    before = {row.direction: row for row in result.passes}
    seconds = sum(result.seconds.values())
    for name, end in result.ends.items():
        if end.status != "limit":
            continue
        best = end.at_point_hinges or end
        least = math.nan
        if name in before:
            change = abs(best.load_factor - before[name].load_factor) / end.size
            least = np.fmax(change, OPTIONS.falls * before[name].algebraic_error)
        for hinges, one in (("mesh", end), ("points", end.at_point_hinges)):
            if one is None:
                continue
            error = one.mesh_error or MeshError(math.nan, math.nan, math.nan)
            algebraic = float(np.fmax(error.algebraic_error, least))  # of what is known
            error = replace(error, algebraic_error=algebraic)
            found = replace(one, mesh_error=error, attempts=end.attempts, trace=end.trace)
            result.ends[name] = found = found.with_errors_in_bracket()
            error = found.mesh_error or error
            about = name, result.discretization.size, result.scene.degree, hinges
            row = Pass(*about, one.load_factor, error.hinge_error, error.algebraic_error, seconds)
            _log.info("pass: %s, estimate %.2g", row, row.estimate)
            result.passes += (row,)


def _finer(result: Result) -> Scene | None:
    """The scene on the next mesh; None where that is too large."""
    scene = result.scene
    if scene.degree == 2:
        scene = replace(scene, mesh=refine(scene.mesh, _cells_to_refine(result)))
    corners = scene.mesh.domain.topology.index_map(0).size_global
    # With the middles of sides there are four times as many nodes, about.
    return replace(scene, degree=2) if 8 * corners <= OPTIONS.displacements else None


def _cells_to_refine(result: Result) -> Flags:
    """This rank's cells with more than the mean surplus, at any end."""
    whole = result.discretization
    marked = np.zeros(len(whole.scene.mesh.body), dtype=bool)
    for end in result.ends.values():
        if end.state is not None and end.status == "limit":
            surplus = _surplus(whole, end.state.elastic)
            total, count = whole.scene.comm.allreduce(np.array([surplus.sum(), len(surplus)]))
            marked |= surplus * count > total
    return marked


def _surplus(whole: Discretization, displacement: Array) -> Array:
    """What makes displacements of degree 2 other than linear, in the norm of the energy, by cell.

    In this rank's cells; up to a factor.
    """
    space = whole.elasticity.space
    law = whole.elasticity.law
    field = fem.Function(space)
    field.x.array[: len(displacement)] = whole.cartesian(displacement).ravel()
    field.x.scatter_forward()
    nodes = compat.cell_dofs(space)
    sides = SIDES[nodes.shape[1]]
    values = field.x.array.reshape(-1, 2)[nodes]
    middle = values[:, len(sides) : 2 * len(sides)]  # nodes follow those at the corners
    apart = middle - values[:, sides].mean(axis=2)
    if isinstance(law, tuple):
        stiffness = law[1].x.array[compat.cell_dofs(law[1].function_space)[:, 0]]
    else:
        stiffness = mean_shear_modulus(whole.elasticity.law_matrices())
    return np.asarray(np.sqrt(stiffness * np.sum(apart**2, axis=(1, 2))))
