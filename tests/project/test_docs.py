"""What the documentation shows must work as shown."""

import re
from pathlib import Path

import pytest

import trunk_ocp as to

ROOT = Path(__file__).parents[2]


def test_the_documented_motion_is_solved(tmp_path):
    text = (ROOT / "docs" / "new-motion.md").read_text()
    (block,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    path = tmp_path / "scratch.toml"
    path.write_text(block)
    plan = to.plan_motion(to.load_motion(path))
    assert plan.status is to.Status.SOLVED
    assert len(plan.x) == 6


def test_the_documented_keys_are_those_of_the_format():
    text = (ROOT / "docs" / "new-motion.md").read_text()
    schema = to.problem_schema()
    known = {key for part in schema["$defs"].values() for key in part["properties"]}
    known |= set(schema["properties"])
    shown = {key for key in known if re.search(rf"\b{key}\b", text)}
    missing = known - shown - {"phases", "targets", "wrap", "loads"}
    assert not missing


def test_what_the_readme_shows_in_python_runs(tmp_path, monkeypatch):
    text = (ROOT / "README.md").read_text()
    (block,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(block, names)
    assert names["plan"].status is to.Status.SOLVED
    assert names["shapes"].found.all()
    assert (tmp_path / "results" / "mine" / "solution.nc").exists()


FAILURES = {
    "MISSED": ["activation = [-0.1, 0.0]"],
    "UNSTABLE": ["loads.tip_force = [0.0, 0.0, -600.0]"],
    "UNVERIFIED": ["loads.tip_force = [0.0, 0.0, 500000.0]"],
    "INFEASIBLE": [
        "bounds.head_z_deg = [10.0, 20.0]",
        "change = [{ head_z_deg = [-4.0, 4.0] }]",
    ],
}


@pytest.mark.parametrize("name", FAILURES)
def test_what_fails_in_the_documentation_fails_as_shown(tmp_path, name):
    """Status, findings and advice; line breaks aside."""
    text = (ROOT / "docs" / "when-it-fails.md").read_text()
    (block,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    for line in FAILURES[name]:
        assert f"`{line}`" in text
        old = "activation = [-3.0, 0.0]" if line.startswith("activation") else "duration = 1.0"
        block = block.replace(old, line if old[0] == "a" else f"{old}\n{line}")
    path = tmp_path / "reach.toml"
    path.write_text(block)
    plan = to.plan_motion(to.load_motion(path), throw=False)
    assert plan.status is to.Status[name]
    (section,) = re.findall(rf"## {name}: (.*?)(?=\n## )", text, re.DOTALL)
    assert section.startswith(plan.status.value)
    (shown,) = re.findall(r"```\n(.*?)```", section, re.DOTALL)
    told = to.explain(plan).findings
    said = " ".join(" ".join((f.what, *f.details, f.advice)) for f in told).split()
    numbers = re.compile(r"-?\d[\d.]*")
    said_words = {numbers.sub("#", word) for word in said}
    words = numbers.sub("#", shown.replace("failure: ", "")).split()
    assert not [word for word in words if word not in said_words]


def test_every_status_has_a_section():
    text = (ROOT / "docs" / "when-it-fails.md").read_text()
    sections = re.findall(r"^## (\w+): (.*)$", text, re.MULTILINE)
    assert dict(sections) == {status.name: status.value for status in to.Status}
