"""How every command ends: with an exit code and a sentence, never with a traceback.

0  done; solved and verified       3  planned, but not solved or not verified
1  a fault of this program         4  interrupted
2  bad usage, bad files, or files that cannot be written
"""

from __future__ import annotations

import contextlib
import logging
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

import click

from ..errors import TrunkError
from .interrupts import INTERRUPTED, Interrupts, ignore_at_exit, show_cursor
from .stdout import steady_streams

FAULT = 1
BAD_INPUT = 2
PACKAGE = Path(__file__).parent.parent
UNTOLD = "Interrupted; nothing more was saved."

# Where it may not keep its settings it makes a folder for them; nobody needs to know.
logging.getLogger("matplotlib").setLevel(logging.ERROR)


class Command(click.Command):
    """A command that ends as this module says."""

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Run the command, and end the process."""
        parent: Any = super()
        if not standalone_mode:
            return parent.main(*args, standalone_mode=False, **extra)
        return _ended(lambda: parent.main(*args, standalone_mode=False, **extra))


class Group(Command, click.Group):
    """Commands that end as this module says; each is imported when it is first asked for.

    Parameters
    ----------
    elsewhere : dict
        Module, attribute and short help of commands, by name.
    """

    def __init__(self, *args: Any, elsewhere: dict[str, tuple[str, str, str]], **extra: Any):
        super().__init__(*args, **extra)
        self.elsewhere = elsewhere

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands."""
        return sorted({*super().list_commands(ctx), *self.elsewhere})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """A command by its name."""
        if cmd_name in self.elsewhere:
            from importlib import import_module

            module, attribute, _ = self.elsewhere[cmd_name]
            return getattr(import_module(f".{module}", __package__), attribute)
        return super().get_command(ctx, cmd_name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands, without importing them."""
        short = {name: about for name, (_, _, about) in self.elsewhere.items()}
        short |= {name: command.get_short_help_str(200) for name, command in self.commands.items()}
        with formatter.section("Commands"):
            formatter.write_dl(sorted(short.items()))


def _ended(run: Callable[[], Any]) -> NoReturn:
    """End the process with the exit code of a command."""
    try:
        with contextlib.ExitStack() as stack:
            output = stack.enter_context(steady_streams())
            stack.enter_context(warnings.catch_warnings())
            _quiet_libraries()
            interrupts = Interrupts.current or stack.enter_context(Interrupts())
            ignore_at_exit()
            code = _code(run, interrupts)
            interrupts.finish()
            output.flush()
            if output.lost:
                warn(f"standard output cannot be written ({output.lost}).")
    except KeyboardInterrupt:
        code = _interrupted()
    sys.exit(code)


def _quiet_libraries() -> None:
    """Leave out what libraries say to programmers, unless Python was asked for it with -W."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")


def _code(run: Callable[[], Any], interrupts: Interrupts) -> int:
    """Exit code of a command that is run here."""
    try:
        with clean_errors():
            code = run()
    except SystemExit as ended:
        code = ended.code
    except click.ClickException as error:
        error.show()
        code = error.exit_code
    except click.Abort:
        code = _interrupted()
    except Exception as error:
        # Native code makes errors of its own of an interrupt that meets it.
        code = _interrupted() if interrupts.came else _fault(error)
    if interrupts.came:
        show_cursor()
        return INTERRUPTED
    return code if isinstance(code, int) else 0


@contextlib.contextmanager
def clean_errors() -> Iterator[None]:
    """Errors a user can mend become a message and exit code 2."""
    try:
        yield
    except (TrunkError, OSError) as error:
        from .._support.toml_files import (
            printable,  # takes its time, and is there already as a rule
        )

        click.echo(f"Error: {printable(str(error), lines=True)}", err=True)
        sys.exit(BAD_INPUT)
    except MemoryError:
        click.echo("Error: there is not enough memory for this; ask for less at a time.", err=True)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        sys.exit(_interrupted())


@contextlib.contextmanager
def optional(what: str) -> Iterator[None]:
    """Block that may fail, with a warning: what matters more is saved already."""
    try:
        yield
    except Exception as error:
        warn(f"{what}: {described(error)}")


def warn(text: str) -> None:
    """Say something that does not change the exit code."""
    click.echo(f"warning: {text}", err=True)


def described(error: BaseException) -> str:
    """An error in a line; with its kind and place if it is no user's."""
    if isinstance(error, TrunkError):
        return str(error)
    return f"{type(error).__name__}: {error}{_place(error)}"


def _interrupted() -> int:
    click.echo(UNTOLD, err=True)
    return INTERRUPTED


def _fault(error: Exception) -> int:
    click.echo(
        f"Error: {described(error)}. This is a fault of trunk_ocp, not yours: please report it "
        "with the command and its files.",
        err=True,
    )
    return FAULT


def _place(error: BaseException) -> str:
    """Where in this package an error arose."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = [frame for frame in frames if Path(frame.filename).is_relative_to(PACKAGE)]
    return f" ({Path(ours[-1].filename).name}:{ours[-1].lineno})" if ours else ""
