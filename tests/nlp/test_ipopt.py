"""What ends a solve from outside: Ctrl-C, a reporter, a deadline, other threads."""

import contextlib
import gc
import signal
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import trunk_ocp as to
from trunk_ocp._support.blas_threads import one_thread
from trunk_ocp._support.deferred_signals import deferred_interrupts
from trunk_ocp.nlp.ipopt import Optimizer
from trunk_ocp.nlp.outcome import Outcome, Solve
from trunk_ocp.planning.decided_steps import DecidedSteps
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planning_run import PlanningRun

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def motion():
    return to.load_motion("lift-log")


@pytest.fixture(scope="module")
def plan(motion):
    return to.plan_motion(motion)


class Interrupting(to.Reporter):
    """Sends Ctrl-C to its own process at the given iteration."""

    def __init__(self, at: int) -> None:
        self.left = at

    def iteration(self, progress: to.Progress) -> None:
        self.left -= 1
        if self.left == 0:
            signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("at", [1, 2, 30, 60, 71])
def test_an_interrupt_reaches_the_caller(motion, at):
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        to.plan_motion(motion, reporter=Interrupting(at))
    assert signal.getsignal(signal.SIGINT) is before


def test_interrupts_at_any_moment(motion):
    """Ctrl-C from another thread, wherever the solve is: it is raised, or the plan says so."""
    outcomes = []
    for wait in np.linspace(0.02, 0.5, 6):
        timer = threading.Timer(wait, signal.raise_signal, [signal.SIGINT])
        timer.start()
        try:
            plan = to.plan_motion(motion, 1)
            timer.cancel()
            timer.join()
            outcomes.append(plan.status)
        except KeyboardInterrupt:
            outcomes.append("interrupt")
        with contextlib.suppress(KeyboardInterrupt):
            timer.join()
    assert set(outcomes) <= {"interrupt", to.Status.SOLVED}
    assert outcomes[0] == "interrupt"


def test_what_a_reporter_raises_reaches_the_caller(motion):
    class Faulty(to.Reporter):
        def iteration(self, progress):
            raise ZeroDivisionError("of mine")

    with pytest.raises(ZeroDivisionError, match="of mine"):
        to.plan_motion(motion, reporter=Faulty())


def test_a_handler_that_does_not_raise_runs_as_ever():
    came = []
    before = signal.signal(signal.SIGINT, lambda number, frame: came.append(number))
    try:
        with deferred_interrupts() as deferred:
            signal.raise_signal(signal.SIGINT)
            assert came == [signal.SIGINT]
            assert deferred.error is None
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_deadline_ends_a_plan_and_says_so(motion):
    plan = to.plan_motion(motion, deadline=1e-3, throw=False)
    assert plan.status is to.Status.TIME_LIMIT
    with pytest.raises(to.PlanError, match="deadline"):
        to.plan_motion(motion, deadline=1e-3)
    for wrong in (0, -1.0, "soon", float("nan"), True):
        with pytest.raises(to.InputError, match="deadline"):
            to.plan_motion(motion, deadline=wrong)


def test_a_deadline_ends_a_replan_for_a_target_out_of_reach(motion, plan):
    again = to.Replanner(plan)
    far = again(motion.shifted((2.0, 0.0, 0.0)), throw=False, deadline=0.2)
    assert far.status is to.Status.TIME_LIMIT
    near = again(motion.shifted((0.0, 0.0, 0.001)), throw=False)  # the deadline does not stick
    assert near.converged


def test_a_replan_cut_short_is_its_last_iterate(motion, plan):
    """Two iterations nearly reach a target that moved by 2 cm; the old plan is not returned."""
    moved = motion.shifted((0.0, 0.02, 0.0))
    full = to.Replanner(plan)(moved)
    few = to.Replanner(plan, to.Options(max_iterations=2))(moved, throw=False)
    assert few.status is to.Status.ITERATION_LIMIT
    assert few.objective.total == pytest.approx(full.objective.total, rel=0.02)
    old = replace(plan, motion=moved)
    assert old.objective.total > 2 * full.objective.total


def test_multipliers_belong_to_the_point_that_is_returned(plan):
    """A solve cut short returns the best point it met as a solve would that ended there."""
    motion, count = plan.motion, len(plan.motion.steps)

    def cut(most: int, return_last: bool = False) -> tuple[Outcome, Solve]:
        optimizer = Optimizer(max_iterations=most)
        work = PlanningRun(motion, plan.mesh, "horizon", count, Options(), optimizer)
        window = work.window(0, motion.steps, DecidedSteps())
        start = work.packed(window, np.zeros_like(plan.x))
        outcome = optimizer.solve(window, start, "horizon", "few", return_last=return_last)
        return outcome, optimizer.solves[-1]

    for most in range(18, 40):
        best, record = cut(most)
        objectives = np.array([objective for objective, _, _ in record.history])
        at = int(np.argmin(np.abs(objectives - best.objective)))
        if 0 < at < most:  # the best is neither the start nor the last
            break
    assert 0 < at < most
    ended, _ = cut(at, return_last=True)
    np.testing.assert_array_equal(best.full, ended.full)
    for name in ("lam_x0", "lam_g0"):
        np.testing.assert_array_equal(best.multipliers[name], ended.multipliers[name])


def test_threads_take_turns_with_a_replanner(motion, plan):
    again = to.Replanner(plan)

    def ask(n: int) -> to.Plan:
        return again(motion.shifted((0.0, 0.001 * n, 0.0)), throw=False)

    with ThreadPoolExecutor(4) as pool:
        plans = list(pool.map(ask, range(6)))
    alone = to.Replanner(plan)
    for n, found in enumerate(plans):
        assert found.converged
        assert found.verified
        expected = alone(motion.shifted((0.0, 0.001 * n, 0.0)), throw=False)
        assert found.objective.total == pytest.approx(expected.objective.total, rel=1e-4)


def blas_threads() -> set[int]:
    return {lib["num_threads"] for lib in threadpool_info() if lib["user_api"] == "blas"}


@pytest.mark.parametrize("first_to_end", [0, 1])
def test_blocks_of_one_thread_that_overlap_in_two_threads_restore_blas(first_to_end):
    with one_thread():
        pass  # loads every BLAS
    entered, may_end = threading.Barrier(3), [threading.Event(), threading.Event()]

    def block(i: int) -> None:
        with one_thread():
            entered.wait(10)
            may_end[i].wait(10)

    with threadpool_limits(2, user_api="blas"), ThreadPoolExecutor(2) as pool:
        before, within = blas_threads(), []
        blocks = [pool.submit(block, i) for i in range(2)]
        entered.wait(10)
        for i in (first_to_end, 1 - first_to_end):
            within.append(blas_threads())
            may_end[i].set()
            blocks[i].result()
        after = blas_threads()
    assert within == [{1}, {1}]
    assert after == before


def test_plans_in_several_threads(motion):
    with ThreadPoolExecutor(3) as pool:
        plans = list(pool.map(lambda _: to.plan_motion(motion, 1), range(3)))
    for found in plans[1:]:
        np.testing.assert_array_equal(found.x, plans[0].x)


def test_a_plan_of_a_part_is_marked(plan):
    late = replace(plan, late=True)
    assert late.status is to.Status.TIME_LIMIT
    assert late.status.exit_code == 3


# --- signals -----------------------------------------------------------------------------


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="a system without timers")
def test_no_signal_is_lost_and_no_handler_left_over():
    """Two thousand short blocks under a storm of timers: each signal is raised, none is left."""
    raised = 0

    def ring(number, frame):
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, ring)
    interrupt = signal.getsignal(signal.SIGINT)
    gc.disable()  # what a handler raises in a destructor is lost to everybody
    try:
        for _ in range(2000):
            try:
                signal.setitimer(signal.ITIMER_REAL, 1e-4)
                for _ in range(100_000):
                    with deferred_interrupts():
                        sum(range(20))
            except TimeoutError:
                raised += 1
        assert raised == 2000
        with deferred_interrupts():  # nothing of them comes up later
            pass
    finally:
        gc.enable()
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert signal.getsignal(signal.SIGINT) is interrupt


def test_a_handler_that_puts_another_in_its_place_stays_deferred():
    came = []

    def first(number, frame):
        came.append("first")
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, first)
    try:
        with pytest.raises(KeyboardInterrupt), deferred_interrupts():  # noqa: PT012
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            came.append("end of the block")
        assert came == ["first", "end of the block"]
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_an_inner_block_raises_what_came_and_the_outer_one_does_not_again():
    with deferred_interrupts():
        with pytest.raises(KeyboardInterrupt), deferred_interrupts():
            signal.raise_signal(signal.SIGINT)
        handled = True
    assert handled


def test_a_reporter_may_plan_and_handle_what_fails(motion):
    class Planner(to.Reporter):
        asked = False

        def iteration(self, progress):
            if not self.asked:
                self.asked = True
                with pytest.raises(LookupError):
                    to.plan_motion(motion, 1, reporter=Faulty(LookupError()))

    plan = to.plan_motion(motion, 1, reporter=Planner())
    assert plan.status is to.Status.SOLVED


class Faulty(to.Reporter):
    def __init__(self, error):
        self.error = error

    def iteration(self, progress):
        raise self.error


def test_any_exception_of_a_reporter_comes_as_it_is(motion):
    with pytest.raises(StopIteration):
        to.plan_motion(motion, 1, reporter=Faulty(StopIteration()))


# --- re-plans ----------------------------------------------------------------------------


def test_a_reporter_cannot_ask_its_own_replanner(motion, plan):
    class Asking(to.Reporter):
        again = None

        def iteration(self, progress):
            if self.again is not None:
                self.again(motion)

    reporter = Asking()
    reporter.again = again = to.Replanner(plan, reporter=reporter)
    with pytest.raises(to.InputError, match="busy"):
        again(motion)
    reporter.again = None
    assert again(motion).status is to.Status.SOLVED


def test_an_unreachable_target_spoils_no_later_replan(motion, plan):
    again = to.Replanner(plan)
    again(motion.shifted((0.6, 0.0, 0.0)), throw=False)
    for _ in range(2):
        assert again(motion).status is to.Status.SOLVED
    assert len(again._optimizer.solves) == 1


# --- plans that are cut short ------------------------------------------------------------


class Stopping(to.Reporter):
    def note(self, text):
        self.stop = "too coarse" in text


def test_a_stop_before_a_finer_mesh_keeps_the_plan_there_is(motion):
    """On a mesh that is too coarse, stopped as soon as the finer one is spoken of."""
    coarse = to.Options(elements=1, degree=3)
    plan = to.plan_motion(motion, 1, coarse, Stopping(), throw=False)
    assert plan.status is to.Status.INTERRUPTED
    assert len(plan.x) == len(motion.steps)


def test_a_plan_out_of_time_is_of_the_motion_that_was_asked(motion, plan):
    moved = motion.shifted((0.0, 0.5, 0.0))
    late = to.plan_motion(moved, start=plan, deadline=1e-9, throw=False)
    assert late.motion is moved
    assert late.status is to.Status.TIME_LIMIT
    assert late.missed
