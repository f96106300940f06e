"""Soil that pushes back, as bars between rigid ground and sides.

With the vertical stress s the soil presses level on a side with p, k_a s <= p <= k_p s, and pushes
more only where the side moves into it: the plastic law with these two bounds, rigid between them.
The power of p against the velocity v of the side into the soil is max(k_p s v, k_a s v): a convex
law, and as such part of every limit load and bound.

k_a s is a force of the dead load (`loads.forces_of_soil`). What is more is the tension t of a bar,
0 <= t <= Y, that pulls the side towards the inside (`ties`). There are two bars on every part of a
facet, at Gauss' places, with Y = (k_p - k_a) s times their share of the height: exact for stresses
that are linear in the depth, and motions that have one sign on the part. Parts are short however
long the facet is: the motion of a side may change its sign anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fenics_contact.discretization.facets import GROUND, NO_NODE, Boundary, Stencil, lagrange
from fenics_contact.discretization.loads import soil_strips, stress_of_soil
from fenics_contact.discretization.ties import Ties
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.scene.scene import Scene

#: Sides this far from level have no level pressure, as a part of their length.
LEVEL = 1e-9

#: Parts of the depth of a soil that have two bars each: a side that turns about a place in one of
#: them has the power there to (1 / PARTS)^2, whatever the cells.
PARTS = 20


@dataclass(frozen=True)
class Places:
    """Gauss' places on the sides that a soil lies against, shape (places, ...).

    Attributes:
        facet: Row of the boundary.
        parameter: Place on the facet, 0 to 1.
        position: m.
        stress: Vertical stress times the height that the place stands for, N/m.
        side: 1 where the soil is to the right, -1 to the left.
    """

    facet: Indices
    parameter: Array
    position: Array
    stress: Array
    side: Array


def places_of_soil(scene: Scene, boundary: Boundary) -> dict[str, Places]:
    """Places by name of the soil.

    Raises:
        InputError: As `loads.soil_strips`.
    """
    found = {}
    abscissa = np.polynomial.legendre.leggauss(2)[0]  # both weights are 1
    for name, strips in soil_strips(scene, boundary).items():
        across = boundary.normal[strips.facets, 0]
        upright = np.abs(across) > LEVEL
        height = strips.length(boundary) * np.abs(across)
        deep = scene.soil[name].level - boundary.points[strips.facets, :2, 1].min(initial=np.inf)
        parts = np.ceil(PARTS * height / deep * (1.0 - LEVEL)).astype(int) * upright
        strip = np.repeat(np.arange(len(parts)), parts)
        part = np.arange(len(strip)) - (np.cumsum(parts) - parts)[strip]
        place = (part[:, None] + 0.5 * (1.0 + abscissa)) / parts[strip, None]
        parameter = strips.start[strip, None] + (strips.end - strips.start)[strip, None] * place
        strip, parameter = np.repeat(strip, 2), parameter.ravel()
        facet = strips.facets[strip]
        first, second = boundary.points[facet, :2].swapaxes(0, 1)
        position = first + parameter[:, None] * (second - first)
        share = (0.5 * height / np.maximum(parts, 1))[strip]
        stress = stress_of_soil(scene.soil[name], position[:, 1]) * share
        found[name] = Places(facet, parameter, position, stress, np.sign(across[strip]))
    return found


def with_soil(ties: Ties, scene: Scene, boundary: Boundary) -> Ties:
    """Bars of ties, and after them those of soil.

    Raises:
        InputError: As `loads.soil_strips`.
    """
    size = float(np.ptp(boundary.points.reshape(-1, 2), axis=0).max())
    for name, places in places_of_soil(scene, boundary).items():
        least, most = scene.soil[name].coefficients
        yields = (most - least) * places.stress
        acts = yields > 0.0
        if not np.any(acts):
            continue
        facet = places.facet[acts]
        count = int(acts.sum())
        out = np.column_stack([places.side[acts], np.zeros(count)])
        nodes = np.full((count, 2, boundary.nodes.shape[1]), NO_NODE)
        nodes[:, 1] = boundary.nodes[facet]
        weights = np.zeros(nodes.shape)
        weights[:, 1] = lagrange(places.parameter[acts], boundary.nodes.shape[1])
        position = places.position[acts]
        body = boundary.body[facet]
        none = np.zeros(count)
        ties = ties.joined(
            Ties(
                names=(name,),
                tie=np.zeros(count, dtype=np.int64),
                bodies=np.column_stack([np.full_like(body, GROUND), body]),
                sides=np.stack([position - size * out, position], axis=1),
                stencil=Stencil(nodes, weights),
                share=yields[acts] / yields.sum(),
                yields=yields[acts],
                compliance=none,
                prestress=none,
                soils=1,
            )
        )
    return ties
