"""What is promised to those who install: versions, required keys, license, a whole sdist."""

import ast
import inspect
import re
import tomllib
from pathlib import Path
from typing import Annotated, get_origin

import pytest
from pydantic.fields import FieldInfo

from trunk_ocp._support import toml_files as reading
from trunk_ocp._support.toml_files import Strict
from trunk_ocp.model import anatomy
from trunk_ocp.problem import problem_file

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
MODULES = (reading, anatomy, problem_file)


def floors(requirements):
    """Oldest version of each requirement that names one."""
    matches = (re.fullmatch(r"([\w-]+)>=([\d.]+)", each) for each in requirements)
    return {match[1]: match[2] for match in matches if match}


def padded(version):
    """Version of three numbers, as pip compares it."""
    return [*map(int, version.split(".")), 0, 0][:3]


def test_the_oldest_environment_has_the_floors_of_the_project():
    extras = PROJECT["project"]["optional-dependencies"]
    asked = floors(PROJECT["project"]["dependencies"])
    assert len(asked) == len(PROJECT["project"]["dependencies"])
    for name in ("fast", "jax", "notebook", "symbolic", "torch"):
        assert len(floors(extras[name])) == len(extras[name])
        asked |= floors(extras[name])
    lines = (ROOT / "requirements-oldest.txt").read_text().splitlines()
    pinned = dict(line.split("==") for line in lines if not line.startswith("#"))
    assert {n: padded(v) for n, v in pinned.items()} == {n: padded(v) for n, v in asked.items()}


def sections():
    """Every section of an input file."""
    found = {value for module in MODULES for value in vars(module).values() if is_section(value)}
    return sorted(found - {Strict}, key=lambda section: section.__name__)


def is_section(value):
    return isinstance(value, type) and issubclass(value, Strict)


# Sections made by a call, as a key is a keyword of Python; whether their keys are required.
MADE = {"_WithFrom": {"from": False}}


def has_default(value):
    """Whether what a key is set to in the source gives it a default."""
    if isinstance(value, ast.Call) and value.func.id == "Field":
        return any(keyword.arg in ("default", "default_factory") for keyword in value.keywords)
    return value is not None


@pytest.mark.parametrize("section", sections(), ids=lambda section: section.__name__)
def test_a_key_is_required_unless_the_source_gives_it_a_default(section):
    """With pydantic before 2.11.5, one key's default could become that of others."""
    written = {}
    for part in reversed(section.__mro__):
        if part.__name__ in MADE:
            written |= MADE[part.__name__]
        elif is_section(part) and part is not Strict:
            (body,) = ast.parse(inspect.getsource(part)).body
            keys = [node for node in body.body if isinstance(node, ast.AnnAssign)]
            written |= {key.target.id: not has_default(key.value) for key in keys}
    known = {name: field.is_required() for name, field in section.model_fields.items()}
    assert written == known


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.__name__)
def test_types_that_keys_share_hold_no_field(module):
    shared = {name: v for name, v in vars(module).items() if get_origin(v) is Annotated}
    assert len(shared) >= 1
    for name, kind in shared.items():
        assert not any(isinstance(part, FieldInfo) for part in kind.__metadata__), name


def test_the_sdist_has_a_license_and_all_that_tests_and_make_use():
    included = PROJECT["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]
    paths = [path for each in included for path in ROOT.glob(each.lstrip("/"))]
    assert all([*ROOT.glob(each.lstrip("/"))] for each in included)
    local = {path.name for path in ROOT.iterdir() if any(path.glob("*.py"))}
    read = {"docs", "problems", "LICENSE", "Makefile", "README.md", "requirements-oldest.txt"}
    assert {"trunk_ocp", "tests", "examples"} <= local
    assert local | read <= {path.name for path in paths}
    assert (ROOT / "trunk_ocp" / "py.typed").exists()
    assert all((ROOT / name).exists() for name in PROJECT["project"]["license-files"])
