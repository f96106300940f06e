"""Pictures as data: drawn at once, by another process, or later from `figures.npz`."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.output.fields import StressRaster
from fenics_contact.output.folder import DrawingError, drawing
from fenics_contact.output.plotting import (
    Draw,
    draw_forces,
    draw_marked,
    draw_mode,
    draw_scene,
    draw_stress,
    draw_thrust,
    save,
    whole_thrust,
)
from fenics_contact.output.thrust import Resultants
from fenics_contact.output.view import Arrows, BlockLabels, Caption, Held, Lines, Loads, View

#: The file of a result with the pictures that were not drawn.
FIGURES = "figures.npz"
#: How hard its arrays are packed: a tenth of the time of the default.
PACKED = 1


@dataclass(frozen=True, eq=False)
class Figure:
    """A picture to be drawn.

    Attributes:
        name: Of the file, without its ending.
        kind: "collapse", "marked", "forces", "stress", "thrust", "scene".
        view: What it shows.
        title: Of the picture.
    """

    name: str
    kind: str
    view: View
    title: str


#: What a file of figures is made of; fields that no picture shows, which are None there.
CLASSES: Mapping[str, type] = {
    kind.__name__: kind
    for kinds in (
        (Figure, View, Lines, Held, Resultants, StressRaster),
        (Loads, Arrows, BlockLabels, Caption),
    )
    for kind in kinds
}
SPARED = {"blocks"}


# ---- drawn


def figures_of(view: View, motion: str = "collapse") -> list[Figure]:
    """Motion, forces, stresses and lines of thrust of a view; or its marked blocks alone.

    Args:
        view: What the pictures show.
        motion: Name of the picture of the motion.
    """
    blocks = view.blocks
    kinds = {motion: "collapse"}
    if view.marked is not None:
        kinds = {"collapse": "marked"}
    elif view.faces is not None:
        kinds |= {kind: kind for kind in ("forces", "thrust")}
    if view.stress is not None:
        kinds["stress"] = "stress"
    return [
        Figure(f"{name}{blocks.suffix}", kind, view, blocks.whole_title)
        for name, kind in kinds.items()
    ]


def picture_paths(path: Path, formats: Iterable[str]) -> list[Path]:
    """Files of a picture, in all formats asked for; `path` is without its ending."""
    return [path.with_name(f"{path.name}.{suffix}") for suffix in dict.fromkeys(formats)]


def draw_figures(figures: Iterable[Figure], folder: Path, formats: Sequence[str]) -> list[str]:
    """Draw pictures into files, on this rank; a task. Lines of thrust are drawn if there are any.

    Returns:
        Which could not be drawn, and why.

    Raises:
        OSError: If a file cannot be written.
    """
    draws: Mapping[str, Draw] = {
        "collapse": draw_mode,
        "marked": draw_marked,
        "forces": draw_forces,
        "stress": draw_stress,
        "thrust": draw_thrust,
        "scene": draw_scene,
    }
    lost = []
    for figure in figures:
        paths = picture_paths(folder / figure.name, formats)
        try:
            with drawing(figure.name):
                if figure.kind != "thrust" or len(whole_thrust(figure.view).segments):
                    save(figure.view, figure.title, paths, draws[figure.kind])
        except DrawingError as error:
            lost.append(str(error))
            for part in paths:
                part.unlink(missing_ok=True)
    return lost


# ---- kept


def write_figures(path: Path, figures: Sequence[Figure]) -> None:
    """Write pictures as data, without pickle: arrays, and as JSON where they belong.

    Raises:
        OSError: If the file cannot be written.
    """
    arrays: dict[int, np.ndarray[Any, Any]] = {}  # each is written once, however many have it
    parts = json.dumps(_packed(tuple(figures), arrays))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=PACKED) as file:
        file.writestr("figures.json", parts)
        for number, array in enumerate(arrays.values()):
            with file.open(f"{number}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def read_figures(path: Path) -> tuple[Figure, ...]:
    """The pictures that were kept as data.

    Raises:
        ValueError: If the file is missing or damaged; the message says which.
    """
    try:
        with zipfile.ZipFile(path) as file:
            parts = json.loads(file.read("figures.json"))
            arrays = []
            for number in range(len(file.namelist()) - 1):
                with file.open(f"{number}.npy") as member:
                    arrays.append(np.lib.format.read_array(member, allow_pickle=False))
        found: tuple[Figure, ...] = _unpacked(parts, arrays)
    except FileNotFoundError:
        raise ValueError(f"{path.name} is not there") from None
    except Exception as error:  # whatever a file that was touched makes of it
        raise ValueError(f"{path.name} is damaged") from error
    return found


def _packed(value: Any, arrays: dict[int, np.ndarray[Any, Any]]) -> Any:
    """A value as JSON has it, but for its arrays, which are added to those there by identity."""
    if isinstance(value, np.ndarray):
        arrays.setdefault(id(value), value)
        return {"array": list(arrays).index(id(value))}
    if type(value).__name__ in CLASSES:
        return {"class": type(value).__name__, "values": dict(_packed_fields(value, arrays))}
    if isinstance(value, Mapping):
        return {"mapping": {key: _packed(item, arrays) for key, item in value.items()}}
    if isinstance(value, (tuple, list)):
        return [_packed(item, arrays) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _packed_fields(
    value: Any, arrays: dict[int, np.ndarray[Any, Any]]
) -> Iterator[tuple[str, Any]]:
    """Fields of a dataclass or a named tuple, by name."""
    names = [one.name for one in fields(value)] if is_dataclass(value) else value._fields
    for name in names:
        yield name, _packed(None if name in SPARED else getattr(value, name), arrays)


def _unpacked(value: Any, arrays: Sequence[np.ndarray[Any, Any]]) -> Any:
    """The inverse of `_packed`."""
    if isinstance(value, list):
        return tuple(_unpacked(item, arrays) for item in value)
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[value["array"]]
    items = value["mapping" if "mapping" in value else "values"].items()
    made = {key: _unpacked(item, arrays) for key, item in items}
    return CLASSES[value["class"]](**made) if "class" in value else made
