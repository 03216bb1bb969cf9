"""The forward problem in general rod simulators: EXUDYN and PyElastica.

Both use the trunk's unloaded shape as reference, with the stiffness of the activated trunk and
the weight of each slice at its nodes. Both rods are shear-deformable, unlike the paper's Kirchhoff
rod, so deviations from ours are reported as differences, not as errors. With the shear stiffness
multiplied by `STIFF`, EXUDYN's difference shrinks to its discretization error.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

import trunk_ocp as to
from trunk_ocp.model.activation import mean_extension, segment_at, stiffness, strains
from trunk_ocp.model.loads import mass_beyond
from trunk_ocp.model.quaternions import directors
from trunk_ocp.rod.unloaded import unloaded_states

from .common import cases, distance, fine_mesh, median, run_part, seconds

STIFF = 1e3
SHEAR_FACTOR = 27 / 28  # circular section, nu = 1/2, as in PyElastica


@dataclass(frozen=True)
class Reference:
    """An unloaded, activated trunk divided into n pieces, and its exact loaded centerline."""

    trunk: to.Trunk
    position: np.ndarray  # (n + 1, 3) of the nodes
    frames: np.ndarray  # (n + 1, 3, 3), row i is d_i
    middle_frames: np.ndarray  # (n, 3, 3)
    lengths: np.ndarray  # (n,) activated arc lengths
    stiffness: np.ndarray  # (n, 4), activated, at the middles
    radii: np.ndarray  # (n,), activated
    weights: np.ndarray  # (n + 1,) N, tip force included
    exact: np.ndarray  # (n + 1, 3)


def reference(i: int, elements: int) -> Reference:
    which = cases(i + 1)
    trunk, activation, head = which.trunk, which.activation[i], which.head[i]
    edges = np.asarray(trunk.edges)
    counts = np.maximum(1, np.round(elements * np.diff(edges) / trunk.length)).astype(int)
    pieces = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(edges[:-1], edges[1:], counts, strict=True)
    ]
    nodes = np.append(np.concatenate(pieces), trunk.length)
    middles = (nodes[1:] + nodes[:-1]) / 2
    position, q = unloaded_states(trunk, activation, head, nodes)
    _, q_middle = unloaded_states(trunk, activation, head, middles)
    strain = strains(trunk, activation)
    mean = float(mean_extension(trunk, strain))
    beyond = mass_beyond(trunk, np.concatenate([[0.0], middles, [trunk.length]]))
    weights = -which.loads.gravity * np.diff(beyond)
    weights[-1] += which.loads.tip_force[2]
    fine = to.solve_statics(trunk, activation, head, which.loads, fine_mesh(which))
    return Reference(
        trunk,
        position,
        _frames(q),
        _frames(q_middle),
        np.diff(nodes) * strain[segment_at(trunk, middles), 0],
        stiffness(trunk, middles) / mean ** np.array([1, 2, 2, 2]),  # eq. (30)
        trunk.radius(middles) / mean**0.5,
        weights,
        fine.position(nodes),
    )


def _frames(q: np.ndarray) -> np.ndarray:
    return np.stack([np.stack(row, axis=-1) for row in directors(tuple(q.T))], axis=-2)


def _along_chords(ref: Reference) -> np.ndarray:
    """Frames (n, 3, 3) at the middles, with d_3 along the chord between nodes."""
    d3 = np.diff(ref.position, axis=0)
    d3 /= np.linalg.norm(d3, axis=1, keepdims=True)
    d2 = np.cross(d3, ref.middle_frames[:, 0])
    d2 /= np.linalg.norm(d2, axis=1, keepdims=True)
    return np.stack([np.cross(d2, d3), d2, d3], axis=1)


def exudyn_shape(ref: Reference, stiff: float = 1.0) -> np.ndarray:
    """Node positions (n + 1, 3) by geometrically exact beams and EXUDYN's static solver."""
    import exudyn as exu
    import exudyn.itemInterface
    from scipy.spatial.transform import Rotation

    items = exu.itemInterface
    system = exu.SystemContainer().AddSystem()
    ground = system.AddNode(items.NodePointGround())
    fixed = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    axial_first = ref.frames[:, [2, 0, 1]].swapaxes(1, 2)  # columns d_3, d_1, d_2
    turns = Rotation.from_matrix(axial_first).as_quat(scalar_first=True)
    nodes = [
        system.AddNode(items.NodeRigidBodyEP(referenceCoordinates=[*r, *turn]))
        for r, turn in zip(ref.position, turns, strict=True)
    ]
    for k, (length, (K0, K1, K2, K3)) in enumerate(zip(ref.lengths, ref.stiffness, strict=True)):
        section = exu.BeamSection()
        shear = stiff * SHEAR_FACTOR * K0 / (2 * (1 + ref.trunk.poisson_ratio))
        section.stiffnessMatrix = np.diag([K0, shear, shear, K3, K1, K2])
        section.massPerLength = 1.0  # unused by statics
        section.inertia = np.eye(3)
        system.AddObject(
            items.ObjectBeamGeometricallyExact(
                nodeNumbers=nodes[k : k + 2], length=length, sectionData=section
            )
        )
    for coordinate in (0, 1, 2, 4, 5, 6):  # the fourth follows from unit length
        at_base = items.MarkerNodeCoordinate(nodeNumber=nodes[0], coordinate=coordinate)
        pair = [fixed, system.AddMarker(at_base)]
        system.AddObject(items.ObjectConnectorCoordinate(markerNumbers=pair))
    for node, weight in zip(nodes, ref.weights, strict=True):
        marker = system.AddMarker(items.MarkerNodePosition(nodeNumber=node))
        system.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=[0, 0, weight]))
    system.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.staticSolver.numberOfLoadSteps = 1
    settings.staticSolver.newton.relativeTolerance = 1e-8
    settings.staticSolver.verboseMode = 0
    settings.show.statistics = False
    if not system.SolveStatic(settings):
        settings.staticSolver.numberOfLoadSteps = 10
        if not system.SolveStatic(settings):
            raise RuntimeError("EXUDYN's static solver did not converge")
    return np.array([system.GetNodeOutput(n, exu.OutputVariableType.Position) for n in nodes])


def exudyn(elements: int = 40, shapes: int = 5) -> dict[str, Any]:
    """Time including model setup, and difference from ours, also with shear suppressed."""
    references = [reference(i, elements) for i in range(shapes)]
    exudyn_shape(references[0])
    times, shearing, stiff = [], 0.0, 0.0
    for ref in references:
        times += seconds(lambda ref=ref: exudyn_shape(ref), 1)
        L = ref.trunk.length
        shearing = max(shearing, distance(exudyn_shape(ref), ref.exact) / L)
        stiff = max(stiff, distance(exudyn_shape(ref, STIFF), ref.exact) / L)
    return {
        "elements": elements,
        "seconds": median(times),
        "difference_in_L": shearing,
        "difference_without_shear_in_L": stiff,
    }


def elastica_shape(ref: Reference, stop: float) -> tuple[np.ndarray, float]:
    """Node positions where PyElastica's damped motion comes to rest, and the final speed in m/s."""
    import elastica as ea

    class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
        pass

    class Weights(ea.NoForces):
        def apply_forces(self, system: Any, time: float = 0.0) -> None:
            system.external_forces[2] += ref.weights

    trunk, n = ref.trunk, len(ref.lengths)
    rod = ea.CosseratRod.straight_rod(
        n,
        ref.position[0],
        ref.frames[0, 2],
        ref.frames[0, 0].copy(),
        ref.lengths.sum(),
        ref.radii,
        trunk.density,
        youngs_modulus=trunk.youngs_modulus,
        shear_modulus=trunk.youngs_modulus / (2 * (1 + trunk.poisson_ratio)),
        position=ref.position.T.copy(),
        directors=np.moveaxis(_along_chords(ref), 0, -1).copy(),
    )
    rod.compute_internal_forces_and_torques(0.0)
    rod.rest_kappa[:] = rod.kappa  # the unloaded shape is the rest shape
    rod.rest_sigma[:] = rod.sigma
    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(
        ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    simulator.add_forcing_to(rod).using(Weights)
    wave = (trunk.youngs_modulus / trunk.density) ** 0.5
    dt = 0.2 * ref.lengths.min() / wave
    simulator.dampen(rod).using(
        ea.AnalyticalLinearDamper, uniform_damping_constant=6.0, time_step=dt
    )
    simulator.finalize()
    stepper, time_reached, speed = ea.PositionVerlet(), 0.0, np.inf
    before = rod.position_collection.copy()
    interval = 0.25
    while time_reached < 30.0 and speed > stop:
        steps = max(1, round(interval / dt))
        for _ in range(steps):
            time_reached = float(stepper.step(simulator, np.float64(time_reached), np.float64(dt)))
        speed = float(np.abs(rod.position_collection - before).max()) / interval
        before = rod.position_collection.copy()
    return rod.position_collection.T.copy(), speed


def elastica(elements: int = 40, shapes: int = 3, stop: float = 1e-3) -> dict[str, Any]:
    """Time to come to rest, without compilation, and difference from ours."""
    references = [reference(i, elements) for i in range(shapes)]
    began = time.perf_counter()
    elastica_shape(references[0], 10.0)
    compilation = time.perf_counter() - began
    times, difference, fastest = [], 0.0, 0.0
    for ref in references:
        began = time.perf_counter()
        position, speed = elastica_shape(ref, stop)
        times.append(time.perf_counter() - began)
        difference = max(difference, distance(position, ref.exact) / ref.trunk.length)
        fastest = max(fastest, speed)
    return {
        "elements": elements,
        "seconds": median(times),
        "compilation_seconds": compilation,
        "difference_in_L": difference,
        "last_speed": fastest,
    }


if __name__ == "__main__":
    run_part({"exudyn": exudyn, "elastica": elastica})
