"""Parts of result.json that all results have, and its numbers."""

from __future__ import annotations

import math
import time
from typing import Any

from fenics_contact import compat
from fenics_contact.discretization.layout import Layout
from fenics_contact.output.scene_record import scene_record
from fenics_contact.results.named_arrays import NamedArrays
from fenics_contact.results.tie_values import TieState
from fenics_contact.version import __version__

Record = dict[str, Any]


def origin_record(layout: Layout) -> Record:
    """Mesh and scene of a result, ranks, versions and date."""
    mesh = layout.scene.mesh
    return {
        "mesh": {
            "bodies": mesh.body_count,
            "floating_bodies": int(layout.bodies.floating.sum()),
            "cells": int(mesh.domain.topology.index_map(2).size_global),
            "dofs": layout.size,
            "joint_points": layout.joints.joint_count,
        },
        "scene": scene_record(layout),
        "ranks": layout.scene.comm.size,
        "version": __version__,
        "versions": compat.versions(),
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }


def tie_records(ties: NamedArrays) -> list[Record]:
    """Every bar of every tie, with its force and what it does."""
    if "state" not in ties:
        return []
    words = {state.value: state.name.lower() for state in TieState}
    columns = {name: ties[name].tolist() for name in ties}
    columns["state"] = [words[state] for state in columns["state"]]
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def strict(value: Any) -> Any:
    """A record as strict JSON has it: numbers that are not finite are None."""
    if isinstance(value, dict):
        return {key: strict(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [strict(item) for item in value]
    if isinstance(value, float):
        return value + 0.0 if math.isfinite(value) else None
    return value
