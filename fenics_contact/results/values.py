"""Forces and motions of joint points, ties and blocks in a state and its collapse mode.

The same by name, and what blocks do in a collapse mode or a fall, for people.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from fenics_contact.discretization.joints import Joints
from fenics_contact.discretization.layout import Layout
from fenics_contact.discretization.soil import places_of_soil
from fenics_contact.geometry.mesh import Array, Indices
from fenics_contact.results.block_view import ContactState
from fenics_contact.results.wording import Line
from fenics_contact.scene.units import Units
from fenics_contact.search_options import SEARCH


@dataclass(frozen=True)
class JointValues:
    """Values at all joint points, in the order of `Joints`, shape (points,); alike on all ranks.

    Attributes:
        normal_force: r_N, N per metre of thickness; below 0 where a bond is pulled.
        shear_force: r_T on the second side along the tangent, N per metre of thickness.
        pressure: r_N over the length of the point, Pa.
        shear: r_T over the length of the point, Pa.
        gap: Opening B_N u, m.
        slip: B_T u, m.
        opening_rate: Opening in the collapse mode.
        slip_rate: Slip in the collapse mode.
        clearance_rate: Opening in the collapse mode beyond that by slip, of joints that dilate.
        bond: Tensile force that is carried, N per metre of thickness.
    """

    normal_force: Array
    shear_force: Array
    pressure: Array
    shear: Array
    gap: Array
    slip: Array
    opening_rate: Array
    slip_rate: Array
    clearance_rate: Array
    bond: Array

    def first(self, count: int) -> JointValues:
        """Values at the first points: those of joints, before those of ties."""
        return JointValues(*(getattr(self, item.name)[:count] for item in fields(self)))

    @property
    def opens(self) -> npt.NDArray[np.bool_]:
        """Points that open in the collapse mode."""
        return self.clearance_rate > self._moving_rate

    @property
    def slips(self) -> npt.NDArray[np.bool_]:
        """Points that slip in the collapse mode, closed or not."""
        return np.abs(self.slip_rate) > self._moving_rate

    @property
    def contact(self) -> npt.NDArray[np.int64]:
        """`ContactState` of every point."""
        contact = np.where(self.slips, ContactState.SLIP, ContactState.STICK)
        force = self.normal_force + self.bond
        loaded = force > SEARCH.verified * force.max(initial=0.0)
        contact[~loaded | self.opens] = ContactState.OPEN
        return contact

    def force(self, normal: Array, tangent: Array) -> Array:
        """Force on the second side in x and y, N per metre of thickness, shape (points, 2).

        `normal` and `tangent` are those of `Joints`.
        """
        return self.normal_force[:, None] * normal + self.shear_force[:, None] * tangent

    def hinges(self, neighbours: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        """Joint points that do not open in the collapse mode, while their neighbours all do.

        Points without force are among them: shorter hinges may press them. `neighbours` are pairs
        of points next to each other, `Joints.neighbours`.
        """
        opens = self.opens
        has_neighbour = np.zeros(len(opens), dtype=bool)
        alone = np.ones(len(opens), dtype=bool)
        for ends in (neighbours, neighbours[:, ::-1]):
            has_neighbour[ends[:, 0]] = True
            alone[ends[~opens[ends[:, 1]], 0]] = False
        return np.flatnonzero(has_neighbour & alone & ~opens)

    @property
    def _moving_rate(self) -> float:
        rates = np.abs([self.opening_rate, self.slip_rate])
        return SEARCH.slight * float(rates.max(initial=0.0))


#: Tensions this close to 0, or to the yield, are there; relative to the yield.
AT_END = 1e-6


class TieState(IntEnum):
    """What a tie does."""

    SLACK = 0
    ELASTIC = 1
    YIELDS = 2


def tie_values(joints: Joints, values: JointValues, soil: bool = False) -> dict[str, Any]:
    """Values of the bars of ties, or of soil, as of `tie_arrays`; none where there are no bars."""
    if joints.ties is None:
        return {}
    mine, bars = joints.ties.part(soil)
    at = joints.joint_count + np.flatnonzero(mine)
    tension = 0.5 * bars.yields - values.shear_force[at]  # t = Y/2 - r_T
    force = np.clip(tension, 0.0, bars.yields)  # rounding
    return {
        "name": bars.name,
        "force": force,
        "elongation": values.slip[at] + (tension - bars.prestress) * bars.compliance,
        "elongation_rate": values.slip_rate[at],
        "state": np.digitize(force / bars.yields, [AT_END, 1.0 - AT_END]),
    }


@dataclass(frozen=True)
class SoilForce:
    """What a soil presses with, level, N per metre of thickness.

    Attributes:
        name: Of the scene's soil.
        force: Sum of its pressure; nan without a state.
        active: The least.
        passive: The largest.
        state: "active", "passive", "between", or "" without a state.
    """

    name: str
    force: float
    active: float
    passive: float
    state: str


def soil_forces(layout: Layout, values: JointValues | None) -> tuple[SoilForce, ...]:
    """Forces of all soils, in a state of the joints if there is one."""
    found = None if values is None else tie_values(layout.joints, values, soil=True)
    forces = []
    for name, places in places_of_soil(layout.scene, layout.boundary).items():
        stress = float(places.stress.sum())
        least, most = (part * stress for part in layout.scene.soil[name].coefficients)
        more = float(found["force"][found["name"] == name].sum()) if found else 0.0
        part = more / (most - least) if most > least else 0.0
        state = "between" if AT_END < part < 1.0 - AT_END else ("active", "passive")[part > 0.5]
        known = values is not None
        forces.append(
            SoilForce(name, least + more if known else np.nan, least, most, state if known else "")
        )
    return tuple(forces)


class NamedArrays(Mapping[str, npt.NDArray[Any]]):
    """Read-only arrays by name, computed when they are first asked for."""

    def __init__(self, what: str, sources: Mapping[str, Callable[[], npt.NDArray[Any]]]) -> None:
        """Name what the arrays go over, and how each is computed."""
        self._what = what
        self._sources = sources
        self._found: dict[str, npt.NDArray[Any]] = {}

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
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
    sources: dict[str, Callable[[], npt.NDArray[Any]]] = {
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
    if layout.joints.ties is None or len(layout.joints.ties.names) == layout.joints.ties.soils:
        return NamedArrays("ties", {})
    bars = layout.joints.ties.part(False)[1]
    found = values and tie_values(layout.joints, values)
    sources: dict[str, Callable[[], npt.NDArray[Any]]] = {
        "name": partial(getattr, bars, "name"),
        "ends": partial(getattr, bars, "sides"),
        "blocks": partial(getattr, bars, "bodies"),
        "yield": partial(getattr, bars, "yields"),
    }
    if found:
        sources |= {name: partial(np.asarray, array) for name, array in found.items()}
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
    sources: dict[str, Callable[[], npt.NDArray[Any]]] = {
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


def _motions(layout: Layout, values: Array, columns: int | slice) -> npt.NDArray[Any]:
    return layout.centroid_motions(values)[:, columns]


def tension_lines(ties: Mapping[str, Any], units: Units) -> list[Line]:
    """Forces of ties, one by one; of those with several bars the sum of all that share it.

    Of many that are slack, as along a line, their number.
    """
    if "state" not in ties:
        return []
    texts, slack = [], []
    for name in dict.fromkeys(ties["name"].tolist()):
        mine = ties["name"] == name
        force, states = ties["force"][mine].sum(), ties["state"][mine]
        state = states[0] if np.all(states == states[0]) else TieState.ELASTIC
        if state == TieState.SLACK:
            slack.append(f"{name} (slack)")
        else:
            texts.append(f"{name} {units.force(force, 4)} ({TieState(state).name.lower()})")
    slack = [f"{len(slack)} slack"] if len(slack) > NAMED else slack
    return [Line("ties:", ", ".join(texts + slack))]


def soil_lines(soils: Sequence[SoilForce], units: Units) -> list[Line]:
    """What soils press with, one by one."""
    texts = [
        f"{one.name} {units.force(one.force, 4)} ({one.state}, from {units.force(one.active, 4)} to"
        f" {units.force(one.passive, 4)})"
        for one in soils
        if one.state
    ]
    return [Line("soil:", ", ".join(texts))] if texts else []


#: Blocks fall, or wedge, from this part of the largest motion, or force, on.
FALLS = 1e-6
#: A block turns from this part of its motion on, and slides at this angle to its load.
OBLIQUE = 1e-3
#: Blocks that a line names.
NAMED = 5


def large(size: Array) -> Indices:
    """Numbers of the blocks for which something is not small."""
    return np.flatnonzero(size > FALLS * size.max(initial=0.0))


def falling_blocks(layout: Layout, fall: Array | None) -> Indices:
    """Numbers of the blocks that move in a fall, (a, b, c) by block about its centre; may be none.

    Args:
        layout: Of the blocks.
        fall: Shape (bodies, 3); None where nothing falls.
    """
    if fall is None:
        return np.empty(0, dtype=np.int64)
    turning = np.abs(fall[:, 2]) * layout.bodies.size
    return large(np.hypot(fall[:, 0], fall[:, 1]) + turning)


def fall_reason(layout: Layout, fall: Array | None) -> str:
    """That the dead load does not stand and what the blocks do, for people.

    They turn, or fall along their dead load, or else slide.
    """
    blocks = falling_blocks(layout, fall)
    motion = np.zeros((len(layout.centroid), 3)) if fall is None else fall
    shift = motion[blocks, :2]
    dead = layout.bodies.dead[blocks, :2]
    pace = np.linalg.norm(shift, axis=1)
    turning = np.abs(motion[blocks, 2]) * layout.bodies.size
    turns = turning > OBLIQUE * (pace + turning)
    cross = np.abs(shift[:, 0] * dead[:, 1] - shift[:, 1] * dead[:, 0])
    falls = ~turns & (cross <= OBLIQUE * np.sum(shift * dead, axis=1))
    kinds = (("fall", falls), ("slide", ~turns & ~falls), ("turn", turns))
    parts = [named_blocks(blocks[k], layout.centroid, what) for what, k in kinds if np.any(k)]
    return f"there is no equilibrium under the dead load alone: {', '.join(parts)}"


def named_blocks(blocks: Indices, centre: Array, what: str) -> str:
    """Blocks by number and place, as far as a line has room, and what they do."""
    places = np.round(centre, 9) + 0.0  # without what rounding leaves of 0
    names = [f"{block} at ({places[block, 0]:.3g}, {places[block, 1]:.3g})" for block in blocks]
    return listed_blocks(names, what)


def listed_blocks(names: Sequence[str], what: str) -> str:
    """Blocks, as far as a line has room, and what they do."""
    if len(names) == 1:
        return f"block {names[0]} {what}s"
    rest = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    return f"blocks {', '.join(names[:NAMED])}{rest} {what}"
