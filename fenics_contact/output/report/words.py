"""Words of the report: what states, residuals, keys and pictures mean."""

from __future__ import annotations

from collections.abc import Mapping

STATUS: Mapping[str, str] = {
    "limit": "a collapse state was found, and all its conditions were checked (see the appendix).",
    "unbounded": "nothing limits the live load.",
    "unstable": "the dead load alone has no equilibrium. The motion of its blocks proves this.",
    "no_equilibrium": "no equilibrium was found under the dead load alone. This is no proof that"
    " there is none.",
    "not_converged": "no verified state was found. The numbers below are not a limit load.",
}

#: The same for one of two directions of the live load that end differently.
STATUS_OF_ONE: Mapping[str, str] = {
    "limit": "verified, see the appendix.",
    "unbounded": "nothing limits it.",
    "no_equilibrium": "no equilibrium was found, which is no proof that there is none.",
    "not_converged": "not converged, no verified state was found. Its numbers below are not a limit"
    " load.",
}


def direction_words(name: str) -> str:
    """A direction of the live load in words."""
    return "live load reversed" if name == "negative" else "live load as given"


#: Name and meaning of every residual of the verification.
RESIDUALS: Mapping[str, tuple[str, str]] = {
    "equilibrium": ("equilibrium", "The forces on every node of the mesh balance."),
    "tension": ("no tension", "No joint pulls beyond its tensile strength."),
    "penetration": ("no penetration", "No block enters another one, or the ground."),
    "complementarity": ("contact", "Where a joint is open, it carries no force."),
    "friction": ("friction", "No shear force is larger than the joint allows."),
    "slip_direction": (
        "direction of slip",
        "Where a joint has slipped, the full friction acts, and it acts against the slip.",
    ),
    "work": ("work", "The live load does the work that was prescribed."),
    "mode_work": ("work of the mode", "The live load does work 1 on the collapse mode."),
    "mode_penetration": ("mode without penetration", "The blocks can move by the collapse mode."),
    "mode_elastic": ("mode of rigid blocks", "The collapse mode does not deform the blocks."),
    "mode_power": ("power", "Friction takes up all the work that the loads do on the mode."),
    "limit": (
        "limit load",
        "Rigid blocks with the friction forces of this state have the same limit load.",
    ),
    "bracket": ("bracket", "The load factor lies in its bracket."),
    "crushing": ("compressive strength", "No joint carries more than its strength."),
}

KEYS: dict[str, str] = {
    "materials": "Materials",
    "joints": "Laws of the joints between blocks",
    "foundations": "Laws on rigid ground",
    "supports": "Supports",
    "ties": "Ties",
    "yield": "tension at which it yields",
    "ground": "to the ground at",
    "young": "Young's modulus",
    "poisson": "Poisson's ratio",
    "friction": "coefficient of friction",
    "bound": "shear strength",
    "tensile_strength": "tensile strength",
    "compressive_strength": "compressive strength",
    "opened": "cohesion and tensile strength of joints that have opened",
    "dilatancy": "angle at which sliding opens the joint",
    "body": "body force",
    "profile": "factor on the body force over the height above the foot, (m, factor)",
    "method": "method asked for",
    "tolerance": "tolerance on the load factor, relative",
    "control": "what is prescribed (work of the live load, or load factor)",
    "slip": "slip is measured from",
    "engine": "what finds the load factor",
    "gap": "gap asked for, relative",
    "states": "collapse state reported",
    "accuracy": "accuracy wished",
    "time": "limit of time",
    "fast": "the load factor and its bracket alone",
}

#: What options mean that are left out.
LEFT_OUT: dict[str, str] = {
    "accuracy": "none",
    "time": "none",
    "gap": "1e-3, from 1 000 blocks on 5e-3",
}

MEANING: Mapping[str, str] = {
    "cells": "cells of the mesh",
    "dofs": "displacements (unknowns)",
    "joint_points": "joint points",
    "fixed_point": "passes of the fixed point",
    "factorizations": "factorisations",
}

PHASES: dict[str, str] = {
    "read": "reading the scene",
    "compile": "compiling the forms",
    "assemble": "assembling",
    "bonded": "one elastic solve with closed joints",
    "bounds": "bracket",
    "solve": "finding the collapse",
    "capacity": "capacity curve",
    "write": "writing files",
    "total": "all, without writing",
}

#: The file that holds outlines and motions of the blocks.
MOTION = "motion.json"

_SHOWN = {
    "collapse": "How the blocks move in the collapse",
    "forces": "Joint forces at collapse, each through its centre of pressure",
    "thrust": "Lines of thrust",
    "stress": "Principal stresses",
}

#: What pictures show, by name of the file without its ending, in the order of the page.
PICTURES: Mapping[str, str] = {
    **{name: f"{words}." for name, words in _SHOWN.items()},
    **{f"{name}_negative": f"{words}, live load reversed." for name, words in _SHOWN.items()},
    "scene": "Materials, groups and loads.",
    "capacity": "Capacity curve: load factor against displacement.",
}

RANGE = (
    "With friction the equations can have several collapse states. The load factor is that of the"
    " state that was found and verified. The bracket holds for all of them: below its lower end"
    " none exists, and beyond its upper end nothing is carried. Where the ends meet the load factor"
    " is the only one. A structure with less friction forces than this state has falls earlier, but"
    " not before the lower end."
)

NOTES = (
    "With Coulomb friction several collapse states may exist. The load factor is that of one"
    " verified state. All states lie in the bracket. Where its ends meet there is no other.",
    "The lower end of the bracket is the limit load with the least friction that any collapse state"
    " can have. Loads beyond the upper end are not carried even by rigid blocks with associative"
    " friction. What is carried without friction is surely carried.",
    "Displacements are small. The problem is planar.",
)
#: What the blocks do, without and with a compressive strength.
ELASTIC = "The blocks are elastic. They do not crush or crack."
CRUSHING = (
    "The blocks are elastic and do not crack. Straight joints crush at the compressive strength;"
    " elsewhere nothing crushes."
)

STYLE = """
body { font: 11pt/1.4 Georgia, "Liberation Serif", "DejaVu Serif", serif; max-width: 50em;
  margin: 2em auto; padding: 0 1em; }
h1, h2, h3, table, figcaption, .labels, .slider { font-family: "Helvetica Neue", Arial,
  "Liberation Sans", "DejaVu Sans", sans-serif; }
h1, h2, h3 { line-height: 1.2; page-break-after: avoid; }
h1 { font-size: 170%; margin: 0 0 0.2em; string-set: title content(); }
h2 { font-size: 130%; border-bottom: 1px solid #999; margin-top: 1.4em; }
h3 { font-size: 105%; margin-bottom: 0.3em; }
table { page-break-inside: avoid; border-collapse: collapse; margin: 0.6em 0; font-size: 85%;
  line-height: 1.3; }
th, td { border: 1px solid #bbb; padding: 0.2em 0.6em; text-align: left; vertical-align: top; }
th { font-weight: normal; background: #f3f3f3; }
tr { page-break-inside: avoid; }
.labels { font-size: 85%; color: #444; margin: 0 0 1em; }
.status { font-size: 130%; padding: 0.5em 0.8em; border: 2px solid #555; font-weight: bold; }
.limit { border-color: #27632a; }
figure { margin: 1em 0; page-break-inside: avoid; }
img { display: block; max-width: 100%; max-height: 22cm; margin: 0 auto; }
.above img { width: 100%; max-height: none; }
.beside figure { float: left; width: 42%; margin: 0.4em 0 0; }
.beside > div { margin-left: 45%; }
.beside h2 { margin-top: 0.4em; }
.beside::after { content: ""; display: block; clear: both; }
svg { display: block; width: 100%; max-height: 16cm; }
figcaption { font-size: 85%; text-align: center; }
.slider { text-align: center; margin: 0.3em 0; }
.slider input { width: 60%; vertical-align: middle; }
p, td, li { overflow-wrap: break-word; }
@page { size: A4; margin: 22mm 18mm 20mm;
  @top-left { content: string(title); font: 8pt sans-serif; color: #555; }
  @bottom-right { content: "page " counter(page) " of " counter(pages); font: 8pt sans-serif;
    color: #555; } }
@page :first { @top-left { content: none; } }
@media print {
  body { margin: 0; max-width: none; padding: 0; font-size: 10pt; }
  .appendix { font-size: 8.5pt; }
  .appendix h2 { font-size: 12pt; }
  .break { page-break-before: always; }
  .slider { display: none; }
  img { max-height: 9.5cm; }
  svg { height: 9.5cm; }
  .above img, .beside img { width: auto; max-height: var(--picture); }
}
"""
