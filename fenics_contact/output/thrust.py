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

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact.discretization.faces import straight_faces
from fenics_contact.discretization.joints import GROUND, Joints
from fenics_contact.geometry.mesh import Array, Flags, Indices
from fenics_contact.geometry.planar_cells import connected
from fenics_contact.results.joint_values import JointValues


@dataclass(frozen=True)
class ThrustOptions:
    """Numbers of lines of thrust.

    Attributes:
        touching: Distance of the ends of two faces that touch, over the structure's size.
        parallel: Sine of the angle between two faces of one section, at most.
        loaded: A face without this part of the largest force of all carries none.
        aside: Forces branch where a third section has more than this part of the second largest
            force on a part. Fill on a ring has less; piers below a lintel have more.
        along: Cosine of the angle between a force and the line through a part, at least.
        grounded: Part of all lines that reach the ground, at least, for lines in pictures.
    """

    touching: float = 1e-6
    parallel: float = 1e-3
    loaded: float = 1e-6
    aside: float = 0.3
    along: float = 0.7
    grounded: float = 0.5


OPTIONS = ThrustOptions()


@dataclass(frozen=True)
class Resultants:
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
        acting: Whether they carry a force, pressed or pulled, shape (faces,).
        parts: Whether most points open in the collapse mode and none carries force, shape (faces,).
    """

    bodies: Indices
    force: Array
    normal_force: Array
    centre: Array
    normal: Array
    ends: Array
    loaded: Flags
    acting: Flags
    parts: Flags


def face_resultants(joints: Joints, values: JointValues) -> Resultants:
    """Resultants of joint forces on all faces, loaded or not."""
    faces = straight_faces(joints)
    count = len(faces.ends)
    opens = np.bincount(faces.of_point, values.opens - 0.5, count) > 0.0
    normal_force, *sums = (
        np.bincount(faces.of_point, column, count).astype(float)
        for column in (
            values.normal_force,
            *values.force(joints.normal, joints.tangent).T,
            *(values.normal_force[:, None] * joints.position).T,
        )
    )
    x, y, *moment = sums
    ends = joints.position[faces.ends]
    with np.errstate(divide="ignore", invalid="ignore"):
        centre = np.column_stack(moment) / normal_force[:, None]
    first = faces.ends[:, 0]
    bonded = np.bincount(faces.of_point, values.bond, count) > 0.0
    pressed = (normal_force > 0.0) & ~(bonded & _outside(centre, ends))
    loaded = normal_force > OPTIONS.loaded * normal_force.max(initial=0.0)
    size = np.hypot(x, y)
    pulled = bonded & (size > OPTIONS.loaded * size.max(initial=0.0))
    return Resultants(
        bodies=np.asarray(joints.bodies[first], dtype=np.int64),
        force=np.column_stack([x, y]),
        normal_force=normal_force,
        centre=np.where(pressed[:, None], centre, ends.mean(axis=1)),
        normal=joints.normal[first],
        ends=ends,
        loaded=loaded,
        acting=loaded | pulled,
        parts=opens & ~loaded,
    )


def _outside(centre: Array, ends: Array) -> Flags:
    """Faces on which the centre of pressure is not."""
    from_middle = np.linalg.norm(centre - ends.mean(axis=1), axis=1)
    half = 0.5 * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return np.asarray(~(from_middle <= half))


@dataclass(frozen=True)
class Section:
    """A section that a line of thrust may cross.

    Attributes:
        force: Resultant, N per metre of thickness.
        centre: Centre of pressure, m.
        ends: Its ends, m, shape (2, 2).
        parts: Parts on its two sides; `GROUND` for rigid ground.
    """

    force: Array
    centre: Array
    ends: Array
    parts: tuple[int, int]

    @property
    def size(self) -> float:
        """Size of the resultant."""
        return float(np.linalg.norm(self.force))


@dataclass(frozen=True)
class ThrustLines:
    """Lines of thrust, and the sections that they cross.

    Attributes:
        segments: Straight pieces inside the parts, m, shape (pieces, 2, 2).
        force: Resultant that every piece carries, N per metre of thickness, shape (pieces,).
        centre: Centres of pressure of the sections crossed, m, shape (sections, 2).
        ends: Ends of these sections, m, shape (sections, 2, 2).
        piece_whole: Whether a piece is of a line that reaches the ground, shape (pieces,); False
            for all where most lines do not.
        section_whole: Whether such a line crosses a section, shape (sections,).
    """

    segments: Array
    force: Array
    centre: Array
    ends: Array
    piece_whole: Flags
    section_whole: Flags

    def whole(self) -> ThrustLines:
        """The lines that reach the ground, none where most do not."""
        pieces = self.piece_whole
        crossed = self.section_whole
        return ThrustLines(
            self.segments[pieces],
            self.force[pieces],
            self.centre[crossed],
            self.ends[crossed],
            pieces[pieces],
            crossed[crossed],
        )


def thrust_lines(faces: Resultants, centre: Array) -> ThrustLines:
    """Lines of thrust through all parts that carry one.

    `centre` is a point inside every body, m, shape (bodies, 2).
    """
    sections, part = _sections_and_parts(faces, len(centre))
    of_part: dict[int, list[Section]] = {}
    for section in sections:
        for number in section.parts:
            of_part.setdefault(number, []).append(section)
    of_part.pop(GROUND, None)
    pieces: list[tuple[Array, list[Section]]] = []
    for number, held in of_part.items():
        held.sort(key=lambda section: -section.size)
        if len(held) == 1:
            (only,) = held
            along = only.force / only.size
            reach = (centre[part[:-1] == number].mean(axis=0) - only.centre) @ along
            pieces.append((only.centre + reach * along, held))
        elif _passes(held):
            pieces.append((held[1].centre, held[:2]))
    # A piece that no other one continues says less than the picture of forces.
    uses = Counter(id(section) for _, held in pieces for section in held)
    pieces = [
        (end, held)
        for end, held in pieces
        if any(uses[id(section)] > 1 or GROUND in section.parts for section in held)
    ]
    crossed = {id(section): section for _, held in pieces for section in held}.values()
    piece_whole, section_whole = _whole([held for _, held in pieces], list(crossed))
    return ThrustLines(
        np.array([(held[0].centre, end) for end, held in pieces]).reshape(-1, 2, 2),
        np.array([np.mean([section.size for section in held]) for _, held in pieces]),
        np.array([section.centre for section in crossed]).reshape(-1, 2),
        np.array([section.ends for section in crossed]).reshape(-1, 2, 2),
        piece_whole,
        section_whole,
    )


def _whole(held: Sequence[Sequence[Section]], sections: Sequence[Section]) -> tuple[Flags, Flags]:
    """Which pieces, and which sections, are of lines that reach the ground; none if these are few.

    `held` are the one or two sections of every piece.
    """
    if not sections:
        return np.zeros(0, dtype=bool), np.zeros(0, dtype=bool)
    number = {id(section): k for k, section in enumerate(sections)}
    met = [[number[id(section)] for section in of_piece] for of_piece in held]
    links = np.array([of_piece for of_piece in met if len(of_piece) == 2], dtype=np.int64)
    line = connected(links.reshape(-1, 2), len(sections))
    on_ground = np.array([GROUND in section.parts for section in sections], dtype=bool)
    grounded = np.isin(line, line[on_ground])
    if len(np.unique(line[grounded])) < OPTIONS.grounded * (line.max() + 1):
        grounded[:] = False
    return np.array([grounded[of_piece[0]] for of_piece in met], dtype=bool), grounded


def _passes(held: Sequence[Section]) -> bool:
    """Whether a force passes through a part, from one to the other of its two leading sections."""
    first, other = held[:2]
    line = other.centre - first.centre
    reach = OPTIONS.along * float(np.linalg.norm(line))
    if any(abs(float(section.force @ line)) < reach * section.size for section in (first, other)):
        return False
    return all(section.size <= OPTIONS.aside * other.size for section in held[2:3])


def _sections_and_parts(faces: Resultants, count: int) -> tuple[list[Section], Indices]:
    """Sections that carry forces, and the part of every body, with that of the ground at the end.

    Sections with larger forces come first. One that would join blocks across another one before
    it is no section: its faces are taken one by one, and those within a part are left out.
    """
    part = np.append(np.arange(count), GROUND)
    kept: list[Indices] = []
    single: list[Indices] = []
    groups = sorted(_in_line(faces), key=lambda mine: -float(faces.normal_force[mine].sum()))
    for mine in groups:
        if len(mine) == 1:
            single.append(mine)
            continue
        joined = part.copy()
        for side in _sides(faces, mine):
            members = side[side != GROUND]
            if len(members):
                joined[np.isin(joined, joined[members])] = joined[members].min()
        if all(_separates(faces, joined, other) for other in (*kept, mine)):
            part = joined
            kept.append(mine)
        else:
            single += [np.array([face]) for face in mine]
    kept += [mine for mine in single if _separates(faces, part, mine)]
    return [_section(faces, mine, part) for mine in kept if np.any(faces.loaded[mine])], part


def _section(faces: Resultants, mine: Indices, part: Indices) -> Section:
    """Resultant of the faces of one section."""
    sign = np.sign(faces.normal[mine] @ faces.normal[mine[0]])
    pressure = faces.normal_force[mine]
    ends = faces.ends[mine].reshape(-1, 2)
    along = (ends - ends[0]) @ np.array([-faces.normal[mine[0], 1], faces.normal[mine[0], 0]])
    first, second = part[faces.bodies[mine[0]]].tolist()
    return Section(
        sign @ faces.force[mine],
        pressure @ faces.centre[mine] / pressure.sum(),
        ends[[np.argmin(along), np.argmax(along)]],
        (first, second),
    )


def _sides(faces: Resultants, mine: Indices) -> Iterable[Indices]:
    """Bodies on either side of a section."""
    turned = faces.normal[mine] @ faces.normal[mine[0]] < 0.0
    sides = np.where(turned[:, None], faces.bodies[mine][:, ::-1], faces.bodies[mine])
    return sides.T


def _separates(faces: Resultants, part: Indices, mine: Indices) -> bool:
    """Whether all faces of a section lie between two parts."""
    first, second = part[faces.bodies[mine]].T
    return bool(np.all(first != second))


def _in_line(faces: Resultants) -> Sequence[Indices]:
    """Faces that touch end to end, have one direction and move together, by the line they form."""
    from scipy.spatial import cKDTree

    if not len(faces.bodies):
        return []
    points = faces.ends.reshape(-1, 2)
    near = OPTIONS.touching * float(np.ptp(points, axis=0).max())
    pairs = cKDTree(points).query_pairs(near, output_type="ndarray") // 2
    one, other = (faces.normal[side] for side in pairs.T)
    sine = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    pairs = pairs[(np.abs(sine) <= OPTIONS.parallel) & ~_apart(faces, pairs)]
    label = connected(pairs, len(faces.bodies))
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


def _apart(faces: Resultants, pairs: Indices) -> Flags:
    """Whether one of two faces parts, or that between the blocks beside each other."""
    number = int(faces.bodies.max()) + 2
    key = np.sort(faces.bodies, axis=1) @ [number, 1]
    parting = np.setdiff1d(key[faces.parts], key[~faces.parts])
    apart = np.any(faces.parts[pairs], axis=1)
    one = faces.bodies[pairs[:, 0]]
    other = faces.bodies[pairs[:, 1]]
    turned = np.sum(faces.normal[pairs[:, 0]] * faces.normal[pairs[:, 1]], axis=1) < 0.0
    other = np.where(turned[:, None], other[:, ::-1], other)
    for side in (0, 1):
        beside = np.sort(np.column_stack([one[:, side], other[:, side]]), axis=1) @ [number, 1]
        apart |= np.isin(beside, parting)
    return apart
