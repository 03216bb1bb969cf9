"""The shipped motions with [contact] need it: without, their trunks pass through something."""

import numpy as np
import pytest

from trunk_ocp.model.solids import signed_distance
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status
from trunk_ocp.problem.build import load_motion
from trunk_ocp.scene.body import section_scale

pytestmark = pytest.mark.slow

Z = np.linspace(0.0, 1.75, 200)


def without_contact(name):
    """Positions (steps, n, 3) and radii (steps, n) of the plan that minds no solid."""
    plan = plan_motion(load_motion(name).with_contact("none"))
    assert plan.status is Status.SOLVED
    trunk = plan.motion.trunk
    radii = section_scale(trunk, plan.shape)[:, None] * trunk.radius(Z)
    return plan, plan.shape.position(Z), radii


def test_the_fruit_behind_posts_is_reached_through_a_post_without_contact():
    plan, points, radii = without_contact("fruit-behind-posts")
    assert plan.motion.with_contact("all").contact > load_motion("fruit-behind-posts").contact
    (post, _) = (s for s in plan.motion.steps[-1].solids if s.group == "obstacles")
    gaps = signed_distance(post, points)[0] - radii
    assert gaps[0].min() > 0.05
    assert gaps.min() < -0.1


def test_the_tip_of_a_tight_curl_enters_the_trunk_without_contact():
    _, points, radii = without_contact("tight-curl")
    to_tip = np.linalg.norm(points - points[:, -1:], axis=-1) - radii - radii[:, -1:]
    apart = Z < 1.2  # far from the tip along the trunk
    assert to_tip[0, apart].min() > 0.02
    assert to_tip[-1, apart].min() < -0.02
