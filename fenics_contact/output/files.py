"""Files of a result: result.json, ParaView files, pictures, the capacity curve as a table."""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.output.fields import write_blocks, write_joints, write_series
from fenics_contact.output.folder import drawing, filled_at_once, going_on, writing
from fenics_contact.output.plotting import draw_scene, save_capacity
from fenics_contact.output.report.content import MOTION, RECORD
from fenics_contact.output.report.page import write_report
from fenics_contact.output.state_files import (
    Record,
    draw_blocks,
    draw_pictures,
    draw_state,
    origin_record,
    picture_paths,
    short_title,
    strict,
    tie_records,
)
from fenics_contact.output.view import View, caption_of, motion_record, view_of
from fenics_contact.results.result import Answer, Collapse, Result, Table
from fenics_contact.results.values import mechanism, tie_arrays
from fenics_contact.scene.units import rounded_alike

#: What result.json says of `SolveOptions.slip`.
SLIP_REFERENCES = {"stress-free": "stress-free state", "load-steps": "previous load step"}

#: What result.json says of `LimitBounds`.
BRACKET = ("lower", "upper", "frictionless", "meet")

#: What is skipped where somebody is in a hurry.
SKIPPED_FILES = "pictures and ParaView files, or some of them: the run was stopped"


def write_result(result: Result, folder: Path, hurry: Callable[[], bool] = lambda: False) -> None:
    """Write everything the scene's output options ask for; the folder is made if need be.

    Once `hurry` is true, on all ranks, only result.json and the report are written.

    Collective. Files appear when all of them are complete, result.json last, so that its presence
    says that all is there.

    Raises:
        OutputError: On all ranks, if a file cannot be written; the folder is then as it was.
    """
    start = time.perf_counter()
    comm = result.scene.comm
    options = result.scene.output
    with filled_at_once(folder, RECORD, comm) as hidden:
        lost = _write_fields(result, hidden, hurry)
        left_out = (*lost, *((SKIPPED_FILES,) if hurry() else ()))
        seconds = {**result.seconds, "write": time.perf_counter() - start}
        result = replace(result, skipped=(*result.skipped, *left_out), seconds=seconds)
        record = strict(result_record(result))
        with writing(comm):
            if comm.rank == 0:
                record["files"] = sorted(path.name for path in hidden.iterdir())
                (hidden / RECORD).write_text(json.dumps(record, indent=2) + "\n")
                if options.report:
                    write_report(hidden)


def _write_fields(result: Result, folder: Path, hurry: Callable[[], bool]) -> list[str]:
    """Pictures, ParaView files and the capacity curve. Collective.

    Returns:
        Which pictures could not be drawn, and why.
    """
    comm = result.scene.comm
    options = result.scene.output
    lost: list[str] = []
    if result.fall is not None and options.pictures and not hurry():
        title = "does not stand under its dead load"
        with going_on(lost):
            path = folder / "collapse"
            fall = draw_blocks(result.layout, result.falling, result.fall, title, path)
            _write_motions(result, {"fall": fall}, folder)
    views: dict[str, View] = {}
    for direction, end in result.ends.items():
        if options.pictures and not hurry():
            shown = _draw_collapse(result, direction, folder, lost)
            views |= {direction: shown} if shown else {}
        if options.paraview and not hurry():
            _write_collapse(result, direction, end, folder)
    if options.pictures and not hurry():
        _write_motions(result, views, folder)
        view = next(iter(views.values())) if views else view_of(result.layout)
        draw = partial(draw_scene, scene=result.scene)
        with going_on(lost):
            draw_pictures(result.scene, view, "", {folder / "scene": [draw]})
    with going_on(lost), writing(comm):
        if result.capacity and comm.rank == 0:
            _write_capacity(result, folder)
    if result.capacity and options.paraview and options.capacity and not hurry():
        write_series(folder / "capacity.pvd", result.layout, result.capacity)
    return lost


def _write_motions(result: Result, views: Mapping[str, View], folder: Path) -> None:
    """How the blocks move, by direction, for the slider of the report. Collective."""
    comm = result.scene.comm
    with writing(comm):
        if comm.rank == 0 and views:
            records = {name: motion_record(view) for name, view in views.items()}
            (folder / MOTION).write_text(json.dumps(records, separators=(",", ":")) + "\n")


def _write_capacity(result: Result, folder: Path) -> None:
    """The capacity curve as a table and as a picture, on this rank."""
    with (folder / "capacity.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["displacement_m", "load_factor", "work", "converged"])
        for p in result.capacity:
            factor = p.load_factor if p.converged else ""
            table.writerow([p.displacement, factor, p.work, int(p.converged)])
    end = result.collapse
    if result.scene.output.pictures and end is not None:
        title = short_title(result.scene.title)
        paths = picture_paths(result.scene, folder / "capacity")
        with drawing("capacity"):
            save_capacity(result.capacity, end, title, paths)


def _suffix(result: Result, direction: str) -> str:
    """What names of files of one end have behind them."""
    return "_negative" if direction == "negative" and len(result.ends) == 2 else ""


def _draw_collapse(result: Result, direction: str, folder: Path, lost: list[str]) -> View | None:
    """Pictures of one end; where nothing limits the load, of what wedges. Collective.

    Returns:
        What the pictures show; None where there is no collapse mode. Those that cannot be drawn are
        added to `lost`.
    """
    layout = result.layout
    end = result.ends[direction]
    first = folder / f"collapse{_suffix(result, direction)}"
    sign, reversal = (-1.0, ", live load reversed") if direction == "negative" else (1.0, "")
    if end.status == "unbounded":
        title = f"unbounded, these blocks wedge{reversal}"
        with going_on(lost):
            draw_blocks(layout, result.wedged(end), None, title, first, sign)
        return None
    if end.state is None or end.mode is None or end.joints is None:
        return None
    view = view_of(layout, end.mode, end.joints, sign)
    view = replace(view, caption=caption_of(end.status, end.engine))
    elastic = layout.with_imposed(end.state).elastic
    with going_on(lost):
        draw_state(layout, view, elastic, _title(end, reversal), first)
    return view


def _write_collapse(result: Result, direction: str, end: Collapse, folder: Path) -> None:
    """ParaView files of one end, if there is a collapse mode. Collective."""
    if end.status == "unbounded" or end.state is None or end.mode is None or end.joints is None:
        return
    layout = result.layout
    state = layout.with_imposed(end.state)
    suffix = _suffix(result, direction)
    path = folder / f"blocks{suffix}.pvd"
    write_blocks(path, layout, state.displacement, state.elastic, end.mode)
    path = folder / f"joints{suffix}.vtu"
    write_joints(path, layout, end.joints, state.displacement, end.mode, end.proof)


def _title(end: Collapse, reversal: str) -> str:
    """Status and load factor of a collapse and its bracket, rounded alike."""
    status = "" if end.status == "limit" else f"{end.status.replace('_', ' ')}, "
    status += f"{end.searched.partition(',')[0]}, " if end.searched else ""
    reversal += f", gap {end.gap:.0e}" if end.gap is not None else ""
    factor = end.load_factor
    bounds = end.bounds.told(lambda bound: rounded_alike([factor, bound])[1])
    return f"{status}load factor {rounded_alike([factor])[0]}{reversal} ({bounds})"


def result_record(result: Result) -> Record:
    """Content of result.json. Collective."""
    collapse = result.collapse
    scene = result.scene
    kinds = Answer.kinds.values()
    ends = {name: _end_record(result, end) for name, end in result.ends.items()}
    details = {name: _collapse_record(result, end) for name, end in result.ends.items()}
    nothing: Record = {"attempts": [], "wedged_blocks": [], "bounds": _record(None, *BRACKET)}
    first = {**nothing, **next(iter(ends.values()), {})}
    record: Record = {
        "status": result.status,
        "title": scene.title,
        "load_factor": result.load_factor,
        "load_factor_negative": result.load_factor_negative,
        **{key: first[key] for key in nothing},
        "reason": result.reason() or None,
        "stopped": result.stopped or None,
        "falling_blocks": result.falling.tolist(),
        **dict.fromkeys(("method", "engine", "gap", "error_estimate", "residuals")),
        **{kind.key: None for kind in kinds},
        "ties": [],
        "capacity": vars(result.curve_end) if result.curve_end else None,
        "passes": [vars(one) | {"estimate": one.estimate} for one in result.passes],
        "iterations": {"fixed_point": 0},
        **next(iter(details.values()), {}),
    }
    for kind in kinds:
        if kind.by_direction:
            found = {name: end.answers.get(kind.name) for name, end in result.limits.items()}
            record[kind.key] = {name: one.record() for name, one in found.items() if one} or None
    counts = _record(result, "factorizations", "mode_factorizations")
    record["iterations"] = record["iterations"] | counts
    directions = {name: ends[name] | details[name] for name in ends}
    if result.negative is not None and result.negative is not collapse:
        record["negative"] = directions["negative"]
    timed = [kind for kind in kinds if kind.seconds]
    return record | {
        **origin_record(result.layout),
        "ends": ends,
        "directions": directions,
        "warnings": [*result.layout.warnings, *result.contradictions, *_other_warnings(result)],
        "skipped": list(result.skipped),
        "words": {kind.seconds: [kind.option, kind.by_default, kind.begins] for kind in timed},
        "control": scene.solve.control,
        "slip_reference": SLIP_REFERENCES[scene.solve.slip],
        "seconds": {name: round(value, 4) for name, value in result.seconds.items()},
    }


def _end_record(result: Result, end: Collapse) -> Record:
    """What one end of the range of load factors is, and what the blocks do there. Collective."""
    moves = None
    if end.mode is not None and end.joints is not None and end.status != "unbounded":
        found = mechanism(result.layout, end.mode, end.joints)
        moves = {name: np.asarray(value).tolist() for name, value in vars(found).items()}
    units = result.scene.units.of_report
    answers = [one.table(end, units) for one in end.told] if end.status == "limit" else []
    rows = [row for table in (end.table(), *answers) if not table.title for row in table.rows]
    apart = [table for table in answers if table.title and (table.rows or table.note)]
    return {
        "status": end.status,
        "load_factor": end.load_factor,
        "engine": end.engine,
        "gap": end.as_state.gap,
        "proof": end.proof or None,
        "is_lowest": bool(end.searched),
        "searched": end.searched or None,
        "tables": [vars(table) for table in (Table(rows), *apart)],
        "bounds": _record(end.bounds, *BRACKET),
        "reason": result.reason(end) or None,
        "rolling": end.rolling or None,
        "wedged_blocks": result.wedged(end).tolist(),
        "mechanism": moves,
        "attempts": [dict(vars(trial)) for trial in end.attempts],
        "path": [dict(vars(point)) for point in end.trace],
    }


def _collapse_record(result: Result, collapse: Collapse) -> Record:
    """How one end of the range was found, its verification, and all answers to it."""
    history = collapse.history
    if not history and collapse.engine == "path":
        return {}
    splitting = collapse.splitting
    method = history[-1].method if history else "auto"
    if method == "fixed-point" and splitting is not None:
        method = result.scene.solve.method
    record: Record = {"method": method, "engine": collapse.engine, "gap": collapse.as_state.gap}
    record |= {"error_estimate": None, "residuals": None, "failures": []}
    if collapse.path is not None:
        record["continuation"] = {
            "equilibrium_up_to": collapse.path.lower,
            "none_found_at": collapse.path.upper,
            "steps": [_record(step, "load_factor", "displacement") for step in collapse.path.steps],
        }
    if collapse.states:
        record["states"] = [dict(vars(state)) for state in collapse.states]
    # Nothing is proved by the last state of a load that is not limited.
    certificate = None if collapse.status == "unbounded" else collapse.certificate
    if certificate is not None:
        joints = result.layout.joints
        worst = certificate.worst_joint
        record |= _record(certificate, "error_estimate", "static_factor", "kinematic_factor") | {
            "residuals": dict(certificate.residuals),
            "tolerances": certificate.tolerances,
            "failures": sorted(certificate.failures),
            "worst_joint": worst
            and vars(worst)
            | {
                "position": joints.position[worst.point].tolist(),
                "group": joints.names[joints.law[worst.point]],
            },
        }
    record["ties"] = tie_records(tie_arrays(result.layout, collapse.joints))
    for kind in Answer.kinds.values():
        if not kind.by_direction:
            answer = collapse.answers.get(kind.name)
            record[kind.key] = answer and answer.record()
    steps = [step for one in history for step in one.steps]
    names = ("load_factor", "bound_change", "relaxation", "factorizations")
    iterations: Record = {
        "fixed_point": len(steps),
        "contraction": history[0].contraction if history else None,
        "cycles": sum(one.cycles for one in history),
        "work_ratio": collapse.work_ratio,
        "history": [_record(step, *names) for step in steps],
    }
    if splitting is not None:
        counts = _record(splitting, "steps", "sweeps", "joint_steps", "contraction")
        iterations["splitting"] = {"proximal_steps": counts.pop("steps"), **counts}
    return record | {"iterations": iterations}


def _other_warnings(result: Result) -> list[str]:
    """Where compressive strengths are exceeded, at any end, and an accuracy that is missed."""
    missed = [f"accuracy not reached: {result.inaccurate}"] if result.inaccurate else []
    return missed + list(dict.fromkeys(end.pressed for end in result.ends.values() if end.pressed))


def _record(item: Any, *names: str) -> Record:
    """Some attributes of an item; None where there is no item."""
    return {name: None if item is None else getattr(item, name) for name in names}
