"""What is legal in a scene and probably meant otherwise, in a line each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fenics_contact.discretization.facets import GROUND, Boundary, Gaps
from fenics_contact.discretization.floors import floor_strips
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.movements import facet_motion
from fenics_contact.discretization.pairing import facing_facets
from fenics_contact.discretization.rolling import possible_turn
from fenics_contact.geometry.mesh import BlockMesh
from fenics_contact.scene.scene import JointLaw, Material, Scene


@dataclass(frozen=True)
class Usual:
    """Values beyond which a number is probably in the wrong unit, or a result not what is wanted.

    Attributes:
        friction: Largest coefficient of friction; that of brick and stone is 0.3 to 0.9.
        young: Smallest Young's modulus, Pa; that of soft brickwork is 1e8.
        density: Smallest density, kg/m3; that of light concrete is 400.
        strength: Smallest compressive strength, Pa; that of lime mortar is 5e5.
        unit_weight: Smallest unit weight of soil or water, N/m3; that of water is 9810.
        poisson: Largest Poisson's ratio; closer to 0.5, linear cells lock in plane strain.
        offset: Largest gap of a joint as a fraction of the longest facet: rounding in files.
        movement: Largest movement of a support, or of a block until its gap closes, over the side
            of a square with the area of the smallest block: displacements are small.
        fall: The same of a block that falls through more than one gap.
    """

    friction: float = 2.0
    young: float = 1e6
    density: float = 50.0
    strength: float = 1e4
    unit_weight: float = 500.0
    poisson: float = 0.49
    offset: float = 1e-6
    movement: float = 0.05
    fall: float = 0.01


#: Stands for no gap, m: graphs have no edges of length 0.
TOUCHING = 1e-12


def doubts(
    scene: Scene, boundary: Boundary, joints: Joints, usual: Usual | None = None
) -> tuple[str, ...]:
    """Warnings on a scene, for people; the same on all ranks. Collective."""
    usual = usual or Usual()
    return (
        *_of_mesh(scene.mesh),
        *_of_materials(scene.materials, scene.plane, usual),
        *_of_laws("joints", scene.joints, usual),
        *_of_laws("foundations", scene.foundations, usual),
        *_of_weights(scene),
        *_of_earth(scene, usual),
        *_of_tractions(scene, boundary),
        *_of_gaps(boundary, joints, usual),
        *_of_hanging_blocks(scene, boundary, joints, usual),
        *filter(None, [possible_turn(joints.without_ties())]),
        *_of_movements(scene, boundary, usual),
        *_of_floors(scene, boundary, usual),
    )


def _of_mesh(mesh: BlockMesh) -> Iterator[str]:
    if mesh.remark:
        yield mesh.remark
    if mesh.joined:
        yield (
            f"{mesh.joined} of the {mesh.surfaces} surfaces drawn share nodes with others of their"
            f" groups, so that there are {mesh.body_count} blocks; if they can come apart, set"
            ' mesh.blocks = "surfaces" (in Python: blocks="surfaces" of BlockMesh)'
        )


def _of_materials(materials: Mapping[str, Material], plane: str, usual: Usual) -> Iterator[str]:
    for name, material in materials.items():
        if material.young < usual.young:
            yield f"materials.{name}.young = {material.young:g} Pa is very soft; is it in Pa?"
        if 0.0 < material.density < usual.density:
            text = f"materials.{name}.density = {material.density:g} kg/m3 is very light"
            yield f"{text}; is it in kg/m3?"
        if (material.compressive_strength or usual.strength) < usual.strength:
            text = f"materials.{name}.compressive_strength = {material.compressive_strength:g} Pa"
            yield f"{text} is very low; is it in Pa?"
        if plane == "strain" and material.poisson > usual.poisson:
            yield (
                f"materials.{name}.poisson = {material.poisson:g} in plane strain: cells are too"
                " stiff in bending"
            )


def _of_laws(table: str, laws: Mapping[str, JointLaw], usual: Usual) -> Iterator[str]:
    for name, law in laws.items():
        if (law.friction or 0.0) > usual.friction:
            yield (
                f"{table}.{name}.friction = {law.friction:g} is very high; it is the tangent of"
                " the angle of friction"
            )
        if (law.compressive_strength or usual.strength) < usual.strength:
            text = f"{table}.{name}.compressive_strength = {law.compressive_strength:g} Pa"
            yield f"{text} is very low; is it in Pa?"


def _of_earth(scene: Scene, usual: Usual) -> Iterator[str]:
    """Soil that weighs next to nothing."""
    for kind, load in (("dead", scene.dead), ("live", scene.live)):
        for name, earth in load.earth.items():
            if 0.0 < earth.unit_weight < usual.unit_weight:
                text = f"loads.{kind}.earth.{name}.unit_weight = {earth.unit_weight:g} N/m3"
                yield f"{text} is very light; is it in N/m3?"


def _of_weights(scene: Scene) -> Iterator[str]:
    """Blocks that body forces leave out."""
    heavy = [scene.material(groups).density > 0.0 for groups in scene.mesh.cell_sets]
    count = np.zeros(scene.mesh.body_count, dtype=np.int64)
    np.add.at(count, scene.mesh.body, np.array(heavy, dtype=np.int64)[scene.mesh.cell_groups])
    scene.comm.Allreduce(MPI.IN_PLACE, count, MPI.SUM)
    light = int(np.count_nonzero(count == 0))
    for name, load in (("dead", scene.dead), ("live", scene.live)):
        if light and any(load.body):
            yield f"loads.{name}.body does not act on {light} blocks: their material has no density"


def _of_tractions(scene: Scene, boundary: Boundary) -> Iterator[str]:
    """Tractions on one side of a joint; those on both sides are refused."""
    if not scene.dead.traction and not scene.live.traction:
        return
    facing = np.zeros(len(boundary.length), dtype=bool)
    facing[facing_facets(boundary, Gaps.of(scene, boundary)).facets] = True
    for kind, load in (("dead", scene.dead), ("live", scene.live)):
        for name in load.traction:
            if inside := np.count_nonzero(boundary.in_group(name) & facing):
                yield (
                    f"loads.{kind}.traction.{name} also acts on {inside} facets in joints, on one"
                    " of the two blocks"
                )


def _of_floors(scene: Scene, boundary: Boundary, usual: Usual) -> Iterator[str]:
    """Floors beside the blocks in part, and floors that a seismic check would leave out."""
    for name, strips in floor_strips(scene, boundary).items():
        wished = float(np.ptp(scene.floors[name].x or (0.0, 0.0)))
        lies = float(strips.length(boundary).sum())
        if lies < (1.0 - usual.offset) * wished:
            yield f"floors.{name} lies on {lies:.6g} m of its {wished:.6g} m; the rest is left out"
        if scene.seismic is not None and not scene.floors[name].mass:
            yield f"floors.{name} is left out of the seismic check; give it mass = true"


def _of_gaps(boundary: Boundary, joints: Joints, usual: Usual) -> Iterator[str]:
    """Gaps and overlaps that are taken for closed joints."""
    if joints.offset > usual.offset * boundary.length.max():
        yield (
            f"joints have gaps or overlaps up to {joints.offset:.3g} m in the drawing; they are"
            " taken for closed"
        )


def _of_hanging_blocks(
    scene: Scene, boundary: Boundary, joints: Joints, usual: Usual
) -> Iterator[str]:
    """Blocks that nothing holds until more than one gap closes, or one that is not small.

    A block moves by at least the least sum of gaps on the way from what holds it.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    if not joints.gap.any():
        return
    ground = scene.mesh.body_count
    between = joints.without_ties()
    pairs = np.sort(np.where(between.bodies == GROUND, ground, between.bodies), axis=1)
    held = boundary.body[boundary.role(scene.supports) >= 0]
    every = np.concatenate([pairs, np.column_stack([held, np.full_like(held, ground)])])
    pairs, pair = np.unique(every, axis=0, return_inverse=True)
    gap = np.full(len(pairs), np.inf)
    np.minimum.at(gap, pair.ravel(), np.append(between.gap, np.zeros(len(held))))
    graph = coo_matrix((np.maximum(gap, TOUCHING), pairs.T), (ground + 1, ground + 1))
    fall = dijkstra(graph.tocsr(), directed=False, indices=ground)[:ground]
    own = np.zeros(ground + 1)
    for side in pairs.T:
        np.maximum.at(own, side, gap)
    origin = np.tile(boundary.points[0, 0], (ground, 1))
    side = float(np.sqrt(boundary.areas(origin).min()))
    through = (fall > 1.01 * own[:ground]) & (fall > usual.fall * side)
    deep = np.flatnonzero(np.isfinite(fall) & (through | (fall > usual.movement * side)))
    if len(deep):
        yield (
            f"{len(deep)} blocks hang in the air and fall by up to {fall[deep].max():.3g} m until"
            " their gaps close, which is not small: load factors are those of blocks that touch,"
            " without the height of mortar; for mortar mesh the drawing with --close"
        )


def _of_movements(scene: Scene, boundary: Boundary, usual: Usual) -> Iterator[str]:
    """Movements of supports that are not small beside the blocks."""
    if not scene.dead.movement:
        return
    origin = np.tile(boundary.points[0, 0], (scene.mesh.body_count, 1))
    side = float(np.sqrt(boundary.areas(origin).min()))
    motion = facet_motion(scene, boundary)
    for name in scene.dead.movement:
        moved = float(np.linalg.norm(motion[boundary.in_group(name)], axis=-1).max(initial=0.0))
        if moved > usual.movement * side:
            yield (
                f"loads.dead.movement.{name} moves it by up to {moved:.3g} m, more than"
                f" {usual.movement:g} of the smallest block's size, {side:.3g} m; displacements"
                " are taken for small"
            )
