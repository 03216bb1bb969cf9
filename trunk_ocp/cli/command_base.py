"""Base classes of the commands: each ends with an exit code and a sentence, never a traceback."""

from __future__ import annotations

import contextlib
import sys
import warnings
from collections.abc import Callable
from importlib import import_module
from typing import Any, NoReturn

import click

from ..errors import TrunkError
from .error_messages import report_internal_error, report_interrupt, report_user_error, warn
from .exit_codes import INTERRUPTED, SUCCESS
from .interrupts import Interrupts, ignore_signals_at_exit, show_cursor
from .safe_streams import safe_streams


class Command(click.Command):
    """A command with the exit codes of `exit_codes`."""

    def main(self, *args: Any, standalone_mode: bool = True, **extra: Any) -> Any:
        """Run the command, and end the process."""
        parent: Any = super()
        if not standalone_mode:
            return parent.main(*args, standalone_mode=False, **extra)
        return _run_and_exit(lambda: parent.main(*args, standalone_mode=False, **extra))


class LazyGroup(Command, click.Group):
    """A group of commands, some of which are imported only when they run.

    Parameters
    ----------
    lazy_commands : dict
        Short help of the commands imported on demand, module.NAME_command, by module and name.
    """

    def __init__(self, *args: Any, lazy_commands: dict[str, dict[str, str]], **extra: Any):
        super().__init__(*args, **extra)
        self.modules = {name: module for module, names in lazy_commands.items() for name in names}
        self.help_texts = {n: text for names in lazy_commands.values() for n, text in names.items()}

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands."""
        return sorted({*super().list_commands(ctx), *self.modules})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """A command by its name."""
        if cmd_name in self.modules:
            module = import_module(f".{self.modules[cmd_name]}", __package__)
            return getattr(module, f"{cmd_name}_command")
        return super().get_command(ctx, cmd_name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing them."""
        own = {name: command.get_short_help_str(200) for name, command in self.commands.items()}
        with formatter.section("Commands"):
            formatter.write_dl(sorted((self.help_texts | own).items()))


def _run_and_exit(run: Callable[[], Any]) -> NoReturn:
    """Run a command, and end the process with its exit code."""
    try:
        with contextlib.ExitStack() as stack:
            output = stack.enter_context(safe_streams())
            stack.enter_context(warnings.catch_warnings())
            if not sys.warnoptions:  # warnings of libraries are for programmers, who ask with -W
                warnings.simplefilter("ignore")
            interrupts = Interrupts.current or stack.enter_context(Interrupts())
            ignore_signals_at_exit()
            code = _exit_code(run, interrupts)
            interrupts.ignore_next()
            output.flush()
            if output.lost:
                warn(f"standard output cannot be written ({output.lost}).")
    except KeyboardInterrupt:
        code = report_interrupt()
    sys.exit(code)


def _exit_code(run: Callable[[], Any], interrupts: Interrupts) -> int:
    """Run a command, and return its exit code."""
    try:
        code = run()
    except SystemExit as exit_request:
        code = exit_request.code
    except click.ClickException as error:
        error.show()
        code = error.exit_code
    except (click.Abort, KeyboardInterrupt):
        code = report_interrupt()
    except (TrunkError, OSError, MemoryError) as error:
        code = report_user_error(error)
    except Exception as error:
        # Native code that an interrupt reaches raises an error of its own.
        code = report_interrupt() if interrupts.received else report_internal_error(error)
    if interrupts.received:
        show_cursor()
        return INTERRUPTED
    return code if isinstance(code, int) else SUCCESS
