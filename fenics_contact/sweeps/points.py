"""Points of a sweep: what varies, the scenes that come of it, and the limit load of each as a row.

Many points are shared by processes.
"""

from __future__ import annotations

import json
import logging
import math
import pickle
import re
import time
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from logging.handlers import BufferingHandler
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from fenics_contact import compat
from fenics_contact.discretization.discretization import Discretization
from fenics_contact.errors import InputError, SolverError, require
from fenics_contact.geometry.mesh import BlockMesh, Flags
from fenics_contact.limit_load import limit_load, limit_load_of
from fenics_contact.output.view import view_of_collapse
from fenics_contact.parallel import MPI
from fenics_contact.results.block_view import AS_ONE, BlockView
from fenics_contact.results.result import ByDirection, Collapse
from fenics_contact.results.words import mechanism_in_words
from fenics_contact.scene.scene import Scene, function_name
from fenics_contact.scene.toml_tables import assign, is_of_blocks, read_toml, value_of
from fenics_contact.workers import InPlace, Ranks, result_of

_log = logging.getLogger("fenics_contact")

#: Significant digits of the values of a range: 0.35, not 0.35000000000000003.
DIGITS = 12
#: Points of a sweep.
MOST = 100_000
_RANGE = re.compile(r"(.+):(.+):\s*(\d+)\s*")
_HOW = "KEY=A:B:N, N values from A to B, or KEY=A,B,C"

#: Values of the keys at one point of a sweep.
Values = Mapping[str, Any]

#: Scene file and what was set on top of it, or a scene made in Python.
Origin: TypeAlias = "tuple[Path, tuple[str, ...]] | Scene"


@dataclass(frozen=True)
class Parameter:
    """Keys of a scene file that have the same value, and the values they get.

    Attributes:
        keys: For example `joints.default.friction`.
        values: As TOML has them: numbers, strings, lists.
    """

    keys: tuple[str, ...]
    values: tuple[Any, ...]

    @classmethod
    def of(cls, keys: str, values: str | Iterable[Any]) -> Parameter:
        """From keys with commas between, and values or a text for them.

        The text is `a:b:n`, n values from a to b, or `a, b, c`. Both ends of a range are numbers,
        or lists of numbers.

        Raises:
            InputError: If there is no key, or no value.
        """
        names = tuple(name.strip() for name in keys.split(","))
        if isinstance(values, str):
            found = _values_of(values)
        else:  # as TOML has them: lists for tuples and arrays, text for paths
            arrays = (np.ndarray, np.generic)
            text = json.dumps(
                list(values), default=lambda x: x.tolist() if isinstance(x, arrays) else str(x)
            )
            found = json.loads(text)
        if not found or not all(all(part.strip() for part in n.split(".")) for n in names):
            raise InputError(f"'{keys}' varies as {_HOW}; give both key and values")
        once: dict[str, Any] = {}
        for value in found:
            once.setdefault(json.dumps(value, sort_keys=True, default=str), value)
        return cls(names, tuple(once.values()))

    @classmethod
    def parse(cls, text: str) -> Parameter:
        """From KEY=A:B:N or KEY=A,B,C; see `of`."""
        keys, _, values = text.partition("=")
        return cls.of(keys, values)


def _values_of(text: str) -> list[Any]:
    """Values that a text stands for, see `Parameter.of`."""
    first = value_of(text.partition(":")[0])
    if found := _RANGE.fullmatch(text):
        start, end = (np.asarray(value_of(part)) for part in found.groups()[:2])
        if all(part.dtype.kind in "if" and part.size for part in (start, end)):
            if start.shape != end.shape:
                raise InputError(f"'{text}': both ends of a range must have as many numbers")
            count = int(found[3])
            told = f"'{text}' must have 1 to {MOST} values, the last number of the range"
            require(1 <= count <= MOST, told)
            exact = np.linspace(start, end, count)
            short = np.array([float(f"{x:.{DIGITS}g}") for x in exact.flat]).reshape(exact.shape)
            whole = start.dtype.kind == end.dtype.kind == "i" and np.all(short == np.round(short))
            return list((short.astype(np.int64) if whole else short).tolist())
    elif ":" in text and isinstance(first, (int, float)):
        raise InputError(f"'{text}' is no range; a key varies as {_HOW}")
    try:
        return list(tomllib.loads(f"values = [{text}]")["values"])
    except (ValueError, RecursionError):
        return [value_of(part) for part in text.split(",") if part.strip()]


def grid(parameters: Sequence[Parameter]) -> list[dict[str, Any]]:
    """Values of all keys at every point, the last parameter changing fastest.

    Raises:
        InputError: If a key varies twice, nothing varies, or there are too many points.
    """
    keys = [key for parameter in parameters for key in parameter.keys]
    require(bool(keys), "nothing varies; give a key and its values")
    for key in (key for k, key in enumerate(keys) if key in keys[:k]):
        raise InputError(f"'{key}' varies twice; give all its values at once")
    if math.prod(len(parameter.values) for parameter in parameters) > MOST:
        raise InputError(f"the sweep has more than {MOST} points; give fewer values")
    return [
        {key: value for p, value in zip(parameters, point, strict=True) for key in p.keys}
        for point in product(*(parameter.values for parameter in parameters))
    ]


class Family:
    """Scenes that differ in the values of some keys; the mesh is read once.

    Attributes:
        origin: Scene file and what was set on top of it, or a scene made in Python.
        comm: Ranks of all scenes.
        tables: Of the scene without these values, as a file has them.
    """

    def __init__(self, origin: Origin, comm: MPI.Comm | None = None) -> None:
        """Read the tables of the file, on all ranks of `comm` (by default PETSc's), or scene."""
        self.origin = origin
        self._last: tuple[tuple[str, str], BlockMesh] | None = None
        self._blocks: tuple[Any, Any] = (None, None)
        if isinstance(origin, Scene):
            self.comm = origin.comm
            self.tables = origin.tables()
        else:
            self.comm = compat.default_comm() if comm is None else comm
            self.tables = read_toml(origin[0], self.comm, origin[1])

    @property
    def of_blocks(self) -> bool:
        """Whether the scenes are of rigid blocks without a mesh."""
        return is_of_blocks(self.tables)

    def to_send(self) -> bytes:
        """The origin, as `Origin`, for another process.

        Raises:
            InputError: If a function of the scene is not found there.
        """
        if isinstance(self.origin, Scene):
            loads = self.origin.dead, self.origin.live
            for given in (self.origin.stress, *(load.form for load in loads)):
                if getattr(given, "__module__", "") == "__main__":
                    raise InputError(
                        f"jobs: the function '{function_name(given)}' is in the script that runs,"
                        " where other processes do not find it; put it into a module of its own"
                    )
        return pickle.dumps(self.origin)

    def scene(self, values: Values) -> Any:
        """The scene with these values.

        Raises:
            InputError: If a key is unknown, or a value wrong.
        """

        def copied(tables: Mapping[str, Any]) -> dict[str, Any]:
            """Tables to assign to; what is in them is replaced, but never changed."""
            return {k: copied(v) if isinstance(v, Mapping) else v for k, v in tables.items()}

        tables = copied(self.tables)
        for key, value in values.items():
            assign(tables, key, value)
        if self.of_blocks and not isinstance(self.origin, Scene):
            return self._of_blocks(tables, self.origin[0].parent)
        return Scene.from_tables(tables, self._kept_mesh)

    def _of_blocks(self, tables: Mapping[str, Any], folder: Path) -> Any:
        """A scene of rigid blocks; those of the last one are kept where their table is the same."""
        from fenics_contact.spatial.scene import BlockScene, read_blocks

        table = tables.get("blocks"), tables.get("dimension")
        if self._blocks[0] != table:
            self._blocks = table, read_blocks(tables, folder)
        return BlockScene.from_tables(tables, folder, self._blocks[1])

    def _kept_mesh(self, name: str, blocks: str) -> BlockMesh:
        """The mesh of `mesh.file` and `mesh.blocks`; the last one is kept."""
        if isinstance(self.origin, Scene):
            if name != self.origin.mesh.source:
                raise InputError("mesh.file varies for scenes of a file only; give its path")
            return self.origin.mesh
        if self._last is None or self._last[0] != (name, blocks):
            self._last = None  # frees the last one
            path = self.origin[0].parent / name
            self._last = (name, blocks), BlockMesh.from_file(path, self.comm, blocks)
        return self._last[1]


#: Status of a point whose loads or joints do not fit the mesh.
WRONG_INPUT = "wrong_input"


@dataclass(frozen=True)
class Point:
    """Limit load with some values of the varied keys.

    Attributes:
        values: By key.
        status: As `LimitLoad.status`, or "wrong_input" where the scene does not fit its mesh.
        load_factor: Of the live load as given; infinite if unbounded, nan if there is none.
        lower: Lower end of its bracket; nan if not known.
        upper: Upper end.
        load_factor_negative: With the live load reversed, not above 0; nan if not asked for.
        lower_negative: Lower end of its bracket.
        upper_negative: Upper end.
        load_factor_point_hinges: Load factor with hinges of no length; nan if not known.
        displacements: Number of those of the mesh, to compare meshes by; 0 in space.
        factorizations: Numeric factorisations.
        seconds: Time, s.
        reason: Why there is no limit load, for people.
        a0: Spectral acceleration at which the mechanism starts, m/s2, where `[seismic]` asks for
            it; nan if not known.
        a0_negative: With the live load reversed.
        moves: The mechanism of the least load factor in words.
        load: What is carried at the least load factor, with its unit, where the live load is forces
            at places alone; else empty.
    """

    values: Values
    status: str
    load_factor: float = math.nan
    lower: float = math.nan
    upper: float = math.nan
    load_factor_negative: float = math.nan
    lower_negative: float = math.nan
    upper_negative: float = math.nan
    load_factor_point_hinges: float = math.nan
    displacements: int = 0
    factorizations: int = 0
    seconds: float = 0.0
    reason: str = ""
    a0: float = math.nan
    a0_negative: float = math.nan
    moves: str = ""
    load: str = ""

    @property
    def place(self) -> str:
        """Its values in words."""
        return ", ".join(dict.fromkeys(map(value_text, self.values.values())))

    @property
    def line(self) -> str:
        """Its values, and what was found, in words."""
        values = ", ".join(
            f"{key} = {f'{value:.6g}' if isinstance(value, float) else value}"
            for key, value in self.values.items()
        )
        both = (self.load_factor, self.load_factor_negative)
        factors = " and ".join(f"{factor:.6g}" for factor in both if not math.isnan(factor))
        factors += f": {self.load}" * bool(self.load)
        factors += f", a0* = {self.start:.4g} m/s2" if math.isfinite(self.start) else ""
        found = f"it collapses at load factor {factors}" if self.solved else self.reason
        found = "nothing limits the live load" if self.status == "unbounded" else found
        return f"{values}: {found}"

    @property
    def start(self) -> float:
        """Lower a0* of both directions; nan if none is known."""
        return float(np.fmin(self.a0, self.a0_negative))

    @property
    def solved(self) -> bool:
        """Whether the answer is a limit load, or that there is none."""
        return self.status in ("limit", "unbounded")

    @property
    def least(self) -> float:
        """Load factor nearest to failure: the lower one of both directions; nan if not solved."""
        if not self.solved:
            return math.nan
        found = (self.load_factor, -self.load_factor_negative)
        return min((one for one in found if not math.isnan(one)), default=math.nan)

    def contradiction(self, part: float) -> str:
        """What its numbers say against its status and each other, beyond a part; else empty."""
        least = self.least
        if self.solved and not (math.isinf if self.status == "unbounded" else math.isfinite)(least):
            return f"status '{self.status}' with the load factor {least:.6g}"
        ends = ("load_factor", "lower", "upper")
        for suffix in ("", "_negative") if self.solved else ():
            factor, low, high = (getattr(self, name + suffix) for name in ends)
            known = [abs(one) for one in (factor, low, high) if math.isfinite(one)]
            miss = part * max(known, default=0.0)
            if factor < low - miss or factor > high + miss:
                return f"load factor {factor:.6g} is outside its bracket, {low:.6g} to {high:.6g}"
        return ""


def value_text(value: Any) -> str:
    """A value of a key as text: strings as they are, all else as JSON."""
    return value if isinstance(value, str) else json.dumps(value)


class KeptStructure:
    """The discretisation of the last scene; the next one keeps what of it is the same."""

    def __init__(self) -> None:
        self._owner: Discretization | None = None
        self._last: Discretization | None = None

    def of(self, scene: Scene) -> Discretization:
        """A scene discretised; the one before must not be used for solving any more.

        Raises:
            InputError: If joints, supports or loads of the scene do not fit its mesh.
        """
        if self._last is not None and self._last.shares_matrices(scene):
            self._last = self._last.with_(scene=scene)
        else:
            self.close()
            self._owner = self._last = Discretization(scene)
        return self._last

    def close(self) -> None:
        """Free the matrices, on all ranks together."""
        if self._owner is not None:
            self._owner.close()
        self._owner = self._last = None


def solve(scene: Any, structure: KeptStructure) -> Any:
    """Limit load and bracket of a scene.

    Raises:
        InputError: If joints, supports or loads of the scene do not fit its mesh.
    """
    start = time.perf_counter()
    # A table of load factors has a column for hinges, and no room for more.
    names = "lowest", "peak", "range", "ties"
    more = {name: bool(getattr(scene.solve, name)) for name in names}
    scene = replace(scene, solve=replace(scene.solve, **more))
    if not isinstance(scene, Scene):
        from fenics_contact.spatial.limit import limit_load as limit_load_of_blocks

        return limit_load_of_blocks(scene)
    if scene.solve.accuracy is None:
        result = limit_load_of(structure.of(scene))
    else:
        result = limit_load(scene)  # on meshes of its own
    result = result.hold_against_brackets()
    seconds = {**result.seconds, "total": time.perf_counter() - start}
    return replace(result, seconds=seconds)


def solve_point(family: Family, structure: KeptStructure, values: Values) -> Point:
    """Limit load with these values; what goes wrong is said in its status and reason."""
    start = time.perf_counter()
    try:
        result = solve(family.scene(values), structure)
    except (InputError, SolverError) as error:
        status = WRONG_INPUT if isinstance(error, InputError) else "not_converged"
        return Point(values, status, reason=" ".join(str(error).split()))
    found: dict[str, Any] = {}
    for name, end in result.ends.items():
        suffix = "_negative" if name == "negative" else ""
        bounds = {"lower": end.bounds.lower, "upper": end.bounds.upper}
        ends = {"load_factor": end.load_factor, **bounds}
        if check := seismic_check(end):
            ends["a0"] = check.acceleration
        found |= {name + suffix: float(x) for name, x in ends.items() if x is not None}
    if result.limits:
        worst, words = worst_of(result), result.wording
        found["moves"] = in_words(views_of(result)[worst])
        carried = abs(result.limits[worst].load_factor) * words.load
        found["load"] = words.units.force(carried, 4) * words.forces
    if getattr(result.collapse, "hinges", None) is not None:
        found["load_factor_point_hinges"] = float(result.collapse.hinges.points)
    reason = result.reason()
    if not reason and result.status == "not_converged":  # what keeps states from being verified
        certificates = [end.certificate for end in result.ends.values() if end.certificate]
        missed = [f"{law} {value:.1e}" for c in certificates for law, value in c.failures.items()]
        reason = ", ".join(missed) or "no state was found"
    return Point(
        values,
        result.status,
        **found,
        displacements=0 if family.of_blocks else result.layout.size,
        factorizations=result.factorizations,
        seconds=time.perf_counter() - start,
        reason=" ".join(reason.split()),
    )


def seismic_check(end: Collapse) -> Any:
    """The seismic check of a collapse, a `SeismicCheck`; None if there is none."""
    return getattr(end.answers.get("seismic"), "value", None)


def worst_of(result: ByDirection) -> str:
    """The direction of the least load factor."""
    return min(result.limits, key=lambda name: abs(result.limits[name].load_factor))


def views_of(result: Any) -> Mapping[str, BlockView]:
    """What is seen of the collapses, by direction. Collective."""
    if isinstance(result.scene, Scene):
        ends = result.limits.items()
        return {name: view_of_collapse(result.layout, end).blocks for name, end in ends}
    from fenics_contact.spatial.view import views_of as views_of_blocks

    return views_of_blocks(result)


def moving(view: BlockView) -> Flags:
    """Which blocks move in a mechanism."""
    return np.asarray(view.share > AS_ONE)


def in_words(view: BlockView) -> str:
    """What moves, and how; a single stone by its name and height."""
    told = mechanism_in_words(view)
    those = moving(view)
    if those.sum() != 1:
        return told
    high, top = view.box_of(those)[1, 2], view.box[1, 2]
    place = "at the eaves" if np.isclose(high, top) else f"up to z = {high:.3g} m"
    return f"one stone {place}, {view.bodies.names[int(np.argmax(those))]}: {told}"


def solved_points(family: Family, points: Sequence[Values], beside: Executor) -> Iterator[Point]:
    """Points in the order in which they end, shared with an executor's workers. Collective.

    Each worker has the scene, or reads it, and a structure of its own. Rank 0 takes points from the
    end while the other ranks begin with the first ones.

    Raises:
        InputError: If the scene cannot be given to other processes.
    """
    with closing(KeptStructure()) as structure:
        if isinstance(beside, InPlace):
            for values in points:
                yield solve_point(family, structure, values)
            return
        origin = family.to_send() if points else b""
        left = {beside.submit(point_beside, origin, values): values for values in points}
        while left:
            last = next((one for one in reversed(left) if _mine(one, beside)), None)
            if last is not None:
                yield solve_point(family, structure, left.pop(last))
            else:
                wait(left, return_when=FIRST_COMPLETED)
            for done in [future for future in left if future.done()]:
                del left[done]
                point, warnings = result_of(done, lambda: None)
                for text in warnings:
                    _log.warning("%s", text)
                yield point


def _mine(future: Future[Any], beside: Executor) -> bool:
    """Whether nobody has begun a task and it is taken back; processes are left to themselves."""
    return isinstance(beside, Ranks) and not future.done() and future.cancel()


@lru_cache(maxsize=1)
def _given(origin: bytes) -> tuple[Family, KeptStructure]:
    """The family of a worker, which keeps it from one point to the next."""
    return Family(pickle.loads(origin), MPI.COMM_SELF), KeptStructure()


def point_beside(origin: bytes, values: Values) -> tuple[Point, list[str]]:
    """A task: a point of a sweep, and warnings, which the process that asked for it tells once."""
    kept = BufferingHandler(MOST)
    before, _log.handlers[:] = list(_log.handlers), [kept]
    try:
        return solve_point(*_given(origin), values), [one.getMessage() for one in kept.buffer]
    finally:
        _log.handlers[:] = before
