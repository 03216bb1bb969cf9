"""The command `trunk-ocp live`: a page on which a motion is changed and planned again."""

from __future__ import annotations

import sys
import webbrowser
from pathlib import Path

import click
from rich.console import Console

from .._support.atomic_files import alone
from ..errors import InputError
from ..planning.plan import Plan, PlanError
from ..planning.planner import plan_motion
from ..problem.motion import Motion
from ..viewer.live_messages import Inbox
from ..viewer.live_session import LiveSession
from .common import load_problem, print_outcome, print_plain
from .error_messages import warn
from .exit_codes import INTERRUPTED, NOT_VERIFIED, SUCCESS
from .option_types import contact_option, number_option, out_option
from .progress import ProgressDisplay
from .safe_streams import standard_output
from .solve import save_plans


@click.command("live")
@click.argument("problem", default="pick-fruit")
@contact_option
@number_option("--port", "port", "PORT", "Port of the page; 0 for any that is free.", 0)
@click.option("--no-browser", is_flag=True, help="Print the address of the page only.")
@out_option("Save the last plan that was solved and verified here.")
def live_command(
    problem: str, contact: str | None, port: int, no_browser: bool, out: Path | None
) -> None:
    """Drag targets on a page and watch the motion being planned again.

    Plans PROBLEM and opens its page in a browser. Drag a target, or the log, and the whole motion
    follows; change the bounds of muscles, or how fast they may be. Plans are unchecked while you
    drag, and checked once you let go. Only programs on this machine that know the page's address
    can reach it. Close the page or press Ctrl-C to end.

    Exit codes: 0 the page was closed; 3 there was nothing to save in --out; 4 Ctrl-C.
    """
    server_class = _server_class()
    console = Console(file=standard_output(), highlight=False)
    motion = load_problem(problem, contact)
    for warning in motion.warnings:
        warn(warning)
    inbox, code = Inbox(), SUCCESS
    with server_class(inbox, port) as server:
        session = LiveSession(_first_plan(motion, console), inbox)
        server.start(session)
        print_plain(console, f"Page: {server.address}")
        print_plain(console, "Close the page or press Ctrl-C to end.")
        if not no_browser and not webbrowser.open(server.address):
            warn("no browser found; open the address in a browser yourself.")
        try:
            for update in session.run():
                server.send(update)
        except KeyboardInterrupt:
            code = INTERRUPTED
    sys.exit((out and _save(session.solved, out, problem, console)) or code)
