"""Directives that write reference pages from the code itself.

```{keys} trunk_ocp.problem.problem_file.ProblemSpec     tables of the keys of a file
```{commands}                                            every command with its options
```{modules} rod                                         modules of a folder, a line each
```{api}                                                 public names (one a line) with their docs
```{api} rest                                            all that no other {api} on the page names
"""

import ast
import re
import types
from importlib import import_module
from pathlib import Path
from typing import Any, Union, get_args, get_origin

import click
from docutils import nodes
from pydantic import BaseModel
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.docutils import SphinxDirective

import trunk_ocp

PACKAGE = Path(trunk_ocp.__file__).parent


class Generated(SphinxDirective):
    """A directive that is replaced by Markdown made from the code."""

    optional_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """Parse the Markdown."""
        text = "\n".join(self.markdown())
        return self.parse_text_to_nodes(text, allow_section_headings=True)

    def markdown(self) -> list[str]:
        """Lines that replace the directive."""
        raise NotImplementedError


def table(head: list[str], rows: list[list[str]]) -> list[str]:
    """A Markdown table."""

    def line(cells: list[str]) -> str:
        return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

    return [line(head), line(["---"] * len(head)), *map(line, rows), ""]


def prose(text: str | None) -> str:
    """A docstring, description or help text as Markdown: code in backticks is its only markup."""
    parts = re.split(r"(`[^`]*`)", re.sub(r" *\n *(?=\S)", "\n", (text or "").strip()))
    parts[::2] = [re.sub(r"[*_\[<]", r"\\\g<0>", part) for part in parts[::2]]
    return "".join(parts)


# --- keys of files -------------------------------------------------------------------------


class Keys(Generated):
    """A section for each part of a file."""

    def markdown(self) -> list[str]:
        """Lines that replace the directive."""
        module, name = self.arguments[0].rsplit(".", 1)
        model = getattr(import_module(module), name)
        return _section(model, "", "Top level")


def _section(model: type[BaseModel], path: str, title: str) -> list[str]:
    """The keys of a part of a file, then of the parts in it."""
    schema = model.model_json_schema()
    rows, parts = [], []
    for key, field in model.model_fields.items():
        inner, repeated = _part(field.annotation)
        place = f"{path}.{key}" if path else key
        if inner:
            header = f"[[{place}]]" if repeated else f"[{place}]"
            parts += _section(inner, place, f"`{header}`")
            kind = f"see `{header}`"
        else:
            kind = _words(schema["properties"][key], schema.get("$defs", {}))
        default = (
            "required"
            if field.is_required()
            else _default(field.get_default(call_default_factory=True))
        )
        rows.append([f"`{key}`", kind, default, prose(field.description)])
    table_rows = table(["key", "value", "if left out", "meaning"], rows)
    return [f"## {title}", "", prose(model.__doc__), "", *table_rows, *parts]


def _part(annotation: Any) -> tuple[type[BaseModel] | None, bool]:
    """The model a field holds, and whether it holds a list of them."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation, False
    if get_origin(annotation) in (Union, types.UnionType):
        inner = [_part(arg) for arg in get_args(annotation) if arg is not type(None)]
        return inner[0] if len(inner) == 1 else (None, False)
    if get_origin(annotation) is tuple and get_args(annotation)[1:] == (...,):
        return _part(get_args(annotation)[0])[0], True
    if annotation is not None and hasattr(annotation, "__metadata__"):
        return _part(get_args(annotation)[0])
    return None, False


def _default(value: Any) -> str:
    if value is None or value == "" or isinstance(value, BaseModel) or value in ((), {}):
        return ""
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, tuple):
        return f"`{list(value)}`".replace("'", '"')
    return f'`"{value}"`' if isinstance(value, str) else f"`{value:g}`"


LIMITS = {"exclusiveMinimum": ">", "minimum": "≥", "exclusiveMaximum": "<", "maximum": "≤"}


def _words(schema: dict[str, Any], defs: dict[str, Any]) -> str:
    """What a key takes, in words, from its JSON schema."""
    if "$ref" in schema:
        return _words(defs[schema["$ref"].rsplit("/", 1)[1]], defs)
    if "anyOf" in schema:
        kinds = [_words(kind, defs) for kind in schema["anyOf"] if kind.get("type") != "null"]
        return " or ".join(dict.fromkeys(kinds))
    if "enum" in schema:
        return ", ".join(f'`"{value}"`' for value in schema["enum"])
    kind = schema.get("type")
    if kind in ("number", "integer"):
        noun = "number" if kind == "number" else "whole number"
        limits = [f"{sign} {schema[key]:g}" for key, sign in LIMITS.items() if key in schema]
        return " ".join([noun, " and ".join(limits)]).strip()
    if kind == "object" and "properties" in schema:
        keys = ", ".join(
            f"{key} = {_words(part, defs)}" for key, part in schema["properties"].items()
        )
        return f"{{ {keys} }}"
    if kind == "object":
        return f"name = {_words(schema['additionalProperties'], defs)}, ..."
    if kind == "array" and "prefixItems" in schema:
        return f"[{', '.join(_words(item, defs) for item in schema['prefixItems'])}]"
    if kind == "array":
        low, high = schema.get("minItems"), schema.get("maxItems")
        count = f" ({low} to {high})" if low and high else f" (at most {high})" if high else ""
        return f"list of {_words(schema['items'], defs)}{count}"
    return {"string": "text", "boolean": "`true` or `false`"}.get(str(kind), str(kind))


# --- commands ------------------------------------------------------------------------------


class Commands(Generated):
    """Every command with its help text and options."""

    def markdown(self) -> list[str]:
        """Lines that replace the directive."""
        from trunk_ocp.cli.commands import main, solve

        group = click.Context(main, info_name="trunk-ocp")
        names = [name for name in main.list_commands(group) if name != "solve"]
        lines = _command(solve, click.Context(solve, info_name="solve-motion"))
        for name in names:
            command = main.get_command(group, name)
            assert command is not None
            lines += _command(command, click.Context(command, info_name=name, parent=group))
        return lines


def _command(command: click.Command, context: click.Context) -> list[str]:
    usage = command.get_usage(context).removeprefix("Usage: ")
    rows = []
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record and isinstance(parameter, click.Option):
            rows.append([f"`{record[0]}`", prose(record[1])])
    text = prose((command.help or "").replace("\b", ""))
    return [
        f"## {context.command_path}", "", "```text", usage, "```", "", text, "",
        *table(["option", "what it does"], rows),
    ]  # fmt: skip


# --- modules -------------------------------------------------------------------------------


class Modules(Generated):
    """The modules of a folder of the package, with the first line of their docstrings."""

    def markdown(self) -> list[str]:
        """Lines that replace the directive."""
        folder = PACKAGE / self.arguments[0]
        rows = []
        for path in sorted(folder.rglob("*.py")):
            doc = ast.get_docstring(ast.parse(path.read_text())) or ""
            name = path.relative_to(folder).as_posix().removesuffix(".py")
            if path.name != "__init__.py" and "templates" not in path.parts:
                rows.append([f"`{name}`", doc.split("\n\n")[0].replace("\n", " ")])
        return table([f"`{self.arguments[0]}/`", "what is in it"], rows)


# --- public names --------------------------------------------------------------------------


class Api(Generated):
    """Public names with their docstrings; a second name of the same object says so."""

    def markdown(self) -> list[str]:
        """Lines that replace the directive."""
        shown = self.env.temp_data.setdefault("api", set())
        names = [line.strip() for line in self.content if line.strip()]
        if self.arguments == ["rest"]:
            names = sorted(set(trunk_ocp.__all__) - shown)
        shown.update(names)
        lines = []
        for name in names:
            if name not in trunk_ocp.__all__:
                self.state.document.reporter.warning(f"{name} is not public", line=self.lineno)
                continue
            value = getattr(trunk_ocp, name)
            current = value.__name__
            if current != name and current in trunk_ocp.__all__:
                lines += [f"`{name}` is the earlier name of `{current}`.", ""]
                continue
            kind = "class" if isinstance(value, type) else "function"
            lines += ["```{eval-rst}", f".. auto{kind}:: trunk_ocp.{name}"]
            lines += ["   :members:"] if kind == "class" else []
            lines += ["```", ""]
        return lines


def plain(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are prose with code in backticks: nothing else in them is markup."""
    if what in ("property", "attribute"):
        lines.insert(0, "")  # napoleon takes what is before a colon on the first line for a type
    for i, line in enumerate(lines):
        parts = re.split(r"(`[^`]*`)", line)
        parts[::2] = [
            re.sub(r"(?<=\w)_(?=\W|$)|[|*](?=\S)", r"\\\g<0>", part) for part in parts[::2]
        ]
        if not re.match(r"\s*(:|\.\. )", line):
            lines[i] = "".join(parts)


def outside(app: Sphinx, docname: str, source: list[str]) -> None:
    """Links to files outside docs/, which the site does not have, become their names."""
    text = source[0].replace("(../results/benchmarks.md)", "(/benchmarks.md)")
    folders = "trust|trunk_ocp|results|problems|examples"
    source[0] = re.sub(rf"(?<!!)\[([^\]]+)\]\((?:\.\./)+(?:{folders})[^)]*\)", r"`\1`", text)


def resolve(
    app: Sphinx, env: BuildEnvironment, node: addnodes.pending_xref, text: nodes.TextElement
) -> nodes.Node | None:
    """Types in signatures: public names link to their docs, all others are text."""
    if node.get("refdomain") != "py":
        return None
    name = str(node["reftarget"]).rsplit(".", 1)[-1]
    if name in trunk_ocp.__all__ and node["reftarget"] != f"trunk_ocp.{name}":
        node["reftarget"] = f"trunk_ocp.{name}"
        domain = env.get_domain("py")
        found = domain.resolve_any_xref(
            env, node["refdoc"], app.builder, node["reftarget"], node, text
        )
        if found:
            return found[0][1]
    in_prose = "refexplicit" in node and "refspecific" not in node
    return None if in_prose else text


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    for name, directive in {
        "keys": Keys,
        "commands": Commands,
        "modules": Modules,
        "api": Api,
    }.items():
        app.add_directive(name, directive)
    # Before napoleon, which adds markup of its own.
    app.connect("autodoc-process-docstring", plain, priority=100)
    app.connect("source-read", outside)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True}
