"""The ONNX model that is exported, run by onnxruntime."""

import shutil
import sys

import exported
import numpy as np
import onnx
import onnxruntime
import pytest
from filelock import FileLock

from trunk_ocp.codegen.model import reference
from trunk_ocp.codegen.onnx_model import check_onnx, write_onnx
from trunk_ocp.codegen.request import CheckError, ToolMissingError

DOUBLE, SINGLE = 1e-10, 1e-4  # promised agreement
NAMES = ["position", "directors", "strain"]


@pytest.fixture(scope="session")
def folders(tmp_path_factory):
    """Exports in double and single precision; building a graph takes ten seconds, so once."""
    root = tmp_path_factory.getbasetemp().parent / "onnx"
    with FileLock(f"{root}.lock"):
        for kind in ("double", "single"):
            if not (root / kind).exists():
                files = write_onnx(exported.request(single=kind == "single"))
                (root / kind).mkdir(parents=True)
                exported.export(root / kind, files)
                exported.write_checks(root / kind, ("jacobian",))
    return root


def session(folder):
    return onnxruntime.InferenceSession(folder / "trunk.onnx")


def feed(controls, kind=np.float64):
    return {"activation": controls[:, :28].astype(kind), "head": controls[:, 28:].astype(kind)}


@pytest.fixture(scope="module")
def controls():
    return exported.inputs()[:, : exported.model().layout.controls]


@pytest.mark.parametrize(("single", "tolerance"), [(False, DOUBLE), (True, SINGLE)])
def test_shapes_are_those_of_solve_statics_without_loads(folders, controls, single, tolerance):
    kind = np.float32 if single else np.float64
    model = session(folders / ("single" if single else "double"))
    parts = model.run(NAMES, feed(controls, kind))
    assert [part.dtype for part in parts] == 3 * [kind]
    assert parts[1].shape == (4, 3, 3, 3)
    x = np.hstack([controls, np.zeros((4, 10))])
    got = np.concatenate([part.reshape(4, 3, -1) for part in parts], axis=-1)
    assert max(exported.agreement(got, reference(exported.model(), x)[:, :, :16])) < tolerance


def test_one_model_takes_any_number_of_shapes(folders, controls):
    model = session(folders / "double")
    whole = model.run(None, feed(controls))
    alone = model.run(None, feed(controls[2:3]))
    for many, one in zip(whole, alone, strict=True):
        np.testing.assert_allclose(many[2:3], one, rtol=0, atol=1e-14)


def test_derivatives_at_rest_and_in_tiny_bends_are_finite(folders, controls):
    model = session(folders / "double")
    for scale in (0.0, 1e-300, 1e-20, 1e-8):
        for part in model.run(None, feed(scale * controls)):
            assert np.all(np.isfinite(part))


def test_the_file_says_what_it_is_and_is_valid(folders):
    model = onnx.load(folders / "double" / "trunk.onnx")
    onnx.checker.check_model(model, full_check=True)
    known = {entry.key: entry.value for entry in model.metadata_props}
    assert known["Z"] == "0.0, 0.6, 1.75"
    assert known["muscles"].split(", ") == list(exported.model().trunk.muscles)
    assert "The loaded trunk is not in here" in model.doc_string
    assert (folders / "double" / "README.txt").read_text() == model.doc_string
    assert model.graph.input[0].type.tensor_type.shape.dim[0].dim_param == "B"


@pytest.mark.parametrize("kind", ["double", "single"])
def test_the_export_checks_itself_and_notices_a_wrong_number(folders, tmp_path, kind):
    shutil.copytree(folders / kind, tmp_path / kind)
    assert "unloaded_jacobian" in check_onnx(tmp_path / kind)
    path = tmp_path / kind / "check_unloaded.csv"
    table = np.loadtxt(path, delimiter=",")
    table[0, -1] += 0.1
    np.savetxt(path, table, delimiter=",", fmt="%.17g")
    with pytest.raises(CheckError, match=r"unloaded_jacobian .*strain .*ABOVE"):
        check_onnx(tmp_path / kind)


def test_a_missing_package_is_named_with_the_line_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ndonnx", None)
    with pytest.raises(ToolMissingError, match=r"pip install 'trunk_ocp\[onnx\]'"):
        write_onnx(exported.request())
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ToolMissingError, match=r"pip install 'trunk_ocp\[onnx\]'"):
        check_onnx(tmp_path)
