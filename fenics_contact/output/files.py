"""Files of a result: result.json, ParaView files, the capacity curve as a table."""

from __future__ import annotations

import csv
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact import compat
from fenics_contact.analysis.certificate import Certificate
from fenics_contact.output.fields import displacement_function, stress_fields
from fenics_contact.output.joint_fields import STATES, JointFields, joint_fields
from fenics_contact.discretization.joints import Joints
from fenics_contact.limit_load import Collapse, LimitLoad

#: What result.json says of `SolveOptions.slip`.
SLIP_REFERENCES = {"stress-free": "stress-free state", "load-steps": "previous load step"}


def write_result(result: LimitLoad, folder: Path) -> None:
    """Write everything the scene's output options ask for.

    Collective. result.json is written last, so that its presence says that all is there.

    Args:
        result: What to write.
        folder: Where to; made if need be.
    """
    start = time.perf_counter()
    comm, options = result.scene.comm, result.scene.output
    if comm.rank == 0:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "result.json").unlink(missing_ok=True)
    comm.barrier()
    both = result.positive is not None and result.negative is not None
    for end, reverse in ((result.positive, False), (result.negative, True)):
        # An unlimited load has a last state, but no collapse to be shown.
        if end is None or end.state is None or end.mode is None or end.status == "unbounded":
            continue
        fields = joint_fields(result.structure, end.state, end.mode)
        suffix = "_negative" if reverse and both else ""
        if options.paraview:
            write_paraview(result, end, fields, folder, suffix)
        if options.pictures:
            from fenics_contact.output.plotting import draw_collapse

            draw_collapse(result, end, fields, folder / f"collapse{suffix}.png", reverse)
    if result.capacity and comm.rank == 0:
        _write_capacity(result, folder)
        if options.pictures:
            from fenics_contact.output.plotting import draw_capacity

            draw_capacity(result, folder / "capacity.png")
    comm.barrier()
    result.seconds["write"] = time.perf_counter() - start
    record = result_record(result)
    if comm.rank == 0:
        (folder / "result.json").write_text(json.dumps(record, indent=2) + "\n")
    comm.barrier()


def result_record(result: LimitLoad) -> dict[str, Any]:
    """The content of result.json; numbers that are not finite are None.

    Collective, because some counts are sums over ranks.
    """
    from fenics_contact import __version__

    structure, collapse = result.structure, result.collapse
    bounds = None if collapse is None else collapse.bounds
    record: dict[str, Any] = {
        "status": result.status,
        "title": result.scene.title,
        "load_factor": _number(result.load_factor),
        "load_factor_negative": _number(result.load_factor_negative),
        "bounds": {
            "lower": None if bounds is None else _number(bounds.lower),
            "upper": None if bounds is None else _number(bounds.upper),
        },
        "method": None,
        "error_estimate": None,
        "residuals": None,
        "iterations": {"fixed_point": 0, **_counts(result)},
    }
    if collapse is not None and collapse.history:
        record |= _iteration_record(result, collapse)
        record["iterations"] |= _counts(result)
    if result.positive is not None and result.negative is not None:
        negative = result.negative
        record["negative"] = {
            "status": negative.status,
            "bounds": {
                "lower": _number(negative.bounds.lower),
                "upper": _number(negative.bounds.upper),
            },
            **(_iteration_record(result, negative) if negative.history else {}),
        }
    return record | {
        "mesh": {
            "bodies": structure.scene.mesh.body_count,
            "floating_bodies": int(structure.bodies.floating.sum()),
            "cells": int(structure.scene.mesh.domain.topology.index_map(2).size_global),
            "dofs": int(structure.problem.dead.getSize()),
            "joint_points": len(structure.joints.length),
        },
        "skipped": list(result.plan.skipped),
        "control": result.scene.solve.control,
        "slip_reference": SLIP_REFERENCES[result.scene.solve.slip],
        "seconds": {name: round(value, 4) for name, value in result.seconds.items()},
        "ranks": result.scene.comm.size,
        "version": __version__,
    }


def _certificate_record(result: LimitLoad, certificate: Certificate, sign: float) -> dict[str, Any]:
    """Static and kinematic load factor of the state found, and its worst joint."""
    joints, worst = result.structure.joints, certificate.worst_joint
    record: dict[str, Any] = {
        "static_factor": _number(sign * certificate.static_factor),
        "kinematic_factor": _number(sign * certificate.kinematic_factor),
        "worst_joint": None,
    }
    if worst is not None:
        record["worst_joint"] = {
            "point": worst.point,
            "position": [float(x) for x in joints.position[worst.point]],
            "group": joints.names[joints.law[worst.point]],
            "law": worst.law,
            "residual": _number(worst.residual),
        }
    return record


def _method(result: LimitLoad, collapse: Collapse) -> str:
    """What made the last step: "monolithic", or how states with given friction were found."""
    made = collapse.history[-1].method
    return result.scene.solve.method if made == "fixed-point" and collapse.splitting else made


def _splitting_record(collapse: Collapse) -> dict[str, Any]:
    """What a method on joint forces did."""
    history = collapse.splitting
    if history is None:
        return {}
    return {
        "splitting": {
            "proximal_steps": history.steps,
            "sweeps": history.sweeps,
            "joint_steps": history.joint_steps,
            "contraction": _number(history.contraction),
        }
    }


def _path_record(collapse: Collapse, sign: float) -> dict[str, Any]:
    """What was found on the way, where it was asked for."""
    record: dict[str, Any] = {}
    if collapse.path is not None:
        path = collapse.path
        record["continuation"] = {
            "equilibrium_up_to": _number(sign * path.lower),
            "none_found_at": _number(sign * path.upper),
            "steps": [
                {
                    "load_factor": _number(sign * step.load_factor),
                    "displacement": _number(step.displacement),
                }
                for step in path.steps
            ],
        }
    if collapse.states:
        record["states"] = [
            {"start": s.start, "status": s.status, "load_factor": _number(sign * s.load_factor)}
            for s in collapse.states
        ]
    return record


def _iteration_record(result: LimitLoad, collapse: Collapse) -> dict[str, Any]:
    # Inside, the live load is reversed for the negative direction, not the load factor.
    sign = -1.0 if collapse is result.negative else 1.0
    steps = [step for history in collapse.history for step in history.steps]
    # Nothing is proved by the last state of a load that is not limited.
    certificate = None if collapse.status == "unbounded" else collapse.certificate
    return {
        **_path_record(collapse, sign),
        "method": _method(result, collapse),
        "error_estimate": _number(certificate.error_estimate) if certificate else None,
        "residuals": {name: _number(value) for name, value in certificate.residuals.items()}
        if certificate
        else None,
        "failures": sorted(certificate.failures) if certificate else [],
        **(_certificate_record(result, certificate, sign) if certificate else {}),
        "iterations": {
            "fixed_point": len(steps),
            "contraction": _number(collapse.history[0].contraction),
            "cycles": sum(history.cycles for history in collapse.history),
            "work_ratio": collapse.work_ratio,
            **_splitting_record(collapse),
            "history": [
                {
                    "load_factor": _number(step.load_factor),
                    "bound_change": _number(step.change),
                    "relaxation": _number(step.relaxation),
                    "factorizations": step.steps,
                }
                for step in steps
            ],
        },
    }


def _counts(result: LimitLoad) -> dict[str, int]:
    return {
        "factorizations": result.factorizations,
        "mode_factorizations": result.mode_factorizations,
    }


def _number(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value) + 0.0


def write_paraview(
    result: LimitLoad, end: Collapse, fields: JointFields, folder: Path, suffix: str = ""
) -> None:
    """Write blocks.pvd (displacement and mode by node, stress and body by cell) and joints.vtu.

    Args:
        result: Whose structure it is.
        end: A collapse with a state and a mode.
        fields: Its joints.
        folder: An existing folder.
        suffix: Added to the names of the files.
    """
    structure = result.structure
    if end.state is None or end.mode is None:
        return
    displacement = displacement_function(structure, end.state.displacement, "displacement")
    strained = displacement_function(
        structure, end.state.strained or end.state.displacement, "strained"
    )
    mode = displacement_function(structure, end.mode, "collapse_mode")
    compat.write_vtk(
        folder / f"blocks{suffix}.pvd",
        [displacement, mode, *stress_fields(structure, strained)],
    )
    if result.scene.comm.rank == 0:
        write_joints(folder / f"joints{suffix}.vtu", structure.joints, fields)


def write_joints(path: Path, joints: Joints, fields: JointFields) -> None:
    """Write the joints as lines with values at their points, an XML file of VTK.

    Every joint point is a point of the file: "pressure" and "shear" in Pa, "gap" and "slip" in m,
    "state" 0 open, 1 slip, 2 stick, and the normal from the first side to the second.
    """
    columns = {
        "pressure": fields.pressure,
        "shear": fields.shear,
        "gap": fields.gap,
        "slip": fields.slip,
        "opening_rate": fields.opening_rate,
        "slip_rate": fields.slip_rate,
        "state": fields.state,
        "normal": _in_3d(joints.normal),
        "force": _in_3d(
            fields.normal_force[:, None] * joints.normal
            + fields.shear_force[:, None] * joints.tangent
        ),
    }
    cells = len(joints.segments)
    data = "\n".join(_vtk_array(name, values) for name, values in columns.items())
    path.write_text(
        f"""<?xml version="1.0"?>
<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">
<!-- state: {", ".join(f"{number} {name}" for number, name in enumerate(STATES))} -->
<UnstructuredGrid><Piece NumberOfPoints="{len(joints.length)}" NumberOfCells="{cells}">
<Points>
{_vtk_array("points", _in_3d(joints.position))}
</Points>
<Cells>
{_vtk_array("connectivity", joints.segments)}
{_vtk_array("offsets", 2 * np.arange(1, cells + 1))}
{_vtk_array("types", np.full(cells, 3), kind="UInt8")}
</Cells>
<PointData>
{data}
</PointData>
</Piece></UnstructuredGrid>
</VTKFile>
"""
    )


def _in_3d(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.column_stack([values, np.zeros(len(values))])


def _vtk_array(name: str, values: npt.NDArray[Any], kind: str | None = None) -> str:
    if kind is None:
        kind = "Int64" if values.dtype.kind == "i" else "Float64"
    width = values.shape[1] if values.ndim > 1 and name != "connectivity" else 1
    text = " ".join(f"{value:.12g}" for value in values.ravel())
    return (
        f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{width}" format="ascii">'
        f"{text}</DataArray>"
    )


def _write_capacity(result: LimitLoad, folder: Path) -> None:
    with (folder / "capacity.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["displacement_m", "load_factor", "work", "converged"])
        for point in result.capacity:
            table.writerow(
                [point.displacement, point.load_factor, point.work, int(point.converged)]
            )
