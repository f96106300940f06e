"""An accuracy that is wished: meshes until the load factor changes by less from one to the next.

On every mesh hinges become points (`hinges`): meshes alone show little of what hinges do. On the
second mesh the displacements have degree 2. Then cells are refined whose displacements are farthest
from linear ones, in the norm of the strain energy: the hierarchical surplus (R.E. Bank, R.K. Smith,
SIAM J. Numer. Anal. 30 (1993) 921). How the blocks strain decides how the joints share the load.
The first mesh is enough only where its mechanism has one load factor (`answers.range`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from fenics_contact import compat
from fenics_contact.discretization.layout import Layout
from fenics_contact.discretization.materials import law_matrices, mean_shear_modulus
from fenics_contact.geometry.mesh import Array, Flags
from fenics_contact.geometry.refinement import refine
from fenics_contact.lazily import fem
from fenics_contact.results.block_view import ContactState
from fenics_contact.results.history import Pass
from fenics_contact.results.result import Result
from fenics_contact.scene.scene import Scene
from fenics_contact.search_options import SEARCH

Found = TypeVar("Found", bound=Result)

#: Corners at the ends of the sides of a cell of degree 2, by its number of nodes.
SIDES = {6: [[1, 2], [0, 2], [0, 1]], 9: [[0, 1], [0, 2], [1, 3], [2, 3]]}


def to_accuracy(result: Found, solve: Callable[[Scene], Found]) -> Found:
    """The limit load on a mesh that is fine enough for the accuracy that its scene wishes.

    Where there is none, `inaccurate` says so. `solve` finds the limit load of a scene.
    """
    result = _with_pass(result)
    wished = result.scene.solve.accuracy or math.inf
    for meshes in itertools.count(1):
        rows = {row.direction: row for row in result.passes}
        if all(
            row.estimate <= wished and (row.algebraic_error == 0.0 or _enough_meshes(result, name))
            for name, row in rows.items()
        ):
            return result
        scene = result.scene
        hinges_known = all(row.hinge_error <= wished for row in rows.values())
        why = f"not with {meshes} meshes of up to {result.layout.size} displacements"
        if not hinges_known:
            why += "; what short hinges do is not known"
        if meshes >= SEARCH.meshes or not (hinges_known or scene.degree == 1):
            break  # where short hinges are not known finer cells do not help
        if scene.degree == 2:
            scene = replace(scene, mesh=refine(scene.mesh, _cells_to_refine(result)))
        corners = scene.mesh.domain.topology.index_map(0).size_global
        # With the middles of sides there are four times as many nodes, about.
        if 8 * corners > SEARCH.large_system:
            break
        new = solve(replace(scene, degree=2))
        both = (result, new)
        costs = {
            "factorizations": sum(one.factorizations for one in both),
            "mode_factorizations": sum(one.mode_factorizations for one in both),
            "cost": sum(one.cost for one in both),
            "seconds": {
                name: sum(one.seconds.get(name, 0.0) for one in both)
                for name in {**result.seconds, **new.seconds}
            },
        }
        if new.status != "limit":
            why = new.stopped or f"no limit load was found on mesh {meshes + 1}"
            result = replace(result, **costs)
            break
        result = _with_pass(replace(new, passes=result.passes, **costs))
    return replace(result, inaccurate=why)


def _enough_meshes(result: Result, name: str) -> bool:
    """Whether load factors of a direction agree on two meshes; three where joints slide.

    Those that slide while they are closed over a length, not at hinges, have an error by the mesh
    that coarse meshes may miss.
    """
    meshes = {row.displacements for row in result.passes if row.direction == name}
    joints = result.ends[name].joints
    if joints is None or len(meshes) > 2:
        return len(meshes) > 2
    slides = joints.contact == ContactState.SLIP
    slides[joints.hinges(result.layout.joints.neighbours)] = False
    return not np.any(slides)


def _with_pass(result: Found) -> Found:
    """A result with load factors for point hinges, and rows for all. Collective."""
    before = {row.direction: row for row in result.passes}
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
            # Load factors may agree by chance: an error of order h^2 falls to a quarter at best.
            change = float(np.fmax(change, 0.25 * last.algebraic_error))
        of_hinges = abs(best - end.load_factor) / end.size if known else math.nan
        rows.append(Pass(name, *about, "mesh", end.load_factor, of_hinges, change, seconds))
        if short:
            rows.append(Pass(name, *about, "points", best, 0.0, change, seconds))
            ends[name] = replace(end, load_factor=best)
    return replace(result, ends=ends, passes=tuple(rows))


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
