"""What `fenics-contact stands` does: the state under the dead load, or at a given load factor."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mpi4py import MPI

from fenics_contact.equilibrium import Equilibrium, standing
from fenics_contact.errors import InputError
from fenics_contact.exit_codes import EXIT_CODES
from fenics_contact.geometry.mesh import BlockMesh
from fenics_contact.scene.scene import Scene
from fenics_contact.scene.toml_tables import read_toml

#: What the answer is, by status.
ANSWERS: Mapping[str, str] = {
    "equilibrium": "it stands",
    "unstable": "it does not stand",
    "no_equilibrium": "it does not stand",
    "not_converged": "not known",
}
#: What it is without a proof of "no_equilibrium".
NOT_PROVED = "no equilibrium was found"


def find_state(options: argparse.Namespace, comm: MPI.Comm) -> Equilibrium:
    """The state that the command asks for."""
    factor = options.load_factor
    return standing(_scene(options.scene, comm, options.overrides, factor), factor)


def told(found: Equilibrium) -> str:
    """The answer, and what it rests on, for people."""
    load = f"at load factor {found.load_factor:g}" if found.load_factor else "under its dead load"
    acting = "loads." if found.load_factor else "loads.dead."
    warnings = [
        f"warning: {text}"
        for text in found.layout.warnings
        if text.startswith(acting) or not text.startswith("loads.")
    ]
    answer = NOT_PROVED if found.status == "no_equilibrium" and not found.proved else None
    return "\n".join([*warnings, f"{answer or ANSWERS[found.status]} {load}", found.summary()])


def exit_code(found: Equilibrium) -> int:
    """The code with which the command ends."""
    return EXIT_CODES.get(found.status, 0)


def _scene(path: Path, comm: MPI.Comm, overrides: Sequence[str], factor: float) -> Scene:
    """The scene of a file, which needs no live load where none acts."""
    tables = read_toml(path, comm, overrides)
    loads = tables.get("loads")
    if factor == 0.0 and isinstance(loads, dict) and "live" not in loads:
        loads["live"] = _any_load(loads.get("dead"))
    return Scene.from_tables(
        tables, lambda file, blocks: BlockMesh.from_file(path.parent / file, comm, blocks)
    )


def _any_load(dead: Any) -> Any:
    """A live load that acts on the blocks, to be multiplied by 0: as the dead load."""
    if not dead:
        raise InputError(
            "loads.dead is missing; give [loads.dead], which the structure is to stand"
        )
    if not isinstance(dead, dict):
        return dead
    return {key: value for key, value in dead.items() if key != "movement"}
