"""`python -m trust.validate`: evaluate every case, write docs/validation.md and its figures."""

from __future__ import annotations

from pathlib import Path

from trust.validation import CASES
from trust.validation.case import Held
from trust.validation.figures import draw_all
from trust.validation.report import page

DOCS = Path(__file__).parent.parent / "docs"


def main() -> None:
    """Write the page and the figures; exit with 1 if a case is off by more than it may."""
    errors = {case.name: case.error() for case in CASES if not isinstance(case, Held)}
    draw_all(DOCS / "figures")
    (DOCS / "validation.md").write_text(page(CASES, errors), encoding="utf-8")
    print(f"{len(errors)} cases evaluated: {DOCS / 'validation.md'}")
    failed = [
        case.name
        for case in CASES
        if not isinstance(case, Held) and not errors[case.name] <= case.tolerance
    ]
    if failed:
        raise SystemExit("off by more than allowed: " + "; ".join(failed))


if __name__ == "__main__":
    main()
