"""Numbers and units for people: SI as in files, or kN, MPa and lengths in m or mm.

Files keep SI units, and forces per metre of thickness, whatever is chosen here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

#: Choices of `output.units`, and the units that they stand for.
UNITS: Mapping[str, str] = {"SI": "N, Pa, m", "m": "kN, MPa, m", "mm": "kN, MPa, mm"}
PER_METRE = "per metre of thickness"
#: A component below this part of the larger one is what rounding left of 0.
ROUNDING = 1e-12

#: Unit in SI, factor and unit in kN and MPa; units that are not here stay.
_FORCES = ("N", "N/m", "N/m2", "N/m3", f"N {PER_METRE}", f"N/m {PER_METRE}")
_SPACED = (f"N {PER_METRE}, N with a spacing", f"N/m {PER_METRE}, N/m with a spacing")
_ENGINEERS = {unit: (1e-3, unit.replace("N", "kN")) for unit in (*_FORCES, *_SPACED)}
_ENGINEERS["Pa"] = (1e-6, "MPa")


@dataclass(frozen=True)
class Units:
    """How quantities are written for people.

    Attributes:
        name: One of `UNITS`.
        thickness: Of the structure, m. Forces of a whole structure are multiplied by it; None:
            they are per metre of thickness.
    """

    name: str = "SI"
    thickness: float | None = None

    @property
    def of_report(self) -> Units:
        """Units of the report: kN, MPa, and m or mm."""
        return Units("mm" if self.name == "mm" else "m", self.thickness)

    def converted(self, value: float, unit: str) -> tuple[float, str]:
        """A value and its unit, from those in SI."""
        if unit == "m":
            return (1e3 * value, "mm") if self.name == "mm" else (value, "m")
        factor, name = (1.0, unit) if self.name == "SI" else _ENGINEERS.get(unit, (1.0, unit))
        return factor * value, name

    def text(self, value: float, unit: str, digits: int = 6) -> str:
        """A value with its unit, from those in SI."""
        number, name = self.converted(value, unit)
        return f"{number:.{digits}g} {name}"

    def length(self, value: float, digits: int = 6) -> str:
        """A length, from m."""
        return self.text(value, "m", digits)

    def small(self, value: float, digits: int = 3) -> str:
        """A displacement or the length of a hinge, from m: in mm, in SI too."""
        return f"{1e3 * value:.{digits}g} mm"

    def stress(self, value: float, digits: int = 6) -> str:
        """A stress or a strength, from Pa."""
        return self.text(value, "Pa", digits)

    @property
    def force_unit(self) -> str:
        """Unit of forces on the structure: "kN/m" is per metre of thickness."""
        unit = "N" if self.name == "SI" else "kN"
        return unit if self.thickness else f"{unit}/m"

    def force_number(self, value: float) -> float:
        """A force on the structure in `force_unit`, from N per metre of thickness."""
        return value * (self.thickness or 1.0) * (1.0 if self.name == "SI" else 1e-3) + 0.0

    def force(self, value: float, digits: int = 6) -> str:
        """A force on the structure, from N per metre of thickness."""
        return f"{self.force_number(value):.{digits}g} {self.force_unit}"

    def bulk(self, value: float, unit: str, digits: int = 6) -> str:
        """A volume or an area of the structure, from that per metre of thickness."""
        whole = f"{value * (self.thickness or 1.0):.{digits}g} {unit}"
        return whole if self.thickness else f"{whole} {PER_METRE}"

    def mass(self, value: float) -> str:
        """A mass of the structure, from kg per metre of thickness; in tonnes beside kN."""
        factor, unit = (1.0, "kg") if self.name == "SI" else (1e-3, "t")
        return self.bulk(factor * value, unit, 4)

    def forces(self, force: Sequence[float], digits: int = 6) -> str:
        """Two components of a force on the structure, from N per metre of thickness.

        A component that rounding has left beside a large one is 0.
        """
        least = ROUNDING * max(abs(value) for value in force)
        parts = [self.force_number(value if abs(value) > least else 0.0) for value in force]
        pair = ", ".join(f"{part:.{digits}g}" for part in parts)
        return f"({pair}) {self.force_unit.replace('/m', f' {PER_METRE}')}"

    def place(self, place: Sequence[float], digits: int = 4) -> str:
        """Coordinates, from m, without what rounding leaves of 0."""
        values = [self.converted(round(value, 9) + 0.0, "m")[0] for value in place]
        pair = ", ".join(f"{value:.{digits}g}" for value in values)
        return f"({pair}) {self.converted(0.0, 'm')[1]}"


def rounded_alike(numbers: Sequence[float], digits: int = 5) -> list[str]:
    """Numbers with as many decimals as the first one needs for its leading digits."""
    first = abs(numbers[0]) if math.isfinite(numbers[0]) else 0.0
    exponent = math.floor(math.log10(first)) if first > 0.0 else 0
    if exponent < -4 or exponent > 8:
        form = f".{digits - 1}e"
    else:
        form = f".{max(digits - 1 - exponent, 0)}f"
    return [format(number, form) if number else "0" for number in numbers]
