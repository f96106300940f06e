"""What `solve` says of eight structures, word for word."""

from __future__ import annotations

import pytest

from tests.eight import EIGHT, collapse

TOLD = {
    "facade": """\
it collapses at 0.4168 g to the right, 0.4168 g to the left (verified)
lowest collapse state found, with any self-stress: this one; nothing carries more than 0.477
mesh and stiffness: 0.4168 to 0.454 while this mechanism stays
seismic check: it starts at a spectral acceleration a0* of 3.036 m/s2 = 0.3095 g
ties of 2 kN/m: from 0.4158 to 0.4168 g
ties: eaves 2 kN/m (yields)
""",
    "gate": """\
it collapses at 0.2500 g to the right (verified)
no other collapse state exists
""",
    "bridge": """\
it collapses at 9.950 times the live load of 10 kN/m: 99.5 kN/m (verified)
lowest collapse state found, with any self-stress: this one; nothing carries more than 10.6 times
""",
    "retaining wall": """\
it collapses at 2.164 times the earth pressure of 14.69 kN/m (verified)
lowest collapse state found, with any self-stress: this one; nothing carries more than 2.164
""",
    "arch": """\
it collapses at 0.1505 g to the right (verified)
no other collapse state exists
""",
    "tower": """\
it collapses at 0.292 g to the right (verified)
lowest collapse state found, with any self-stress: 0.2898; nothing carries more than 0.299
mesh and stiffness: 0.2898 to 0.299 while this mechanism stays
""",
    "ring": """\
it collapses at 9.071 times the live load of 10 kN/m: 90.71 kN/m (verified)
lowest collapse state found, with any self-stress: this one; nothing carries more than 9.072 times
""",
    "wall with opening": """\
it collapses at 0.2943 g to the left (verified)
lowest collapse state found, with any self-stress: this one; nothing carries more than 0.328
crushing: base crushes over 134 mm at (0, 0)
""",
}

#: What only those read who ask for more.
MORE = ("residual", "bracket", "factorisation", "verified:", "skipped", "not known", "solve.")


@pytest.mark.parametrize("name", EIGHT)
def test_the_answer_in_a_few_lines(name):
    told = collapse(name).summary()
    assert f"{told}\n" == TOLD[name]
    most = 5 + ("ties of" in told)  # what ties bring
    assert len(told.splitlines()) <= most and not any(word in told for word in MORE)
