"""Directives whose examples are run when the site is built.

    ```{file} reach.toml            a file: shown, and written to the page's folder
    ```{shell}                      commands: shown with their output
    :exit: 3                        the exit code of the last command
    :setup: cp a.toml b.toml        run before, and not shown
    :lines: 12                      show no more than these lines of output

Every page has a folder of its own, in which its commands run in order. A command that ends with
another exit code than the page says is a warning, which fails the build. To look at prose only,
build with `-D run_examples=0 -D nb_execution_mode=off`.
"""

import re
import shutil
import subprocess
import tempfile
import textwrap
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

WIDTH = 90
"""Characters of a line of output."""
_root = Path(tempfile.mkdtemp(prefix="docs-"))


class Example(SphinxDirective):
    """A directive that works in the folder of its page."""

    has_content = True

    @property
    def folder(self) -> Path:
        """Folder of the page's example."""
        folder = _root / self.env.docname
        folder.mkdir(parents=True, exist_ok=True)
        return folder


class File(Example):
    """A file of the example."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Write and show the file."""
        name, text = self.arguments[0], "\n".join(self.content) + "\n"
        (self.folder / name).write_text(text)
        block = nodes.literal_block(text, text, language=Path(name).suffix[1:] or "text")
        caption = nodes.caption(name, "", nodes.literal(name, name))
        return [
            nodes.container(
                "", caption, block, literal_block=True, classes=["literal-block-wrapper"]
            )
        ]


class Shell(Example):
    """Commands and what they print."""

    option_spec: ClassVar = {
        "exit": directives.nonnegative_int,
        "setup": directives.unchanged,
        "lines": directives.positive_int,
    }

    def run(self) -> list[nodes.Node]:
        """Run the commands and show them with their output."""
        if "setup" in self.options:
            self._output(self.options["setup"], None)
        shown, last = [], len(self.content) - 1
        for number, command in enumerate(self.content):
            output = self._output(command, self.options.get("exit", 0) if number == last else 0)
            shown.append(f"$ {command}\n{output}".rstrip())
        text = "\n".join(shown)
        return [nodes.literal_block(text, text, language="console")]

    def _output(self, command: str, code: int | None) -> str:
        if not self.config.run_examples:
            return "..."
        done = subprocess.run(
            ["bash", "-c", command],
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=300,
        )
        if code is not None and done.returncode != code:
            self.state.document.reporter.warning(
                f"{command!r} ended with {done.returncode}, not {code}:\n{done.stdout}",
                line=self.lineno,
            )
        text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", done.stdout).rstrip()
        lines = [part for line in text.split("\n") for part in _wrapped(line)]
        most = self.options.get("lines", len(lines))
        return "\n".join([*lines[:most], *["..."][: len(lines) > most]])


def _wrapped(line: str) -> list[str]:
    """A line in parts that fit a page."""
    indent = " " * (len(line) - len(line.lstrip()) + 4)
    whole = len(line) <= WIDTH
    return [line.rstrip()] if whole else textwrap.wrap(line, WIDTH, subsequent_indent=indent)


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    app.add_config_value("run_examples", True, "env", types=[bool, int])
    app.add_directive("file", File)
    app.add_directive("shell", Shell)
    app.connect("build-finished", lambda app, error: shutil.rmtree(_root, ignore_errors=True))
    return {"parallel_read_safe": False}
