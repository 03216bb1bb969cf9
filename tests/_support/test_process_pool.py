"""Computations side by side: how many processes, where none can be had, and what errors do."""

import os
import pickle
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pkgutil import walk_packages

import numpy as np
import pytest
from plans import TOUCH, written

import trunk_ocp
from trunk_ocp._support import process_pool as parallel
from trunk_ocp._support.process_pool import cores, iter_finished, run_tasks
from trunk_ocp.cli import run_figures as drawing
from trunk_ocp.errors import InputError, StaticsError, TrunkError
from trunk_ocp.model.loads import Loads
from trunk_ocp.planning.plan import PlanError
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import load_motion
from trunk_ocp.reporting import Reporter

pytestmark = pytest.mark.slow

FAR = TOUCH.replace("position = [0.6, 0.1, 1.2]", "position = [3.0, 0.1, 1.2]")


@pytest.fixture(scope="module")
def missed(tmp_path_factory):
    """A plan whose target is out of reach."""
    motion = load_motion(written(tmp_path_factory.mktemp("far"), FAR))
    return plan_motion(motion, lookahead=1, throw=False)


# --- errors --------------------------------------------------------------------------------


def every_error():
    """All classes of errors of this package."""
    for module in walk_packages(trunk_ocp.__path__, "trunk_ocp."):
        if "templates" not in module.name and not module.name.endswith("__main__"):
            import_module(module.name)
    found, classes = [], [TrunkError]
    while classes:
        kind = classes.pop()
        found.append(kind)
        classes += [k for k in kind.__subclasses__() if k.__module__.startswith("trunk_ocp.")]
    return found


def test_every_error_survives_being_sent_to_another_process(missed):
    arguments = {StaticsError: ("no equilibrium", 0.25), PlanError: (missed,)}
    kinds = every_error()
    assert {InputError, StaticsError, PlanError} < set(kinds)
    for kind in kinds:
        error = kind(*arguments.get(kind, ("a sentence",)))
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is kind
        assert str(again) == str(error)


def test_what_an_error_carries_arrives_as_well(missed):
    assert pickle.loads(pickle.dumps(StaticsError("no", 0.25))).load_fraction == 0.25
    plan = pickle.loads(pickle.dumps(PlanError(missed))).plan
    assert plan.status is missed.status
    np.testing.assert_array_equal(plan.x, missed.x)


def missing(number, plan, reporter):
    if number == 2:
        raise PlanError(plan)
    return number


def test_a_missed_target_in_a_process_leaves_the_pool_and_the_environment_alone(missed):
    before = dict(os.environ)
    with pytest.raises(PlanError, match="out of reach") as caught:
        run_tasks(missing, [(1, missed), (2, missed)], 2)
    assert caught.value.plan.status is missed.status
    jobs = [(missing, (number, missed, None)) for number in (1, 2, 3)]
    ended = dict(iter_finished(jobs, 2))
    assert [number for number in ended if ended[number].exception() is None] != []
    assert [ended[n].exception() is None for n in range(3)] == [True, False, True]
    assert dict(os.environ) == before


# --- where processes cannot be had ---------------------------------------------------------


def doubled(number, reporter):
    return 2 * number, os.getpid()


def no_lock(self):
    raise OSError(30, "Read-only file system")


@pytest.mark.parametrize("hindrance", ["no shared memory", "a daemon", "one core"])
def test_tasks_are_computed_here_where_no_process_can_be_started(monkeypatch, hindrance):
    processes = 2
    if hindrance == "no shared memory":
        monkeypatch.setattr("multiprocessing.context.SpawnContext.Lock", no_lock)
    elif hindrance == "a daemon":  # such as a process of a pool of the user's
        config = {**parallel.multiprocessing.current_process()._config, "daemon": True}
        monkeypatch.setattr(parallel.multiprocessing.current_process(), "_config", config)
    else:
        monkeypatch.setattr(os, "sched_getaffinity", lambda _: {3})
        processes = None
    here = os.getpid()
    assert run_tasks(doubled, [(1,), (2,)], processes) == [(2, here), (4, here)]


def test_tasks_are_computed_here_where_there_is_no_room_for_a_process(monkeypatch):
    def full(*arguments):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(parallel.ProcessPoolExecutor, "submit", full)
    assert [number for number, _ in run_tasks(doubled, [(1,), (2,)], 2)] == [2, 4]


def test_all_is_drawn_here_where_no_process_can_be_started(tmp_path, monkeypatch):
    monkeypatch.setattr("multiprocessing.context.SpawnContext.Lock", no_lock)
    monkeypatch.setattr(drawing, "PARTS", drawing.PARTS[-1:])
    monkeypatch.setattr(drawing, "draw_anatomy", lambda *arguments: [])
    plan = plan_motion(load_motion(written(tmp_path, TOUCH)), lookahead=1)
    drawn = drawing.draw_run([plan], [tmp_path / "sequential"], tmp_path, everything=True)
    assert (drawn.page, drawn.failures) == (tmp_path / drawing.PAGE, ())
    assert drawn.page.exists()
    assert (tmp_path / "sequential" / "figures" / "errors.png").exists()


SCRIPT = """
import trunk_ocp as to
from trunk_ocp.analysis.study_tasks import plan_of
from trunk_ocp._support.process_pool import run_tasks
from trunk_ocp.planning.options import Options
motion = to.load_motion({path!r})
plans = run_tasks(plan_of, [(motion, 1, Options(), None)] * 2, 2)
print([plan.status.name for plan in plans])
"""


@pytest.mark.parametrize("place", ["a file", "standard input"])
def test_a_script_needs_no_main_guard(tmp_path, place):
    text = SCRIPT.format(path=str(written(tmp_path, TOUCH)))
    script = written(tmp_path, text, "script.py")
    words, given = ([str(script)], None) if place == "a file" else (["-"], text)
    ended = subprocess.run(
        [sys.executable, *words], input=given, capture_output=True, text=True, timeout=100
    )
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ended.stdout == "['SOLVED', 'SOLVED']\n"  # once: no process ran the script again


def dying(number, reporter):
    os._exit(9)


def test_a_process_ended_from_outside_is_named_with_a_way_out():
    with pytest.raises(TrunkError, match="processes=1"):
        run_tasks(dying, [(1,), (2,)], 2)


DIES_WHILE_SENDING = """
import os, sys, threading, time
from trunk_ocp._support.process_pool import run_tasks
from trunk_ocp.errors import TrunkError

def exit_in_the_middle(thread):
    while True:
        frame = sys._current_frames()[thread]
        while frame is not None:
            if frame.f_code.co_name == "_send" and len(frame.f_locals["buf"]) > 10**6:
                time.sleep(0.005)
                os._exit(9)
            frame = frame.f_back

def large(number, reporter):
    if number == 1:
        main = threading.main_thread().ident
        threading.Thread(target=exit_in_the_middle, args=(main,), daemon=True).start()
    return bytes(10**8)

if __name__ == "__main__":
    try:
        run_tasks(large, [(1,), (2,)], 2)
    except TrunkError as error:
        print(error)
"""


def test_a_process_killed_while_it_sends_its_result_is_noticed(tmp_path):
    """Its half of the result would be waited for without end, also when Python ends."""
    (tmp_path / "script.py").write_text(DIES_WHILE_SENDING)
    words = [sys.executable, "script.py"]
    ended = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert "processes=1" in ended.stdout
    assert "Traceback" not in ended.stderr
    assert ended.returncode == 0


# --- how many ------------------------------------------------------------------------------


def test_processes_are_as_many_as_the_cores_one_may_use(monkeypatch, tmp_path):
    monkeypatch.setattr(parallel, "CGROUP", tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 5, 9})
    assert cores() == 3
    for text, count in {"150000 100000": 2, "10000 100000": 1, "max 100000": 3, "?": 3}.items():
        (tmp_path / "cpu.max").write_text(text + "\n")
        assert cores() == count


@pytest.mark.parametrize("wrong", [0, -1, 10**6, 2.0, True])
def test_a_number_of_processes_that_cannot_be_is_refused(wrong):
    with pytest.raises(InputError, match="processes"):
        run_tasks(doubled, [(1,)], wrong)


def test_the_script_is_back_after_pools_start_in_threads_that_overlap():
    main, hidden = sys.modules["__main__"], []

    def started(number):
        with parallel._script_hidden([(run_tasks, ())]):
            hidden.append(sys.modules["__main__"] is not main)
            time.sleep(0.01 * (number % 3))

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(started, range(16)))
    assert sys.modules["__main__"] is main
    assert hidden == [True] * 16


def test_a_request_to_stop_ends_tasks_in_other_processes():
    reporter = Reporter()
    reporter.stop = True
    with pytest.raises(KeyboardInterrupt):
        run_tasks(doubled, [(n,) for n in range(50)], 2, reporter)


def test_loads_are_data_for_another_process():
    assert pickle.loads(pickle.dumps(Loads(gravity=3.0))) == Loads(gravity=3.0)
