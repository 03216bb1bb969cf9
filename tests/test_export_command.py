"""`trunk-ocp export`: every format proves itself, and bad use is told."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import trunk_ocp as to
from trunk_ocp import cli
from trunk_ocp.codegen.formats import FORMATS, check_export
from trunk_ocp.codegen.request import CheckError
from trunk_ocp.errors import InputError

SHAPES = [name for name, form in FORMATS.items() if not form.formulas]
PARTS = ("position", "directors", "strain", "moment")
FORMULAS = [name for name, form in FORMATS.items() if form.formulas]


def export(*arguments):
    return CliRunner().invoke(cli.main, ["export", *map(str, arguments)])


def needs(to):
    if to == "torch":
        pytest.importorskip("torch", reason="PyTorch is large; its export is checked where it is")


def errors(told):
    """Largest error of each part that a check printed."""
    lines = re.findall(r"^(\w[\w ]*?) +(\d\.\d+e[+-]\d+|0)$", told, re.MULTILINE)
    return {name: float(error) for name, error in lines}


@pytest.mark.parametrize("to", SHAPES)
def test_every_format_agrees_with_its_check_file_in_its_own_world(tmp_path, to):
    needs(to)
    result = export("asian-elephant", "--at", "0.9,1.75", "--to", to, "--out", tmp_path, "--check")
    assert result.exit_code == 0, result.output
    told = errors(result.output)
    free = {f"{kind} {part}" for kind in ("unloaded", "unloaded_jacobian") for part in PARTS[:3]}
    under_load = {f"{kind} {part}" for kind in ("loaded", "jacobian") for part in PARTS}
    wanted = free | (under_load if FORMATS[to].loaded else set())
    assert wanted <= {*told}
    assert max(told[name] for name in wanted) <= 1e-10


@pytest.mark.parametrize("to", ["c", "casadi", "mex"])
def test_the_programme_of_a_motion_agrees_with_its_check_file(tmp_path, to):
    arguments = ["lift-log", "--what", "constraints", "--to", to, "--out", tmp_path, "--check"]
    result = export(*arguments)
    assert result.exit_code == 0, result.output
    assert max(errors(result.output).values()) <= 1e-10
    assert (tmp_path / "layout.json").exists()


@pytest.mark.parametrize("to", FORMULAS)
def test_formulas_agree_with_the_numbers_of_their_muscle(tmp_path, to):
    result = export("asian-elephant", "--to", to, "--muscle", "R1-ovo", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    if to == "sympy":
        assert max(errors(check_export(tmp_path, to)).values()) <= 1e-10


def test_second_derivatives_are_in_the_export_on_request_only(tmp_path):
    for folder, more in (("without", []), ("with", ["--second"])):
        result = export("lift-log", "--to", "numpy", "--out", tmp_path / folder, "--check", *more)
        assert result.exit_code == 0, result.output
        assert ("second position" in result.output) == bool(more)


def test_an_export_that_disagrees_is_told_with_exit_code_3(tmp_path):
    arguments = ["asian-elephant", "--to", "casadi", "--out", tmp_path]
    assert export(*arguments).exit_code == 0
    rows = np.loadtxt(tmp_path / "check.csv", delimiter=",")
    rows[2, 34] += 1e-8  # one position, by a hundredth of a micrometre
    np.savetxt(tmp_path / "check.csv", rows, delimiter=",", fmt="%.17g")
    with pytest.raises(CheckError, match="ABOVE"):
        check_export(tmp_path, "casadi")


def test_a_check_that_does_not_end_well_is_told(tmp_path, monkeypatch):
    def refuse(folder, to, what):
        raise CheckError("position 1e-3 ABOVE 1e-10")

    monkeypatch.setattr("trunk_ocp.exporting.check_export", refuse)
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
        (["lift-log", "--what", "constraints", "--at", "1"], "which has its own points"),
        (["lift-log", "--what", "shape", "--second"], "expected with --what jacobian"),
        (["lift-log", "--muscle", "R1-dl"], "expected with --to sympy or latex"),
        (["lift-log", "--single"], "for --to onnx"),
        (["asian-elephant", "--contact-from", "1.75"], "expected 0 <= Z_w < L"),
    ],
)
def test_bad_use_is_told_and_nothing_is_written(tmp_path, arguments, told):
    result = export(*arguments, "--to", "casadi", "--out", tmp_path / "out")
    assert result.exit_code == 2
    assert told in " ".join(result.stderr.split())
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()


def test_what_a_format_does_not_carry_is_told_with_those_that_do():
    result = export("lift-log", "--what", "constraints", "--to", "onnx")
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
