"""Building a motion from a problem file and an anatomy (section 5, appendix B)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from .._support.arguments import check_arguments
from .._support.toml_files import is_file, read_toml, shipped
from ..errors import InputError
from ..model.anatomy import AnatomySpec, Trunk, build_trunk, read_anatomy
from ..model.loads import Loads, Vector, vector
from .bound_specs import ChangeSpec, LimitsSpec
from .edits import built_spec
from .load_specs import LoadsSpec, LogSpec
from .mirror import asks_the_same, mirror_order
from .motion import HEAD_LIMIT, Auxiliary, Bounds, Log, Motion, Phase, Step
from .muscle_patterns import matching_muscles, muscles_of
from .plausibility import plausibility_warnings
from .problem_file import PhaseSpec, ProblemSpec
from .start import start_of
from .step_solids import check_obstacles, head_solids, log_solids, phase_obstacles
from .targets import HeldDirection, Target, earlier_step, origins_of, phase_targets, wrap_center
from .variants import mirrored_spec
from .weights import Weights

ROUNDING = 1e-11  # relative, and absolute in SI units


def problems_folder() -> Path:
    """Folder of the shipped problem files: inside the installed package, or beside it."""
    package = Path(__file__).parent.parent
    inside = package / "problems"
    return inside if inside.is_dir() else package.parent / "problems"


@check_arguments
def load_motion(name_or_path: str | Path) -> Motion:
    """Read a motion: a shipped name ("pick-fruit") or a path to a problem file.

    Raises
    ------
    InputError
        If it is neither, or if the file is faulty; names file, key, value, expectation.
    """
    path = shipped(str(name_or_path), problems_folder())
    spec = read_toml(path, ProblemSpec)
    local = path.parent / spec.anatomy
    anatomy_path = local if is_file(local) else Path(spec.anatomy)
    try:
        anatomy = read_anatomy(anatomy_path)
    except InputError as error:
        raise InputError(f"{path}:\n  anatomy: {error}") from None
    try:
        motion = build_motion(spec, anatomy)
    except InputError as error:
        raise InputError(f"{path}:\n  {error}") from None
    return replace(motion, warnings=plausibility_warnings(motion, path, anatomy_path))


@check_arguments
def made_motion(
    name: str,
    phases: Iterable[Mapping[str, Any]],
    anatomy: str | Path = "asian-elephant",
    **sections: Any,
) -> Motion:
    """A motion from Python values, which are checked as those of a problem file.

    `Motion.build("reach", [{"duration": 1.0, "targets": [{"Z": 1.75, "position": [0.5, 0, 1]}]}])`

    Parameters
    ----------
    phases : sequence of dict
        With the keys of `[[phases]]`; names may be left out.
    anatomy : str or Path
        A shipped name, or the path of an anatomy file.
    **sections
        Other sections and keys of a problem file: `bounds`, `gravity`, `weights`, `obstacles`, ...
        By default activations are from -2 to 0 and extensions from 0.67 to 1.35.

    Raises
    ------
    InputError
        With the messages of `load_motion`.
    """
    spec = built_spec(name, str(anatomy), phases, sections)
    motion = build_motion(spec, read_anatomy(anatomy))
    return replace(motion, warnings=plausibility_warnings(motion, Path(name), Path(anatomy)))


Motion.build = staticmethod(made_motion)


def build_motion(spec: ProblemSpec, anatomy: AnatomySpec, trunk: Trunk | None = None) -> Motion:
    """Turn a validated problem file and anatomy into a motion.

    Fast, because a control loop does it at every tick: what is the same at all steps of a phase is
    built once. `trunk` is that of the anatomy, if there is one already.

    Raises
    ------
    InputError
        For faults that only show in the two together: unknown muscles, points off the trunk,
        directions held from a step that is not earlier, two solids of one name, a start that
        collapses a segment; if both sides shall contract alike in a motion that is not its own
        mirror image.
    """
    trunk = trunk or build_trunk(anatomy)
    motion = _built(spec, anatomy, trunk)
    if spec.weights.symmetric:
        mirror_order(trunk)  # raises if a muscle has no partner
        image = _built(mirrored_spec(spec, trunk.muscles), anatomy, trunk)
        if not asks_the_same(motion, image):
            raise InputError(
                "weights.symmetric = true: the motion is not its own mirror image; expected "
                "targets and loads in the plane Y = 0, and equal bounds and weights on both sides."
            )
    return motion


def _built(spec: ProblemSpec, anatomy: AnatomySpec, trunk: Trunk) -> Motion:
    """The motion of a spec; see `build_motion`."""
    check_obstacles(spec.obstacles, trunk)
    origins = origins_of(spec, trunk)
    matches = matching_muscles(spec, trunk.muscles)
    box = _box(trunk, spec.bounds, matches, None, "bounds", spec.weights.symmetric)
    steps: list[Step] = []
    with_targets: list[int] = []  # numbers of steps, from 0, as files count them
    phases: list[Phase] = []
    began = 0.0
    head = head_solids(trunk)
    before, loads_before = LoadsSpec(), Loads(spec.gravity)
    for number, phase in enumerate(spec.phases):
        where = f"phases[{number + 1}]"
        phase_box = _box(trunk, phase.bounds, matches, box, f"{where}.bounds")
        phase_loads = _loads(phase.loads, spec.gravity, trunk, where)
        obstacles = phase_obstacles(spec, phase)
        parts = phase.free_steps + 1
        for part in range(1, phase.steps * parts + 1):
            free = part % parts != 0
            i = part / parts if free else part // parts  # in time steps with targets
            log = _log(spec, phase, i, origins)
            targets = () if free else phase_targets(phase, i, trunk, origins, with_targets, where)
            loads = phase_loads
            if i < 1:
                loads = _ramped(loads_before, phase_loads, before, phase.loads, i)
            steps.append(
                Step(
                    time=began + phase.duration * i / phase.steps,
                    duration=phase.duration / (phase.steps * parts),
                    phase=number,
                    targets=targets,
                    loads=loads,
                    pull=_pull(phase.loads, i / phase.steps, trunk, with_targets, where),
                    box=phase_box,
                    change=_change(phase.change, math.ceil(i), len(trunk.subdomains), parts),
                    auxiliary=None if free else _auxiliary(phase),
                    log=log,
                    solids=(*head, *log_solids(log), *obstacles),
                )
            )
            with_targets += [] if free else [len(steps) - 1]
        began += phase.duration
        before, loads_before = phase.loads, phase_loads
        smooth = parts > 1 and phase.interpolation == "cosine"  # else it would stop at every step
        phases.append(Phase(phase.name, began, "hermite" if smooth else phase.interpolation))
    steps[-1] = replace(steps[-1], targets=_terminal(steps[-1].targets, spec.weights.terminal))
    _check_contact(steps)
    Weights(spec.weights.effort).of_muscles(trunk.muscles)  # raises if a muscle is unknown
    return Motion(
        spec,
        anatomy,
        trunk,
        tuple(phases),
        tuple(steps),
        spec.bounds.extension,
        box,
        start_of(spec.start, trunk, matches),
        build_motion,
    )


def as_built(motion: Motion) -> bool:
    """Whether a motion is what its spec and anatomy build once they are read back from a file.

    It is not if it was changed by hand after it was built, or if its spec was edited into one that
    no problem file can have.
    """
    try:
        spec = ProblemSpec.model_validate_json(motion.spec.model_dump_json())
        anatomy = AnatomySpec.model_validate_json(motion.anatomy.model_dump_json())
        built = build_motion(spec, anatomy)
    except (InputError, ValidationError):
        return False
    names = ("spec", "anatomy", "trunk", "phases", "steps", "extension", "box", "start")
    return all(_equal(getattr(motion, name), getattr(built, name)) for name in names)


def _equal(a: object, b: object) -> bool:
    """Equality of dataclasses and tuples that contain arrays, to the rounding of another processor.

    Positions measured from the passive tip are results of linear algebra, whose last digits differ.
    """
    if isinstance(a, np.ndarray | float):
        return isinstance(b, np.ndarray | float) and np.allclose(a, b, ROUNDING, ROUNDING)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_equal, a, b))
    if is_dataclass(a) and type(a) is type(b):
        return all(_equal(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return a == b


def _box(
    trunk: Trunk,
    spec: LimitsSpec,
    matches: dict[str, np.ndarray],
    outer: Bounds | None,
    where: str,
    symmetric: bool = False,
) -> Bounds:
    """Bounds of a phase; what it leaves out is as in `outer`, the motion's.

    Symmetric: psi_Z is 0, in all phases because they narrow the motion's bounds.
    """
    count = len(trunk.muscles)
    if outer is None:
        lower = np.concatenate([np.zeros(count), [-HEAD_LIMIT, -HEAD_LIMIT]])
        upper = -lower
    else:
        lower, upper = outer.lower.copy(), outer.upper.copy()
    if spec.activation is not None:
        lower[:count], upper[:count] = spec.activation
    for pattern, pair in spec.muscles.items():
        matching = muscles_of(pattern, matches, trunk.muscles, f"{where}.muscles")
        lower[matching], upper[matching] = pair
    for index, angles in ((count, spec.head_z_deg), (count + 1, spec.head_y_deg)):
        if angles is not None:
            lower[index], upper[index] = np.radians(angles)
    if symmetric:
        lower[count], upper[count] = max(lower[count], 0.0), min(upper[count], 0.0)
    if outer is not None:
        lower, upper = np.maximum(lower, outer.lower), np.minimum(upper, outer.upper)
    for i in np.flatnonzero(lower > upper).tolist():
        name = (*trunk.muscles, "head_z_deg", "head_y_deg")[i]
        raise InputError(
            f"{where}: {name} has no value left; expected bounds that overlap with the motion's."
        )
    return Bounds(lower, upper)


def _terminal(targets: tuple[Target, ...], factor: float) -> tuple[Target, ...]:
    """Targets of the last step, with their weights times a factor."""
    if factor == 1:
        return targets
    return tuple(
        replace(
            target,
            position_weight=factor * target.position_weight,
            direction_weights=vector(factor * np.asarray(target.direction_weights)),
        )
        for target in targets
    )


def _change(specs: tuple[ChangeSpec, ...], i: int, count: int, parts: int) -> Bounds:
    """Bounds on the change to step i of a phase, or to a part of it; later entries override."""
    upper = np.full(count + 2, np.inf)
    lower = -upper
    for spec in specs:
        if spec.steps is not None and not spec.steps[0] <= i <= spec.steps[1]:
            continue
        if spec.activation is not None:
            lower[:count], upper[:count] = -spec.activation, spec.activation
        for index, pair in ((count, spec.head_z_deg), (count + 1, spec.head_y_deg)):
            if pair is not None:
                lower[index], upper[index] = np.radians(pair)
    return Bounds(lower / parts, upper / parts)


def _auxiliary(phase: PhaseSpec) -> Auxiliary | None:
    spec = phase.auxiliary
    if spec is None:
        return None
    activation, head = spec.activation_deviation, spec.head_deviation_deg
    return Auxiliary(
        math.inf if activation is None else activation,
        math.inf if head is None else math.radians(head),
    )


def _loads(spec: LoadsSpec, gravity: float, trunk: Trunk, where: str) -> Loads:
    """Loads of a phase; a log's weight and couple follow from its size (eq. 54)."""
    tip = np.asarray(spec.tip_force) + np.array([0.0, 0, spec.tip_mass * gravity])
    contact_from, force, couple = spec.contact_from, spec.contact_force, spec.contact_couple
    lever = 0.0
    if spec.log is not None:
        log, weight = spec.log, _mass(spec.log) * gravity
        contact_from, force = log.contact_from, (0.0, 0.0, weight)
        if log.hung:
            lever = 0.0 - log.offset  # by eq. (54), where d2 is e_Y
        else:
            couple = (-log.offset * weight, 0.0, 0.0)
    if contact_from is not None and not contact_from < trunk.length:
        raise InputError(
            f"{where}.loads: contact_from = {contact_from:g}: expected less than the trunk's "
            f"length, {trunk.length:g} m."
        )
    return Loads(gravity, vector(tip), contact_from, force, couple, lever)


def _ramped(
    before: Loads, loads: Loads, spec_before: LoadsSpec, spec: LoadsSpec, share: float
) -> Loads:
    """Loads on the way to the first time step of a phase, as interpolation has them.

    `share` is how far on the way, below 1. Loads that jump have the values of the phase.
    """
    weight, jump = (1 - math.cos(math.pi * share)) / 2, spec.jump

    def blend(one: Vector, other: Vector, jumps: bool) -> np.ndarray:
        return (
            np.asarray(other) if jumps else (1 - weight) * np.array(one) + weight * np.array(other)
        )

    force = blend(spec_before.tip_force, spec.tip_force, jump.tip_force)
    masses = [
        vector(np.subtract(load.tip_force, part.tip_force))
        for load, part in ((before, spec_before), (loads, spec))
    ]
    contact_from, lever = loads.contact_from, loads.contact_lever
    if contact_from is None and not jump.contact:
        contact_from, lever = before.contact_from, before.contact_lever
    return replace(
        loads,
        tip_force=vector(force + blend(masses[0], masses[1], jump.tip_mass)),
        contact_from=contact_from,
        contact_lever=lever,
        contact_force=vector(blend(before.contact_force, loads.contact_force, jump.contact)),
        contact_couple=vector(blend(before.contact_couple, loads.contact_couple, jump.contact)),
    )


def _mass(log: LogSpec) -> float:
    """Mass of a log in kg."""
    return math.pi * log.radius**2 * log.length * log.density


def _log(
    spec: ProblemSpec, phase: PhaseSpec, i: float, origins: dict[str, np.ndarray]
) -> Log | None:
    """The log at step i of a phase; see `Log`."""
    wrap, carried = phase.wrap, phase.loads.log
    if wrap is not None:
        logs = (p.loads.log for p in spec.phases if p.loads.log is not None)
        same = next((log for log in logs if log.radius == wrap.log_radius), None)
        log, radius = carried or same, wrap.log_radius
    elif carried is not None:
        log, radius = carried, carried.radius
    else:
        return None
    center, offset = wrap_center(phase, i, origins), log.offset if log else 0.0
    if center is not None:
        # By eq. (54) the weight W turns by -offset W about e_X, as a weight at y = -offset does.
        center = (center[0], center[1] - offset, center[2])
    return Log(
        center,
        radius,
        log.length if log else None,
        offset,
        _mass(log) if log else None,
        carried.contact_from if carried else None,
    )


def _pull(
    spec: LoadsSpec, t: float, trunk: Trunk, earlier: Sequence[int], where: str
) -> tuple[float, HeldDirection] | None:
    if spec.pull is None:
        return None
    pull = spec.pull
    step = earlier_step(pull.held_from_step, earlier, f"{where}.loads.pull.held_from_step")
    held = HeldDirection(step, trunk.length, int(pull.along[1]) - 1)
    return pull.force * (t if pull.ramp else 1.0), held


def _check_contact(steps: list[Step]) -> None:
    """Raise InputError unless all contact starts at the same place, and acts on one lever."""
    starts = {step.loads.contact_from for step in steps} - {None}
    if len(starts) > 1:
        raise InputError(
            f"phases: contact starts at {sorted(starts, key=str)} m in different phases; expected "
            "one place for the whole motion."
        )
    levers = {step.loads.contact_lever for step in steps if step.loads.contact_from is not None}
    if len(levers) > 1:
        raise InputError(
            f"phases: the contact force acts on levers of {sorted(levers)} m in different phases; "
            "expected one log offset for the whole motion, hung in all phases or in none."
        )
