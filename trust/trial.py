"""Trial of one file: it must be refused with a message, or planned with a correct answer."""

from __future__ import annotations

import time
import tomllib
import traceback
import warnings
from dataclasses import dataclass, field
from pathlib import Path

from trunk_ocp.errors import InputError
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.planning.storage import load_plan
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.motion import Motion
from trunk_ocp.reporting import Progress, Reporter

from .answers import wrongs

READING = 1.0
"""Seconds of processor time that reading a file may take; a passive trunk may have to be found."""
PLANNING = 30.0
"""Seconds after which a plan is stopped."""


class Deadline(Reporter):
    """Stops a plan after some seconds."""

    def __init__(self, seconds: float) -> None:
        self._end = time.monotonic() + seconds

    def iteration(self, progress: Progress) -> None:
        """Stop once the time is up."""
        self.stop = time.monotonic() > self._end


@dataclass
class Verdict:
    """Outcome of a trial.

    `outcome` is "refused" or the status of the plan; `faults` lists what went wrong.
    """

    outcome: str
    message: str = ""
    reading: float = 0.0
    planning: float = 0.0
    checked: bool = False
    faults: list[str] = field(default_factory=list)


def tried(path: Path, lookahead: int | None = None) -> Verdict:
    """Read a problem file, plan it if it can be, and check a plan that says it is solved."""
    began = time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            motion = load_motion(path)
        except InputError as error:
            verdict = Verdict("refused", str(error))
            if path.name not in str(error):
                verdict.faults.append(f"the message does not name the file: {error}")
        except Exception:
            verdict = Verdict("crashed", faults=[traceback.format_exc()])
        else:
            verdict = Verdict("read")
        verdict.reading = time.process_time() - began
        if verdict.reading > READING:
            verdict.faults.append(f"reading took {verdict.reading:.1f} s")
        verdict.faults += [f"warning while reading: {w.message}" for w in caught]
        caught.clear()
        if verdict.outcome == "read":
            _plan(motion, path, lookahead, verdict)
        # Only warnings of the package: the independent check may warn of its own difficulties.
        ours = [w for w in caught if "trunk_ocp" in w.filename]
        verdict.faults += [f"warning: {w.message} ({w.filename}:{w.lineno})" for w in ours]
    return verdict


def restored(folder: Path) -> Verdict:
    """Load a saved plan that may be damaged, and check its contents."""
    began = time.perf_counter()
    verdict = Verdict("refused")
    try:
        plan = load_plan(folder, throw=False)
        verdict.outcome = plan.status.name.lower()
        if plan.status is Status.SOLVED:
            problem = plan.motion.spec.model_dump(mode="json", exclude_none=True)
            verdict.faults += wrongs(problem, plan)
            verdict.checked = True
    except InputError as error:
        verdict.message = str(error)
        if "solution.nc" not in verdict.message:
            verdict.faults.append(f"the message does not name the file: {error}")
    except Exception:
        verdict.outcome = "crashed"
        verdict.faults.append(traceback.format_exc())
    verdict.reading = time.perf_counter() - began
    return verdict


def _plan(motion: Motion, path: Path, lookahead: int | None, verdict: Verdict) -> None:
    """Plan a motion and check the plan."""
    began = time.perf_counter()
    reporter = Deadline(PLANNING)
    try:
        plan = plan_motion(motion, lookahead, Options(max_iterations=150), reporter, throw=False)
        verdict.outcome = plan.status.name.lower()
        verdict.planning = time.perf_counter() - began
        if plan.status is Status.SOLVED:
            problem = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
            verdict.faults += wrongs(problem, plan)
            verdict.checked = True
    except Exception:
        verdict.outcome = "crashed"
        verdict.faults.append(traceback.format_exc())
    verdict.planning = verdict.planning or time.perf_counter() - began
