"""Loads that jump where a phase starts, and everything that shows a motion over time."""

import base64
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from plans import POINT, planned, written

from trunk_ocp.errors import InputError
from trunk_ocp.figures import film, shapes
from trunk_ocp.motion_files import write_vtk
from trunk_ocp.motion_files.glb import weight_keys
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.problem.build import load_motion
from trunk_ocp.problem.interpolation import jumps, loads_at
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.scene import keyframes
from trunk_ocp.scene.moments import moments_at, times_of_motion
from trunk_ocp.viewer.payload import payload
from trust import between

pytestmark = pytest.mark.slow

TIP = np.array([1.75])
PICKED = between.PICKED
NONE = (0.0, 0.0, 0.0)

# Three phases from 0 to 1, 2 and 4 s, the first two in two steps; loads are put in.
PHASES = """
name = "phases"
[bounds]
activation = [-3.0, 0.0]
extension = [0.67, 1.35]
"""
PHASE = """
[[phases]]
name = "phase"
duration = {duration}
steps = {steps}
interpolation = "{kind}"
targets = [{{ Z = 1.75, d3 = [0.0, 0.0, 1.0] }}]
loads = {{ {loads} }}
"""


def fruit():
    return planned("pick-fruit", "sequential")


def motion_of(folder, first, second, third, kind="cosine"):
    parts = ((1.0, 2, first), (1.0, 2, second), (2.0, 1, third))
    return load_motion(
        written(
            folder,
            PHASES
            + "".join(
                PHASE.format(duration=duration, steps=steps, kind=kind, loads=loads)
                for duration, steps, loads in parts
            ),
        )
    )


def loads_of(motion, pulls=()):
    """Loads of all steps, with the pull's force along -X at some, by number from 0."""
    found = [step.loads for step in motion.steps]
    for step, pull in dict(pulls).items():
        tip = np.add(found[step].tip_force, (-pull, 0.0, 0.0))
        found[step] = replace(found[step], tip_force=tuple(tip))
    return found


# --- the fruit ---------------------------------------------------------------------------


@pytest.mark.parametrize(("mode", "count"), [("sequential", 50), ("horizon", 6)])
def test_the_trunk_that_carries_the_fruit_is_in_equilibrium_under_the_papers_loads(mode, count):
    times = np.linspace(PICKED, PICKED + 2, count).tolist()
    off = between.deviations(planned("pick-fruit", mode), [(t, t == PICKED) for t in times])
    assert off.shape == (count,)
    assert off.max() <= 1e-4  # m


def test_the_trunk_that_pulls_is_in_equilibrium_under_the_papers_loads():
    times = [*np.linspace(1.5, PICKED, 12), 1.5 + 1e-6, PICKED - 1e-6, PICKED]
    assert between.deviations(fruit(), [(t, False) for t in times]).max() <= 1e-4  # m


def test_the_fruit_comes_off_at_once_and_the_tip_goes_down():
    plan = fruit()
    assert plan.jumps == (plan.motion.times[20],)
    before, after = plan.sample(PICKED), plan.sample(PICKED, after=True)
    assert before.loads == plan.loads[20]
    assert np.linalg.norm(before.loads.tip_force) == pytest.approx(100, abs=1e-4)
    assert after.loads.tip_force == pytest.approx((0, 0, 8 * 9.8), abs=1e-6)
    np.testing.assert_array_equal(after.activation, before.activation)
    np.testing.assert_array_equal(after.head, before.head)
    tips = [sample.shape.position(TIP)[0] for sample in (before, after)]
    assert tips[1][2] > tips[0][2] + 0.05  # +Z is down; "slightly lower" in the paper
    soon = plan.sample(PICKED + 1e-6).shape.position(TIP)[0]
    np.testing.assert_allclose(soon, tips[1], rtol=0, atol=1e-6)


def test_elsewhere_both_sides_are_one():
    plan = fruit()
    for t in (0.0, 1.0, 1.5, plan.motion.times[7], 3.0, plan.motion.times[-1]):
        assert plan.sample(t, after=True).loads == plan.sample(t).loads


def test_a_plan_without_steps_is_at_rest():
    plan = fruit()
    none = replace(plan, x=plan.x[:0], tip_forces=plan.tip_forces[:0], shape=plan.part(0, 0))
    assert none.jumps == ()
    assert none.sample(0.0).loads == none.sample(0.0, after=True).loads == plan.sample(0.0).loads
    with pytest.raises(InputError, match=r"t = 0\.1: expected a time from 0 to 0\.0 s"):
        none.sample(0.1)


@pytest.mark.parametrize("count", [20, 21])
def test_a_plan_cut_short_at_the_pull_has_no_fruit(count):
    plan = fruit()
    forces, shape = plan.tip_forces[:count], plan.part(0, count)
    cut = replace(plan, x=plan.x[:count], tip_forces=forces, shape=shape)
    assert cut.jumps == ()
    end = plan.motion.times[count - 1]
    assert cut.sample(end, after=True).loads == cut.sample(end).loads == plan.loads[count - 1]


def test_a_file_can_let_the_fruit_fade_in(tmp_path):
    plan = fruit()
    spec = plan.motion.spec
    phases = list(spec.phases)
    loads = phases[2].loads
    ramps = loads.jump.model_copy(update={"tip_mass": False, "pull": False})
    phases[2] = phases[2].model_copy(update={"loads": loads.model_copy(update={"jump": ramps})})
    faded = replace(plan.motion, spec=spec.model_copy(update={"phases": tuple(phases)}))
    assert jumps(faded, plan.loads) == ()
    halfway = loads_at(faded, plan.loads, PICKED + 1).tip_force
    np.testing.assert_allclose(halfway, plan.tip_forces[20:].mean(axis=0), rtol=0, atol=1e-9)


# --- any load ----------------------------------------------------------------------------

WEIGHT, LOG = "tip_mass = 2.0", "contact_from = 1.0, contact_force = [0.0, 0.0, 30.0]"
FORCE = "tip_force = [5.0, 0.0, 0.0]"
LOADS = {
    "tip_force": (FORCE, "tip_force", (5.0, 0.0, 0.0)),
    "tip_mass": (WEIGHT, "tip_force", (0.0, 0.0, 19.6)),
    "contact": (LOG, "contact_force", (0.0, 0.0, 30.0)),
}
JUMP_BY_DEFAULT = {"tip_force": False, "tip_mass": True, "contact": False}


@pytest.mark.parametrize("said", [None, True, False])
@pytest.mark.parametrize("name", LOADS)
def test_a_load_jumps_or_ramps_as_its_file_says(tmp_path, name, said):
    text, part, full = LOADS[name]
    jump = f"jump = {{ {name} = {str(said).lower()} }}"
    jumping = JUMP_BY_DEFAULT[name] if said is None else said
    tell = "" if said is None else jump
    motion = motion_of(tmp_path, "", ", ".join(filter(None, (text, tell))), tell)
    loads = loads_of(motion)
    assert jumps(motion, loads) == ((1.0, 2.0) if jumping else ())

    def share(t, after=False):
        return np.dot(getattr(loads_at(motion, loads, t, after), part), full) / np.dot(full, full)

    np.testing.assert_allclose([share(t) for t in (0.5, 1, 1.5, 2, 4)], [0, 0, 1, 1, 0], atol=1e-12)
    sides = [share(1.0, True), share(1.25), share(2.0, True), share(3.0)]
    np.testing.assert_allclose(sides, [1, 1, 0, 0] if jumping else [0, 0.5, 1, 0.5], atol=1e-12)


@pytest.mark.parametrize("kind", ["cosine", "hermite", "none"])
def test_a_pull_grows_from_nothing_and_is_gone_at_once(tmp_path, kind):
    pull = "pull = { force = 8.0, held_from_step = 1 }"
    motion = motion_of(tmp_path, FORCE, f"{pull}, {WEIGHT}", pull, kind)
    loads = loads_of(motion, {2: 4.0, 3: 8.0, 4: 8.0})

    def tip(t, after=False):
        return loads_at(motion, loads, t, after).tip_force

    # Of the force of the first phase, which does not jump, nothing is gone yet.
    np.testing.assert_allclose(tip(1.0, True), (5, 0, 19.6), rtol=0, atol=1e-12)
    np.testing.assert_allclose(tip(2.0), (-8, 0, 19.6), rtol=0, atol=1e-12)
    np.testing.assert_allclose(tip(2.0, True), NONE, rtol=0, atol=1e-12)
    held = {"cosine": (-6, 0, 19.6), "none": (-4, 0, 19.6)}
    if kind in held:
        np.testing.assert_allclose(tip(1.75), held[kind], rtol=0, atol=1e-12)
    else:  # monotone
        assert -8 < tip(1.75)[0] < -4
    np.testing.assert_allclose(tip(3.0)[0], 0 if kind == "none" else -4, rtol=0, atol=1e-12)


def test_a_pull_that_does_not_grow_is_there_at_once(tmp_path):
    pull = "pull = { force = 8.0, held_from_step = 1, ramp = false }"
    motion = motion_of(tmp_path, "", pull, pull)
    loads = loads_of(motion, {2: 8.0, 3: 8.0, 4: 8.0 + 1e-8})  # as found by a solver
    assert jumps(motion, loads) == (1.0,)
    for t in (1.2, 1.7, 2.0, 3.0):
        np.testing.assert_allclose(loads_at(motion, loads, t).tip_force, (-8, 0, 0), atol=1e-7)


def test_a_mass_carried_on_does_not_jump_and_one_of_the_first_phase_does(tmp_path):
    motion = motion_of(tmp_path, WEIGHT, WEIGHT, WEIGHT)
    loads = loads_of(motion)
    assert jumps(motion, loads) == (0.0,)
    assert loads_at(motion, loads, 0.0).tip_force == NONE  # at rest there is weight alone
    for t, after in ((0.0, True), (0.25, False), (1.0, True), (1.7, False)):
        assert loads_at(motion, loads, t, after).tip_force == pytest.approx((0, 0, 19.6))


@pytest.mark.parametrize(
    ("jump", "fault"),
    [
        ("{ fruit = true }", "jump.fruit"),
        ("{ pull = 1 }", "jump.pull"),
        ('["pull"]', "loads.jump"),
    ],
)
def test_a_jump_that_cannot_be_understood_is_refused(tmp_path, jump, fault):
    with pytest.raises(InputError, match=fault):
        motion_of(tmp_path, "", f"jump = {jump}", "")


# --- a step's own loads, and the ends of time --------------------------------------------


def test_gravity_is_the_steps_own():
    plan = planned("lift-log", "sequential")
    gravities = [0.0, 0.0, 1.0, 2.0, *[9.8] * 6]
    steps = tuple(
        replace(step, loads=replace(step.loads, gravity=g))
        for step, g in zip(plan.motion.steps, gravities, strict=True)
    )
    motion = replace(plan.motion, steps=steps)
    loads = [step.loads for step in steps]
    shape = solve_statics(motion.trunk, plan.activations, plan.head, loads, near=plan.shape)
    other = replace(plan, motion=motion, shape=shape)
    for step in (0, 2, 3, 9):
        sample = other.sample(motion.times[step])
        assert sample.loads == other.loads[step]
        expected = shape.position(TIP)[step]
        np.testing.assert_allclose(sample.shape.position(TIP), expected, rtol=0, atol=1e-9)
    assert other.sample(0.0).loads.gravity == other.sample(0.5).loads.gravity == 0
    assert other.sample(0.0).shape.position(TIP)[0, 0] == pytest.approx(
        1.75 / 2
    )  # straight, 30 deg
    assert 1 < other.sample(motion.times[2:4].mean()).loads.gravity < 2


def test_contact_starts_where_the_steps_own_does():
    plan = planned("lift-log", "sequential")
    assert plan.loads[0].contact_from is None
    assert plan.sample(plan.motion.times[0]).loads.contact_from is None
    assert plan.sample(1.2).loads.contact_from == plan.loads[1].contact_from


@pytest.mark.parametrize("name", ["pick-fruit", "lift-log"])
def test_a_rounding_error_beyond_either_end_is_at_the_end(name):
    plan = planned(name, "sequential")
    end = plan.motion.times[-1]
    for t, expected in ((-1e-17, 0.0), (np.nextafter(end, 9), end), (end * (1 + 5e-13), end)):
        sample = plan.sample(t)
        assert sample.time == expected
        assert sample.loads == plan.sample(expected).loads


def test_a_rounding_error_beside_a_jump_is_before_it():
    plan = fruit()
    for t in (np.nextafter(PICKED, 0), np.nextafter(PICKED, 9)):
        assert plan.sample(t).loads == plan.loads[20]
        assert plan.sample(t, after=True).loads == plan.sample(PICKED, after=True).loads


def test_a_time_that_is_refused_is_told_in_all_its_digits():
    with pytest.raises(InputError, match=r"t = 2\.4000000001: expected a time from 0 to 2\.4 s"):
        planned("lift-log", "sequential").sample(2.4000000001)


# --- pictures and files ------------------------------------------------------------------


def tips_at_the_jump():
    plan = fruit()
    return [plan.sample(PICKED, after=after).shape.position(TIP)[0] for after in (False, True)]


def test_pictures_of_a_phase_begin_after_the_jump_and_end_before_it():
    plan = fruit()
    rows = [shapes.row_of(plan, number) for number in range(3)]
    before, after = tips_at_the_jump()
    pull, eat = rows[1].trunks[-1], rows[2].trunks[0]
    assert (pull.time, pull.after, eat.time, eat.after) == (PICKED, False, PICKED, True)
    np.testing.assert_allclose(pull.shape.position(TIP)[0, 0], before, rtol=0, atol=1e-6)
    np.testing.assert_allclose(eat.shape.position(TIP)[0, 0], after, rtol=0, atol=1e-6)
    np.testing.assert_allclose(rows[2].tips[0], after, rtol=0, atol=1e-6)
    assert not any(instant.after for row in rows[:2] for instant in row.trunks)


def test_film_and_muscles_show_both_sides():
    plan = fruit()
    for times in (film.frame_times(plan), times_of_motion(plan)):
        moments = moments_at(plan, times[np.abs(times - PICKED) < 0.1])
        at = [moment for moment in moments if moment.time == PICKED]
        assert [moment.after for moment in at] == [False, True]
    times = film.frame_times(plan)
    assert (times[0], times[-1]) == (0.0, plan.motion.times[-1])
    assert np.diff(times).max() < 1.6 * np.median(np.diff(times))


@pytest.mark.parametrize("after", [False, True])
def test_the_film_shows_the_fruit_before_and_after_the_jump(monkeypatch, after):
    plan, held = fruit(), []
    monkeypatch.setattr(film, "paint", lambda axes, view, surfaces, **_: held.append(surfaces))
    moments = moments_at(plan, np.array([PICKED]))
    film.Stage(plan, moments).show(moments[after])
    assert [any(s.color == shapes.MASS for s in drawn) for drawn in held] == [True, True]


def test_key_frames_have_both_sides_of_a_jump_a_millisecond_apart():
    plan = fruit()
    frames = keyframes.for_blending(plan)
    at = int(np.searchsorted(frames.times, PICKED))
    assert frames.times[at] == PICKED
    assert frames.times[at + 1] == pytest.approx(PICKED + keyframes.JUMP_DURATION, abs=1e-12)
    tips = frames.shape.position(TIP)[at : at + 2, 0]
    np.testing.assert_allclose(tips, tips_at_the_jump(), rtol=0, atol=1e-6)
    keys, weights = weight_keys(frames)
    assert np.all(np.diff(keys) > 0)
    jump = int(np.searchsorted(keys, PICKED))
    assert [int(row.argmax()) for row in weights[jump : jump + 2]] == [at - 1, at]


def test_vtk_has_a_file_for_either_side_of_a_jump(tmp_path):
    plan = fruit()
    for path in write_vtk(plan, tmp_path):
        sets = ElementTree.parse(path).getroot().findall("Collection/DataSet")
        times = [float(entry.get("timestep")) for entry in sets]
        expected = sorted([0.0, *plan.motion.times, PICKED + keyframes.JUMP_DURATION])
        np.testing.assert_allclose(times, expected, rtol=0, atol=1e-12)
        files = [tmp_path / entry.get("file") for entry in sets]
        assert len(set(files)) == len({file.read_bytes() for file in files}) == 24


def test_a_jump_at_the_start_is_shown(tmp_path):
    text = POINT.replace("steps = 2\n", "steps = 2\nloads.tip_mass = 3.0\n", 1)
    plan = plan_motion(load_motion(written(tmp_path, text)), lookahead=1)
    assert plan.jumps == (0.0, 1.0)  # taken at the start, and left after the first phase
    frames = keyframes.at_steps(plan)
    times = [0, 0.001, *plan.motion.times[:2], 1.001, *plan.motion.times[2:]]
    np.testing.assert_allclose(frames.times, times, rtol=0, atol=1e-12)
    (mass,) = payload([plan])["plans"][0]["objects"]
    assert mass["mass"] == 3.0
    moments = moments_at(plan, np.array([0.0, 1.0]))
    assert [(m.time, m.after) for m in moments] == [(0, False), (0, True), (1, False), (1, True)]


def test_samples_of_the_page_have_both_sides_and_the_fruit_hangs_on_the_tip():
    plan = fruit()
    told = payload([plan])["plans"][0]
    times = np.array(told["times"])
    (at,) = np.flatnonzero(np.diff(times) == 0)
    assert times[at] == PICKED
    assert told["jumps"] == [PICKED]
    assert np.all(np.diff(times)[np.arange(len(times) - 1) != at] > 1e-6)

    def rows(text):
        return np.frombuffer(base64.b64decode(text), "<f4").reshape(len(times), -1, 3)

    tips = rows(told["frames"]["position"])[:, -1]
    np.testing.assert_allclose(tips[at : at + 2], tips_at_the_jump(), rtol=0, atol=1e-6)
    (thing,) = told["objects"]
    away = np.linalg.norm(rows(thing["center"])[:, 0] - tips, axis=-1)
    np.testing.assert_allclose(away[at:], thing["radius"], rtol=1e-4)
    waiting = rows(thing["center"])[: at + 1, 0]
    np.testing.assert_array_equal(waiting, np.broadcast_to(waiting[-1], waiting.shape))
