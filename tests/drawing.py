"""Blocks as arrays: drawn, turned, stretched, renumbered, and made a gmsh model again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.geometry.gmsh_mesh import GmshMesh
from fenics_contact.meshing import model_from_arrays, polygons

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


def rectangle(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float]]:
    """Corners of a block."""
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


def rotation(angle: float) -> Array:
    """Matrix that turns by an angle (radians) anticlockwise."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def area(outline: npt.ArrayLike) -> float:
    """Area of a polygon by its corners."""
    x, y = np.asarray(outline).T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def turned(points: npt.ArrayLike, degrees: float) -> Array:
    """Points turned anticlockwise about the origin."""
    return np.asarray(points, dtype=float) @ rotation(np.radians(degrees)).T


@dataclass
class Drawing:
    """A gmsh model as arrays.

    Attributes:
        points: Coordinates, shape (points, 2).
        cells: Point indices by two-dimensional group.
        facets: Point indices by one-dimensional group.
    """

    points: Array
    cells: dict[str, Indices]
    facets: dict[str, Indices]

    @classmethod
    def of(cls, model: Any) -> Drawing:
        """Read the current gmsh model."""
        tags, coordinates, _ = model.mesh.getNodes()
        place = np.zeros(int(tags.max()) + 1, dtype=np.int64)
        place[tags.astype(np.int64)] = np.arange(len(tags))
        tables: tuple[dict[str, Indices], dict[str, Indices]] = ({}, {})
        for dim, target in ((2, tables[0]), (1, tables[1])):
            for _, group in model.getPhysicalGroups(dim):
                parts = []
                for entity in model.getEntitiesForPhysicalGroup(dim, group):
                    types, _, nodes = model.mesh.getElements(dim, entity)
                    for kind, flat in zip(types, nodes, strict=True):
                        width = model.mesh.getElementProperties(kind)[3]
                        parts.append(place[flat.astype(np.int64)].reshape(-1, width))
                target[model.getPhysicalName(dim, group)] = np.concatenate(parts)
        return cls(coordinates.reshape(-1, 3)[:, :2].copy(), *tables)

    def model(self) -> Any:
        """A gmsh model of it."""
        return model_from_arrays(self.points, self.cells, self.facets, "drawing")

    def moved(self, change: Callable[[Array], Array]) -> Drawing:
        """With other points."""
        return replace(self, points=change(self.points))

    def turned(self, angle: float) -> Drawing:
        """Turned about the origin by an angle (radians)."""
        return replace(self, points=self.points @ rotation(angle).T)

    def renumbered(self, seed: int) -> Drawing:
        """With nodes and cells in random order."""
        random = np.random.default_rng(seed)
        order = random.permutation(len(self.points))
        place = np.argsort(order)
        cells = {name: random.permutation(place[table]) for name, table in self.cells.items()}
        facets = {name: random.permutation(place[table]) for name, table in self.facets.items()}
        return Drawing(self.points[order], cells, facets)

    def bodies(self) -> Indices:
        """Number of the connected block of every cell, all groups in turn."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        table = np.concatenate(list(self.cells.values()))
        first, other = np.repeat(table[:, 0], table.shape[1]), table.ravel()
        count = len(self.points)
        graph = coo_matrix((np.ones(len(first)), (first, other)), (count, count))
        body = connected_components(graph, directed=False)[1][table[:, 0]]
        return np.unique(body, return_inverse=True)[1]

    def odd_and_even(self) -> Drawing:
        """Every second block in the group "odd", the others in "even"."""
        table, odd = np.concatenate(list(self.cells.values())), self.bodies() % 2 == 1
        return replace(self, cells={"odd": table[odd], "even": table[~odd]})

    def one_by_one(self, seed: int) -> Drawing:
        """Every block meshed by itself, with a size of its own."""
        random = np.random.default_rng(seed)
        return self.meshed_again(lambda length: length * random.uniform(0.7, 1.4, len(length)))

    def meshed_again(self, size_of: Callable[[Array], Any]) -> Drawing:
        """Every block drawn by its corners and meshed again.

        `size_of` mean lengths of the blocks' facets gives the size of elements: one, so that nodes
        match, or one for every block.
        """
        table = np.concatenate(list(self.cells.values()))
        names = [name for name, cells in self.cells.items() for _ in cells]
        groups: dict[tuple[int, int], frozenset[str]] = {}
        for name, facets in self.facets.items():
            for a, b in np.sort(facets, axis=1).tolist():
                groups[a, b] = groups.get((a, b), frozenset()) | {name}
        bodies = self.bodies()
        outlines, lengths, of_block = [], [], []
        segments: dict[str, list[tuple[Array, Array]]] = {name: [] for name in self.facets}
        for body in range(bodies.max() + 1):
            cells = np.flatnonzero(bodies == body)
            corners, sets, length = self._outline(table[cells], groups)
            outlines.append(corners)
            of_block.append(names[cells[0]])
            lengths.append(length)
            for start, end, names_here in zip(corners, np.roll(corners, -1, 0), sets, strict=True):
                for name in names_here:
                    segments[name].append((start, end))
        size, quads = np.asarray(size_of(np.array(lengths))).tolist(), table.shape[1] == 4
        return Drawing.of(polygons(outlines, size, of_block, segments, quads))

    def _outline(
        self, cells: Indices, groups: dict[tuple[int, int], frozenset[str]]
    ) -> tuple[Array, list[frozenset[str]], float]:
        """Corners of a block, also where groups begin; groups of the sides; mean facet length."""
        edges = np.concatenate([np.roll(cells, -a, axis=1)[:, :2] for a in range(cells.shape[1])])
        seen = {tuple(edge) for edge in edges.tolist()}
        following = dict(edge for edge in seen if edge[::-1] not in seen)
        loop = [next(iter(following))]
        while following[loop[-1]] != loop[0]:
            loop.append(following[loop[-1]])
        points = self.points[loop]
        along = np.roll(points, -1, axis=0) - points
        length = np.linalg.norm(along, axis=1)
        sets = [
            groups.get((min(a, b), max(a, b)), frozenset())
            for a, b in zip(loop, [*loop[1:], loop[0]], strict=True)
        ]
        unit = along / length[:, None]
        turns = np.abs(np.cross(np.roll(unit, 1, axis=0), unit)) > 1e-9
        kept = [k for k in range(len(loop)) if turns[k] or sets[k] != sets[k - 1]]
        return points[kept], [sets[k] for k in kept], float(length.mean())

    def shaken(self, seed: int) -> Drawing:
        """Nodes moved at random by up to a quarter of the shortest side of a cell.

        Nodes inside blocks move in both directions, nodes on straight sides along them, alike in
        all blocks that meet there; corners of blocks stay.
        """
        table = np.concatenate(list(self.cells.values()))
        edges = np.concatenate([table[:, [a, a - 1]] for a in range(table.shape[1])])
        along = self.points[edges[:, 1]] - self.points[edges[:, 0]]
        reach = 0.25 * np.linalg.norm(along, axis=1).min()
        _, index, count = np.unique(
            np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True
        )
        outer = index[count == 1]
        rounded = np.round(self.points / (1e-6 * reach))
        place = np.unique(rounded, axis=0, return_inverse=True)[1].ravel()
        # Sum of t t^T over the sides at a place: of rank 1 where all lie on one line.
        unit = along[outer] / np.linalg.norm(along[outer], axis=1)[:, None]
        tensor = np.zeros((place.max() + 1, 2, 2))
        for end in edges[outer].T:
            np.add.at(tensor, place[end], unit[:, :, None] * unit[:, None, :])
        values, vectors = np.linalg.eigh(tensor)
        random = np.random.default_rng(seed)
        move = random.uniform(-reach, reach, (len(tensor), 2)) / np.sqrt(2.0)
        on_line = np.einsum("ni,nj,nj->ni", vectors[:, :, 1], vectors[:, :, 1], move)
        inside, straight = values[:, 1] == 0.0, values[:, 0] <= 1e-9 * values[:, 1]
        kept = np.where(inside[:, None], move, np.where(straight[:, None], on_line, 0.0))
        return replace(self, points=self.points + kept[place])


def grid_block(
    corner: Sequence[float], size: Sequence[float], divisions: Sequence[int]
) -> tuple[Array, Indices, dict[str, Indices]]:
    """A rectangular block of quadrilaterals: points, cells and facets of its four sides."""
    nx, ny = divisions
    x = np.linspace(corner[0], corner[0] + size[0], nx + 1)
    y = np.linspace(corner[1], corner[1] + size[1], ny + 1)
    grid = np.arange((nx + 1) * (ny + 1)).reshape(ny + 1, nx + 1)
    points = np.column_stack([np.tile(x, ny + 1), np.repeat(y, nx + 1)])
    cells = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]], axis=2)
    lines = {"bottom": grid[0], "right": grid[:, -1], "top": grid[-1], "left": grid[:, 0]}
    sides = {name: np.column_stack([line[:-1], line[1:]]) for name, line in lines.items()}
    return points, cells.reshape(-1, 4), sides


def grid_blocks(*blocks: tuple[Sequence[float], Sequence[float], Sequence[int]]) -> Drawing:
    """Blocks (corner, size, divisions) next to each other, each with nodes of its own.

    The facet groups are "bottom0", "right0", "top0", "left0", "bottom1", ...
    """
    points: list[Array] = []
    cells: list[Indices] = []
    facets: dict[str, Indices] = {}
    count = 0
    for number, block in enumerate(blocks):
        own, quadrilaterals, sides = grid_block(*block)
        points.append(own)
        cells.append(quadrilaterals + count)
        facets |= {f"{name}{number}": side + count for name, side in sides.items()}
        count += len(own)
    return Drawing(np.concatenate(points), {"blocks": np.concatenate(cells)}, facets)


def cell_areas(drawn: GmshMesh) -> Array:
    """Areas of cells, positive where their nodes run anticlockwise."""
    corners = drawn.points[drawn.cells]
    following = np.roll(corners, -1, axis=1)
    cross = corners[..., 0] * following[..., 1] - corners[..., 1] * following[..., 0]
    return 0.5 * cross.sum(axis=1)


def group_lengths(drawn: GmshMesh) -> dict[str, float]:
    """Length of the facets of every one-dimensional group."""
    ends = drawn.points[drawn.facets]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    groups = [drawn.facet_sets[group] for group in drawn.facet_groups]
    return {
        name: float(sum(long for long, names in zip(length, groups, strict=True) if name in names))
        for name in drawn.facet_names
    }
