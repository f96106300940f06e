"""Points of a sweep: the limit load of one scene as a row of a table; many shared by processes."""

from __future__ import annotations

import json
import math
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from queue import SimpleQueue
from typing import Any

from fenics_contact.discretization.discretization import Discretization
from fenics_contact.errors import InputError, SolverError
from fenics_contact.limit_load import LimitLoad, limit_load, limit_load_of
from fenics_contact.scene.scene import Scene
from fenics_contact.sweeps.parameters import Family, Values

#: Status of a point whose loads or joints do not fit the mesh.
WRONG_INPUT = "wrong_input"
#: Variables by which launchers of MPI know their ranks: a worker is none of them.
_LAUNCHED = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_")
_KEPT = ("OMPI_MCA_", "OMPI_ALLOW_")


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
        factorizations: Numeric factorisations.
        seconds: Time, s.
        reason: Why there is no limit load, for people.
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
    factorizations: int = 0
    seconds: float = 0.0
    reason: str = ""

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


class Structure:
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


def solve(scene: Scene, structure: Structure) -> LimitLoad:
    """Limit load and bracket of a scene.

    Raises:
        InputError: If joints, supports or loads of the scene do not fit its mesh.
    """
    start = time.perf_counter()
    more = {"lowest": bool(scene.solve.lowest), "peak": bool(scene.solve.peak)}
    # A table of load factors has no room for more.
    scene = replace(scene, solve=replace(scene.solve, **more))
    if scene.solve.accuracy is None:
        result = limit_load_of(structure.of(scene))
    else:
        result = limit_load(scene)  # on meshes of its own
    result = result.hold_against_brackets()
    seconds = {**result.seconds, "total": time.perf_counter() - start}
    return replace(result, seconds=seconds)


def solve_point(family: Family, structure: Structure, values: Values) -> Point:
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
        low = end.bounds.lower
        high = end.bounds.upper
        ends = {"load_factor": end.load_factor, "lower": low, "upper": high}
        found |= {name + suffix: float(x) for name, x in ends.items() if x is not None}
    if result.collapse is not None and result.collapse.hinges is not None:
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
        factorizations=result.factorizations,
        seconds=time.perf_counter() - start,
        reason=" ".join(reason.split()),
    )


def solved_points(family: Family, points: Sequence[Values], jobs: int) -> Iterator[Point]:
    """Points in the order in which they end, shared among so many processes. Collective.

    Raises:
        InputError: If the scene cannot be given to other processes.
        SolverError: If a process ends before its answer.
    """
    if jobs > 1 and points:
        yield from _solved_by_workers(family, points, jobs)
        return
    with closing(Structure()) as structure:
        for values in points:
            yield solve_point(family, structure, values)


def _solved_by_workers(family: Family, points: Sequence[Values], jobs: int) -> Iterator[Point]:
    """Points by processes that each have the scene, or read it, and a structure of their own.

    They have sessions of their own, so that Ctrl-C is for the process that has the table.
    """
    origin = family.to_send()
    environment = {
        name: value
        for name, value in os.environ.items()
        if name.startswith(_KEPT) or not name.startswith(_LAUNCHED)
    }
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
    program = [sys.executable, "-c", f"from {__name__} import answer; answer()"]
    style: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    style |= {"env": environment, "start_new_session": True}
    workers: list[Any] = []
    free: SimpleQueue[Any] = SimpleQueue()

    def solved(values: Values) -> Point:
        worker = free.get()
        try:
            pickle.dump(values, worker.stdin)
            worker.stdin.flush()
            found: Point = pickle.load(worker.stdout)
        except (OSError, EOFError, ValueError, pickle.UnpicklingError):
            code = worker.wait()
            raise SolverError(f"a process of the sweep ended early (exit code {code})") from None
        finally:
            free.put(worker)
        return found

    pool = ThreadPoolExecutor(jobs)
    try:
        for _ in range(min(jobs, len(points))):
            worker: Any = subprocess.Popen(program, **style)
            workers.append(worker)
            worker.stdin.write(origin)
            free.put(worker)
        for future in as_completed([pool.submit(solved, values) for values in points]):
            yield future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.terminate()
            with suppress(OSError), worker:  # closes its pipes and waits for its end
                pass


def answer() -> None:
    """Read the origin of a family and then values from standard input, and answer with points."""
    with os.fdopen(os.dup(0), "rb") as asked, os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(2, 1)  # what libraries have to say is no answer
        family = Family(pickle.load(asked))
        with closing(Structure()) as structure, suppress(EOFError, BrokenPipeError):
            while True:
                values = pickle.load(asked)
                pickle.dump(solve_point(family, structure, values), answers)
                answers.flush()
