"""Real notebooks in a headless browser: JupyterLab and marimo on 127.0.0.1, with a token each."""

import contextlib
import os
import secrets
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path

import nbformat

SUPPORT = Path(__file__).parent
START = 60  # s that a server may take to start, on a busy machine
DRIVER = "window.jupyterapp?.shell?.currentWidget"


def free_port():
    """A port that nobody uses now."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@contextlib.contextmanager
def serving(command, port, folder):
    """A server that answers while the context lasts; its settings and logs are in a folder."""
    places = ("HOME", "IPYTHONDIR", "XDG_CONFIG_HOME", "XDG_STATE_HOME", "XDG_CACHE_HOME")
    places += ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR")
    settings = {place: str(folder / "settings" / place.lower()) for place in places}
    Path(settings["HOME"]).mkdir(parents=True)
    paths = {"PYTHONPATH": str(SUPPORT)}
    with open(folder / "log.txt", "w") as log:
        server = subprocess.Popen(
            [sys.executable, "-m", *command], cwd=folder, env=os.environ | settings | paths,
            stdout=log, stderr=subprocess.STDOUT,
        )  # fmt: skip
        try:
            until(lambda: server.poll() is not None or answers(port), START)
            assert server.poll() is None, (folder / "log.txt").read_text()
            yield
        finally:
            server.terminate()
            server.wait(30)


def answers(port):
    """Whether a server answers, with whatever status."""
    try:
        urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5).close()
    except urllib.error.HTTPError:
        return True
    except OSError:
        return False
    return True


def until(condition, seconds=30):
    """Wait for a condition; its value."""
    end = time.monotonic() + seconds
    while not (value := condition()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)
    return value


@contextlib.contextmanager
def jupyter(folder, cells):
    """JupyterLab with a notebook of these cells; its address."""
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    made = [nbformat.v4.new_code_cell(text) for text in cells]
    book = nbformat.v4.new_notebook(cells=made, metadata={"kernelspec": kernel})
    nbformat.write(book, folder / "book.ipynb")
    port, token = free_port(), secrets.token_hex(16)
    command = ["jupyterlab", "--no-browser", "--ip=127.0.0.1", f"--port={port}", "--allow-root"]
    command += [f"--IdentityProvider.token={token}", f"--ServerApp.root_dir={folder}"]
    command += ["--expose-app-in-browser", "--LabApp.news_url="]
    with serving(command, port, folder):
        yield f"http://127.0.0.1:{port}/lab/tree/book.ipynb?token={token}"


def run_next_cell(tab):
    """Run the selected cell and select the next one; does not wait for its end."""
    tab.wait_for_function(f"() => {DRIVER}?.sessionContext?.session?.kernel?.status === 'idle'")
    run = "window.jupyterapp.commands.execute('notebook:run-cell-and-select-next')"
    tab.evaluate(f"() => {{ {run}; }}")


@contextlib.contextmanager
def marimo(folder, app):
    """marimo, running an app with this text; its address."""
    (folder / "app.py").write_text(app)
    port, token = free_port(), secrets.token_hex(16)
    command = ["marimo", "run", "app.py", "--headless", "--host=127.0.0.1", f"--port={port}"]
    command += ["--token", f"--token-password={token}"]
    with serving(command, port, folder):
        yield f"http://127.0.0.1:{port}/?access_token={token}"
