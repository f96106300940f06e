"""A page that moves blocks along the collapse mode, or the way after the peak, and turns them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact.geometry.mesh import Array
from fenics_contact.output.folder import replace_file
from fenics_contact.output.report.html import direction_words, text
from fenics_contact.results.block_view import BlockView, ContactState

#: The page, and what it is made from.
PAGE = "viewer.html"
TEMPLATE = Path(__file__).with_name(PAGE)
#: Digits of coordinates after that of the structure's size.
DIGITS = 4


def write_viewer(views: Mapping[str, BlockView], folder: Path) -> None:
    """Write viewer.html, on this rank.

    Args:
        views: What was found, by direction.
        folder: Where to, which is there.

    Raises:
        OSError: If the file cannot be written.
    """
    replace_file(folder / PAGE, viewer_page(views).encode("utf-8"))


def viewer_page(views: Mapping[str, BlockView]) -> str:
    """The page, as HTML. Texts of the user cannot leave the JSON that holds them."""
    data = json.dumps(_data(views), separators=(",", ":")).replace("<", "\\u003c")
    title = text(next(iter(views.values())).title or "Collapse")
    return TEMPLATE.read_text(encoding="utf-8").replace("TITLE", title, 1).replace("DATA", data, 1)


def _data(views: Mapping[str, BlockView]) -> dict[str, Any]:
    """What the page shows: blocks once, motions and contacts by direction."""
    view = next(iter(views.values()))
    bodies = view.bodies
    at = view.touching
    digits = DIGITS - int(np.floor(np.log10(view.size)))

    def rounded(values: Array, digits: int = digits) -> Any:
        return (np.round(values, digits) + 0.0).tolist()  # without signs of zeros

    return {
        "dimension": bodies.dimension,
        "centre": rounded(view.box.mean(axis=0)),
        "size": float(np.linalg.norm(np.ptp(view.box, axis=0))),
        "blocks": [
            {"name": name, "group": group, "fixed": fixed, "centre": centre, "size": size}
            for name, group, fixed, centre, size in zip(
                bodies.names,
                bodies.groups,
                bodies.fixed.tolist(),
                rounded(bodies.centroid),
                rounded(bodies.volume ** (1.0 / bodies.dimension)),
                strict=True,
            )
        ],
        "pieces": [
            {
                "block": int(number),
                "sides": [list(map(int, side)) for side in piece.sides],
                "at": rounded(piece.corners),
            }
            for number, piece in zip(bodies.of_piece, bodies.pieces, strict=True)
        ],
        "ties": [
            (*pair, rounded(ends))
            for pair, ends in zip(view.tie_blocks.tolist(), view.tie_ends, strict=True)
        ],
        "views": [
            {
                "name": direction_words(name),
                "caption": one.caption,
                "motion": rounded(one.motion, digits + 1),
                "share": rounded(one.share, 3),
                "marked": one.marked,
                "stresses": {kind: rounded(mpa, 4) for kind, mpa in one.stresses.items()},
                "unit": one.way_unit,
                "way": [
                    {"at": at, "carried": carried, "pose": rounded(pose, digits + 1)}
                    for at, carried, pose in one.way
                ],
                "contacts": [
                    (*pair, state, rounded(corners))
                    for pair, corners, state in zip(
                        at.pairs.tolist(), at.corners, one.contacts.state.tolist(), strict=True
                    )
                    if state != ContactState.STICK
                ],
            }
            for name, one in views.items()
        ],
    }
