"""One trunk to export, with numbers to hold the exports against; and their check files."""

import importlib.util
import sys
from functools import cache

import numpy as np

from trunk_ocp.codegen.numpy_module import module_text
from trunk_ocp.codegen.request import Request
from trunk_ocp.codegen.shape_model import build_model, reference
from trunk_ocp.model.anatomy import load_anatomy
from trunk_ocp.model.loads import Loads
from trust.validation import rods

STEP = 1e-30  # of a complex step: nothing cancels, so it can be as small as one likes


@cache
def model():
    """The elephant, touched beyond 1.3 m, at its base, between two edges, and at its tip."""
    trunk = load_anatomy("asian-elephant")
    loads = Loads(contact_from=1.3)
    # Eight elements, as six leave 6e-10 in the directors of the hardest case below.
    return build_model(trunk, (0.0, 0.6, trunk.length), loads, elements=8)


def request(what="jacobian", **options):
    return Request(model(), what, "asian-elephant", **options)


@cache
def inputs(count=4):
    """Inputs x (count, 40): contractions, head angles and all kinds of loads."""
    layout, rng = model().layout, np.random.default_rng(0)
    x = rng.uniform(-1, 1, (count, layout.size))
    x[:, layout.inputs["activation"]] = rods.contractions(model().trunk, count, seed=3)
    x[:, layout.inputs["head"]] *= 0.3
    x[:, layout.inputs["gravity"]] = 9.8
    x[:, layout.inputs["tip_force"]] *= 40
    x[:, layout.inputs["contact_force"]] *= 40
    x[:, layout.inputs["contact_couple"]] *= 20
    return x


def load(folder, name, text=None):
    """A module of an export, as its user would import it; written first if there is text."""
    path = folder / f"{name}.py"
    if text is not None:
        path.write_text(text)
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    # A wrapper imports trunk_numpy from its own folder, and leaves other tests theirs.
    sys.modules.pop("trunk_numpy", None)
    sys.path.insert(0, str(folder))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(folder))
        sys.modules.pop("trunk_numpy", None)
    return module


def slopes(function, x):
    """Derivative (..., size) by complex steps of a function of x (..., size)."""
    columns = [function(x + STEP * 1j * e).imag / STEP for e in np.eye(x.shape[-1])]
    return np.stack(columns, axis=-1)


def agreement(got, wanted):
    """Largest difference of each part of a point's outputs, over its largest value."""
    assert got.shape == wanted.shape
    parts = [at for at in model().layout.outputs.values() if at.stop <= got.shape[2]]
    return [np.abs((got - wanted)[:, :, at]).max() / np.abs(wanted[:, :, at]).max() for at in parts]


def write_checks(folder, wanted=("jacobian", "second")):
    """Check files: shapes by another formulation, derivatives by complex steps.

    The functions stepped are those of the NumPy module, whose values have a test of their own.
    """
    numpy_module = load(folder, "stepped", module_text(request(second=True)))
    x, controls = inputs(), inputs()[:, : model().layout.controls]
    bare = np.where(np.arange(x.shape[1]) < controls.shape[1], x, 0)
    rows = [x, reference(model(), x)]
    unloaded = [controls, reference(model(), bare)[:, :, :16]]
    if "jacobian" in wanted:
        rows.append(slopes(numpy_module.loaded, x))
        unloaded.append(slopes(numpy_module.unloaded, controls))
    if "second" in wanted:
        v = np.random.default_rng(1).normal(size=x.shape)
        rows += [v, numpy_module.jacobian(x + STEP * 1j * v)[1].imag / STEP]
    for name, blocks in {"check": rows, "check_unloaded": unloaded}.items():
        table = np.concatenate([block.reshape(len(x), -1) for block in blocks], axis=1)
        np.savetxt(folder / f"{name}.csv", table, delimiter=",", fmt="%.17g")


def export(folder, files):
    """Write the files of an export."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        data = content if isinstance(content, bytes) else content.encode()
        (folder / name).write_bytes(data)
    return folder
