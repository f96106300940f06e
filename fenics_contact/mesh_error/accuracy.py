"""An accuracy that is wished: meshes until the load factor changes by less from one to the next.

On every mesh hinges become points (`hinges`): meshes alone show little of what hinges do. On the
second mesh the displacements have degree 2. Then cells are refined whose displacements are farthest
from linear ones, in the norm of the strain energy: the hierarchical surplus (R.E. Bank, R.K. Smith,
SIAM J. Numer. Anal. 30 (1993) 921). How the blocks strain decides how the joints share the load.
The first mesh is enough only where its mechanism has one load factor (`answers.range`).
"""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from typing import TypeVar

import numpy as np
from dolfinx import fem

from fenics_contact import compat
from fenics_contact.discretization.layout import Layout
from fenics_contact.discretization.materials import law_matrices, mean_shear_modulus
from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.geometry.refinement import refine
from fenics_contact.results.history import Pass
from fenics_contact.results.result import Result
from fenics_contact.results.values import Contact
from fenics_contact.scene.scene import Scene
from fenics_contact.search_options import SEARCH

_log = logging.getLogger("fenics_contact")
Found = TypeVar("Found", bound=Result)

#: Corners at the ends of the sides of a cell of degree 2, by its number of nodes.
SIDES = {6: [[1, 2], [0, 2], [0, 1]], 9: [[0, 1], [0, 2], [1, 3], [2, 3]]}


def is_accurate(result: Result) -> bool:
    """Whether the last load factors are as accurate as the scene wishes."""
    wished = result.scene.solve.accuracy
    rows = _last_rows(result).items()
    return wished is None or all(
        row.estimate <= wished and (row.algebraic_error == 0.0 or _enough_meshes(result, name))
        for name, row in rows
    )


def _enough_meshes(result: Result, name: str) -> bool:
    """Whether load factors of a direction agree on two meshes; three where joints slide.

    Those that slide while they are closed over a length, not at hinges, have an error by the mesh
    that coarse meshes may miss.
    """
    meshes = {row.displacements for row in result.passes if row.direction == name}
    joints = result.ends[name].joints
    if joints is None or len(meshes) > 2:
        return len(meshes) > 2
    slides = joints.contact == Contact.SLIP
    slides[joints.hinges(result.layout.joints.neighbours)] = False
    return not np.any(slides)


def finer_scene(result: Result, meshes: int) -> Scene | None:
    """The scene on the next mesh, after so many; None if there is none to be tried. Collective."""
    scene = result.scene
    if meshes >= SEARCH.meshes or not (_hinges_known(result) or scene.degree == 1):
        return None
    if scene.degree == 2:
        scene = replace(scene, mesh=refine(scene.mesh, _cells_to_refine(result)))
    corners = scene.mesh.domain.topology.index_map(0).size_global
    # With the middles of sides there are four times as many nodes, about.
    return replace(scene, degree=2) if 8 * corners <= SEARCH.mesh_size else None


def why_no_finer(result: Result, meshes: int) -> str:
    """Why no mesh after so many is tried, for people."""
    why = f"not with {meshes} meshes of up to {result.layout.size} displacements"
    return why + ("" if _hinges_known(result) else "; what short hinges do is not known")


def inaccurate(result: Found, why: str) -> Found:
    """A result that says why it is not as accurate as its scene wishes."""
    if result.scene.comm.rank == 0:
        _log.warning("warning: the accuracy wished is not reached: %s", why)
    return replace(result, inaccurate=why)


def with_costs(result: Found, other: Result) -> Found:
    """A result with the time and the factorisations of another one added to its own."""
    names = dict.fromkeys([*result.seconds, *other.seconds])
    return replace(
        result,
        factorizations=result.factorizations + other.factorizations,
        mode_factorizations=result.mode_factorizations + other.mode_factorizations,
        cost=result.cost + other.cost,
        seconds={n: result.seconds.get(n, 0.0) + other.seconds.get(n, 0.0) for n in names},
    )


def with_pass(result: Found) -> Found:
    """A result with load factors for point hinges, and rows for all. Collective."""
    before = _last_rows(result)
    about = result.layout.size, result.scene.degree
    seconds = sum(result.seconds.values())
    ends = dict(result.ends)
    rows = list(result.passes)
    for name, end in result.ends.items():
        if end.status != "limit":
            continue
        end = ends[name] = end.with_errors_in_bracket()
        hinges = end.hinges
        known = hinges is not None and hinges.status == "known"
        short = known and hinges.points != end.load_factor
        best = hinges.points if short else end.load_factor
        fixed = end.engine == "faces" or (end.range is not None and end.range.is_one)
        change = 0.0 if fixed else math.nan
        if name in before and not fixed:
            last = before[name]
            change = abs(best - last.load_factor) / end.size
            change = float(np.fmax(change, SEARCH.error_falls * last.algebraic_error))
        of_hinges = abs(best - end.load_factor) / end.size if known else math.nan
        rows.append(Pass(name, *about, "mesh", end.load_factor, of_hinges, change, seconds))
        if short:
            rows.append(Pass(name, *about, "points", best, 0.0, change, seconds))
            ends[name] = replace(end, load_factor=best)
        _log.info("pass: %s, estimate %.2g", rows[-1], rows[-1].estimate)
    return replace(result, ends=ends, passes=tuple(rows))


def _last_rows(result: Result) -> dict[str, Pass]:
    """The last row of every direction."""
    return {row.direction: row for row in result.passes}


def _hinges_known(result: Result) -> bool:
    """Whether it is known what short hinges do: finer cells do not help where it is not."""
    wished = result.scene.solve.accuracy
    return wished is None or all(row.hinge_error <= wished for row in _last_rows(result).values())


def _cells_to_refine(result: Result) -> Flags:
    """This rank's cells with more than the mean surplus, at any end."""
    layout = result.layout
    marked = np.zeros(len(layout.scene.mesh.body), dtype=bool)
    for end in result.ends.values():
        if end.state is not None and end.status == "limit":
            surplus = _surplus(layout, end.state.elastic)
            total, count = layout.scene.comm.allreduce(np.array([surplus.sum(), len(surplus)]))
            marked |= surplus * count > total
    return marked


def _surplus(layout: Layout, displacement: Array) -> Array:
    """What makes displacements of degree 2 other than linear, in the norm of the energy, by cell.

    In this rank's cells; up to a factor.
    """
    space = layout.space
    field = fem.Function(space)
    field.x.array[: len(displacement)] = layout.cartesian(displacement).ravel()
    field.x.scatter_forward()
    nodes = compat.cell_dofs(space)
    sides = SIDES[nodes.shape[1]]
    values = field.x.array.reshape(-1, 2)[nodes]
    middle = values[:, len(sides) : 2 * len(sides)]  # nodes follow those at the corners
    apart = middle - values[:, sides].mean(axis=2)
    stiffness = mean_shear_modulus(law_matrices(layout.law))
    return np.asarray(np.sqrt(stiffness * np.sum(apart**2, axis=(1, 2))))
