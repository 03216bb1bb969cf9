"""Ctrl-C while public names are imported on first use."""

import subprocess
import sys

INTERRUPTED_IMPORT = """
import signal, sys
import trunk_ocp as to
class Finder:
    def find_spec(self, name, *_):
        if name == "trunk_ocp.planning.planner":
            exec("signal.raise_signal(signal.SIGINT)")  # as the exec of a dataclass
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.meta_path.insert(0, Finder())
try:
    to.plan_motion
except KeyboardInterrupt:
    print("KeyboardInterrupt", hasattr(sys.modules["trunk_ocp.planning.planner"], "plan_motion"))
print(to.plan_motion.__name__)
"""


def test_an_import_is_finished_before_ctrl_c_is_raised_once():
    """Without the block, Python ends with SIGINT, although the script caught the exception."""
    words = [sys.executable, "-c", INTERRUPTED_IMPORT]
    ended = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert ended.stdout.splitlines() == ["KeyboardInterrupt True", "plan_motion"], ended.stderr
    assert ended.returncode == 0
