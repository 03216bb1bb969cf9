"""Processes that start at once: forked from one that has imported the package."""

import multiprocessing
import os
import runpy
import subprocess
import sys
import tempfile
from pathlib import Path

SERVER = multiprocessing.get_context("forkserver")
SERVER.set_forkserver_preload(
    ["trunk_ocp.cli.commands", "trunk_ocp.cli.solve", "trunk_ocp.cli.run_figures", "xarray"]
)


def run_script(script, arguments, timeout):
    """Run a Python script in a process of its own, as `subprocess.run` does; with its output.

    Raises
    ------
    subprocess.TimeoutExpired
        If it takes longer than `timeout` in s; it is killed.
    """
    words = [str(script), *map(str, arguments)]
    with tempfile.TemporaryDirectory() as folder:
        out, err = Path(folder, "out"), Path(folder, "err")
        process = SERVER.Process(target=_run, args=(words, out, err))
        process.start()
        process.join(timeout)
        if process.exitcode is None:
            process.kill()
            raise subprocess.TimeoutExpired(words, timeout)
        return subprocess.CompletedProcess(
            words, process.exitcode, out.read_text(), err.read_text()
        )


def _run(words, out, err):
    for number, path in ((1, out), (2, err)):
        os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT), number)
    sys.argv[:] = words
    runpy.run_path(words[0], run_name="__main__")
