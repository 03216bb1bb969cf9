"""The ONNX model that is exported, run by onnxruntime."""

import sys
from functools import cache

import exported
import numpy as np
import onnx
import onnxruntime
import pytest

from trunk_ocp.codegen.model import reference
from trunk_ocp.codegen.onnx_model import check_onnx, write_onnx
from trunk_ocp.codegen.request import CheckError, ToolMissingError

DOUBLE, SINGLE = 1e-10, 1e-4  # the promise of issue 7
NAMES = ["position", "directors", "strain"]


@cache
def files(**options):
    """The export; building the graph takes some seconds."""
    return write_onnx(exported.request(**options))


@cache
def session(**options):
    return onnxruntime.InferenceSession(files(**options)["trunk.onnx"])


def feed(controls, kind=np.float64):
    return {"activation": controls[:, :28].astype(kind), "head": controls[:, 28:].astype(kind)}


@pytest.fixture(scope="module")
def controls():
    return exported.inputs()[:, : exported.model().layout.controls]


@pytest.mark.parametrize(("single", "bar"), [(False, DOUBLE), (True, SINGLE)])
def test_shapes_are_those_of_solve_statics_without_loads(controls, single, bar):
    kind = np.float32 if single else np.float64
    model = session(single=True) if single else session()
    parts = model.run(NAMES, feed(controls, kind))
    assert [part.dtype for part in parts] == 3 * [kind]
    assert parts[1].shape == (4, 3, 3, 3)
    x = np.hstack([controls, np.zeros((4, 10))])
    got = np.concatenate([part.reshape(4, 3, -1) for part in parts], axis=-1)
    assert max(exported.agreement(got, reference(exported.model(), x)[:, :, :16])) < bar


def test_a_shape_export_has_no_jacobian():
    assert [output.name for output in session(what="shape").get_outputs()] == NAMES


def test_one_model_takes_any_number_of_shapes(controls):
    model = session()
    whole = model.run(None, feed(controls))
    alone = model.run(None, feed(controls[2:3]))
    for many, one in zip(whole, alone, strict=True):
        np.testing.assert_allclose(many[2:3], one, rtol=0, atol=1e-14)


def test_derivatives_at_rest_and_in_tiny_bends_are_finite(controls):
    for scale in (0.0, 1e-300, 1e-20, 1e-8):
        for part in session().run(None, feed(scale * controls)):
            assert np.all(np.isfinite(part))


def test_the_file_says_what_it_is_and_is_valid():
    model = onnx.load_from_string(files()["trunk.onnx"])
    onnx.checker.check_model(model, full_check=True)
    known = {entry.key: entry.value for entry in model.metadata_props}
    assert known["Z"] == "0.0, 0.6, 1.75"
    assert known["muscles"].split(", ") == list(exported.model().trunk.muscles)
    assert "The loaded trunk is not in here" in model.doc_string
    assert files()["README.txt"] == model.doc_string
    assert model.graph.input[0].type.tensor_type.shape.dim[0].dim_param == "B"


@pytest.mark.parametrize("single", [False, True])
def test_the_export_checks_itself_and_notices_a_wrong_number(tmp_path, single):
    exported.export(tmp_path, files(single=single) if single else files())
    exported.write_checks(tmp_path, ("jacobian",))
    assert "unloaded_jacobian" in check_onnx(tmp_path)
    table = np.loadtxt(tmp_path / "check_unloaded.csv", delimiter=",")
    table[0, -1] += 0.1
    np.savetxt(tmp_path / "check_unloaded.csv", table, delimiter=",", fmt="%.17g")
    with pytest.raises(CheckError, match=r"unloaded_jacobian .*strain .*ABOVE"):
        check_onnx(tmp_path)


def test_a_missing_package_is_named_with_the_line_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ndonnx", None)
    with pytest.raises(ToolMissingError, match=r"pip install 'trunk_ocp\[onnx\]'"):
        write_onnx(exported.request())
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ToolMissingError, match=r"pip install 'trunk_ocp\[onnx\]'"):
        check_onnx(tmp_path)
