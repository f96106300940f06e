"""Whole tasks beside each other: by other processes, by other ranks of MPI, or one by one here.

A task is a function of a module and arguments that can be pickled, as for any executor of
`concurrent.futures`. Every worker holds what a task needs as a whole, so that an answer has the
digits that it has when everything is done here. No worker waits by spinning.
"""

from __future__ import annotations

import ctypes
import logging
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import partial
from importlib import import_module
from queue import SimpleQueue
from typing import IO, TYPE_CHECKING, Any

from fenics_contact.errors import SolverError, Stopped

if TYPE_CHECKING:
    from mpi4py import MPI

_log = logging.getLogger("fenics_contact")

#: Linux's name for "send me a signal when my parent has ended".
PARENT_DEATH_SIGNAL = 1

#: Signals that end a run early, with what is known by then.
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)
#: Time between two looks at whether a run is to end while a worker's answer is waited for, s.
PAUSE = 0.05
#: Time for a task that was asked to end, s.
LAST = 20.0
#: Variables by which launchers of MPI know their ranks: a process beside is none of them.
_LAUNCHED = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_")
_KEPT = ("OMPI_MCA_", "OMPI_ALLOW_")


class Signals:
    """Signals that ask to end a run: what is known by then is written.

    They are Ctrl-C, SIGTERM (batch systems), and SIGUSR1, which mpirun passes on to its ranks
    without killing them. Ctrl-C once more ends at once.

    Attributes:
        number: Of the first signal that came; 0 for none.
    """

    _current: Signals | None = None

    def __init__(self) -> None:
        self.number = 0

    def __enter__(self) -> Signals:
        self._outer = Signals._current
        self._before = {number: signal.signal(number, self._note) for number in STOPPING}
        Signals._current = self
        return self

    def __exit__(self, *_: object) -> None:
        Signals._current = self._outer
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __call__(self) -> str:
        """Who asked to end the run; empty if nobody did."""
        return signal.Signals(self.number).name if self.number else ""

    def _note(self, number: int, _: object) -> None:
        if self.number and number == signal.SIGINT:
            raise KeyboardInterrupt
        self.number = self.number or number


def asked_to_stop() -> str:
    """Who asked this process to end what it does; empty if nobody did. For tasks."""
    return Signals._current() if Signals._current is not None else ""


def check_asked_to_stop() -> None:
    """Raise `Stopped` if this process was asked to end what it does."""
    if reason := asked_to_stop():
        raise Stopped(reason)


class LostError(SolverError):
    """A process ended before the answer to its task, which may be done elsewhere.

    Attributes:
        task: Function and arguments, pickled.
    """

    def __init__(self, message: str, task: bytes) -> None:
        super().__init__(message)
        self.task = task


class InPlace(Executor):
    """Does every task in this process, once its result is asked for."""

    def submit(self, task: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The result to come."""
        return _Later(partial(task, *args, **kwargs))


class _Later(Future[Any]):
    """A result that is computed when it is first asked for."""

    def __init__(self, task: Callable[[], Any]) -> None:
        super().__init__()
        self._task = task

    def result(self, timeout: float | None = None) -> Any:
        """The result of the task, or what it raised."""
        if not self.done():
            self.set_running_or_notify_cancel()
            try:
                self.set_result(self._task())
            except Exception as error:
                self.set_exception(error)
        return super().result(timeout)


class Processes(Executor):
    """Processes beside this one, each of which does one task at a time.

    They have sessions of their own, so that Ctrl-C is for this process.
    """

    def __init__(self, count: int) -> None:
        """Start so many, which begin to import at once."""
        self.count = count
        environment = {
            name: value
            for name, value in os.environ.items()
            if name.startswith(_KEPT) or not name.startswith(_LAUNCHED)
        }
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))
        self._workers: list[tuple[subprocess.Popen[bytes], IO[bytes]]] = []
        self._free: SimpleQueue[Any] = SimpleQueue()
        self._busy: set[subprocess.Popen[bytes]] = set()
        for _ in range(count):
            read, write = os.pipe()  # what a task prints is no answer
            program = f"from {__name__} import answer; answer({write})"
            # A worker that still begins is not killed by a signal that asks it to end its task.
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGUSR1})
            worker = subprocess.Popen(
                [sys.executable, "-c", program],
                stdin=subprocess.PIPE,
                pass_fds=(write,),
                env=environment,
                start_new_session=True,
            )
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            os.close(write)
            self._workers.append((worker, os.fdopen(read, "rb")))
            self._free.put(self._workers[-1])
        # A process that has ended is an error of writing to it; PETSc would end this one, too.
        block = signal.SIG_BLOCK, {signal.SIGPIPE}
        self._threads = ThreadPoolExecutor(count, "", signal.pthread_sigmask, block)

    def submit(self, task: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The result to come; it raises `LostError` if its process ends early."""
        return self._threads.submit(self._answer, pickle.dumps((task, args, kwargs)))

    def _answer(self, task: bytes) -> Any:
        worker, answers = self._free.get()
        self._busy.add(worker)
        try:
            worker.stdin.write(task)
            worker.stdin.flush()
            value, error = pickle.load(answers)
        except (OSError, EOFError, ValueError, pickle.UnpicklingError):
            code = worker.wait()
            with suppress(OSError):
                worker.stdin.close()
            why = f"a process beside this one ended early (exit code {code})"
            raise LostError(why, task) from None
        finally:
            self._busy.discard(worker)
            # One that has ended takes no task from those that go on.
            if worker.poll() is None or all(one.poll() is not None for one, _ in self._workers):
                self._free.put((worker, answers))
        if error is not None:
            raise error
        return value

    def stop(self) -> None:
        """Ask the tasks that run to end with what they know; see `asked_to_stop`."""
        for worker in list(self._busy):
            worker.send_signal(signal.SIGUSR1)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes, whatever they do."""
        self._threads.shutdown(wait=False, cancel_futures=True)
        for worker, answers in self._workers:
            worker.kill()
            with suppress(OSError), worker, answers:  # closes its pipes and waits for its end
                pass


class Ranks(Executor):
    """Other ranks of MPI, each of which does one task at a time, on `COMM_SELF`."""

    def __init__(self, pool: Executor, count: int) -> None:
        self._pool = pool
        self.count = count

    def submit(self, task: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """The result to come."""
        return self._pool.submit(task, *args, **kwargs)


@contextmanager
def ranks(comm: MPI.Intracomm) -> Iterator[Ranks | None]:
    """The other ranks as workers, on rank 0; None on those, once it is done with them. Collective.

    It is left on all ranks together.
    """
    from mpi4py.futures import MPICommExecutor

    with MPICommExecutor(comm, root=0) as pool:
        yield None if pool is None else Ranks(pool, comm.size - 1)


def workers_of(beside: Executor) -> int:
    """How many workers there are beside this process."""
    return beside.count if isinstance(beside, (Processes, Ranks)) else 0


def ranks_of(beside: Executor | None) -> int:
    """How many ranks do the tasks of an executor, with this one."""
    return 1 + beside.count if isinstance(beside, Ranks) else 1


def result_of(future: Future[Any], check_stop: Callable[[], None]) -> Any:
    """The result of a task; what `check_stop` raises meanwhile, or the task.

    One whose process has ended, for want of memory for instance, is done here.
    """
    while True:
        try:
            return future.result(PAUSE)
        except TimeoutError:
            if future.done():  # the task's own
                raise
            check_stop()
        except LostError as lost:
            _log.warning("warning: %s; its task is done here", lost)
            task, arguments, named = pickle.loads(lost.task)
            return task(*arguments, **named)


def last_result_of(future: Future[Any], beside: Executor) -> Any:
    """What a task knows once it is asked to end; None if it does not end soon."""
    if isinstance(beside, Processes):
        beside.stop()
    future.cancel()
    with suppress(TimeoutError, CancelledError, SolverError, Stopped):
        return future.result(LAST)
    return None


def end_with_parent() -> None:
    """Let this process be killed when the one that started it has ended, on Linux."""
    with suppress(AttributeError, OSError):  # elsewhere
        ctypes.CDLL(None).prctl(PARENT_DEATH_SIGNAL, signal.SIGKILL)


def answer(answers: int) -> None:
    """Do tasks that come by standard input, and answer by an open file, in a worker's process."""
    end_with_parent()
    import_module("fenics_contact.limit_load")  # what most tasks need
    with (
        os.fdopen(os.dup(0), "rb") as tasks,
        os.fdopen(answers, "wb") as file,
        Signals() as signals,
        suppress(EOFError, BrokenPipeError),
    ):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGUSR1})
        while True:
            task, args, kwargs = pickle.load(tasks)
            try:
                found: tuple[Any, Exception | None] = (task(*args, **kwargs), None)
            except Exception as error:
                found = None, error
            signals.number = 0  # this task was asked to end, not the next one
            pickle.dump(found, file)
            file.flush()


class Once(logging.Filter):
    """Lets a warning pass once: all points of a sweep have those of their scene."""

    def __init__(self) -> None:
        super().__init__()
        self._told: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether it is no warning, or one that was not told before."""
        text = record.getMessage()
        again = record.levelno >= logging.WARNING and text in self._told
        self._told.add(text)
        return not again


@contextmanager
def told_once() -> Iterator[None]:
    """Warnings are told once while it lasts."""
    once = Once()
    _log.addFilter(once)
    try:
        yield
    finally:
        _log.removeFilter(once)
