"""What is legal in a scene or a state and probably meant otherwise, in a line each.

Contacts of curved sides are told how far they may roll, and have rolled. Displacements are small: a
round block stays where it is drawn while its contact rolls along. Sides whose distance grows like
s^2 / 2R then press at s = R a after a turn a, and a gap g lets s reach sqrt(2 g R). No round block
has this arm. So a state misses about the part a of what it carries.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from fenics_contact.discretization.contacts import Gaps, facing_facets
from fenics_contact.discretization.facets import GROUND, Boundary
from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.layout import straight_faces
from fenics_contact.discretization.loads import floor_strips
from fenics_contact.discretization.supports import facet_motion
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.parallel import MPI
from fenics_contact.scene.scene import Scene

#: Values beyond which a number is probably in the wrong unit: in what, the value, on which side
#: of it (1: above), and words. Friction of brick and stone is 0.3 to 0.9; E of soft brickwork 1e8
#: Pa; light concrete has 400 kg/m3, lime mortar a strength of 5e5 Pa, water weighs 9810 N/m3.
UNUSUAL = {
    "friction": (2.0, 1, "", "very high; it is the tangent of the angle of friction"),
    "young": (1e6, -1, " Pa", "very soft; is it in Pa?"),
    "density": (50.0, -1, " kg/m3", "very light; is it in kg/m3?"),
    "compressive_strength": (1e4, -1, " Pa", "very low; is it in Pa?"),
    "unit_weight": (500.0, -1, " N/m3", "very light; is it in N/m3?"),
}
#: Largest Poisson's ratio in plane strain: closer to 0.5, linear cells lock.
LOCKS = 0.49
#: Gaps of joints, of the longest facet, that are rounding in files; so for widths of floors.
ROUNDING = 1e-6
#: Largest movement of a support, or of a block until its gap closes, over the side of a square with
#: the area of the smallest block: displacements are small.
MOVEMENT = 0.05
#: The same of a block that falls through more than one gap.
FALL = 0.01
#: Places that a warning names.
NAMED = 3
#: Stands for no gap, m: graphs have no edges of length 0.
TOUCHING = 1e-12
#: Turns of contacts up to this count as none, rad: what a load factor is missed by.
LEAST_TURN = 2e-3
#: Part of the largest force of a point below which a contact carries nothing.
NOTHING = 1e-3


def warnings_on(scene: Scene, boundary: Boundary, joints: Joints) -> tuple[str, ...]:
    """Warnings on a scene, for people; the same on all ranks. Collective."""
    closed = joints.without_ties()
    return (
        *_of_values(scene),
        *_of_groups(scene, boundary),
        *_of_gaps(scene, boundary, closed),
        *filter(None, [possible_turn(closed)]),
        *_of_movements_and_floors(scene, boundary),
    )


def _of_values(scene: Scene) -> Iterator[str]:
    """The mesh; values of materials, laws and earth that are probably in another unit."""
    mesh = scene.mesh
    if mesh.remark:
        yield mesh.remark
    if mesh.joined:
        yield (
            f"{mesh.joined} of the {mesh.surfaces} surfaces drawn share nodes with others of their"
            f" groups, so that there are {mesh.body_count} blocks; if they can come apart, set"
            ' mesh.blocks = "surfaces" (in Python: blocks="surfaces" of BlockMesh)'
        )
    given: dict[str, Any] = {}
    for table in ("materials", "joints", "foundations"):
        given |= {f"{table}.{name}": item for name, item in getattr(scene, table).items()}
    for kind in ("dead", "live"):
        earth = getattr(scene, kind).earth
        given |= {f"loads.{kind}.earth.{name}": item for name, item in earth.items()}
    yield from unusual_values(given)
    for key, item in given.items():
        if scene.plane == "strain" and getattr(item, "poisson", 0.0) > LOCKS:
            yield (
                f"{key}.poisson = {item.poisson:g} in plane strain: cells are too stiff in bending"
            )


def unusual_values(given: Mapping[str, Any]) -> Iterator[str]:
    """Values that are probably in another unit, of materials, laws and earth by their keys."""
    for key, item in given.items():
        for name, (limit, sense, unit, words) in UNUSUAL.items():
            value = getattr(item, name, None) or 0.0
            if value > 0.0 and sense * (value - limit) > 0.0:
                yield f"{key}.{name} = {value:g}{unit} is {words}"


def _of_groups(scene: Scene, boundary: Boundary) -> Iterator[str]:
    """Blocks that body forces leave out; tractions on one side of a joint."""
    heavy = [scene.material(groups).density > 0.0 for groups in scene.mesh.cell_sets]
    count = np.zeros(scene.mesh.body_count, dtype=np.int64)
    np.add.at(count, scene.mesh.body, np.array(heavy, dtype=np.int64)[scene.mesh.cell_groups])
    scene.comm.Allreduce(MPI.IN_PLACE, count, MPI.SUM)
    light = int(np.count_nonzero(count == 0))
    loads = {"dead": scene.dead, "live": scene.live}
    for kind, load in loads.items():
        if light and any(load.body):
            yield f"loads.{kind}.body does not act on {light} blocks: their material has no density"
    facing = np.zeros(len(boundary.length), dtype=bool)
    if scene.dead.traction or scene.live.traction:
        facing[facing_facets(boundary, Gaps.of(scene, boundary)).facets] = True
    for kind, load in loads.items():
        for name in load.traction:
            if inside := np.count_nonzero(boundary.in_group(name) & facing):
                yield (
                    f"loads.{kind}.traction.{name} also acts on {inside} facets in joints, on one"
                    " of the two blocks"
                )


def _of_gaps(scene: Scene, boundary: Boundary, joints: Joints) -> Iterator[str]:
    """Gaps and overlaps that are taken for closed joints; blocks that hang in the air.

    These are blocks that nothing holds until more than one gap closes, or one that is not small. A
    block moves by at least the least sum of gaps on the way from what holds it.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    if joints.offset > ROUNDING * boundary.length.max():
        yield (
            f"joints have gaps or overlaps up to {joints.offset:.3g} m in the drawing; they are"
            " taken for closed"
        )
    if not joints.gap.any():
        return
    ground = scene.mesh.body_count
    pairs = np.sort(np.where(joints.bodies == GROUND, ground, joints.bodies), axis=1)
    held = boundary.body[boundary.role(scene.supports) >= 0]
    every = np.concatenate([pairs, np.column_stack([held, np.full_like(held, ground)])])
    pairs, pair = np.unique(every, axis=0, return_inverse=True)
    gap = np.full(len(pairs), np.inf)
    np.minimum.at(gap, pair.ravel(), np.append(joints.gap, np.zeros(len(held))))
    graph = coo_matrix((np.maximum(gap, TOUCHING), pairs.T), (ground + 1, ground + 1))
    fall = dijkstra(graph.tocsr(), directed=False, indices=ground)[:ground]
    own = np.zeros(ground + 1)
    for side in pairs.T:
        np.maximum.at(own, side, gap)
    size = _smallest_side(scene, boundary)
    through = (fall > 1.01 * own[:ground]) & (fall > FALL * size)
    deep = np.flatnonzero(np.isfinite(fall) & (through | (fall > MOVEMENT * size)))
    if len(deep):
        yield (
            f"{len(deep)} blocks hang in the air and fall by up to {fall[deep].max():.3g} m until"
            " their gaps close, which is not small: load factors are those of blocks that touch,"
            " without the height of mortar; for mortar mesh the drawing with --close"
        )


def _smallest_side(scene: Scene, boundary: Boundary) -> float:
    """Side of a square with the area of the smallest block, m."""
    origin = np.tile(boundary.points[0, 0], (scene.mesh.body_count, 1))
    return float(np.sqrt(boundary.areas(origin).min()))


def _of_movements_and_floors(scene: Scene, boundary: Boundary) -> Iterator[str]:
    """Movements of supports that are not small; floors beside the blocks, or left out."""
    if scene.dead.movement:
        size = _smallest_side(scene, boundary)
        motion = facet_motion(scene, boundary)
    for name in scene.dead.movement:
        moved = float(np.linalg.norm(motion[boundary.in_group(name)], axis=-1).max(initial=0.0))
        if moved > MOVEMENT * size:
            yield (
                f"loads.dead.movement.{name} moves it by up to {moved:.3g} m, more than"
                f" {MOVEMENT:g} of the smallest block's size, {size:.3g} m; displacements"
                " are taken for small"
            )
    for name, strips in floor_strips(scene, boundary).items():
        wished = float(np.ptp(scene.floors[name].x or (0.0, 0.0)))
        lies = float(strips.length(boundary).sum())
        if lies < (1.0 - ROUNDING) * wished:
            yield f"floors.{name} lies on {lies:.6g} m of its {wished:.6g} m; the rest is left out"
        if scene.seismic is not None and not scene.floors[name].mass:
            yield f"floors.{name} is left out of the seismic check; give it mass = true"


def _curved_contacts(joints: Joints) -> Iterator[tuple[Indices, Array, float, str]]:
    """Contacts at curved sides alone; a straight one beside them keeps a block from rolling.

    Joint points next to each other at which sides of unlike curvature face each other; their
    coordinates along the joint from where the sides are nearest, m; the curvature 1 / R, of one
    side relative to the other, 1/m; blocks and place, for people.
    """
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
        yield points, place + slope / curvature, curvature, where


def possible_turn(joints: Joints) -> str:
    """The contact that may roll farthest, for people; empty if none may roll far."""
    turn, where = max(
        (
            (float(np.abs(place).max()) * curvature, where)
            for _, place, curvature, where in _curved_contacts(joints)
        ),
        default=(0.0, ""),
    )
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
    for points, place, curvature, where in _curved_contacts(joints):
        of_points = force[points]
        if of_points.sum() > NOTHING * force.max():
            arm = abs(of_points @ place) / of_points.sum()
            # The force is at the nearest point at best, on a facet that may be large.
            if arm - np.abs(place).min() > LEAST_TURN / curvature:
                found.append((float(arm) * curvature, where))
    turn, where = max(found)
    if not where:
        return ""
    return (
        f"the force between curved sides of {where} acts beside the place where they touch, as"
        f" after a turn of {turn:.2g} rad; blocks stay where they are drawn, so arms of forces are"
        f" wrong by about {turn:.2g} of the radius, and whether a block rolls away is not known"
    )


def pressed_too_much(joints: Joints, force: Array) -> str:
    """Where pressures exceed the strength of curved joints, which do not crush, for people.

    `force` is normal, N/m, at all joint points.
    """
    strength = joints.crushes
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
