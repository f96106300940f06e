"""Codes with which the program ends, and the signals that end it early."""

from __future__ import annotations

import signal

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130

#: Signals that end a run early, with what is known by then; the exit code is this and the number.
STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1)
BY_SIGNAL = 128

#: Exit codes by status of the result.
EXIT_CODES = {"limit": 0, "unbounded": 0, "unstable": 3, "no_equilibrium": 3, "not_converged": 4}
