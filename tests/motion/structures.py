"""Structures whose way after the peak is known by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from fenics_contact.motion.beyond import Beyond, beyond
from fenics_contact.spatial import Scene
from fenics_contact.spatial.limit import collapse_of
from tests.spatial.bank import moved

GRAVITY = 9.81
#: Left for right, and by 30 degrees about z.
MIRROR = np.diag([-1.0, 1.0, 1.0])
COSINE, SINE = np.cos(np.radians(30.0)), np.sin(np.radians(30.0))
TURN = np.array([[COSINE, -SINE, 0.0], [SINE, COSINE, 0.0], [0.0, 0.0, 1.0]])


def box(left, low, right, high):
    """Corners of a rectangle."""
    return [[left, low], [right, low], [right, high], [left, high]]


def in_plane(outlines, fixed=(), friction=0.7, push=1.0, density=2000.0, **tables):
    """A scene of polygons, m, under their weight and a part of it sideways."""
    blocks = {
        f"b{k}": {"polygon": np.asarray(outline).tolist(), "fixed": k in fixed}
        for k, outline in enumerate(outlines)
    }
    return _scene(blocks, [0.0, -GRAVITY], [push * GRAVITY, 0.0], friction, density, tables)


def in_space(blocks, push, friction=0.7, **tables):
    """A scene in space under its weight and a part of it along a vector."""
    live = [GRAVITY * part for part in push]
    tables = {"dimension": 3, "solve": {"quick": True}, **tables}
    return _scene(blocks, [0.0, 0.0, -GRAVITY], live, friction, 1800.0, tables)


def _scene(blocks, dead, live, friction, density, tables):
    given = {
        "blocks": blocks,
        "materials": {"default": {"density": density}},
        "joints": {"default": {"friction": friction}},
        "loads": {"dead": {"body": dead}, "live": {"body": live}},
    }
    return Scene.from_tables(given | tables, Path())


def way_down(scene, **options) -> Beyond:
    """The way of a scene after its peak."""
    structure = scene.structure()
    found = beyond(structure, collapse_of(structure), **options)
    assert found is not None
    return found


def seen(scene, matrix):
    """A scene that is turned or mirrored as a whole, with its loads."""

    def load(one):
        given = {key: getattr(one, key) for key in ("body", "direction")}
        found = {k: (matrix[: len(v), : len(v)] @ v).tolist() for k, v in given.items() if v}
        return replace(one, **{k: tuple(v) for k, v in found.items()})

    blocks = tuple(moved(block, matrix, np.zeros(3)) for block in scene.blocks)
    return replace(scene, blocks=blocks, dead=load(scene.dead), live=load(scene.live))


def turned(point, block=0):
    """Angle by which a block has turned in its plane, rad."""
    cosine = 0.5 * (np.trace(point.poses.rotation[block]) - 1.0)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def arch(count, thickness, mean=1.0):
    """Voussoirs of a semicircle and the two springers below it."""
    angle = 0.5 * np.pi * (1.0 + np.linspace(1.0, -1.0, count + 1))
    ray = np.column_stack([np.cos(angle), np.sin(angle)])
    inner, outer = (mean - 0.5 * thickness) * ray, (mean + 0.5 * thickness) * ray
    blocks = [np.array([inner[k], inner[k + 1], outer[k + 1], outer[k]]) for k in range(count)]
    below = np.array([0.0, -0.3])
    for k in (0, count):
        blocks.append(np.array([inner[k], outer[k], outer[k] + below, inner[k] + below]))
    return blocks
