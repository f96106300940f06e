"""Files of a result without a mesh: result.json, and what output options ask for beside it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fenics_contact import compat
from fenics_contact.errors import checked
from fenics_contact.output.files import UNITS, record_of, write_capacity, write_files
from fenics_contact.output.folder import going_on
from fenics_contact.output.report.viewer import write_viewer
from fenics_contact.parallel import MPI
from fenics_contact.results.block_view import BlockView
from fenics_contact.results.result import Collapse
from fenics_contact.results.words import mechanism_in_words, mechanism_record
from fenics_contact.scene.units import PER_METRE
from fenics_contact.spatial.picture import draw_collapse
from fenics_contact.spatial.result import SpatialLimit
from fenics_contact.spatial.structure import Structure
from fenics_contact.spatial.view import views_of
from fenics_contact.spatial.vtu import write_fields


class BlockLimitLoad(SpatialLimit):
    """Result of `limit_load`, with its files."""

    def mechanisms(self) -> dict[str, str]:
        """What moves in the collapse of each direction, in a sentence."""
        views = views_of(self)
        return {name: mechanism_in_words(views[name]) for name in self.limits}

    @checked
    def write(
        self,
        folder: str | Path,
        hurry: Callable[[], bool] = lambda: False,
        beside: Executor | None = None,
    ) -> None:
        """Write result.json and what the scene's output options say, on the first rank.

        The folder is made. Once `hurry` is true only result.json and tables are. Nothing is left to
        other processes (`beside`).

        Raises:
            OutputError: If a file cannot be written; the folder is then as it was.
        """
        output = self.scene.output

        def draw(hidden: Path) -> list[str]:
            lost: list[str] = []
            views = views_of(self)
            tables = replace(output, paraview=False, pictures=False)
            for name, end in self.ends.items():
                for answer in end.told:
                    answer.write(hidden, views[name], tables if hurry() else output)
            if output.paraview and not hurry():
                write_fields(self, hidden)
            if output.pictures and not hurry():
                lost += draw_collapse(self, hidden, output)
                write_viewer(views, hidden)
            with going_on(lost):
                if self.capacity:
                    write_capacity(self, hidden)
            return lost

        def record(seconds: Mapping[str, float], lost: list[str]) -> dict[str, Any]:
            return result_record(replace(self, seconds=seconds))

        if compat.default_comm().rank == 0:
            write_files(self, Path(folder), MPI.COMM_SELF, draw, record)


def result_record(result: SpatialLimit) -> dict[str, Any]:
    """Content of result.json."""
    structure = result.structure
    views = views_of(result)
    record = record_of(
        result,
        {name: _block_record(structure, end, views[name]) for name, end in result.ends.items()},
        {
            "dimension": structure.dimension,
            "mesh": {
                "bodies": len(structure.blocks),
                "floating_bodies": int(np.count_nonzero(structure.number >= 0)),
                "contacts": len(structure.contacts),
                "joint_points": len(structure.points.area),
                "ties": len(structure.bars),
            },
            "scene": scene_record(result),
            "warnings": list(structure.warnings),
            "ranks": result.ranks,
        },
    )
    return record | ({"directions": {}} if result.status == "unstable" else {})


def _block_record(structure: Structure, collapse: Collapse, view: BlockView) -> dict[str, Any]:
    """What rigid blocks and ties do in one direction."""
    mode = collapse.mode
    moves = None
    if collapse.status == "limit" and mode is not None:
        moves = {**mechanism_record(view), "motion": structure.told_motions(mode).tolist()}
    falling = list(collapse.falling)
    unstable = collapse.status == "unstable"
    return {
        "mechanism": moves,
        "falling_blocks": falling if unstable else [],
        "wedged_blocks": [] if unstable else falling,
        "tensions": None if collapse.tension is None else collapse.tension.tolist(),
    }


def scene_record(result: SpatialLimit) -> dict[str, Any]:
    """What was solved."""
    structure = result.structure
    moving = [block for block in structure.blocks if not block.fixed]
    areas = {k: structure.areas_of(k) for k in dict.fromkeys(law.key for law in structure.laws)}
    volumes: dict[str, list[float]] = {block.group: [] for block in moving}
    for block in moving:
        volumes[block.group].append(block.volume)
    extent = np.array([block.extent for block in moving])
    size = dict(zip(("width", "depth", "height"), np.ptp(extent, axis=(0, 1)), strict=True))
    if structure.dimension == 2:
        size.pop("depth")
    whole = structure.dimension == 3
    return {
        **result.scene.tables(),
        "thickness": result.scene.thickness,
        "size": size,
        "resultants": {
            name: structure.told(getattr(structure, name)[:, :3].sum(axis=0)).tolist()
            for name in ("dead", "live")
        },
        "contacts": [
            {
                "group": key.partition(".")[2],
                "kind": key.partition("s.")[0],
                "contacts": len(some),
                "area": sum(some),
            }
            for key, some in areas.items()
        ],
        "units": {k: u.partition(f" {PER_METRE}")[0] if whole else u for k, u in UNITS.items()},
        "groups": [
            {"group": name, "blocks": len(some), "volume": sum(some)}
            for name, some in volumes.items()
        ],
    }
