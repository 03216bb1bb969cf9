"""`trunk-ocp export`: every format passes its self-check, and bad use is reported."""

import hashlib
import json
import re
from pathlib import Path

import exported
import numpy as np
import pytest
from click.testing import CliRunner
from programs import needs

import trunk_ocp as to
from trunk_ocp.cli import commands
from trunk_ocp.codegen import casadi_function
from trunk_ocp.codegen.check_cases import cases, free_cases, resolved
from trunk_ocp.codegen.formats import FORMATS, check_export
from trunk_ocp.codegen.manifest import MANIFEST, NAMES
from trunk_ocp.codegen.numpy_module import module_text
from trunk_ocp.codegen.request import CheckError, Request
from trunk_ocp.codegen.shape_model import build_model
from trunk_ocp.errors import InputError
from trunk_ocp.model.activation import strains

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("unoptimized")]

SHAPES = [name for name, form in FORMATS.items() if not form.formulas]
PARTS = ("position", "directors", "strain", "moment")
FORMULAS = [name for name, form in FORMATS.items() if form.formulas]


def export(*arguments):
    return CliRunner().invoke(commands.main, ["export", *map(str, arguments)])


def can_check(to):
    """Skip the test where a format cannot be checked."""
    if to in ("jax", "torch"):
        pytest.importorskip(to, reason="JAX and PyTorch are large: make frameworks")
    needs(*{"c": ["cc"], "mex": ["mkoctfile"], "latex": ["pdflatex"]}.get(to, []))


def errors(told):
    """Largest error of each part that a check printed."""
    lines = re.findall(r"^(\w[\w ]*?) +(\d\.\d+e[+-]\d+|0)$", told, re.MULTILINE)
    return {name: float(error) for name, error in lines}


@pytest.mark.parametrize("to", SHAPES)
def test_every_format_agrees_with_its_check_file_in_its_own_environment(tmp_path, to):
    can_check(to)
    result = export("asian-elephant", "--at", "0.9,1.75", "--to", to, "--out", tmp_path, "--check")
    assert result.exit_code == 0, result.output
    told = errors(result.output)
    free = {f"{kind} {part}" for kind in ("unloaded", "unloaded_jacobian") for part in PARTS[:3]}
    wanted = free | {f"{kind} {part}" for kind in ("loaded", "jacobian") for part in PARTS}
    assert wanted <= {*told}
    assert max(told[name] for name in wanted) <= 1e-10
    assert {path.name for path in tmp_path.iterdir()} <= {*NAMES, MANIFEST}


def test_the_nlp_of_a_motion_agrees_with_its_check_file(tmp_path):
    needs("cc")
    arguments = ["lift-log", "--what", "constraints", "--to", "c", "--out", tmp_path, "--check"]
    result = export(*arguments)
    assert result.exit_code == 0, result.output
    assert max(errors(result.output).values()) <= 1e-10
    assert (tmp_path / "layout.json").exists()
    assert {path.name for path in tmp_path.iterdir()} <= {*NAMES, MANIFEST}


@pytest.mark.parametrize("to", FORMULAS)
def test_formulas_agree_with_the_numbers_of_their_muscle(tmp_path, to):
    result = export("asian-elephant", "--to", to, "--muscle", "R1-ovo", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    if to == "sympy":
        assert max(errors(check_export(tmp_path, to)).values()) <= 1e-10


def test_second_derivatives_are_in_the_export_on_request(tmp_path):
    result = export("lift-log", "--to", "numpy", "--out", tmp_path, "--check", "--second")
    assert result.exit_code == 0, result.output
    assert max(error for name, error in errors(result.output).items() if "second" in name) <= 1e-10


def test_an_export_that_disagrees_is_told_with_exit_code_3(tmp_path):
    arguments = ["asian-elephant", "--to", "casadi", "--out", tmp_path]
    assert export(*arguments).exit_code == 0
    rows = np.loadtxt(tmp_path / "check.csv", delimiter=",")
    rows[2, 34] += 1e-8  # one position, by a hundredth of a micrometer
    np.savetxt(tmp_path / "check.csv", rows, delimiter=",", fmt="%.17g")
    with pytest.raises(CheckError, match="ABOVE"):
        check_export(tmp_path, "casadi")


def test_a_check_that_does_not_end_well_is_told(tmp_path, monkeypatch):
    def refuse(folder, to, what):
        raise CheckError("position 1e-3 ABOVE 1e-10")

    monkeypatch.setattr("trunk_ocp.cli.export_model.check_export", refuse)
    result = export("asian-elephant", "--to", "casadi", "--out", tmp_path, "--check")
    assert result.exit_code == 3
    assert "does not pass its check" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["asian-elephant", "--at", "2"], "--at 2: expected points Z in m on the trunk"),
        (["asian-elephant", "--at", "0.9;1"], "expected numbers in m, such as 0.9,1.75"),
        (
            ["asian-elephant", "--at", ",".join(["0"] + [f"{i / 64}" for i in range(1, 66)])],
            "66 points",
        ),
        (["elephant"], "neither a file nor a shipped name"),
        (["asian-elephant", "--what", "constraints"], "expected a problem, not an anatomy"),
        (
            ["lift-log", "--what", "constraints", "--at", "1"],
            "whose points are those of its targets",
        ),
        (["lift-log", "--what", "shape", "--second"], "expected with --what jacobian"),
        (["lift-log", "--muscle", "R1-dl"], "expected with --to sympy or latex"),
        (["asian-elephant", "--contact-from", "1.75"], "expected 0 <= Z_w < L"),
    ],
)
def test_bad_use_is_told_and_nothing_is_written(tmp_path, arguments, told):
    result = export(*arguments, "--to", "casadi", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_format_by_another_name_is_suggested(tmp_path):
    result = export("lift-log", "--to", "C++", "--out", tmp_path)
    assert result.exit_code == 2
    assert "Did you mean c?" in result.stderr
    with pytest.raises(InputError, match=r"Did you mean torch\?"):
        check_export(tmp_path, "pytorch")


def test_what_a_format_does_not_carry_is_told_with_those_that_do():
    result = export("lift-log", "--what", "constraints", "--to", "numpy")
    assert result.exit_code == 2
    assert "--to c, casadi, mex" in result.stderr


def test_an_unknown_format_is_refused_by_the_function_too(trunk, tmp_path):
    with pytest.raises(InputError, match="Did you mean casadi"):
        to.export(trunk, "casady", tmp_path)


def test_a_problem_brings_its_contact_region_and_gravity(tmp_path):
    assert export("lift-log", "--to", "casadi", "--out", tmp_path).exit_code == 0
    told = (tmp_path / "README.txt").read_text()
    assert "Contact from Z = 1.4 m." in told
    assert "x, 40 numbers" in told


def test_an_anatomy_file_of_ones_own_is_exported(tmp_path, trunk):
    shipped = Path(to.__file__).parent / "data" / "anatomies" / "asian-elephant.toml"
    path = tmp_path / "mine.toml"
    path.write_text(shipped.read_text().replace('name = "asian-elephant"', 'name = "mine"'))
    assert export(path, "--to", "casadi", "--out", tmp_path / "out").exit_code == 0
    assert "'mine'" in (tmp_path / "out" / "README.txt").read_text()


def test_check_files_reach_both_sides_of_the_kernels_switch(trunk):
    """Series below theta = 1 rad in an element, closed forms beyond."""
    model = resolved(build_model(trunk))
    strain = strains(trunk, free_cases(model)[:, :28])[:, model.tables.segment]
    theta = strain[..., 0] * np.linalg.norm(strain[..., 1:], axis=-1) * model.tables.piece[:, 0]
    sharpest = theta.max(axis=1)
    assert np.any((sharpest > 0.5) & (sharpest < 1))
    assert np.any((sharpest > 1) & (sharpest < 1.2))
    assert sharpest.max() > 2.5
    loaded = strains(trunk, cases(model)[:, :28])[:, model.tables.segment]
    turned = loaded[..., 0] * np.linalg.norm(loaded[..., 1:], axis=-1) * model.tables.piece[:, 0]
    assert turned.max() > 1


def test_a_wrong_closed_form_does_not_pass_the_check(tmp_path):
    assert export("asian-elephant", "--to", "numpy", "--out", tmp_path).exit_code == 0
    path = tmp_path / "trunk_numpy.py"
    driver, turns = path.read_text().split("def turn_slopes")
    turns = turns.replace("xp.cos(", "1.01 * xp.cos(")
    path.write_text(f"{driver}def turn_slopes{turns}")
    with pytest.raises(CheckError, match=r"unloaded .*ABOVE"):
        check_export(tmp_path, "numpy")


def test_a_shape_that_bends_too_sharply_for_its_mesh_is_refused_and_more_elements_give_it(
    tmp_path, trunk
):
    force = (-6000.0, 2000.0, -8000.0)  # N, nine times the trunk's weight
    activation = np.array([-0.6 if muscle.endswith("dl") else 0.0 for muscle in trunk.muscles])
    modules = {}
    for elements in (6, 40):
        request = Request(build_model(trunk, elements=elements), "shape", trunk.name)
        modules[elements] = exported.load(tmp_path, "trunk_numpy", module_text(request))
    x = modules[6].pack(activation, tip_force=force)
    with pytest.raises(modules[6].NoShape, match="bends too sharply"):
        modules[6].loaded(x)
    with pytest.raises(RuntimeError):
        casadi_function.loaded(build_model(trunk))(x)
    tip = modules[40].loaded(x)[0, :3]
    shape = to.solve_statics(trunk, activation, loads=to.Loads(tip_force=force))
    np.testing.assert_allclose(tip, shape.position([trunk.length])[0], atol=1e-6)


def test_a_second_export_leaves_nothing_of_the_first_behind(tmp_path):
    assert export("asian-elephant", "--to", "casadi", "--out", tmp_path).exit_code == 0
    assert (
        export("asian-elephant", "--to", "c", "--what", "shape", "--out", tmp_path).exit_code == 0
    )
    assert not [*tmp_path.glob("*.casadi")]
    assert not (tmp_path / "README.txt").exists()


def test_a_file_of_the_users_own_is_not_overwritten(tmp_path):
    (tmp_path / "CMakeLists.txt").write_text("mine")
    result = export("asian-elephant", "--to", "c", "--out", tmp_path)
    assert result.exit_code == 2
    assert "CMakeLists.txt: exists and is not as an export wrote it" in result.stderr
    assert (tmp_path / "CMakeLists.txt").read_text() == "mine"
    assert not (tmp_path / "trunk.c").exists()


# --- folders with other files ------------------------------------------------------------


def told_and_kept(folder, before):
    """Refused by name, with every file as it was."""
    result = export("asian-elephant", "--to", "c", "--what", "shape", "--out", folder)
    assert result.exit_code == 2, result.output
    assert "not as an export wrote it" in result.stderr
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def manifest(files, **changes):
    """An export.json as an export writes it."""
    return json.dumps({"made_by": "trunk-ocp export", "files": files, **changes})


@pytest.mark.parametrize(
    "claim",
    [
        json.dumps({"files": ["thesis.docx", "export.json"]}),
        manifest({"thesis.docx": hashlib.sha256(b"mine").hexdigest()}, made_by="me"),
        "[1, 2]",
        "[" * 50_000,
        "null",
        "",
    ],
    ids=["list", "another program", "no table", "deep", "null", "empty"],
)
def test_a_manifest_that_no_export_wrote_is_refused_and_kept(tmp_path, claim):
    (tmp_path / "thesis.docx").write_text("mine")
    (tmp_path / "export.json").write_text(claim)
    told_and_kept(tmp_path, {"thesis.docx": b"mine", "export.json": claim.encode()})


def test_a_forged_manifest_deletes_nothing(tmp_path):
    """Not by a hash that is right, nor by a path out of the folder, nor through a link."""
    outside, folder = tmp_path / "check.csv", tmp_path / "out"
    folder.mkdir()
    mine = {"thesis.docx": b"mine", "__init__.py": b"", "solve.py": b"changed"}
    for name, content in mine.items():
        (folder / name).write_bytes(content)
    outside.write_text("mine")
    (folder / "rows.csv").symlink_to(outside)
    digest = hashlib.sha256(b"mine").hexdigest()
    hashes = dict.fromkeys(("thesis.docx", "../check.csv", str(outside), "rows.csv"), digest)
    hashes |= {"__init__.py": hashlib.sha256(b"").hexdigest(), "solve.py": digest, "trunk.c": 3}
    (folder / "export.json").write_text(manifest(hashes))
    result = export("asian-elephant", "--to", "casadi", "--what", "shape", "--out", folder)
    assert result.exit_code == 0, result.output
    assert {name: (folder / name).read_bytes() for name in mine} == mine
    assert outside.read_text() == "mine"
    assert (folder / "rows.csv").is_symlink()


def test_an_export_of_version_0_1_is_replaced_where_it_is_unchanged(tmp_path):
    old = {"programme.c": b"/* the NLP */", "trunk.onnx": b"\x08", "programme.h": b"edited since"}
    for name, content in old.items():
        (tmp_path / name).write_bytes(content)
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in old.items()}
    hashes["programme.h"] = hashlib.sha256(b"as exported").hexdigest()
    (tmp_path / "export.json").write_text(manifest(hashes))
    result = export("asian-elephant", "--to", "casadi", "--what", "shape", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert [name for name in old if (tmp_path / name).exists()] == ["programme.h"]


def test_an_export_that_was_edited_is_not_overwritten(tmp_path):
    again = ["asian-elephant", "--to", "c", "--what", "shape", "--out", tmp_path]
    assert export(*again).exit_code == 0
    assert export(*again).exit_code == 0
    with (tmp_path / "example.c").open("a") as stream:
        stream.write("/* my own work */")
    told_and_kept(tmp_path, {path.name: path.read_bytes() for path in tmp_path.iterdir()})


@pytest.mark.parametrize("kind", ["link", "dangling", "folder"])
def test_what_is_no_plain_file_is_in_the_way(tmp_path, kind):
    folder, outside = tmp_path / "out", tmp_path / "outside.c"
    folder.mkdir()
    if kind == "folder":
        (folder / "trunk.c").mkdir()
    else:
        (folder / "trunk.c").symlink_to(outside)
    if kind == "link":
        outside.write_text("mine")
    result = export("asian-elephant", "--to", "c", "--what", "shape", "--out", folder)
    assert result.exit_code == 2, result.output
    assert "trunk.c: exists" in result.stderr
    assert [path.name for path in folder.iterdir()] == ["trunk.c"]
    assert not outside.exists() or outside.read_text() == "mine"


def test_a_check_runs_nothing_else_that_is_in_the_folder(tmp_path):
    (tmp_path / "numpy.py").write_text("raise SystemExit('ran what was there')")
    result = export("asian-elephant", "--to", "numpy", "--out", tmp_path, "--check")
    assert result.exit_code == 0, result.output
    assert "all agree" in result.output
    assert not (tmp_path / "__pycache__").exists()
