"""The motion of blocks as a film: GIF, or MP4 by ffmpeg."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.errors import InputError
from fenics_contact.output.drawing import frame
from fenics_contact.output.plotting import draw_mode, structure_figure
from fenics_contact.output.view import View


@dataclass(frozen=True)
class AnimationOptions:
    """Numbers of an animation.

    Attributes:
        rate: Pictures per second: motion looks smooth, and files stay small.
        still: Part of the time at the end in which nothing moves, to look at the mechanism.
        resolution: Pixels per inch, so that the picture is some 900 pixels wide.
        longest: Of an animation, s: 1 500 pictures take minutes.
    """

    rate: int = 15
    still: float = 0.25
    resolution: int = 110
    longest: float = 100.0


OPTIONS = AnimationOptions()

#: Matplotlib's writers by ending of the file.
WRITERS = {".gif": "pillow", ".mp4": "ffmpeg"}


def check_animation(path: Path, seconds: float) -> None:
    """Refuse files that cannot be made.

    Raises:
        InputError: If the ending is another than .gif and .mp4, ffmpeg is missing, or the time
            makes no sense.
    """
    from matplotlib import animation

    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError(f"path = '{path}' must end with {' or '.join(WRITERS)}")
    if not animation.writers.is_available(writer):
        raise InputError(f"'{path}' needs {writer}, which is not installed; write a .gif")
    if not 0.0 < seconds <= OPTIONS.longest:
        raise InputError(f"seconds = {seconds} must lie in 0 ... {OPTIONS.longest:g}, without 0")


def shares(seconds: float) -> list[float]:
    """Parts of the whole motion, 0 to 1, in the pictures of an animation: slow, fast, slow."""
    count = max(2, round(seconds * OPTIONS.rate))
    moving = max(2, round(count * (1.0 - OPTIONS.still)))
    rising = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, moving))
    return [*rising.tolist(), *[1.0] * (count - moving)]


def draw_moment(axes: Any, view: View, share: float) -> None:
    """A part of the motion of a view, with room for all of it."""
    axes.clear()
    frame(axes, view, view.moved)
    draw_mode(axes, view.scaled(share))


def moving_axes(view: View) -> Any:
    """Axes of a figure of their own, which show the whole motion and keep their place."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = structure_figure(view, 1)
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    draw_moment(axes, view, 1.0)
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine(None)  # it would move the axes from picture to picture
    return axes


def animate(view: View, path: Path, seconds: float) -> None:
    """Write the motion of a view as a film, on this rank.

    The file appears when it is complete.

    Raises:
        OSError: If it cannot be written.
    """
    from matplotlib import animation

    axes = moving_axes(view)
    figure = axes.figure
    writer = animation.writers[WRITERS[path.suffix.lower()]](fps=OPTIONS.rate)
    with tempfile.TemporaryDirectory(prefix=".writing-", dir=path.parent) as folder:
        unfinished = Path(folder, path.name)
        with writer.saving(figure, unfinished, OPTIONS.resolution):
            for share in shares(seconds):
                draw_moment(axes, view, share)
                writer.grab_frame()
        os.replace(unfinished, path)
