"""Compares an export with its check files; prints the largest error of each part of the shape."""

import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
PARTS = {"position": 3, "directors": 9, "strain": 4, "moment": 3}


def columns(name, *sizes):
    """The rows of a check file, cut into pieces of these sizes; those that it has."""
    rows = np.loadtxt(HERE / name, delimiter=",", ndmin=2)
    ends = [end for end in np.cumsum(sizes) if end <= rows.shape[1]]
    return np.split(rows, ends, axis=1)[: len(ends)]


def compare(title, value, expected, width=1, numbers=19, bar=1e-10):
    """Whether a value agrees with what is expected: shapes y (width 1) or derivatives of them.

    An error is relative to the largest value of its part, unless all of it is 0 but for round-off.
    """
    shape = (len(expected), -1, numbers, width)
    value, expected = np.reshape(value, shape), np.reshape(expected, shape)
    good, start = True, 0
    for part, size in PARTS.items():
        a, b = value[:, :, start : start + size], expected[:, :, start : start + size]
        start += size
        if b.size:
            largest = np.abs(b).max()
            error = np.abs(a - b).max() / (largest if largest > 1e-9 else 1.0)
            good = good and bool(error <= bar)
            print(f"{title} {part} {error:.1e}")
    return good


def end(*good):
    """Leave with what a program that asks for it understands: 0 if all agree."""
    print("all agree" if all(good) else "some DISAGREE")
    sys.exit(0 if all(good) else 1)
