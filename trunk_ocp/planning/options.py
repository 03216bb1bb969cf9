"""Options of the planner, and what follows from them: the mode and the first mesh."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral

from .._support.arguments import check_fields
from .._support.ranges import check
from ..errors import InputError
from ..problem.motion import Motion
from ..problem.weights import Weights
from ..rod.collocation import Mesh, mesh_for

GAUSS_POINTS = 24
"""Of the first mesh; with fewer, the shipped motions come close to the limits of the check."""
REFINEMENTS = 2
"""How often elements are halved where the independent check finds the mesh too coarse."""
TOO_COARSE = "The mesh was too coarse; planning again with {} elements."


@dataclass(frozen=True)
class Options:
    """Options of the planner; the defaults solve every shipped motion.

    Attributes
    ----------
    weights : Weights, optional
        Weights of the costs beside tracking; by default those of the motion.
    elements, degree : int
        Mesh of the transcription, see `mesh_for`; refined if a plan's check asks for it. The
        degree is 6 by default, less (3 at least) where many segments bring many elements.
    linear_solver : str
        Of Ipopt: mumps comes with CasADi, ma27 ... ma97 and spral need installing.
    max_iterations : int
        Of Ipopt, for each solve.
    starts : int
        Least number of starts of a window of several steps; the best solution is kept.
        The first is the sequential plan, the second the passive trunk, further ones are
        random. If the best misses a target, the passive trunk is tried in any case.
    """

    weights: Weights | None = None
    elements: int = 3
    degree: int | None = None
    linear_solver: str = "mumps"
    max_iterations: int = 1000
    starts: int = 1

    def __post_init__(self) -> None:
        check_fields(self)
        for name in ("elements", "degree", "max_iterations", "starts"):
            if (value := getattr(self, name)) is not None:
                check(value, name)
                object.__setattr__(self, name, int(value))  # as JSON takes it, not of NumPy
        if not self.linear_solver:
            raise InputError("linear_solver = '': expected a name, such as mumps.")

    def weights_for(self, motion: Motion) -> Weights:
        """Weights of the costs beside tracking, of a plan of this motion."""
        return motion.weights if self.weights is None else self.weights


def mode_of(motion: Motion, lookahead: int | None) -> tuple[str, int]:
    """Name of the mode that a lookahead gives, and the lookahead as a number of time steps.

    Raises
    ------
    InputError
        If the lookahead is not a whole number of at least 1.
    """
    count = len(motion.steps)
    if lookahead is not None and not (isinstance(lookahead, Integral) and lookahead >= 1):
        raise InputError(f"lookahead = {lookahead}: expected a whole number of at least 1.")
    mode = "horizon" if lookahead is None or lookahead >= count else "receding"
    return "sequential" if lookahead == 1 else mode, int(min(lookahead or count, count))


def is_deferred(check: str) -> bool:
    """Whether a plan's check waits: of "now" and "later", whether it is the latter.

    Raises
    ------
    InputError
        If it is neither.
    """
    if check not in ("now", "later"):
        raise InputError(f"check = {check!r}: expected 'now' or 'later'.")
    return check == "later"


def first_mesh(motion: Motion, options: Options) -> Mesh:
    """The first mesh: about `GAUSS_POINTS` along the trunk, of a degree from 3 to 6."""
    coarse = mesh_for(motion.trunk, motion.contact_from, options.elements)
    degree = options.degree or min(max(GAUSS_POINTS // coarse.elements, 3), 6)
    return Mesh(coarse.edges, degree)


def finer_mesh(motion: Motion, mesh: Mesh) -> Mesh:
    """A mesh of the same degree with about half as long elements."""
    return mesh_for(motion.trunk, motion.contact_from, 2 * mesh.elements, mesh.degree)
