"""Files of a result in space: result.json, and what output options ask for beside it."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from mpi4py import MPI

from fenics_contact import compat
from fenics_contact.answers.seismic import SeismicAnswer
from fenics_contact.errors import checked
from fenics_contact.output.files import BRACKET, strict, tie_records, write_capacity
from fenics_contact.output.folder import filled_at_once
from fenics_contact.output.report.content import RECORD
from fenics_contact.output.report.page import write_report
from fenics_contact.output.report.viewer import write_viewer
from fenics_contact.results.block_view import BlockView
from fenics_contact.results.history import CurveEnd
from fenics_contact.results.result import Table
from fenics_contact.results.words import mechanism_record
from fenics_contact.scene.units import Units
from fenics_contact.spatial.certificate import tolerances
from fenics_contact.spatial.picture import draw_collapse
from fenics_contact.spatial.result import SpatialCollapse, SpatialLimit, collapse_proof
from fenics_contact.spatial.structure import Structure
from fenics_contact.spatial.view import views_of
from fenics_contact.spatial.vtu import write_fields
from fenics_contact.version import __version__


class LimitLoad(SpatialLimit):
    """Result of `limit_load`, with its files."""

    @checked
    def write(
        self,
        folder: str | Path,
        hurry: Callable[[], bool] = lambda: False,
        beside: Executor | None = None,
    ) -> None:
        """Write result.json and what the scene's output options say, on the first rank.

        The folder is made. Once `hurry` is true only result.json is written. Nothing is left to
        other processes (`beside`).

        Raises:
            OutputError: If a file cannot be written; the folder is then as it was.
        """
        if compat.default_comm().rank != 0:
            return
        output = self.scene.output
        with filled_at_once(Path(folder), RECORD, MPI.COMM_SELF) as hidden:
            start = time.perf_counter()
            if output.paraview and not hurry():
                write_fields(self, hidden)
            if output.pictures and not hurry():
                draw_collapse(self, hidden, output.formats)
                write_viewer(views_of(self), hidden)
            first = next(iter(self.ends.values()))
            if first.curve:
                write_capacity(self, first.curve, first, hidden)
            seconds = {**self.seconds, "write": time.perf_counter() - start}
            record = strict(result_record(replace(self, seconds=seconds)))
            record["files"] = sorted(path.name for path in hidden.iterdir())
            (hidden / RECORD).write_text(json.dumps(record, indent=2) + "\n")
            if output.report:
                write_report(hidden)


def result_record(result: SpatialLimit) -> dict[str, Any]:
    """Content of result.json."""
    words = replace(result.wording, units=result.scene.units.of_report)
    found, more = result.answer(words)
    structure = result.structure
    gap = result.scene.solve.asked_gap
    views = views_of(result)
    ends = {
        name: _collapse_record(structure, end, views[name], gap)
        | {"tables": _tables(end, words.units)}
        for name, end in result.ends.items()
    }
    first = next(iter(ends.values()))
    return {
        **first,
        "status": result.status,
        "dimension": structure.dimension,
        "title": result.scene.title,
        "answer": {"question": words.question, "found": found, "more": more},
        "load_factor": result.load_factor,
        "load_factor_negative": result.load_factor_negative,
        "reason": result.reason(),
        "stopped": result.stopped,
        "iterations": {"factorizations": result.factorizations},
        "mesh": {
            "bodies": len(structure.blocks),
            "floating_bodies": int(np.count_nonzero(structure.number >= 0)),
            "contacts": len(structure.contacts),
            "joint_points": len(structure.points.area),
            "ties": len(structure.bars),
        },
        "scene": scene_record(result),
        "directions": {} if result.status == "unstable" else ends,
        "ways": {name: words.way(name) for name in ends},
        "acceleration": words.acceleration,
        "warnings": list(structure.warnings),
        "ranks": result.ranks,
        "version": __version__,
        "versions": compat.versions(),
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "seconds": {name: round(value, 4) for name, value in result.seconds.items()},
    }


def _tables(collapse: SpatialCollapse, units: Units) -> list[dict[str, Any]]:
    """Rows of the report: on the load factor, and the seismic check where that is asked for."""
    known = {
        "load factor": (collapse.load_factor, ".6g"),
        "gap of its proof, relative": (collapse.gap, ".1e"),
        "lowest collapse state found": (collapse.lowest, ".6g"),
        "nothing carries more than": (collapse.upper, ".6g"),
    }
    rows = [(name, f"{n:{form}}") for name, (n, form) in known.items() if n and math.isfinite(n)]
    tables = [Table(rows)]
    for answer in collapse.told:
        rows += [(row[0], row[1]) for row in answer.table(cast(Any, collapse), units).rows]
    if collapse.seismic is not None:
        tables.append(SeismicAnswer(collapse.seismic).table(cast(Any, collapse), units))
    return [vars(one) for one in tables]


def _collapse_record(
    structure: Structure, collapse: SpatialCollapse, view: BlockView, asked: float
) -> dict[str, Any]:
    """What is known of one direction, of which a gap was asked for."""
    limit = collapse.status == "limit"
    mode = collapse.mode
    moves = (
        {**mechanism_record(view), "motion": structure.told_motions(mode).tolist()}
        if limit and mode is not None
        else {}
    )
    falling = list(collapse.falling)
    known = vars(collapse).items()
    return {
        **{name: value for name, value in known if isinstance(value, (str, int, float, dict))},
        "engine": "faces",
        "proof": collapse_proof(collapse) if limit else None,
        "bounds": {name: getattr(collapse.bounds, name) for name in BRACKET},
        "tolerances": tolerances(collapse.residuals, asked),
        "peak": collapse.peak and {k: v for k, v in vars(collapse.peak).items() if k != "state"},
        "capacity": vars(CurveEnd.of(collapse.curve, collapse.load_factor))
        if collapse.curve
        else None,
        "seismic": collapse.seismic and asdict(collapse.seismic),
        "falling_blocks": falling if collapse.status == "unstable" else [],
        "wedged_blocks": falling if collapse.status != "unstable" else [],
        "ties": tie_records(view.ties),
        "tensions": None if collapse.tension is None else collapse.tension.tolist(),
        "mechanism": moves,
        "states": [
            dict(zip(("load_factor", "gap", "start"), one, strict=True)) for one in collapse.states
        ],
        "attempts": [{**vars(one), "outcome": one.outcome} for one in collapse.attempts],
    }


def scene_record(result: SpatialLimit) -> dict[str, Any]:
    """What was solved."""
    structure = result.structure
    moving = [block for block in structure.blocks if not block.fixed]
    areas = {k: structure.areas_of(k) for k in dict.fromkeys(law.key for law in structure.laws)}
    volumes: dict[str, list[float]] = {block.group: [] for block in moving}
    for block in moving:
        volumes[block.group].append(block.volume)
    extent = np.array([block.extent for block in moving])
    size = dict(zip(("width", "depth", "height"), np.ptp(extent, axis=(0, 1)), strict=True))
    if structure.dimension == 2:
        size.pop("depth")
    return {
        **result.scene.tables(),
        "thickness": result.scene.thickness,
        "size": size,
        "resultants": {
            name: structure.told(getattr(structure, name)[:, :3].sum(axis=0)).tolist()
            for name in ("dead", "live")
        },
        "contacts": [
            {"group": key, "contacts": len(some), "area": sum(some)} for key, some in areas.items()
        ],
        "groups": [
            {"group": name, "blocks": len(some), "volume": sum(some)}
            for name, some in volumes.items()
        ],
    }
