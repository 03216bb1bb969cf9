"""A whole plan as labeled arrays: what `solution.nc` holds and `plan.to_xarray()` returns."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import numpy as np
import xarray as xr

from .._support.provenance import fingerprint
from .plan import Plan
from .records import gaps_record, solves_json

POINTS = 101
"""Along the trunk, in what is labeled by Z."""


def dataset(plan: Plan) -> xr.Dataset:
    """The whole plan as labeled arrays."""
    Z = np.linspace(0.0, plan.motion.trunk.length, POINTS)
    data = xr.Dataset(_arrays(plan, Z), _coordinates(plan, Z), _attributes(plan))
    if plan.auxiliary:
        near = np.stack(list(plan.auxiliary.values()))
        data["near_step"] = ("near_number", np.array(list(plan.auxiliary)) + 1)
        data["near_activation"] = (("near_number", "muscle"), near[:, :-2])
        data["near_head"] = (("near_number", "angle"), near[:, -2:])
    # The format reads a dimension of length 0 as unlimited: leave such arrays out.
    return data.drop_vars([name for name, array in data.variables.items() if not array.size])


def _arrays(plan: Plan, Z: np.ndarray) -> dict[str, Any]:
    """Arrays with their dimensions, units and meanings."""
    loads = plan.loads
    return {
        "activation": (("time", "muscle"), plan.activations, {"long_name": "negative contracts"}),
        "head": (("time", "angle"), plan.head, {"units": "rad"}),
        "tip_force": (
            ("time", "axis"),
            plan.tip_forces,
            {"units": "N", "long_name": "on the tip, pulls included"},
        ),
        "contact_force": (("time", "axis"), [x.contact_force for x in loads], {"units": "N"}),
        "contact_couple": (("time", "axis"), [x.contact_couple for x in loads], {"units": "N m"}),
        **(
            {"contact_lever": ("time", [x.contact_lever for x in loads], {"units": "m"})}
            if any(x.contact_lever for x in loads)
            else {}
        ),
        "position": (
            ("time", "Z", "axis"),
            plan.shape.position(Z),
            {"units": "m", "long_name": "centerline; X forwards, Y to the right, Z down"},
        ),
        "directors": (
            ("time", "Z", "director", "axis"),
            plan.shape.directors(Z),
            {"long_name": "unit vectors: d1 dorsal, d2 right, d3 along the trunk"},
        ),
        "moment": (
            ("time", "Z", "director"),
            plan.shape.moment(Z),
            {"units": "N m", "long_name": "internal moment in the directors"},
        ),
        "edge": (("edge_number",), np.asarray(plan.mesh.edges), {"units": "m"}),
        "state": (
            ("time", "element", "node", "component"),
            plan.shape.states,
            {"long_name": "collocation states: quaternion, then moment in N m"},
        ),
    }


def _coordinates(plan: Plan, Z: np.ndarray) -> dict[str, Any]:
    """Labels of the dimensions."""
    motion = plan.motion
    return {
        "time": ("time", motion.times[: len(plan.x)], {"units": "s"}),
        "muscle": list(motion.trunk.muscles),
        "angle": ["psi_z", "psi_y"],
        "axis": ["X", "Y", "Z"],
        "director": ["d1", "d2", "d3"],
        "Z": ("Z", Z, {"units": "m"}),
    }


def _attributes(plan: Plan) -> dict[str, Any]:
    """Attributes: the problem and the anatomy, and how the plan was made."""
    motion, effort = plan.motion, plan.weights.effort
    records = (plan.notes, plan.versions, plan.options, gaps_record(plan.gaps))
    others = [json.dumps(part) for part in records]
    return {
        "title": motion.spec.title or motion.name,
        "problem_json": motion.spec.model_dump_json(),
        "anatomy_json": motion.anatomy.model_dump_json(),
        "gaps_json": others[3],
        "notes_json": others[0],
        "solves_json": solves_json(plan.solves, *others),
        "status": plan.check().name.lower(),
        "plan_mode": plan.mode,
        "lookahead": plan.lookahead,
        "weight_effort": json.dumps(effort) if isinstance(effort, Mapping) else effort,
        "weight_rate": plan.weights.rate,
        "weight_head_effort": plan.weights.head_effort,
        "converged": int(plan.converged),
        "interrupted": int(plan.interrupted),
        "late": int(plan.late),
        "iterations": plan.iterations,
        "seconds_setup": plan.setup_seconds,
        "seconds_solve": plan.solve_seconds,
        "seconds_derivatives": plan.derivative_seconds,
        "seconds_total": plan.total_seconds,
        "versions_json": others[1],
        "options_json": others[2],
        "problem_sha256": fingerprint(motion.spec),
        "anatomy_sha256": fingerprint(motion.anatomy),
        "source": f"trunk_ocp {version('trunk_ocp')}",
    }
