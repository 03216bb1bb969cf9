"""Random scenes: whatever a plan claims, points of its surface are in no body, at any time.

SCENES=300 in the environment plans as many; they take some minutes.
"""

import os

import pytest
from dense_contact import deepest
from scenes import scene

from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.status import Status

pytestmark = pytest.mark.slow

CLAIM_NO_COLLISION = (Status.SOLVED, Status.MISSED, Status.UNSTABLE)
COUNT = int(os.environ.get("SCENES", "4"))
TOL = 1e-4 / 1.75
"""Depth that counts as a collision, over the trunk's length; 0.1 mm for the elephant."""


@pytest.mark.parametrize("number", range(COUNT))
def test_a_plan_collides_only_if_it_says_so(number):
    motion = scene(number)
    plan = plan_motion(motion, options=Options(max_iterations=60), throw=False)
    assert plan.status is not Status.UNVERIFIED
    if plan.status in CLAIM_NO_COLLISION:
        depth, where = deepest(plan)
        assert depth <= TOL * motion.trunk.length, where
        assert not plan.collisions
        assert (
            min(gap.bound - gap.least for gap in plan.clearance.all) >= -TOL * motion.trunk.length
        )
    if plan.status is Status.COLLIDING:
        assert plan.collisions
