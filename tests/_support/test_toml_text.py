"""TOML that is written is read back as it was."""

import tomllib

import pytest

from trunk_ocp._support.toml_files import read_toml
from trunk_ocp._support.toml_text import toml_text
from trunk_ocp.problem.build import problems_folder
from trunk_ocp.problem.problem_file import ProblemSpec
from trunk_ocp.problem.problem_text import problem_text


def test_values_of_all_kinds():
    table = {
        "name": 'a "quoted" \\ text\n\x7f é',
        "number": 1e-300,
        "whole": -3,
        "yes": True,
        "empty": [],
        "section": {"*1-dl": [1.0, 2.5], "inner": {}, "more keys": {"a": "b", "c": {"d": False}}},
        "list": [{"a": 1}, {"b": [{"c": 2}, {"c": 3}]}],
    }
    text = toml_text(table)
    assert tomllib.loads(text) == table
    assert "[section]" in text
    assert text.count("[[list]]") == 2


@pytest.mark.parametrize("path", sorted(problems_folder().glob("*.toml")), ids=lambda p: p.stem)
def test_a_problem_that_is_written_is_the_same_problem(path, tmp_path):
    spec = read_toml(path, ProblemSpec)
    copy = tmp_path / "copy.toml"
    copy.write_text(problem_text(spec))
    assert read_toml(copy, ProblemSpec) == spec
