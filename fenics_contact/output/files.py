"""Files of a result or of one state: result.json, ParaView files, pictures, tables."""

from __future__ import annotations

import csv
import json
import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.console import answer, law_contacts
from fenics_contact.discretization.layout import Layout
from fenics_contact.errors import SolverError, plain
from fenics_contact.output.fields import stress_raster, write_blocks, write_series
from fenics_contact.output.figures import (
    FIGURES,
    Figure,
    draw_figures,
    figures_of,
    picture_paths,
    write_figures,
)
from fenics_contact.output.folder import drawing, filled_at_once, going_on, writing
from fenics_contact.output.plotting import save_capacity
from fenics_contact.output.report.content import RECORD
from fenics_contact.output.report.page import write_report
from fenics_contact.output.report.viewer import write_viewer
from fenics_contact.output.view import View, caption_of, view_of, view_of_collapse, view_of_fall
from fenics_contact.output.vtu import write_joints
from fenics_contact.parallel import MPI
from fenics_contact.results.certificate import tolerances
from fenics_contact.results.result import (
    Answer,
    ByDirection,
    Collapse,
    Result,
    ServiceState,
    Table,
)
from fenics_contact.results.values import (
    TieState,
    falling_blocks,
    soil_forces,
    tie_arrays,
)
from fenics_contact.results.words import mechanism_record
from fenics_contact.scene.scene import ALL, Scene, function_name
from fenics_contact.scene.units import rounded_alike
from fenics_contact.version import __version__
from fenics_contact.workers import InPlace

#: What result.json says of `SolveOptions.slip`.
SLIP_REFERENCES = {"stress-free": "stress-free state", "load-steps": "previous load step"}

#: What result.json says of `LimitBounds`.
BRACKET = ("lower", "upper", "frictionless", "meet", "reason")

#: What result.json has of the first direction beside answers, and where there is none.
FIRST: Mapping[str, Any] = {
    "attempts": [],
    "wedged_blocks": [],
    "falling_blocks": [],
    "bounds": dict.fromkeys(BRACKET),
    **dict.fromkeys(("method", "engine", "gap", "error_estimate", "residuals", "tolerances")),
    **dict.fromkeys(("failures", "static_factor", "kinematic_factor")),
    "states": [],
    "ties": [],
    "soil": [],
    "iterations": {"fixed_point": 0},
}

#: What is skipped where somebody is in a hurry.
SKIPPED_FILES = "pictures and ParaView files, or some of them: the run was stopped"
#: Characters of a title that a picture has room for.
LONGEST_TITLE = 60
#: Units by key; keys without one have numbers without unit, or words.
UNITS: Mapping[str, str] = {
    key: unit
    for unit, keys in {
        "Pa": "young bound cohesion tensile_strength compressive_strength traction surcharge",
        "kg/m3": "density",
        "m": "gap spacing x y level displacement length width height",
        "m2": "area",
        "degrees": "dilatancy tilt friction_angle wall_friction rotation",
        "m/s2": "body demand",
        "N/m3": "unit_weight",
        "N per metre of thickness": "force resultants",
        "N per metre of thickness, N with a spacing": "yield prestress",
        "N/m per metre of thickness, N/m with a spacing": "stiffness",
    }.items()
    for key in keys.split()
}

_log = logging.getLogger("fenics_contact")

Record = dict[str, Any]


def write_result(
    result: Result,
    folder: Path,
    hurry: Callable[[], bool] = lambda: False,
    beside: Executor | None = None,
) -> None:
    """Write everything the scene's output options ask for; the folder is made if need be.

    Once `hurry` is true, on all ranks, only result.json and the report are written. Pictures are
    drawn `beside` the other files.

    Collective. Files appear when all of them are complete, result.json last, so that its presence
    says that all is there.

    Raises:
        OutputError: On all ranks, if a file cannot be written; the folder is then as it was.
    """

    def draw(hidden: Path) -> list[str]:
        lost = _write_fields(result, hidden, hurry, beside or InPlace())
        return [*lost, *([SKIPPED_FILES] if hurry() else [])]

    def record(seconds: Mapping[str, float], lost: list[str]) -> Record:
        skipped = (*result.skipped, *lost)
        return result_record(replace(result, skipped=skipped, seconds=seconds))

    write_files(result, folder, result.scene.comm, draw, record)


def write_files(
    result: ByDirection,
    folder: Path,
    comm: MPI.Comm,
    draw: Callable[[Path], list[str]],
    record: Callable[[Mapping[str, float], list[str]], Record],
) -> None:
    """Write files, result.json and the report of a result. Collective.

    Args:
        result: What is written.
        folder: Where to.
        comm: Of the ranks that write.
        draw: Writes all other files into a folder, and returns what could not be written, and why.
        record: Content of result.json, from seconds by phase and what could not be written.
    """
    start = time.perf_counter()
    with filled_at_once(folder, RECORD, comm) as hidden:
        lost = draw(hidden)
        seconds = {**result.seconds, "write": time.perf_counter() - start}
        content = strict(record(seconds, lost))
        with writing(comm):
            if comm.rank == 0:
                _write_record(content, hidden)
                if result.scene.output.report and result.status != "equilibrium":
                    write_report(hidden)


def _write_record(record: Record, folder: Path) -> None:
    """Write result.json with the names of the files beside it, on this rank."""
    record["files"] = sorted(path.name for path in folder.iterdir())
    (folder / RECORD).write_text(json.dumps(record, indent=2) + "\n")


def _write_fields(
    result: Result, folder: Path, hurry: Callable[[], bool], beside: Executor
) -> list[str]:
    """Pictures, ParaView files and the capacity curve. Collective.

    Returns:
        Which pictures could not be drawn, and why.
    """
    comm = result.scene.comm
    layout = result.layout
    options = result.scene.output
    lost: list[str] = []
    figures: list[Figure] = []
    drawn: list[Figure] = []
    if options.pictures and not hurry():
        views = _views(result)
        figures = [one for view in views.values() for one in figures_of(view)]
        whole = next((one for one in views.values() if one.faces), None) or view_of(layout)
        figures.append(Figure("scene", "scene", whole, plain(result.scene.title, LONGEST_TITLE)))
        collapses = [one for one in figures if one.kind in ("collapse", "marked")]
        everything = options.pictures == ALL or options.report
        drawn = figures if everything else collapses or figures
    with _drawing(drawn, folder, result.scene, lost, hurry, beside):
        for direction, end in result.ends.items():
            if end.state is None or end.mode is None or end.joints is None:
                continue
            if options.paraview and end.status != "unbounded" and not hurry():
                suffix = result.suffix(direction)
                state = layout.with_imposed(end.state)
                path = folder / f"blocks{suffix}.pvd"
                write_blocks(path, layout, state.displacement, state.elastic, end.mode)
                path = folder / f"joints{suffix}.vtu"
                write_joints(path, layout, end.joints, state.displacement, end.mode, end.proof)
    if figures and not hurry():
        blocks = {name: one.blocks for name, one in views.items() if np.any(one.motion)}
        kept = [one for one in figures if one not in drawn]
        with writing(comm):
            if comm.rank == 0 and kept:
                write_figures(folder / FIGURES, kept)
            if comm.rank == 0 and blocks:
                write_viewer(blocks, folder)
    with going_on(lost), writing(comm):
        if result.capacity and comm.rank == 0:
            write_capacity(result, folder)
    if result.capacity and options.paraview and options.capacity and not hurry():
        write_series(folder / "capacity.pvd", layout, result.capacity)
    return lost


def _views(result: Result) -> dict[str, View]:
    """What pictures show, by direction; of a structure that does not stand its fall. Collective."""
    layout = result.layout
    views: dict[str, View] = {}
    if result.fall is not None:
        views["fall"] = view_of_fall(layout, result.fall)
    for direction, end in result.ends.items():
        told: dict[str, Any] = {"caption": title_of(end), "suffix": result.suffix(direction)}
        if end.status == "unbounded":
            told["marked"] = tuple(result.wedged(end).tolist())
            wedged = replace(view_of(layout, sign=end.sign), caption=caption_of(end))
            views[direction] = wedged.told(**told)
        elif end.state is not None and end.mode is not None and end.joints is not None:
            stress = stress_raster(layout, layout.with_imposed(end.state).elastic)
            views[direction] = replace(view_of_collapse(layout, end).told(**told), stress=stress)
    title = plain(result.scene.title, LONGEST_TITLE)
    return {name: view.told(title=title) for name, view in views.items()}


@contextmanager
def _drawing(
    figures: Sequence[Figure],
    folder: Path,
    scene: Scene,
    lost: list[str],
    hurry: Callable[[], bool] = lambda: False,
    beside: Executor | None = None,
) -> Iterator[None]:
    """Draw pictures on rank 0, beside what is done in this context or before it. Collective.

    What could not be drawn is added to `lost`, on all ranks.
    """
    comm = scene.comm
    formats = scene.output.formats
    known: list[str] = []
    task: Future[list[str]] | None = None
    if comm.size == 1 and beside is not None and not isinstance(beside, InPlace):
        task = beside.submit(draw_figures, figures, folder.absolute(), formats)
    for figure in figures if task is None else ():
        if hurry():
            break
        with writing(comm):
            known += draw_figures([figure], folder, formats) if comm.rank == 0 else []
    yield
    with writing(comm):
        try:
            known += task.result() if task is not None else []
        except SolverError:  # the process ended: once more here
            known = draw_figures(figures, folder, formats)
    for text in comm.bcast(known):
        lost.append(text)
        _log.warning("warning: %s", text)


def write_capacity(result: ByDirection, folder: Path) -> None:
    """The capacity curve to a collapse as a table and as a picture, on this rank."""
    points, end = result.capacity, result.collapse
    with (folder / "capacity.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["displacement_m", "load_factor", "work", "converged"])
        for p in points:
            factor = p.load_factor if p.converged else ""
            table.writerow([p.displacement, factor, p.work, int(p.converged)])
    if result.scene.output.pictures and end is not None:
        title = plain(result.scene.title, LONGEST_TITLE)
        paths = picture_paths(folder / "capacity", result.scene.output.formats)
        with drawing("capacity"):
            save_capacity(points, end, title, paths)


# ---- pictures of one state, or of blocks


def title_of(end: Collapse) -> str:
    """Status and load factor of a collapse and its bracket, rounded alike."""
    reversal = ", live load reversed" * (end.sign < 0.0)
    factor = end.load_factor
    if end.given is not None:
        stands = {"equilibrium": "stands", "unstable": "does not stand"}
        return f"{stands.get(end.status, end.status.replace('_', ' '))} {end.under}"
    if end.status == "unbounded":
        return f"unbounded, these blocks wedge{reversal}"
    status = "" if end.status == "limit" else f"{end.status.replace('_', ' ')}, "
    status += f"{end.searched.partition(',')[0]}, " if end.searched else ""
    if math.isnan(factor):
        return f"{status.rstrip(', ')}{reversal}"
    known = end.bounds.lower is not None or end.bounds.upper is not None
    bounds = end.bounds.told(lambda bound: rounded_alike([factor, bound])[1])
    proved = f" ({bounds})" if known else ""
    return f"{status}load factor {rounded_alike([factor])[0]}{reversal}{proved}"


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
        view: What pictures show; None where there is nothing.
        numbers: More of result.json.
        folder: Where to.

    Raises:
        OutputError: On all ranks, if a file cannot be written; the folder is then as it was.
    """
    scene = layout.scene
    state = found.state
    falling = falling_blocks(layout, found.fall)
    record: Record = {
        "status": found.status,
        "title": scene.title,
        "load_factor": found.load_factor,
        "engine": found.engine,
        "reason": found.reason or None,
        "residuals": dict(found.residuals),
        "tolerances": {name: tolerances()[name] for name in found.residuals},
        "falling_blocks": falling.tolist(),
        "ties": tie_records(tie_arrays(layout, found.joint_values)),
        "soil": [vars(one) for one in soil_forces(layout, found.joint_values)],
        "warnings": list(layout.warnings),
        **origin_record(layout),
        **numbers,
    }
    figures: list[Figure] = []
    if scene.output.pictures and view is not None:
        caption = f"{found.status.replace('_', ' ')}, load factor {found.load_factor:.6g}"
        view = view.told(title=plain(scene.title, LONGEST_TITLE))
        if state is not None:
            view = replace(view.told(caption=caption), stress=stress_raster(layout, state.elastic))
        figures = figures_of(view, "state")
    with filled_at_once(folder, RECORD, scene.comm) as hidden:
        with _drawing(figures, hidden, scene, record["warnings"]):
            if scene.output.paraview and state is not None and found.joint_values is not None:
                moved = state.displacement
                write_blocks(hidden / "blocks.pvd", layout, moved, state.elastic, None)
                write_joints(hidden / "joints.vtu", layout, found.joint_values, moved, None)
        with writing(scene.comm):
            if scene.comm.rank == 0:
                _write_record(strict(record), hidden)


# ---- result.json


def result_record(result: Result) -> Record:
    """Content of result.json. Collective."""
    scene = result.scene
    missed = [f"accuracy not reached: {result.inaccurate}"] if result.inaccurate else []
    pressed = dict.fromkeys(end.pressed for end in result.ends.values() if end.pressed)
    record = record_of(
        result,
        {name: _meshed_record(result, end) for name, end in result.ends.items()},
        {
            **origin_record(result.layout),
            "tilt_angle": scene.tilt_angle(result.load_factor),
            "tilt_angle_negative": scene.tilt_angle(result.load_factor_negative),
            "falling_blocks": result.falling.tolist(),
            "passes": [vars(one) | {"estimate": one.estimate} for one in result.passes],
            "ranks": max(result.ranks, scene.comm.size),
            "warnings": [*result.layout.warnings, *result.contradictions, *missed, *pressed],
            "skipped": list(result.skipped),
            "control": scene.solve.control,
            "slip_reference": SLIP_REFERENCES[scene.solve.slip],
        },
    )
    record["iterations"] |= _record(result, "mode_factorizations")
    return record


def record_of(
    result: ByDirection, details: Mapping[str, Record], more: Mapping[str, Any]
) -> Record:
    """Content of result.json: directions, some of the first one at the top, and what was solved.

    Args:
        result: What was found.
        details: By direction, what only results of this kind know.
        more: The same of the whole result.
    """
    words = replace(result.wording, units=result.scene.units.of_report)
    told, remarks = answer(result, words)
    given = [end.given for end in result.ends.values() if end.given is not None]
    question = f"Does it stand {words.under(given[0])}?" if given else words.question
    kinds = Answer.kinds.values()
    timed = [kind for kind in kinds if kind.seconds]
    ends = {name: _end_record(result, end) | details[name] for name, end in result.ends.items()}
    first: Record = next(iter(ends.values()), {})
    record: Record = {
        "status": result.status,
        "title": result.scene.title,
        "answer": {"question": question, "found": told, "more": remarks},
        "load_factor": result.load_factor,
        "load_factor_negative": result.load_factor_negative,
        **{key: first.get(key, nothing) for key, nothing in FIRST.items()},
        **{key: first[key] for key in ("continuation", "worst_joint") if key in first},
        **{kind.key: first.get(kind.key) for kind in kinds},
        "ways": {name: words.way(name) for name in result.ends},
        "acceleration": words.acceleration,
        "words": {kind.seconds: [kind.option, kind.begins] for kind in timed},
        "reason": result.reason() or None,
        "stopped": result.stopped or None,
        "capacity": vars(result.curve_end) if result.curve_end else None,
    }
    for kind in kinds:
        if kind.by_direction:
            found = {name: end.answers.get(kind.name) for name, end in result.limits.items()}
            record[kind.key] = {name: one.record() for name, one in found.items() if one} or None
    counts = _record(result, "factorizations")
    return record | {
        "iterations": record["iterations"] | counts,
        "directions": ends,
        "seconds": {name: round(value, 4) for name, value in result.seconds.items()},
        **_made(),
        **more,
    }


def _end_record(result: ByDirection, end: Collapse) -> Record:
    """What is known of one end of the range of load factors. Collective."""
    words = replace(result.wording, units=result.scene.units.of_report)
    answers = [one.table(end, words) for one in end.told] if end.status == "limit" else []
    rows = [row for table in (end.table(), *answers) if not table.title for row in table.rows]
    apart = [table for table in answers if table.title and (table.rows or table.note)]
    # Nothing is proved by the last state of a load that is not limited.
    certificate = None if end.status == "unbounded" else end.certificate
    names = "error_estimate", "static_factor", "kinematic_factor", "residuals", "tolerances"
    return {
        **_record(end, "status", "load_factor", "engine"),
        "way": end.way or None,
        "gap": end.as_state.gap,
        "proof": end.proof or None,
        "is_lowest": bool(end.searched),
        "searched": end.searched or None,
        "tables": [vars(table) for table in (Table(rows), *apart)],
        "bounds": _record(end.bounds, *BRACKET),
        "reason": result.reason(end) or None,
        "rolling": end.rolling or None,
        "attempts": [dict(vars(trial)) for trial in end.attempts],
        "path": [dict(vars(point)) for point in end.trace],
        "states": [dict(vars(state)) for state in end.states],
        **_record(certificate, *names),
        "failures": sorted(certificate.failures) if certificate else [],
        "ties": tie_records(result.ties_of(end)),
        **{
            kind.key: end.answers[kind.name].record() if kind.name in end.answers else None
            for kind in Answer.kinds.values()
        },
    }


def _meshed_record(result: Result, end: Collapse) -> Record:
    """What blocks with a mesh do in a collapse, and how it was found. Collective."""
    moves = None
    if end.mode is not None and end.joints is not None and end.status != "unbounded":
        moves = mechanism_record(view_of_collapse(result.layout, end).blocks)
    history = end.history
    splitting = end.splitting
    method = history[-1].method if history else "auto"
    if method == "fixed-point" and splitting is not None:
        method = result.scene.solve.method
    record: Record = {
        "mechanism": moves,
        "wedged_blocks": result.wedged(end).tolist(),
        "method": method,
        "soil": [vars(one) for one in soil_forces(result.layout, end.joints)],
    }
    if end.path is not None:
        record["continuation"] = {
            "equilibrium_up_to": end.path.lower,
            "none_found_at": end.path.upper,
            "steps": [_record(step, "load_factor", "displacement") for step in end.path.steps],
        }
    worst = end.certificate and end.certificate.worst_joint
    if worst and end.status != "unbounded":
        joints = result.layout.joints
        place = joints.position[worst.point].tolist()
        group = joints.names[joints.law[worst.point]]
        record["worst_joint"] = vars(worst) | {"position": place, "group": group}
    steps = [step for one in history for step in one.steps]
    names = ("load_factor", "bound_change", "contraction", "relaxation", "factorizations")
    iterations: Record = {
        "fixed_point": len(steps),
        "contraction": history[0].contraction if history else None,
        "cycles": sum(one.cycles for one in history),
        "work_ratio": end.work_ratio,
        "history": [_record(step, *names) for step in steps],
    }
    if splitting is not None:
        counts = _record(splitting, "steps", "sweeps", "joint_steps", "contraction")
        iterations["splitting"] = {"proximal_steps": counts.pop("steps"), **counts}
    return record | {"iterations": iterations}


def _record(item: Any, *names: str) -> Record:
    """Some attributes of an item; None where there is no item."""
    return {name: None if item is None else getattr(item, name) for name in names}


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
        **_made(),
    }


def _made() -> Record:
    """Versions and date."""
    return {
        "version": __version__,
        "versions": compat.versions(),
        "date": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }


def tie_records(ties: Mapping[str, Any]) -> list[Record]:
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


def scene_record(layout: Layout) -> dict[str, Any]:
    """What was solved, as in a scene file, and what the mesh makes of it; the same on all ranks."""
    scene = layout.scene
    bodies = layout.bodies
    width, height = np.ptp(layout.boundary.points.reshape(-1, 2), axis=0).tolist()
    given = scene.tables()
    for load in given["loads"].values():
        if "form" in load:
            load["form"] = function_name(load["form"])
    forces = {name: getattr(bodies, name)[:, :2].sum(axis=0) for name in ("dead", "live")}
    return {
        **given,
        "plane": scene.plane,
        "thickness": scene.thickness,
        "degree": scene.degree,
        "size": {"width": width, "height": height, "area": layout.bodies_area()},
        "stress": function_name(scene.stress) or None,
        "resultants": {name: (force + 0.0).tolist() for name, force in forces.items()},
        "contacts": law_contacts(layout),
        "units": dict(UNITS),
    }
