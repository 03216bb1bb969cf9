"""The HTML under a notebook's cell that ends with a plan, motion, trunk or shape."""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Mapping
from functools import singledispatch
from typing import Any

import numpy as np

from .._support.wording import rounded
from ..errors import InputError, StaticsError
from ..model.anatomy import Trunk
from ..model.loads import Loads
from ..planning.plan import Plan
from ..problem.motion import Log, Motion
from ..rod.shape import Shape
from ..rod.statics import solve_statics
from ..scene.colors import groups
from .side_view import side_view

MAX_SHAPES = 5  # in a picture
MAX_TARGETS = 60
MAX_PHASES = 6  # in a list
MAX_LETTERS = 80  # of a name or a title
ROW = (
    '<tr><td style="opacity:.65;text-align:left;padding:1px 12px 1px 0">{}</td>'
    '<td style="text-align:left;padding:1px 0">{}</td></tr>'
)


@singledispatch
def summary_html(shown: object) -> str:
    """A plan, motion, trunk or shape as a small picture with key facts.

    All text from files is escaped.
    """
    raise InputError(f"shown = {shown!r}: expected a Plan, Motion, Trunk or Shape.")


@summary_html.register
def _(plan: Plan) -> str:
    motion = plan.motion
    facts = {
        "status": plan.status.value,
        "motion": f"{_seconds(plan.times[-1])}, {len(plan.x)} of {len(motion.steps)} time steps",
        **(_errors(plan) if len(plan.x) and not plan.unchecked else {}),
        **_gap(plan),
        "planned": f"{plan.mode}, {plan.iterations} iterations, {_seconds(plan.total_seconds)}",
    }
    picture = ""
    if len(plan.x):
        wanted = np.linspace(0.0, plan.times[-1], MAX_SHAPES)
        steps = np.unique([np.argmin(np.abs(plan.times - time)) for time in wanted[1:]])
        shapes = [plan.shape[i] for i in (np.maximum(steps, 1) - 1).tolist()]
        places = _targets(motion, plan.x[:, -2:])
        log = motion.steps[len(plan.x) - 1].log
        picture = side_view(Shape.stack([*_start(motion), *shapes], plan.mesh), places, _logs(log))
    return _card("plan", motion.spec.title or motion.name, picture, facts)


def _errors(plan: Plan) -> dict[str, str]:
    """Largest errors of a plan with time steps, and its objective."""
    positions = np.concatenate([each.position for each in plan.errors])
    directions = np.concatenate([each.direction for each in plan.errors])
    facts = {"J (eq. 42)": rounded(plan.objective.paper, 4)}
    if positions.size:
        facts["position error"] = f"at most {rounded(1e3 * positions.max())} mm"
    if directions.size:
        facts["direction error"] = f"at most {rounded(directions.max())}"
    return facts


def _gap(plan: Plan) -> dict[str, str]:
    """The smallest gap to a body, if it is known already; it takes half a second."""
    gap = plan.clearance.min if "clearance" in vars(plan) else None
    return {} if gap is None else {"smallest gap": f"{rounded(1e3 * gap.gap, 3)} mm to {gap.body}"}


@summary_html.register
def _(motion: Motion) -> str:
    phases = [f"{phase.name}, to {_seconds(phase.end)}" for phase in motion.phases[:MAX_PHASES]]
    more = len(motion.phases) - MAX_PHASES
    facts = {
        "trunk": motion.trunk.name,
        "phases": "; ".join([*phases, *([f"and {more} more"] if more > 0 else [])]),
        "time steps": f"{len(motion.steps)}",
        "stays clear of": ", ".join(sorted(motion.contact)) or "nothing: no contact asked for",
    }
    picture, start = "", _start(motion)
    if start:
        head = np.tile(motion.start[-2:], (len(motion.steps), 1))
        picture = side_view(Shape.stack(start), _targets(motion, head))
    else:
        facts["start"] = "no equilibrium"
    return _card("motion", motion.spec.title or motion.name, picture, facts)


@summary_html.register
def _(trunk: Trunk) -> str:
    names = groups(trunk)
    ends = trunk.radius(np.array([0.0, trunk.length]))
    sections = math.pi / 3 * (ends[0] ** 2 + ends[0] * ends[1] + ends[1] ** 2)
    facts = {
        "length": f"{trunk.length:g} m",
        "radius": f"{1e3 * ends[0]:.3g} mm at the base, {1e3 * ends[1]:.3g} mm at the tip",
        "mass": f"{rounded(trunk.density * sections * trunk.length, 4)} kg",
        "muscles": f"{len(trunk.muscles)} in {trunk.segments} segments: {_list(names)}",
    }
    rest = solve_statics(trunk, np.zeros(len(trunk.muscles)), loads=Loads(gravity=0.0))
    return _card("trunk", trunk.name, side_view(Shape.stack([rest])), facts)


@summary_html.register
def _(shape: Shape) -> str:
    batch = shape.states.shape[:-3]
    count = math.prod(batch)
    facts = {"shapes": " x ".join(map(str, batch))} if batch else {}
    picture = ""
    if count:
        tips = shape.position(np.array([shape.trunk.length]))
        low, high = (tips.reshape(-1, 3).min(axis=0), tips.reshape(-1, 3).max(axis=0))
        facts["tip"] = ", ".join(map(_range, "XYZ", low, high)) + " m"
        facts["extension"] = _range("zeta", shape.extension.min(), shape.extension.max())
        chosen = np.linspace(0, count - 1, min(count, MAX_SHAPES)).round().astype(int)
        some = shape[np.unravel_index(chosen, batch)] if batch else Shape.stack([shape])
        picture = side_view(some)
    return _card("shape", shape.trunk.name, picture, facts)


def _range(name: str, low: float, high: float) -> str:
    ends = dict.fromkeys(f"{value:.3f}" for value in (low, high))
    return f"{name} {' to '.join(ends)}"


def _start(motion: Motion) -> list[Shape]:
    """The shape where a motion starts; none if the trunk does not hold its own weight."""
    x0 = motion.start
    try:
        return [solve_statics(motion.trunk, x0[:-2], x0[-2:], Loads(motion.gravity))]
    except StaticsError:
        return []


def _targets(motion: Motion, head: np.ndarray) -> list[np.ndarray]:
    """Positions (3,) in m that steps ask for, at head angles (H, 2) of the first H steps."""
    places = {
        tuple(target.position_at(motion.trunk, angles).tolist())
        for step, angles in zip(motion.steps, head, strict=False)
        for target in step.targets
        if target.position is not None and target.position_weight > 0
    }
    kept = sorted(places)
    return [np.array(place) for place in kept[:: -(-len(kept) // MAX_TARGETS) or 1]]


def _logs(log: Log | None) -> list[tuple[np.ndarray, float]]:
    return [(np.array(log.center), log.radius)] if log is not None and log.center else []


def _list(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"


def _seconds(value: float) -> str:
    return f"{rounded(value, 3)} s"


def _card(kind: str, title: str, picture: str, facts: Mapping[str, Any]) -> str:
    rows = "".join(ROW.format(_text(key), _text(value)) for key, value in facts.items())
    return (
        '<div style="display:flex;gap:16px;align-items:center;flex-wrap:wrap">'
        f"{picture}<div><div><b>{_text(title)}</b> ({kind})</div>"
        f'<table style="border-collapse:collapse">{rows}</table></div></div>'
    )


def _text(value: str) -> str:
    """Text from a file, shortened, that is only text to a browser."""
    short = value if len(value) <= MAX_LETTERS else value[: MAX_LETTERS - 3].rstrip() + "..."
    return html.escape(short).encode("utf-8", "replace").decode("utf-8")
