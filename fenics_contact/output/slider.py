"""A slider for notebooks that moves the blocks of a picture; needs ipywidgets."""

from __future__ import annotations

import io
from importlib.util import find_spec
from typing import Any

from fenics_contact.errors import InputError
from fenics_contact.output.animation import draw_moment, moving_axes
from fenics_contact.output.view import View

#: Pixels per inch, and steps of the slider: a picture of 100 blocks takes .2 s.
RESOLUTION, STEPS = 80, 20


def check_slider() -> None:
    """Refuse to go on without ipywidgets.

    Raises:
        InputError: With the ways to it.
    """
    if find_spec("ipywidgets") is None:
        ways = "pip install ipywidgets 'matplotlib-inline<0.2', or apt install python3-ipywidgets"
        raise InputError(f"a slider needs ipywidgets, which is not installed: {ways}")


def slider(view: View) -> Any:
    """A widget with a picture of a view, and a slider from rest to its motion, on this rank."""
    import ipywidgets

    axes = moving_axes(view)

    def picture(share: float) -> bytes:
        file = io.BytesIO()
        draw_moment(axes, view, share)
        axes.figure.savefig(file, format="png", dpi=RESOLUTION)
        return file.getvalue()

    image = ipywidgets.Image(value=picture(1.0), format="png")
    style = {"min": 0.0, "max": 1.0, "step": 1.0 / STEPS, "description": "motion"}
    moves = ipywidgets.FloatSlider(value=1.0, **style)

    def show(change: Any) -> None:
        image.value = picture(change["new"])

    moves.observe(show, names="value")
    return ipywidgets.VBox([moves, image])
