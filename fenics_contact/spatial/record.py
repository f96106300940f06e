"""Files of a result in space: result.json, and what output options ask for beside it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.errors import key_of
from fenics_contact.output.files import BRACKET, strict
from fenics_contact.output.folder import filled_at_once
from fenics_contact.output.report.content import RECORD
from fenics_contact.output.report.page import write_report
from fenics_contact.spatial.certificate import tolerances
from fenics_contact.spatial.picture import draw_collapse
from fenics_contact.spatial.result import SpatialCollapse, SpatialLimit, collapse_proof
from fenics_contact.spatial.view import SpatialView, views_of
from fenics_contact.spatial.viewer import write_viewer
from fenics_contact.spatial.vtu import write_fields
from fenics_contact.spatial.words import mechanism_record
from fenics_contact.version import __version__


def write_result(
    result: SpatialLimit, folder: Path, hurry: Callable[[], bool] = lambda: False
) -> None:
    """Write what the scene's output options ask for, on the first rank; the folder is made.

    Once `hurry` is true only result.json is written.

    Raises:
        OutputError: If a file cannot be written; the folder is then as it was.
    """
    if compat.default_comm().rank != 0:
        return
    output = result.scene.output
    with filled_at_once(folder, RECORD, MPI.COMM_SELF) as hidden:
        start = time.perf_counter()
        if output.paraview and not hurry():
            write_fields(result, hidden)
        if output.pictures and not hurry():
            draw_collapse(result, hidden, output.formats)
            write_viewer(result, hidden)
        seconds = {**result.seconds, "write": time.perf_counter() - start}
        record = strict(result_record(replace(result, seconds=seconds)))
        record["files"] = sorted(path.name for path in hidden.iterdir())
        (hidden / RECORD).write_text(json.dumps(record, indent=2) + "\n")
        if output.report:
            write_report(hidden)


def result_record(result: SpatialLimit) -> dict[str, Any]:
    """Content of result.json."""
    words = replace(result.wording, units=result.scene.units.of_report)
    found, more = result.answer(words)
    structure = result.structure
    moving = sum(not block.fixed for block in structure.blocks)
    gap = result.scene.solve.gap
    views = dict(zip(result.directions, views_of(result).values(), strict=True))
    directions = {n: _collapse_record(one, views[n], gap) for n, one in result.directions.items()}
    first = next(iter(directions.values()))
    record = {
        "status": result.status,
        "dimension": 3,
        "title": result.scene.title,
        "answer": {"question": words.question, "found": found, "more": more},
        "load_factor": result.load_factor,
        "load_factor_negative": result.load_factor_negative,
        **{key: first[key] for key in first if key not in ("status", "load_factor", "mechanism")},
        "reason": result.reason() or None,
        "stopped": result.stopped or None,
        "iterations": {"factorizations": result.factorizations},
        "mesh": {
            "bodies": len(structure.blocks),
            "floating_bodies": moving,
            "contacts": len(structure.contacts),
            "joint_points": len(structure.points.area),
            "ties": len(structure.bars),
        },
        "scene": scene_record(result),
        "ends": {} if result.status == "unstable" else directions,
        "ways": {name: words.way(name) for name in directions},
        "acceleration": words.acceleration,
        "directions": directions,
        "warnings": list(result.warnings),
        "ranks": result.ranks,
        "version": __version__,
        "versions": compat.versions(),
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "seconds": {name: round(value, 4) for name, value in result.seconds.items()},
    }
    if len(directions) > 1:
        record["negative"] = directions["negative"]
    return record


def _collapse_record(collapse: SpatialCollapse, view: SpatialView, asked: float) -> dict[str, Any]:
    """What is known of one direction, of which a gap was asked for."""
    limit = collapse.status == "limit"
    moves: dict[str, Any] = {}
    if limit and collapse.mode is not None:
        moves = {**mechanism_record(view), "motion": collapse.mode.tolist()}
    falling = collapse.status == "unstable"
    wedged = collapse.status == "unbounded"
    return {
        "status": collapse.status,
        "load_factor": collapse.load_factor,
        "engine": "faces",
        "gap": collapse.gap,
        "proof": collapse_proof(collapse) if limit else None,
        "bounds": {name: getattr(collapse.bounds, name) for name in BRACKET},
        "lowest": collapse.lowest,
        "searched": collapse.searched or None,
        "residuals": collapse.residuals or None,
        "tolerances": tolerances(collapse.residuals, asked) or None,
        "seismic": collapse.seismic and asdict(collapse.seismic),
        "falling_blocks": list(collapse.falling) if falling else [],
        "wedged_blocks": list(collapse.falling) if wedged else [],
        "tensions": None if collapse.tension is None else collapse.tension.tolist(),
        "mechanism": moves or None,
        "attempts": [vars(attempt) for attempt in collapse.attempts],
        "factorizations": collapse.factorizations,
        "reason": collapse.reason or None,
    }


def scene_record(result: SpatialLimit) -> dict[str, Any]:
    """What was solved."""
    scene = result.scene
    structure = result.structure
    resultants = {
        name: (load[:, :3].sum(axis=0) + 0.0).tolist()
        for name, load in (("dead", structure.dead), ("live", structure.live))
    }
    pairs = list(zip(structure.contacts, structure.laws, strict=True))
    contacts = []
    for key in dict.fromkeys(law.key for law in structure.laws):
        areas = [float(contact.area) for contact, law in pairs if law.key == key]
        contacts.append({"group": key, "contacts": len(areas), "area": sum(areas)})
    groups = []
    moving = [block for block in scene.blocks if not block.fixed]
    for group in dict.fromkeys(block.group for block in moving):
        volumes = [float(block.volume) for block in moving if block.group == group]
        groups.append({"group": group, "blocks": len(volumes), "volume": sum(volumes)})
    ties = {
        name: {key_of(key): value for key, value in asdict(tie).items()}
        for name, tie in scene.ties.items()
    }
    extent = np.array([block.extent for block in structure.blocks if not block.fixed])
    size = extent[:, 1].max(axis=0) - extent[:, 0].min(axis=0)
    return {
        "size": dict(zip(("width", "depth", "height"), size.tolist(), strict=True)),
        "loads": {name: asdict(getattr(scene, name)) for name in ("dead", "live")},
        "floors": {name: asdict(floor) for name, floor in scene.floors.items()},
        "materials": {name: asdict(one) for name, one in scene.materials.items()},
        "joints": {name: asdict(one) for name, one in scene.joints.items()},
        "foundations": {name: asdict(one) for name, one in scene.foundations.items()},
        "resultants": resultants,
        "contacts": contacts,
        "groups": groups,
        "ties": ties,
        "seismic": scene.seismic and asdict(scene.seismic),
        "solve": asdict(scene.solve),
        "quick": structure.quick,
    }
