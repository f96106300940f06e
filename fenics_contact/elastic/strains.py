"""Blocks that strain in the search: their motions are those of the nodes of meshes, S = K.

Contacts see means of displacements, `elastic.means`: B R = H for rigid motions R. A block that has
no mesh stays rigid. Springs of contacts stand for blocks' strains where these are rigid; here they
are next to stiff.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from fenics_contact.elastic.body import ElasticBody
from fenics_contact.elastic.shapes import Placed
from fenics_contact.elastic.stresses import (
    ForcesOnBlock,
    Touch,
    at_nodes,
    body_of,
    loads_on_blocks,
    sorted_blocks,
    table_at,
    touches_of,
)
from fenics_contact.errors import SolverError
from fenics_contact.faces.model import FaceModel
from fenics_contact.faces.strained import StrainedModel
from fenics_contact.geometry.mesh import Array
from fenics_contact.results.values import listed_blocks
from fenics_contact.spatial.scene import BlockScene
from fenics_contact.spatial.structure import Structure

#: Compliance of contacts' springs, in parts of that where blocks are rigid.
SOFT = 1e-3
#: Entries of means below this are rounding.
ROUNDING = 1e-12

_log = logging.getLogger("fenics_contact")


class Strains(NamedTuple):
    """Of one block.

    Attributes:
        motion: B, sparse, shape (3 units, motions).
        stiffness: K, N/m, sparse.
        loads: Dead and live, N, shape (motions, 2).
        mean: Rigid motions, m and rad times the structure's size, as means of motions: sparse.
        rigid: R, motions of rigid ones, sparse.
    """

    motion: Any
    stiffness: Any
    loads: Array
    mean: Any
    rigid: Any


def with_strains(scene: BlockScene, structure: Structure, degree: int = 1) -> Structure:
    """The structure, with blocks that strain, by displacements of a degree, in elastic states."""
    return replace(structure, strained=partial(_strained, scene, degree))


def _strained(scene: BlockScene, degree: int, structure: Structure) -> partial[StrainedModel]:
    """What makes a model with meshes of a rigid one, by the sign of the live load."""
    from scipy.sparse import block_diag, hstack

    parts = _parts(scene, degree, structure)
    stiffness, mean, rigid = (
        block_diag([getattr(part, name) for part in parts], "csr")
        for name in ("stiffness", "mean", "rigid")
    )
    motion = hstack([part.motion for part in parts], "csr")
    dead, live = np.vstack([part.loads for part in parts]).T
    dead = dead + motion.T @ structure.given_force.ravel()
    counts = [len(part.loads) for part in parts]
    compliance, offset = structure.springs(SOFT)
    changes = {
        "motion": motion,
        "stiffness": stiffness / structure.young,
        "compliance": compliance,
        "offset": offset,
        "block": np.repeat(np.arange(len(counts)), counts),
    }
    return partial(_model_of, changes, (dead, live), rigid, mean)


def _model_of(
    changes: Mapping[str, Any],
    loads: tuple[Array, Array],
    rigid: Any,
    mean: Any,
    model: FaceModel,
    sign: float,
) -> StrainedModel:
    """A rigid model with what strains change.

    Loads at nodes get the sums and moments of those of rigid blocks: what differs, as rounding, or
    of blocks whose loads were changed, acts as a body force.
    """
    dead, live = loads[0], sign * loads[1]
    dead = dead + mean.T @ (model.dead - rigid.T @ dead)
    live = live + mean.T @ (model.live - rigid.T @ live)
    return StrainedModel.of(model, mean, dead=dead, live=live, **changes)


def _parts(scene: BlockScene, degree: int, structure: Structure) -> list[Strains]:
    """The blocks that move, in their order; those that have no mesh rigid."""
    touches = touches_of(structure)
    none, both = loads_on_blocks(structure, 0.0), loads_on_blocks(structure, 1.0)
    found: dict[int, Strains] = {}
    missed: dict[str, str] = {}
    for shape in sorted_blocks(scene, structure):
        known: dict[bytes, Any] = {}
        body: ElasticBody | None = None
        for placed in shape:
            number = placed.block
            try:
                body = body or body_of(scene, structure.blocks[placed.like], degree)
                loads = none[number], both[number]
                found[number] = _meshed(structure, body, placed, touches[number], loads, known)
            except SolverError as error:
                missed[structure.blocks[number].name or str(number)] = str(error)
                found[number] = _rigid(structure, number)
    if missed:
        text = f"{listed_blocks([*missed], 'stay')} rigid: {next(iter(missed.values()))}"
        _log.warning("warning: blocks.elastic: %s", text)
    return [found[number] for number in sorted(found)]


def _meshed(
    structure: Structure,
    body: ElasticBody,
    placed: Placed,
    touches: list[Touch],
    loads: tuple[ForcesOnBlock, ForcesOnBlock],
    known: dict[bytes, Any],
) -> Strains:
    """A block on its mesh, motions in the axes of its shape.

    Raises:
        SolverError: If a contact does not lie on the mesh.
    """
    from scipy.sparse import csr_matrix, kron

    count = len(body.nodes)
    units = len(structure.axes)
    motion = csr_matrix((3 * units, 3 * count))
    for where, numbers, axes in touches:
        table = table_at(body, placed, where, known).copy()
        table.data[np.abs(table.data) < ROUNDING] = 0.0
        table.eliminate_zeros()
        local = kron(table, axes @ placed.rotation, "coo")
        row = 3 * numbers[local.row // 3] + local.row % 3
        motion += csr_matrix((local.data, (row, local.col)), motion.shape)
    dead, both = (at_nodes(body, placed, one, known).ravel() for one in loads)
    arm = body.nodes - placed.inside(structure.blocks[placed.block].centroid)
    turned = np.cross(np.eye(3), arm[:, None]).transpose(0, 2, 1).reshape(-1, 3)
    back = placed.rotation.T
    rigid = np.hstack([np.tile(back, (count, 1)), turned @ back / structure.size])
    weighted = body.mass @ rigid
    mean = np.linalg.solve(rigid.T @ weighted, weighted.T)
    loads_at = np.column_stack([dead, both - dead])
    return Strains(motion, body.stiffness, loads_at, csr_matrix(mean), csr_matrix(rigid))


def _rigid(structure: Structure, number: int) -> Strains:
    """A block that has its six motions alone."""
    from scipy.sparse import csr_matrix, identity

    place = 6 * structure.number[number] + np.arange(6)
    motion = structure.relative_motion()[:, place]
    loads = [structure.generalised(one)[place] for one in (structure.dead, structure.live)]
    return Strains(motion, csr_matrix((6, 6)), np.column_stack(loads), identity(6), identity(6))
