"""A result that can be looked at: plotted, moved by a slider in a notebook, animated."""

from __future__ import annotations

import io
from abc import ABC, abstractmethod
from functools import partial
from pathlib import Path
from typing import Any

from fenics_contact.discretization.layout import Layout
from fenics_contact.errors import InputError, OutputError, SolverError
from fenics_contact.errors.checks import checked
from fenics_contact.errors.texts import plain
from fenics_contact.geometry.mesh import Array
from fenics_contact.output.animation import animate, check_animation
from fenics_contact.output.folder import writing
from fenics_contact.output.plotting import (
    Draw,
    check_axes,
    draw_forces,
    draw_mode,
    draw_stress,
    draw_thrust,
    new_axes,
    save,
)
from fenics_contact.output.slider import check_slider, slider
from fenics_contact.output.stress_raster import stress_raster
from fenics_contact.output.view import View


class Pictured(ABC):
    """Pictures of a result, from what `_view` says of it.

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
    def _elastic(self) -> Array | None:
        """Displacements that strain the blocks, this rank's part; None if there is no state."""

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
        check_axes(axes)
        view = self._view().scaled(_scale(scale))
        return self._drawn(draw_mode, axes, view)

    def plot_forces(self, axes: Any = None) -> Any:
        """Draw the joint forces; as `plot`."""
        check_axes(axes)
        return self._drawn(draw_forces, axes, self._view_with_forces())

    def plot_thrust(self, axes: Any = None) -> Any:
        """Draw the lines of thrust that reach the ground; as `plot`."""
        check_axes(axes)
        return self._drawn(draw_thrust, axes, self._view_with_forces())

    def plot_stress(self, axes: Any = None) -> Any:
        """Draw the principal stresses; as `plot`."""
        check_axes(axes)
        view = self._view()
        elastic = self._elastic()
        if elastic is None:
            raise SolverError("no stresses to draw: the blocks fall")
        raster = stress_raster(self.layout, elastic)
        return self._drawn(partial(draw_stress, raster=raster), axes, view)

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
        path = Path(path)
        check_animation(path, seconds)
        view = self._view().scaled(_scale(scale))
        comm = self.layout.scene.comm
        try:
            with writing(comm):
                if comm.rank == 0:
                    animate(view, path, seconds)
        except OutputError as error:
            raise OutputError(f"cannot write '{path}': {error}") from None

    @checked
    def slider(self, scale: float = 1.0) -> Any:
        """A picture for a notebook, with a slider that moves the blocks; needs ipywidgets.

        Args:
            scale: As of `plot`; the slider goes up to this.

        Returns:
            The widget on rank 0, else None. Collective.

        Raises:
            InputError: If ipywidgets is missing.
            SolverError: If there is nothing to draw.
        """
        check_slider()
        view = self._view().scaled(_scale(scale))
        return slider(view) if self.layout.scene.comm.rank == 0 else None

    def _repr_png_(self) -> bytes | None:
        """Motion and joint forces, for a notebook. Collective."""
        try:
            view = self._view()
        except SolverError:
            return None
        file = io.BytesIO()
        draws = [draw_mode] if view.values is None else [draw_mode, draw_forces]
        if self.layout.scene.comm.rank == 0:
            save(view, plain(repr(self)[1:-1]), [file], *draws)
        return file.getvalue()

    def _view_with_forces(self) -> View:
        """What `_view` says, if it has joint forces. Collective."""
        view = self._view()
        if view.values is None:
            raise SolverError("there are no joint forces to draw: no state was found")
        return view

    def _drawn(self, draw: Draw, axes: Any, view: View) -> Any:
        """Axes with a picture, on rank 0."""
        if self.layout.scene.comm.rank != 0:
            return None
        return draw(new_axes() if axes is None else axes, view)


def _scale(scale: float) -> float:
    """A factor on displacements, checked."""
    if not 0.0 <= scale < 1e3:
        raise InputError(f"scale = {scale} must lie in 0 ... 1000")
    return scale
