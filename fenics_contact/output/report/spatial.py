"""What the report has of blocks in space behind page 1."""

from __future__ import annotations

from collections.abc import Iterator

from fenics_contact.output.report.answer import law_text
from fenics_contact.output.report.content import Content
from fenics_contact.output.report.html import (
    direction_words,
    heading,
    table,
)

#: What residuals mean where they are other ones than in the plane.
OF_BLOCKS = {
    "equilibrium": ("equilibrium", "The forces and moments on every block balance."),
    "pressure": ("no tension", "No contact pulls beyond its tensile strength."),
    "ties": ("ties", "No tie pushes, or pulls beyond the tension at which it yields."),
}
NOTES_IN_SPACE = (
    "Blocks are rigid; their joints are elastic. Blocks do not crack.",
    "Displacements are small.",
)
RANGE_IN_SPACE = (
    "With friction a structure can have several collapse states. The load factor is that of the"
    " state that was found and verified."
)


def contacts(content: Content) -> Iterator[str]:
    """Groups of blocks, and laws of contacts with what these do."""
    record = content.record
    scene = record["scene"]
    units = content.units
    yield heading("Appendix: blocks and contacts")
    groups = [(one["group"], one["blocks"], f"{one['volume']:.4g}") for one in scene["groups"]]
    yield table(groups, ("group", "blocks", "volume, m3"), "Blocks")
    laws = {
        f"{kind}.{name}": law_text(one, units)
        for kind in ("joints", "foundations")
        for name, one in scene[kind].items()
    }
    found = [tuple(one.values()) for one in scene["contacts"]]
    rows = [(key, laws.get(key, ""), count, f"{area:.4g}") for key, count, area in found]
    yield table(rows, ("contacts", "law", "number", "area, m2"), "Contacts")
    motions = []
    for name, end in record["directions"].items():
        if does := end["mechanism"] and end["mechanism"]["contacts"]:
            pressure = units.stress(does["pressure"], 4)
            motions.append((direction_words(name), *does["states"].values(), pressure))
    head = ("", "closed", "slide", "open along an edge", "open", "crush", "largest mean pressure")
    yield table(motions, head, "What contacts do in the collapse")
