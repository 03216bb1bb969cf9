"""Plans on disk: labelled, complete, readable by people and programs.

A folder holds `summary.json` (how good the plan is), `activations.csv` (for a spreadsheet)
and `solution.nc` (everything, labelled; opens in xarray, MATLAB, R). The last alone restores
the plan: problem and anatomy are inside.
"""

from __future__ import annotations

import csv
import io
import json
import math
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from .anatomy import AnatomySpec
from .collocation import Mesh
from .deferred_signals import deferred_interrupts
from .diagnosis import Diagnosis
from .errors import InputError
from .files import replacing, write
from .motion import build_motion
from .problem_file import ProblemSpec
from .provenance import fingerprint
from .reading import read_bytes
from .rod import STATES
from .solution import Plan, Status, loads_of
from .solver import Solve
from .statics import check_mesh, shape_of_states
from .threads import one_thread
from .transcription import Weights

POINTS = 101
LARGEST_FILE = 1_000_000_000
"""Bytes; ten times a plan of as many steps as a motion may have."""
MODES = ("sequential", "horizon", "receding")
UNITS = {
    "time": "s",
    "seconds": "s of wall time",
    "position_error, max_position_error, max_verification_error": "m",
    "position_error_at, tangent_error_at": "Z of the target, m",
    "tangent_error": "length of the error of a director, the tangent d3 as a rule",
    "stability_margin": "share of the stiffness that the loads leave; 0: the trunk buckles",
    "falling_directions": "ways the trunk would leave the shape by itself; 0: stable",
    "psi_z, psi_y": "rad",
    "objective": "J of eq. (42) with the problem's weights",
}
"""Of the numbers in `summary`."""


@deferred_interrupts()
@one_thread()
def save_plan(plan: Plan, folder: str | Path) -> None:
    """Write a plan to a folder, which is made if need be; each file whole or not at all.

    Raises
    ------
    InputError
        If the plan has no time steps, or a file cannot be written there.
    """
    if not len(plan.x):
        raise InputError(f"{plan.motion.name}: the plan has no time steps; nothing to save.")
    folder = Path(folder)
    # All of them first, so that a plan that cannot be told leaves the files of the one before.
    report, labelled = json.dumps(summary(plan), indent=2) + "\n", dataset(plan)
    write(folder / "activations.csv", _activations(plan))
    with replacing(folder / "solution.nc") as path:
        labelled.to_netcdf(path, engine="scipy")
    write(folder / "summary.json", report)


def save_diagnosis(diagnosis: Diagnosis, folder: str | Path) -> None:
    """Write a diagnosis beside the plan it is of."""
    text = json.dumps(finite(diagnosis.as_json()), indent=2)
    write(Path(folder) / "diagnosis.json", text + "\n")


def load_plan(folder: str | Path, throw: bool = True) -> Plan:
    """Read a plan that `save_plan` wrote.

    throw : False to get a plan that is not solved as well: look at its `status`.

    Raises
    ------
    PlanError
        If the plan is not solved; the error has the plan.
    InputError
        If the folder has no readable solution.nc.
    """
    path = Path(folder) / "solution.nc"
    try:
        content = read_bytes(path, LARGEST_FILE)
        plan = _restore(xr.load_dataset(io.BytesIO(content), engine="scipy"))
    except Exception as error:  # a damaged file breaks its readers in ways of their own
        raise InputError(
            f"{path}: cannot be read as a plan ({error}); expected a file written by solve-motion."
        ) from None
    return plan.checked() if throw else plan


def _restore(data: xr.Dataset) -> Plan:
    """The plan that `dataset` turned into labelled arrays.

    The file may claim anything: shapes and labels must fit its problem. Whether its numbers
    solve it is no claim of the file; `Plan.status` finds out.
    """
    attributes = data.attrs
    motion = build_motion(
        ProblemSpec.model_validate_json(attributes["problem_json"]),
        AnatomySpec.model_validate_json(attributes["anatomy_json"]),
    )
    for name, part in (("problem", motion.spec), ("anatomy", motion.anatomy)):
        if attributes[f"{name}_sha256"] != fingerprint(part):
            raise InputError(f"its {name} was changed after the plan was made")
    muscles = motion.trunk.muscles
    planned = data.sizes["time"]
    if planned > len(motion.steps) or (muscles and tuple(data["muscle"].values) != muscles):
        raise InputError("its time steps or muscles are not those of its problem")
    x = _unknowns(data, "", planned, len(muscles))
    states = _numbers(data, "state", planned, None, None, STATES)
    edges = _numbers(data, "edge", states.shape[1] + 1)
    mesh = Mesh(tuple(edges.tolist()), states.shape[2] - 1)
    near: dict[int, np.ndarray] = {}
    if "near_step" in data:
        numbers = (data["near_step"].values - 1).tolist()
        if not set(numbers) <= set(range(planned)):
            raise InputError("near_step: expected numbers of planned time steps")
        rows = _unknowns(data, "near_", len(numbers), len(muscles))
        near = dict(zip(map(int, numbers), rows, strict=True))
    tip_forces = _numbers(data, "tip_force", planned, 3)
    loads = loads_of(motion, tip_forces)
    check_mesh(mesh, motion.trunk, loads)
    notes = json.loads(attributes["notes_json"])
    if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise InputError("notes_json: expected a list of sentences")
    if attributes["plan_mode"] not in MODES or not attributes["lookahead"] >= 1:
        raise InputError("plan_mode, lookahead: expected those of a plan")
    return Plan(
        motion=motion,
        x=x,
        tip_forces=tip_forces,
        shape=shape_of_states(motion.trunk, mesh, x, loads, states),
        mode=str(attributes["plan_mode"]),
        lookahead=int(attributes["lookahead"]),
        weights=Weights(float(attributes["weight_effort"]), float(attributes["weight_rate"])),
        near=near,
        converged=bool(attributes["converged"]),
        interrupted=bool(attributes["interrupted"]),
        late=bool(attributes.get("late", 0)),
        iterations=int(attributes["iterations"]),
        setup_seconds=float(attributes["seconds_setup"]),
        solve_seconds=float(attributes["seconds_solve"]),
        derivative_seconds=float(attributes["seconds_derivatives"]),
        total_seconds=float(attributes["seconds_total"]),
        notes=tuple(notes),
        solves=tuple(Solve.restored(record) for record in json.loads(attributes["solves_json"])),
        versions=json.loads(attributes.get("versions_json", "{}")),
        options=json.loads(attributes.get("options_json", "{}")),
    )


def _unknowns(data: xr.Dataset, prefix: str, rows: int, muscles: int) -> np.ndarray:
    """Activations and head angles (rows, muscles + 2)."""
    activation = np.zeros((rows, 0))
    if muscles:  # an array of length 0 is left out of the file
        activation = _numbers(data, f"{prefix}activation", rows, muscles)
    return np.hstack([activation, _numbers(data, f"{prefix}head", rows, 2)])


def _numbers(data: xr.Dataset, name: str, *shape: int | None) -> np.ndarray:
    """An array of real numbers of a shape, of which None fits any length."""
    values = data[name].values
    fits = values.ndim == len(shape) and all(
        n in (None, size) for n, size in zip(shape, values.shape, strict=True)
    )
    if not fits or values.dtype.kind != "f":
        raise InputError(f"{name}: expected numbers of shape {shape}, got {values.shape}")
    return np.asarray(values, dtype=float)


def summary(plan: Plan) -> dict[str, Any]:
    """The plan in numbers, ready for JSON; what is not finite becomes null."""
    report = {
        "problem": plan.motion.name,
        "mode": plan.mode,
        "lookahead": plan.lookahead,
        "status": plan.status.name.lower(),
        "message": plan.status.value,
        "verified": plan.verified,
        "faults": plan.verification.faults,
        "missed": plan.missed,
        "notes": list(plan.notes),
        "iterations": plan.iterations,
        "seconds": {
            "setup": round(plan.setup_seconds, 4),
            "solve": round(plan.solve_seconds, 4),
            "derivatives": round(plan.derivative_seconds, 4),
            "total": round(plan.total_seconds, 4),
        },
        "objective": plan.objective.paper,
        "planner_objective": {
            "total": plan.objective.total,
            "tracking": plan.objective.tracking,
            "effort": plan.objective.effort,
            "rate": plan.objective.rate,
        },
        "max_position_error": max(
            (float(e.position.max()) for e in plan.errors if e.position.size), default=math.nan
        ),
        "max_verification_error": float(plan.verification.position_difference.max(initial=0.0)),
        "timesteps": _timesteps(plan),
        "steps_planned": len(plan.x),
        "units": UNITS,
        "version": version("trunk_ocp"),
        "versions": plan.versions,
        "options": plan.options,
        "problem_sha256": fingerprint(plan.motion.spec),
        "anatomy_sha256": fingerprint(plan.motion.anatomy),
    }
    numbers: dict[str, Any] = finite(report)
    return numbers


def _timesteps(plan: Plan) -> list[dict[str, Any]]:
    """What `summary` says of each time step."""
    stability = plan.stability
    rows = zip(plan.motion.steps, plan.errors, plan.x, strict=False)
    return [
        {
            "time": step.time,
            "phase": plan.motion.phases[step.phase].name,
            "objective": errors.paper,
            "position_error": errors.position.tolist(),
            "position_error_at": errors.position_Z.tolist(),
            "tangent_error": errors.direction.tolist(),
            "tangent_error_at": errors.direction_Z.tolist(),
            "stability_margin": float(stability.margin[t]),
            "falling_directions": int(stability.index[t]),
            "psi_z": float(x[-2]),
            "psi_y": float(x[-1]),
        }
        for t, (step, errors, x) in enumerate(rows)
    ]


def finite(value: Any) -> Any:
    """The same with null in place of numbers that JSON does not have."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def dataset(plan: Plan) -> xr.Dataset:
    """The whole plan as labelled arrays."""
    Z = np.linspace(0.0, plan.motion.trunk.length, POINTS)
    data = xr.Dataset(_arrays(plan, Z), _coordinates(plan, Z), _attributes(plan))
    if plan.near:
        near = np.stack(list(plan.near.values()))
        data["near_step"] = ("near_number", np.array(list(plan.near)) + 1)
        data["near_activation"] = (("near_number", "muscle"), near[:, :-2])
        data["near_head"] = (("near_number", "angle"), near[:, -2:])
    # The format reads a dimension of length 0 as unlimited: leave such arrays out.
    return data.drop_vars([name for name, array in data.variables.items() if not array.size])


def _arrays(plan: Plan, Z: np.ndarray) -> dict[str, Any]:
    """Arrays with their dimensions, units and meanings."""
    loads = plan.loads
    return {
        "activation": (
            ("time", "muscle"),
            plan.activations,
            {"long_name": "negative contracts"},
        ),
        "head": (("time", "angle"), plan.head, {"units": "rad"}),
        "tip_force": (
            ("time", "axis"),
            plan.tip_forces,
            {"units": "N", "long_name": "on the tip, pulls included"},
        ),
        "contact_force": (("time", "axis"), [x.contact_force for x in loads], {"units": "N"}),
        "contact_couple": (
            ("time", "axis"),
            [x.contact_couple for x in loads],
            {"units": "N m"},
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
    """What is not an array: the problem itself, and how the plan was made."""
    motion = plan.motion
    return {
        "title": motion.spec.title or motion.name,
        "problem_json": motion.spec.model_dump_json(),
        "anatomy_json": motion.anatomy.model_dump_json(),
        "notes_json": json.dumps(plan.notes),
        "solves_json": json.dumps([asdict(solve) for solve in plan.solves]),
        "status": plan.status.name.lower(),
        "plan_mode": plan.mode,
        "lookahead": plan.lookahead,
        "weight_effort": plan.weights.effort,
        "weight_rate": plan.weights.rate,
        "converged": int(plan.converged),
        "interrupted": int(plan.interrupted),
        "late": int(plan.late),
        "iterations": plan.iterations,
        "seconds_setup": plan.setup_seconds,
        "seconds_solve": plan.solve_seconds,
        "seconds_derivatives": plan.derivative_seconds,
        "seconds_total": plan.total_seconds,
        "versions_json": json.dumps(plan.versions),
        "options_json": json.dumps(plan.options),
        "problem_sha256": fingerprint(motion.spec),
        "anatomy_sha256": fingerprint(motion.anatomy),
        "source": f"trunk_ocp {version('trunk_ocp')}",
    }


def _activations(plan: Plan) -> str:
    """A table in CSV: one row for each time step, the passive start included.

    A plan that is not solved says so at the end of every row, for no one to take it for one.
    """
    motion, text = plan.motion, io.StringIO(newline="")
    mark = [] if plan.status is Status.SOLVED else [plan.status.name.lower()]
    head = ["time_s", "phase", *motion.trunk.muscles, "psi_z_rad", "psi_y_rad"]
    writer = csv.writer(text)
    writer.writerow([*head, *(["status"] if mark else [])])
    writer.writerow([0.0, "rest", *np.zeros(plan.x.shape[1]), *mark])
    for step, x in zip(motion.steps, plan.x, strict=False):
        phase = motion.phases[step.phase].name
        numbers = (f"{value:.9g}" for value in x)
        writer.writerow([f"{step.time:.9g}", phase, *numbers, *mark])
    return text.getvalue()
