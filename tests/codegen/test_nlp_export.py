"""The exported NLP is the planner's: its values, its derivatives, its names, its optimum."""

import json
import re
import shutil
import subprocess
import sys
from functools import cache

import casadi as ca
import numpy as np
import pytest
from plans import first_steps
from programs import needs

from trunk_ocp import Loads, solve_statics
from trunk_ocp.codegen import nlp_export as nlp
from trunk_ocp.codegen.request import CheckError, Request, ToolMissingError
from trunk_ocp.codegen.run_checks import build_mex, run_octave
from trunk_ocp.codegen.shape_model import build_model
from trunk_ocp.errors import InputError
from trunk_ocp.planning.planner import plan_motion

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("unoptimized")]

WRITERS = {
    "casadi": (nlp.write_nlp_casadi, nlp.check_nlp_casadi),
    "c": (nlp.write_nlp_c, nlp.check_nlp_c),
    "mex": (nlp.write_nlp_mex, nlp.check_nlp_mex),
}
# Differences of order 8 with a step of 3e-3: about h^8 = 1e-20 times a ninth derivative, and
# round-off 1e-16 / h; the tolerance is far above both.
STEP = 3e-3
DIFFERENCES = 1e-8
CENTRAL = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}

# Held directions and pulls; a contact couple and targets inside elements.
MOTIONS = [("pick-fruit", 3), ("lift-log-asymmetric", 2)]


def request(name="lift-log", steps=2):
    motion = first_steps(name, steps)
    return Request(build_model(motion.trunk), "constraints", name, motion=motion)


def saved(files, folder):
    folder.mkdir(parents=True)
    for name, content in files.items():
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return folder


@cache
def exported(to, name="lift-log", steps=2):
    return WRITERS[to][0](request(name, steps))


def loaded(folder):
    return {path.stem: ca.Function.load(str(path)) for path in folder.glob("*.casadi")}


def table(folder, name):
    return np.loadtxt(folder / name, delimiter=",", unpack=True)


def tool(name):
    needs(name)
    return shutil.which(name)


def differences(function, x):
    """Jacobian (outputs, n) of a function of x (n,), column by column."""
    columns = []
    for i in range(x.size):
        step = np.zeros_like(x)
        step[i] = STEP
        terms = (w * (function(x + k * step) - function(x - k * step)) for k, w in CENTRAL.items())
        columns.append(sum(terms) / STEP)
    return np.stack(columns, axis=-1)


# --- values and derivatives ----------------------------------------------------------------


@pytest.mark.parametrize("to", WRITERS)
def test_an_export_gives_the_nlps_own_numbers_in_its_own_world(to, tmp_path):
    folder = saved(exported(to), tmp_path / to)
    before = sorted(path.name for path in folder.iterdir())
    said = WRITERS[to][1](folder).split()
    assert said[1::3] == ["objective", "constraints", "gradient", "jacobian", "hessian"]
    assert max(float(share) for share in said[2::3]) <= 1e-10
    assert sorted(path.name for path in folder.iterdir()) == before


def test_a_check_notices_one_wrong_number(tmp_path):
    to = "casadi"  # which is checked the quickest
    folder = saved(exported(to), tmp_path / to)
    path = folder / "nlp_check.csv"
    first, *rest = path.read_text().splitlines()
    numbers = first.split(",")
    numbers[-1] = repr(float(numbers[-1]) + 1e-3)  # the Hessian's last nonzero
    path.write_text("\n".join([",".join(numbers), *rest]) + "\n")
    with pytest.raises(CheckError, match="hessian"):
        WRITERS[to][1](folder)


@pytest.mark.parametrize(("name", "steps"), MOTIONS)
def test_first_derivatives_are_those_of_differences_and_no_nonzero_is_missing(
    name, steps, tmp_path
):
    folder = saved(exported("casadi", name, steps), tmp_path / name)
    functions, rng = loaded(folder), np.random.default_rng(2)
    _, _, x = table(folder, "unknowns.csv")
    x = x + 0.05 * rng.normal(size=x.size)
    at = ca.MX.sym("x", x.size)
    both = ca.Function("both", [at], [ca.vertcat(*functions["nlp"](at, 0))])
    values = differences(lambda at: both(at).full().ravel(), x)
    first = functions["nlp_grad_f"](x=x)["grad_f_x"].full().ravel()
    jacobian = functions["nlp_jac_g"](x=x)["jac_g_x"]
    assert np.abs(values[0] - first).max() <= DIFFERENCES * np.abs(first).max()
    error = np.abs(values[1:] - jacobian.full())
    assert error.max() <= DIFFERENCES * np.abs(jacobian.full()).max()
    outside = np.ones(jacobian.shape, bool)
    outside[jacobian.sparsity().get_triplet()] = False
    assert np.abs(values[1:][outside]).max() <= DIFFERENCES


@pytest.mark.parametrize(("name", "steps"), MOTIONS)
def test_the_hessian_is_that_of_differences_and_an_upper_triangle(name, steps, tmp_path):
    folder = saved(exported("casadi", name, steps), tmp_path / name)
    functions, rng = loaded(folder), np.random.default_rng(3)
    _, _, x = table(folder, "unknowns.csv")
    x = x + 0.05 * rng.normal(size=x.size)
    lam_f, lam_g = 1.7, rng.normal(size=functions["nlp_jac_g"].size1_out("g"))

    at = ca.MX.sym("x", x.size)
    jacobian = functions["nlp_jac_g"](x=at)["jac_g_x"]
    slope = lam_f * functions["nlp_grad_f"](x=at)["grad_f_x"] + ca.mtimes(jacobian.T, lam_g)
    gradient = ca.Function("gradient", [at], [slope])
    expected = differences(lambda at: gradient(at).full().ravel(), x)
    upper = functions["nlp_hess_l"](x=x, lam_f=lam_f, lam_g=lam_g)["triu_hess_gamma_x_x"].full()
    assert np.array_equal(upper, np.triu(upper))
    hessian = upper + np.triu(upper, 1).T
    assert np.abs(hessian - expected).max() <= DIFFERENCES * np.abs(hessian).max()


# --- in C ----------------------------------------------------------------------------------


def test_example_and_check_run_without_a_fault_of_memory(tmp_path):
    folder = saved(exported("c"), tmp_path / "c")
    flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Wconversion", "-Werror"]
    for program in ("example", "check"):
        sources = [f"{program}.c", "nlp.c", "nlp_data.c"]
        built = [tool("gcc"), *flags, "-o", program, *sources, "-lm"]
        subprocess.run(built, cwd=folder, check=True)
        watched = [tool("valgrind"), "-q", "--leak-check=full", "--error-exitcode=9"]
        assert subprocess.run([*watched, f"./{program}"], cwd=folder).returncode == 0


def test_the_cmake_file_builds_and_its_test_passes(tmp_path):
    folder = saved(exported("c"), tmp_path / "c")
    for command in ("cmake -S . -B build", "cmake --build build", "ctest --test-dir build"):
        program, *arguments = command.split()
        done = subprocess.run([tool(program), *arguments], cwd=folder, capture_output=True)
        assert done.returncode == 0, done.stderr


def test_a_name_cannot_end_a_comment(tmp_path):
    odd = request()
    odd = Request(odd.model, odd.what, "*/ int main; /* %d\\", motion=odd.motion)
    assert "int main" in (head := nlp.write_nlp_c(odd)["nlp.c"][:80])
    assert "*/" not in head
    assert "\\" not in head


# --- in Octave -----------------------------------------------------------------------------


def test_the_gateway_says_what_is_wrong_with_a_call(tmp_path):
    folder = saved(exported("mex"), tmp_path / "mex")
    build_mex(folder, "nlp", ["nlp_mex.c", "nlp.c", "nlp_data.c"])
    assert "unknowns" in run_octave(folder, "nlp_example")
    for call, fault in {
        "nlp()": "expected a name first",
        "nlp('nlp_h', 1)": "no such function",
        "nlp('nlp_f')": "expected 1 to 2 inputs",
        "nlp('nlp_f', [1 2 3])": "nlp_f: expected x as",
        "nlp('pattern', 'nlp_f')": "no such function",
    }.items():
        with pytest.raises(CheckError, match=re.escape(fault)):
            run_octave(folder, call)


# --- the optimum, from the exported files alone --------------------------------------------


@cache
def planned_objective():
    """The objective that the planner's horizon reaches."""
    return plan_motion(first_steps("lift-log", 2)).solves[-1].objective


# Ipopt stops at relative errors of 1e-8 in the optimality conditions, so that objectives of
# 1e-3 agree better than that; its bounds are relaxed by 1e-8.
OPTIMUM = 1e-6


def test_the_compiled_library_alone_leads_a_solver_to_the_planners_optimum(tmp_path):
    folder = saved(exported("c"), tmp_path / "c")
    sources = ["-o", "nlp.so", "nlp.c", "nlp_data.c"]
    subprocess.run([tool("gcc"), "-O1", "-shared", "-fPIC", *sources], cwd=folder, check=True)
    lower, upper, start = table(folder, "unknowns.csv")
    low, high = table(folder, "rows.csv")
    options = {"no_nlp_grad": True, "calc_lam_p": False, "ipopt.mu_init": 1e-6}
    solver = ca.nlpsol("solver", "ipopt", str(folder / "nlp.so"), options)
    found = solver(x0=start, lbx=lower, ubx=upper, lbg=low, ubg=high)
    assert solver.stats()["success"]
    assert float(found["f"]) == pytest.approx(planned_objective(), rel=OPTIMUM)


def test_the_program_beside_the_casadi_files_solves_the_motion(tmp_path):
    folder = saved(exported("casadi"), tmp_path / "casadi")
    ran = subprocess.run(
        [sys.executable, "solve.py"], cwd=folder, check=True, capture_output=True, text=True
    )
    (said,) = [line for line in ran.stdout.splitlines() if line.startswith("objective ")]
    assert float(said.split()[1]) == pytest.approx(planned_objective(), rel=OPTIMUM)
    assert np.loadtxt(folder / "solution.csv").size == len(table(folder, "unknowns.csv")[0])


# --- names ---------------------------------------------------------------------------------


def layout(files):
    return json.loads(files["layout.json"])


def indices(known, part):
    """All indices of a range, (shape, components)."""
    parts = part["components"]
    width = len(known["components"][parts] if isinstance(parts, str) else parts)
    shape = (*part.get("shape", ()), width)
    return part["first"] + np.arange(int(np.prod(shape))).reshape(shape)


@pytest.mark.parametrize(("name", "steps"), [*MOTIONS, ("lift-log", 2)])
def test_every_unknown_row_and_parameter_has_one_name(name, steps):
    known = layout(exported("casadi", name, steps))
    for part in ("x", "g", "p"):
        every = np.concatenate([indices(known, entry).ravel() for entry in known[part]])
        assert np.array_equal(np.sort(every), np.arange(known["sizes"][part]))


def test_named_and_scaled_the_start_is_the_passive_trunk(tmp_path):
    folder = saved(exported("casadi"), tmp_path / "casadi")
    known = layout(exported("casadi"))
    _, _, start = table(folder, "unknowns.csv")
    motion = first_steps("lift-log", 2)
    passive = solve_statics(motion.trunk, np.zeros(28), (0, 0), Loads(motion.gravity))
    first = [part for part in known["x"] if part["step"] == 1]
    edges = {part["name"]: part for part in first if part.get("Z") == "element edges"}
    Z = np.array(known["Z"]["element edges"])
    scale = {
        kind: np.array([c["scale"] for c in parts]) for kind, parts in known["components"].items()
    }
    position = start[indices(known, edges["centerline"])] * scale["position"]
    assert np.abs(position - passive.position(Z)).max() <= 1e-6  # m; another mesh
    moment = (start[indices(known, edges["rod"])] * scale["state"])[:, 4:]
    assert np.abs(moment - passive.moment(Z)).max() <= 1e-5 * np.abs(moment).max()


def test_bounds_of_a_named_muscle_are_those_of_the_motion(tmp_path):
    folder = saved(exported("casadi"), tmp_path / "casadi")
    known, motion = layout(exported("casadi")), first_steps("lift-log", 2)
    lower, upper, _ = table(folder, "unknowns.csv")
    (part,) = [e for e in known["x"] if (e["name"], e["step"]) == ("activation", 2)]
    names = [c["name"] for c in known["components"]["activations"]]
    at, muscle = part["first"] + names.index("R2-dl"), motion.trunk.muscles.index("R2-dl")
    box = motion.steps[1].box
    assert (lower[at], upper[at]) == (box.lower[muscle], box.upper[muscle])


def test_moving_the_targets_by_their_parameters_is_moving_the_motions_targets(tmp_path):
    folder, offset = saved(exported("casadi"), tmp_path / "casadi"), (0.01, -0.02, 0.03)
    known, functions = layout(exported("casadi")), loaded(folder)
    _, _, x = table(folder, "unknowns.csv")
    change = np.zeros(known["sizes"]["p"])
    for part in known["p"]:
        if part["name"] == "squared_distance":
            change[indices(known, part)[:, :3]] = offset
    moved = request()
    moved = Request(moved.model, moved.what, "moved", motion=moved.motion.shifted(offset))
    other = nlp.export_nlp(moved).functions["nlp"]
    f, g = functions["nlp"](x, change)
    expected_f, expected_g = other(x, 0)
    assert float(f) == pytest.approx(float(expected_f), rel=1e-12)  # round-off
    assert np.abs((g - expected_g).full()).max() == 0
    assert float(f) != pytest.approx(float(functions["nlp"](x, 0)[0]), rel=1e-3)


# --- bad use -------------------------------------------------------------------------------


@pytest.mark.parametrize("to", WRITERS)
def test_an_anatomy_has_no_constraints(to):
    trunk = first_steps("lift-log", 2).trunk
    with pytest.raises(InputError, match="expected a problem"):
        WRITERS[to][0](Request(build_model(trunk), "constraints", "asian-elephant"))


def test_gaps_from_bodies_are_not_exported():
    motion = first_steps("lift-log", 2).with_contact("log")
    with pytest.raises(InputError, match=r"without \[contact\]"):
        WRITERS["c"][0](
            Request(build_model(motion.trunk), "constraints", "lift-log", motion=motion)
        )


@pytest.mark.parametrize(("to", "line"), [("c", "install gcc"), ("mex", "install octave")])
def test_a_missing_tool_is_named_with_the_line_that_installs_it(to, line, tmp_path, monkeypatch):
    folder = saved(exported(to), tmp_path / to)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ToolMissingError, match=line):
        WRITERS[to][1](folder)
