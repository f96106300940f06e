"""Files of a result: result.json, ParaView files, pictures, the capacity curve as a table."""

from __future__ import annotations

import csv
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fenics_contact.analysis.certificate import Certificate
from fenics_contact.analysis.history import CapacityPoint
from fenics_contact.analysis.result import Collapse, Result
from fenics_contact.analysis.rigid_blocks import LimitBounds
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.joints import Joints
from fenics_contact.output.fields import write_paraview
from fenics_contact.output.plotting import draw_capacity, draw_collapse
from fenics_contact.version import __version__

#: What result.json says of `SolveOptions.slip`.
SLIP_REFERENCES = {"stress-free": "stress-free state", "load-steps": "previous load step"}

Record = dict[str, Any]


def write_result(result: Result, folder: Path) -> None:
    """Write everything the scene's output options ask for; the folder is made if need be.

    Collective. result.json is written last, so that its presence says that all is there.
    """
    start = time.perf_counter()
    comm, options = result.scene.comm, result.scene.output
    record = folder / "result.json"
    if comm.rank == 0:
        folder.mkdir(parents=True, exist_ok=True)
        record.unlink(missing_ok=True)
    comm.barrier()
    for direction, end in result.ends.items():
        # An unlimited load has a last state, but no collapse to be shown.
        if end.mode is None or end.status == "unbounded":
            continue
        suffix = "_negative" if direction == "negative" and len(result.ends) == 2 else ""
        if options.paraview:
            write_paraview(result.discretization, end, folder, suffix)
        if options.pictures:
            draw_collapse(result, direction, folder / f"collapse{suffix}.png")
    if result.capacity and comm.rank == 0:
        _write_capacity(result.capacity, folder / "capacity.csv")
        if options.pictures:
            draw_capacity(result, folder / "capacity.png")
    comm.barrier()
    result.seconds["write"] = time.perf_counter() - start
    if comm.rank == 0:
        partial = record.with_suffix(".part")
        partial.write_text(json.dumps(strict(result_record(result)), indent=2) + "\n")
        partial.replace(record)
    comm.barrier()


def result_record(result: Result) -> Record:
    """Content of result.json."""
    collapse = result.collapse
    record: Record = {
        "status": result.status,
        "title": result.scene.title,
        "load_factor": result.load_factor,
        "load_factor_negative": result.load_factor_negative,
        "bounds": _bounds_record(result.bounds),
        "method": None,
        "error_estimate": None,
        "residuals": None,
        "iterations": {"fixed_point": 0},
    }
    if collapse is not None:
        record |= _collapse_record(result, collapse)
    record["iterations"] |= {
        "factorizations": result.factorizations,
        "mode_factorizations": result.mode_factorizations,
    }
    if result.negative is not None and result.negative is not collapse:
        record["negative"] = {
            "status": result.negative.status,
            "bounds": _bounds_record(result.negative.bounds),
            **_collapse_record(result, result.negative),
        }
    return record | {
        "mesh": _mesh_record(result.discretization),
        "skipped": list(result.skipped),
        "control": result.scene.solve.control,
        "slip_reference": SLIP_REFERENCES[result.scene.solve.slip],
        "seconds": {name: round(value, 4) for name, value in result.seconds.items()},
        "ranks": result.scene.comm.size,
        "version": __version__,
    }


def _mesh_record(discretization: Discretization) -> Record:
    """Numbers of bodies, cells, displacements and joint points."""
    mesh = discretization.scene.mesh
    return {
        "bodies": mesh.body_count,
        "floating_bodies": int(discretization.bodies.floating.sum()),
        "cells": int(mesh.domain.topology.index_map(2).size_global),
        "dofs": 2 * int(discretization.elasticity.space.dofmap.index_map.size_global),
        "joint_points": len(discretization.joints.length),
    }


def _collapse_record(result: Result, collapse: Collapse) -> Record:
    """How one end of the range was found, and its verification."""
    if not collapse.history:
        return {}
    # Nothing is proved by the last state of a load that is not limited.
    certificate = None if collapse.status == "unbounded" else collapse.certificate
    method = collapse.history[-1].method
    if method == "fixed-point" and collapse.splitting is not None:
        method = result.scene.solve.method
    record: Record = {"method": method, "error_estimate": None, "residuals": None, "failures": []}
    if collapse.path is not None:
        record["continuation"] = {
            "equilibrium_up_to": collapse.path.lower,
            "none_found_at": collapse.path.upper,
            "steps": [_record(step, "load_factor", "displacement") for step in collapse.path.steps],
        }
    if collapse.states:
        names = ("start", "status", "load_factor")
        record["states"] = [_record(state, *names) for state in collapse.states]
    if certificate is not None:
        record |= _certificate_record(certificate, result.discretization.joints)
    return record | {"iterations": _iteration_record(collapse)}


def _certificate_record(certificate: Certificate, joints: Joints) -> Record:
    """Residuals, static and kinematic load factor, and the worst joint."""
    worst, law = certificate.worst_joint, joints.law
    record = _record(certificate, "error_estimate", "static_factor", "kinematic_factor")
    record |= {
        "residuals": dict(certificate.residuals),
        "failures": sorted(certificate.failures),
        "worst_joint": None if worst is None else _record(worst, "point", "law", "residual"),
    }
    if worst is not None:
        record["worst_joint"] |= {
            "position": joints.position[worst.point].tolist(),
            "group": joints.names[law[worst.point]],
        }
    return record


def _iteration_record(collapse: Collapse) -> Record:
    """Iterations of all states of one end."""
    steps = [step for history in collapse.history for step in history.steps]
    record: Record = {
        "fixed_point": len(steps),
        "contraction": collapse.history[0].contraction,
        "cycles": sum(history.cycles for history in collapse.history),
        "work_ratio": collapse.work_ratio,
    }
    if collapse.splitting is not None:
        counts = _record(collapse.splitting, "steps", "sweeps", "joint_steps", "contraction")
        record["splitting"] = {"proximal_steps": counts.pop("steps"), **counts}
    names = ("load_factor", "bound_change", "relaxation", "factorizations")
    return record | {"history": [_record(step, *names) for step in steps]}


def _record(item: Any, *names: str) -> Record:
    """Some attributes of an item."""
    return {name: getattr(item, name) for name in names}


def _bounds_record(bounds: LimitBounds | None) -> Record:
    lower, upper = (None, None) if bounds is None else (bounds.lower, bounds.upper)
    return {"lower": lower, "upper": upper}


def strict(value: Any) -> Any:
    """A record as strict JSON has it: numbers that are not finite are None."""
    if isinstance(value, dict):
        return {key: strict(item) for key, item in value.items()}
    if isinstance(value, list):
        return [strict(item) for item in value]
    if isinstance(value, float):
        return value + 0.0 if math.isfinite(value) else None
    return value


def _write_capacity(points: Sequence[CapacityPoint], path: Path) -> None:
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["displacement_m", "load_factor", "work", "converged"])
        table.writerows([p.displacement, p.load_factor, p.work, int(p.converged)] for p in points)
