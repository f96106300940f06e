"""Files of the state at a given load factor: result.json, pictures, ParaView files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fenics_contact.discretization.layout import Layout
from fenics_contact.output.fields import write_blocks, write_joints
from fenics_contact.output.folder import filled_at_once, going_on, writing
from fenics_contact.output.records import Record, origin_record, strict, tie_records
from fenics_contact.output.report.content import RECORD
from fenics_contact.output.state_files import draw_blocks, draw_state
from fenics_contact.output.view import View
from fenics_contact.results.certificate import TOLERANCES
from fenics_contact.results.moving_blocks import falling_blocks
from fenics_contact.results.named_arrays import tie_arrays
from fenics_contact.results.service_state import ServiceState


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
        "tolerances": {name: TOLERANCES[name] for name in found.residuals},
        "falling_blocks": falling_blocks(layout, found.fall).tolist(),
        "ties": tie_records(tie_arrays(layout, found.joint_values)),
        "warnings": list(layout.warnings),
        **origin_record(layout),
    }
