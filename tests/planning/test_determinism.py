"""The same input gives the same bits; a result says what it was made of and by what."""

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import replace

import pytest
import threadpoolctl
import xarray as xr
from click.testing import CliRunner
from plans import POINT, first_steps, written

from trunk_ocp._support.provenance import fingerprint, versions
from trunk_ocp.cli import commands
from trunk_ocp.planning.options import Options
from trunk_ocp.planning.planner import plan_motion
from trunk_ocp.planning.storage import load_plan, save_plan, summary
from trunk_ocp.problem.build import load_motion
from trunk_ocp.reporting import Reporter

pytestmark = pytest.mark.slow

# Plans a motion, and another one before it if asked to; prints a fingerprint of every number.
PLANNER = """
import hashlib, sys
from dataclasses import replace
import trunk_ocp as to
from trunk_ocp.model.anatomy import AnatomySpec
from trunk_ocp.problem.build import build_motion

def told(motion, lookahead):
    plan = to.plan_motion(motion, lookahead)
    check = plan.verification
    shapes = plan.shape.states, plan.shape.edges, plan.shape.slopes, plan.tip_forces
    arrays = plan.x, *shapes, check.trajectory.position, check.position_difference
    return plan.iterations, [hashlib.sha256(a.tobytes()).hexdigest() for a in arrays]

def many_segments(motion, parts):
    data = motion.anatomy.model_dump()
    segments = []
    for segment in data["segments"]:
        first, last = segment["Z_over_length"]
        edges = [first + (last - first) * i / parts for i in range(parts)] + [last]
        for ends in zip(edges[:-1], edges[1:]):
            segments.append(segment | {"Z_over_length": ends})
    spec = motion.spec.model_copy(update={"phases": motion.spec.phases[:1]})
    return build_motion(spec, AnatomySpec.model_validate(data | {"segments": tuple(segments)}))

point = to.load_motion(sys.argv[1])
if "before" in sys.argv:
    fruit = to.load_motion("pick-fruit")
    told(replace(fruit, steps=fruit.steps[:3]), 2)
print(told(point, 1), told(point, None), told(point, 2), told(many_segments(point, 8), None))
"""


def environment(threads, seed):
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    return os.environ | dict.fromkeys(names, str(threads)) | {"PYTHONHASHSEED": str(seed)}


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    return written(tmp_path_factory.mktemp("problem"), POINT)


@pytest.fixture(scope="module")
def plan(problem):
    return plan_motion(load_motion(problem), lookahead=1)


def test_threads_hashes_folders_and_history_change_no_bit(problem, tmp_path):
    settings = [
        (environment(1, 0), problem.parent, []),
        (environment(2, 1), tmp_path, []),
        (environment(4, 4711), problem.parent, ["before"]),
    ]
    told = {
        subprocess.run(
            [sys.executable, "-c", PLANNER, str(problem), *more],
            env=env,
            cwd=folder,
            capture_output=True,
            text=True,
            check=True,
            timeout=200,
        ).stdout
        for env, folder, more in settings
    }
    assert len(told) == 1
    assert told.pop().count("]") == 4  # of four plans


class Threads(Reporter):
    """Notes how many threads every BLAS has while a plan is made."""

    def __init__(self):
        self.seen = set()

    def iteration(self, progress):
        self.seen |= {library["num_threads"] for library in blas()}


def blas():
    return [found for found in threadpoolctl.threadpool_info() if found["user_api"] == "blas"]


def test_a_plan_has_one_thread_and_gives_the_others_back():
    motion = first_steps("lift-log", 1)
    plan_motion(motion)  # all libraries are loaded after it
    assert any("casadi" in library["prefix"] for library in blas())
    with threadpoolctl.threadpool_limits(limits=2, user_api="blas"):
        threads = Threads()
        plan_motion(motion, reporter=threads)
        assert threads.seen == {1}
        assert {library["num_threads"] for library in blas()} == {2}


def test_both_modes_at_once_are_each_alone(problem, tmp_path):
    """A horizon alone starts from a rougher sequential plan; the sequential one is the same."""
    for mode in ("both", "sequential"):
        arguments = [str(problem), "--out", str(tmp_path / mode), "--mode", mode, "--no-figures"]
        assert CliRunner().invoke(commands.solve, arguments).exit_code == 0
    csv = [tmp_path / mode / "sequential" / "activations.csv" for mode in ("both", "sequential")]
    assert csv[0].read_bytes() == csv[1].read_bytes()
    nc = [path.with_name("solution.nc") for path in csv]
    both, alone = (xr.load_dataset(path, engine="scipy") for path in nc)
    for name, array in alone.variables.items():
        if array.dtype.kind in "fi":
            assert both[name].values.tobytes() == array.values.tobytes(), name
    horizon = plan_motion(load_motion(problem), start=load_plan(tmp_path / "sequential/sequential"))
    assert load_plan(tmp_path / "both" / "horizon").x.tobytes() == horizon.x.tobytes()


# --- provenance ----------------------------------------------------------------------------


def test_a_plan_tells_its_versions_and_options(problem, tmp_path):
    arguments = [str(problem), "--out", str(tmp_path), "--max-iterations", "500", "--no-figures"]
    assert CliRunner().invoke(commands.solve, arguments).exit_code == 0
    told = json.loads((tmp_path / "horizon" / "summary.json").read_text())
    named = {"trunk_ocp", "casadi", "ipopt", "numpy", "scipy", "python", "platform"}
    assert set(told["versions"]) == named
    assert told["versions"]["python"] == ".".join(map(str, sys.version_info[:3]))
    assert told["versions"]["ipopt"].startswith("3.")
    assert told["options"]["max_iterations"] == 500
    assert told["options"]["linear_solver"] == "mumps"
    assert told["options"]["weights"] == {"effort": 1e-5, "rate": 1e-5, "head_effort": 0.0}
    assert told["options"]["command"]["problem"] == str(problem)
    assert told["options"]["command"]["mode"] == "horizon"
    with xr.open_dataset(tmp_path / "horizon" / "solution.nc", engine="scipy") as data:
        assert json.loads(data.attrs["versions_json"]) == told["versions"]
        assert json.loads(data.attrs["options_json"]) == told["options"]
        for name in ("problem_sha256", "anatomy_sha256"):
            assert data.attrs[name] == told[name]


def test_a_fingerprint_is_the_hash_of_what_the_file_says(plan):
    spec = plan.motion.spec
    text = json.dumps(spec.model_dump(mode="json"), sort_keys=True, separators=(",", ":"))
    assert summary(plan)["problem_sha256"] == hashlib.sha256(text.encode()).hexdigest()
    assert len(summary(plan)["anatomy_sha256"]) == 64


def test_a_fingerprint_does_not_depend_on_how_the_file_is_written(tmp_path):
    same = POINT.replace("1.75", "1.750e0").replace('name = "reach"\nduration = 1.0\nsteps = 2',
        'steps = 2  # two\nname = "reach"\nduration = 1.0')  # fmt: skip
    other = POINT.replace("1.75", "1.7499999999999998")
    specs = [load_motion(written(tmp_path, text)).spec for text in (POINT, same, other)]
    first, second, third = map(fingerprint, specs)
    assert same != POINT
    assert first == second
    assert first != third  # one bit of one number


def test_where_a_plan_comes_from_stays_with_it(plan, tmp_path):
    elsewhere = replace(plan, versions=versions() | {"trunk_ocp": "0.0.1"})
    save_plan(elsewhere, tmp_path / "first")
    again = load_plan(tmp_path / "first")
    save_plan(again, tmp_path / "second")
    told = json.loads((tmp_path / "second" / "summary.json").read_text())
    assert told["versions"]["trunk_ocp"] == "0.0.1"
    assert told["options"] == plan.options


def test_other_options_are_told(problem):
    options = Options(elements=4, starts=2)
    told = plan_motion(load_motion(problem), 1, options).options
    assert (told["elements"], told["starts"], told["degree"]) == (4, 2, None)
