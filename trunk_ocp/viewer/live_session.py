"""A conversation about a plan: changes come in, new plans go out. Knows nothing of networks.

While something is dragged, each plan is the newest iterate under a deadline, unchecked. Once it is
let go, the plan is finished, checked, and sampled as finely as that of a page from disk. Whatever
takes longer than a moment ends early where another message waits.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..errors import InputError, TrunkError
from ..nlp.outcome import FEASIBILITY_TOL
from ..nlp.window_layout import layout_of
from ..planning.options import Options
from ..planning.plan import Plan
from ..planning.planner import plan_motion
from ..planning.replanning import Replanner
from ..planning.status import Status
from ..reporting import Progress, Reporter
from ..scene.moments import moments_at
from .bundle import bundled
from .live_edits import EditableMotion, Edits, Handle
from .live_messages import Drag, Inbox, Message
from .live_payload import Update, handle_entries, outcome, quick_plan, smooth_plan
from .payload import payload

DEADLINE = 0.03  # s, for a plan while something is dragged
IPOPT_DEADLINE = 0.3  # s, where Ipopt plans, whose first iterates may violate bounds
STILL = 0.25  # s without a move, until the plan is improved: before, the page needs the processor
ROUNDS = 40  # plans under a deadline, until one converges
FARTHEST = 10.0  # trunk lengths from the base; nothing is dragged beyond
NOT_CHECKED = {"text": "not checked yet: let go", "state": "open"}
PLANNING = {"text": "planning ...", "state": "busy"}
CHECKING = {"text": "checking ...", "state": "busy"}


class _Impatience(Reporter):
    """Ends a solve when another message waits."""

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox

    def iteration(self, progress: Progress) -> None:
        """Look for messages."""
        self.stop = self._inbox.waiting


class LiveSession:
    """The plan of a motion that changes.

    Parameters
    ----------
    plan : Plan
        A converged horizon plan, whose motion the changes start from.
    inbox : Inbox
        Where the messages come from; `run` takes them.

    Attributes
    ----------
    plan : Plan
        The newest one.
    solved : Plan or None
        The newest one that is solved and verified.

    Raises
    ------
    InputError
        If the plan did not converge, or is not a horizon.
    """

    def __init__(self, plan: Plan, inbox: Inbox, options: Options | None = None) -> None:
        self.plan = plan
        self.solved = plan if plan.check() is Status.SOLVED else None
        self._inbox, self._options = inbox, options or Options()
        self._reporter = _Impatience(inbox)
        self._editable, self._edits = EditableMotion(plan.motion), Edits()
        self._motion = plan.motion
        self._replan, self._planned = self._replanner(plan), plan
        self._start = moments_at(plan, np.zeros(1))[0]

    def page(self, socket: str) -> str:
        """Text of the page as it opens; `socket` is the address that it connects to."""
        return bundled(payload([self.plan]), socket)

    def first_update(self) -> Update:
        """What the page gets once it is connected."""
        return {"plan": {"handles": handle_entries(self._handles())}, "status": outcome(self.plan)}

    def run(self) -> Iterator[Update]:
        """Answer messages until the inbox is closed."""
        while messages := self._inbox.take():
            number = max(message.n for message in messages)
            faults = [fault for message in messages if (fault := self._changed(message))]
            about = {"answers": number, "fault": " ".join(faults)}
            try:
                for update in self._plans(messages[-1].done, len(faults) < len(messages)):
                    yield {**update, **about}
            except TrunkError as error:
                yield {**about, "fault": str(error)}

    def _plans(self, done: bool, changed: bool) -> Iterator[Update]:
        """Updates of the page after some messages."""
        if done:
            yield {"status": PLANNING}
            yield from self._finished()
        elif changed:
            yield from self._followed()
        else:
            yield {}

    def _changed(self, message: Message) -> str:
        """Make a change; returns the sentence on what is wrong with it, or nothing."""
        try:
            edits = self._edits_after(message)
            self._motion = self._editable.edited(edits)
            self._edits = edits
        except InputError as error:
            return str(error)
        return ""

    def _edits_after(self, message: Message) -> Edits:
        if message.drag is not None:
            return self._dragged(message.drag)
        if message.bound is not None:
            return self._edits.bounded(message.bound.muscles, *message.bound.activation)
        if message.speed is not None:
            return self._edits.limited(message.speed.largest)
        return Edits()

    def _dragged(self, drag: Drag) -> Edits:
        length = self._motion.trunk.length
        if np.linalg.norm(drag.position) > FARTHEST * length:
            raise InputError(f"position: expected at most {FARTHEST * length:g} m from the base.")
        return self._editable.dragged(self._motion, self._edits, drag.name, drag.position)

    def _followed(self) -> Iterator[Update]:
        """Plans while something is dragged: until one converges, or another message comes."""
        slow = self._planned.gaps or self._motion.spec.weights.symmetric
        for _ in range(ROUNDS):
            plan = self._replanned(IPOPT_DEADLINE if slow else DEADLINE)
            usable = plan is not None and plan.solves[-1].infeasibility <= FEASIBILITY_TOL
            if plan is not None and usable:
                self.plan = plan
                yield self._shown(plan, NOT_CHECKED)
            else:
                yield {"status": PLANNING}
            if plan is None or not plan.late or self._inbox.wait(STILL):
                break

    def _finished(self) -> Iterator[Update]:
        """The plan, checked; nothing more as soon as another message comes."""
        plan = self._replanned(None) or self._planned_anew()
        if plan.interrupted:
            return
        self.plan = plan
        yield self._shown(plan, CHECKING)
        if plan.check() is Status.COLLIDING:
            yield {"status": PLANNING}
            plan = self._planned_anew()
            if plan.interrupted:
                return
            self.plan = plan
            yield self._shown(plan, CHECKING)
        if plan.check() is Status.SOLVED:
            self.solved = plan
        yield {"status": outcome(plan)}
        smooth = smooth_plan(plan, self._handles(), lambda: self._inbox.waiting)
        if smooth is not None:
            yield {"plan": smooth}

    def _replanned(self, deadline: float | None) -> Plan | None:
        """A plan from the last one; None where more than numbers changed."""
        self._reporter.stop = False
        if layout_of(self._motion) != layout_of(self._planned.motion):
            return None
        return self._replan(self._motion, throw=False, deadline=deadline, check="later")

    def _planned_anew(self) -> Plan:
        self._reporter.stop = False
        plan = plan_motion(self._motion, None, self._options, self._reporter, throw=False)
        if plan.converged and not plan.interrupted:
            self._replan, self._planned = self._replanner(plan), plan
        return plan

    def _replanner(self, plan: Plan) -> Replanner:
        self._reporter.stop = False
        return Replanner(plan, self._options, self._reporter)

    def _shown(self, plan: Plan, status: Update) -> Update:
        return {"plan": quick_plan(plan, self._start, self._handles()), "status": status}

    def _handles(self) -> list[Handle]:
        return self._editable.handles(self.plan.motion)
