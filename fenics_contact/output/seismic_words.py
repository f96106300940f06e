"""Words on the seismic check: its line on the console, its rows in the report."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from fenics_contact.scene.units import Units

#: Title of the rows.
TITLE = "Seismic check of this mechanism (Circolare 7/2019, C8.7.1.2.1)"


def seismic_line(check: Mapping[str, Any], units: Units) -> str:
    """The check in a line; `check` has the names of `SeismicCheck`."""
    return (
        f"seismic: a0* = {check['acceleration']:.4g} m/s2 = {check['acceleration_g']:.4g} g"
        f" (alpha0 = {check['multiplier']:.4g}, e* = {check['mass_fraction']:.4g},"
        f" FC = {check['confidence_factor']:.4g}, M* = {units.mass(check['participating_mass'])} of"
        f" {units.mass(check['moving_mass'])} that move in {check['parts']} rigid"
        f" part{'s' * (check['parts'] != 1)})"
    )


def seismic_rows(check: Mapping[str, Any] | None, units: Units) -> Iterator[tuple[str, str]]:
    """Names and values for a table; none where there is no check."""
    if check is None:
        return
    acceleration = f"{check['acceleration']:.4g} m/s2 = {check['acceleration_g']:.4g} g"
    yield "multiplier of the weights alpha0", f"{check['multiplier']:.4g}"
    yield "rigid parts that move", f"{check['parts']}"
    yield "mass that moves", units.mass(check["moving_mass"])
    yield "participating mass M*", units.mass(check["participating_mass"])
    yield "participating fraction e*", f"{check['mass_fraction']:.4g}"
    yield "confidence factor FC", f"{check['confidence_factor']:.4g}"
    yield "spectral acceleration at which it starts, a0* = alpha0 g / (e* FC)", acceleration
