"""A page that turns the blocks and moves them along the collapse mode, without any other file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.geometry.mesh import Array
from fenics_contact.output.folder import replace_file
from fenics_contact.output.report.html import direction_words, text
from fenics_contact.spatial.result import SpatialLimit
from fenics_contact.spatial.view import ContactState, SpatialView, views_of

#: The page, and what it is made from.
PAGE = "viewer.html"
TEMPLATE = Path(__file__).with_name(PAGE)
#: Digits of coordinates after that of the structure's size.
DIGITS = 4


def write_viewer(result: SpatialLimit, folder: Path) -> None:
    """Write viewer.html, on this rank.

    Args:
        result: What was found.
        folder: Where to, which is there.

    Raises:
        OSError: If the file cannot be written.
    """
    replace_file(folder / PAGE, viewer_page(result).encode("utf-8"))


def viewer_page(result: SpatialLimit) -> str:
    """The page, as HTML. Texts of the user cannot leave the JSON that holds them."""
    views = dict(zip(result.ends, views_of(result).values(), strict=True))
    data = json.dumps(_data(next(iter(views.values())), views), separators=(",", ":"))
    data = data.replace("<", "\\u003c")
    title = text(getattr(result.scene, "title", "") or "Collapse")
    return TEMPLATE.read_text(encoding="utf-8").replace("TITLE", title, 1).replace("DATA", data, 1)


def _data(view: SpatialView, views: dict[str, SpatialView]) -> dict[str, Any]:
    """What the page shows: blocks once, motions and contacts by direction."""
    bodies = view.bodies
    blocks = view.structure.blocks
    digits = DIGITS - int(np.floor(np.log10(view.size)))

    def rounded(values: Array, digits: int = digits) -> Any:
        return (np.round(values, digits) + 0.0).tolist()  # without signs of zeros

    shapes: dict[tuple[tuple[int, ...], ...], int] = {}
    pieces = []
    numbered = ((number, piece) for number, block in enumerate(blocks) for piece in block.pieces)
    for number, piece in numbered:
        shape = shapes.setdefault(tuple(map(tuple, piece.sides)), len(shapes))
        pieces.append({"block": number, "shape": shape, "at": rounded(piece.corners.ravel())})
    reach = np.linalg.norm(bodies.corner - view.box.mean(axis=0), axis=1).max()
    return {
        "title": view.title.partition("\n")[0] if "\n" in view.title else "Collapse",
        "centre": rounded(view.box.mean(axis=0)),
        "size": float(np.linalg.norm(np.ptp(view.box, axis=0))),
        "reach": float(reach + view.size),
        "blocks": [
            {
                "name": block.name,
                "group": block.group,
                "fixed": block.fixed,
                "centre": rounded(block.centroid),
            }
            for block in blocks
        ],
        "shapes": list(shapes),
        "pieces": pieces,
        "ties": [
            (*bar.blocks, [rounded(end) for end in bar.tie.ends]) for bar in view.structure.bars
        ],
        "views": [
            {
                "name": direction_words(name),
                "caption": one.title.rpartition("\n")[2],
                "motion": rounded(one.motion, digits + 1),
                "share": rounded(one.share, 3),
                "use": rounded(one.utilisation, 3),
                "marked": list(one.marked),
                "contacts": [
                    (c.first, c.second, int(state), rounded(c.corners.ravel()))
                    for c, state in zip(one.structure.contacts, one.contacts.state, strict=True)
                    if state != ContactState.CLOSED
                ],
            }
            for name, one in views.items()
        ],
    }
