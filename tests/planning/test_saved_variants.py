"""A plan of a variant of a motion is read back as the plan it was, solved or not.

With VARIANTS=1000 in the environment, a thousand random variants are planned instead of a few.
"""

import os
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st
from plans import POINT, TOUCH, planned, written

from trunk_ocp.analysis.lookahead_study import equal_bounds
from trunk_ocp.analysis.redundancy.ablation import motion_without
from trunk_ocp.errors import InputError
from trunk_ocp.model.loads import Loads
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.planning.storage import load_plan, save_plan
from trunk_ocp.problem.build import as_built, build_motion, load_motion
from trunk_ocp.problem.mirror import mirrored_motion
from trunk_ocp.problem.variants import held_head_spec

pytestmark = pytest.mark.slow

COUNT = int(os.environ.get("VARIANTS", "12"))

# One step with loads of every kind and an auxiliary problem.
LADEN = """
name = "laden"
[bounds]
activation = [-3.0, 0.0]
extension = [0.67, 1.35]
head_z_deg = [-20.0, 10.0]
[[phases]]
name = "hold"
duration = 1.0
auxiliary = { activation_deviation = 0.5 }
change = [{ activation = 2.5 }]
loads.tip_mass = 2.0
loads.tip_force = [3.0, -2.0, 1.0]
loads.log = { contact_from = 1.4, radius = 0.05, length = 1.0, density = 300.0, offset = 0.2 }
bounds.muscles = { "R*" = [-2.5, 0.0] }
[phases.wrap]
Z = [1.4, 1.75]
points = 2
log_radius = 0.05
angles_deg = [80.0, -50.0]
center = [0.3, 0.1, 1.2]
position_weights = [1.0, 1.0]
d3_weights = [1.0, 0.0]
"""


def loaded(kind, value):
    """Change a load of every phase."""

    def change(motion):
        phases = [
            phase.model_copy(update={"loads": phase.loads.model_copy(update={kind: value})})
            for phase in motion.spec.phases
        ]
        return motion.with_spec(motion.spec.model_copy(update={"phases": tuple(phases)}))

    return change


def bounded(pattern, pair):
    """Tighten the bounds of some muscles."""

    def change(motion):
        bounds = motion.spec.bounds
        muscles = bounds.muscles | {pattern: pair}
        bounds = bounds.model_copy(update={"muscles": muscles})
        return motion.with_spec(motion.spec.model_copy(update={"bounds": bounds}))

    return change


def head_held(angle):
    return lambda motion: motion.with_spec(held_head_spec(motion.spec, angle))


def started(seed):
    """Start somewhere else."""

    def change(motion):
        rng = np.random.default_rng(seed)
        return motion.started(rng.uniform(-0.4, 0.1, len(motion.trunk.muscles) + 2))

    return change


def decimals(low, high):
    """Numbers that a problem file may have; it has none closer to zero than 1e-24."""
    return st.floats(low, high).map(lambda value: round(value, 6))


SHIFTS = st.tuples(*[decimals(-0.3, 0.3)] * 3)
PAIRS = st.tuples(decimals(-2.0, -0.5), decimals(-0.4, 0.0))
CHANGES = st.one_of(
    SHIFTS.map(lambda by: lambda motion: motion.shifted(by)),
    decimals(0.5, 4.0).map(lambda most: lambda motion: motion.limited(activation=most)),
    decimals(0.5, 9.0).map(lambda rate: lambda motion: motion.limited(rate=rate)),
    st.builds(bounded, st.sampled_from(["*1-dl", "L*", "R3-vr"]), PAIRS),
    decimals(0.0, 8.0).map(lambda mass: loaded("tip_mass", mass)),
    st.tuples(*[decimals(-9.0, 9.0)] * 3).map(lambda force: loaded("tip_force", force)),
    st.sampled_from(["R1-dl", "L3-vr", "R2-ivo"]).map(
        lambda name: lambda motion: motion_without(motion, (name,))
    ),
    st.just(mirrored_motion),
    st.just(equal_bounds),
    st.sampled_from([0, 1]).map(head_held),
    st.integers(0, 99).map(started),
)


def numbers(step):
    """Bounds of a step as one array."""
    return np.concatenate([step.box.lower, step.box.upper, step.change.lower, step.change.upper])


@settings(
    max_examples=COUNT,
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=list(HealthCheck),
)
@given(
    text=st.sampled_from([TOUCH, POINT, LADEN]),
    changes=st.lists(CHANGES, min_size=1, max_size=4),
    lookahead=st.sampled_from([1, None]),
    iterations=st.sampled_from([2, 30, 300]),
)
def test_a_plan_of_a_variant_comes_back_as_itself(
    tmp_path_factory, text, changes, lookahead, iterations
):
    folder = tmp_path_factory.getbasetemp() / "variant"
    folder.mkdir(exist_ok=True)
    motion = load_motion(written(folder, text))
    try:
        for change in changes:
            motion = change(motion)
    except InputError as error:  # a limit that leaves a muscle nothing
        event(f"no motion: {error}"[:60])
        return
    options = Options(max_iterations=iterations)
    plan = plan_motion(motion, lookahead, options, throw=False)
    save_plan(plan, folder)
    again = load_plan(folder, throw=False)
    event(plan.status.name)
    assert (again.status, again.objective) == (plan.status, plan.objective)
    assert again.loads == plan.loads
    assert (again.motion.extension, again.missed) == (motion.extension, plan.missed)
    np.testing.assert_array_equal(again.trajectory, plan.trajectory)
    for step, same in zip(motion.steps, again.motion.steps, strict=True):
        np.testing.assert_array_equal(numbers(same), numbers(step))
        exact = ("time", "targets", "loads", "pull", "auxiliary", "log", "solids")
        assert {*exact, "duration", "phase", "box", "change"} == {f.name for f in fields(step)}
        assert [getattr(same, name) for name in exact] == [getattr(step, name) for name in exact]


def test_a_missed_plan_is_not_read_back_as_solved_nor_the_other_way_round(tmp_path):
    motion = load_motion(written(tmp_path, TOUCH))
    for moved in (motion.shifted((5.0, 0.0, 0.0)), motion.shifted((0.05, 0.0, 0.0))):
        plan = plan_motion(moved, throw=False)
        save_plan(plan, tmp_path)
        assert load_plan(tmp_path, throw=False).status is plan.status
    assert plan.status is Status.SOLVED


def heavier(motion):
    steps = (
        replace(step, loads=replace(step.loads, tip_force=(0, 0, 9.0))) for step in motion.steps
    )
    return replace(motion, steps=tuple(steps))


@pytest.mark.parametrize(
    "change",
    [
        heavier,
        lambda motion: replace(motion, steps=motion.steps[:2]),
        lambda motion: replace(motion, extension=(0.5, 1.5)),
        lambda motion: replace(motion, spec=motion.spec.model_copy(update={"gravity": 9.0})),
        loaded("tip_mass", 1e-200),
    ],
)
def test_what_could_not_be_read_back_is_not_saved(tmp_path, change):
    plan = plan_motion(load_motion(written(tmp_path, POINT)), lookahead=1)
    save_plan(plan, tmp_path / "out")
    before = {path: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    with pytest.raises(InputError, match=r"changed by hand|no problem file can have"):
        save_plan(replace(plan, motion=change(plan.motion)), tmp_path / "out")
    assert {path: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


def test_loads_changed_in_the_spec_are_kept(tmp_path):
    motion = load_motion(written(tmp_path, TOUCH))
    phase = motion.spec.phases[0]
    loads = phase.loads.model_copy(update={"tip_mass": 3.0})
    spec = motion.spec.model_copy(update={"phases": (phase.model_copy(update={"loads": loads}),)})
    plan = plan_motion(build_motion(spec, motion.anatomy))
    save_plan(plan, tmp_path)
    assert load_plan(tmp_path).loads == (Loads(9.8, (0.0, 0.0, 3.0 * 9.8)),)


def test_a_horizon_that_never_began_is_read_back_as_that(tmp_path):
    start = planned("lift-log", "sequential")
    plan = plan_motion(start.motion, start=start, deadline=1e-9, throw=False)
    save_plan(plan, tmp_path)
    loaded = load_plan(tmp_path, throw=False)
    assert loaded.status is plan.status is Status.TIME_LIMIT
    assert loaded.mode == "horizon"
    assert loaded.auxiliary.keys() == plan.auxiliary.keys() == start.auxiliary.keys()


@pytest.mark.parametrize("position", [np.inf, np.nan])
def test_a_spec_that_no_file_can_have_is_no_variant(tmp_path, position):
    motion = load_motion(written(tmp_path, TOUCH))
    tolerance = motion.spec.tolerance.model_copy(update={"position": position})
    spec = motion.spec.model_copy(update={"tolerance": tolerance})
    with pytest.raises(InputError, match="no problem file can have"):
        motion.with_spec(spec)
    with pytest.raises(InputError):
        save_plan(plan_motion(replace(motion, spec=spec), throw=False), tmp_path / "out")


@pytest.mark.parametrize("rate", [1e-30, 1e25])
def test_a_rate_beyond_the_numbers_of_a_file_is_named(tmp_path, rate):
    motion = load_motion(written(tmp_path, TOUCH))
    with pytest.raises(InputError, match="rate = "):
        motion.limited(rate=rate)


def test_the_rounding_of_another_processor_is_no_change_by_hand(tmp_path):
    motion = load_motion("lift-log")
    moved = tuple(
        replace(target, position=tuple(np.nextafter(target.position, 1.0).tolist()))
        for target in motion.steps[0].targets
    )
    steps = (replace(motion.steps[0], targets=moved), *motion.steps[1:])
    assert as_built(replace(motion, steps=steps))
