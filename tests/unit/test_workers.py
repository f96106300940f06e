"""Tasks by other processes, other ranks, or here: results, failures, and who may stop them."""

import operator
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fenics_contact import SolveOptions, limit_load
from fenics_contact.errors import SolverError, Stopped
from fenics_contact.workers import InPlace, Processes, asked_to_stop, last_result_of, result_of
from tests.bank import coulomb, wall_recipe
from tests.quick import each_once, slow, slow_rows


@pytest.fixture(scope="module")
def beside():
    with Processes(1) as processes:
        yield processes


def fail(reason):
    raise SolverError(reason)


def wait_until_stopped():
    while not asked_to_stop():
        time.sleep(0.01)
    return asked_to_stop()


def go_on():
    pass


@pytest.mark.parametrize("make", [InPlace, lambda: Processes(2)])
def test_a_task_has_its_result_or_what_it_raised(make):
    with make() as executor:
        quotients = [executor.submit(divmod, 7, n) for n in (2, 3, 0)]
        assert [result_of(one, go_on) for one in quotients[:2]] == [(3, 1), (2, 1)]
        with pytest.raises(ZeroDivisionError):
            result_of(quotients[2], go_on)
        with pytest.raises(SolverError, match="no state"):
            result_of(executor.submit(fail, "no state"), go_on)
        assert result_of(executor.submit(operator.add, 1, 2), go_on) == 3


def test_tasks_in_place_are_done_when_asked_for():
    done = []
    future = InPlace().submit(done.append, 1)
    assert not done and not future.done()
    assert future.result() is None and future.result() is None and done == [1]


def dies_elsewhere(here, number):
    if os.getpid() != here:
        os.kill(os.getpid(), number)
    return os.getpid()


@pytest.mark.parametrize(("number", "count"), each_once([signal.SIGKILL, signal.SIGSEGV], [1, 2]))
def test_the_task_of_a_process_that_ends_is_done_here(number, count):
    with Processes(count) as executor:
        lost = executor.submit(dies_elsewhere, os.getpid(), number)
        assert result_of(lost, go_on) == os.getpid()
        others = [executor.submit(divmod, 7, n) for n in (2, 3, 4)]
        assert [result_of(one, go_on) for one in others] == [(3, 1), (2, 1), (1, 3)]


def running(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="by the kernel of Linux")
@pytest.mark.parametrize("number", [signal.SIGKILL, *slow(signal.SIGTERM)])
def test_no_process_outlives_the_one_that_started_it(number):
    """Begun, and in a task that would go on for a minute."""
    code = (
        "import os, sys, time; from fenics_contact.workers import Processes;"
        " p = Processes(2); pid = p.submit(os.getpid).result(); p.submit(time.sleep, 60);"
        " p.submit(time.sleep, 60); print(pid, flush=True); time.sleep(60)"
    )
    program = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    worker = int(program.stdout.readline())
    assert running(worker)
    program.send_signal(number)
    program.wait()
    end = time.monotonic() + 5.0
    while running(worker) and time.monotonic() < end:
        time.sleep(0.01)
    assert not running(worker)


def test_who_waits_may_be_stopped_and_the_task_tells_what_it_knows():
    def stop():
        raise Stopped("time is over")

    with Processes(1) as executor:
        task = executor.submit(wait_until_stopped)
        time.sleep(0.5)
        with pytest.raises(Stopped, match="time is over"):
            result_of(task, stop)
        assert last_result_of(task, executor) == "SIGUSR1"
        assert result_of(executor.submit(asked_to_stop), go_on) == ""


@pytest.mark.parametrize(
    ("name", "direction"), [("W3", "positive"), *slow_rows(("W3", "both"), ("W4", "positive"))]
)
def test_limit_load_with_a_process_beside_has_the_digits_without(beside, name, direction):
    scene = wall_recipe(name, coulomb(0.65)).scene(1, fast=False)
    scene = replace(scene, solve=SolveOptions(direction=direction))
    alone = limit_load(scene).hold_against_brackets()
    shared = limit_load(scene, beside=beside).hold_against_brackets()
    assert list(alone.ends) == list(shared.ends)
    for key, end in alone.ends.items():
        other = shared.ends[key]
        assert (end.status, end.load_factor) == (other.status, other.load_factor)
        assert str(end.bounds) == str(other.bounds)
        assert end.certificate.residuals == other.certificate.residuals
        records = [{k: a.record() for k, a in one.answers.items()} for one in (end, other)]
        assert repr(records[0]) == repr(records[1])
        np.testing.assert_array_equal(end.mode, other.mode)
