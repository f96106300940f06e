"""DXF drawings to be drawn on and read."""

from __future__ import annotations

from typing import Any

import ezdxf

from fenics_contact.drawing import DxfContents, LayerRoles, read_dxf
from tests.drawing import area, rectangle


class Sheet:
    """A drawing, by default in m (DXF's unit 6; 4 are mm)."""

    def __init__(self, path: Any, unit: int = 6) -> None:
        self.path = path
        self.document = ezdxf.new("R2010", units=unit)
        self.space = self.document.modelspace()

    def polyline(self, corners: Any, layer: str = "STONE", close: bool = True, **options: Any):
        """A polyline; options are those of ezdxf, and of DXF by `dxfattribs`."""
        attributes = {"layer": layer} | options.pop("dxfattribs", {})
        self.space.add_lwpolyline(corners, close=close, dxfattribs=attributes, **options)

    def box(self, x0: float, y0: float, x1: float, y1: float, layer: str = "STONE") -> None:
        """A closed rectangle."""
        self.polyline(rectangle(x0, y0, x1, y1), layer)

    def lines(self, *pairs: Any, layer: str = "JOINTS") -> None:
        """Lines from start to end."""
        for start, end in pairs:
            self.space.add_line(start, end, dxfattribs={"layer": layer})

    def grid(self, xs: Any, ys: Any, layer: str = "JOINTS") -> None:
        """Lines through all of the extent."""
        self.lines(*(((xs[0], y), (xs[-1], y)) for y in ys), layer=layer)
        self.lines(*(((x, ys[0]), (x, ys[-1])) for x in xs), layer=layer)

    def read(self, snap: float = 0.0, **roles: str) -> DxfContents:
        """What is read of it."""
        self.document.saveas(self.path)
        layers = LayerRoles(**{role: [name] for role, name in roles.items()})
        return read_dxf(self.path, roles=layers, snap=snap)


def areas(contents: DxfContents) -> list[float]:
    """Areas of the blocks, m2, ascending."""
    return sorted(map(area, contents.drawing.blocks))


def said(contents: DxfContents, *texts: str) -> bool:
    """Whether notes have all these texts."""
    return all(text in "\n".join(contents.notes) for text in texts)
