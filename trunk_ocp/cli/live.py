"""The command `trunk-ocp live`: a page on which a motion is changed and planned again."""

from __future__ import annotations

import sys
import webbrowser
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from .._support.atomic_files import alone
from ..errors import InputError
from ..planning.plan import Plan
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

if TYPE_CHECKING:
    from ..viewer.live_server import LiveServer


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
    inbox, interrupted = Inbox(), False
    with server_class(inbox, port) as server, alone(out) if out else nullcontext():
        session = LiveSession(_first_plan(motion, console), inbox)
        server.start(session.page(server.socket_address), session.first_update())
        print_plain(console, f"Page: {server.address}")
        print_plain(console, "Close the page or press Ctrl-C to end.")
        if not no_browser and not webbrowser.open(server.address):
            warn("no browser found; open the address in a browser yourself.")
        try:
            for update in session.run():
                server.send(update)
        except KeyboardInterrupt:
            interrupted = True
            click.echo("Interrupted.", err=True)
        saved = out is None or _save(session.solved, out, problem, console)
    sys.exit(INTERRUPTED if interrupted else SUCCESS if saved else NOT_VERIFIED)


def _server_class() -> type[LiveServer]:
    """The server, whose library is no dependency of the rest of this package.

    Raises
    ------
    InputError
        If the library is missing or too old.
    """
    try:
        from ..viewer.live_server import LiveServer
    except ImportError as error:
        if not (error.name or "").startswith("websockets"):
            raise
        raise InputError(
            "trunk-ocp live needs websockets 14 or later: pip install 'websockets>=14'."
        ) from None
    return LiveServer


def _first_plan(motion: Motion, console: Console) -> Plan:
    """The plan to start from.

    Raises
    ------
    InputError
        If it does not converge.
    """
    with ProgressDisplay(console, motion) as display:
        plan = plan_motion(motion, reporter=display, throw=False)
    print_outcome(console, plan)
    if not plan.converged:
        raise InputError(
            f"{motion.name}: {plan.status.value}. A live page starts from a plan that converged; "
            f"solve-motion and trunk-ocp explain say more."
        )
    return plan


def _save(plan: Plan | None, folder: Path, problem: str, console: Console) -> bool:
    """Save a plan as solve-motion does; returns whether there is one."""
    if plan is None:
        warn(f"no plan was solved and verified, so nothing was saved in {folder}/.")
        return False
    aside, _ = save_plans([plan], folder, problem)
    if (earlier := aside.settle()) is not None:
        print_plain(console, f"Files made from earlier plans are now in {earlier}/")
    print_plain(console, f"The last plan that was solved and verified is in {folder}/")
    return True
