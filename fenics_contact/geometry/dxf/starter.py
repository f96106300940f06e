"""A scene file to begin with, for the mesh of a drawing: the keys that most scenes need, explained.

It is complete: what a drawing does not say has a usual value, and a comment that says so.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from fenics_contact.errors import InputError
from fenics_contact.geometry.dxf.ground import GroupRoles

#: Usual values: Pa, 1, kg/m3 of stone masonry; friction of dry joints, tan 31 degrees.
YOUNG = "5.0e9"
POISSON = "0.2"
DENSITY = "2000.0"
FRICTION = "0.6"


@dataclass(frozen=True)
class Starter:
    """What a drawing says of a scene.

    Attributes:
        title: For pictures.
        mesh: Path of the mesh, relative to the scene file.
        materials: Number of blocks by two-dimensional group.
        lengths: Of the sides in every one-dimensional group, m.
        roles: Of these groups.
        gap: Of mortar joints, m, as text; empty where blocks touch.
        mortar: Their thickness, for people; empty where `mesh --close` finds none.
        slips: What the drawing loses by ends of lines that miss each other; empty if nothing.
    """

    title: str
    mesh: str
    materials: Mapping[str, int]
    lengths: Mapping[str, float]
    roles: GroupRoles
    gap: str = ""
    mortar: str = ""
    slips: str = ""

    def write(self, target: Path) -> None:
        """Write the scene file; one that is there stays.

        Raises:
            InputError: If it is there, or cannot be written.
        """
        try:
            with target.open("x", encoding="utf-8") as file:
                file.write(self.text())
        except OSError as error:
            raise InputError(f"cannot write to '{target}': {error.strerror}") from None

    def text(self) -> str:
        """The scene file, TOML."""
        lines = [*self._head(), *self._materials(), *self._contacts(), *self._loads(), *_END]
        return "\n".join(lines) + "\n"

    def _head(self) -> Iterator[str]:
        yield "# A scene to begin with. What is called a guess is not in the drawing: set it right."
        yield "# Units are SI: m, N, Pa, kg/m3. All keys: the scene reference, docs/scene.md."
        if self.slips:
            yield f"# warning: in the drawing {self.slips}"
        yield f"title = {_quoted(self.title)}"
        yield f"mesh.file = {_quoted(self.mesh)}"
        yield _line("# plane.thickness = 0.5", "m; forces are printed for the whole thickness then")

    def _materials(self) -> Iterator[str]:
        yield from ("", "# ---- Materials, by layer of the blocks. All values are guesses.")
        for name, count in self.materials.items():
            yield from ("", _line(f"[materials.{_key(name)}]", f"{count} blocks"))
            yield _line(f"young = {YOUNG}", "Pa; matters little for the load factor")
            yield f"poisson = {POISSON}"
            yield _line(f"density = {DENSITY}", "kg/m3")
            yield _line("# compressive_strength = 5.0e6", "Pa; joints crush then")

    def _contacts(self) -> Iterator[str]:
        yield from ("", "# ---- Joints. All frictions are guesses.")
        yield from ("", _line("[joints.default]", "wherever two blocks touch"))
        yield f"friction = {FRICTION}"
        if self.gap:
            yield _line(f"gap = {self.gap}", "m; gaps between blocks, which must close first")
        if self.mortar:
            yield f"# If they are mortar, {self.mortar}, mesh with --close, and delete this line:"
            yield "# mortar has a height, and blocks with a gap fall until they touch."
        for name in self.roles.joints:
            if name != "default":
                yield from ("", _line(f"[joints.{_key(name)}]", self._length(name)))
                yield f"friction = {FRICTION}"
        yield from ("", f"# ---- Where the structure stands. A guess: {self.roles.why}.")
        for name in self.roles.ground:
            what = f"rigid ground, {self._length(name)}"
            yield from ("", _line(f"[foundations.{_key(name)}]", what))
            yield f"friction = {FRICTION}"

    def _loads(self) -> Iterator[str]:
        yield from ("", "# ---- Loads", "", _line("[loads.dead]", "acts first, and stays"))
        yield _line("body = [0.0, -9.81]", "m/s2, times density: the weight")
        yield from ("", _line("[loads.live]", "times the load factor. A guess:"))
        yield _line("body = [9.81, 0.0]", "the weight acting sideways: the load factor is in g")
        for name in self.roles.edges:
            load = f"# traction.{_key(name)} = [0.0, -1.0e4]"
            yield _line(load, f"Pa, in place of it: on {self._length(name)}")

    def _length(self, name: str) -> str:
        return f"{self.lengths[name]:g} m of sides"


def _line(text: str, comment: str) -> str:
    """A line with a comment."""
    return f"{text.ljust(29)} # {comment}"


_END = (
    "",
    "[solve]",
    _line('# direction = "both"', "the live load as given, and reversed"),
    "",
    "[output]",
    _line('units = "m"', "kN, MPa and m on the console and in the report"),
)


def _quoted(text: str) -> str:
    """A string of TOML, which has JSON's escapes and one more."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007F")


def _key(name: str) -> str:
    """A key of TOML: bare if it can be."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _quoted(name)
