"""Lines of thrust: through which points of the joints the forces pass, from load to ground.

Joint forces act on a straight face between two bodies, so that their resultant passes through the
centre of pressure, sum r_N x / sum r_N: shear forces have no moment about points of the face. Faces
in one line that touch end to end are one *section*, as a bed joint through a pier is, or a radial
joint through a ring; it ends at a face that opens over its whole length in the collapse mode, so
that parts that move apart have lines of their own. Blocks on one side of a section are one *part*:
a course of a pier, a voussoir.

Through a part runs a straight line between the sections with the two largest forces, if these lie
along it: the line of resistance of J. Heyman, The Stone Skeleton, Cambridge 1995. From other
sections, as those of piers below one course, the resultant is shown along its line of action, up to
the middle of the blocks next to it; so is that of a part on one section, where the line begins.
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
        along: Cosine of the angle between a force and the line through a part, at least.
    """

    touching: float = 1e-6
    parallel: float = 1e-3
    loaded: float = 1e-6
    leading: float = 1e-2
    along: float = 0.7


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
        parts: Whether they open over their whole length in the collapse mode, shape (faces,).
    """

    bodies: Indices
    force: Array
    normal_force: Array
    centre: Array
    normal: Array
    ends: Array
    parts: Flags

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
    closed = np.bincount(faces.of_point, ~values.opens, count)
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
        parts=closed == 0,
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
    of_part: dict[int, list[tuple[_Crossing, Array]]] = {}
    for one, mine in zip(crossed, loaded, strict=True):
        for side in _sides(faces, mine):
            if np.all(side != GROUND):
                beside = faces.normal_force[mine] @ centre[side] / faces.normal_force[mine].sum()
                of_part.setdefault(int(part[side[0]]), []).append((one, beside))
    segments: list[Array] = []
    forces: list[float] = []
    for pairs in of_part.values():
        pairs.sort(key=lambda pair: -pair[0].size)
        through = len(pairs) > 1 and _passes(pairs[0][0], pairs[1][0])
        if through:
            segments.append(np.stack([pair[0].centre for pair in pairs[:2]]))
            forces.append(0.5 * (pairs[0][0].size + pairs[1][0].size))
        for one, beside in pairs[2 * through :]:
            if one.size < OPTIONS.leading * pairs[0][0].size:
                continue
            along = one.force / one.size
            inside = one.centre + ((beside - one.centre) @ along) * along
            segments.append(np.stack([one.centre, inside]))
            forces.append(one.size)
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

    @property
    def size(self) -> float:
        """Size of the resultant."""
        return float(np.linalg.norm(self.force))


def _passes(one: _Crossing, other: _Crossing) -> bool:
    """Whether a force passes from one section to another: both lie along the line between."""
    line = other.centre - one.centre
    reach = OPTIONS.along * float(np.linalg.norm(line))
    return all(abs(float(each.force @ line)) > reach * each.size for each in (one, other))


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
    apart = np.any(faces.parts[pairs], axis=1)
    pairs = pairs[(np.abs(sine) <= OPTIONS.parallel) & ~apart]
    graph = coo_matrix((np.ones(len(pairs)), pairs.T), (count, count))
    label = connected_components(graph, directed=False)[1]
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
