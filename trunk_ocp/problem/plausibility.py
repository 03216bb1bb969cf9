"""Plausibility warnings: likely mistakes of unit or sign in a problem or an anatomy.

They are no errors: every value is legal and will be planned. The thresholds are far from the values
of living trunks, of soft arms and of the shipped motions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from .._support.wording import rounded
from ..model.anatomy import AnatomySpec, Trunk
from ..model.loads import Vector, mass_beyond
from ..model.overlaps import overlapping
from .bound_plausibility import of_changes, of_start
from .bound_specs import LimitsSpec
from .load_specs import LoadsSpec
from .motion import Motion, Step
from .problem_file import MAX_STEPS, PhaseSpec
from .solid_plausibility import of_mouth, of_obstacles
from .target_specs import TargetSpec, WrapSpec
from .targets import Target, bezier, way_points

MAX_WARNINGS = 20
LONGEST_TRUNK = 30.0  # m
LIGHTEST_TISSUE = 25.0  # kg/m^3; water is 1 in g/cm^3, foams begin here
LARGEST_SAG = 0.5  # density g L / E: strain of the base under the trunk's own weight
POINTED = 0.01  # of the radius at the base, below which a tip is nearly a point
STRONGEST = 10.0  # |activation|; at most 3.5 in the paper
CUBIC_POINTS = 4  # control points of a cubic; a path with more may be meant as way points
LARGEST_LOAD = 100.0  # times E I / L^2, which bends the trunk to about its own length
LONGEST_PHASE = 300.0  # s
SMALLEST_ANGLE = 0.3  # degrees; smaller bounds look like radians
OFF_STEP = 1e-4  # share of a step by which a way point may be off it

Finding = tuple[str, object, str]
"""Key, value, and a text on what it looks like and what to write."""


def plausibility_warnings(motion: Motion, problem: Path, anatomy: Path) -> tuple[str, ...]:
    """Warnings on a motion and its anatomy, a sentence each with file, key and value."""
    warnings = [
        f"{file}: {key} = {_show(value)}: {text}."
        for file, findings in (
            (anatomy, _of_anatomy(motion.anatomy, motion.gravity)),
            (anatomy, _of_muscles(motion.trunk)),
            (anatomy, of_mouth(motion.trunk)),
            (problem, _of_problem(motion)),
            (problem, of_obstacles(motion.spec.obstacles, motion.trunk)),
        )
        for key, value, text in findings
    ]
    more = len(warnings) - MAX_WARNINGS
    return tuple(warnings[:MAX_WARNINGS] + ([f"{problem}: and {more} more."] if more > 0 else []))


def _show(value: object) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_show, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


# --- the trunk ---------------------------------------------------------------------------


def _of_anatomy(spec: AnatomySpec, gravity: float) -> Iterator[Finding]:
    material, head = spec.material, spec.head
    if spec.length > LONGEST_TRUNK:
        yield "length", spec.length, f"looks like {_smaller(spec.length, LONGEST_TRUNK)}"
    if head.pivot_radius > 10 * spec.length:
        hint = _smaller(head.pivot_radius, spec.length)
        yield "head.pivot_radius", head.pivot_radius, f"looks like {hint}"
    if spec.base_radius_over_length > 1:
        text = "the trunk is thicker than it is long; radii are fractions of its length"
        yield "base_radius_over_length", spec.base_radius_over_length, text
    if 0 < material.density < LIGHTEST_TISSUE:
        yield "material.density", material.density, _grams(material.density)
    sag = material.density * abs(gravity) * spec.length / material.youngs_modulus
    if sag > LARGEST_SAG:
        E, unit = material.youngs_modulus, "MPa" if sag > 1e3 * LARGEST_SAG else "kPa"
        yield (
            "material.youngs_modulus",
            E,
            f"weight alone would strain the trunk by {sag:.2g}; it looks like {unit}, "
            f"write {E * (1e6 if unit == 'MPa' else 1e3):g} for Pa",
        )
    tip = spec.base_radius_over_length - math.tan(math.radians(spec.taper_deg))
    if tip < POINTED * spec.base_radius_over_length:
        text = f"leaves a tip of radius {rounded(tip * spec.length)} m, nearly a point, which bends"
        yield "taper_deg", spec.taper_deg, f"{text} without limit; write a smaller taper_deg"
    if 0 < spec.taper_deg < 0.15:
        yield "taper_deg", spec.taper_deg, _radians((spec.taper_deg,))
    for name in ("xi_z_deg", "xi_y_deg", "xi_d_deg"):
        value = getattr(head, name)
        if 0 < abs(value) <= math.pi:
            yield f"head.{name}", value, _radians((value,))
    for number, segment in enumerate(spec.segments, 1):
        for muscle in segment.muscles:
            if 0 < abs(muscle.helix_deg) <= math.pi / 2:
                key = f"segments[{number}].{muscle.group}.helix_deg"
                yield key, muscle.helix_deg, _radians((muscle.helix_deg,))


def _of_muscles(trunk: Trunk) -> Iterator[Finding]:
    for one, two in overlapping(trunk):
        low, high = (end(one.radii[i], two.radii[i]) for i, end in enumerate((max, min)))
        yield (
            f"segments[{one.segment + 1}].muscles",
            f"{one.name} and {two.name}",
            f"they overlap, at radii from {low / trunk.length:.3g} to {high / trunk.length:.3g} of "
            "the length, where tissue would count twice; change their radii or sectors",
        )


def _smaller(value: float, most: float) -> str:
    """Likely units of a length that is too large, and what to write for m."""
    if value * 1e-2 > most:
        return f"mm; write {value * 1e-3:g} for m"
    return f"mm or cm; write {value * 1e-3:g} or {value * 1e-2:g} for m"


def _grams(density: float) -> str:
    return f"looks like g/cm^3; write {1000 * density:g} for kg/m^3"


def _radians(values: Iterable[float]) -> str:
    degrees = _show(tuple(round(math.degrees(v), 4) for v in values))
    return f"looks like radians; {degrees.strip('[]')} would be that in degrees"


# --- the motion --------------------------------------------------------------------------


def _of_problem(motion: Motion) -> Iterator[Finding]:
    spec = motion.spec
    if spec.gravity < 0:
        yield "gravity", spec.gravity, "pulls upwards; +Z points down, so weight is positive"
    if abs(spec.gravity) > 100:
        unit, factor = ("cm", 1e-2) if abs(spec.gravity) < 3000 else ("mm", 1e-3)
        text = f"looks like {unit}/s^2; write {factor * spec.gravity:g} for m/s^2"
        yield "gravity", spec.gravity, text
    yield from _limits(spec.bounds, "bounds")
    if spec.bounds.extension[0] > 5:
        text = "a fraction of the length at rest, such as [0.67, 1.35]; this looks like percent"
        yield "bounds.extension", spec.bounds.extension, text
    yield from _tolerances(motion.tolerance, motion.trunk.length)
    for number, phase in enumerate(spec.phases, 1):
        where = f"phases[{number}]"
        yield from _limits(phase.bounds, f"{where}.bounds")
        yield from _phase(phase, where, motion)
        yield from _jumps(phase.loads, spec.phases[number - 2] if number > 1 else None, where)
        steps = [step for step in motion.steps if step.phase == number - 1]
        before = [step for step in motion.steps if step.phase == number - 2]
        for n, target in enumerate(phase.targets):
            if target.through is not None:
                pair = (before[-1] if before else None, steps[-1].targets[n])
                key = f"{where}.targets[{n + 1}].through[1]"
                yield from _first_way_point(target, phase, *pair, key, motion.tolerance[0])
        yield from _targets(phase, where, steps, motion)
    yield from of_start(motion)
    yield from of_changes(motion)


def _limits(spec: LimitsSpec, where: str) -> Iterator[Finding]:
    pairs: Mapping[str, tuple[float, float]] = {
        f'{where}.muscles."{name}"': pair for name, pair in spec.muscles.items()
    }
    if spec.activation is not None:
        pairs = {f"{where}.activation": spec.activation, **pairs}
    for key, (low, high) in pairs.items():
        percent, only_lengthens = max(-low, high) > STRONGEST, low >= 0 < high
        unit = 100 if percent else 1
        least, most = (-high, -low) if only_lengthens else (low, high)
        text = f"negative contracts; write [{least / unit:g}, {most / unit + 0.0:g}]"
        if percent:
            text = (
                f"looks like percent; an activation is a fraction of a fiber's length, and {text}"
            )
            yield key, (low, high), text
        elif only_lengthens:
            yield key, (low, high), f"only lengthens; {text}"
    for name in ("head_z_deg", "head_y_deg"):
        angles = getattr(spec, name)
        if angles is not None and 0 < max(map(abs, angles)) <= math.pi / 2:
            yield f"{where}.{name}", angles, _radians(angles)


def _tolerances(tolerance: tuple[float, float], length: float) -> Iterator[Finding]:
    position, direction = tolerance
    if position >= length / 2:
        text = f"every point within {position:g} m counts as reached, but the trunk is {length:g} m"
        text = f"{text} long; it looks like mm, write {position / 1000:g} for m"
        yield "tolerance.position", position, text
    if direction >= 1:
        text = "a director off by 60 degrees counts as reached; write the length of its error"
        yield "tolerance.direction", direction, f"{text}, about {math.radians(direction):.2g}"


def _phase(phase: PhaseSpec, where: str, motion: Motion) -> Iterator[Finding]:
    if phase.duration > LONGEST_PHASE:
        text = f"looks like ms; write {phase.duration / 1000:g} for s"
        yield f"{where}.duration", phase.duration, text
    for number, change in enumerate(phase.change, 1):
        for name in ("head_z_deg", "head_y_deg"):
            angles = getattr(change, name)
            if angles is not None and 0 < max(map(abs, angles)) < SMALLEST_ANGLE:
                yield f"{where}.change[{number}].{name}", angles, _radians(angles)
    near = phase.auxiliary.head_deviation_deg if phase.auxiliary else None
    if near is not None and 0 < near < SMALLEST_ANGLE:
        yield f"{where}.auxiliary.head_deviation_deg", near, _radians((near,))
    wrap = phase.wrap
    if wrap is not None:
        if max(map(abs, wrap.angles_deg)) <= 2 * math.pi:
            yield f"{where}.wrap.angles_deg", wrap.angles_deg, _radians(wrap.angles_deg)
        if wrap.log_radius > motion.trunk.length:
            hint = _smaller(wrap.log_radius, motion.trunk.length / 4)
            yield f"{where}.wrap.log_radius", wrap.log_radius, f"looks like {hint}"
    yield from _loads(phase.loads, f"{where}.loads", motion)
    for number, target in enumerate(phase.targets, 1):
        yield from _curve(target, phase, f"{where}.targets[{number}]")
    if wrap is not None:
        yield from _curve(wrap, phase, f"{where}.wrap")


def _curve(place: TargetSpec | WrapSpec, phase: PhaseSpec, where: str) -> Iterator[Finding]:
    """Paths whose points look like way points, and way points that lie between time steps."""
    if place.path is not None and len(place.path) > CUBIC_POINTS:
        points = np.array(place.path)
        curve = np.array([bezier(place.path, t) for t in np.linspace(0, 1, 201)])
        away = np.linalg.norm(points[:, None] - curve, axis=-1).min(axis=1).max()
        if away > 0:
            yield (
                f"{where}.path",
                f"{len(points)} points",
                "these are Bezier control points, of which the curve meets only the first and the "
                f"last; it misses others by up to {rounded(away)} m; for way points write through "
                "= [...] in place of path",
            )
    if place.through is not None:
        times, _ = way_points(place.through, phase.duration, phase.steps)
        yield from _between_steps(times, phase, f"{where}.through")


def _first_way_point(
    spec: TargetSpec, phase: PhaseSpec, before: Step | None, last: Target, key: str, near: float
) -> Iterator[Finding]:
    """A way point at the phase's start, which is no step of this phase, that no target covers.

    `last` is the target at the phase's end, which is where the last way point is.
    """
    assert spec.through is not None
    assert last.position is not None
    times, points = way_points(spec.through, phase.duration, phase.steps)
    if times[0] > OFF_STEP * phase.duration / phase.steps:
        return
    place = np.asarray(last.position) + points[0] - points[-1]
    asked = before.targets if before else ()
    if any(
        (t.Z, t.frame) == (spec.Z, last.frame)
        and t.position is not None
        and math.dist(t.position, place) <= near
        for t in asked
    ):
        return
    start = "the end of the phase before" if before else "the start of the motion"
    text = f"is ignored: no time step of this phase is at {start}"
    yield key, spec.through[0], f"{text}; add a phase before that reaches it, or give a later time"


def _between_steps(times: np.ndarray, phase: PhaseSpec, key: str) -> Iterator[Finding]:
    """Way points, at times (n,) in s from the phase's start, that are at none of its steps."""
    number = times / phase.duration
    off = np.abs(number * phase.steps - np.round(number * phase.steps)) > OFF_STEP
    if not off.any():
        return
    counts = np.arange(1, MAX_STEPS + 1)[:, None]
    fits = np.all(np.abs(number * counts - np.round(number * counts)) <= OFF_STEP, axis=1)
    hint = f"steps = {np.argmax(fits) + 1} would put one at each" if fits.any() else "add steps"
    verb = "lies" if off.sum() == 1 else "lie"
    text = f"{off.sum()} of them {verb} between time steps; targets hold only at time steps"
    yield key, f"{len(times)} way points", f"{text}; {hint}"


def _loads(spec: LoadsSpec, where: str, motion: Motion) -> Iterator[Finding]:
    trunk = motion.trunk
    bends = trunk.youngs_modulus * math.pi / 4 * trunk.base_radius**4 / trunk.length**2
    most = LARGEST_LOAD * max(bends, float(mass_beyond(trunk, 0.0)) * abs(motion.gravity))
    text = "is more than a hundred times what bends the trunk double"
    for name in ("tip_force", "contact_force"):
        force = getattr(spec, name)
        if math.hypot(*force) > most:
            yield f"{where}.{name}", force, f"{text}; forces are in N"
    if spec.pull is not None and abs(spec.pull.force) > most:
        yield f"{where}.pull.force", spec.pull.force, f"{text}; forces are in N"
    if spec.tip_mass * abs(motion.gravity) > most:
        hint = f"it looks like g, write {spec.tip_mass / 1000:g} for kg"
        yield f"{where}.tip_mass", spec.tip_mass, f"{text}; {hint}"
    if spec.log is None:
        return
    for name in ("radius", "length"):
        size = getattr(spec.log, name)
        if size > 10 * trunk.length:
            hint = _smaller(size, trunk.length)
            yield f"{where}.log.{name}", size, f"looks like {hint}"
    if spec.log.density < LIGHTEST_TISSUE:
        yield f"{where}.log.density", spec.log.density, _grams(spec.log.density)


def _jumps(loads: LoadsSpec, before: PhaseSpec | None, where: str) -> Iterator[Finding]:
    """Loads that are to jump but are not there, before or after."""
    both = [loads, *([before.loads] if before else [])]
    there = {
        "tip_force": any(any(one.tip_force) for one in both),
        "tip_mass": any(one.tip_mass > 0 for one in both),
        "pull": any(one.pull is not None for one in both),
        "contact": any(
            one.log is not None or any((*one.contact_force, *one.contact_couple)) for one in both
        ),
    }
    for name, exists in there.items():
        stated = name in loads.jump.model_fields_set and getattr(loads.jump, name)
        if stated and not exists:
            phases = "this phase and the one before have" if before else "this phase has"
            text = f"{phases} no such load, so nothing jumps; add the load or remove this key"
            yield f"{where}.loads.jump.{name}", "true", text


def _targets(phase: PhaseSpec, where: str, steps: list[Step], motion: Motion) -> Iterator[Finding]:
    """Phases without a weight, and targets that no trunk of this length can reach."""
    counting = [
        t
        for step in steps
        for t in step.targets
        if (t.position is not None and t.position_weight > 0) or t.pairs()
    ]
    if not counting:
        yield where, phase.name, "every weight is 0, so the phase has no target"
    stretch, pivot = motion.extension[1], motion.trunk.head.pivot_radius
    for step in steps:
        for n, target in enumerate(step.targets):
            if target.position is None or target.position_weight == 0:
                continue
            away = math.hypot(*target.position)
            moves = 0.0 if target.frame == "head" else 2 * pivot  # of the base in that frame
            reach = target.Z * stretch + moves
            if away > reach + motion.tolerance[0]:
                yield _too_far(phase, n, target.source, target.position, reach)
                return


def _too_far(phase: PhaseSpec, n: int, key: str, position: Vector, reach: float) -> Finding:
    """Warning on target `n` (from 0) of a step, with the key and the value of the file."""
    place: TargetSpec | WrapSpec | None
    place = phase.targets[n] if n < len(phase.targets) else phase.wrap
    assert place is not None
    name, rows = ("path", place.path) if place.path else ("through", place.through)
    if not rows:
        word = "position" if isinstance(place, TargetSpec) else "center"
        return f"{key}.{word}", getattr(place, word), _unreachable(math.hypot(*position), reach)
    far = [math.hypot(*row[-3:]) for row in rows]
    k = int(np.argmax(far))
    # A curve may swing out between its points, and its origin may be elsewhere: then as computed.
    away = far[k] if place.origin == "base" and far[k] > reach else math.hypot(*position)
    return f"{key}.{name}[{k + 1}]", rows[k], _unreachable(away, reach)


def _unreachable(away: float, reach: float) -> str:
    far, near = rounded(away, 3), rounded(reach, 3)
    text = f"{far} m from the base at rest; this point reaches at most {near} m"
    for unit, factor in (("cm", 1e-2), ("mm", 1e-3)):
        if 0.1 * reach < factor * away <= reach:
            return f"{text}; it looks like {unit}, write {factor:g} times the value for m"
    return f"{text}, so it will be missed"
