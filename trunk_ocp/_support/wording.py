"""Numbers in sentences."""

from __future__ import annotations


def rounded(value: float, digits: int = 2) -> str:
    """A number to some digits, up to a million without a power of ten: 180, not 1.8e+02."""
    short = f"{value:.{digits}g}"
    return f"{float(short):g}" if abs(value) < 1e6 else short
