"""Lines of thrust: through which points of the joints the forces pass, from load to ground.

Joint forces act on a straight face between two bodies, so that their resultant passes through the
centre of pressure, sum r_N x / sum r_N: shear forces have no moment about points of the face. Faces
in one line that touch end to end are one *section*, as a bed joint through a pier is, or a radial
joint through a ring. It ends where blocks move apart in the collapse mode: parts that do so have
lines of their own. Blocks on one side of a section are one *part*: a course of a pier, a voussoir.

A part that two sections hold carries the force of one to the other, and its own load. The line
through it runs straight between their centres of pressure: the line of resistance of J. Heyman,
The Stone Skeleton, Cambridge 1995. Where one section holds a part, the line begins in it, on the
line of action. Where a third section carries much too, as below a lintel or in a wall whose blocks
all turn by themselves, forces branch and there is no line. Pictures leave out lines that do not
reach the ground; where most do not, as in a facade with windows, they have none.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from fenics_contact.discretization.joints import GROUND
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.results.block_view import BlockView, ContactState

#: Distance of the ends of two faces that touch, over the structure's size.
TOUCHING = 1e-6
#: Sine of the angle between two faces of one section, at most.
PARALLEL = 1e-3
#: A face without this part of the largest force of all carries none.
LOADED = 1e-6
#: Forces branch where a third section has more than this part of the second largest force on a
#: part. Fill on a ring has less; piers below a lintel have more.
ASIDE = 0.3
#: Cosine of the angle between a force and the line through a part, at least.
ALONG = 0.7
#: Part of all lines that reach the ground, at least, for lines in pictures.
GROUNDED = 0.5


class Resultants(NamedTuple):
    """Resultants of the joint forces on straight faces between two bodies.

    Attributes:
        bodies: First and second body, `GROUND` for rigid ground, shape (faces, 2).
        force: On the second body, N per metre of thickness, shape (faces, 2).
        normal_force: Its part along the normal, at least 0, shape (faces,).
        centre: Centre of pressure, m, shape (faces, 2); the middle where no force acts, or a bond
            carries more moment than pressure does.
        normal: Unit normal from first to second body, shape (faces, 2).
        ends: Ends of the faces, m, shape (faces, 2, 2).
        loaded: Whether they are pressed, shape (faces,).
        parts: Whether most points open in the collapse mode and none carries force, shape (faces,).
    """

    bodies: Indices
    force: Array
    normal_force: Array
    centre: Array
    normal: Array
    ends: Array
    loaded: Flags
    parts: Flags


def face_resultants(view: BlockView) -> Resultants:
    """Resultants of the forces on all faces in the plane, loaded or not, but between grounds."""
    at = view.touching
    bodies = np.where(np.append(view.bodies.fixed, True)[at.pairs], GROUND, at.pairs)
    columns = (at.pressing, *at.force[:, ::2].T, *(at.pressing[:, None] * at.position[:, ::2]).T)
    normal_force, *sums = map(at.sums, columns)
    force = np.column_stack(sums[:2])
    ends = at.ends
    middle = ends.mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        centre = np.column_stack(sums[2:]) / normal_force[:, None]
    half = 0.5 * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    inside = np.linalg.norm(centre - middle, axis=1) <= (1.0 + TOUCHING) * half
    loaded = normal_force > LOADED * normal_force.max(initial=0.0)
    opens = np.isin(view.contacts.state, (ContactState.OPEN, ContactState.ROCKS))
    found = Resultants(
        bodies=bodies,
        force=force,
        normal_force=normal_force,
        centre=np.where(((normal_force > 0.0) & inside)[:, None], centre, middle),
        normal=at.normal[:, ::2],
        ends=ends,
        loaded=loaded,
        parts=opens & ~loaded,
    )
    return Resultants(*(column[np.any(bodies != GROUND, axis=1)] for column in found))


class ThrustLines(NamedTuple):
    """Lines of thrust that reach the ground, and the sections that they cross.

    Attributes:
        segments: Straight pieces inside the parts, m, shape (pieces, 2, 2).
        force: Resultant that every piece carries, N per metre of thickness, shape (pieces,).
        centre: Centres of pressure of the sections crossed, m, shape (sections, 2).
        ends: Ends of these sections, m, shape (sections, 2, 2).
    """

    segments: Array
    force: Array
    centre: Array
    ends: Array


def thrust_lines(faces: Resultants, inside: Array) -> ThrustLines:
    """Lines of thrust that reach the ground; none where most do not.

    `inside` is a point inside every body, m, shape (bodies, 2).
    """
    groups, part = _sections_and_parts(faces, len(inside))
    count = len(groups)
    force = np.zeros((count, 2))
    centre = np.zeros((count, 2))
    ends = np.zeros((count, 2, 2))
    for k, mine in enumerate(groups):
        normal = faces.normal[mine[0]]
        pressure = faces.normal_force[mine]
        force[k] = np.sign(faces.normal[mine] @ normal) @ faces.force[mine]
        centre[k] = pressure @ faces.centre[mine] / pressure.sum()
        points = faces.ends[mine].reshape(-1, 2)
        along = (points - points[0]) @ [-normal[1], normal[0]]
        ends[k] = points[[np.argmin(along), np.argmax(along)]]
    size = np.linalg.norm(force, axis=1)
    sides = part[faces.bodies[[mine[0] for mine in groups]]].reshape(-1, 2)
    on_ground = np.any(sides == GROUND, axis=1)
    pieces: list[tuple[Array, Indices]] = []  # end of the piece, and its one or two sections
    for number in np.unique(sides[sides != GROUND]):
        held = np.flatnonzero(np.any(sides == number, axis=1))
        held = held[np.argsort(-size[held], kind="stable")]
        first = held[0]
        if len(held) == 1:
            along = force[first] / size[first]
            reach = (inside[part[:-1] == number].mean(axis=0) - centre[first]) @ along
            pieces.append((centre[first] + reach * along, held))
            continue
        line = centre[held[1]] - centre[first]
        least = ALONG * np.linalg.norm(line) * size[held[:2]]
        passes = np.all(np.abs(force[held[:2]] @ line) >= least)
        if passes and np.all(size[held[2:3]] <= ASIDE * size[held[1]]):
            pieces.append((centre[held[1]], held[:2]))
    # A piece that no other one continues says less than the picture of forces.
    met = np.array([k for _, held in pieces for k in held], dtype=np.int64)
    uses = np.bincount(met, minlength=count)
    pieces = [one for one in pieces if np.any((uses[one[1]] > 1) | on_ground[one[1]])]
    crossed = np.zeros(count, dtype=bool)
    crossed[[k for _, held in pieces for k in held]] = True
    links = [held for _, held in pieces if len(held) == 2]
    line_of = connected(np.array(links, dtype=np.int64).reshape(-1, 2), count)
    whole = crossed & np.isin(line_of, line_of[crossed & on_ground])
    if len(np.unique(line_of[whole])) < GROUNDED * len(np.unique(line_of[crossed])):
        whole[:] = False
    pieces = [one for one in pieces if whole[one[1][0]]]
    return ThrustLines(
        np.array([(centre[held[0]], end) for end, held in pieces]).reshape(-1, 2, 2),
        np.array([size[held].mean() for _, held in pieces]),
        centre[whole],
        ends[whole],
    )


def _sections_and_parts(faces: Resultants, count: int) -> tuple[list[Indices], Indices]:
    """Faces of the sections that carry forces, and the part of every body, then of the ground.

    Sections with larger forces come first. One that would join blocks across another one before
    it is no section: its faces are taken one by one, and those within a part are left out.
    """
    part = np.append(np.arange(count), GROUND)
    kept: list[Indices] = []
    single: list[Indices] = []

    def separates(part: Indices, mine: Indices) -> bool:
        first, second = part[faces.bodies[mine]].T
        return bool(np.all(first != second))

    for mine in sorted(_in_line(faces), key=lambda mine: -float(faces.normal_force[mine].sum())):
        if len(mine) == 1:
            single.append(mine)
            continue
        joined = part.copy()
        turned = faces.normal[mine] @ faces.normal[mine[0]] < 0.0
        bodies = faces.bodies[mine]
        for side in np.where(turned[:, None], bodies[:, ::-1], bodies).T:
            members = side[side != GROUND]
            if len(members):
                joined[np.isin(joined, joined[members])] = joined[members].min()
        if all(separates(joined, other) for other in (*kept, mine)):
            part = joined
            kept.append(mine)
        else:
            single += [np.array([face]) for face in mine]
    kept += [mine for mine in single if separates(part, mine)]
    return [mine for mine in kept if np.any(faces.loaded[mine])], part


def _in_line(faces: Resultants) -> list[Indices]:
    """Faces that touch end to end, have one direction and move together, by the line they form.

    Two faces do not move together where one of them parts, or the blocks beside each other do.
    """
    from scipy.spatial import cKDTree

    if not len(faces.bodies):
        return []
    points = faces.ends.reshape(-1, 2)
    near = TOUCHING * float(np.ptp(points, axis=0).max())
    pairs = cKDTree(points).query_pairs(near, output_type="ndarray") // 2
    one, other = (faces.normal[side] for side in pairs.T)
    sine = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    turned = np.sum(one * other, axis=1) < 0.0
    together = (np.abs(sine) <= PARALLEL) & ~np.any(faces.parts[pairs], axis=1)
    number = int(faces.bodies.max()) + 2
    key = np.sort(faces.bodies, axis=1) @ [number, 1]
    parting = np.setdiff1d(key[faces.parts], key[~faces.parts])
    beside, others = (faces.bodies[side] for side in pairs.T)
    others = np.where(turned[:, None], others[:, ::-1], others)
    for side in (0, 1):
        blocks = np.sort(np.column_stack([beside[:, side], others[:, side]]), axis=1)
        together &= ~np.isin(blocks @ [number, 1], parting)
    label = connected(pairs[together], len(faces.bodies))
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
