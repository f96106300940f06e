"""Files of fields: forces at points; for ParaView blocks, their motion, contacts, ties, loads."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from fenics_contact.geometry.mesh import Array
from fenics_contact.output.vtu import (
    FILE,
    LINE,
    POLYHEDRON,
    VERTEX,
    Grid,
    grid_of,
    write_contacts,
    write_grid,
)
from fenics_contact.results.block_view import BlockView
from fenics_contact.results.result import Collapse
from fenics_contact.results.values import TieState
from fenics_contact.spatial.loads import Acting
from fenics_contact.spatial.result import SpatialLimit
from fenics_contact.spatial.structure import Structure
from fenics_contact.spatial.view import views_of

#: Files of the motion, after that at rest.
STEPS = 10


def write_fields(result: SpatialLimit, folder: Path) -> None:
    """Write what ParaView shows of a result, on this rank, for every direction of the live load.

    blocks.vtu has the blocks at rest with the collapse mode, contacts.vtu, ties.vtu and loads.vtu
    what these names say, points.npz the forces at points of contacts, and collapse.pvd the motion
    in steps; with two directions, likewise blocks_negative.vtu, and so on.

    Args:
        result: What was found.
        folder: Where to, which is there.

    Raises:
        OSError: If a file cannot be written.
    """
    for name, view in views_of(result).items():
        end = result.ends[name]
        _write_points(folder / f"points{view.suffix}.npz", result.structure, end)
        write_grid(folder / f"blocks{view.suffix}.vtu", _blocks(view))
        write_contacts(folder / f"contacts{view.suffix}.vtu", view)
        if view.ties:
            write_grid(folder / f"ties{view.suffix}.vtu", _ties(view))
        if result.structure.acting:
            loads = _loads(view, result.structure.acting, end.sign)
            write_grid(folder / f"loads{view.suffix}.vtu", loads)
        if view.motion.any():
            parts = [step / STEPS for step in range(STEPS + 1)]
            poses = ((part, view.bodies.corner + part * view.displacement) for part in parts)
            write_series(folder / f"collapse{view.suffix}", view, poses)


def write_series(path: Path, view: BlockView, poses: Iterable[tuple[float, Array]]) -> None:
    """Write blocks in several poses, and the file that ParaView opens for all of them.

    Args:
        path: Without an ending.
        view: What is shown.
        poses: Times, and corners of all pieces, m, shape (corners, 3).

    Raises:
        OSError: If a file cannot be written.
    """
    blocks = _blocks(view)
    steps = ""
    for number, (at, corners) in enumerate(poses):
        name = f"{path.name}_{number:02d}.vtu"
        write_grid(path.with_name(name), blocks | {"Points": {"Points": corners}})
        steps += f'<DataSet timestep="{at:g}" part="0" file="{name}"/>'
    series = FILE.format("Collection", "", f"<Collection>{steps}</Collection>")
    path.with_name(f"{path.name}.pvd").write_text(series)


def _write_points(path: Path, structure: Structure, end: Collapse) -> None:
    """Write the forces at points, if any are known, with all that recomputes their equilibrium."""
    if end.force is None or end.tension is None:
        return
    count = len(end.force)
    blocks = np.column_stack([block for _, block, _ in structure.ends])
    np.savez_compressed(
        path,
        **vars(structure.points),
        axes=structure.axes[:count],
        force=end.force,
        blocks=blocks[:count],
        names=np.array([block.name for block in structure.blocks], dtype=str),
        centroid=np.array([block.centroid for block in structure.blocks]),
        dead=structure.dead,
        live=structure.live,
        load_factor=end.load_factor,
        tie_ends=np.array([bar.ends for bar in structure.bars]).reshape(-1, 2, 3),
        tie_blocks=blocks[count:],
        tension=end.tension,
    )


def _blocks(view: BlockView) -> Grid:
    """Cells of the blocks' pieces with what is known of them; groups are numbered in turn."""
    bodies = view.bodies
    faces = [[len(piece.sides)] for piece in bodies.pieces]
    for loop, piece in zip(bodies.sides, bodies.side_piece, strict=True):
        faces[piece] += [len(loop), *loop.tolist()]
    at_cells = {
        "block": bodies.of_piece,
        "group": bodies.group[bodies.of_piece],
        "fixed": bodies.fixed[bodies.of_piece].astype(int),
        "movement": view.share[bodies.of_piece],
        "falls": np.isin(bodies.of_piece, view.marked).astype(int),
    }
    grid = grid_of(POLYHEDRON, bodies.corner, bodies.counts, at_cells)
    grid["Cells"]["faces"] = np.concatenate(faces)
    grid["Cells"]["faceoffsets"] = np.cumsum([len(stream) for stream in faces])
    grid["PointData"] = {"displacement": view.displacement}
    grid["FieldData"] = {"groups": bodies.group_names}
    return grid


def _ties(view: BlockView) -> Grid:
    """Ties as lines, with their forces and yields, N."""
    names, force, limit, state = (view.ties[key] for key in ("name", "force", "yield", "state"))
    at_cells = {"tie": np.arange(len(names)), "force": force, "yield": limit, "state": state}
    at_cells["utilisation"] = force / limit
    ends = view.tie_ends.reshape(-1, 3)
    grid = grid_of(LINE, ends, np.full(len(names), 2), at_cells)
    grid["PointData"] = {"displacement": view.moved_ties.reshape(-1, 3) - ends}
    states = tuple(state.name.lower() for state in TieState)
    grid["FieldData"] = {"ties": tuple(names.tolist()), "states": states}
    return grid


def _loads(view: BlockView, acting: Mapping[str, Acting], sign: float) -> Grid:
    """Resultants of every load on every block, N, at points; the live load as it acts at 1."""
    signs = [sign if key.startswith("loads.live") else 1.0 for key in acting]
    rows = [
        (np.full(len(one.block), load), one.block, one.place, side * one.force)
        for load, (one, side) in enumerate(zip(acting.values(), signs, strict=True))
    ]
    load, block, place, force = map(np.concatenate, zip(*rows, strict=True))
    size = np.linalg.norm(force, axis=1)[:, None]
    acts = size.ravel() > 0.0
    pairs, row = np.unique(np.column_stack([load, block])[acts], axis=0, return_inverse=True)
    sums = np.zeros((len(pairs), 7))
    np.add.at(sums, row.ravel(), np.hstack([force, size * place, size])[acts])
    middle: Array = sums[:, 3:6] / sums[:, 6:]
    one_each = np.ones(len(pairs), dtype=np.int64)
    grid = grid_of(VERTEX, middle, one_each, {"load": pairs[:, 0], "block": pairs[:, 1]})
    grid["PointData"] = {
        "force": sums[:, :3],
        "displacement": view.displacements(middle, pairs[:, 1]),
    }
    grid["FieldData"] = {"loads": tuple(acting)}
    return grid
