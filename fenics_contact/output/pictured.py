"""Results that can be looked at: plots, a slider for notebooks, films; their stresses in UFL.

Films are GIF, or MP4 by ffmpeg. A slider is that of the report.
"""

from __future__ import annotations

import io
import os
import tempfile
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.discretization.forms import measures, stress_of
from fenics_contact.discretization.layout import Layout
from fenics_contact.errors import InputError, OutputError, SolverError, checked, plain
from fenics_contact.lazily import fem
from fenics_contact.output.fields import displacement_function, stress_raster
from fenics_contact.output.folder import writing
from fenics_contact.output.plotting import (
    Draw,
    check_axes,
    draw_forces,
    draw_mode,
    draw_stress,
    draw_thrust,
    frame,
    new_axes,
    save,
    structure_figure,
)
from fenics_contact.output.view import View
from fenics_contact.results.result import Shown
from fenics_contact.results.values import (
    NamedArrays,
    block_arrays,
    joint_arrays,
    tie_arrays,
)

#: Of a film: pictures per second, so that motion looks smooth and files stay small; part of the
#: time at the end in which nothing moves; pixels per inch, for some 900 pixels of width; its
#: longest time, s, as 1 500 pictures take minutes.
RATE, STILL, RESOLUTION, LONGEST = 15, 0.25, 110, 100.0
#: Matplotlib's writers by ending of the file.
WRITERS = {".gif": "pillow", ".mp4": "ffmpeg"}


@dataclass(frozen=True)
class MovingPicture:
    """Blocks that a slider moves, as HTML that needs no other file."""

    html: str

    def _repr_html_(self) -> str:
        return self.html


class Pictured(ABC):
    """Arrays, fields and pictures of a result, from what `_view` and `_shown` say of it.

    On several ranks all must call these methods; rank 0 draws and writes.
    """

    layout: Layout

    @abstractmethod
    def _view(self) -> View:
        """Blocks, motion and joint forces to draw. Collective.

        Raises:
            SolverError: If there is nothing to draw.
        """

    @abstractmethod
    def _shown(self) -> Shown:
        """The state that arrays and fields show."""

    @property
    def joints(self) -> NamedArrays:
        """Arrays over all joint points by name, the same on all ranks; see `joint_arrays`."""
        return joint_arrays(self.layout, self._shown().values)

    @property
    def ties(self) -> NamedArrays:
        """Arrays over the bars of all ties by name, the same on all ranks; see `tie_arrays`."""
        return tie_arrays(self.layout, self._shown().values)

    @property
    def blocks(self) -> NamedArrays:
        """Arrays over all blocks by name, the same on all ranks; see `block_arrays`.

        Collective: ask for motions on all ranks together.
        """
        _, state, mode = self._shown()
        return block_arrays(self.layout, None if state is None else state.displacement, mode)

    @property
    def displacement(self) -> fem.Function | None:
        """Displacements at the state, m, a dolfinx function; None if there is none."""
        state = self._shown().state
        if state is None:
            return None
        return displacement_function(self.layout, state.displacement, "displacement")

    @checked
    def plot(self, axes: Any = None, scale: float = 1.0) -> Any:
        """Draw how the blocks move. Collective; returns the axes on rank 0, else None.

        Args:
            axes: Matplotlib's axes to draw into; those of a new figure by default.
            scale: Factor on the displacements that are drawn. With 1 the largest is 8 % of the
                structure's size.

        Raises:
            SolverError: If there is nothing to draw.
        """
        return self._drawn(draw_mode, axes, scale)

    def plot_forces(self, axes: Any = None) -> Any:
        """Draw the joint forces; as `plot`."""
        return self._drawn(draw_forces, axes)

    def plot_thrust(self, axes: Any = None) -> Any:
        """Draw the lines of thrust that reach the ground; as `plot`."""
        return self._drawn(draw_thrust, axes)

    def plot_stress(self, axes: Any = None) -> Any:
        """Draw the principal stresses; as `plot`."""
        return self._drawn(draw_stress, axes)

    def _drawn(self, draw: Any, axes: Any, scale: float = 1.0) -> Any:
        """Axes with a picture, on rank 0. Collective."""
        check_axes(axes)
        view = self._scaled(scale)
        if draw in (draw_forces, draw_thrust) and view.faces is None:
            raise SolverError("there are no joint forces to draw: no state was found")
        if draw is draw_stress:
            state = self._shown().state
            if state is None:
                raise SolverError("no stresses to draw: the blocks fall")
            view = replace(view, stress=stress_raster(self.layout, state.elastic))
        if self.layout.scene.comm.rank != 0:
            return None
        return draw(new_axes() if axes is None else axes, view)

    def _scaled(self, scale: float) -> View:
        """What pictures show, with displacements times a factor, which is checked. Collective."""
        if not 0.0 <= scale < 1e3:
            raise InputError(f"scale = {scale} must lie in 0 ... 1000")
        return self._view().scaled(scale)

    @checked
    def animate(self, path: str | Path, scale: float = 1.0, seconds: float = 3.0) -> None:
        """Write the motion of the blocks as a GIF, or as MP4 where ffmpeg is installed. Collective.

        Args:
            path: File that ends with .gif or .mp4; rank 0 writes it.
            scale: As of `plot`.
            seconds: How long it takes.

        Raises:
            InputError: If the file has another ending, or ffmpeg is missing.
            SolverError: If there is nothing to draw.
            OutputError: If the file cannot be written.
        """
        from matplotlib import animation

        path = Path(path)
        writer = WRITERS.get(path.suffix.lower())
        if writer is None:
            raise InputError(f"path = '{path}' must end with {' or '.join(WRITERS)}")
        if not animation.writers.is_available(writer):
            raise InputError(f"'{path}' needs {writer}, which is not installed; write a .gif")
        if not 0.0 < seconds <= LONGEST:
            raise InputError(f"seconds = {seconds} must lie in 0 ... {LONGEST:g}, without 0")
        view = self._scaled(scale)
        comm = self.layout.scene.comm
        try:
            with writing(comm):
                if comm.rank == 0:
                    _write_film(view, path, animation.writers[writer](fps=RATE), seconds)
        except OutputError as error:
            raise OutputError(f"cannot write '{path}': {error}") from None

    @checked
    def slider(self, scale: float = 1.0) -> MovingPicture | None:
        """The blocks with a slider that moves them, for a notebook.

        It is HTML and a script, and needs no kernel: it stays in a notebook that is exported.

        Args:
            scale: As of `plot`, where the page opens; the slider goes up to 1.5 times this.

        Returns:
            The picture on rank 0, else None. Collective.

        Raises:
            SolverError: If there is nothing to draw.
        """
        view = self._scaled(scale)
        if self.layout.scene.comm.rank != 0:
            return None
        from fenics_contact.output.report.html import viewer_frame
        from fenics_contact.output.report.viewer import viewer_page

        return MovingPicture(viewer_frame(viewer_page({"positive": view.blocks})))

    def _repr_png_(self) -> bytes | None:
        """Motion and joint forces, for a notebook. Collective."""
        try:
            view = self._view()
        except SolverError:
            return None
        file = io.BytesIO()
        draws: list[Draw] = [draw_mode] if view.faces is None else [draw_mode, draw_forces]
        if self.layout.scene.comm.rank == 0:
            save(view, plain(repr(self)[1:-1]), [file], *draws)
        return file.getvalue()

    @property
    def stress(self) -> Any | None:
        """Stress in the plane, Pa, a UFL tensor on `scene.mesh.domain`; None if there is no state.

        It is that of the scene's plane state or stress law, of the part of the displacements that
        strains the blocks: beside a large motion the sum has fewer digits. Collective.
        """
        state = self._shown().state
        if state is None:
            return None
        return stress_of(
            displacement_function(self.layout, state.elastic, "elastic"), self.layout.law
        )

    def measures(self) -> tuple[Any, Any]:
        """UFL's dx over the blocks and ds over their edges, both faces of joints among these.

        They take names of groups: `dx("stone")`, `ds(("back", "top"))`.
        """
        return measures(self.layout.scene.mesh, self.layout.boundary)


def _draw_moment(axes: Any, view: View, share: float) -> None:
    """A part of the motion of a view, with room for all of it."""
    axes.clear()
    frame(axes, view, view.moved)
    draw_mode(axes, view.scaled(share))


def _moving_axes(view: View) -> Any:
    """Axes of a figure of their own, which show the whole motion and keep their place."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = structure_figure(view, 1)
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    _draw_moment(axes, view, 1.0)
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine(None)  # it would move the axes from picture to picture
    return axes


def _write_film(view: View, path: Path, writer: Any, seconds: float) -> None:
    """Write the motion of a view, slow, fast, slow, on this rank; the file appears complete.

    Raises:
        OSError: If it cannot be written.
    """
    axes = _moving_axes(view)
    count = max(2, round(seconds * RATE))
    moving = max(2, round(count * (1.0 - STILL)))
    rising = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, moving))
    with tempfile.TemporaryDirectory(prefix=".writing-", dir=path.parent) as folder:
        unfinished = Path(folder, path.name)
        with writer.saving(axes.figure, unfinished, RESOLUTION):
            for share in (*rising.tolist(), *[1.0] * (count - moving)):
                _draw_moment(axes, view, share)
                writer.grab_frame()
        os.replace(unfinished, path)
