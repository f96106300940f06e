"""Contacts of curved sides: where they touch, and how far their force has rolled away from there.

Displacements are small: a round block stays where it is drawn while its contact rolls along. Sides
whose distance grows like s^2 / 2R then press at s = R a after a turn a, and a gap g lets s reach
sqrt(2 g R). No round block has this arm. So a state misses about the part a of what it carries.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fenics_contact.discretization.joints import Joints
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.geometry.planar_cells import connected

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
