"""What the documentation shows must work as shown."""

import re
import tomllib
from pathlib import Path

import pytest

import trunk_ocp as to
from trunk_ocp.cli.commands import main, solve
from trunk_ocp.planning.results_folder import OF_PLAN, OF_RUN

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
FRONT = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"]
PAGES = [*FRONT, *(str(p.relative_to(ROOT)) for p in sorted((ROOT / "docs").rglob("*.md")))]
PAGES = [page for page in PAGES if "_build" not in page]


def page(name):
    return (ROOT / name).read_text()


def blocks(text, language):
    """Contents of the fenced blocks that begin with a word or directive."""
    return re.findall(rf"```{re.escape(language)}[^\n]*\n(.*?)```", text, re.DOTALL)


def anchors(text):
    """Anchors of the headings of a page, as GitHub and the site make them."""
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


# --- links and files ---------------------------------------------------------------------


@pytest.mark.parametrize("name", PAGES)
def test_every_link_to_a_file_of_this_project_leads_to_one(name):
    broken = []
    for link in re.findall(r"\]\(([^)\s]+)\)", page(name)):
        if link.startswith(("http", "mailto:")):
            continue
        path, _, anchor = link.partition("#")
        target = (ROOT / name).parent / path if path else ROOT / name
        if not target.exists() or (anchor and anchor not in anchors(target.read_text())):
            broken.append(link)
    assert not broken


@pytest.mark.parametrize("name", PAGES)
def test_every_file_of_the_package_that_a_page_names_exists(name):
    named = re.findall(r"`((?:trunk_ocp|tests|problems|docs|trust)/[\w./-]*)`", page(name))
    assert not [path for path in named if not (ROOT / path).exists()]


def test_what_the_architecture_page_says_to_look_for_is_in_that_file():
    rows = re.findall(
        r"^\| .* \| `(trunk_ocp/\S+)` \| (.+) \|$", page("docs/architecture.md"), re.M
    )
    assert len(rows) > 15
    missing = [
        (path, word)
        for path, words in rows
        for word in re.findall(r"`(\w+)`", words)
        if not re.search(rf"\b{word}\b", (ROOT / path).read_text())
    ]
    assert not missing


def test_every_layer_is_on_the_architecture_page():
    folders = {path.parent.name for path in (ROOT / "trunk_ocp").glob("*/__init__.py")}
    text = page("docs/architecture.md")
    assert not [name for name in folders if f"`{name}/`" not in text]


# --- commands and result files -------------------------------------------------------------


@pytest.mark.parametrize("name", PAGES)
def test_every_command_and_option_that_a_page_shows_exists(name):
    known = {command: main.get_command(None, command) for command in main.list_commands(None)}
    known["solve-motion"] = solve
    shown = re.findall(r"(?:trunk-ocp (\w+)|(solve-motion))((?: [^\s`#|]+)*)", page(name))
    wrong = []
    for verb, plain, words in shown:
        command = known.get(plain or verb)
        options = {name for p in command.params for name in p.opts} if command else set()
        options |= {"--help", "--version"}
        used = re.findall(r"(?<= )--[\w-]+", words)
        wrong += [verb or plain] * (command is None) + [o for o in used if o not in options]
    assert not [word for word in wrong if word not in ("NAME", "VERB")]


@pytest.mark.parametrize("name", ["README.md", "docs/reference/results.md"])
def test_result_files_that_a_table_names_are_written_by_this_program(name):
    named = re.findall(r"^\| `(?:MODE/)?([\w-]+\.\w+)`", page(name), re.MULTILINE)
    known = {"summary.json", "activations.csv", "solution.nc", "source.json", "resume.npz"}
    known |= {"trunk.html"}  # in a folder of its own
    patterns = [OF_PLAN["."], OF_RUN["."]]
    assert "summary.json" in named
    assert not [n for n in named if n not in known and not any(p.fullmatch(n) for p in patterns)]


# --- examples ------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_documented_motion_is_solved(tmp_path):
    (block,) = blocks(page("docs/how-to/new-motion.md"), "{file} scratch.toml")
    path = tmp_path / "scratch.toml"
    path.write_text(block)
    plan = to.plan_motion(to.load_motion(path))
    assert plan.status is to.Status.SOLVED
    assert len(plan.x) == 6


def test_the_documented_obstacles_fit_the_documented_motion(tmp_path):
    text = page("docs/how-to/new-motion.md")
    (motion,) = blocks(text, "{file} scratch.toml")
    (obstacles,) = (block for block in blocks(text, "toml") if "[[obstacles]]" in block)
    path = tmp_path / "scratch.toml"
    path.write_text(motion + obstacles)
    loaded = to.load_motion(path)
    assert loaded.contact == {"self", "head", "log", "obstacles"}
    names = [
        [solid.name for solid in step.solids if solid.group == "obstacles"] for step in loaded.steps
    ]
    assert names == [["post", "ground"]] + 5 * [["post", "ground", "crate"]]


def test_every_other_problem_in_the_documentation_is_read(tmp_path):
    shown = [
        block
        for name in PAGES
        for block in blocks(page(name), "{file} ")
        if "phases" in tomllib.loads(block)
    ]
    assert len(shown) > 2
    for number, block in enumerate(shown):
        path = tmp_path / f"{number}.toml"
        path.write_text(block)
        assert to.load_motion(path).steps


@pytest.mark.slow
def test_what_the_readme_shows_in_python_runs(tmp_path, monkeypatch):
    (block,) = blocks(page("README.md"), "python")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(block, names)
    assert names["plan"].status is to.Status.SOLVED
    assert names["dr"].shape == (3, 30)
    assert (tmp_path / "results" / "mine" / "solution.nc").exists()


FAILURES = {
    "MISSED": ["activation = [-0.1, 0.0]"],
    "UNSTABLE": ["loads.tip_force = [0.0, 0.0, -600.0]"],
    "UNVERIFIED": ["loads.tip_force = [0.0, 0.0, 200000.0]"],
    "INFEASIBLE": [
        "bounds.head_z_deg = [10.0, 20.0]",
        "change = [{ head_z_deg = [-4.0, 4.0] }]",
    ],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FAILURES)
def test_what_fails_in_the_documentation_fails_with_that_status(tmp_path, name):
    """What `explain` says of it is made when the documentation is built."""
    text = page("docs/how-to/when-it-fails.md")
    (block,) = blocks(text, "{file} reach.toml")
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

    assert to.explain(plan).findings


def test_every_status_has_a_section():
    sections = re.findall(r"^## (\w+): (.*)$", page("docs/how-to/when-it-fails.md"), re.MULTILINE)
    assert dict(sections) == {status.name: status.value for status in to.Status}


# --- citation ------------------------------------------------------------------------------


def test_the_citation_is_that_of_the_readme():
    text, front = page("CITATION.cff"), page("README.md")
    (doi,) = re.findall(r"^  doi: (\S+)$", text, re.MULTILINE)
    assert f"https://doi.org/{doi}" in front
    assert not [n for n in re.findall(r"family-names: (\w+)", text) if n not in front]
