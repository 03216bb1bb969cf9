"""Saving and loading plans.

A folder has `summary.json` (quality of the plan), `activations.csv` (for a spreadsheet) and
`solution.nc` (labeled arrays with the problem and the anatomy; opens in xarray, MATLAB, R), from
which alone the plan is loaded.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from .._support.arguments import check_arguments
from .._support.atomic_files import replacing, write
from .._support.blas_threads import one_thread
from .._support.netcdf import read_netcdf
from .._support.provenance import fingerprint
from .._support.toml_files import printable, read_bytes
from ..contact.gaps import Gap
from ..errors import InputError
from ..problem.build import as_built
from .labeled import dataset
from .plan import Plan
from .restoring import check_mesh_size, check_texts, restored
from .results_folder import set_derived_aside
from .tables import activations_table

SOLUTION = "solution.nc"
MAX_FILE_SIZE = 100_000_000
"""Bytes; twice the size of a plan with the largest number of steps."""
MAX_REASON_LENGTH = 500  # characters in a message
MAX_PLANS_SHOWN = 5
UNITS = {
    "time": "s",
    "seconds": "s of wall time",
    "position_error, max_position_error, max_verification_error": "m",
    "position_error_at, tangent_error_at": "Z of the target, m",
    "tangent_error": "length of the error of a director, the tangent d3 as a rule",
    "stability_margin": "share of the stiffness that the loads leave; 0: the trunk buckles",
    "falling_directions": "ways the trunk would leave the shape by itself; 0: stable",
    "flutter_growth": "1/s, of vibrations under a couple fixed in space; null without a couple",
    "flutter_frequency": "Hz, of the vibration that grows fastest, or the lowest if none grows",
    "inertia_ratio": "moment of inertia forces about the base over that of the weight, largest "
    "on the way to the step; null where a phase has no interpolation",
    "inertia_time": "s, when the ratio is largest",
    "acceleration": "m/s^2, the largest on the way to the step",
    "natural_frequencies": "Hz, the lowest three, undamped",
    "psi_z, psi_y": "rad",
    "objective": "J of eq. (42) with the problem's weights",
}
"""Of the numbers in `summary`."""


@check_arguments
@one_thread()
def save_plan(plan: Plan, folder: str | Path) -> None:
    """Write a plan to a folder, which is created if needed; each file completely or not at all.

    It replaces an earlier plan. If that one was different, files made from it, such as figures and
    exports, move to `earlier/` in the folder.

    Raises
    ------
    InputError
        If the plan has no time steps, a file cannot be written, or the file would have another
        motion: the plan's is not what its spec and anatomy build.
    """
    _check_saving(plan)
    folder = Path(folder)
    # Make all contents first, so that an error leaves the files of the earlier plan alone.
    report, labeled = json.dumps(summary(plan), indent=2) + "\n", dataset(plan)
    table = activations_table(plan)
    set_derived_aside(folder, plan.motion, table)
    write(folder / "activations.csv", table)
    with replacing(folder / SOLUTION) as path:
        labeled.to_netcdf(path, engine="scipy")
    write(folder / "summary.json", report)


def _check_saving(plan: Plan) -> None:
    """Raise InputError for a plan that could not be read back as the same plan."""
    name = plan.motion.name
    if not len(plan.x):
        raise InputError(f"{name}: the plan has no time steps; nothing to save.")
    if not as_built(plan.motion):
        raise InputError(
            f"{name}: the motion was changed by hand after it was built from its spec and anatomy, "
            "so the file would have another motion than the planned one. Edit the motion's spec "
            "instead, and plan motion.with_spec(spec)."
        )
    try:
        check_mesh_size(plan.mesh)
        check_texts([part.model_dump_json() for part in (plan.motion.spec, plan.motion.anatomy)])
    except InputError as error:
        raise InputError(f"{name}: the plan cannot be saved; {error}.") from None


@check_arguments
def load_plan(folder: str | Path, throw: bool = True) -> Plan:
    """Read a plan that `save_plan` wrote, from its folder or from the solution.nc in it.

    Parameters
    ----------
    throw : bool
        False to return a plan that is not solved instead of raising; look at its `status`.

    Raises
    ------
    PlanError
        If the plan is not solved; the error has the plan.
    InputError
        If the folder has no readable solution.nc.
    """
    path = Path(folder)
    path = path if path.name == SOLUTION and not path.is_dir() else path / SOLUTION
    content = _content(path)
    try:
        with np.errstate(all="ignore"):  # absurd numbers end in the plan's status
            plan = restored(read_netcdf(content))
    except Exception as error:  # damaged files break readers in many ways
        reason = printable(f"{error}")
        reason = reason if len(reason) <= MAX_REASON_LENGTH else reason[:MAX_REASON_LENGTH] + "..."
        raise InputError(
            f"{path}: cannot be read as a plan ({reason}); expected a file written by solve-motion."
        ) from None
    return plan.checked() if throw else plan


def _content(path: Path) -> bytes:
    """Content of a solution.nc; InputError that names plans in subfolders, if there are any."""
    if not os.path.exists(path):  # of any name, unlike Path.exists
        plans: list[str] = []
        with contextlib.suppress(OSError, ValueError):
            plans = sorted(str(found.parent) for found in path.parent.glob(f"*/{SOLUTION}"))
        if plans:
            more = (
                f" or {len(plans) - MAX_PLANS_SHOWN} more" if len(plans) > MAX_PLANS_SHOWN else ""
            )
            raise InputError(
                f"{path.parent}: has a subfolder for each of its plans; expected "
                f"{printable(' or '.join(plans[:MAX_PLANS_SHOWN]))}{more}."
            )
        raise InputError(
            f"{path}: cannot be read as a plan (no such file); expected a file written by "
            "solve-motion."
        )
    return read_bytes(path, MAX_FILE_SIZE)


def summary(plan: Plan) -> dict[str, Any]:
    """Quality of a plan, ready for JSON; numbers that are not finite become null."""
    report = {
        "problem": plan.motion.name,
        "mode": plan.mode,
        "lookahead": plan.lookahead,
        "status": plan.check().name.lower(),
        "message": plan.check().value,
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
            "head_effort": plan.objective.head_effort,
        },
        "max_position_error": max(
            (float(e.position.max()) for e in plan.errors if e.position.size), default=math.nan
        ),
        "max_verification_error": float(plan.verification.position_difference.max(initial=0.0)),
        "clearance": _clearance(plan.clearance.min),
        "collisions": plan.clearance.warnings,
        "inertia_ratio": plan.inertia_ratio,
        "natural_frequencies": plan.natural_frequencies.tolist(),
        **_start(plan),
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


def _clearance(gap: Gap | None) -> dict[str, Any] | None:
    """A gap, for JSON."""
    if gap is None:
        return None
    return {
        "min": gap.gap,
        "bound": gap.bound,
        "with": gap.body,
        "step": gap.step + 1,
        "time": gap.time,
        "Z": gap.Z,
        "other_Z": gap.other,
    }


def _start(plan: Plan) -> dict[str, Any]:
    """The entry on where the motion starts; none for one that starts at rest."""
    *activation, psi_z, psi_y = plan.motion.start.tolist()
    if not np.any(plan.motion.start):
        return {}
    pairs = zip(plan.motion.trunk.muscles, activation, strict=True)
    active = {name: value for name, value in pairs if value}
    return {"start": {"activation": active, "psi_z": psi_z, "psi_y": psi_y}}


def _timesteps(plan: Plan) -> list[dict[str, Any]]:
    """Entries of `summary` for each time step."""
    stability, flutter, inertia = plan.stability, plan.flutter, plan.inertia
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
            "flutter_growth": float(flutter.growth[t]),
            "flutter_frequency": float(flutter.frequency[t]),
            "psi_z": float(x[-2]),
            "psi_y": float(x[-1]),
            "clearance": _clearance(plan.clearance.of_step(t)),
            "inertia_ratio": float(inertia.ratio[t]),
            "inertia_time": float(inertia.time[t]),
            "acceleration": float(inertia.acceleration[t]),
            "natural_frequencies": inertia.frequencies[t].tolist(),
        }
        for t, (step, errors, x) in enumerate(rows)
    ]


def finite(value: Any) -> Any:
    """The value with null in place of numbers that are not finite."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
