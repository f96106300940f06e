"""The way after the peak as an answer of a collapse, and the check of the code along it."""

from __future__ import annotations

import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from fenics_contact.answers.question import Asked
from fenics_contact.answers.seismic import NOT_FOLLOWED, SeismicAnswer, SeismicCheck
from fenics_contact.geometry.mesh import Array
from fenics_contact.motion.beyond import Beyond, beyond
from fenics_contact.motion.check import NonlinearCheck, Spectrum, nonlinear_check
from fenics_contact.motion.files import draw_beyond, with_way, write_poses, write_table
from fenics_contact.results.block_view import BlockView
from fenics_contact.results.result import Collapse, Table
from fenics_contact.results.wording import Line, Wording
from fenics_contact.scene.scene import OutputOptions
from fenics_contact.spatial.question import BlockQuestion
from fenics_contact.spatial.scene import BlockScene
from fenics_contact.spatial.structure import Structure

_log = logging.getLogger("fenics_contact")

NO_BEGIN = "no state that the live load drives was found to begin from: nothing is told of the way"
#: Title of its table.
TITLE = "After the peak"
#: Motions off a plane above this part of all are told.
TWISTS = 0.1


class BeyondAnswer(Asked):
    """What is left of a limit in large displacements, a `Beyond`."""

    value: Beyond
    name = key = "beyond"
    place = 9
    begins = "after the peak"
    asks = BlockQuestion
    by_direction = with_fast = True

    @classmethod
    def concerns(cls, question: BlockQuestion) -> bool:
        """Whether the scene asks for the way after the peak, or for what needs it."""
        seismic = question.scene.seismic
        return bool(question.options.beyond) or (seismic is not None and seismic.nonlinear)

    @classmethod
    def run(cls, question: BlockQuestion) -> tuple[Self | None, Collapse]:
        """The way, and the seismic check with the non-linear one."""
        scene, structure, end = question.scene, question.structure, question.end
        asked = scene.solve.beyond
        until = math.inf if isinstance(asked, bool) else float(asked)
        stop = {"control": scene.output.control, "check_stop": question.check_stop}
        way = beyond(structure, end, until=until, **stop)
        start = end.answers.get(SeismicAnswer.name)
        if start is not None and start.value.missing:
            missing = without_check(way)
            further = None
            if way is not None and not missing:
                further = check_along(scene, structure, end, way, start.value)
            check = replace(start.value, nonlinear=further, missing=missing)
            end = end.with_answer(SeismicAnswer(check))
        if way is None:
            _log.warning("warning: solve.beyond: %s", NO_BEGIN)
            return None, end
        return cls(way), end

    def lines(self, end: Collapse, words: Wording) -> list[Line]:
        """The way, and how far it is to be trusted."""
        way = self.value
        lines = [Line(way.head, way.text)]
        if way.left_out:
            lines.append(Line("after the peak is left out:", " and ".join(way.left_out)))
        return [*lines, Line("the way after the peak:", way.checks, verbose=True)]

    def table(self, end: Collapse, words: Wording) -> Table:
        """Load factors at parts of the way."""
        found = self.value
        points = [found.end * part for part in (0.0, 0.25, 0.5, 0.75, 1.0)]
        rows = [(f"{at:.3g} m", found.amount(at)) for at in points]
        return Table(rows, TITLE, ("displacement", "carried"), " ".join(found.sentences()) + ".")

    def record(self) -> dict[str, Any]:
        """For result.json."""
        return self.value.record()

    def seen(self, view: BlockView) -> BlockView:
        """Its viewer goes through the poses."""
        return with_way(self.value, view)

    def write(self, folder: Path, view: BlockView, output: OutputOptions) -> None:
        """Write beyond.csv, and what is asked for of beyond.pvd and beyond.png."""
        write_table(self.value, folder / f"beyond{view.suffix}.csv")
        if output.paraview:
            write_poses(self.value, view, folder)
        if output.pictures:
            draw_beyond(self.value, view, folder, output.formats)


def without_check(way: Beyond | None) -> str:
    """Why no non-linear check is made along a way, in words; empty where it is."""
    if way is None:
        return "no state was found to begin from"
    if way.driven:
        return "the ground moves on"
    if not way.is_twice:
        return NOT_FOLLOWED
    if len(way.trusted) < 2:
        return "two ways part at once"
    least = min(point.load_factor for point in way.trusted[:-1])
    return "nothing is left before the end of the way" * (least <= 0.0)


def check_along(
    scene: BlockScene, structure: Structure, found: Collapse, way: Beyond, start: SeismicCheck
) -> NonlinearCheck | None:
    """The non-linear check of a limit, whose mechanism starts as is known, along the trusted way.

    The control point is that of the scene; by default the mean of the masses that are pushed, whose
    displacement is the live load's work over its force.
    """
    options = scene.seismic
    if options is None or options.spectrum is None:
        return None
    gravity, push = (float(np.linalg.norm(load.acceleration)) for load in (scene.dead, scene.live))
    here, factor = np.array([(one.displacement, one.load_factor) for one in way.trusted]).T
    ratio = 1.0 / start.mass_fraction
    if scene.output.control is None:
        work = np.array([point.work for point in way.trusted])
        here = work / (start.moving_mass * push)
    else:
        mode = np.asarray(found.mode)
        moment = float(np.vdot(structure.live, mode)) * found.sign / push
        ratio = moment / (start.participating_mass * way.control.velocity(mode))
    lost = math.inf if options.lost is None else options.lost
    remarks = []
    if way.zero is None:
        remarks.append("d_0 is the end of the path, where something is left")
    if twists(np.asarray(found.mode), structure.size):
        remarks.append("the code is calibrated for motions parallel to one plane, this one twists")
    return nonlinear_check(
        np.abs(here) * ratio,
        np.abs(factor) * push / (start.mass_fraction * options.confidence_factor),
        Spectrum.of(options.spectrum, gravity),
        gravity=gravity,
        limit_state=options.limit_state,
        lost=lost * ratio,
        free=options.period,
        remarks=remarks,
    )


def twists(mode: Array, size: float) -> bool:
    """Whether the motions of blocks are not parallel to one plane.

    With its normal u they would have v . u = 0 and w x u = 0.
    """
    shift, turn = mode[:, :3], size * mode[:, 3:]
    apart = shift.T @ shift + np.sum(turn**2) * np.eye(3) - turn.T @ turn
    return bool(np.linalg.eigvalsh(apart)[0] > TWISTS**2 * np.trace(apart))
