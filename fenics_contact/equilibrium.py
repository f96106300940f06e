"""The state of a scene at a given load factor: service loads, and contact without a limit load."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from fenics_contact.collapse.load_case import LoadCase
from fenics_contact.collapse.reasons import within
from fenics_contact.collapse.rigid_blocks.programs import RigidBlocks
from fenics_contact.collapse.service_state import (
    face_state,
    rests,
    service_state,
    without_equilibrium,
)
from fenics_contact.console import state_lines
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.discretization.layout import Layout
from fenics_contact.discretization.warnings import turn_in
from fenics_contact.errors import InputError, SolverError, Stopped, checked
from fenics_contact.geometry.mesh import Indices
from fenics_contact.output.files import write_service_state
from fenics_contact.output.pictured import Pictured
from fenics_contact.output.view import NO_LOAD, Caption, View, view_of, view_of_fall
from fenics_contact.results.block_view import JOINT_STATES
from fenics_contact.results.result import ServiceState, Shown
from fenics_contact.results.values import (
    falling_blocks,
    soil_forces,
    soil_lines,
    tension_lines,
)
from fenics_contact.results.wording import state_in_words, wording_of
from fenics_contact.scene.scene import Scene

#: What is said of a state that the forces of faces give.
BY_FACES = "by the forces of joint faces; the blocks are strained by these forces"


@dataclass(frozen=True, kw_only=True, repr=False)
class Equilibrium(ServiceState, Pictured):
    """Result of `equilibrium`, with its fields, pictures and files.

    Attributes:
        layout: Blocks, joints and supports of the scene as arrays.
        factorizations: Numeric factorisations.
        seconds: Time that it took, s.
    """

    layout: Layout
    factorizations: int
    seconds: float = 0.0

    def __repr__(self) -> str:
        return f"<Equilibrium: {self.status}, load factor {self.load_factor:.8g}>"

    def _shown(self) -> Shown:
        return Shown(self.joint_values, self.state)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is legal in the scene and probably meant otherwise."""
        return self.layout.warnings

    @property
    def falling(self) -> Indices:
        """Numbers of the blocks that fall where the status is "unstable"; none else."""
        return falling_blocks(self.layout, self.fall)

    def summary(self, verbose: bool = False) -> str:
        """Whether it stands, its ties and soils, as text.

        Args:
            verbose: With verification, joints that open or slide, work and time.
        """
        words = wording_of(self.layout.scene, self.layout.bodies.live[:, :2].sum(axis=0))
        at = words.under(self.load_factor)
        lines = [state_in_words(self.status, at, self.reason, self.proved)]
        if self.joint_values is not None:
            held = tension_lines(self.ties, words.units)
            held += soil_lines(soil_forces(self.layout, self.joint_values), words.units)
            if self.engine == "faces":  # which tell of one of many
                among = "in one of its equilibria:"
                held = [replace(line, head=f"{line.head.rstrip(':')} {among}") for line in held]
            lines += words.merged([("", line) for line in held], [""])
        if not verbose:
            return "\n".join(lines)
        lines += ["", *state_lines(self.status, self.load_factor, self.reason, self.residuals)]
        if self.status == "equilibrium":
            lines += [BY_FACES] if self.engine == "faces" else []
        if self.joint_values is not None:
            state = self.joints["state"]
            counts = (f"{np.sum(state == one)} {one.name.lower()}" for one in JOINT_STATES)
            lines.append(f"joint points: {', '.join(counts)}")
        return "\n".join([*lines, f"{self.factorizations} factorisations, {self.seconds:.2f} s"])

    @checked
    def write(self, folder: str | Path) -> None:
        """Write result.json, and pictures and ParaView files as the scene's output options say.

        The folder is made. The pictures are state.png (displacements and joint forces), thrust.png
        and stress.png, or collapse.png with the blocks that fall. Collective.

        Raises:
            OutputError: On all ranks, if a file cannot be written; the folder is then as it was.
        """
        numbers = {"factorizations": self.factorizations, "seconds": self.seconds}
        drawn = self.state is not None or self.fall is not None
        view = self._view() if drawn else None
        write_service_state(self, self.layout, view, numbers, Path(folder))

    def _view(self) -> View:
        """Displacements and joint forces, or the blocks that fall. Collective."""
        if self.fall is not None:
            return view_of_fall(self.layout, self.fall)
        if self.state is None:
            raise SolverError(f"there is no state to draw: the status is '{self.status}'")
        sign = math.copysign(1.0, self.load_factor)
        view = view_of(self.layout, self.state.displacement, self.joint_values, sign)
        if self.load_factor == 0.0:
            view = replace(view, live=NO_LOAD)
        at = f"at load factor {self.load_factor:.6g}"
        doubt = "" if self.status == "equilibrium" else ", not verified"
        return replace(view, caption=Caption(f"displacements x {{}}{doubt}", at + doubt))


@checked
def equilibrium(scene: Scene, load_factor: float = 1.0, steps: int = 1) -> Equilibrium:
    """Find the state of a scene under its dead load and a multiple of its live load. Collective.

    With `slip = "stress-free"` friction resists the slip from the stress-free state, and the number
    of steps does not matter. With `slip = "load-steps"` it resists the slip of each step, the dead
    load being the first.

    Args:
        scene: What to solve.
        load_factor: Multiple of the live load.
        steps: Equal steps of the live load; they are halved where no state is found.

    Returns:
        The state; look at its status.

    Raises:
        InputError: If joints, supports or loads of the scene do not fit its mesh, the load factor
            is not finite, or there is no step.
    """
    if steps < 1:
        raise InputError(f"steps = {steps} must be 1 or more")
    return _found(scene, load_factor, partial(service_state, steps=steps))


@checked
def standing(scene: Scene, load_factor: float = 0.0) -> Equilibrium:
    """Whether a scene stands under its dead load and a multiple of its live load. Collective.

    Cheaper than `equilibrium`: programs of rigid blocks and the forces of joint faces tell, and the
    blocks are strained by these forces. Elastic blocks are asked where a support moves, where sides
    are curved, or where faces come to no state.

    Args:
        scene: What stands, or not.
        load_factor: Multiple of the live load.

    Returns:
        The state; look at its status.

    Raises:
        InputError: As `equilibrium` does.
    """

    def told_by_faces(case: LoadCase, load_factor: float) -> ServiceState:
        return face_state(case, load_factor) or service_state(case, load_factor)

    return _found(scene, load_factor, told_by_faces)


@checked
def stands(scene: Scene) -> bool:
    """Whether the dead load of a scene alone has a state of equilibrium. Collective.

    True says that joint faces have an elastic state with Coulomb's law, from rest, for which no
    matrix of the blocks is factored, or that elastic blocks have one; False that there is none:
    rigid blocks with associative friction prove it. `equilibrium(scene, 0)` has the state, or the
    blocks that fall.

    Args:
        scene: What stands, or not.

    Raises:
        InputError: As `equilibrium` does.
        SolverError: If neither was found; the message says why.
    """
    _check(scene, 0.0)
    with Discretization(scene) as made:
        if RigidBlocks.of(made, 1.0, made.effort.wait).stands() and rests(made):
            return True
    found = equilibrium(scene, 0.0)
    if not found.proved:
        raise SolverError(f"neither a state nor a proof that there is none: {found.reason}")
    return found.status == "equilibrium"


def _found(
    scene: Scene, load_factor: float, find: Callable[[LoadCase, float], ServiceState]
) -> Equilibrium:
    """The state at a load factor that programs do not rule out, as it is found."""
    start = time.perf_counter()
    _check(scene, load_factor)
    sign = math.copysign(1.0, load_factor)
    with Discretization(scene) as made:
        blocks = RigidBlocks.of(made, sign, made.effort.wait)
        found = without_equilibrium(made.layout, blocks, abs(load_factor), sign)
        if found is None:
            made.end_when(within(scene.solve.time))
            try:
                case = LoadCase.of(made, made.bonded(), sign, lambda step: None)
                found = find(case, abs(load_factor))
            except Stopped as stop:
                found = ServiceState("not_converged", load_factor, reason=str(stop))
        if found.status == "equilibrium" and found.joint_values is not None:
            forces = found.joint_values.normal_force
            if turned := turn_in(made.joints.without_ties(), forces):  # a contact has rolled
                found = replace(found, status="not_converged", reason=turned)
        count = made.factorizations()
    took = time.perf_counter() - start
    return Equilibrium(**vars(found), layout=made.layout, factorizations=count, seconds=took)


def _check(scene: Scene, load_factor: float) -> None:
    """Raise `InputError` for what `equilibrium` cannot be asked."""
    if not math.isfinite(load_factor):
        raise InputError(f"load_factor = {load_factor} must be finite")
    if any(law.loses for law in (*scene.joints.values(), *scene.foundations.values())):
        raise InputError("equilibrium() knows no opened = 'lost'; give joints opened = 'kept'")
