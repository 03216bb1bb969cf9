"""Check files: inputs and expected outputs that an export must reproduce.

Expected shapes come from `solve_statics`, an independent formulation on a finer mesh; expected
derivatives from CasADi's differentiation of the collocation equations.
"""

from __future__ import annotations

import contextlib
import io
from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np

from ..errors import InputError, StaticsError
from ..model.activation import strains
from ..model.anatomy import Trunk
from ..model.loads import mass_beyond
from . import casadi_function
from .request import Request
from .shape_model import Layout, Model, reference

RANDOM_CASES = 8  # with random activations, head angles and loads
TURNS = (0.9, 1.1)  # rad by which the sharpest element turns in two more cases; see `turning`
TURN_GRAVITY = 0.05  # factor on gravity there: such a coiled trunk has no shape under full weight
MAX_HALVINGS = 12  # of a case without an equilibrium
FREE_TURNS = (0.999, 1.001, 3.0)  # as `TURNS`, for further cases without loads
EXTENSION = (0.67, 1.35)  # of every segment: the paper's bounds
RESOLUTION_TOL = 3e-11  # relative error of a resolved shape; an export is allowed 1e-10
ROUND_OFF = 1e-9  # largest value, in SI units, of a part that is zero up to round-off
ELEMENT_COUNTS = (6, 7, 8, 10, 12, 16, 24, 32)


@lru_cache(maxsize=4)
def cases(model: Model) -> np.ndarray:
    """Inputs x (B, size), the same in every call for a model.

    The passive trunk; random activations, head angles and loads of the size that motions have; and
    shapes that turn by about 1 rad in an element, where the kernels of `rod_space_axes` switch from
    series to closed forms. A case that Newton's method does not solve from the unloaded shape is
    halved until it does.
    """
    layout, trunk, rng = model.layout, model.trunk, np.random.default_rng(20)
    rest = layout.x(np.zeros(len(trunk.muscles)), (0.0, 0.0), model.loads)
    x = np.tile(rest, (1 + RANDOM_CASES + len(TURNS), 1))
    force = _force(model)
    for row in x[1 : 1 + RANDOM_CASES]:
        part = {name: row[where] for name, where in layout.inputs.items()}  # views
        part["activation"][:] = _contraction(trunk, rng)
        part["head"][:] = rng.uniform(-0.5, 0.5, 2)
        part["gravity"][:] *= rng.uniform(0.5, 1.1)
        for name in part:
            if name.endswith("force"):
                part[name][:] = force * rng.uniform(-0.6, 0.6, 3)
            if name.endswith("couple"):
                part[name][:] = force * trunk.length * rng.uniform(-0.3, 0.3, 3)
    for row, angle in zip(x[1 + RANDOM_CASES :], TURNS, strict=True):
        row[layout.inputs["activation"]] = turning(model, angle, rng)
        row[layout.inputs["gravity"]] *= TURN_GRAVITY
    x = np.array([_solvable(model, row) for row in x])
    x.flags.writeable = False  # kept for the next call
    return x


def free_cases(model: Model) -> np.ndarray:
    """Activations and head angles (B, muscles + 2) of shapes without loads."""
    rng, loaded = np.random.default_rng(22), cases(model)[:, : model.layout.controls]
    more = [[*turning(model, angle, rng), *rng.uniform(-0.5, 0.5, 2)] for angle in FREE_TURNS]
    return np.vstack([loaded, np.array(more).reshape(len(FREE_TURNS), -1)])


def turning(model: Model, angle: float, rng: np.random.Generator) -> np.ndarray:
    """Activations (muscles,) that turn the sharpest element by an angle (rad) without extension."""
    tables = model.tables
    A = tables.strain
    activation = np.asarray(rng.normal(size=A.shape[2]))
    activation -= np.linalg.pinv(A[:, 0]) @ (A[:, 0] @ activation)
    bend = np.linalg.norm(A[:, 1:] @ activation, axis=1)[tables.segment]
    sharpest = float((bend * tables.piece[:, 0]).max())
    return activation * (angle / sharpest if sharpest > ROUND_OFF else 0.0)


def _solvable(model: Model, row: np.ndarray) -> np.ndarray:
    """A case, halved until both formulations find its shape: a soft trunk may fold."""
    function = casadi_function.loaded(model)
    for _ in range(MAX_HALVINGS):
        try:
            reference(model, row[None])
            with contextlib.redirect_stderr(io.StringIO()):  # CasADi prints all arguments
                function(row)
        except StaticsError:
            row = row / 2
        except RuntimeError as error:  # CasADi's, which also turns Ctrl-C into one
            if "KeyboardInterrupt" in str(error):
                raise KeyboardInterrupt from None
            row = row / 2
        else:
            return row
    raise InputError(
        f"{model.trunk.name}: the trunk folds under its own weight, so there is no shape to "
        "check an export with; expected a stiffer or lighter one."
    )


def _force(model: Model) -> float:
    """A force in N that bends the trunk but does not fold it."""
    trunk = model.trunk
    bending = trunk.youngs_modulus * np.pi / 4 * float(trunk.radius(trunk.length / 2)) ** 4
    weight = abs(model.loads.gravity) * float(mass_beyond(trunk, np.zeros(1))[0])
    buckling = 2.5 * bending / trunk.length**2
    return min(weight, buckling) if weight > 0 else buckling


def _contraction(trunk: Trunk, rng: np.random.Generator) -> np.ndarray:
    """Random activations (muscles,), with every extension within the paper's bounds."""
    activation = rng.uniform(-2.0, 0.1, len(trunk.muscles)) * (rng.random(len(trunk.muscles)) < 0.4)
    low, high = EXTENSION
    while True:
        zeta = strains(trunk, activation)[:, 0]
        if np.all((zeta > low) & (zeta < high)):
            return activation
        activation = activation * 0.8


@lru_cache(maxsize=4)
def resolved(model: Model) -> Model:
    """The model on the coarsest mesh, no coarser than its own, that resolves its shapes.

    Raises
    ------
    InputError
        If no mesh does.
    """
    finer_counts = [count for count in ELEMENT_COUNTS if count > model.elements]
    for elements in (model.elements, *finer_counts):
        finer = replace(model, elements=elements)
        x = cases(finer)
        expected = reference(finer, x)
        y = _values(casadi_function.loaded(finer), x).reshape(expected.shape)
        if max(disagreements(y, expected, model.layout).values()) <= RESOLUTION_TOL:
            return finer
    raise InputError(
        f"{model.trunk.name}: {ELEMENT_COUNTS[-1]} elements do not resolve its shapes to "
        f"{RESOLUTION_TOL:g}; expected a trunk that bends less sharply, or fewer points --at."
    )


def disagreements(value: np.ndarray, expected: np.ndarray, layout: Layout) -> dict[str, float]:
    """Largest error of each part of y, or of its derivatives, relative to its largest value.

    value, expected : (B, n, 19 or 16, ...). The error is absolute for a part that is zero up to
    round-off, such as the moment at the tip. NaN counts as infinite.
    """
    worst = {}
    for name, where in layout.outputs.items():
        a, b = value[:, :, where], expected[:, :, where]
        if b.size:
            size = float(np.abs(b).max())
            error = float(np.abs(a - b).max()) / (size if size > ROUND_OFF else 1.0)
            worst[name] = error if np.isfinite(error) else np.inf
    return worst


def check_files(request: Request) -> dict[str, str]:
    """check.csv and check_unloaded.csv, with one case per row.

    check.csv: x, y; with a Jacobian, dy/dx row by row; with second derivatives, a direction v and
    the derivative of dy/dx along it. check_unloaded.csv: activations and head, the unloaded y, its
    Jacobian.
    """
    controls, slopes = free_cases(request.model), request.what == "jacobian"
    free = casadi_function.unloaded(request.model)
    rows = [controls, _values(free, controls)]
    if slopes:
        rows.append(_derivatives(casadi_function.jacobian(free), controls))
    unloaded = _csv(np.hstack(rows))
    x, function = cases(request.model), casadi_function.loaded(request.model)
    rows = [x, reference(request.model, x).reshape(len(x), -1)]
    if slopes:
        rows.append(_derivatives(casadi_function.jacobian(function), x))
    if slopes and request.second:
        v = np.random.default_rng(21).uniform(-1, 1, x.shape)
        along = casadi_function.second(function)
        rows += [v, np.array([_flat(along(a, b)) for a, b in zip(x, v, strict=True)])]
    return {"check_unloaded.csv": unloaded, "check.csv": _csv(np.hstack(rows))}


def _values(function: ca.Function, x: np.ndarray) -> np.ndarray:
    return np.array([_flat(function(row)) for row in x])


def _derivatives(function: ca.Function, x: np.ndarray) -> np.ndarray:
    return np.array([_flat(function(row)[1]) for row in x])


def _flat(value: ca.DM) -> np.ndarray:
    """Numbers row by row."""
    return value.full().ravel()


def _csv(rows: np.ndarray) -> str:
    return "".join(",".join(f"{number:.17g}" for number in row) + "\n" for row in rows)
