"""Costs of a window's controls alone, effort and rates: a quadratic function, kept as numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .term_derivatives import first_derivatives, second_derivatives
from .window import Window


@dataclass(frozen=True, eq=False)
class ControlCosts:
    """A quadratic function of the controls of H time steps and of the step before.

    Attributes
    ----------
    constant : float
        Value where all controls are zero.
    slope : (H + 1, controls)
        Gradient there; the first row belongs to the step before.
    diagonal : (H + 1, controls)
        Diagonal of the Hessian.
    links : (H + 1, controls)
        Hessian by each control and the same one of the step before; 0 in the first row.
    """

    constant: float
    slope: np.ndarray
    diagonal: np.ndarray
    links: np.ndarray

    @classmethod
    def of(cls, window: Window) -> ControlCosts:
        """Costs of a window, from its terms."""
        x = np.stack([window.previous, *(u.x for u in window.unknowns)])
        number = np.full(window.bounds["lbx"].size, -1)
        number[x] = np.arange(x.size).reshape(x.shape)
        constant, (slope, diagonal, links) = 0.0, np.zeros((3, x.size))
        for function, variables, parameters in window.regularization():
            w, p = np.zeros(variables.T.shape), parameters.T
            value, first = first_derivatives(function, w, p)
            second = second_derivatives(function, w, p, np.ones((len(w), 1)))
            constant += float(value.sum())
            at = number[variables]
            for i, places in enumerate(at):
                np.add.at(slope, places, first[:, 0, i])
                np.add.at(diagonal, places, second[:, i, i])
            if len(at) == 2:
                np.add.at(links, at[1], second[:, 0, 1])
        return cls(constant, *(array.reshape(x.shape) for array in (slope, diagonal, links)))

    def at(self, before: np.ndarray, x: np.ndarray) -> tuple[float, np.ndarray]:
        """Value, and gradient (H, controls) by controls x (H, controls) after those `before`."""
        x = np.concatenate([before[None], x])
        change = self.diagonal * x
        change[1:] += self.links[1:] * x[:-1]
        change[:-1] += self.links[1:] * x[1:]
        value = self.constant + float(np.sum((self.slope + change / 2) * x))
        return value, (self.slope + change)[1:]
