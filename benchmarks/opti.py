"""The horizon formulated by hand in CasADi's Opti, with loops and one constraint at a time.

Unknowns, units, bounds, constraints, objective, start and Ipopt options are those of the planner,
but its transcription (`trunk_ocp.nlp`) is not used: the rod's right-hand side is a function that is
called at each collocation point, and everything else is written out. The only difference: what the
transcription treats as unknowns with equal bounds (the trunk before the first step, known tip
forces) are constants here.
"""

from __future__ import annotations

import time
from typing import Any

import casadi as ca
import numpy as np

import trunk_ocp as to
from trunk_ocp.model.activation import segment_at, segment_fractions, strain_matrix, strains
from trunk_ocp.model.head import base_pose
from trunk_ocp.model.quaternions import directors
from trunk_ocp.nlp.ipopt_options import DEFAULT_OPTIONS
from trunk_ocp.nlp.point_functions import scaled_rates
from trunk_ocp.planning.options import Options, first_mesh
from trunk_ocp.problem.motion import Step
from trunk_ocp.problem.targets import HeldDirection
from trunk_ocp.rod.collocation import gauss
from trunk_ocp.rod.equations import STATES, point_parameters

from .common import run_part
from .inverse import paper_objective, solver_figures

Points = dict[float, tuple[ca.MX, ca.MX]]  # Z: q (4) and r (3)


class Horizon:
    """All time steps of a motion as one problem, `opti`, starting from a plan."""

    def __init__(self, plan: to.Plan) -> None:
        self.motion, self.plan = plan.motion, plan
        trunk, options = plan.motion.trunk, Options()
        self.mesh, weights = first_mesh(plan.motion, options), plan.motion.weights
        self.length = trunk.length
        self.moment = trunk.youngs_modulus * np.pi / 4 * trunk.base_radius**4 / trunk.length
        self.force = self.moment / trunk.length
        self.rates = scaled_rates(self.length, self.moment)
        psi, q = ca.SX.sym("psi", 2), ca.SX.sym("q", 4)
        pose = [ca.vertcat(*part) for part in base_pose(trunk.head, psi[0], psi[1])]
        self.base = ca.Function("base", [psi], pose)
        d = [ca.vertcat(*d_j) for d_j in directors(ca.vertsplit(q))]
        self.directors = [ca.Function("director", [q], [d_j]) for d_j in d]

        self.opti, self.x = ca.Opti(), []
        self.held: dict[HeldDirection, ca.MX] = {}
        f, before = ca.MX(0), ca.MX(np.zeros(plan.x.shape[1]))
        for t, step in enumerate(self.motion.steps):
            x = self.variable(plan.x[t])
            self.between(step.box.lower, x, step.box.upper)
            lower, upper = step.change.lower, step.change.upper
            limited = np.flatnonzero(np.isfinite(lower) | np.isfinite(upper)).tolist()
            if limited:
                self.between(lower[limited], (x - before)[limited], upper[limited])
            points = self.rod(t, step, x)
            self.hold(t, points)
            effort = weights.of_muscles(trunk.muscles)
            f += self.tracking(step, points) + ca.dot(effort, x[:-2] ** 2)
            f += weights.rate / step.duration * ca.sumsqr(x - before)
            self.x.append(x)
            before = x
        self.opti.minimize(f)

    def variable(self, start: np.ndarray) -> ca.MX:
        """Unknowns with the shape of their initial guess."""
        unknowns = self.opti.variable(*start.shape)
        self.opti.set_initial(unknowns, start)
        return unknowns

    def between(self, lower: Any, value: ca.MX, upper: Any) -> None:
        self.opti.subject_to(self.opti.bounded(lower, value, upper))

    def strains(self, t: int, x: ca.MX) -> tuple[list[ca.MX], ca.MX]:
        """Strain numbers of each segment, and mean extension (eqs. 5, 30)."""
        trunk, units = self.motion.trunk, np.array([1, *3 * [self.length]])
        fractions, numbers = segment_fractions(trunk), strains(trunk, self.plan.x[t, :-2]) * units
        strain = [self.variable(start) for start in numbers]
        for A_i, strain_i in zip(strain_matrix(trunk) * units[:, None], strain, strict=True):
            self.opti.subject_to(strain_i == np.array([1, 0, 0, 0]) + A_i @ x[:-2])
            self.between(self.motion.extension[0], strain_i[0], self.motion.extension[1])
        mean = self.variable(fractions @ numbers[:, :1])
        zeta_hat = ca.vertcat(*(strain_i[0] for strain_i in strain))
        self.opti.subject_to(mean == ca.dot(fractions, zeta_hat))
        return strain, mean

    def tip_force(self, step: Step) -> ca.MX:
        """Tip force of a step; unknown if it pulls along a held direction."""
        known = np.asarray(step.loads.tip_force) / self.force
        if step.pull is None:
            return ca.MX(known)
        strength, held = step.pull[0] / self.force, step.pull[1]
        tip_force = self.variable(known + strength * self.held_start(held))
        self.opti.subject_to(tip_force == known + strength * self.held[held])
        return tip_force

    def rod(self, t: int, step: Step, x: ca.MX) -> Points:
        """The rod of a step (eq. 14); returns its points at targets and held directions."""
        opti, mesh, trunk = self.opti, self.mesh, self.motion.trunk
        E, d, element, h = mesh.elements, mesh.degree, gauss(mesh.degree), mesh.widths / self.length
        strain, mean = self.strains(t, x)
        tip_force = self.tip_force(step)
        edges = [self.variable(start) for start in self.states(t, mesh.edges)]
        line = [self.variable(start) for start in self.positions(t, mesh.edges)]
        r, q = self.base(x[-2:])
        opti.subject_to(line[0] == r / self.length)
        opti.subject_to(edges[0][:4] == q)
        opti.subject_to(edges[E][4:] == 0)  # m(L) = 0
        requested = {target.Z for target in step.targets}
        requested |= {held.Z for held in self.motion.held if held.step == t}
        points: Points = {}
        for k in range(E):
            inner = self.variable(self.states(t, mesh.points[k]).T)
            states = ca.horzcat(edges[k], inner)
            p = point_parameters(trunk, step.loads, mesh.points[k])
            strain_k = strain[segment_at(trunk, mesh.points[k, 0])]
            rates = []
            for i in range(d):
                w = ca.vertcat(inner[:, i], strain_k, mean, tip_force)
                rates.append(h[k] * self.rates(w, p[:, i]))
                opti.subject_to(states @ element.derivative[i] == rates[i][:STATES])
            dr = ca.horzcat(*(rate[STATES:] for rate in rates))
            opti.subject_to(edges[k + 1] == states @ element.value(1.0))
            opti.subject_to(line[k + 1] == line[k] + dr @ element.integral(1.0))
            for Z in sorted(requested):
                at, tau = (value.item() for value in mesh.locate(Z))
                if at == k and tau in (0.0, 1.0):
                    points[Z] = (edges[k + int(tau)][:4], line[k + int(tau)])
                elif at == k:
                    q = self.variable(self.states(t, [Z])[0, :4])
                    r = self.variable(self.positions(t, [Z])[0])
                    opti.subject_to(q == states[:4, :] @ element.value(tau))
                    opti.subject_to(r == line[k] + dr @ element.integral(tau))
                    points[Z] = (q, r)
        return points

    def hold(self, t: int, points: Points) -> None:
        """Unknowns for the directions of this step that later steps refer to."""
        for held in self.motion.held:
            if held.step == t:
                q, D = points[held.Z][0], self.variable(self.held_start(held))
                self.opti.subject_to(D == self.directors[held.director](q) / ca.sumsqr(q))
                self.held[held] = D

    def tracking(self, step: Step, points: Points) -> ca.MX:
        """Squared errors of a step's targets (eq. 42, squared)."""
        f = ca.MX(0)
        for target in step.targets:
            q, r = points[target.Z]
            if target.position is not None:
                miss = self.length * r - np.asarray(target.position)
                f += target.position_weight * ca.sumsqr(miss)
            for j, wanted, weight in target.pairs():
                goal = (
                    self.held[wanted] if isinstance(wanted, HeldDirection) else np.asarray(wanted)
                )
                f += weight * ca.sumsqr(self.directors[j](q) - goal)
        return f

    def states(self, t: int, Z: Any) -> np.ndarray:
        """States (n, 7) of the plan at Z (n,)."""
        return self.plan.shape.state(np.asarray(Z))[t] / np.array([*4 * [1], *3 * [self.moment]])

    def positions(self, t: int, Z: Any) -> np.ndarray:
        return self.plan.shape.position(np.asarray(Z))[t] / self.length

    def held_start(self, held: HeldDirection) -> np.ndarray:
        return self.plan.shape.directors(np.array([held.Z]))[held.step, 0, held.director]


def horizon(motion: str, expand: bool, budget: float = 60.0) -> dict[str, Any]:
    """The horizon in Opti, with derivatives by `nlpsol`; the budget limits Ipopt."""
    loaded = to.load_motion(motion)
    to.plan_motion(loaded, lookahead=1)  # warm-up, as for our planner
    began = time.perf_counter()
    plan = to.plan_motion(loaded, lookahead=1)
    start_seconds = time.perf_counter() - began
    options = {"expand": expand, "print_time": False, "record_time": True}
    options["detect_simple_bounds"] = (
        True  # otherwise bounds on unknowns become constraints with slacks
    )
    began = time.perf_counter()
    problem = Horizon(plan)
    opti = problem.opti
    opti.solver("ipopt", options, DEFAULT_OPTIONS | {"max_wall_time": budget})
    opti.solve_limited()
    duration = time.perf_counter() - began
    stats = opti.stats()
    setup = duration - stats["t_wall_total"]  # Opti creates its solver in `solve`
    x = np.stack([opti.debug.value(x) for x in problem.x])
    return solver_figures(stats, start_seconds, setup) | {
        "objective": float(opti.debug.value(opti.f)),
        "J": paper_objective(loaded, x),
        "unknowns": opti.nx,
        "constraints": opti.ng - sum(stats["detect_simple_bounds_is_simple"]),
    }


if __name__ == "__main__":
    run_part({"horizon": horizon})
