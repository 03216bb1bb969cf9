"""All validation cases; the tests and docs/validation.md are made from them.

To add a subject, write a module with a tuple `CASES` and add it here.
"""

from __future__ import annotations

from . import (
    balance,
    beams,
    buckling,
    convergence,
    elastica,
    flutter,
    helices,
    invariances,
    limits,
    trunk,
)
from .case import Case, CoveredByTest

CASES: tuple[Case | CoveredByTest, ...] = (
    *elastica.CASES,
    *beams.CASES,
    *buckling.CASES,
    *flutter.CASES,
    *helices.CASES,
    *trunk.CASES,
    *balance.CASES,
    *invariances.CASES,
    *limits.CASES,
    *convergence.CASES,
)
