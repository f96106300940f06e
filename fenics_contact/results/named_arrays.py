"""Arrays of a result by name, over all joint points or all blocks, for people."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.discretization.layout import Layout
from fenics_contact.geometry.mesh import Array
from fenics_contact.results.joint_values import JointValues, tie_values

Values = npt.NDArray[Any]


class NamedArrays(Mapping[str, Values]):
    """Read-only arrays by name, computed when they are first asked for."""

    def __init__(self, what: str, sources: Mapping[str, Callable[[], Values]]) -> None:
        """Name what the arrays go over, and how each is computed."""
        self._what = what
        self._sources = sources
        self._found: dict[str, Values] = {}

    def __getitem__(self, name: str) -> Values:
        if name not in self._sources:
            raise KeyError(f"no '{name}' of {self._what}; there is {', '.join(self)}")
        if name not in self._found:
            array = np.asarray(self._sources[name]()).view()
            array.flags.writeable = False
            self._found[name] = array
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._sources)

    def __len__(self) -> int:
        return len(self._sources)

    def __repr__(self) -> str:
        return f"<{self._what}: {', '.join(self)}>"


def joint_arrays(layout: Layout, values: JointValues | None) -> NamedArrays:
    """Arrays over all joint points; the state is left out where there is none.

    | name | unit | |
    |---|---|---|
    | `position`, `normal`, `tangent` | m, 1, 1 | shape (points, 2); normal to the second block |
    | `length` | m | length of joint that belongs to the point |
    | `blocks` | | first and second block, -1 for rigid ground, shape (points, 2) |
    | `group` | | name of the joint or foundation |
    | `friction` | 1 | coefficient of friction |
    | `pressure`, `shear` | Pa | positive in compression; along the tangent on the second block |
    | `force` | N/m | force on the second block in x and y, shape (points, 2) |
    | `gap`, `slip` | m | opening, and slip along the tangent |
    | `opening_rate`, `slip_rate` | m | in the collapse mode, on which the live load does work 1 |
    | `state` | | 0 open, 1 slip, 2 stick |
    """
    joints = layout.joints.without_ties()
    values = values and values.first(joints.joint_count)
    sources: dict[str, Callable[[], Values]] = {
        "position": lambda: joints.position,
        "normal": lambda: joints.normal,
        "tangent": lambda: joints.tangent,
        "length": lambda: joints.length,
        "blocks": lambda: joints.bodies,
        "group": lambda: np.array(joints.names, dtype=str)[joints.law],
        "friction": lambda: joints.friction,
    }
    if values is not None:
        names = "pressure", "shear", "gap", "slip", "opening_rate", "slip_rate"
        sources |= {name: partial(getattr, values, name) for name in names}
        sources |= {
            "force": partial(values.force, joints.normal, joints.tangent),
            "state": partial(getattr, values, "contact"),
        }
    return NamedArrays("joints", sources)


def tie_arrays(layout: Layout, values: JointValues | None) -> NamedArrays:
    """Arrays over the bars of all ties; the state is left out where there is none.

    | name | unit | |
    |---|---|---|
    | `name` | | name of the tie; an end at a group on several blocks has a bar to each of them |
    | `ends` | m | first and second end, shape (bars, 2, 2) |
    | `blocks` | | of both ends, -1 for the ground, shape (bars, 2) |
    | `yield` | N/m | tension at which the bar yields, per metre of thickness |
    | `force` | N/m | tension |
    | `elongation` | m | from the structure as drawn |
    | `elongation_rate` | m | in the collapse mode, on which the live load does work 1 |
    | `state` | | 0 slack, 1 elastic, 2 yields |
    """
    bars = layout.joints.ties
    if bars is None:
        return NamedArrays("ties", {})
    found = values and tie_values(layout.joints, values)
    sources: dict[str, Callable[[], Values]] = {
        "name": partial(getattr, bars, "name"),
        "ends": partial(getattr, bars, "sides"),
        "blocks": partial(getattr, bars, "bodies"),
        "yield": partial(getattr, bars, "yields"),
    }
    if found is not None:
        names = "force", "elongation", "elongation_rate", "state"
        sources |= {name: partial(getattr, found, name) for name in names}
    return NamedArrays("ties", sources)


def block_arrays(layout: Layout, displacement: Array | None, mode: Array | None) -> NamedArrays:
    """Arrays over all blocks; motions are left out where there are none.

    | name | unit | |
    |---|---|---|
    | `centre` | m | centre of its area, shape (blocks, 2) |
    | `area` | m2 | |
    | `dead_load`, `live_load` | N/m | resultants, for a load factor of 1, shape (blocks, 2) |
    | `displacement` | m | of its centre at collapse, shape (blocks, 2) |
    | `rotation` | rad | at collapse, anticlockwise |
    | `mode`, `mode_rotation` | m, rad | in the collapse mode, on which the live load does work 1 |

    Collective: a motion must be asked for on all ranks together. `displacement` and `mode` are
    this rank's part, in the supports' coordinates.
    """
    bodies = layout.bodies
    sources: dict[str, Callable[[], Values]] = {
        "centre": lambda: layout.centroid,
        "area": partial(layout.boundary.areas, bodies.centre),
        "dead_load": lambda: bodies.dead[:, :2],
        "live_load": lambda: bodies.live[:, :2],
    }
    for name, turn, values in (
        ("displacement", "rotation", displacement),
        ("mode", "mode_rotation", mode),
    ):
        if values is not None:
            sources[name] = partial(_motions, layout, values, slice(2))
            sources[turn] = partial(_motions, layout, values, 2)
    return NamedArrays("blocks", sources)


def _motions(layout: Layout, values: Array, columns: int | slice) -> Values:
    return layout.centroid_motions(values)[:, columns]
