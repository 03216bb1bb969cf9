"""The conversation of the live page, without a network."""

import base64
import json
import re

import numpy as np
import pytest
from plans import POINT, shipped, written

from trunk_ocp.errors import InputError
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.replanning import Replanner
from trunk_ocp.planning.status import Status
from trunk_ocp.problem.build import load_motion
from trunk_ocp.viewer.live_messages import Inbox, parsed
from trunk_ocp.viewer.live_session import LiveSession
from trunk_ocp.viewer.payload import payload

PLACE = [0.65, 0.05, 1.15]  # of the last target, within reach
FAR = [2.9, 0.0, 0.5]


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return plan_motion(load_motion(written(tmp_path_factory.mktemp("live"), POINT)))


@pytest.fixture
def session(plan):
    return LiveSession(plan, Inbox())


def drag(position, done, n=1, name="3:0"):
    change = {"name": name, "position": position, "done": done}
    return parsed(json.dumps({"n": n, "drag": change}))


def answers(session, *messages):
    """Updates after messages that came together, until the plan is checked."""
    for message in messages:
        session._inbox.put(message)
    updates = []
    for update in session.run():
        updates.append(update)
        state = update.get("status", {}).get("state")
        if state in ("good", "bad") or (update["fault"] and state != "busy"):
            break
    return updates


def floats(text, width=3):
    return np.frombuffer(base64.b64decode(text), "<f4").reshape(-1, width)


def tip_at(plan, index):
    """The tip of a sample in what the page gets."""
    return floats(plan["frames"]["position"]).reshape(len(plan["times"]), -1, 3)[index, -1]


def first(session, *messages):
    for message in messages:
        session._inbox.put(message)
    return next(session.run())


def test_while_dragging_the_newest_iterate_is_shown_unchecked(session, plan):
    update = first(session, drag(PLACE, False, n=7))
    assert (update["answers"], update["fault"]) == (7, "")
    assert update["status"] == {"text": "not checked yet: let go", "state": "open"}
    assert session.plan.deferred
    assert session.solved is plan
    asked = next(h for h in update["plan"]["handles"] if h["name"] == "3:0")
    assert asked["position"] == pytest.approx(PLACE, abs=1e-12)
    assert update["plan"]["times"] == [0.0, *plan.motion.times]
    last = session.plan.shape[-1].position(np.array([1.75]))[0]
    assert tip_at(update["plan"], -1) == pytest.approx(last, abs=1e-6)


def test_a_plan_that_was_let_go_is_that_of_the_replanner_and_of_the_planner(session, plan):
    *_, update = answers(session, drag(PLACE, True))
    assert re.fullmatch(r"verified, [\d.]+ mm", update["status"]["text"])
    assert session.solved is session.plan
    motion = plan.motion.retarget("rise", path=[[0.6, 0.1, 1.2], PLACE])
    again, anew = Replanner(plan)(motion), plan_motion(motion)
    for other in (again, anew):
        J = other.objective.total
        assert session.plan.objective.total == pytest.approx(J, rel=5e-3)
    assert update["status"]["objective"] == pytest.approx(again.objective.paper, rel=1e-2, abs=1e-4)


def test_what_is_out_of_reach_is_said_to_be_so_and_comes_back(session, plan):
    *_, update = answers(session, drag(FAR, True))
    distance = float(re.fullmatch(r"cannot be reached: (\d+) mm away", update["status"]["text"])[1])
    tip = session.plan.sample(plan.motion.times[-1]).shape.position(np.array([1.75]))[0]
    assert distance == pytest.approx(1e3 * np.linalg.norm(tip - FAR), abs=0.6)
    assert session.solved is plan
    assert answers(session, drag(PLACE, True))[-1]["status"]["state"] == "good"


def test_let_go_the_page_gets_as_many_shapes_as_from_disk(session):
    session._inbox.put(drag(PLACE, True))
    updates = []
    for update in session.run():
        updates.append(update)
        if len(update.get("plan", {}).get("times", ())) > 10:
            break
    fine = payload([session.plan])["plans"][0]
    assert {key: updates[-1]["plan"][key] for key in ("times", "frames", "targets", "arrows")} == {
        key: fine[key] for key in ("times", "frames", "targets", "arrows")
    }


def test_a_new_message_ends_what_takes_longer(session):
    session._inbox.put(drag(PLACE, True))
    conversation = session.run()
    assert next(conversation)["status"]["state"] == "busy"
    session._inbox.put(drag(FAR, False, n=2))
    texts = []
    while True:
        update = next(conversation)
        texts.append(update["status"]["text"] if "status" in update else "plan")
        if update["answers"] == 2:
            break
    assert "plan" not in texts  # the many shapes of a plan that is out of date
    assert texts[-1] == "not checked yet: let go"


def test_a_fault_is_answered_with_a_sentence_and_the_conversation_goes_on(session):
    bad = parsed('{"n": 3, "bound": {"muscles": "R9-dl", "activation": [-1.0, 0.0]}}')
    update = answers(session, bad)[-1]
    assert "no such muscle" in update["fault"]
    assert (
        "expected the name of a target" in first(session, drag(PLACE, False, name="8:8"))["fault"]
    )
    assert "from the base" in first(session, drag([1e9, 0.0, 0.0], False))["fault"]
    good = parsed('{"n": 4, "bound": {"muscles": "*-dl", "activation": [-0.3, 0.0]}}')
    update = answers(session, good)[-1]
    assert update["fault"] == ""
    dl = [i for i, name in enumerate(session.plan.motion.trunk.muscles) if name.endswith("-dl")]
    assert session.plan.activations[:, dl].min() >= -0.3 - 1e-6


def test_a_limit_that_changes_the_structure_is_planned_anew_and_undone(session, plan):
    update = answers(session, parsed('{"n": 1, "speed": {"largest": 1.5}}'))[-1]
    assert update["status"]["state"] == "good"
    change = np.abs(np.diff(session.plan.trajectory[:, :-2], axis=0)).max(axis=1)
    steps = np.diff(np.append(0.0, plan.motion.times))
    assert np.all(change <= 1.5 * steps + 1e-6)
    assert first(session, drag(PLACE, False, n=2))["status"]["state"] == "open"
    answers(session, parsed('{"n": 3, "reset": true}'))
    assert session.plan.motion.spec == plan.motion.spec
    assert session.plan.objective.total == pytest.approx(plan.objective.total, rel=1e-3)


def test_a_session_needs_a_horizon_that_converged():
    failed = plan_motion(shipped("lift-log"), lookahead=1, deadline=1e-3, throw=False)
    assert failed.status is Status.TIME_LIMIT
    with pytest.raises(InputError, match="converged"):
        LiveSession(failed, Inbox())


@pytest.mark.parametrize(
    "text",
    [
        "",
        "null",
        "[]",
        "{",
        "[" * 5000,
        b"\xff\xfe",
        '{"n": 1}',
        '{"n": -1, "reset": true}',
        '{"n": 1, "reset": true, "drag": {"name": "0:0", "position": [0, 0, 0], "done": true}}',
        '{"n": 1, "drag": {"name": "0:0", "position": [0, 0], "done": true}}',
        '{"n": 1, "drag": {"name": "0:0", "position": [0, 0, NaN], "done": true}}',
        '{"n": 1, "drag": {"name": "0:0", "position": [0, 0, 1e999], "done": true}}',
        '{"n": 1, "drag": {"name": "0:0", "position": ["0", 0, 0], "done": true}}',
        '{"n": 1, "speed": {"largest": 0}}',
        '{"n": 1, "reset": true, "file": "/etc/passwd"}',
        '{"n": 1%s, "reset": true}' % ("0" * 6000),
    ],
)
def test_garbage_is_no_message(text):
    with pytest.raises(InputError):
        parsed(text)


def test_of_waiting_messages_on_one_subject_the_newest_counts():
    inbox = Inbox()
    for n in range(5):
        inbox.put(drag(PLACE, n == 4, n=n))
    inbox.put(drag(PLACE, True, n=5, name="0:0"))
    assert [(m.n, m.done) for m in inbox.take()] == [(4, True), (5, True)]
    assert not inbox.waiting
    inbox.put(drag(PLACE, False))
    inbox.put(parsed('{"n": 9, "reset": true}'))
    assert [m.n for m in inbox.take()] == [9]
    for n in range(Inbox.MOST):
        inbox.put(drag(PLACE, False, name=f"{n}:0"))
    with pytest.raises(InputError, match="others wait"):
        inbox.put(drag(PLACE, False, name="another:0"))
    inbox.close()
    assert inbox.take() == []
