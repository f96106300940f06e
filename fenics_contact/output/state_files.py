"""Pictures, ParaView files and records of one state or a fall; the files of `equilibrium()`."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from fenics_contact import compat
from fenics_contact.discretization.layout import Layout
from fenics_contact.errors import plain
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.output.fields import stress_raster, write_blocks, write_joints
from fenics_contact.output.folder import DrawingError, drawing, filled_at_once, going_on, writing
from fenics_contact.output.plotting import (
    Draw,
    draw_forces,
    draw_marked,
    draw_mode,
    draw_stress,
    draw_thrust,
    save,
    whole_thrust,
)
from fenics_contact.output.report.content import RECORD
from fenics_contact.output.scene_record import scene_record
from fenics_contact.output.view import View, view_of
from fenics_contact.results.certificate import tolerances
from fenics_contact.results.result import ServiceState
from fenics_contact.results.values import NamedArrays, TieState, falling_blocks, tie_arrays
from fenics_contact.scene.scene import Scene
from fenics_contact.version import __version__

#: Characters of a title that a picture has room for.
LONGEST_TITLE = 60


def short_title(title: str) -> str:
    """A title as pictures have it: one short line, in which dollars are no mathematics."""
    return plain(title, LONGEST_TITLE)


def picture_paths(scene: Scene, path: Path) -> list[Path]:
    """Files of a picture, in all formats asked for; `path` is without its ending."""
    return [
        path.with_name(f"{path.name}.{suffix}") for suffix in dict.fromkeys(scene.output.formats)
    ]


def draw_pictures(
    scene: Scene, view: View, title: str, pictures: Mapping[Path, Sequence[Draw]]
) -> None:
    """Pictures by file without its ending, each of panels side by side, on rank 0. Collective.

    Raises:
        DrawingError: On all ranks, once all others are drawn, if one cannot be.
    """
    whole = "\n".join(filter(None, (short_title(scene.title), title)))
    with writing(scene.comm):
        failed = []
        for path, draws in pictures.items() if scene.comm.rank == 0 else ():
            paths = picture_paths(scene, path)
            try:
                with drawing(path.name):
                    save(view, whole, paths, *draws)
            except DrawingError as error:
                failed.append(str(error))
                for part in paths:
                    part.unlink(missing_ok=True)
        if failed:
            raise DrawingError("; ".join(failed))


def draw_state(layout: Layout, view: View, elastic: Array, title: str, first: Path) -> None:
    """Motion, forces, stresses and whole lines of thrust of a state. Collective.

    Args:
        layout: Of the state.
        view: What the pictures show.
        elastic: Displacement without a large motion, this rank's part.
        title: Of all pictures.
        first: The picture of the motion, without its ending; what its name has after the first
            underscore is in the other names too.
    """
    _, underscore, rest = first.name.partition("_")
    suffix = underscore + rest
    stress = partial(draw_stress, raster=stress_raster(layout, elastic))
    panels: dict[str, Draw] = {first.name: draw_mode, f"forces{suffix}": draw_forces}
    panels[f"stress{suffix}"] = stress
    with drawing(f"thrust{suffix}"):  # alike on all ranks
        if len(whole_thrust(view).segments):
            panels[f"thrust{suffix}"] = draw_thrust
    pictures = {first.with_name(name): [draw] for name, draw in panels.items()}
    draw_pictures(layout.scene, view, title, pictures)


def draw_blocks(
    layout: Layout,
    blocks: Indices,
    motion: Array | None,
    title: str,
    path: Path,
    sign: float = 1.0,
) -> View:
    """Picture of some blocks among all, moved by rigid motions (a, b, c) by block. Collective.

    Returns:
        What it shows; `sign` is that of the live load.
    """
    mode = None if motion is None else layout.rigid_motion(motion)
    view = replace(view_of(layout, mode, sign=sign), marked=blocks)
    draw_pictures(layout.scene, view, title, {path: [draw_marked]})
    return view


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


def write_service_state(
    found: ServiceState,
    layout: Layout,
    view: View | None,
    numbers: Mapping[str, Any],
    folder: Path,
) -> None:
    """Write what the scene's output options ask for; the folder is made if need be. Collective.

    Args:
        found: The state, or why there is none.
        layout: Of the state.
        view: What pictures show; None where there is no state.
        numbers: More of result.json.
        folder: Where to.

    Raises:
        OutputError: On all ranks, if a file cannot be written; the folder is then as it was.
    """
    comm = layout.scene.comm
    record = strict(_record(found, layout) | dict(numbers))
    with filled_at_once(folder, RECORD, comm) as hidden:
        if layout.scene.output.pictures:
            with going_on(record["warnings"]):
                _draw(found, layout, view, hidden)
        if layout.scene.output.paraview:
            _write_fields(found, layout, hidden)
        with writing(comm):
            if comm.rank == 0:
                record["files"] = sorted(path.name for path in hidden.iterdir())
                (hidden / RECORD).write_text(json.dumps(record, indent=2) + "\n")


def _draw(found: ServiceState, layout: Layout, view: View | None, folder: Path) -> None:
    """Pictures of the state, or of the blocks that fall. Collective."""
    if found.fall is not None:
        falling = falling_blocks(layout, found.fall)
        title = "does not stand under its dead load"
        draw_blocks(layout, falling, found.fall, title, folder / "collapse")
    if found.state is not None and view is not None:
        title = f"{found.status.replace('_', ' ')}, load factor {found.load_factor:.6g}"
        draw_state(layout, view, found.state.elastic, title, folder / "state")


def _write_fields(found: ServiceState, layout: Layout, folder: Path) -> None:
    """ParaView files of the state. Collective."""
    state = found.state
    if state is None or found.joint_values is None:
        return
    write_blocks(folder / "blocks.pvd", layout, state.displacement, state.elastic, None)
    write_joints(folder / "joints.vtu", layout, found.joint_values, state.displacement, None)


def _record(found: ServiceState, layout: Layout) -> Record:
    """Content of result.json without its files. Collective."""
    return {
        "status": found.status,
        "title": layout.scene.title,
        "load_factor": found.load_factor,
        "engine": found.engine,
        "reason": found.reason or None,
        "residuals": dict(found.residuals),
        "tolerances": {name: tolerances()[name] for name in found.residuals},
        "falling_blocks": falling_blocks(layout, found.fall).tolist(),
        "ties": tie_records(tie_arrays(layout, found.joint_values)),
        "warnings": list(layout.warnings),
        **origin_record(layout),
    }
