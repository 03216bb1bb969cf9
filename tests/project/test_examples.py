"""The examples do what they say."""

import os
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import pytest
from programs import needs

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


def test_a_controller_on_exported_c_keeps_the_tip_at_a_swinging_fruit(tmp_path):
    """All of it as a user runs it: export, compile, 2000 ticks with a load it does not know."""
    needs("cc")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    command = [sys.executable, str(ROOT / "examples" / "follow_target.py"), "--out", str(tmp_path)]
    done = subprocess.run(
        command, capture_output=True, text=True, env=os.environ | {"PATH": path}, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "2000 ticks of 10 ms" in done.stdout
    worst = re.search(r"RMS\), ([\d.]+) mm \(max", done.stdout)[1]
    assert float(worst) < 4.0  # of a swing of half a meter
    low, high = re.search(r"segments: (\d\.\d+) to (\d\.\d+)", done.stdout).groups()
    assert float(low) > 0.67  # the paper's bounds on extension
    assert float(high) < 1.35
    assert matplotlib.image.imread(tmp_path / "follow-target.png").std() > 0.05


def test_a_controller_that_replans_keeps_the_tip_at_a_moving_target(tmp_path):
    """With time enough; the target flies out of reach meanwhile, and the tip catches it again."""
    script = str(ROOT / "examples" / "track_moving_target.py")
    command = [sys.executable, script, "--until", "2.6", "--deadline", "5", "--out", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "51 ticks of 50 ms" in done.stdout
    reached, median, worst = re.search(
        r"In reach: (\d+) ticks, the tip ([\d.]+) mm .*, ([\d.]+) mm", done.stdout
    ).groups()
    assert int(reached) >= 30
    assert float(median) < 2.0  # from a target at up to 0.5 m/s, as extrapolated
    assert float(worst) < 12.0
    away, far = re.search(r"Out of reach: (\d+) ticks, .* (\d+) mm away", done.stdout).groups()
    assert int(away) >= 5
    assert float(far) > 300.0
    assert "51 converged, but not checked yet" in done.stdout
    assert "51 keep their bounds, in equilibrium; 0 do not" in done.stdout
    assert matplotlib.image.imread(tmp_path / "track-moving-target.png").std() > 0.05
