"""A plan played on the trunk with inertia, and how far that is from what was planned."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from .._support.arguments import check_arguments
from .._support.atomic_files import replacing, write
from .._support.blas_threads import one_thread
from .._support.ranges import check
from ..dynamics.simulation import DAMPING_TIME, TIME_STEP, Simulation, simulate_controls
from ..errors import StaticsError
from .plan import Plan

POINTS = 101
FILES = ("simulation.nc", "simulation.json")


@dataclass(frozen=True, repr=False, eq=False)
class SimulatedPlan:
    """A simulation of a plan.

    Attributes
    ----------
    plan : Plan
    simulation : Simulation
    time_step, damping_time : float
        In s.
    """

    plan: Plan
    simulation: Simulation
    time_step: float
    damping_time: float

    def __repr__(self) -> str:
        name = f"{self.plan.motion.name}, {self.plan.mode}"
        return f"<Simulation of {name}: {len(self.simulation.times) - 1} steps in time>"

    @property
    def Z(self) -> np.ndarray:
        """Points (101,) in m at which it is compared and saved."""
        return np.linspace(0.0, self.plan.motion.trunk.length, POINTS)

    @cached_property
    def planned(self) -> np.ndarray:
        """Planned positions (S + 1, 101, 3) in m at the times of the simulation.

        NaN where the plan has no equilibrium.
        """
        positions = np.full((len(self.simulation.times), POINTS, 3), np.nan)
        for i, t in enumerate(self.simulation.times.tolist()):
            try:
                positions[i] = self.plan.sample(t).shape.position(self.Z)
            except StaticsError:
                continue
        return positions

    @cached_property
    def distance(self) -> np.ndarray:
        """Distance (S + 1, 101) in m from what was planned."""
        difference = self.simulation.shape.position(self.Z) - self.planned
        return np.asarray(np.linalg.norm(difference, axis=2))

    def summary(self) -> dict[str, Any]:
        """The main figures, ready for JSON."""
        worst = self.distance if np.any(np.isfinite(self.distance)) else np.zeros((1, 1))
        i, k = np.unravel_index(int(np.nanargmax(worst)), worst.shape)
        energy = self.simulation.energy
        return {
            "problem": self.plan.motion.name,
            "mode": self.plan.mode,
            "time_step": self.time_step,
            "damping_time": self.damping_time,
            "largest_distance": float(worst[i, k]),
            "largest_distance_time": float(self.simulation.times[i]),
            "largest_distance_Z": float(self.Z[k]),
            "tip_distance_at_end": float(np.nan_to_num(self.distance[-1, -1])),
            "kinetic_energy": float(energy.kinetic.max()),
            "work": energy.turned_over,
            "energy_imbalance": float(np.abs(energy.imbalance).max()),
            "units": {
                "time_step, damping_time, largest_distance_time": "s",
                "largest_distance, largest_distance_Z, tip_distance_at_end": "m, from the plan",
                "kinetic_energy, work, energy_imbalance": "J, the largest at any time",
            },
        }

    def dataset(self) -> xr.Dataset:
        """All of it as labeled arrays."""
        result, energy = self.simulation, self.simulation.energy
        joules = {"units": "J"}
        works = ("kinetic", "elastic", "loads", "muscles", "head", "lost", "imbalance")
        place = ("time", "Z", "axis")
        data = {
            "position": (place, result.shape.position(self.Z), {"units": "m"}),
            "planned_position": (place, self.planned, {"units": "m"}),
            "moment": (
                ("time", "Z", "director"),
                result.shape.moment(self.Z),
                {"units": "N m", "long_name": "internal moment in the directors"},
            ),
            **{name: ("time", getattr(energy, name), joules) for name in works},
        }
        coordinates = {
            "time": ("time", result.times, {"units": "s"}),
            "Z": ("Z", self.Z, {"units": "m"}),
            "axis": ["X", "Y", "Z"],
            "director": ["d1", "d2", "d3"],
        }
        return xr.Dataset(data, coordinates, {"summary_json": json.dumps(self.summary())})

    def save(self, folder: str | Path) -> None:
        """Write simulation.nc and simulation.json to a folder, which is created if needed.

        Raises
        ------
        InputError
            If a file cannot be written.
        """
        labeled, report = self.dataset(), json.dumps(self.summary(), indent=2) + "\n"
        with replacing(Path(folder) / FILES[0]) as path:
            labeled.to_netcdf(path, engine="scipy")
        write(Path(folder) / FILES[1], report)


@check_arguments
@one_thread()
def simulate(
    plan: Plan,
    time_step: float = TIME_STEP,
    damping_time: float = DAMPING_TIME,
    advance: Callable[[float], None] | None = None,
) -> SimulatedPlan:
    """Play a plan's activations, head angles and loads on the trunk with inertia.

    Parameters
    ----------
    time_step : float
        Longest step in time, in s.
    damping_time : float
        Of the Kelvin-Voigt tissue, in s; 0 for none. It is not known for elephants.
    advance : callable
        Told the time in s that is reached.

    Raises
    ------
    InputError
        For a trunk without mass, and numbers out of range.
    StaticsError
        If no motion is found.
    """
    check(time_step, "time step", "time_step")
    check(damping_time, "damping time", "damping_time")
    parts = plan.motion, plan.x, plan.loads, plan.mesh
    result = simulate_controls(*parts, time_step, damping_time, advance=advance)
    return SimulatedPlan(plan, result, time_step, damping_time)
