"""The MEX export in Octave: right numbers where the help says they are, and clear errors."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from programs import needs

from trunk_ocp import Loads, load_anatomy, solve_statics
from trunk_ocp.codegen.check_cases import check_files
from trunk_ocp.codegen.formats import build_request
from trunk_ocp.codegen.mex import check_mex, write_mex
from trunk_ocp.codegen.request import CheckError, ToolMissingError
from trunk_ocp.codegen.run_checks import build_mex, run, run_octave

pytestmark = pytest.mark.slow

AT = (0.9, 1.75)
BUILT = ["trunk_shape.c", "trunk.c"]
# Another mesh and formulation, and numbers printed with 17 digits.
AGREEMENT = 1e-10
TRUNK = load_anatomy("asian-elephant")


def saved(request, folder):
    for name, content in files(request).items():
        (folder / name).write_text(content)
    return folder


@cache
def files(request):
    return write_mex(request) | check_files(request)


@cache
def request(what="jacobian", second=False):
    return build_request(TRUNK, "mex", what, AT, second, None, 1.2)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Folder of an export with everything, compiled."""
    folder = saved(request(second=True), tmp_path_factory.mktemp("mex"))
    said = build_mex(folder, "trunk_shape", ["-Wall", "-Wextra", *BUILT])
    assert "warning" not in said
    return folder


def octave(folder, code):
    """What a piece of Octave prints, as JSON."""
    (folder / "piece.m").write_text(code)
    return json.loads(run_octave(folder, "piece").strip().splitlines()[-1])


def error(folder, call):
    """Identifier and message of the error that a call ends with."""
    caught = f"try, {call}; said = {{'', ''}}; catch e, said = {{e.identifier, e.message}}; end"
    return octave(folder, f"{caught}\ndisp(jsonencode(said))")


def numbers(values):
    return "[" + " ".join(map(repr, np.asarray(values, float).tolist())) + "]"


# --- in its own environment ------------------------------------------------------------------


def test_shapes_and_both_derivatives_are_those_of_the_check_files(tmp_path):
    folder = saved(request(second=True), tmp_path)
    before = sorted(path.name for path in folder.iterdir())
    said = [line.split() for line in check_mex(folder).splitlines() if line.count(" ") == 2]
    kinds = {kind for kind, _, _ in said}
    assert kinds == {"loaded", "jacobian", "second", "unloaded", "unloaded_jacobian"}
    assert len(said) == 3 * 4 + 2 * 3
    assert max(float(share) for _, _, share in said) <= AGREEMENT
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.parametrize("name", ["check.csv", "check_unloaded.csv"])
def test_the_check_notices_one_wrong_number(name, tmp_path, unoptimized):
    folder = saved(request(), tmp_path)
    first, *rest = (folder / name).read_text().splitlines()
    values = first.split(",")
    values[-40] = repr(float(values[-40]) + 1e-3)
    (folder / name).write_text("\n".join([",".join(values), *rest]) + "\n")
    with pytest.raises(CheckError, match="some disagree"):
        check_mex(folder)


def test_the_example_runs(built):
    assert "Z = 1.75 m is at" in run_octave(built, "trunk_example")


def test_help_is_the_file_beside_it_with_the_muscles_in_order(tmp_path):
    said = run_octave(saved(request(), tmp_path), "help trunk_shape")
    assert "mkoctfile --mex trunk_shape.c trunk.c" in said
    assert " ".join(TRUNK.muscles[:3]) in said


# --- where numbers are -----------------------------------------------------------------------


def test_every_field_is_what_its_name_says(built):
    rng, Z = np.random.default_rng(5), np.array(AT)
    activation, head = -0.3 * rng.random(28), (0.2, -0.1)
    loads = Loads(9.0, (5.0, -3.0, 8.0), 1.2, (4.0, 2.0, -6.0), (1.0, -2.0, 0.5))
    given = (
        "struct('gravity', 9, 'tip_force', [5 -3 8], 'contact_force', [4; 2; -6], "
        "'contact_couple', [1 -2 0.5])"
    )
    call = f"trunk_shape({numbers(activation)}', {numbers(head)}, {given})"
    ours = octave(
        built,
        f"s = {call}; d = s.directors; s.directors = {{d(1, :, 2), d(2, :, 2), d(3, :, 2)}};\n"
        "disp(jsonencode(s))",
    )
    shape = solve_statics(TRUNK, activation, head, loads, near=None)
    shape = solve_statics(TRUNK, activation, head, loads, near=shape)
    assert ours["Z"] == list(AT)
    assert np.abs(np.transpose(ours["position"]) - shape.position(Z)).max() <= 1e-8  # its mesh
    rows = np.reshape(ours["directors"], (3, 3))
    assert np.abs(rows - shape.directors(Z)[1]).max() <= 1e-8
    moment = shape.moment(Z)
    assert np.abs(np.transpose(ours["moment"]) - moment).max() <= 1e-7 * np.abs(moment).max()
    assert np.shape(ours["strain"]) == (4, 2)


def test_the_last_dimension_of_a_derivative_is_that_of_the_named_inputs(built):
    names = octave(built, "disp(jsonencode(trunk_shape('inputs')))")
    assert names[:28] == list(TRUNK.muscles)
    muscle, force = names.index("R2-dl"), names.index("tip_force_Y")
    # Differences of order 4 with a step of 1e-3, and of 1 N on a trunk of stiffness 500 N.
    code = f"""
    a = -0.1 * ones(28, 1); e = zeros(28, 1); e({muscle + 1}) = 1e-3;
    tip = @(s) s.position(:, 2);
    bent = @(k) tip(trunk_shape(a + k * e));
    pulled = @(k) tip(trunk_shape(a, [], struct('tip_force', [0 k 0])));
    [~, J] = trunk_shape(a);
    slope = @(f, h) (8 * (f(1) - f(-1)) - (f(2) - f(-2))) / (12 * h);
    disp(jsonencode({{size(J.directors), slope(bent, 1e-3), J.position(:, 2, {muscle + 1}), ...
                      slope(pulled, 1), J.position(:, 2, {force + 1})}}))
    """
    size, bent, by_muscle, pulled, by_force = octave(built, code)
    assert size == [3, 3, 2, len(names)]
    assert np.abs(np.subtract(bent, by_muscle)).max() <= 1e-8 * np.abs(by_muscle).max()
    assert np.abs(np.subtract(pulled, by_force)).max() <= 1e-8 * np.abs(by_force).max()


def test_what_is_left_out_is_the_straight_head_and_the_trunks_own_weight(built):
    code = """
    a = -0.1 * ones(1, 28);
    whole = trunk_shape(a, [0 0], struct('gravity', 9.8, 'tip_force', [0 0 0]));
    less = {trunk_shape(a), trunk_shape(a', []), trunk_shape(a, [0; 0], []), ...
            trunk_shape(a, [], struct())};
    apart = cellfun(@(s) max(abs(s.position(:) - whole.position(:))), less);
    disp(jsonencode(apart))
    """
    assert max(octave(built, code)) <= 1e-12  # m; from another start


def test_an_unloaded_shape_is_that_of_statics_without_loads(built):
    activation = -0.2 * np.random.default_rng(6).random(28)
    call = f"trunk_shape('unloaded', {numbers(activation)}, [0.1 0.2])"
    ours = octave(built, f"disp(jsonencode({call}))")
    shape = solve_statics(TRUNK, activation, (0.1, 0.2), Loads(0.0))
    assert sorted(ours) == ["Z", "directors", "position", "strain"]
    assert np.abs(np.transpose(ours["position"]) - shape.position(np.array(AT))).max() <= 1e-8


# --- bad use ---------------------------------------------------------------------------------

GOOD = "-0.1 * ones(1, 28)"
FAULTS = {
    "trunk_shape()": ("usage", "expected activations"),
    "trunk_shape(zeros(1, 27))": ("input", "activation: has 27 values; expected 28"),
    "trunk_shape(single(zeros(1, 28)))": ("input", "activation: expected a full array"),
    f"trunk_shape([NaN, {GOOD}(2:28)])": ("input", "activation"),
    f"trunk_shape({GOOD}, [0 NaN])": ("input", "head: value 2 is not finite"),
    f"trunk_shape({GOOD}, [0 0 0])": ("input", "head: has 3 values; expected 2"),
    f"trunk_shape({GOOD}, [], 9.8)": ("input", "loads: expected a struct"),
    f"trunk_shape({GOOD}, [], struct('wind', 1))": ("input", "loads.wind: no such load"),
    f"trunk_shape({GOOD}, [], struct('tip_force', 1))": ("input", "tip_force: has 1 values"),
    f"trunk_shape({GOOD}, [], [], 1)": ("input", "direction: has 1 values"),
    "trunk_shape(-9 * ones(1, 28))": ("shape", "shorten"),
    f"[a, b, c] = trunk_shape({GOOD})": ("usage", "at most 2 outputs without a direction"),
    f"trunk_shape('unloaded', {GOOD}, [0 0], 1)": ("usage", "at most 2 inputs"),
    f"trunk_shape('twisted', {GOOD})": ("usage", "'unloaded'"),
}


@pytest.mark.parametrize(("call", "expected"), FAULTS.items(), ids=list(FAULTS))
def test_a_fault_is_told_and_the_next_call_works(call, expected, built):
    kind, message = expected
    identifier, said = error(built, call)
    assert identifier == f"trunk:{kind}"
    assert message in said
    assert error(built, f"trunk_shape({GOOD})") == ["", ""]


def test_an_export_of_shapes_says_that_it_has_no_derivatives(tmp_path, unoptimized):
    folder = saved(request("shape"), tmp_path)
    assert "loaded position" in check_mex(folder)
    build_mex(folder, "trunk_shape", BUILT)
    identifier, said = error(folder, f"[a, b] = trunk_shape({GOOD})")
    assert identifier == "trunk:usage"
    assert "exported without --what jacobian" in said


def test_a_trunk_without_contact_says_so(tmp_path, unoptimized):
    plain = request()
    plain = replace(plain, model=replace(plain.model, loads=Loads()))
    folder = saved(plain, tmp_path)
    assert "jacobian position" in check_mex(folder)
    build_mex(folder, "trunk_shape", BUILT)
    call = f"trunk_shape({GOOD}, [], struct('contact_force', [0 0 1]))"
    assert "exported without contact" in error(folder, call)[1]


def test_without_octave_there_is_the_line_that_installs_it(tmp_path, monkeypatch):
    folder = saved(request("shape"), tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ToolMissingError, match="apt-get install octave octave-dev"):
        check_mex(folder)


def test_octave_finds_no_fault_of_memory_under_valgrind(built):
    needs("valgrind")
    (built / "once.m").write_text(
        f"[s, J, d] = trunk_shape({GOOD}, [0.1 0], struct('gravity', 9), ones(1, 40));\n"
        f"[u, K] = trunk_shape('unloaded', {GOOD});\n"
    )
    watched = ["valgrind", "-q", "octave", "--no-gui", "--norc", "--quiet", "--eval", "once"]
    said = run(watched, built, HOME=str(built))
    assert "trunk_shape.c" not in said  # Octave itself has its own reports
    assert "trunk.c" not in said
