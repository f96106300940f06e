"""A load factor in the words of its user: how much of which load, and which way."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from fenics_contact.geometry.mesh import Array
from fenics_contact.scene.scene import GRAVITY
from fenics_contact.scene.units import Units
from fenics_contact.search_options import SEARCH

#: A component of an acceleration below this part of the other one is none.
LEVEL = 1e-9
#: That no live load acts, in words.
DEAD = "under its dead load"
#: Relative difference of load factors below which three digits do not tell them apart.
CLOSE = 0.01


@dataclass(frozen=True)
class Line:
    """A line for the console; lines of both directions with one head become one.

    Attributes:
        head: What it is about.
        text: What is said of it.
        tail: What follows, once for both directions.
        verbose: Whether only those who ask for more (`-v`) read it.
        states: Whether it stands with the bracket, on the line on other collapse states.
    """

    head: str
    text: str = ""
    tail: str = ""
    verbose: bool = False
    states: bool = False


@dataclass(frozen=True)
class Wording:
    """How load factors of a scene are told.

    Attributes:
        units: Of forces and lengths.
        acceleration: Horizontal one at load factor 1, m/s2, where the live load is gravity sideways
            on all masses; None for other loads.
        load: Size of the live load's resultant, N per metre of thickness.
        noun: What the live load is called.
        forces: Whether it is forces at places alone: what is carried is told as a force, too.
        tilt: Horizontal body force of the live load, where it is that of a tilting table, whose
            angle is told then; else 0.
        along: In space the live load's direction, where it has an acceleration.
        both: Whether both directions of the live load are told of.
        asked: Options of the solve that the scene sets.
    """

    units: Units
    acceleration: float | None = None
    load: float = 0.0
    noun: str = "live load"
    forces: bool = False
    tilt: float = 0.0
    along: tuple[float, ...] = ()
    both: bool = False
    asked: Collection[str] = field(default_factory=frozenset)

    @classmethod
    def of(
        cls,
        loads: Mapping[str, Mapping[str, Any]],
        floors: Mapping[str, Mapping[str, Any]],
        resultant: Sequence[float],
        units: Units,
        **more: Any,
    ) -> Self:
        """For loads and floors with the names and values of a scene file."""
        live = loads["live"]
        tilt = live["body"][0] if live.get("tilt") is True else 0.0
        kinds = {name for name in ("force", "traction", "earth", "form") if live.get(name)}
        kinds |= {"body"} if any(live["body"]) else set()
        noun = "earth pressure" if kinds == {"earth"} else "live load"
        size = math.hypot(*resultant)
        return cls(units, sideways(loads, floors), size, noun, kinds == {"force"}, tilt, **more)

    @property
    def question(self) -> str:
        """What is asked of the structure."""
        if self.tilt:
            return "At which tilt of the ground does it collapse?"
        if self.acceleration is not None:
            return "At which horizontal acceleration of all masses does it collapse?"
        if self.forces:
            return "How large a force does it carry?"
        return f"How many times the {self.noun} does it carry?"

    def number(self, factor: float, sign: float = 1.0) -> float:
        """A load factor in g or degrees, or as a multiple, against the load in its direction."""
        if self.tilt:
            return math.degrees(math.atan(sign * factor)) + 0.0
        share = 1.0 if self.acceleration is None else abs(self.acceleration) / GRAVITY
        return sign * factor * share + 0.0

    @property
    def unit(self) -> str:
        """What numbers are in."""
        if self.tilt:
            return "degrees"
        return "times" if self.acceleration is None else "g"

    def way(self, direction: str) -> str:
        """Where the live load pushes."""
        negative = direction == "negative"
        pushes = self.tilt or self.acceleration
        if pushes and self.along:
            return _way_in_space(np.array(self.along) * (-1.0 if negative else 1.0))
        if pushes:
            side = "right" if (pushes > 0.0) != negative else "left"
            return f"{'down ' * bool(self.tilt)}to the {side}"
        return "reversed" if negative else "as given" * self.both

    def amount(self, factor: float, direction: str, digits: int = 4) -> str:
        """How much of the live load, and which way, in a few words."""
        sign = -1.0 if direction == "negative" else 1.0
        number = leading(self.number(factor, sign), digits)
        if self.tilt:
            return f"a tilt of {number} degrees, {self.way(direction)}"
        if self.acceleration is not None:
            return f"{number} g {self.way(direction)}"
        if sign < 0.0:
            return f"{number} times the {self.noun} reversed"
        load = f" of {self.units.force(self.load, 4)}" if self.load else ""
        if load and self.forces:
            carried = self.units.force(self.number(factor) * self.load, digits)
            return f"{number} times the {self.noun}{load}: {carried}"
        return f"{number} times the {self.noun}{load}"

    def at(self, factor: float) -> str:
        """A load factor that is given: with as many digits, as `amount`."""
        name = "negative" if factor < 0.0 else "positive"
        number = f"{abs(self.number(factor)):.6g}"
        if self.tilt:
            return f"a tilt of {number} degrees, {self.way(name)}"
        if self.acceleration is not None:
            return f"{number} g {self.way(name)}"
        return f"{number} times the {self.noun}{' reversed' * (factor < 0.0)}"

    def under(self, factor: float) -> str:
        """Under which loads a state is, with so much of the live load."""
        return f"at {self.at(factor)}" if factor else DEAD

    def beside(self, factor: float, leading: float, sign: float, outward: int = 0) -> str:
        """A number beside that of a collapse: three digits, or four where they are close.

        Bounds are rounded up (`outward` 1) or down (-1), so that they stay bounds.
        """
        value = self.number(factor, sign)
        apart = abs(value - self.number(leading, sign))
        digits = 3 if apart > CLOSE * abs(self.number(leading, sign)) else 4
        if value == 0.0 or not math.isfinite(value):
            return f"{value:g}"
        exponent = math.floor(math.log10(abs(value)))
        count = round(value * 10.0 ** (digits - 1 - exponent), 3)
        whole = {1: math.ceil, -1: math.floor}.get(outward, round)(count)
        return f"{whole * 10.0 ** (exponent + 1 - digits):.{max(digits - 1 - exponent, 0)}f}"

    def together(self, told: Sequence[tuple[str, Line]], of: Collection[str]) -> list[str]:
        """Lines as of `merged`; those on other collapse states are the first."""
        states = self.merged([item for item in told if item[1].states], of)
        others = self.merged([item for item in told if not item[1].states], of)
        return ["; ".join(states)] * bool(states) + others

    def merged(self, told: Sequence[tuple[str, Line]], of: Collection[str]) -> list[str]:
        """Lines, each with its direction, as text: those with one head are one.

        Directions are named where there are several (`of`) and they differ.
        """
        found = []
        for head in dict.fromkeys(line.head for _, line in told):
            parts = [(name, line) for name, line in told if line.head == head]
            first = parts[0][1]
            texts = [line.text for _, line in parts]
            between = "; " if any(", " in text for text in texts) else ", "
            if len(of) > 1 and (len(parts) == 1 or len(set(texts)) > 1):
                pairs = [(line.text, self.way(name)) for name, line in parts]
                texts = [" ".join(pair[:: -1 if ";" in between else 1]).strip() for pair in pairs]
            else:
                texts = texts[:1]
            found.append(f"{head} {between.join(texts)}{first.tail}".strip())
        return found


def four(value: float) -> str:
    """A number with four digits, trailing zeros too."""
    return leading(value, 4)


def leading(value: float, digits: int) -> str:
    """A number with its leading digits, trailing zeros too."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    return f"{value:.{max(digits - 1 - math.floor(math.log10(abs(value))), 0)}f}"


def meant(factor: float, gap: float, others: Iterable[float], size: float) -> int:
    """Digits of a load factor that say something: four, or three beside its gap or other states.

    Args:
        factor: Of the state that is told.
        gap: Of it, relative.
        others: Load factors of all verified states that were found.
        size: That load factors are relative to.
    """
    spread = max((abs(other - factor) for other in others), default=0.0)
    return 4 if max(gap * size, spread) <= SEARCH.higher * size else 3


def wording_of(scene: Any, resultant: Sequence[float], both: bool = False) -> Wording:
    """How the load factors of a scene are told, with both directions of the live load or one."""
    loads = {"dead": vars(scene.dead), "live": vars(scene.live)}
    along: tuple[float, ...] = ()
    if len(resultant) == 3:  # loads are those in the upright plane of the push
        push = np.array(scene.live.body)
        along = tuple((push / (np.linalg.norm(push) or 1.0)).tolist())

        def in_plane(vector: Sequence[float]) -> tuple[float, float]:
            level = sum(a * b for a, b in zip(vector, along, strict=False))
            return level, vector[-1]

        for name, load in loads.items():
            traction = {key: in_plane(one) for key, one in load["traction"].items()}
            loads[name] = {**load, "body": in_plane(load["body"]), "traction": traction}
    floors = {name: vars(floor) for name, floor in scene.floors.items()}
    asked = {name for name, value in vars(scene.solve).items() if value is True}
    more = {"along": along, "both": both, "asked": asked}
    return Wording.of(loads, floors, resultant, scene.units, **more)


def _way_in_space(vector: Array) -> str:
    """A direction in space by an axis, or by its angle."""
    axis = int(np.argmax(np.abs(vector)))
    if np.abs(vector).sum() - abs(vector[axis]) < LEVEL:
        return f"along {'+' if vector[axis] > 0.0 else '-'}{'xyz'[axis]}"
    if abs(vector[2]) < LEVEL:
        degrees = math.degrees(math.atan2(vector[1], vector[0])) % 360.0  # as `loads.live.angle`
        return f"at {degrees:.3g} degrees from +x towards +y"
    return f"along ({', '.join(f'{part + 0.0:.3g}' for part in vector)})"


def sideways(
    loads: Mapping[str, Mapping[str, Any]], floors: Mapping[str, Mapping[str, Any]]
) -> float | None:
    """Horizontal acceleration of the live load at load factor 1, m/s2; None for other loads.

    The live load is then the horizontal body force, and the dead load has the weight. A weight that
    is given as a traction may be pushed along, by the same part of it; floors are with their mass.
    """
    dead = loads["dead"]
    live = loads["live"]
    x, y = live["body"]
    down = -dead["body"][1]
    others = [live.get(name) for name in ("force", "earth", "form", "tilt")]
    others += [not one["mass"] for one in floors.values()]  # weights that are not pushed
    uniform = live.get("profile") in (None, "uniform")
    if not x or abs(y) > LEVEL * abs(x) or down <= 0.0 or not uniform or any(others):
        return None
    resting = dead.get("traction") or {}
    for name, (along, up) in (live.get("traction") or {}).items():
        weight = -resting.get(name, (0.0, 0.0))[1]
        same = math.isclose(along, weight * x / down, rel_tol=1e-3)
        if not same or weight <= 0.0 or abs(up) > LEVEL * abs(along):
            return None
    return float(x)


def state_in_words(status: str, at: str, reason: str, proved: bool) -> str:
    """Whether a structure stands under given loads (`at`), in a sentence.

    What its blocks do is behind a colon in the reason.
    """
    if status == "equilibrium":
        return f"it stands {at} (verified{f'; {reason}' * bool(reason)})"
    if status == "not_converged":
        return f"not known whether it stands {at}: {reason}"
    if not proved:
        return f"no equilibrium was found {at}, which is no proof that there is none"
    blocks = reason.partition(": ")[2]
    return f"it does not stand {at}{f': {blocks}' * bool(blocks)}"
