"""What the documentation shows must work as shown."""

import re
from pathlib import Path

import trunk_ocp as to

ROOT = Path(__file__).parent.parent


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
