"""Contents of a text file of gmsh (MSH 4.1) without gmsh, which takes .3 s to start.

Only what is plainly well formed is read: straight lines, triangles and quadrilaterals, every number
where the format has it. All else is left to gmsh, and so is every complaint.
Format: gmsh's reference manual, "MSH file format".
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from fenics_contact.errors import require
from fenics_contact.geometry.gmsh_reader import GmshContents, Tags

Array = npt.NDArray[np.float64]

#: Elements that are read: gmsh's number, nodes, gmsh's name.
ELEMENTS = {1: (2, "Line 2"), 2: (3, "Triangle 3"), 3: (4, "Quadrilateral 4"), 15: (1, "Point")}
#: Sections, in the order in which gmsh writes them; the second may be left out.
SECTIONS = ("MeshFormat", "PhysicalNames", "Entities", "Nodes", "Elements")
#: Section after all others with what is wrong with the drawing; gmsh passes over it.
REMARK = "\n$Comments\nfenics-contact: {}\n$EndComments\n"
_REMARK_HEAD, _, _REMARK_END = REMARK.partition("{}")
#: Version 4.1, text, with numbers of 8 bytes.
FORMAT = ["4.1", "0", "8"]
#: Whole numbers above this are not exact as floating point numbers.
EXACT = 2.0**53

#: Leaves the file to gmsh where a condition does not hold.
_require = partial(require, message="gmsh has to read this file", error=ValueError)

_SECTION = re.compile(r"\$(\w+)\n(.*?\n)\$End\1\n", re.DOTALL)
_NAME = re.compile(r'([0-3]) ([1-9]\d{0,8}) "([^"]{1,100})"')


def text_contents(path: Path) -> GmshContents | None:
    """Contents of a file as `gmsh_reader.read` returns them; None where gmsh has to read it.

    Raises:
        OSError: If the file cannot be read.
    """
    try:
        return _contents(path.read_text(encoding="utf-8").partition(_REMARK_HEAD)[0])
    except (ValueError, IndexError, DeprecationWarning):
        return None


def remark_of(path: Path) -> str:
    """What `REMARK` says at the end of a file, as one printable line; empty without one."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 2000))
        end = file.read().decode("utf-8", "replace")
    text = end.rpartition(_REMARK_HEAD)[2] if _REMARK_HEAD in end else ""
    return "".join(c for c in text.removesuffix(_REMARK_END) if c.isprintable())


class _Numbers:
    """Numbers of a section, taken from its start on."""

    def __init__(self, text: str) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # what is no number
            self._left = np.fromstring(text, sep=" ")
        _require(bool(np.all(np.isfinite(self._left))))

    def real(self, count: int) -> Array:
        """The next numbers."""
        _require(0 <= count <= len(self._left))
        taken = self._left[:count]
        self._left = self._left[count:]
        return taken

    def whole(self, count: int) -> list[int]:
        """The next numbers, which must be whole."""
        return _whole(self.real(count)).tolist()

    def end(self) -> None:
        """See to it that no number is left."""
        _require(len(self._left) == 0)


def _whole(numbers: Array) -> npt.NDArray[np.int64]:
    """Numbers that are whole, as such."""
    _require(bool(np.all((numbers == np.round(numbers)) & (np.abs(numbers) < EXACT))))
    return numbers.astype(np.int64)


def _contents(text: str) -> GmshContents:
    """Contents of the text of a file.

    Raises:
        ValueError, IndexError, DeprecationWarning: If gmsh has to read it.
    """
    found = list(_SECTION.finditer(text))
    names = [section[1] for section in found]
    _require("".join(section[0] for section in found) == text)
    _require(names in ([*SECTIONS], [SECTIONS[0], *SECTIONS[2:]]))
    sections = {section[1]: section[2] for section in found}
    _require(sections["MeshFormat"].split() == FORMAT)
    of_entity = dict(_entities(sections["Entities"]))
    _require(all(dim < 3 for dim, _ in of_entity))
    tags, coordinates = _nodes(sections["Nodes"], set(of_entity))
    blocks = _elements(sections["Elements"], set(of_entity), tags)
    named = dict(_physical_names(sections.get("PhysicalNames", "0\n")))
    used = sorted({(dim, tag) for (dim, _), tags in of_entity.items() for tag in tags})
    elements = [
        (dim, of_entity[dim, entity], kind, nodes)
        for (dim, entity, kind), nodes in sorted(blocks.items(), key=lambda item: item[0])
        if dim > 0 and of_entity[dim, entity]
    ]
    kinds = {kind: ELEMENTS[kind][1] for _, _, kind, _ in elements}
    groups: dict[tuple[int, int], str | None] = {key: named.get(key, str(key[1])) for key in used}
    return GmshContents(groups, tags, coordinates, elements, kinds)


def _physical_names(section: str) -> Iterator[tuple[tuple[int, int], str]]:
    """Dimension and number of every named group, and its name."""
    count, *lines = section.splitlines()
    _require(len(lines) == int(count))
    for line in lines:
        match = _NAME.fullmatch(line.rstrip())
        if match is None or not match[3].isprintable():
            raise ValueError(line)
        yield (int(match[1]), int(match[2])), match[3]


def _entities(section: str) -> Iterator[tuple[tuple[int, int], list[int]]]:
    """Dimension and number of every entity, and its groups; a reversed one has a number below 0."""
    numbers = _Numbers(section)
    for dim, count in enumerate(numbers.whole(4)):
        for _ in range(count):
            (entity,) = numbers.whole(1)
            numbers.real(3 if dim == 0 else 6)  # the box around it
            (of_groups,) = numbers.whole(1)
            groups = [abs(tag) for tag in numbers.whole(of_groups)]
            if dim > 0:
                (bounding,) = numbers.whole(1)
                numbers.whole(bounding)
            yield (dim, entity), groups
    numbers.end()


def _nodes(section: str, entities: set[tuple[int, int]]) -> tuple[Tags, Array]:
    """Numbers of the nodes, in the order of their entities, and their coordinates."""
    numbers = _Numbers(section)
    found = {}
    blocks, total, _, _ = numbers.whole(4)
    for _ in range(blocks):
        dim, entity, parametric, count = numbers.whole(4)
        _require(parametric == 0 and (dim, entity) in entities and (dim, entity) not in found)
        tags = _whole(numbers.real(count))
        found[dim, entity] = tags, numbers.real(3 * count).reshape(-1, 3)
    numbers.end()
    in_order = [found[key] for key in sorted(found)]
    tags = np.concatenate([some for some, _ in in_order])
    _require(len(tags) == total == len(np.unique(tags)) and int(tags.min()) > 0)
    return tags.astype(np.uint64), np.concatenate([places for _, places in in_order])


def _elements(
    section: str, entities: set[tuple[int, int]], known: Tags
) -> dict[tuple[int, int, int], Tags]:
    """Nodes, in a row, of the elements by dimension and number of their entity, and by kind."""
    numbers = _Numbers(section)
    found = {}
    blocks, total, _, _ = numbers.whole(4)
    elements = 0
    for _ in range(blocks):
        dim, entity, kind, count = numbers.whole(4)
        _require(kind in ELEMENTS and count > 0 and (dim, entity, kind) not in found)
        _require((dim, entity) in entities and dim == min(ELEMENTS[kind][0] - 1, 2))
        rows = _whole(numbers.real(count * (1 + ELEMENTS[kind][0]))).reshape(count, -1)
        found[dim, entity, kind] = rows[:, 1:].ravel().astype(np.uint64)
        elements += count
    numbers.end()
    _require(elements == total)
    _require(bool(np.all(np.isin(np.concatenate(list(found.values())), known))))
    return found
