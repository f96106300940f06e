"""Every scene of the bank has the load factor that is known of it, inside its bracket."""

from __future__ import annotations

import pytest

from fenics_contact import LimitLoad, limit_load
from tests.bank import BANK, WALLS, Known, known

#: Over a second each, of kinds of which others are quick.
SECONDS = (
    "arch wall 0.6 to the right",
    "arch wall 0.6 to the left",
    "gable 0.6 to the left",
    "stone of 0.001 on a block",
    "slabs of 1000 to 1 300",
    "cells of 1000 to 1 4000",
    "10x10 coulomb 0.75 fine",
)
#: The quick ones of kinds that are alike.
FEW = {
    "feet of": ("feet of 0.0001 0.5", "feet of 0.01 2"),
    "contrast": ("contrast 1e-06 stack 0.1", "contrast 1e+06 stack 0.7", "contrast 1e+06 W1"),
    "arch ": (
        *("arch 7 0.2", "arch 27 0.15", "arch 27 0.395 0.106723", "arch 44 0.3091 0.5"),
        *(
            f"arch {count} 1 least thickness {than}"
            for count in (7, 27)
            for than in ("less", "more")
        ),
    ),
    "wedge": ("wedge 0.1", "wedge 0.57 near locking", "wedge 0.6 near locking"),
}
#: Of walls over friction and strength, which are alike, the quick ones.
ALIKE = {
    "tresca": {"W1 tresca 0.5 kPa", "W2 tresca 2 kPa", "W3 tresca 8 kPa", "W4 tresca 2 kPa"},
    "bracket": {
        f"{name} bracket {f:g}" for name, f in zip(WALLS, (0.3, 0.65, 0.8, 1), strict=True)
    },
    "wall": {f"{name} coulomb 0.65" for name in WALLS} | {"W4 coulomb 0.65 fine"},
}


def is_slow(entry: Known) -> bool:
    """Whether a test of an entry is a slow one."""
    about = entry.tags - ({"wall"} if {"tresca", "bracket"} & entry.tags else set())
    quick = [names for tag, names in ALIKE.items() if tag in about]
    quick += [set(names) for begin, names in FEW.items() if entry.name.startswith(begin)]
    dear = "slow" in entry.tags or entry.name in SECONDS
    return dear or any(entry.name not in names for names in quick)


def cases(entries: list[Known]) -> pytest.MarkDecorator:
    """Parameter `entry`, whose name is the test's; slow entries are marked as such."""
    marked = [
        pytest.param(e, id=e.name, marks=[pytest.mark.slow] if is_slow(e) else [])
        for e in entries
        if "open" not in e.tags
    ]
    return pytest.mark.parametrize("entry", marked)


def solved(entry: Known, **options: float) -> LimitLoad:
    """The result, which must be right."""
    result = limit_load(entry.scene(**options))
    found = (result.status, result.load_factor)
    assert entry.right(*found), f"{found}, known is {entry.expected} from {entry.source}"
    return result


@cases([e for e in BANK.values() if not {"tresca", "bracket", "arch"} & e.tags])
def test_load_factor(entry):
    result = solved(entry)
    if entry.status != "limit":
        return
    slack = 1e-6 * (entry.size or abs(result.load_factor))
    assert result.load_factor <= result.bounds.upper + slack
    # Without friction the dead load may not stand; then there is no lower end.
    assert result.bounds.lower is None or result.bounds.lower - slack <= result.load_factor


@cases(known("tresca") + known("arch", without=("least",)))
def test_load_factor_equals_linear_program(entry):
    """Given friction, or friction that is never overcome: the program of rigid blocks is exact."""
    result = solved(entry)
    assert result.load_factor == pytest.approx(result.bounds.upper, rel=1e-8)


@cases(known("bracket"))
def test_bracket(entry):
    result = solved(entry)
    assert result.bounds.lower == pytest.approx(0.0, abs=1e-9)
    assert result.bounds.upper == pytest.approx(entry.interval[1], abs=5.1e-6)


@cases(known("arch", "least"))
def test_least_thickness_of_an_arch(entry):
    solved(entry)


@pytest.mark.slow
@pytest.mark.parametrize("entry", known("open"), ids=lambda entry: entry.name)
def test_what_is_not_solved_is_not_claimed(entry):
    result = limit_load(entry.scene())
    assert result.status == "not_converged" or entry.right(result.status, result.load_factor)


def test_the_bank_has_a_source_for_everything():
    assert len(BANK) > 100
    assert all(len(entry.source) > 20 for entry in BANK.values())
    assert {e.status for e in BANK.values()} == {"limit", "unbounded", "unstable"}
