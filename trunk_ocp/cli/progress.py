"""Live progress of a plan on the console."""

from __future__ import annotations

import time

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as ProgressBar
from rich.status import Status as Spinner

from ..problem.motion import Motion
from ..reporting import Progress, Reporter


def progress_bar(console: Console, title: str, items: str, transient: bool = False) -> ProgressBar:
    """A bar with a title, the number of finished items of all, and the time that is left."""
    return ProgressBar(
        TextColumn(title),
        BarColumn(),
        TextColumn(f"{{task.completed}} of {{task.total}} {items}, time left"),
        TimeRemainingColumn(),
        console=console,
        transient=transient,
        disable=console.quiet,
    )


class ProgressDisplay(Reporter):
    """Shows progress: one live line on a terminal, one line per solve elsewhere."""

    def __init__(self, console: Console, motion: Motion) -> None:
        self.console, self.motion = console, motion
        self.start = time.perf_counter()
        self.last_line = ""
        self.stopping_shown = False
        self.spinner: Spinner | None = None

    def __enter__(self) -> ProgressDisplay:
        steps, muscles = len(self.motion.steps), len(self.motion.trunk.muscles)
        title = escape(self.motion.spec.title or self.motion.name)
        self.console.print(f"[bold]{title}[/]: {steps} time steps, {muscles} muscles")
        if self.console.is_terminal:
            self.spinner = self.console.status("setting up")
            self.spinner.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._show_stopping()
        if self.spinner is not None:
            self.spinner.stop()

    def iteration(self, progress: Progress) -> None:
        """Show an iteration."""
        seconds = time.perf_counter() - self.start
        if self.spinner is not None:
            self.spinner.update(
                f"{progress.stage}: {progress.detail} | iteration {progress.iteration} | "
                f"worst error {1e3 * progress.worst_error:.2f} mm | infeasibility "
                f"{progress.infeasibility:.0e} | {seconds:.1f} s"
            )
        line = progress.stage if progress.first == progress.last else progress.detail
        if line != self.last_line:  # one line for all single steps together, one for each window
            self.last_line = line
            self.console.print(f"[dim]{seconds:6.1f} s  {line}[/]")
        self._show_stopping()

    def note(self, text: str) -> None:
        """Show a sentence."""
        self.console.print(text, markup=False)

    def _show_stopping(self) -> None:
        """Acknowledge a request to stop.

        Not in the signal handler itself, which may interrupt another print.
        """
        if self.stop and not self.stopping_shown:
            self.stopping_shown = True
            self.note("Stopping; the best plan so far will be saved.")
