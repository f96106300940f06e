"""What is legal in a scene or a state and probably meant otherwise, in a line each.

Contacts of curved sides are told how far they may roll, and have rolled. Displacements are small: a
round block stays where it is drawn while its contact rolls along. Sides whose distance grows like
s^2 / 2R then press at s = R a after a turn a, and a gap g lets s reach sqrt(2 g R). No round block
has this arm. So a state misses about the part a of what it carries.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from fenics_contact.discretization.contacts import facing_facets
from fenics_contact.discretization.faces import straight_faces, strength_of
from fenics_contact.discretization.facets import GROUND, Boundary, Gaps
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.profiles import floor_strips
from fenics_contact.discretization.supports import facet_motion
from fenics_contact.geometry.mesh import Array, BlockMesh, Indices
from fenics_contact.geometry.planar_cells import connected
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


#: Places that a warning names.
NAMED = 3
#: Stands for no gap, m: graphs have no edges of length 0.
TOUCHING = 1e-12


def warnings_on(
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


#: Turns up to this count as none, rad: what a load factor is missed by.
LEAST_TURN = 2e-3
#: Part of the largest force of a point below which a contact carries nothing.
NOTHING = 1e-3


@dataclass(frozen=True)
class CurvedContact:
    """Joint points next to each other at which sides of unlike curvature face each other.

    Attributes:
        points: Their numbers.
        place: Coordinates along the joint from where the sides are nearest, m.
        curvature: 1 / R, of one side relative to the other, 1/m.
        where: Blocks and place, for people.
    """

    points: Indices
    place: Array
    curvature: float
    where: str


def curved_contacts(joints: Joints) -> Iterator[CurvedContact]:
    """Contacts at curved sides alone; a straight one beside them keeps a block from rolling."""
    if not np.any(joints.curvature > 0.0):
        return
    spots = np.column_stack([joints.bodies, np.round(joints.position, 9)])
    spot = np.unique(spots, axis=0, return_inverse=True)[1].ravel()
    contact = connected(spot[joints.neighbours], len(spots))[spot]
    for number in np.unique(contact[joints.curvature > 0.0]):
        points = np.flatnonzero(contact == number)
        curvature = float(joints.curvature[points].mean())
        if np.any(joints.curvature[points] == 0.0):
            continue
        tangent = joints.tangent[points].mean(axis=0)
        middle = joints.position[points].mean(axis=0)
        place = (joints.position[points] - middle) @ tangent
        # On a parabola of known curvature: the slope at the middle tells how far its foot is.
        slope = np.polyfit(place, joints.gap[points] - 0.5 * curvature * place**2, 1)[0]
        first, second = joints.bodies[points[0]]
        x, y = np.round(middle - slope / curvature * tangent, 9) + 0.0
        where = f"blocks {first} and {second} at ({x:.3g}, {y:.3g})"
        yield CurvedContact(points, place + slope / curvature, curvature, where)


def possible_turn(joints: Joints) -> str:
    """The contact that may roll farthest, for people; empty if none may roll far."""
    found = [
        (float(np.abs(contact.place).max()) * contact.curvature, contact.where)
        for contact in curved_contacts(joints)
    ]
    turn, where = max(found, default=(0.0, ""))
    if turn <= LEAST_TURN:
        return ""
    return (
        f"curved sides face each other beside where they touch, farthest those of {where}: if a"
        f" block rolls there, load factors are wrong by up to sqrt(2 gap / R) = {turn:.2g},"
        " less with a smaller gap and smaller facets"
    )


def turn_in(joints: Joints, force: Array) -> str:
    """The contact that has rolled farthest under normal forces at all joint points, for people."""
    found = [(0.0, "")]
    for contact in curved_contacts(joints):
        of_points = force[contact.points]
        if of_points.sum() > NOTHING * force.max():
            arm = abs(of_points @ contact.place) / of_points.sum()
            # The force is at the nearest point at best, on a facet that may be large.
            if arm - np.abs(contact.place).min() > LEAST_TURN / contact.curvature:
                found.append((float(arm) * contact.curvature, contact.where))
    turn, where = max(found)
    if not where:
        return ""
    return (
        f"the force between curved sides of {where} acts beside the place where they touch, as"
        f" after a turn of {turn:.2g} rad; blocks stay where they are drawn, so arms of forces are"
        f" wrong by about {turn:.2g} of the radius, and whether a block rolls away is not known"
    )


def pressed_too_much(scene: Scene, joints: Joints, force: Array) -> str:
    """Where pressures exceed the strength of curved joints, which do not crush, for people.

    `force` is normal, N/m, at all joint points. Collective.
    """
    strength = strength_of(scene, joints)
    face = straight_faces(joints).of_point
    pressure = force / joints.length
    beyond = np.flatnonzero((np.bincount(face)[face] == 1) & (pressure > strength))
    if not len(beyond):
        return ""
    beyond = beyond[np.argsort(-pressure[beyond])]
    places = []
    for point in beyond[:NAMED]:
        x, y = np.round(joints.position[point], 9) + 0.0
        pair = f"{1e-6 * pressure[point]:.3g} MPa, strength {1e-6 * strength[point]:.3g} MPa"
        places.append(f"({x:.3g}, {y:.3g}) ({pair})")
    more = f" and {len(beyond) - NAMED} more" if len(beyond) > NAMED else ""
    text = "the compressive strength is exceeded at curved joints, which do not crush here: at"
    return f"{text} {', '.join(places)}{more}"
