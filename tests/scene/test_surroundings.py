"""Head, log, mass at the tip and targets: where they are, and the same in every output."""

import base64
from dataclasses import dataclass

import numpy as np
import pytest
from plans import MOTIONS, planned, shipped, written

import trunk_ocp as to
from trunk_ocp.figures import film, shapes
from trunk_ocp.problem.mirror import mirrored_motion
from trunk_ocp.problem.motion import LENGTH_OVER_RADIUS
from trunk_ocp.rod.statics import solve_statics
from trunk_ocp.scene.colors import HEAD, MASS
from trunk_ocp.scene.moments import moments_at, phase_at
from trunk_ocp.scene.surroundings import logs, marks, tip_mass
from trunk_ocp.viewer.payload import payload

pytestmark = pytest.mark.slow

TIP = np.array([1.75])

# A log that is wrapped and let go, and whose weight nobody takes.
WRAP = """
name = "wrap"

[bounds]
activation = [-3.5, 0.0]
extension = [0.67, 1.35]

[[phases]]
name = "hang"
duration = 0.5
targets = [{ Z = 1.75, d3 = [0.0, 0.0, 1.0] }]

[[phases]]
name = "wrap"
duration = 1.0

[phases.wrap]
Z = [1.4, 1.75]
points = 3
log_radius = 0.07
angles_deg = [90.0, -60.0]
center = [0.3, 0.0, 1.1]
position_weights = [1.0, 1.0, 1.0]
d3_weights = [0.0, 0.0, 0.0]

[[phases]]
name = "leave"
duration = 0.5
targets = [{ Z = 1.75, d3 = [0.0, 0.0, 1.0] }]
"""


@dataclass
class Solid:
    """An object that an output draws: center and size (3,) in m."""

    kind: str
    center: tuple[float, ...]
    size: tuple[float, ...]

    @classmethod
    def of_facets(cls, facets, color):
        points = facets.reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0)
        kind = "fruit" if color == MASS else "log"
        size = high - low if kind == "fruit" else (high - low)[[0, 1, 0]]
        return cls(kind, tuple((low + high) / 2), tuple(size))

    @classmethod
    def of_page(cls, thing, sample):
        center = np.frombuffer(base64.b64decode(thing["center"]), "<f4").reshape(-1, 3)[sample]
        length = thing.get("length", 2 * thing["radius"])
        return cls(thing["kind"], tuple(center), (2 * thing["radius"], length, 2 * thing["radius"]))


def same(ones, others):
    def numbers(solids):
        return np.array([[*solid.center, *solid.size] for solid in solids]).reshape(-1, 6)

    def kind(solid):
        return solid.kind

    ones, others = sorted(ones, key=kind), sorted(others, key=kind)
    assert [kind(one) for one in ones] == [kind(other) for other in others]
    # Balls and cylinders of twenty facets are up to 1.3 % narrower than round ones.
    np.testing.assert_allclose(numbers(ones), numbers(others), rtol=0.015, atol=2e-3)


def on_page(plan, moment):
    data = payload([plan])["plans"][0]
    at = np.flatnonzero(np.abs(np.array(data["times"]) - moment.time) < 1e-9)
    sample = int(at[-1] if moment.after else at[0])
    shown = [thing for thing in data["objects"] if thing.get("shown", [True] * 999)[sample]]
    return [Solid.of_page(thing, sample) for thing in shown]


def in_film(plan, moment):
    stage = film.Stage(plan, [moment])
    return [Solid.of_facets(s.facets, s.color) for s in stage.objects(moment)]


def in_figure(plan, phase):
    """Objects at the end of a phase's row, besides trunk and head."""
    row = shapes.row_of(plan, phase)
    surfaces = shapes.layer(plan, row, len(row.trunks) - 1)[1:]
    objects = (surface for surface in surfaces if surface.color != HEAD)
    return row.trunks[-1], [Solid.of_facets(s.facets, s.color) for s in objects]


@pytest.fixture(scope="module")
def wrapped(tmp_path_factory):
    """A plan that need not reach anything."""
    path = written(tmp_path_factory.mktemp("wrap"), WRAP)
    return to.plan_motion(to.load_motion(path), lookahead=1, throw=False)


@pytest.fixture(scope="module")
def mirrored():
    """The asymmetric lift to the other side."""
    return to.plan_motion(mirrored_motion(shipped("lift-log-asymmetric")), lookahead=1)


def check_outputs(plan):
    for phase in range(len(plan.motion.phases)):
        moment, figure = in_figure(plan, phase)
        same(on_page(plan, moment), figure)
        same(in_film(plan, moment), figure)
        assert figure


@pytest.mark.parametrize("name", MOTIONS)
def test_figures_film_and_page_draw_the_same_objects(name):
    check_outputs(planned(name, "sequential"))


def test_they_do_so_of_a_log_whose_weight_is_not_taken(wrapped):
    check_outputs(wrapped)
    (log,) = logs(wrapped)
    assert (log.radius, log.length) == (0.07, LENGTH_OVER_RADIUS * 0.07)
    np.testing.assert_allclose(log.centers, np.broadcast_to((0.3, 0.0, 1.1), (4, 3)), atol=1e-12)


def test_they_do_so_of_a_mirrored_lift(mirrored):
    check_outputs(mirrored)
    (log,), (original,) = logs(mirrored), logs(planned("lift-log-asymmetric", "sequential"))
    reflected = original.centers * (1, -1, 1)
    np.testing.assert_allclose(log.centers, reflected, rtol=0, atol=1e-12)
    assert (log.radius, log.length) == (original.radius, original.length)


def test_between_steps_the_film_has_the_log_where_the_page_has_it():
    plan = planned("lift-log", "sequential")
    times = np.array(payload([plan])["plans"][0]["times"])
    between = times[~np.isin(times, plan.motion.times)][[10, 30, -2]]
    for moment in moments_at(plan, between):
        same(in_film(plan, moment), on_page(plan, moment))


@pytest.mark.parametrize("name", ["lift-log", "lift-log-asymmetric"])
def test_the_log_is_where_the_motion_says(name):
    plan = planned(name, "sequential")
    phases = plan.motion.spec.phases
    wrap, load = phases[0].wrap, phases[2].loads.log
    passive_tip = solve_statics(plan.motion.trunk, np.zeros(28)).position(TIP)[0]
    (log,) = logs(plan)
    assert (log.radius, log.length) == (wrap.log_radius, load.length)
    for step, center in ((0, wrap.center), (1, wrap.center), (10, phases[2].wrap.path[-1])):
        expected = passive_tip + center - np.array([0, load.offset, 0])
        np.testing.assert_allclose(log.centers[step], expected, rtol=0, atol=1e-4)


@pytest.mark.parametrize("side", [1, -1])
def test_an_offset_log_weighs_on_the_side_it_is_drawn(mirrored, side):
    """Its weight, at its middle, makes the couple of eq. (54) about the grip."""
    plan = planned("lift-log-asymmetric", "sequential") if side == 1 else mirrored
    ((grip,), (log,)) = logs(planned("lift-log", "sequential")), logs(plan)
    loads = plan.motion.steps[5].loads
    couple = np.cross(log.centers[6] - grip.centers[6], loads.contact_force)
    np.testing.assert_allclose(couple, loads.contact_couple, rtol=0, atol=1e-9)
    assert np.sign(log.centers[6, 1]) == -side


def test_the_fruit_waits_at_its_target_and_then_hangs_on_the_tip():
    plan = planned("pick-fruit", "sequential")
    mass, picked = tip_mass(plan), plan.motion.phases[1].end
    assert mass.mass == 8.0
    assert 4 / 3 * np.pi * mass.radius**3 * 1000 == pytest.approx(8.0)  # a ball of water
    for moment in moments_at(plan, np.array([0.0, 1.0, picked, picked + 1])):
        carried = moment.after or moment.time > picked
        tip, d3 = moment.shape.position(TIP)[0, 0], moment.shape.directors(TIP)[0, 0, 2]
        expected = tip + mass.radius * d3 if carried else mass.place
        np.testing.assert_allclose(mass.center(plan, moment), expected, rtol=0, atol=1e-12)
    fruit = np.array([0.7, 0.3, -0.2])  # the target; the ball touches it
    assert np.linalg.norm(mass.place - fruit) == pytest.approx(mass.radius, abs=2e-3)


def test_a_motion_without_log_or_mass_has_none(wrapped):
    assert tip_mass(wrapped) is None
    assert logs(planned("pick-fruit", "sequential")) == []


def test_marks_are_the_targets_that_have_a_weight():
    plan = planned("pick-fruit", "sequential")
    (mark,) = marks(plan, 0)
    np.testing.assert_array_equal(mark.target, (0.7, 0.3, -0.2))
    assert mark.placed
    assert mark.Z == 1.75
    np.testing.assert_allclose(mark.reached, plan.part(0, 1).position(TIP)[0, 0], atol=1e-4)


def test_a_time_belongs_to_the_phase_that_leads_to_it():
    motion = shipped("pick-fruit")
    ends = [phase.end for phase in motion.phases]
    assert [phase_at(motion, end) for end in ends] == [0, 1, 2]
    assert [phase_at(motion, end, after=True) for end in ends[:-1]] == [1, 2]
    assert phase_at(motion, 0.0) == 0
