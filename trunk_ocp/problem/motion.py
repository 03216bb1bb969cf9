"""What a motion is: time steps with targets, loads and bounds (section 5, appendix B)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from .._support.arguments import check_arguments
from .._support.toml_files import is_file, read_toml, shipped
from ..errors import InputError
from ..model.anatomy import AnatomySpec, Trunk, build_trunk, read_anatomy
from ..model.loads import Loads, Vector, vector
from .plausibility import suspicions
from .problem_file import ChangeSpec, LimitsSpec, LoadsSpec, PhaseSpec, ProblemSpec
from .targets import HeldDirection, Target, all_targets, check_earlier
from .variants import LONGEST_SHOWN, limited_spec, listed, named_muscles, shifted_spec

HEAD_LIMIT = math.pi / 2  # head angles without bounds of their own
REFERENCE_LENGTH = 1.75
"""Length in m of the trunk for which 1 m of position error weighs as much as 1 of a direction's.

The elephant's. Position errors of other trunks are compared in proportion to their length, so that
a motion and its scale model have the same optimum."""

TOLERANCE = 0.02  # m, of positions for the reference trunk; the default


@dataclass(frozen=True, eq=False)
class Bounds:
    """Lower and upper bounds on the unknowns x = (activations, psi_Z, psi_Y) of a step."""

    lower: np.ndarray
    upper: np.ndarray

    @property
    def limited(self) -> np.ndarray:
        """Indices of the unknowns that have a finite bound."""
        return np.flatnonzero(np.isfinite(self.lower) | np.isfinite(self.upper))


@dataclass(frozen=True)
class Auxiliary:
    """How far the loaded optimum may be from the unloaded one (appendix B.1-B.2); inf: free."""

    activation_deviation: float
    head_deviation: float

    @property
    def binds(self) -> bool:
        """Whether it is more than a first guess."""
        return math.isfinite(self.activation_deviation) or math.isfinite(self.head_deviation)


@dataclass(frozen=True, eq=False)
class Step:
    """One time step T: when, what is asked, what loads act, what is allowed.

    `pull` adds a force (N) along a held direction to the loads. `box` bounds the unknowns,
    `change` their difference from the step before.
    """

    time: float
    duration: float
    phase: int
    targets: tuple[Target, ...]
    loads: Loads
    pull: tuple[float, HeldDirection] | None
    box: Bounds
    change: Bounds
    auxiliary: Auxiliary | None

    @property
    def follows(self) -> bool:
        """Whether it may ask to stay near an auxiliary solution instead of the step before."""
        return self.auxiliary is not None and self.auxiliary.binds


@dataclass(frozen=True)
class Phase:
    """Name, end time (s) and interpolation of a phase."""

    name: str
    end: float
    interpolation: str


@dataclass(frozen=True, repr=False, eq=False)
class Motion:
    """A motion to plan. Time step 0 is the passive trunk: x = 0 under weight alone."""

    spec: ProblemSpec
    anatomy: AnatomySpec
    trunk: Trunk
    phases: tuple[Phase, ...]
    steps: tuple[Step, ...]
    extension: tuple[float, float]
    box: Bounds
    """Bounds of the whole motion, that phases narrow."""
    warnings: tuple[str, ...] = ()
    """What looks like a slip in the files: legal, and planned, but worth a look."""

    def __repr__(self) -> str:
        return f"<Motion {self.name}: {len(self.steps)} steps of {self.trunk!r}>"

    @property
    def name(self) -> str:
        """Name of the motion, as in its file."""
        return self.spec.name

    @property
    def gravity(self) -> float:
        """Gravitational acceleration along +e_Z in m/s^2, at rest and at the first step."""
        return self.steps[0].loads.gravity

    @property
    def tolerance(self) -> tuple[float, float]:
        """Largest errors, in m and of a director, with which a target counts as reached."""
        position, direction = self.spec.tolerance.position, self.spec.tolerance.direction
        return TOLERANCE / self.position_scale if position is None else position, direction

    @property
    def position_scale(self) -> float:
        """Factor of a position error in the objective: `REFERENCE_LENGTH` over the trunk's."""
        return REFERENCE_LENGTH / self.trunk.length

    @cached_property
    def _asks_what_its_spec_does(self) -> bool:
        return [step.targets for step in self.steps] == all_targets(self.spec, self.trunk)

    @check_arguments
    def shifted(self, offset: Vector) -> Motion:
        """The same motion with every target position moved by `offset` (3,) in m.

        Raises
        ------
        InputError
            If the offset is not three finite numbers.
        """
        spec = shifted_spec(self.spec, offset)

        def moved(target: Target) -> Target:
            if target.position is None:
                return target
            return replace(target, position=vector(np.add(target.position, offset)))

        targets = [tuple(moved(target) for target in step.targets) for step in self.steps]
        # To the last bit as it would be built, unless somebody has changed the built steps.
        if self._asks_what_its_spec_does:
            targets = all_targets(spec, self.trunk)
        steps = (replace(s, targets=t) for s, t in zip(self.steps, targets, strict=True))
        return replace(self, spec=spec, steps=tuple(steps))

    @check_arguments
    def limited(self, activation: float | None = None, rate: float | None = None) -> Motion:
        """The same motion with weaker or slower muscles; its own narrower bounds stay.

        Parameters
        ----------
        activation : float, optional
            Largest |gamma| of any muscle.
        rate : float, optional
            Largest |change of gamma| in 1/s, over each time step as a whole, the one from rest to
            step 1 included. A rate, not a change, for time steps differ in length. Interpolation
            in between may be faster for a while, `cosine` by pi / 2.

        Raises
        ------
        InputError
            If a limit is not positive, or leaves a muscle no activation that is allowed.
        """
        for name, value in (("activation", activation), ("rate", rate)):
            if value is not None and not value > 0:
                raise InputError(f"{name} = {value:g}: expected a limit above 0.")
        most = math.inf if activation is None else activation
        fastest = math.inf if rate is None else rate
        steps = tuple(
            replace(
                step,
                box=_narrowed(step.box, most, self.trunk),
                change=_narrowed(step.change, fastest * step.duration, self.trunk),
            )
            for step in self.steps
        )
        box = _narrowed(self.box, most, self.trunk)
        return replace(self, spec=limited_spec(self.spec, most, fastest), steps=steps, box=box)

    @cached_property
    def held(self) -> tuple[HeldDirection, ...]:
        """Every direction that some step takes from an earlier one."""
        wanted = {step.pull[1] for step in self.steps if step.pull is not None}
        for step in self.steps:
            for target in step.targets:
                wanted |= {d for _, d, _ in target.pairs() if isinstance(d, HeldDirection)}
        return tuple(sorted(wanted, key=lambda held: (held.step, held.Z, held.director)))

    @property
    def times(self) -> np.ndarray:
        """Times of steps 1, 2, ... in s."""
        return np.array([step.time for step in self.steps])

    @property
    def contact_from(self) -> float | None:
        """Start of contact Z_w in m, where any step has contact."""
        starts = (step.loads.contact_from for step in self.steps)
        return next((start for start in starts if start is not None), None)


def allowed(motion: Motion, step: Step, near: np.ndarray | None) -> Bounds:
    """Bounds on a step's unknowns, around an auxiliary solution `near` if there is one.

    Appendix B bounds the auxiliary problem by the step's own box; the main problem then has
    the motion's activation bounds, cut to the deviation from the auxiliary optimum.
    """
    if near is None or step.auxiliary is None:
        return step.box
    deviation, head = step.auxiliary.activation_deviation, step.auxiliary.head_deviation
    lower, upper = step.box.lower.copy(), step.box.upper.copy()
    if math.isfinite(deviation):
        lower[:-2], upper[:-2] = motion.box.lower[:-2], motion.box.upper[:-2]
    reach = np.append(np.full(near.size - 2, deviation), [head, head])
    near = np.clip(near, lower, upper)  # Ipopt may end a trifle beyond
    return Bounds(np.maximum(lower, near - reach), np.minimum(upper, near + reach))


def _narrowed(box: Bounds, most: float, trunk: Trunk) -> Bounds:
    """A box of unknowns with activations, or their changes, cut to -most ... most."""
    size = np.append(np.full(len(trunk.muscles), most), [np.inf, np.inf])
    lower, upper = np.maximum(box.lower, -size), np.minimum(box.upper, size)
    for i in np.flatnonzero(lower > upper).tolist():
        raise InputError(
            f"activation = {most:g}: {trunk.muscles[i]} must be between {box.lower[i]:g} and "
            f"{box.upper[i]:g} in this motion; expected a limit that leaves it some of that."
        )
    return Bounds(lower, upper)


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
    beside = path.parent / spec.anatomy
    beside = beside if is_file(beside) else Path(spec.anatomy)
    try:
        anatomy = read_anatomy(beside)
    except InputError as error:
        raise InputError(f"{path}:\n  anatomy: {error}") from None
    try:
        motion = build_motion(spec, anatomy)
    except InputError as error:
        raise InputError(f"{path}:\n  {error}") from None
    return replace(motion, warnings=suspicions(motion, path, beside))


def build_motion(spec: ProblemSpec, anatomy: AnatomySpec) -> Motion:
    """Turn a validated problem file and anatomy into a motion.

    Raises
    ------
    InputError
        For what only trunk and file together show: unknown muscles, points off the trunk,
        directions held from a step that is not earlier.
    """
    trunk = build_trunk(anatomy)
    targets = all_targets(spec, trunk)
    named = named_muscles(spec, trunk.muscles)
    whole = _box(trunk, spec.bounds, named, None, "bounds")
    steps: list[Step] = []
    phases: list[Phase] = []
    start = 0.0
    for number, phase in enumerate(spec.phases):
        where = f"phases[{number + 1}]"
        box = _box(trunk, phase.bounds, named, whole, f"{where}.bounds")
        for i in range(1, phase.steps + 1):
            first = len(steps)
            steps.append(
                Step(
                    time=start + phase.duration * i / phase.steps,
                    duration=phase.duration / phase.steps,
                    phase=number,
                    targets=targets[first],
                    loads=_loads(phase.loads, spec.gravity, trunk, where),
                    pull=_pull(phase.loads, i / phase.steps, trunk, first, where),
                    box=box,
                    change=_change(phase.change, i, len(trunk.muscles)),
                    auxiliary=_auxiliary(phase),
                )
            )
        start += phase.duration
        phases.append(Phase(phase.name, start, phase.interpolation))
    _one_contact(steps)
    return Motion(spec, anatomy, trunk, tuple(phases), tuple(steps), spec.bounds.extension, whole)


def _box(
    trunk: Trunk,
    spec: LimitsSpec,
    named: dict[str, np.ndarray],
    outer: Bounds | None,
    where: str,
) -> Bounds:
    """Bounds of a phase; what it leaves out is as in `outer`, the motion's."""
    count = len(trunk.muscles)
    if outer is None:
        lower = np.concatenate([np.zeros(count), [-HEAD_LIMIT, -HEAD_LIMIT]])
        upper = -lower
    else:
        lower, upper = outer.lower.copy(), outer.upper.copy()
    if spec.activation is not None:
        lower[:count], upper[:count] = spec.activation
    for pattern, pair in spec.muscles.items():
        matching = named[pattern]
        if not matching.size:
            raise InputError(
                f'{where}.muscles."{pattern[:LONGEST_SHOWN]}": no such muscle; expected a name or '
                f"pattern of {listed(trunk.muscles)}."
            )
        lower[matching], upper[matching] = pair
    for index, angles in ((count, spec.head_z_deg), (count + 1, spec.head_y_deg)):
        if angles is not None:
            lower[index], upper[index] = np.radians(angles)
    if outer is not None:
        lower, upper = np.maximum(lower, outer.lower), np.minimum(upper, outer.upper)
    for i in np.flatnonzero(lower > upper).tolist():
        name = (*trunk.muscles, "head_z_deg", "head_y_deg")[i]
        raise InputError(
            f"{where}: {name} may be nowhere; expected bounds that overlap with the motion's."
        )
    return Bounds(lower, upper)


def _change(specs: tuple[ChangeSpec, ...], i: int, count: int) -> Bounds:
    """Bounds on the change to step i of a phase; later entries override."""
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
    return Bounds(lower, upper)


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
    if spec.log is not None:
        log = spec.log
        weight = math.pi * log.radius**2 * log.length * log.density * gravity
        contact_from, force = log.contact_from, (0.0, 0.0, weight)
        couple = (-log.offset * weight, 0.0, 0.0)
    if contact_from is not None and not contact_from < trunk.length:
        raise InputError(
            f"{where}.loads: contact_from = {contact_from:g}: expected less than the trunk's "
            f"length, {trunk.length:g} m."
        )
    return Loads(gravity, vector(tip), contact_from, force, couple)


def _pull(
    spec: LoadsSpec, t: float, trunk: Trunk, step: int, where: str
) -> tuple[float, HeldDirection] | None:
    if spec.pull is None:
        return None
    pull = spec.pull
    check_earlier(pull.held_from_step, step, f"{where}.loads.pull.held_from_step")
    held = HeldDirection(pull.held_from_step - 1, trunk.length, int(pull.along[1]) - 1)
    return pull.force * (t if pull.ramp else 1.0), held


def _one_contact(steps: list[Step]) -> None:
    starts = {step.loads.contact_from for step in steps} - {None}
    if len(starts) > 1:
        raise InputError(
            f"phases: contact starts at {sorted(starts, key=str)} m in different phases; expected "
            "one place for the whole motion."
        )
