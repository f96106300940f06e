"""Joint forces, lines of thrust, stresses and the capacity curve in the report."""

from __future__ import annotations

from collections.abc import Iterator

from fenics_contact.output.report.content import Content
from fenics_contact.output.report.html import heading, paragraph, picture
from fenics_contact.output.report.words import PICTURES

#: Forces on the joints of more blocks are too small in a picture on a page.
LEGIBLE = 120


def forces(content: Content) -> Iterator[str]:
    """Pictures of forces and stresses that say something."""
    many = content.record["mesh"]["bodies"] > LEGIBLE
    first = ("collapse", "collapse_negative", "scene", "capacity")
    found = {
        stem: address
        for stem, address in content.pictures.items()
        if stem not in first and not (many and stem.startswith("forces"))
    }
    if found:
        yield heading("Forces and stresses")
    for stem, address in found.items():
        more = " Forces are per metre of thickness." if stem.startswith("forces") else ""
        direction = "negative" if stem.endswith("_negative") else "positive"
        if content.details(direction).get("engine") == "faces" and stem.startswith("stress"):
            more = " They are those of elastic blocks under the joint forces of the state."
        yield picture(address, PICTURES[stem] + more)
    if many and "forces" in content.pictures:
        yield paragraph(
            f"The joint forces of more than {LEGIBLE} blocks are too small for this page;"
            " the picture 'forces' in the folder of the result has them."
        )
    if address := content.pictures.get("capacity", ""):
        yield heading("Capacity curve")
        yield picture(address, PICTURES["capacity"])
