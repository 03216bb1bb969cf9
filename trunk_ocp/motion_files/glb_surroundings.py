"""What surrounds the trunk in a glTF file: head, obstacles, logs, the tip mass, and targets."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from ..model.quaternions import about_y, about_z, product
from ..model.solids import Solid, axes_along, pivot
from ..planning.plan import Plan
from ..problem.step_solids import head_solids
from ..rod.shape import Shape
from ..scene.colors import MASS, TARGET, WOOD
from ..scene.keyframes import Keyframes
from ..scene.moments import Moment, curves
from ..scene.solid_meshes import SolidSurface, color_of, obstacles, solid_surface
from ..scene.surfaces import Surface, shaded
from ..scene.surroundings import logs, marks, tip_mass
from .glb_file import GlbFile

LOG_TIMES = 121  # at which the center of a moving log is stored
TARGET_RADIUS, ARROW_RADIUS, ARROW_LENGTH = 0.012, 0.004, 0.1  # of the trunk's length
ORIGIN = (0.0, 0.0, 0.0)


def add_solids(file: GlbFile, plan: Plan, keys: np.ndarray, times: np.ndarray) -> None:
    """Add head and obstacles; the head turns at `keys` (k,) in s as it does at `times` (k,).

    An obstacle of some phases only has no size in the others.
    """
    motion = plan.motion
    there: dict[Solid, set[int]] = {solid: set() for solid in head_solids(motion.trunk)}
    for number in range(len(motion.phases)):
        for solid in obstacles(plan, number):
            there.setdefault(solid, set()).add(number)
    sampler = -1
    if any(solid.frame == "head" for solid in there):
        z, y = curves(plan, times)[:, -2:].T
        turns = np.stack(product(about_z(z), about_y(y)), axis=-1)[:, [1, 2, 3, 0]]
        sampler = file.sampler_of(keys, turns, "VEC4")
    for solid, phases in there.items():
        surface = _surface(solid, motion.trunk.length)
        names = [motion.phases[number].name for number in sorted(phases)]
        extras = {"solid": solid.group} | ({"phases": names} if names else {})
        if solid.frame == "head":
            origin = pivot(motion.trunk)
            moved = Surface(surface.vertices - origin, surface.normals, surface.triangles)
            mesh = file.still_mesh(solid.name, moved, color_of(solid))
            node = file.node(solid.name, mesh, extras, translation=origin.tolist())
            file.animate(node, "rotation", sampler)
        else:
            node = file.node(
                solid.name, file.still_mesh(solid.name, surface, color_of(solid)), extras
            )
        if names and len(phases) < len(motion.phases):
            starts = [0.0, *(phase.end for phase in motion.phases[:-1])]
            shown = [number in phases for number in range(len(starts))]
            _show(file, node, np.array(starts), shown)


def add_objects(
    file: GlbFile, plan: Plan, keys: np.ndarray, frames: Keyframes, at: np.ndarray
) -> None:
    """Add logs, and the mass at the tip, where it is at `keys` (k,) in s in shapes `at` (k,)."""
    end = float(keys[-1])
    for log in logs(plan):
        solid = Solid(
            "log", "log", "cylinder", ORIGIN, axes_along(np.array([0.0, 1.0, 0.0])),
            (log.radius, log.length / 2),
        )  # fmt: skip
        mesh = file.still_mesh("log", _surface(solid, plan.motion.trunk.length), WOOD)
        times = np.unique(np.concatenate([np.linspace(0.0, end, LOG_TIMES), plan.times]))
        centers = np.array([log.center(plan, time) for time in times.tolist()])
        node = file.node("log", mesh, {"solid": "log"}, translation=centers[0].tolist())
        if np.ptp(centers, axis=0).any():
            file.animate(node, "translation", file.sampler_of(times, centers, "VEC3"))
    mass = tip_mass(plan)
    if mass is None:
        return
    ball = Solid("tip mass", "obstacles", "sphere", ORIGIN, sizes=(mass.radius,))
    mesh = file.still_mesh("tip mass", _surface(ball, plan.motion.trunk.length), MASS)
    where = []
    for time, i in zip(keys.tolist(), at.tolist(), strict=True):
        shape = Shape.stack([frames.shape[i]])
        moment = Moment(time, frames.activation[i], np.zeros(2), shape)
        where.append(mass.center(plan, moment))
    shown = [center is not None for center in where]
    places = np.array([mass.place if center is None else center for center in where])
    extras = {"solid": "tip mass", "mass": mass.mass}
    node = file.node("tip mass", mesh, extras, translation=places[0].tolist())
    file.animate(node, "translation", file.sampler_of(keys, places, "VEC3"))
    if not all(shown):
        _show(file, node, keys, shown)


def add_targets(file: GlbFile, plan: Plan) -> None:
    """Add a ball for each point of the trunk with a target, and an arrow for each direction.

    Until a time step they are where that step wants them; they have no size where it wants none.
    """
    trunk = plan.motion.trunk
    starts = plan.times[:-1]
    balls: dict[float, dict[int, np.ndarray]] = {}
    arrows: dict[tuple[float, int], dict[int, tuple[np.ndarray, np.ndarray]]] = {}
    for number in range(len(plan.x)):
        for mark in marks(plan, number):
            if mark.placed:
                balls.setdefault(mark.Z, {})[number] = mark.target
            for k, direction in enumerate(mark.directions):
                arrows.setdefault((mark.Z, k), {})[number] = mark.target, direction
    length = trunk.length
    if balls:
        ball = Solid("target", "obstacles", "sphere", ORIGIN, sizes=(TARGET_RADIUS * length,))
        mesh = file.still_mesh("target", _surface(ball, length), TARGET)
        for Z, places in balls.items():
            node = file.node(f"target, Z = {Z:.4g} m", mesh, {"solid": "target", "Z": Z})
            _place(file, node, starts, places)
    if arrows:
        half = ARROW_LENGTH * length / 2
        bar = Solid("direction", "obstacles", "cylinder", (0.0, 0.0, half),
                    sizes=(ARROW_RADIUS * length, half))  # fmt: skip
        mesh = file.still_mesh("direction", _surface(bar, length), TARGET)
        for (Z, k), asked in arrows.items():
            extras = {"solid": "direction", "Z": Z}
            node = file.node(f"direction {k + 1}, Z = {Z:.4g} m", mesh, extras)
            turns = {n: _turned(direction) for n, (_, direction) in asked.items()}
            _animate(file, node, "rotation", starts, turns)
            _place(file, node, starts, {n: place for n, (place, _) in asked.items()})


def _turned(direction: np.ndarray) -> np.ndarray:
    """Quaternion x, y, z, w (4,) that turns e_Z to a direction (3,)."""
    axes = np.array(axes_along(direction)).T
    turn: np.ndarray = Rotation.from_matrix(axes).as_quat()
    return turn


def _place(file: GlbFile, node: int, starts: np.ndarray, places: dict[int, np.ndarray]) -> None:
    """Put a node at a place (3,) from the start of each of some time steps on, and hide it else."""
    _animate(file, node, "translation", starts, places)
    shown = [number in places for number in range(len(starts))]
    if not all(shown):
        _show(file, node, starts, shown)


def _animate(
    file: GlbFile, node: int, path: str, starts: np.ndarray, values: dict[int, np.ndarray]
) -> None:
    """Give a node a value from the start of each time step on; the nearest where it has none."""
    held = [values[min(values, key=lambda m: abs(m - n))] for n in range(len(starts))]
    file.nodes[node][path] = held[0].tolist()
    if any(not np.array_equal(value, held[0]) for value in held):
        kind = "VEC4" if path == "rotation" else "VEC3"
        file.animate(node, path, file.sampler_of(starts, np.array(held), kind, steps=True))


def _show(file: GlbFile, node: int, times: np.ndarray, shown: list[bool]) -> None:
    """Show a node from some of the times on, and give it no size from the others on."""
    sizes = np.repeat(np.array(shown, dtype=float)[:, None], 3, axis=1)
    file.nodes[node]["scale"] = sizes[0].tolist()
    file.animate(node, "scale", file.sampler_of(times, sizes, "VEC3", steps=True))


def _surface(solid: Solid, length: float) -> Surface:
    mesh: SolidSurface = solid_surface(solid, length)
    return shaded(mesh.body)
