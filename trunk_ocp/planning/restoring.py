"""A plan from the arrays and attributes of its file, which is untrusted.

Shapes, labels, types and sizes must fit the file's own problem. Whether the numbers solve it is not
taken from the file: `Plan.status` checks it again.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from pydantic import ValidationError

from .._support.netcdf import Contents
from .._support.provenance import fingerprint
from .._support.toml_files import check_json
from ..errors import InputError
from ..model.anatomy import AnatomySpec
from ..problem.build import build_motion
from ..problem.motion import Motion
from ..problem.problem_file import MAX_STEPS, ProblemSpec
from ..problem.weights import Weights
from ..rod.arguments import check_mesh
from ..rod.collocation import Mesh
from ..rod.equations import STATES
from ..rod.rod_batch import shape_of_states
from .plan import MODES, Plan, planned_loads
from .records import (
    check_auxiliary,
    count,
    entries,
    fits,
    gaps_of,
    json_of,
    number,
    solve_of,
    table,
    words,
)

MAX_NODES = 800
"""Of a mesh, elements times degree; its stability takes matrices of three rows for each node."""
MAX_FAULTS = 20  # of a problem; of more only their number is reported, as each takes memory
Section = TypeVar("Section", ProblemSpec, AnatomySpec)


RECORDS = ("gaps", "notes", "solves", "versions", "options")


def restored(contents: Contents) -> Plan:
    """The plan that a file contains.

    Raises
    ------
    InputError, LookupError, ValueError
        If it has no valid plan.
    """
    attributes, arrays = contents.attributes, contents.arrays
    planned = len(arrays["head"])
    if planned > MAX_STEPS:
        raise InputError(f"it has {planned} time steps; expected at most {MAX_STEPS}")
    states = _numbers(contents, "state", planned, None, None, STATES)
    edges = _numbers(contents, "edge", states.shape[1] + 1)
    mesh = Mesh(tuple(edges.tolist()), states.shape[2] - 1)
    check_mesh_size(mesh)
    motion = _motion(attributes)
    muscles = motion.trunk.muscles
    if planned > len(motion.steps) or (muscles and contents.texts("muscle") != muscles):
        raise InputError("its time steps or muscles are not those of its problem")
    x = _controls(contents, "", planned, len(muscles))
    auxiliary = _auxiliary(contents, motion, x)
    tip_forces = _numbers(contents, "tip_force", planned, 3)
    loads = planned_loads(motion, tip_forces)
    check_mesh(mesh, motion.trunk, loads)
    mode, lookahead = attributes["plan_mode"], count(attributes["lookahead"], 1)
    if mode not in MODES or (mode == "sequential" and lookahead != 1):
        raise InputError("plan_mode, lookahead: expected those of a plan")
    return Plan(
        motion=motion,
        x=x,
        tip_forces=tip_forces,
        shape=shape_of_states(motion.trunk, mesh, x, loads, states),
        mode=mode,
        lookahead=lookahead,
        auxiliary=auxiliary,
        gaps=gaps_of(json_of(words(attributes.get("gaps_json", "[]"))), motion),
        **_record(attributes),
    )


def check_mesh_size(mesh: Mesh) -> None:
    """Raise InputError if a mesh is too large for a saved plan."""
    if not (mesh.degree >= 1 and mesh.elements * mesh.degree <= MAX_NODES):
        raise InputError(
            f"its mesh has {mesh.elements} elements of degree {mesh.degree}; expected at most "
            f"{MAX_NODES} nodes"
        )


def check_texts(texts: Sequence[str]) -> None:
    """Raise InputError if the JSON of a problem or an anatomy is too long."""
    for name, text in zip(("problem", "anatomy"), texts, strict=True):
        try:
            check_json(text)
        except InputError as error:
            raise InputError(f"its {name} {error}") from None


def _motion(attributes: dict[str, Any]) -> Motion:
    texts = [words(attributes[f"{name}_json"]) for name in ("problem", "anatomy")]
    check_texts(texts)
    spec, anatomy = _valid(ProblemSpec, texts[0]), _valid(AnatomySpec, texts[1])
    for name, text in zip(("problem", "anatomy"), texts, strict=True):
        # Not that of `spec`, which may have keys that are newer than the file.
        if attributes[f"{name}_sha256"] != fingerprint(json.loads(text)):
            raise InputError(f"its {name} was changed after the plan was made")
    return build_motion(spec, anatomy)


def _valid(model: type[Section], text: str) -> Section:
    """A problem or an anatomy; InputError with the first fault."""
    try:
        return model.model_validate_json(text)
    except ValidationError as error:
        count = error.error_count()
        faults = f"{count:,} faults"
        if count <= MAX_FAULTS:
            fault = error.errors(include_url=False, include_input=False, include_context=False)[0]
            where = ".".join(str(part) for part in fault["loc"][:10])
            faults = f"{where}: {fault['msg']}" + (f", and {faults} in all" if count > 1 else "")
        raise InputError(f"it has no valid {model.__name__[:-4].lower()} ({faults})") from None


def _auxiliary(contents: Contents, motion: Motion, x: np.ndarray) -> dict[int, np.ndarray]:
    """Auxiliary solutions by their step."""
    if "near_step" not in contents.arrays:
        return {}
    steps = contents.arrays["near_step"]
    if steps.ndim != 1 or steps.dtype.kind != "i":
        raise InputError("near_step: expected numbers of time steps")
    numbers = [step - 1 for step in steps.tolist()]
    if len({*numbers}) != len(numbers) or not {*numbers} <= {*range(len(x))}:
        raise InputError("near_step: expected numbers of planned time steps")
    rows = _controls(contents, "near_", len(numbers), len(motion.trunk.muscles))
    auxiliary = dict(zip(numbers, rows, strict=True))
    # A horizon that was stopped before its first window is the sequential plan that it starts from.
    stopped = contents.attributes["interrupted"] or contents.attributes.get("late", 0)
    if contents.attributes["plan_mode"] != "sequential" and not stopped:
        raise InputError("near_step: expected auxiliary solutions of a sequential plan only")
    if contents.attributes["converged"]:
        check_auxiliary(motion, auxiliary)
    return auxiliary


def _record(attributes: dict[str, Any]) -> dict[str, Any]:
    """Fields of a plan on how it was made."""
    texts = [words(attributes.get(f"{name}_json", "")) for name in RECORDS]
    if not fits(*texts):
        raise InputError("its records are too large; expected those of one plan")
    listed = {name: json_of(words(attributes[f"{name}_json"])) for name in ("notes", "solves")}
    named = {
        name: table(json_of(words(attributes.get(f"{name}_json", "{}"))))
        for name in ("versions", "options")
    }
    return {
        "weights": _weights(attributes),
        "converged": bool(count(attributes["converged"])),
        "interrupted": bool(count(attributes["interrupted"])),
        "late": bool(count(attributes.get("late", 0))),
        "iterations": count(attributes["iterations"]),
        "setup_seconds": number(attributes["seconds_setup"]),
        "solve_seconds": number(attributes["seconds_solve"]),
        "derivative_seconds": number(attributes["seconds_derivatives"]),
        "total_seconds": number(attributes["seconds_total"]),
        "notes": tuple(words(note) for note in entries(listed["notes"])),
        "solves": tuple(solve_of(record) for record in entries(listed["solves"])),
        "versions": {name: words(text) for name, text in named["versions"].items()},
        "options": named["options"],
    }


def _weights(attributes: dict[str, Any]) -> Weights:
    """Weights; those of muscles are a table in JSON, and files of 0.2 have none of the head."""
    effort = attributes["weight_effort"]
    return Weights(
        table(json_of(words(effort))) if isinstance(effort, str) else number(effort),
        number(attributes["weight_rate"]),
        number(attributes.get("weight_head_effort", 0.0)),
    )


def _controls(contents: Contents, prefix: str, rows: int, muscles: int) -> np.ndarray:
    """Activations and head angles (rows, muscles + 2)."""
    activation = np.zeros((rows, 0))
    if muscles:  # an array of length 0 is left out of the file
        activation = _numbers(contents, f"{prefix}activation", rows, muscles)
    return np.hstack([activation, _numbers(contents, f"{prefix}head", rows, 2)])


def _numbers(contents: Contents, name: str, *shape: int | None) -> np.ndarray:
    """An array of real numbers of a shape, in which None stands for any length."""
    values = contents.arrays[name]
    fits = values.ndim == len(shape) and all(
        n in (None, size) for n, size in zip(shape, values.shape, strict=True)
    )
    if not fits or values.dtype.kind != "f":
        raise InputError(f"{name}: expected numbers of shape {shape}, got {values.shape}")
    return np.asarray(values, dtype=float)
