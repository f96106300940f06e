"""Pictures and ParaView files of one state, or of a fall, for all kinds of results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from fenics_contact.discretization.layout import Layout
from fenics_contact.errors.checks import plain
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.output.fields import stress_raster
from fenics_contact.output.folder import DrawingError, drawing, writing
from fenics_contact.output.plotting import (
    Draw,
    draw_forces,
    draw_marked,
    draw_mode,
    draw_stress,
    draw_thrust,
    save,
    whole_thrust,
)
from fenics_contact.output.view import View, view_of
from fenics_contact.scene.scene import Scene

#: Characters of a title that a picture has room for.
LONGEST_TITLE = 60


def short_title(title: str) -> str:
    """A title as pictures have it: one short line, in which dollars are no mathematics."""
    return plain(title, LONGEST_TITLE)


def picture_paths(scene: Scene, path: Path) -> list[Path]:
    """Files of a picture, in all formats asked for; `path` is without its ending."""
    return [
        path.with_name(f"{path.name}.{suffix}") for suffix in dict.fromkeys(scene.output.formats)
    ]


def draw_pictures(
    scene: Scene, view: View, title: str, pictures: Mapping[Path, Sequence[Draw]]
) -> None:
    """Pictures by file without its ending, each of panels side by side, on rank 0. Collective.

    Raises:
        DrawingError: On all ranks, once all others are drawn, if one cannot be.
    """
    whole = "\n".join(filter(None, (short_title(scene.title), title)))
    with writing(scene.comm):
        failed = []
        for path, draws in pictures.items() if scene.comm.rank == 0 else ():
            paths = picture_paths(scene, path)
            try:
                with drawing(path.name):
                    save(view, whole, paths, *draws)
            except DrawingError as error:
                failed.append(str(error))
                for part in paths:
                    part.unlink(missing_ok=True)
        if failed:
            raise DrawingError("; ".join(failed))


def draw_state(layout: Layout, view: View, elastic: Array, title: str, first: Path) -> None:
    """Motion, forces, stresses and whole lines of thrust of a state. Collective.

    Args:
        layout: Of the state.
        view: What the pictures show.
        elastic: Displacement without a large motion, this rank's part.
        title: Of all pictures.
        first: The picture of the motion, without its ending; what its name has after the first
            underscore is in the other names too.
    """
    _, underscore, rest = first.name.partition("_")
    suffix = underscore + rest
    stress = partial(draw_stress, raster=stress_raster(layout, elastic))
    panels: dict[str, Draw] = {first.name: draw_mode, f"forces{suffix}": draw_forces}
    panels[f"stress{suffix}"] = stress
    with drawing(f"thrust{suffix}"):  # alike on all ranks
        if len(whole_thrust(view).segments):
            panels[f"thrust{suffix}"] = draw_thrust
    pictures = {first.with_name(name): [draw] for name, draw in panels.items()}
    draw_pictures(layout.scene, view, title, pictures)


def draw_blocks(
    layout: Layout,
    blocks: Indices,
    motion: Array | None,
    title: str,
    path: Path,
    sign: float = 1.0,
) -> View:
    """Picture of some blocks among all, moved by rigid motions (a, b, c) by block. Collective.

    Returns:
        What it shows; `sign` is that of the live load.
    """
    mode = None if motion is None else layout.rigid_motion(motion)
    view = replace(view_of(layout, mode, sign=sign), marked=blocks)
    draw_pictures(layout.scene, view, title, {path: [draw_marked]})
    return view
