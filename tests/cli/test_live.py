"""`trunk-ocp live` as a process: it plans, listens, and ends with the page or with Ctrl-C."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
from urllib.parse import urlsplit

import pytest
from click.testing import CliRunner
from plans import TOUCH, written
from websockets.sync.client import connect

from trunk_ocp.cli import commands
from trunk_ocp.planning.status import Status
from trunk_ocp.planning.storage import load_plan

pytestmark = pytest.mark.slow

COMMAND = "from trunk_ocp.cli.entry import trunk_ocp; trunk_ocp()"
PLACE = [0.65, 0.05, 1.15]


@pytest.fixture
def started(tmp_path):
    """Start the command; gives the process and the address of its page."""
    processes = []

    def start(*words):
        written(tmp_path, TOUCH)
        command = [sys.executable, "-c", COMMAND, "live", "problem.toml", "--no-browser", *words]
        process = subprocess.Popen(
            command,
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )
        processes.append(process)
        address = next(m[0] for line in process.stdout if (m := re.search(r"http://\S+", line)))
        return process, address

    yield start
    for process in processes:
        process.kill()
        process.wait()


def talking(address):
    parts = urlsplit(address)
    path = f"ws://{parts.netloc}/socket?{parts.query}"
    return connect(path, origin=f"http://{parts.netloc}", proxy=None)


def drag(page, n, done=True, position=PLACE):
    change = {"name": "0:0", "position": position, "done": done}
    page.send(json.dumps({"n": n, "drag": change}))


def received(page, n, state):
    """Wait for a status."""
    while True:
        update = json.loads(page.recv(timeout=60))
        if update.get("answers") == n and update.get("status", {}).get("state") == state:
            return update


def test_closing_the_page_ends_it_and_saves_the_last_plan_that_was_checked(started, tmp_path):
    process, address = started("--out", "new")
    with talking(address) as page:
        drag(page, 1)
        received(page, 1, "good")
        drag(page, 2, done=False, position=[0.6, 0.0, 1.2])
        received(page, 2, "open")
    output, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) == (0, "")
    assert "solved and verified is in new/" in output
    plan = load_plan(tmp_path / "new" / "horizon")
    assert plan.status is Status.SOLVED
    assert plan.motion.spec.phases[0].targets[0].position == pytest.approx(PLACE, abs=1e-12)


@pytest.mark.parametrize("busy", [False, True])
def test_ctrl_c_ends_it_cleanly(started, busy):
    process, address = started()
    with talking(address) as page:
        page.recv()
        for n in range(1, 5 if busy else 1):
            drag(page, n, done=n % 2 == 0, position=[0.6, 0.01 * n, 1.2])
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=30)
    assert process.returncode == 4
    assert "Traceback" not in errors


def test_it_says_what_to_install_and_which_port_is_taken(tmp_path, monkeypatch):
    path = str(written(tmp_path, TOUCH))
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        ended = CliRunner().invoke(commands.main, ["live", path, "--no-browser", "--port", port])
    assert ended.exit_code == 2
    assert f"port {port}: cannot be used" in ended.output
    for name in [name for name in sys.modules if name.startswith("websockets")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delitem(sys.modules, "trunk_ocp.viewer.live_server", raising=False)
    monkeypatch.setitem(sys.modules, "websockets", None)
    ended = CliRunner().invoke(commands.main, ["live", path, "--no-browser"])
    assert ended.exit_code == 2
    assert "pip install 'websockets>=14'" in ended.output
