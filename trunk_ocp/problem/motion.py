"""The data of a motion: time steps with targets, loads and bounds (section 5, appendix B)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from .._support.arguments import check_arguments
from .._support.outputs import Displayed
from ..errors import InputError
from ..model.anatomy import AnatomySpec, Trunk
from ..model.loads import Loads, Vector
from ..model.solid_specs import CONTACT_KINDS
from ..model.solids import Solid
from .edits import loaded_spec, retargeted_spec, weighted_spec
from .problem_file import ProblemSpec
from .start import start_of, start_spec
from .targets import HeldDirection, Target
from .variants import contact_spec, limited_spec, shifted_spec, valid_spec
from .weights import Weights

HEAD_LIMIT = math.pi / 2
"""Bound on head angles, in rad, where the problem file has none."""

REFERENCE_LENGTH = 1.75
"""Length in m of the trunk for which 1 m of position error weighs as much as 1 of a direction's.

The elephant's. Position errors of other trunks are compared in proportion to their length, so that
a motion and its scale model have the same optimum."""

LENGTH_OVER_RADIUS = 12.0
"""Of a log of which only the radius is given; lift-log's own ratio."""

POSITION_TOLERANCE = 0.02
"""Default tolerance in m of positions, for a trunk of `REFERENCE_LENGTH`."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Lower and upper bounds on the controls x = (activations, psi_Z, psi_Y) of a step."""

    lower: np.ndarray
    upper: np.ndarray

    @property
    def limited(self) -> np.ndarray:
        """Indices of the controls that have a finite bound."""
        return np.flatnonzero(np.isfinite(self.lower) | np.isfinite(self.upper))


@dataclass(frozen=True)
class Auxiliary:
    """How far the loaded optimum may be from the unloaded one (appendix B.1-B.2); inf: free."""

    activation_deviation: float
    head_deviation: float

    @property
    def binds(self) -> bool:
        """Whether the unloaded optimum is more than an initial guess."""
        return math.isfinite(self.activation_deviation) or math.isfinite(self.head_deviation)


@dataclass(frozen=True)
class Log:
    """The log at one time step: a cylinder whose axis is e_Y (eqs. 46-54).

    It is there in phases that wrap around it or carry its weight. Before its weight is taken, its
    length, offset and mass come from the phase that carries a log of the same radius.

    Attributes
    ----------
    center : (3,) or None
        Middle of the cylinder in m; None if the phase has no wrap, which alone gives a place.
    radius : float
        In m.
    length : float or None
        In m; None if no phase carries the log, so that the problem file does not give it.
    offset : float
        From the middle to the grip, along e_Y, in m (eq. 54).
    mass : float or None
        In kg; None where `length` is.
    contact_from : float or None
        Z_w in m, from which on the trunk carries the log; None if it does not carry it yet.
    """

    center: Vector | None
    radius: float
    length: float | None
    offset: float
    mass: float | None
    contact_from: float | None


@dataclass(frozen=True, eq=False)
class Step:
    """One time step T: its time, targets, loads and bounds.

    Attributes
    ----------
    time, duration : float
        End of the step, and time since the step before, in s.
    phase : int
        Index of its phase, from 0.
    pull : (float, HeldDirection) or None
        Force in N along a held direction, in addition to `loads`.
    box : Bounds
        On the controls.
    change : Bounds
        On the change of the controls from the step before.
    log : Log or None
        The log that the trunk wraps around or carries.
    solids : tuple of Solid
        What the trunk may run into: parts of the head, the log where it has a place, obstacles.
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
    log: Log | None = None
    solids: tuple[Solid, ...] = ()

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
class Motion(Displayed):
    """A motion to plan. Time step 0 is its `start`, under the trunk's weight alone.

    `spec` and `anatomy` define it; all else is built from them. So every variant edits the spec
    and builds it again, and can be saved and read back as the same motion.

    Attributes
    ----------
    box : Bounds
        Bounds of the whole motion, which phases narrow.
    start : (muscles + 2,)
        Activations and head angles (rad) of time step 0; zeros, which is rest, by default.
    builder : callable
        `build_motion`, which builds the variants.
    warnings : tuple of str
        What looks like a mistake in the files: legal, and planned, but worth a look.
    """

    spec: ProblemSpec
    anatomy: AnatomySpec
    trunk: Trunk
    phases: tuple[Phase, ...]
    steps: tuple[Step, ...]
    extension: tuple[float, float]
    box: Bounds
    start: np.ndarray
    builder: Callable[[ProblemSpec, AnatomySpec, Trunk | None], Motion]
    warnings: tuple[str, ...] = ()
    build: ClassVar[Callable[..., Motion]]  # `made_motion` of `build`, which is above this module

    def __repr__(self) -> str:
        return f"<Motion {self.name}: {len(self.steps)} steps of {self.trunk!r}>"

    @property
    def name(self) -> str:
        """Name of the motion, as in its file."""
        return self.spec.name

    @property
    def gravity(self) -> float:
        """Gravitational acceleration along +e_Z in m/s^2, at the start and at the first step."""
        return self.steps[0].loads.gravity

    @property
    def weights(self) -> Weights:
        """Weights of the costs beside tracking."""
        section = self.spec.weights
        return Weights(section.effort, section.rate, section.head_effort)

    @property
    def tolerance(self) -> tuple[float, float]:
        """Largest errors, in m and of a director, with which a target counts as reached."""
        position, direction = self.spec.tolerance.position, self.spec.tolerance.direction
        default = POSITION_TOLERANCE / self.position_scale
        return default if position is None else position, direction

    @property
    def position_scale(self) -> float:
        """Factor of a position error in the objective: `REFERENCE_LENGTH` over the trunk's."""
        return REFERENCE_LENGTH / self.trunk.length

    @property
    def contact(self) -> frozenset[str]:
        """What the plan keeps out of: some of "self", "head", "log", "obstacles"."""
        return frozenset(kind for kind in CONTACT_KINDS if getattr(self.spec.contact, kind))

    def with_spec(self, spec: ProblemSpec) -> Motion:
        """The motion of another spec with the same anatomy; warnings are kept.

        Raises
        ------
        InputError
            If no problem file could have the spec, or if it does not fit the anatomy.
        """
        return self._of(valid_spec(spec, "spec"))

    def _of(self, spec: ProblemSpec) -> Motion:
        """The motion of another spec, which is valid."""
        motion = self.builder(spec, self.anatomy, self.trunk)
        return replace(motion, warnings=self.warnings)

    @check_arguments
    def shifted(self, offset: Vector) -> Motion:
        """The same motion with every target position moved by `offset` (3,) in m.

        Targets in the head's frame, such as those at the mouth, move by it in that frame.

        Raises
        ------
        InputError
            If the offset is not three finite numbers.
        """
        return self._of(shifted_spec(self.spec, offset))

    @check_arguments
    def retarget(
        self, phase: str | int | None = None, Z: float | None = None, **keys: Any
    ) -> Motion:
        """The same motion with other targets of the same kinds, which a `Replanner` accepts.

        `motion.retarget("reach", 1.75, position=(0.5, 0.1, 1.2), d3=(0, 0, 1))`

        Parameters
        ----------
        phase : str or int, optional
            Name of the phase, or its number from 1; may be left out if there is only one.
        Z : float, optional
            Point of the trunk in m that the target is for; may be left out if the phase has only
            one target, or a wrap instead.
        **keys
            New values, by their keys in a problem file: `position`, `path` or `through`, `d1`,
            `d2`, `d3` and their weights; of a wrap `center`, `path` or `through`, `angles_deg`,
            `position_weights`, `d3_weights`.

        Raises
        ------
        InputError
            If there is no such target, it has no position or direction of this kind, or no problem
            file could have the values.
        """
        return self._of(retargeted_spec(self.spec, phase, Z, keys))

    @check_arguments
    def with_loads(
        self, phase: str | int | None = None, gravity: float | None = None, **keys: Any
    ) -> Motion:
        """The same motion with other loads.

        `motion.with_loads("carry", tip_mass=5.0)`, or `motion.with_loads(log={"density": 900.0})`

        Parameters
        ----------
        phase : str or int, optional
            Name of the phase, or its number from 1; by default all phases.
        gravity : float, optional
            In m/s^2, of the whole motion.
        **keys
            New values, by their keys in a problem file: `tip_force`, `tip_mass`, `contact_force`,
            ... Those of `log`, `pull` and `jump` are dicts, which change the phases that have one.

        Raises
        ------
        InputError
            If there is no such phase or key, or no problem file could have the values.
        """
        return self._of(loaded_spec(self.spec, phase, gravity, keys))

    @check_arguments
    def weighted(
        self,
        effort: float | Mapping[str, float] | None = None,
        rate: float | None = None,
        head_effort: float | None = None,
        terminal: float | None = None,
        symmetric: bool | None = None,
    ) -> Motion:
        """The same motion with other weights of the costs beside tracking; None: as it is.

        Parameters
        ----------
        effort, rate, head_effort
            See `Weights`.
        terminal : float
            Factor of the weights of all targets of the last time step.
        symmetric : bool
            Whether both sides contract alike and psi_Z is 0.

        Raises
        ------
        InputError
            If no problem file could have them, a pattern matches no muscle, or a motion that is not
            its own mirror image shall be planned alike on both sides.
        """
        weights = {
            "effort": effort,
            "rate": rate,
            "head_effort": head_effort,
            "terminal": terminal,
            "symmetric": symmetric,
        }
        given = {key: value for key, value in weights.items() if value is not None}
        return self._of(weighted_spec(self.spec, given))

    @check_arguments
    def limited(self, activation: float | None = None, rate: float | None = None) -> Motion:
        """The same motion with weaker or slower muscles; its own narrower bounds stay.

        Parameters
        ----------
        activation : float, optional
            Largest |gamma| of any muscle.
        rate : float, optional
            Largest |change of gamma| in 1/s, averaged over each time step, the one from the
            start to step 1 included. A rate, not a change, because time steps differ in length. The
            interpolation within a step may be faster for a while, `cosine` by pi / 2.

        Raises
        ------
        InputError
            If a limit is not positive, or leaves a muscle no activation that is allowed.
        """
        for name, value in (("activation", activation), ("rate", rate)):
            if value is not None and not value > 0:
                raise InputError(f"{name} = {value:g}: expected a limit above 0.")
        largest = math.inf if activation is None else activation
        for box in (self.box, *(step.box for step in self.steps)):
            self._check_limit(box, largest)
        fastest = math.inf if rate is None else rate
        return self._of(limited_spec(self.spec, largest, fastest))

    @check_arguments
    def started(self, x0: np.ndarray) -> Motion:
        """The same motion, started from activations and head angles instead of rest.

        Its `start` has the same activations to the last bit. Head angles, which a spec has in
        degrees, may differ in it.

        Parameters
        ----------
        x0 : (muscles + 2,)
            Activations, then psi_Z and psi_Y in rad, as in a row of `Plan.x`. They may be outside
            the bounds of the motion, which count from step 1 on.

        Raises
        ------
        InputError
            For a wrong shape, values that are not finite, or activations that collapse a segment.
        """
        section = start_spec(x0, self.trunk)
        index = {name: np.array([i]) for i, name in enumerate(self.trunk.muscles)}
        start = start_of(section, self.trunk, index)
        # All else is built from other sections. A control loop cannot wait until it is built again.
        return replace(self, spec=self.spec.model_copy(update={"start": section}), start=start)

    @check_arguments
    def with_contact(self, kinds: str) -> Motion:
        """The same motion whose plan keeps out of solids.

        Parameters
        ----------
        kinds : str
            "all", "none", or some of "self", "head", "log" and "obstacles", separated by commas.

        Raises
        ------
        InputError
            If it is none of these.
        """
        return self._of(contact_spec(self.spec, kinds))

    def _check_limit(self, box: Bounds, activation: float) -> None:
        """Raise InputError if |gamma| <= activation leaves a muscle nothing of its bounds."""
        excluded = np.maximum(box.lower, -box.upper)[:-2] > activation
        for i in np.flatnonzero(excluded).tolist():
            raise InputError(
                f"activation = {activation:g}: {self.trunk.muscles[i]} must be between "
                f"{box.lower[i]:g} and {box.upper[i]:g} in this motion; expected a limit that "
                "overlaps with these bounds."
            )

    @cached_property
    def held(self) -> tuple[HeldDirection, ...]:
        """Every direction that some step takes from an earlier one."""
        held = {step.pull[1] for step in self.steps if step.pull is not None}
        for step in self.steps:
            for target in step.targets:
                held |= {d for _, d, _ in target.pairs() if isinstance(d, HeldDirection)}
        return tuple(sorted(held, key=lambda d: (d.step, d.Z, d.director)))

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
    """Bounds on a step's controls, around an auxiliary solution `near` if there is one.

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
    near = np.clip(near, lower, upper)  # Ipopt relaxes bounds by 1e-8 of their size
    return Bounds(np.maximum(lower, near - reach), np.minimum(upper, near + reach))
