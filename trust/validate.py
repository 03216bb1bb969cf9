"""`python -m trust.validate`: evaluate all cases, write docs/validation.md and its figures."""

from __future__ import annotations

from pathlib import Path

from trust.validation import CASES
from trust.validation.case import CoveredByTest
from trust.validation.figures import draw_all
from trust.validation.report import page

DOCS = Path(__file__).parent.parent / "docs"


def evaluate() -> list[str]:
    """Write the page and its figures; returns the names of cases outside their tolerance."""
    cases = [case for case in CASES if not isinstance(case, CoveredByTest)]
    errors = {case.name: case.error() for case in cases}
    draw_all(DOCS / "figures")
    (DOCS / "validation.md").write_text(page(CASES, errors), encoding="utf-8")
    print(f"{len(errors)} cases evaluated: {DOCS / 'validation.md'}", flush=True)
    return [case.name for case in cases if not errors[case.name] <= case.tolerance]


def main() -> None:
    """Evaluate; exit code 1 if a case is outside its tolerance."""
    if failed := evaluate():
        raise SystemExit("outside tolerance: " + "; ".join(failed))


if __name__ == "__main__":
    main()
