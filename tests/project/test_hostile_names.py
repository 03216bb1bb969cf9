"""Names from files in exports and on the page: hostile ones are refused, or stay mere text.

What is generated is parsed, not run, and has to be the same program as with a harmless name.
"""

import ast
import html.parser
import re
import subprocess
from dataclasses import replace
from functools import lru_cache

import pytest
from click.testing import CliRunner
from hostile import HOSTILE, ORDINARY
from hypothesis import example, given, settings
from hypothesis import strategies as st
from plans import TOUCH
from programs import needs

import trunk_ocp as to
from trunk_ocp.cli import commands
from trunk_ocp.codegen import escaping
from trunk_ocp.codegen.formats import FORMATS
from trunk_ocp.codegen.formulas import check_latex
from trunk_ocp.codegen.manifest import NAMES
from trunk_ocp.codegen.request import Request
from trunk_ocp.codegen.run_checks import STRICT
from trunk_ocp.codegen.shape_model import build_model
from trunk_ocp.errors import InputError
from trunk_ocp.figures import style
from trunk_ocp.model.anatomy import AnatomySpec, Trunk, anatomies_folder
from trunk_ocp.viewer.bundle import bundled

pytestmark = pytest.mark.slow

texts = given(st.text(st.characters(codec=None, exclude_categories=[]), max_size=60))


@pytest.fixture(scope="module")
def named(build):
    """Maker of a small trunk with a name, which its muscles have, too."""
    muscle = {"group": "dl", "architecture": "longitudinal", "radii_over_length": (0.01, 0.04)}
    muscles = ({**muscle, "sector": (0.5, 1.5)},)
    trunk = build(({"Z_over_length": (0.0, 1.0), "muscles": muscles},), taper_deg=1.0)

    def make(name: str, muscle: str | None = None) -> Trunk:
        own = [replace(each, name=f"{each.side}{muscle or name}") for each in trunk.subdomains]
        return replace(trunk, name=name, subdomains=tuple(own))

    return make


@pytest.fixture(scope="module")
def written(named):
    """Writer of the text files of an export of a trunk with a name."""

    def write(form: str, name: str) -> dict[str, str]:
        trunk = named(name)
        request = Request(build_model(trunk), "shape", name, muscle=trunk.muscles[0])
        return FORMATS[form].write(request)

    return write


@lru_cache(maxsize=16)  # most files do not have the name
def program(source: str) -> str:
    """Python source as its syntax tree, with every text in it the same."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            node.value = ""
    return ast.dump(tree)


# --- generated sources -------------------------------------------------------------------


@pytest.mark.parametrize("form", ["numpy", "jax", "torch", "sympy"])
def test_a_python_module_is_the_same_program_whatever_the_name(written, form):
    harmless = {
        file: program(text) for file, text in written(form, "trunk").items() if file.endswith(".py")
    }
    names = [*HOSTILE.values()]
    for name in (
        names if form in ("numpy", "sympy") else names[:2]
    ):  # the others have NumPy's module
        files = written(form, name)
        modules = {file: text for file, text in files.items() if file.endswith(".py")}
        assert len(modules) >= 2
        for file, text in modules.items():
            assert program(text) == harmless[file]
        if form == "sympy":
            assert constant(files["trunk_formulas.py"], "ANATOMY") == name
        else:
            assert constant(files["trunk_numpy.py"], "MUSCLES") == (f"R{name}", f"L{name}")


def constant(source, name):
    """Value that a module gives to a name."""
    assigned = [node for node in ast.parse(source).body if isinstance(node, ast.Assign)]
    (value,) = (n.value for n in assigned if getattr(n.targets[0], "id", "") == name)
    return ast.literal_eval(value)


def test_c_compiles_without_a_warning_whatever_the_name(written, tmp_path):
    needs("cc")
    sources = []
    for number, name in enumerate(HOSTILE.values()):
        folder = tmp_path / str(number)
        folder.mkdir()
        for file, text in written("c", name[: escaping.MAX_NAME]).items():
            (folder / file).write_text(text, encoding="utf-8")
        sources.append(str(folder / "trunk.c"))
    ended = subprocess.run(
        ["cc", *STRICT, "-fsyntax-only", *sources], capture_output=True, text=True, check=False
    )
    assert len(sources) == len(HOSTILE)
    assert (ended.returncode, ended.stderr) == (0, "")


def test_c_has_the_names_as_they_are(tmp_path):
    """A program prints what the literals hold."""
    needs("cc")
    names = [name.replace("\x00", "") for name in HOSTILE.values() if name.isprintable()]
    literals = ", ".join(escaping.c_literal(name) for name in names)
    text = f"#include <stdio.h>\nint main(void)\n{{\n    const char *names[] = {{{literals}}};\n"
    text += f"    for (int i = 0; i < {len(names)}; i++) puts(names[i]);\n    return 0;\n}}\n"
    (tmp_path / "names.c").write_text(text, encoding="ascii")
    flags = [*STRICT, "-Wno-overlength-strings", "names.c", "-o", "names"]
    subprocess.run(["cc", *flags], cwd=tmp_path, check=True)
    said = subprocess.run([tmp_path / "names"], capture_output=True, check=True).stdout
    assert said.decode().splitlines() == names


def test_help_of_a_mex_file_is_comments_alone(written):
    def code(name):
        lines = written("mex", name)["trunk_shape.m"].splitlines()
        return [line for line in lines if not line.startswith("% ")]

    for name in HOSTILE.values():
        assert code(name) == code("trunk")


def test_a_latex_page_differs_by_the_name_alone(written):
    harmless = written("latex", "trunk")["trunk_formulas.tex"]
    for name in (
        HOSTILE[key] for key in ("latex", "line ends", "scripts", "template", "long word")
    ):
        text = written("latex", name)["trunk_formulas.tex"]
        shown = escaping.in_latex(name)
        wanted = harmless.replace("Rtrunk", escaping.in_latex(f"R{name}"))
        wanted = wanted.replace("of trunk:", f"of {shown}:").replace("(trunk)", f"({shown})")
        assert text == wanted
        assert text.isascii()


@pytest.mark.parametrize("name", [ORDINARY, HOSTILE["latex"], HOSTILE["scripts"], "W" * 200])
def test_latex_takes_a_page_with_any_name(named, tmp_path, name):
    needs("pdflatex")
    trunk = named(name, "1-dl")
    request = Request(build_model(trunk), "shape", name, muscle=trunk.muscles[0])
    for file, text in FORMATS["latex"].write(request).items():
        (tmp_path / file).write_text(text)
    assert "compile" in check_latex(tmp_path)


@settings(deadline=None)
@texts
@example(HOSTILE["python"])
def test_comments_have_no_character_that_means_anything(text):
    shown = escaping.in_comment(text)
    assert len(shown) == len(text)
    assert not re.search(r"[\"\\/*%#<>{}?$@`~^&|!\x00-\x1f\x7f]", shown)
    assert len((shown + "x").splitlines()) == 1
    shown.encode()


@settings(deadline=None)
@texts
@example("\\")
def test_latex_has_only_characters_and_commands_that_show_text(text):
    shown = escaping.in_latex(text)
    known = r"(?:[\w .,:;=+\-()\[\]'!?/*@]|\\[&%$#_{}]|\\text[a-z]+\{\}|\\allowbreak\{\})*"
    assert re.fullmatch(known, shown, re.ASCII)


@settings(deadline=None)
@texts
def test_literals_say_the_text(text):
    assert ast.literal_eval(escaping.python_literal(text)) == text
    literal = escaping.c_literal(text)
    assert re.fullmatch(r'"(?:[\w.,:;=+\-()\[\]]|\\[0-7]{3})*"', literal, re.ASCII)
    octal = re.sub(r"\\([0-7]{3})", lambda found: chr(int(found[1], 8)), literal[1:-1])
    assert octal.encode("latin-1") == text.encode("utf-8", "replace")


# --- files and commands ------------------------------------------------------------------


def elephant(name: str, group: str = "dl") -> str:
    """The shipped anatomy file with another name and another muscle group."""
    text = (anatomies_folder() / "asian-elephant.toml").read_text()
    text = text.replace('group = "dl"', f"group = {quoted(group)}")
    return text.replace('name = "asian-elephant"', f"name = {quoted(name)}", 1)


def quoted(text: str) -> str:
    """A text as TOML writes it."""
    escapes = (f"\\U{ord(c):08X}" if c in '"\\' or not c.isprintable() else c for c in text)
    return f'"{"".join(escapes)}"'


@pytest.mark.parametrize(
    "name",
    [HOSTILE[key] for key in ("python", "c", "bidi", "line ends", "terminal", "long")],
)
def test_an_anatomy_with_an_unprintable_name_is_refused_by_that_key(tmp_path, name):
    path = tmp_path / "anatomy.toml"
    path.write_text(elephant(name), encoding="utf-8")
    with pytest.raises(InputError, match=r"anatomy\.toml:\n  name = "):
        to.load_anatomy(path)


@pytest.mark.parametrize("group", ["d l", 'd"l', "d\nl", "1dl", "", "d*/l", "dl象", "x" * 41])
def test_a_muscle_group_is_a_plain_word(tmp_path, group):
    path = tmp_path / "anatomy.toml"
    path.write_text(elephant("mine", group), encoding="utf-8")
    with pytest.raises(InputError, match=r"muscles\[\d+\]\.group"):
        to.load_anatomy(path)


@pytest.mark.parametrize(
    ("form", "name"), [("c", ORDINARY), ("numpy", ORDINARY + ' """ */ /* ??/ % 象 \\')]
)
def test_any_printable_name_is_exported(tmp_path, monkeypatch, form, name):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "anatomy.toml"
    path.write_text(elephant(name), encoding="utf-8")
    needs(*{"c": ["cc"], "mex": ["mkoctfile"]}.get(form, []))
    result = CliRunner().invoke(commands.main, ["export", str(path), "--to", form, "--check"])
    assert result.exit_code == 0, result.output
    assert "all agree" in result.output
    (folder,) = (tmp_path / "export").iterdir()
    assert {file.name for file in folder.iterdir()} <= {*NAMES, "export.json"}


# --- page and figures --------------------------------------------------------------------


class Elements(html.parser.HTMLParser):
    """Tags of a page in their order, and the text of its title."""

    def __init__(self):
        super().__init__()
        self.tags, self.title = [], ""

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)

    def handle_data(self, data):
        self.title += data if self.tags[-1:] == ["title"] else ""


def elements(title: str) -> Elements:
    """What a browser finds on a page whose data have this text everywhere."""
    parser = Elements()
    parser.feed(bundled({"title": title, "name": title, "plans": [{"phases": [title]}]}))
    return parser


@pytest.mark.parametrize("key", ["html", "python", "template", "line ends", "scripts"])
def test_a_page_has_the_same_elements_whatever_the_title(key):
    assert elements(HOSTILE[key]).tags == elements("plain").tags
    assert elements("a <b> title").title.strip().startswith("a <b> title")


@pytest.mark.parametrize("key", ["formula", "latex", "html"])
def test_a_title_is_no_formula_to_a_figure(tmp_path, key):
    from matplotlib.figure import Figure

    title = HOSTILE[key].replace("\n", " ")
    spec = TOUCH.replace('name = "touch"', f'name = "touch"\ntitle = {quoted(title)}', 1)
    spec = spec.replace('name = "reach"', f"name = {quoted('_' + title)}")
    (tmp_path / "touch.toml").write_text(spec, encoding="utf-8")
    figure, motion = Figure(), to.load_motion(tmp_path / "touch.toml")
    style.headline(figure, style.title(motion))
    legend = figure.legend(handles=style.phase_patches(motion))
    assert len(legend.get_texts()) == 1
    figure.savefig(tmp_path / "title.svg")
    assert (tmp_path / "title.svg").stat().st_size > 1000


def test_names_are_limited_in_the_file_format():
    fields = AnatomySpec.model_json_schema()
    assert fields["properties"]["name"]["maxLength"] == escaping.MAX_NAME
