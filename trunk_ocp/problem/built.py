"""Whether a motion is what its own spec builds, and so can be saved and read back as itself."""

from __future__ import annotations

from dataclasses import fields, is_dataclass

import numpy as np

from ..errors import InputError
from .motion import Motion, build_motion


def as_built(motion: Motion) -> bool:
    """Whether a motion is what its spec and anatomy build, and not changed by hand since."""
    try:
        built = build_motion(motion.spec, motion.anatomy)
    except InputError:
        return False
    names = ("trunk", "phases", "steps", "extension", "box")
    return all(_same(getattr(motion, name), getattr(built, name)) for name in names)


def _same(a: object, b: object) -> bool:
    """Equality of dataclasses and tuples with arrays in them."""
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and np.array_equal(a, b)
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    if is_dataclass(a) and type(a) is type(b):
        return all(_same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    return a == b
