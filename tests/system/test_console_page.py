"""Page 1 of the report on eight structures, word for word."""

from __future__ import annotations

import re

import pytest

from fenics_contact.output.files import result_record
from fenics_contact.output.report.answer import first_page
from fenics_contact.output.report.content import Content
from tests.eight import EIGHT, collapse

ASIDE = "At which horizontal acceleration of all masses does it collapse?"
UNCRACKED = "Blocks do not crack: that is not in the model."
TOLD = {
    "facade": [
        ASIDE,
        "It collapses at 0.4168 g to the right, 0.4168 g to the left (verified). Seismic check: "
        "it starts at a spectral acceleration a0* of 3.036 m/s2 = 0.3095 g.",
        "To the right: the right part (26 blocks) rocks to the right about its lower right "
        "corner, the upper left part (2 blocks) turns to the left, tie eaves yields.",
        "To the left: the same, mirrored.",
        "Lowest collapse state found, with any self-stress: this one; nothing carries more "
        "than 0.477.",
        "Mesh and stiffness: 0.4168 to 0.454 while this mechanism stays.",
        "Ties of 2 kN/m: from 0.4158 to 0.4168 g.",
        "Ties: eaves 2 kN/m (yields).",
    ],
    "gate": [
        ASIDE,
        "It collapses at 0.2500 g to the right (verified).",
        "The upper block (8) moves to the right, the left part (4 blocks) rocks to the "
        "right about its lower right corner, the right part (4 blocks) rocks to the right "
        "about its lower right corner.",
        "No other collapse state exists.",
    ],
    "bridge": [
        "How large a force does it carry?",
        "It collapses at 9.950 times the live load of 10 kN/m: 99.5 kN/m (verified).",
        "The right part (13 blocks) rocks to the right about its lower right corner, the "
        "upper middle part (14 blocks) turns to the left, 3 upper left parts turn to the "
        "right, the upper left block (15) rocks to the right about its lower left corner, "
        "1 smaller part moves between these.",
        "Lowest collapse state found, with any self-stress: this one; nothing carries more "
        "than 10.6 times.",
    ],
    "retaining wall": [
        "How many times the earth pressure does it carry?",
        "It collapses at 2.164 times the earth pressure of 14.69 kN/m (verified).",
        "The whole structure slides to the left.",
        "Lowest collapse state found, with any self-stress: this one; nothing carries more "
        "than 2.164.",
    ],
    "arch": [
        ASIDE,
        "It collapses at 0.1505 g to the right (verified).",
        "The upper left part (5 blocks) turns to the right, the upper right part (5 blocks) "
        "turns to the left, the lower right part (3 blocks) rocks to the right about its "
        "lower right corner.",
        "No other collapse state exists.",
    ],
    "tower": [
        ASIDE,
        "It collapses at 0.292 g to the right (verified).",
        "The main part (33 blocks) rocks to the right about its lower right corner.",
        "Lowest collapse state found, with any self-stress: 0.2898; nothing carries more "
        "than 0.299.",
        "Mesh and stiffness: 0.2898 to 0.299 while this mechanism stays.",
    ],
    "ring": [
        "How large a force does it carry?",
        "It collapses at 9.071 times the live load of 10 kN/m: 90.71 kN/m (verified).",
        "The upper right part (4 blocks) slides to the right, the upper left part (4 "
        "blocks) slides to the left, the upper middle block (7) slides down.",
        "Lowest collapse state found, with any self-stress: this one; nothing carries more "
        "than 9.072 times.",
    ],
    "wall with opening": [
        ASIDE,
        "It collapses at 0.2943 g to the left (verified).",
        "The main part (23 blocks) rocks to the left about its lower left corner.",
        "Lowest collapse state found, with any self-stress: this one; nothing carries more "
        "than 0.328.",
        "Crushing: base crushes over 134 mm at (0, 0).",
    ],
}


def words(page: str) -> list[str]:
    """Question, answer, collapse and what decides, between the line on the run and the table."""
    page = page[page.index('<p class="question">') : page.index("<h2>Assumptions")]
    texts = re.findall(r"<(?:p|li)[^>]*>(.*?)</(?:p|li)>", page)
    return [text for text in texts if text != UNCRACKED]


@pytest.mark.parametrize("name", EIGHT)
def test_question_answer_collapse_and_what_decides(name):
    page = "".join(first_page(Content(result_record(collapse(name)))))
    assert words(page) == TOLD[name]
    assert UNCRACKED in page
