"""Linear programs by HiGHS, in this process or in one of their own.

HiGHS cannot be interrupted, and nothing else of a Python process runs meanwhile. A process of its
own solves a large program beside other work, and can be ended. It imports scipy alone: this file
is all that it runs.
"""

from __future__ import annotations

import ctypes
import json
import pickle
import signal
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Callable
from contextlib import suppress
from typing import Any

#: Interval at which it is asked whether to wait on, s.
PAUSE = 0.05

#: Linux's name for "send me a signal when my parent has ended".
_PARENT_DEATH_SIGNAL = 1

_CODE = (
    "import json, runpy, sys; sys.path[:] = json.loads(sys.argv[1]);"
    " runpy.run_path(sys.argv[2])['_answer_standard_input']()"
)


def solved(*arguments: Any) -> Any:
    """What `scipy.optimize.linprog` returns, solved in this process."""
    from scipy.optimize import linprog

    return linprog(*arguments)


class Beside:
    """A linear program that a process of its own solves, from now on."""

    def __init__(self, *arguments: Any) -> None:
        """Begin; arguments as of `linprog`."""
        with tempfile.TemporaryFile() as given:
            pickle.dump(arguments, given)
            given.seek(0)
            self._answer = tempfile.TemporaryFile()
            # A session of its own: Ctrl-C is for the process that waits for the answer.
            self._process = subprocess.Popen(
                [sys.executable, "-I", "-c", _CODE, json.dumps(sys.path), __file__],
                stdin=given,
                stdout=self._answer,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        self.end = weakref.finalize(self, _ended, self._process, self._answer)

    def answer(self, patient: Callable[[], None]) -> Any:
        """What `linprog` returns, once it is there; None if the process ended without.

        `patient` is called now and then; what it raises ends the process.
        """
        try:
            while self._process.poll() is None:
                patient()
                with suppress(subprocess.TimeoutExpired):
                    self._process.wait(PAUSE)
            if self._process.returncode != 0:
                return None
            self._answer.seek(0)
            return pickle.load(self._answer)
        finally:
            self.end()


def _ended(process: subprocess.Popen[bytes], answer: Any) -> None:
    """End a process."""
    process.kill()
    process.wait()
    answer.close()


def end_with_parent() -> None:
    """Let this process be killed when the one that started it has ended, on Linux."""
    with suppress(AttributeError, OSError):  # elsewhere
        ctypes.CDLL(None).prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL)


def _answer_standard_input() -> None:
    """Solve the program given as standard input, and write the answer to standard output."""
    end_with_parent()
    pickle.dump(solved(*pickle.load(sys.stdin.buffer)), sys.stdout.buffer)
