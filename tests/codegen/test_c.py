"""The C99 export: shapes, derivatives, failures and memory, of the program as it is compiled."""

import ctypes
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor

import exported
import numpy as np
import pytest

from trunk_ocp.codegen.c import check_c, write_c
from trunk_ocp.codegen.request import CheckError, Request, ToolMissingError
from trunk_ocp.codegen.run_checks import STRICT
from trunk_ocp.codegen.shape_model import build_model, reference
from trunk_ocp.model.loads import Loads
from trunk_ocp.rod.unloaded import unloaded_states

pytestmark = pytest.mark.slow

VALUE = 1e-10  # promised agreement, with different meshes and formulations on either side
SLOPE = 1e-8  # and that for high-order differences
WARM = ("warm", "warm jacobian", "warm second")  # kinds of outputs, in what a check prints
SAME = 1e-12  # Newton's method leaves 1e-13 of a shape, wherever it starts
RESOLVED = 1e-6  # what a mesh that is judged fine enough leaves of a shape, whatever the load
OK, NOT_FOUND, COLLAPSED, NOT_FINITE, COARSE = range(5)
WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])  # eighth-order central differences


def run(*command, folder=None):
    done = subprocess.run(list(map(str, command)), cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


class Library:
    """A compiled trunk.c, called through ctypes; `work` as the memory of a caller."""

    def __init__(self, source, model, *options):
        library = source.parent / "libtrunk.so"
        run("cc", *STRICT, *options, "-fPIC", "-shared", source, "-o", library, "-lm")
        self.c, self.layout, self.points = ctypes.CDLL(library), model.layout, len(model.Z)
        self.c.trunk_work_size.restype = ctypes.c_size_t
        self.c.trunk_message.restype = ctypes.c_char_p
        self.work = self.new_work()

    def new_work(self):
        work = ctypes.create_string_buffer(self.c.trunk_work_size())
        self.c.trunk_reset(work)
        return work

    def status(self, name, *arguments):
        """Call a function with works and arrays as they are, other arguments as float arrays."""
        memory = [a if isinstance(a, np.ndarray | ctypes.Array) else _floats(a) for a in arguments]
        return getattr(self.c, name)(
            *(_pointer(a) if isinstance(a, np.ndarray) else a for a in memory)
        )

    def loaded(self, x, work=None):
        y = np.full((self.points, 19), np.nan)
        assert self.status("trunk_loaded", list(x), work or self.work, y) == OK
        return y

    def cold(self, x):
        return self.loaded(x, self.new_work())

    def jacobian(self, x, work=None):
        J = np.full((self.points, 19, self.layout.size), np.nan)
        self.loaded(x, work)
        assert self.status("trunk_jacobian", work or self.work, J) == OK
        return J

    def second(self, x, v):
        dJ = np.full((self.points, 19, self.layout.size), np.nan)
        self.loaded(x)
        assert self.status("trunk_second", self.work, list(v), dJ) == OK
        return dJ

    def unloaded(self, controls):
        y = np.full((self.points, 16), np.nan)
        J = np.full((self.points, 16, self.layout.controls), np.nan)
        assert self.status("trunk_unloaded", list(controls), y, J) == OK
        return y, J


def _floats(values):
    return np.array(values, dtype=float)


def _pointer(array):
    assert array.flags.c_contiguous
    return array.ctypes.data_as(ctypes.c_void_p)


def differences(function, x, v):
    """Derivative of a function along v, to eighth order in v."""
    return sum(
        w * (function(x + i * v) - function(x - i * v)) for i, w in enumerate(WEIGHTS, start=1)
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """An export with everything, and its check files."""
    folder = tmp_path_factory.mktemp("c")
    exported.export(folder, write_c(exported.request(second=True)))
    exported.write_checks(folder)
    return folder


@pytest.fixture(scope="module")
def compiled(folder):
    """trunk.o for all tests that do not ask how it is compiled."""
    made = folder / "trunk.o"
    run("cc", *STRICT, "-g", "-O1", "-fPIC", "-c", folder / "trunk.c", "-o", made)
    return made


@pytest.fixture(scope="module")
def fast(folder):
    """trunk.o as users compile it."""
    made = folder / "trunk_fast.o"
    run("cc", *STRICT, "-O3", "-c", folder / "trunk.c", "-o", made)
    return made


@pytest.fixture(scope="module")
def library(compiled):
    return Library(compiled, exported.model())


@pytest.fixture(scope="module")
def check(folder, compiled):
    """The check program."""
    program = folder / "check"
    run("cc", *STRICT, "-g", folder / "check.c", compiled, "-o", program, "-lm")
    return program


@pytest.fixture
def x():
    return exported.inputs()


@pytest.fixture
def direction():
    """A change of all inputs: 0.2 % of an activation, some N of a load."""
    v = np.random.default_rng(2).normal(size=exported.model().layout.size)
    v[: exported.model().layout.controls] *= 2e-3
    return v


def push(x, newtons):
    """The same inputs with a push on the tip toward the base."""
    x = x.copy()
    x[exported.model().layout.inputs["tip_force"]] = (5.0, 3.0, -newtons)
    return x


# Numbers


def test_loaded_shapes_are_those_of_solve_statics(library, x):
    y = np.array([library.cold(row) for row in x])
    assert max(exported.agreement(y, reference(exported.model(), x))) < VALUE


def test_unloaded_shapes_are_the_closed_form(library, x):
    model, n = exported.model(), exported.model().layout.controls
    y, _ = library.unloaded(x[0, :n])
    r, _ = unloaded_states(model.trunk, x[0, : n - 2], x[0, n - 2 : n], np.array(model.Z))
    np.testing.assert_allclose(y[:, :3], r, atol=1e-14)  # round-off of meters


def test_the_jacobian_is_the_slope_of_the_shape(library, x, direction):
    for row in x[:2]:
        wanted = differences(library.loaded, row, direction)
        got = library.jacobian(row) @ direction
        assert max(exported.agreement(got[None], wanted[None])) < SLOPE


def test_the_second_derivative_is_the_slope_of_the_jacobian(library, x, direction):
    wanted = differences(library.jacobian, x[0], direction)
    assert max(exported.agreement(library.second(x[0], direction)[None], wanted[None])) < SLOPE


def test_the_unloaded_jacobian_is_the_slope_of_the_unloaded_shape(library, x, direction):
    n = exported.model().layout.controls
    wanted = differences(lambda controls: library.unloaded(controls)[0], x[0, :n], direction[:n])
    got = library.unloaded(x[0, :n])[1] @ direction[:n]
    assert max(exported.agreement(got[None], wanted[None])) < SLOPE


def test_a_jacobian_asked_for_again_is_the_same(library, x):
    first = library.jacobian(x[0])
    again = np.zeros_like(first)
    assert library.status("trunk_jacobian", library.work, again) == OK
    np.testing.assert_array_equal(again, first)


# Where a shape starts from


def test_a_shape_does_not_depend_on_the_one_before(library, x):
    for step in np.linspace(0, 1, 30):
        here = x[0] + step * (x[1] - x[0])
        warm, cold = library.loaded(here), library.cold(here)
        np.testing.assert_allclose(warm, cold, rtol=SAME, atol=SAME * np.abs(cold).max())
        library.jacobian(here)


PROBE = """
#include "trunk.c"
/* Whether Newton's method gets from the unloaded shape to the full load at once. */
int at_once(const double *x, trunk_work *work)
{
    trunk_reset(work);
    work->head[0] = x[TRUNK_HEAD];
    work->head[1] = x[TRUNK_HEAD + 1];
    set_strain(x, work->strain, &work->mean);
    set_loads(work, x, 1);
    set_unloaded(work);
    work->steps_left = TRUNK_MAX_STEPS;
    return newton(work);
}
int steps(const trunk_work *work) { return TRUNK_MAX_STEPS - work->steps_left; }
"""


@pytest.fixture(scope="module")
def probe(folder, tmp_path_factory):
    """A library that sees what trunk.c keeps to itself."""
    place = tmp_path_factory.mktemp("probe")
    (place / "probe.c").write_text(PROBE)
    made = place / "probe.so"
    run("cc", "-I", folder, "-O0", "-fPIC", "-shared", place / "probe.c", "-o", made, "-lm")
    return ctypes.CDLL(made)


def test_a_push_that_buckles_the_trunk_is_reached_by_raising_the_load(library, probe, x):
    hard = push(x[0], 600.0)
    assert not probe.at_once(_pointer(hard), library.new_work())
    y = library.cold(hard)
    assert max(exported.agreement(y[None], reference(exported.model(), hard[None]))) < VALUE


def test_a_start_that_does_not_help_is_given_up_for_the_unloaded_shape(library, x):
    library.jacobian(push(x[0], 2000.0))
    far = x[1].copy()
    far[:28] = x[2][:28]
    y, wanted = library.loaded(far), reference(exported.model(), far[None])
    assert max(exported.agreement(y[None], wanted)) < VALUE


# Failures


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({0: np.nan}, NOT_FINITE),
        ({31: np.inf}, NOT_FINITE),
        (dict.fromkeys(range(28), -40.0), COLLAPSED),
        ({31: 1e12, 32: 1e12}, NOT_FOUND),
        ({36: 1e155}, NOT_FOUND),  # an overflow makes inf - inf
    ],
)
def test_a_call_that_fails_says_why_and_leaves_a_clean_work(library, x, change, status):
    bad, y, J = x[0].copy(), np.full((3, 19), 7.0), np.zeros((3, 19, 40))
    for place, value in change.items():
        bad[place] = value
    library.jacobian(x[0])
    assert library.status("trunk_loaded", bad, library.work, y) == status
    assert np.all(y == 7.0)
    assert library.status("trunk_jacobian", library.work, J) == NOT_FOUND
    np.testing.assert_array_equal(library.loaded(x[0]), library.cold(x[0]))


def test_a_shape_too_sharp_for_the_mesh_is_not_handed_out(library, x):
    bad, work = x[3].copy(), library.new_work()
    bad[31:34] = -2954.6834944158345, -514.2294576400819, -73.57657726354667
    y, J = np.full((3, 19), 7.0), np.zeros((3, 19, 40))
    assert library.status("trunk_loaded", bad, work, y) == COARSE
    assert np.all(y == 7.0)
    assert library.status("trunk_jacobian", work, J) == NOT_FOUND
    np.testing.assert_array_equal(library.loaded(x[0], work), library.cold(x[0]))


def test_no_load_however_heavy_gives_a_shape_that_the_mesh_does_not_resolve(library, x):
    told = []
    for newtons in (100.0, 300.0, 600.0, 1000.0, 3000.0, 1e4):
        for direction in (0.97, 0.2, -0.1), (-0.98, -0.17, -0.02):
            row, y = x[3].copy(), np.zeros((1, 3, 19))
            row[exported.model().layout.inputs["tip_force"]] = newtons * np.array(direction)
            told.append(library.status("trunk_loaded", row, library.new_work(), y))
            if told[-1] == OK:
                wanted = reference(exported.model(), row[None])
                assert max(exported.agreement(y, wanted)) < RESOLVED, (newtons, direction)
    assert {OK, COARSE} <= set(told)


def test_a_call_that_fails_ends_after_so_many_steps(library, probe, x):
    bad, work, y = x[0].copy(), library.new_work(), np.zeros((3, 19))
    bad[31:34] = 1e6
    assert probe.trunk_loaded(_pointer(bad), work, _pointer(y)) != OK
    assert probe.steps(work) <= 400


def test_unloaded_shapes_fail_alike(library, x):
    y, J = np.full((3, 16), 7.0), np.zeros((3, 16, 30))
    assert library.status("trunk_unloaded", np.eye(30)[0] * 1e300, y, J) == NOT_FINITE
    assert library.status("trunk_unloaded", np.full(30, np.nan), y, J) == NOT_FINITE
    assert library.status("trunk_unloaded", np.full(30, -40.0), y, J) == COLLAPSED
    assert np.all(y == 7.0)


def test_a_direction_that_is_not_finite_is_refused_and_the_shape_kept(library, x):
    dJ, J = np.zeros((3, 19, 40)), np.zeros((3, 19, 40))
    library.loaded(x[0])
    assert library.status("trunk_second", library.work, np.full(40, np.nan), dJ) == NOT_FINITE
    assert library.status("trunk_jacobian", library.work, J) == OK


def test_every_status_is_a_sentence_of_its_own(library):
    assert len({library.c.trunk_message(status) for status in range(6)}) == 6


# Memory


def test_two_trunks_in_turn_do_not_disturb_each_other(library, x):
    alone = [
        [library.jacobian(row + 1e-3 * i, work) for i in range(3)]
        for row, work in ((x[0], library.new_work()), (x[1], library.new_work()))
    ]
    works = library.new_work(), library.new_work()
    for i in range(3):
        for k in range(2):
            together = library.jacobian(x[k] + 1e-3 * i, works[k])
            np.testing.assert_array_equal(together, alone[k][i])


def test_two_threads_at_once_give_what_one_does(library, x):
    def follow(row):
        work = library.new_work()
        return np.array([library.jacobian(row * (1 - 1e-3 * i), work) for i in range(40)])

    with ThreadPoolExecutor(2) as pool:
        for got, row in zip(pool.map(follow, x), x, strict=True):
            np.testing.assert_array_equal(got, follow(row))


def test_nothing_is_allocated_and_nothing_kept(fast):
    symbols = [line.split()[-2:] for line in run("nm", fast).splitlines()]
    mathematics = {"sqrt", "sin", "cos", "sincos", "memset", "memcpy", "memmove"}
    assert {name for kind, name in symbols if kind == "U"} - {"_GLOBAL_OFFSET_TABLE_"} <= (
        mathematics | {"__stack_chk_fail"}
    )
    assert not [name for kind, name in symbols if kind in "bBC"]  # variables
    assert {name for kind, name in symbols if kind in "dD"} <= {"trunk_input_names"}


def test_valgrind_finds_no_fault(folder, check, tmp_path):
    for name in ("check.csv", "check_unloaded.csv"):
        rows = (folder / name).read_text().splitlines(keepends=True)
        (tmp_path / name).write_text("".join(rows[:2]))
    told = run("valgrind", "--error-exitcode=9", "--leak-check=full", "-q", check, tmp_path)
    assert "all agree" in told


# Compiling and checking


@pytest.mark.parametrize("name", ["trunk.c", "example.c", "check.c"])
def test_the_sources_compile_without_a_warning(folder, tmp_path, request, name):
    if name == "trunk.c":
        assert request.getfixturevalue("fast").exists()  # compiled the same way
        return
    assert run("gcc", *STRICT, "-O3", "-c", folder / name, "-o", tmp_path / "out.o") == ""


@pytest.mark.parametrize("option", ["-ffast-math", "-Ofast", "-ffinite-math-only"])
def test_a_compiler_may_not_think_that_all_numbers_are_finite(folder, option):
    command = ["cc", option, "-E", folder / "trunk.c"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode
    assert "without -ffast-math" in done.stderr


def test_the_header_is_cpp_as_well(folder, tmp_path):
    (tmp_path / "use.cpp").write_text(
        '#include "trunk.h"\nint use(trunk_work *w) { trunk_reset(w); return TRUNK_OK; }\n'
    )
    strict = ("-std=c++11", "-pedantic", *STRICT[2:])
    use = tmp_path / "use"
    assert run("g++", *strict, "-I", folder, "-c", f"{use}.cpp", "-o", f"{use}.o") == ""


def test_the_export_proves_itself(folder):
    told = check_c(folder)
    assert "all agree" in told
    for kind in ("loaded", "jacobian", "second", "unloaded", "unloaded_jacobian", *WARM):
        assert f"\n{kind} position" in "\n" + told


def test_a_check_file_with_a_wrong_number_is_found_out(folder, check, tmp_path):
    shutil.copy(folder / "check_unloaded.csv", tmp_path)
    rows = np.loadtxt(folder / "check.csv", delimiter=",")
    rows[1, 40 + 2] += 1e-8  # a position by 10 nm
    np.savetxt(tmp_path / "check.csv", rows, delimiter=",", fmt="%.17g")
    done = subprocess.run([check, tmp_path], capture_output=True, text=True)
    assert done.returncode == 1
    assert "some DISAGREE" in done.stdout


def test_a_warm_start_with_the_loads_of_the_last_shape_is_found_out(folder, tmp_path):
    source = (folder / "trunk.c").read_text()
    right = "    set_loads(work, x, 1);\n    if (work->found"
    assert source.count(right) == 1
    wrong = right.replace("set_loads", "if (!work->found) set_loads", 1)
    (tmp_path / "trunk.c").write_text(source.replace(right, wrong))
    sources, program = [tmp_path / "trunk.c", folder / "check.c"], tmp_path / "check"
    run("cc", "-O0", "-std=c99", "-I", folder, *sources, "-o", program, "-lm")
    done = subprocess.run([program, folder], capture_output=True, text=True)
    errors = dict(line.rsplit(" ", 1) for line in done.stdout.splitlines())
    assert done.returncode == 1
    assert float(errors["loaded position"]) < VALUE < float(errors["warm position"])


def test_sources_that_do_not_compile_are_told(folder, tmp_path):
    exported.export(tmp_path, write_c(exported.request()))
    (tmp_path / "trunk.c").write_text("int trunk(void) { return }\n")
    with pytest.raises(CheckError, match="error:"):
        check_c(tmp_path)


def test_a_missing_compiler_names_the_line_that_installs_one(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ToolMissingError, match="apt-get install gcc"):
        check_c(folder)


def test_cmake_builds_the_library_and_runs_the_check(folder, tmp_path):
    source = tmp_path / "source"
    shutil.copytree(folder, source)
    example = source / "example.c"
    example.write_text(example.read_text().replace("#define CALLS 20000", "#define CALLS 400"))
    run("cmake", "-S", source, "-B", tmp_path, "-DCMAKE_C_FLAGS_RELEASE=-O1")
    run("cmake", "--build", tmp_path)
    assert "100% tests passed" in run("ctest", "--test-dir", tmp_path)
    assert "CMAKE_BUILD_TYPE:STRING=Release" not in (tmp_path / "CMakeCache.txt").read_text()
    assert "microseconds per call" in run(tmp_path / "example")


# Other trunks and requests


def test_a_shape_alone_comes_without_derivatives(tmp_path, x):
    exported.export(tmp_path, write_c(exported.request("shape")))
    exported.write_checks(tmp_path, wanted=())
    sources = [tmp_path / "trunk.c", tmp_path / "check.c"]
    run("cc", *STRICT, "-O0", *sources, "-o", tmp_path / "check", "-lm")
    assert "jacobian" not in run(tmp_path / "check", tmp_path)
    assert "trunk_jacobian(" not in (tmp_path / "trunk.c").read_text()
    run("cc", *STRICT, "-c", tmp_path / "example.c", "-o", tmp_path / "example.o")


def test_a_rod_without_muscles_and_without_taper_bends_under_its_loads(build, tmp_path):
    model = build_model(build(), (0.5, 1.0), Loads(9.8))
    exported.export(tmp_path, write_c(Request(model, "jacobian", "rod", second=True)))
    library = Library(tmp_path / "trunk.c", model, "-O0")
    x = np.array([0.1, 0.2, 9.8, 0.3, -0.2, 0.1])
    y = library.loaded(x)
    np.testing.assert_allclose(y, reference(model, x[None])[0], rtol=VALUE, atol=VALUE)
    v = np.array([1e-2, 1e-2, 1e-1, 2e-2, 2e-2, 2e-2])
    wanted = differences(library.loaded, x, v)
    np.testing.assert_allclose(library.jacobian(x) @ v, wanted, rtol=SLOPE, atol=SLOPE * 1e-2)
    wanted = differences(library.jacobian, x, v)
    np.testing.assert_allclose(library.second(x, v), wanted, rtol=SLOPE, atol=1e-10)
    for name in ("example.c", "check.c"):
        run("cc", *STRICT, "-O0", "-c", tmp_path / name, "-o", tmp_path / "out.o")


def test_what_is_written_does_not_change_from_one_export_to_the_next():
    request = exported.request(second=True)
    assert write_c(request) == write_c(request)
