"""Lines of thrust: through which points of the joints the forces pass, from load to ground.

Joint forces act on a straight face between two bodies, so that their resultant passes through the
centre of pressure, sum r_N x / sum r_N: shear forces have no moment about points of the face. Faces
in one line that touch end to end are one *section*, as a bed joint through a pier is, or a radial
joint through a ring. Blocks on one side of a section are one *part*: a course of a pier, a
voussoir. Through a part runs a straight line from one of its sections to the other; with three
sections or more, a line from each to the mean of all centres of pressure, weighted by force. This
is the line of resistance of J. Heyman, The Stone Skeleton, Cambridge 1995. A part on one section
only has its line in the resultant, from where its load acts.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from fenics_contact.analysis.joint_values import JointValues
from fenics_contact.analysis.rigid_blocks import straight_faces
from fenics_contact.discretization.joints import GROUND, Joints
from fenics_contact.mesh import Array, Flags, Indices


@dataclass(frozen=True)
class ThrustOptions:
    """Numbers of lines of thrust.

    Attributes:
        touching: Distance of the ends of two faces that touch, over the structure's size.
        parallel: Sine of the angle between two faces of one section, at most.
        loaded: A face without this part of the largest force of all carries none.
        leading: A section with less than this part of the largest force of a part has no line.
    """

    touching: float = 1e-6
    parallel: float = 1e-3
    loaded: float = 1e-6
    leading: float = 1e-2


OPTIONS = ThrustOptions()


@dataclass(frozen=True)
class Resultants:
    """Resultants of the joint forces on straight faces between two bodies.

    Attributes:
        bodies: First and second body, `GROUND` for rigid ground, shape (faces, 2).
        force: On the second body, N per metre of thickness, shape (faces, 2).
        normal_force: Its part along the normal, at least 0, shape (faces,).
        centre: Centre of pressure, m, shape (faces, 2); the middle where no force acts.
        normal: Unit normal from first to second body, shape (faces, 2).
        ends: Ends of the faces, m, shape (faces, 2, 2).
    """

    bodies: Indices
    force: Array
    normal_force: Array
    centre: Array
    normal: Array
    ends: Array

    @property
    def size(self) -> Array:
        """Size of the resultants, N per metre of thickness, shape (faces,)."""
        return np.linalg.norm(self.force, axis=1)

    @property
    def loaded(self) -> Flags:
        """Faces that carry a force."""
        return self.normal_force > OPTIONS.loaded * self.normal_force.max(initial=0.0)


def face_resultants(joints: Joints, values: JointValues) -> Resultants:
    """Resultants of joint forces on all faces, loaded or not."""
    faces = straight_faces(joints, joints.length)
    count = len(faces.ends)
    normal_force, *sums = (
        np.bincount(faces.of_point, column, count).astype(float)
        for column in (
            values.normal_force,
            *values.force(joints).T,
            *(values.normal_force[:, None] * joints.position).T,
        )
    )
    x, y, *moment = sums
    ends = joints.position[faces.ends]
    with np.errstate(divide="ignore", invalid="ignore"):
        centre = np.column_stack(moment) / normal_force[:, None]
    first = faces.ends[:, 0]
    pressed = normal_force > 0.0
    return Resultants(
        bodies=np.asarray(joints.bodies[first], dtype=np.int64),
        force=np.column_stack([x, y]),
        normal_force=normal_force,
        centre=np.where(pressed[:, None], centre, ends.mean(axis=1)),
        normal=joints.normal[first],
        ends=ends,
    )


@dataclass(frozen=True)
class ThrustLines:
    """Lines of thrust, and the sections that they cross.

    Attributes:
        segments: Straight pieces inside the parts, m, shape (pieces, 2, 2).
        force: Resultant that every piece carries, N per metre of thickness, shape (pieces,).
        centre: Centres of pressure of the loaded sections, m, shape (sections, 2).
        ends: Ends of these sections, m, shape (sections, 2, 2).
    """

    segments: Array
    force: Array
    centre: Array
    ends: Array


def thrust_lines(faces: Resultants, centre: Array) -> ThrustLines:
    """Lines of thrust through all parts.

    `centre` is a point inside every body, m, shape (bodies, 2).
    """
    sections, part = _sections_and_parts(faces, len(centre))
    loaded = [mine for mine in sections if np.any(faces.loaded[mine])]
    crossed = [_crossing(faces, mine) for mine in loaded]
    of_part: dict[int, list[int]] = {}
    for number, mine in enumerate(loaded):
        for side in set(part[faces.bodies[mine]].ravel().tolist()) - {GROUND}:
            of_part.setdefault(side, []).append(number)
    segments: list[Array] = []
    forces: list[float] = []
    for label, numbers in of_part.items():
        point = np.array([crossed[number].centre for number in numbers])
        force = np.array([crossed[number].force for number in numbers])
        size = np.linalg.norm(force, axis=1)
        leads = size >= OPTIONS.leading * size.max()
        point, force, size = point[leads], force[leads], size[leads]
        if len(size) == 1:
            along = force[0] / size[0]
            inside = centre[np.flatnonzero(part[:-1] == label)].mean(axis=0)
            node = point[0] + ((inside - point[0]) @ along) * along
        else:
            node = size @ point / size.sum()
        segments += [np.stack([one, node]) for one in point]
        forces += size.tolist()
    return ThrustLines(
        np.array(segments).reshape(-1, 2, 2),
        np.array(forces),
        np.array([one.centre for one in crossed]).reshape(-1, 2),
        np.array([one.ends for one in crossed]).reshape(-1, 2, 2),
    )


@dataclass(frozen=True)
class _Crossing:
    """Resultant of a section, its centre of pressure and the ends of the section."""

    force: Array
    centre: Array
    ends: Array


def _crossing(faces: Resultants, mine: Indices) -> _Crossing:
    """Resultant of the faces of one section."""
    sign = np.sign(faces.normal[mine] @ faces.normal[mine[0]])
    pressure = faces.normal_force[mine]
    ends = faces.ends[mine].reshape(-1, 2)
    along = (ends - ends[0]) @ np.array([-faces.normal[mine[0], 1], faces.normal[mine[0], 0]])
    return _Crossing(
        sign @ faces.force[mine],
        pressure @ faces.centre[mine] / pressure.sum(),
        ends[[np.argmin(along), np.argmax(along)]],
    )


def _sections_and_parts(faces: Resultants, count: int) -> tuple[list[Indices], Indices]:
    """Faces of every section, and the part of every body, with that of the ground at the end.

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
    return kept, part


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
    """Faces that touch end to end and have one direction, by the line they form."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    count = len(faces.bodies)
    if count == 0:
        return []
    points = faces.ends.reshape(-1, 2)
    near = OPTIONS.touching * float(np.ptp(points, axis=0).max())
    pairs = cKDTree(points).query_pairs(near, output_type="ndarray") // 2
    one, other = faces.normal[pairs[:, 0]], faces.normal[pairs[:, 1]]
    sine = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    pairs = pairs[np.abs(sine) <= OPTIONS.parallel]
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), (count, count))
    label = connected_components(graph, directed=False)[1]
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
