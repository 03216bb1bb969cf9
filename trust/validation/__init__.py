"""One collection of cases, from which the tests and the page docs/validation.md are made.

A new subject is a module with a tuple `CASES`, named here.
"""

from __future__ import annotations

from . import balance, beams, buckling, convergence, elastica, helices, invariances, limits, trunk
from .case import Case, HeldByTest

CASES: tuple[Case | HeldByTest, ...] = (
    *elastica.CASES,
    *beams.CASES,
    *buckling.CASES,
    *helices.CASES,
    *trunk.CASES,
    *balance.CASES,
    *invariances.CASES,
    *limits.CASES,
    *convergence.CASES,
)
