"""What the report has of blocks in space behind page 1."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

from fenics_contact.output.report.answer import law_text
from fenics_contact.output.report.content import Content
from fenics_contact.output.report.html import (
    PHASES,
    PICTURES,
    STATUS,
    bullets,
    direction_words,
    heading,
    paragraph,
    picture,
    table,
    value_text,
)

#: What residuals mean where they are other ones than in the plane.
OF_BLOCKS = {
    "equilibrium": ("equilibrium", "The forces and moments on every block balance."),
    "pressure": ("no tension", "No contact pulls beyond its tensile strength."),
    "ties": ("ties", "No tie pushes, or pulls beyond the tension at which it yields."),
}
NOTES = (
    "Blocks are rigid; their joints are elastic. Blocks do not crack.",
    "Displacements are small.",
    "With friction a structure can have several collapse states. The load factor is that of the"
    " state that was found and verified.",
)


def turning(content: Content) -> Iterator[str]:
    """The page that turns and moves the blocks, inside of this one; not in print."""
    if content.viewer:
        yield heading("How it fails")
        frame = 'title="Blocks in space" style="width: 100%; height: 36em; border: 0"'
        yield f'<iframe {frame} srcdoc="{escape(content.viewer)}"></iframe>'


def bounds(content: Content) -> Iterator[str]:
    """Load factor, what is proved of it, other states and tensions of ties, by direction."""
    units = content.units
    if content.record["ends"]:
        yield heading("Load factors")
    for direction, end in content.record["ends"].items():
        yield heading(f"Load factor, {direction_words(direction)}", 3)
        if end["status"] != "limit":
            yield paragraph(
                STATUS[end["status"]], f"Reason: {end['reason']}." * bool(end["reason"])
            )
            continue
        known = {
            "load factor": (end["load_factor"], ".6g"),
            "gap of its proof, relative": (end["gap"], ".1e"),
            "lowest collapse state found": (end["lowest"], ".6g"),
            "nothing carries more than": (end["bounds"]["upper"], ".6g"),
        }
        rows = [(name, f"{value:{form}}") for name, (value, form) in known.items() if value]
        yield table(rows)
        yield paragraph(f"{end['proof'][0].upper()}{end['proof'][1:]}.") if end["proof"] else ""
        ties = content.record["scene"]["ties"].items()
        forces = [
            (name, units.force(tension, 4), units.force(tie["yield"], 4))
            for (name, tie), tension in zip(ties, end["tensions"] or (), strict=False)
        ]
        yield table(forces, ("tie", "tension", "yields at"), "Ties")
    for direction in list(content.record["ends"])[1:]:
        if address := content.picture_of("collapse", direction):
            yield picture(address, PICTURES["collapse_negative"])


def contacts(content: Content) -> Iterator[str]:
    """Groups of blocks, and laws of contacts with what these do."""
    record = content.record
    scene = record["scene"]
    units = content.units
    yield heading("Appendix: blocks and contacts")
    rows = [(one["group"], one["blocks"], f"{one['volume']:.4g}") for one in scene["groups"]]
    yield table(rows, ("group", "blocks", "volume, m3"), "Blocks")
    laws = {
        f"{kind}.{name}": one
        for kind in ("joints", "foundations")
        for name, one in scene[kind].items()
    }
    yield table(
        (
            (
                one["group"],
                law_text(laws[one["group"]], units) if one["group"] in laws else "",
                one["contacts"],
                f"{one['area']:.4g}",
            )
            for one in scene["contacts"]
        ),
        ("contacts", "law", "number", "area, m2"),
        "Contacts",
    )
    motions: list[tuple[str, ...]] = [
        (
            direction_words(name),
            *map(str, does["states"].values()),
            units.stress(does["pressure"], 4),
        )
        for name, end in record["ends"].items()
        if end["mechanism"] and (does := end["mechanism"]["contacts"])
    ]
    head = ("", "closed", "slide", "open along an edge", "open", "crush", "largest mean pressure")
    yield table(motions, head, "What contacts do in the collapse")


def limits_of_the_model(content: Content) -> Iterator[str]:
    """What readers should know of the theory."""
    yield heading("What to know when you use these numbers")
    yield bullets(NOTES)


def options_and_times(content: Content) -> Iterator[str]:
    """Options, counts, times and versions."""
    record = content.record
    yield heading("Appendix: how it was computed")
    given = {name: value_text(value) for name, value in record["scene"]["solve"].items()}
    rows = [(name, told) for name, told in given.items() if told != "-"]
    rows += [("points of contact", record["mesh"]["joint_points"])]
    rows += [("factorisations", record["iterations"]["factorizations"])]
    rows += [("processes (MPI ranks)", record["ranks"]), ("date (UTC)", record["date"])]
    yield table(rows)
    seconds = record["seconds"].items()
    yield table(
        [(PHASES.get(name, name), f"{value:.3g} s") for name, value in seconds], (), "Times"
    )
    named = {"fenics-contact": record["version"], **record["versions"]}
    yield table([(k, version or "not known") for k, version in named.items()], (), "Versions")
