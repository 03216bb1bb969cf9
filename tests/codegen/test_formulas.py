"""The formulas of one muscle, to read: against quadrature, calculus and the trunk itself."""

import dataclasses
import math
import re
import subprocess
import sys

import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from matplotlib.mathtext import MathTextParser

from trunk_ocp.codegen import closed_forms as forms
from trunk_ocp.codegen import formulas
from trunk_ocp.codegen.request import CheckError, Request, ToolMissingError
from trunk_ocp.codegen.shape_model import build_model
from trunk_ocp.errors import InputError
from trunk_ocp.model.activation import radial_integrals, strain_matrix
from trunk_ocp.model.anatomy import AnatomySpec, build_trunk, load_anatomy

pytestmark = pytest.mark.slow

ELEPHANT = load_anatomy("asian-elephant")
KINDS = ("radial", "straight", "tapered", "helix", "steep", "gentle", "even")


def of(muscle, trunk=ELEPHANT):
    return Request(build_model(trunk), "jacobian", trunk.name, muscle=muscle)


def one_muscle(taper_deg, architecture, helix_deg=0.0, radii=(0.04, 0.09), name="rod", nu=0.45):
    """A trunk of two segments with a bender in both, and a muscle R1-own."""
    own = {"group": "own", "architecture": architecture, "radii_over_length": radii}
    own |= {"sector": (0.4, 2.9), "helix_deg": helix_deg, "sides": ("R",)}
    bender = {"group": "dl", "architecture": "longitudinal", "radii_over_length": (0.05, 0.1)}
    bender |= {"sector": (0.0, 1.5)}
    return build_trunk(
        AnatomySpec.model_validate(
            {
                "name": name,
                "length": 1.6,
                "base_radius_over_length": 0.1,
                "taper_deg": taper_deg,
                "material": {"youngs_modulus": 1e6, "poisson_ratio": nu, "density": 1000.0},
                "segments": (
                    {"Z_over_length": (0.0, 0.6), "muscles": (own, bender)},
                    {"Z_over_length": (0.6, 1.0), "muscles": (bender,)},
                ),
            }
        )
    )


def kinds():
    """A trunk for each closed form; its muscle is R1-own."""
    even = math.degrees(math.atan(math.tan(math.radians(3.0)) * 0.9))
    return {
        "radial": one_muscle(3.0, "radial"),
        "straight": one_muscle(0.0, "longitudinal"),
        "tapered": one_muscle(3.0, "longitudinal"),
        "helix": one_muscle(0.0, "helical", -25.0),
        "steep": one_muscle(3.0, "helical", 25.0),
        "gentle": one_muscle(3.0, "helical", 0.8 * even),
    }


def write(folder, files):
    for name, content in files.items():
        (folder / name).write_text(content)
    return folder


def module(files):
    """The names of trunk_formulas.py."""
    space = {"__name__": "trunk_formulas"}
    exec(files["trunk_formulas.py"], space)
    return space


def at(values, expression):
    return expression.doit().evalf(50, subs=values)


def chain(kind, values):
    """Values of delta_0, delta_1, delta_3 from the closed form of a kind."""
    values = {sp.Symbol(name, real=True): sp.Float(x, 50) for name, x in values.items()}
    for formula in forms.radial_factors(kind):
        values[sp.Symbol(formula.name, real=True)] = at(values, formula.expression)
    return [values[sp.Symbol(name, real=True)] for name in ("delta_0", "delta_1", "delta_3")]


def by_definition(kind, values):
    """The same from eq. (6) with the fiber direction printed beside them, by quadrature."""
    mp.mp.dps = 40
    known = {sp.Symbol(name, real=True): sp.Float(x, 50) for name, x in values.items()}
    R, nu = sp.Symbol("R", real=True), mp.mpf(values["nu"])
    along, around = (
        sp.lambdify(R, formula.expression.doit().subs(known), "mpmath")
        for formula in forms.fiber(kind)
    )
    integrands = (
        lambda r: ((1 + nu) * along(r) - nu) * r,
        lambda r: ((1 + nu) * along(r) - nu) * r**2,
        lambda r: around(r) * r**2,
    )
    ends = [mp.mpf(values["R_1"]), mp.mpf(values["R_2"])]
    return [mp.quad(f, ends) for f in integrands]


def drawn(kind, seed):
    """Random radii, taper and helix of a kind."""
    rng = np.random.default_rng(seed)
    R_1, R_2 = np.sort(rng.uniform(0.02, 0.3, 2))
    k = 0.0 if kind in ("straight", "helix") else rng.uniform(0.05, 3)
    h = {"steep": k + rng.uniform(0.1, 9), "gentle": k * rng.uniform(0.1, 0.9), "even": k}
    h = h.get(kind, rng.uniform(0.5, 9)) * rng.choice([-1, 1])
    return {"R_1": R_1, "R_2": R_2, "nu": rng.uniform(-0.5, 0.5), "k": k, "h": h}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("kind", KINDS)
def test_radial_factors_are_the_integrals_that_define_them(kind, seed):
    values = drawn(kind, seed)
    for found, wanted in zip(chain(kind, values), by_definition(kind, values), strict=True):
        # 40 digits of quadrature, 50 less some cancellation of the closed form.
        assert abs(found - wanted) <= 1e-30 * abs(wanted)


@pytest.mark.parametrize("kind", ["steep", "gentle", "tapered"])
def test_the_fiber_direction_is_that_of_eqs_9_to_22(kind):
    values = drawn(kind, 5) | {"R": 0.17}
    known = {sp.Symbol(name, real=True): x for name, x in values.items()}
    h = 0.0 if kind == "tapered" else values["h"]
    helix, taper = math.atan(h * 0.17), math.atan(values["k"] * 0.17)
    wanted = (math.cos(helix) * math.cos(taper)) ** 2  # D_Z of eq. (9) with beta = 0
    twist = math.sin(helix) * math.cos(helix) * math.cos(taper)
    along, around = (float(at(known, f.expression)) for f in forms.fiber(kind))
    assert (along, around) == pytest.approx((wanted, twist), rel=1e-14)


@pytest.mark.parametrize(
    ("near", "change", "limit"),
    [
        ("gentle", {"h": 1e-9}, "tapered"),
        ("steep", {"k": 1e-9}, "helix"),
        ("steep", {"k": 2.0, "h": 2.0 + 1e-9}, "even"),
        ("gentle", {"k": 2.0, "h": -2.0 + 1e-9}, "even"),
        ("helix", {"h": 1e-9}, "straight"),
        ("tapered", {"k": 1e-9}, "straight"),
    ],
)
def test_radial_factors_tend_to_the_right_limits(near, change, limit):
    values = drawn(near, 8) | change
    there = values | ({"h": math.copysign(values["k"], values["h"])} if limit == "even" else {})
    # The next order of the changed rate (1e-9) is first at |h| = k, of delta_3 always.
    for found, wanted in zip(chain(near, values), chain(limit, there), strict=True):
        assert float(found) == pytest.approx(float(wanted), rel=1e-8, abs=1e-10)


@pytest.mark.parametrize("trunk", [ELEPHANT, *kinds().values()], ids=["elephant", *kinds()])
def test_every_coefficient_is_that_of_the_strain_map(trunk):
    A = strain_matrix(trunk)
    for column, muscle in enumerate(trunk.subdomains):
        values = {name: float(x) for name, x in forms.coefficient_values(trunk, muscle).items()}
        factors = [values[f"delta_{i}"] for i in (0, 1, 3)]
        slopes = [values[f"{name}_gamma"] for name in ("zeta", "c_1", "c_2", "c_3")]
        # Gauss-Legendre with 64 nodes, summed in double.
        np.testing.assert_allclose(factors, radial_integrals(trunk, muscle), rtol=1e-12)
        wanted = A[muscle.segment, :, column]
        np.testing.assert_allclose(slopes, wanted, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("kind", kinds())
def test_a_muscle_gets_the_closed_form_of_its_kind(kind):
    trunk = kinds()[kind]
    assert forms.kind(trunk, trunk.subdomains[0]) == kind


@pytest.mark.parametrize("trunk", [ELEPHANT, kinds()["helix"]], ids=["tapered", "untapered"])
def test_the_jacobian_is_the_derivative_of_the_closed_form(trunk):
    name = "R2-ivo" if trunk is ELEPHANT else "R1-own"
    space = module(formulas.write_sympy(of(name, trunk)))
    spiral, gamma = space["spiral"](), sp.Symbol("gamma", real=True)
    symbols = {n: sp.Symbol(n, real=True) for n in ("zeta", "c_1", "c_2", "c_3")}
    moved = {s: s + gamma * sp.Symbol(f"{n}_gamma", real=True) for n, s in symbols.items()}
    rng, values = np.random.default_rng(2), {}
    for symbol in {s for x in [*spiral["rho_gamma"], *spiral["d"][0]] for s in x.free_symbols}:
        values[symbol] = sp.Float(rng.uniform(0.3, 1.5), 40)
    values[sp.Symbol("k", real=True)] = sp.Float(0.4, 40)
    values[sp.Symbol("Z_1", real=True)] = sp.Float(0.2, 40)
    turn = number(spiral["theta_gamma"], values)

    def slope(vector):
        by_gamma = vector.subs(moved, simultaneous=True).diff(gamma).subs(gamma, 0)
        return number(by_gamma, values)

    # Both with 50 digits.
    assert (slope(spiral["rho"]) - number(spiral["rho_gamma"], values)).norm() < 1e-25
    for d_i in spiral["d"]:
        assert (slope(d_i) - turn.cross(number(d_i, values))).norm() < 1e-25


def number(vector, values):
    """A vector at values, with 50 digits."""
    with mp.workdps(50):
        evaluate = sp.lambdify([*values], list(vector), "mpmath")
        parts = evaluate(*(mp.mpf(str(value)) for value in values.values()))
        return sp.Matrix([sp.Float(str(part), 50) for part in parts])


def test_a_straight_segment_is_the_limit_of_a_spiral():
    space = module(formulas.write_sympy(of("R1-ivo")))
    values = {"Z": 0.6, "Z_1": 0.1, "k": 0.4, "zeta": 0.9, "zeta_gamma": 0.1}
    values |= {"c_1_gamma": 0.7, "c_2_gamma": -0.4, "c_3_gamma": 0.3}
    values |= {"c_1": 1e-12, "c_2": 2e-12, "c_3": -1e-12}
    values = {sp.Symbol(name, real=True): sp.Float(x, 60) for name, x in values.items()}
    curved, straight = space["spiral"](), space["straight"]()
    for name in ("rho", "theta_gamma", "rho_gamma"):
        difference = number(curved[name], values) - number(straight[name], values)
        assert difference.norm() < 1e-11  # of first order in c = 2e-12


@pytest.mark.parametrize("muscle", ["R1-dl", "L3-ovo"])
def test_the_module_gives_the_numbers_of_the_trunk(tmp_path, muscle):
    told = formulas.check_sympy(write(tmp_path, formulas.write_sympy(of(muscle))))
    errors = dict(line.split()[1:] for line in told.splitlines())
    assert set(errors) == {"position", "directors", "d_position", "d_directors", "coefficients"}
    assert max(map(float, errors.values())) < 1e-12  # round-off of differences of order 8


@pytest.mark.parametrize("kind", kinds())
def test_the_module_of_every_kind_proves_itself(tmp_path, kind):
    files = formulas.write_sympy(of("R1-own", kinds()[kind]))
    assert "formulas d_position" in formulas.check_sympy(write(tmp_path, files))


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("+ Q * agamma_x_e3", "- Q * agamma_x_e3"),
        ("4 * delta_1", "4.000001 * delta_1"),
        ("sin(theta) * a_gamma", "sin(theta) * a"),
    ],
)
def test_a_wrong_formula_is_found_out(tmp_path, right, wrong):
    files = formulas.write_sympy(of("R1-ovo"))
    assert right in files["trunk_formulas.py"]
    files["trunk_formulas.py"] = files["trunk_formulas.py"].replace(right, wrong)
    with pytest.raises(CheckError, match="formulas d_position"):
        formulas.check_sympy(write(tmp_path, files))


def test_the_module_runs_by_itself(tmp_path):
    write(tmp_path, formulas.write_sympy(of("R3-ovo")))
    command = [sys.executable, "trunk_formulas.py"]
    told = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    A = strain_matrix(ELEPHANT)[2, :, ELEPHANT.muscles.index("R3-ovo")]
    shown = re.search(r"c_3_gamma = .*\n    = (\S+)", told)
    assert float(shown[1]) == pytest.approx(A[3], rel=1e-11)  # 12 digits are shown


def test_at_rest_the_tip_moves_as_the_trunk_says():
    for name in ("R1-ivo", "R3-ovo"):
        column = ELEPHANT.muscles.index(name)
        slope = formulas._slope(ELEPHANT, np.zeros(28), np.zeros(2), np.array([1.75]), column)
        frame = formulas._pose(ELEPHANT, np.zeros(28), np.zeros(2), np.array([0.0]))[0, 3:]
        told = forms.rest_slopes(ELEPHANT, ELEPHANT.subdomains[column])["tip"]
        np.testing.assert_allclose(frame.reshape(3, 3).T @ told, slope[0, :3], atol=1e-13)


def formulas_of(trunk, muscle):
    tapered, kind = trunk.taper_rate > 0, forms.kind(trunk, muscle)
    yield from forms.fiber(kind)
    yield from forms.coefficient_formulas(kind)
    yield from forms.axis()
    yield from forms.stretched(tapered)
    yield from forms.spiral()
    yield from forms.spiral_slopes()
    yield from forms.straight_slopes(tapered)


def test_every_formula_is_well_formed_and_on_the_page():
    parser = MathTextParser("path")
    for trunk in kinds().values():
        muscle = trunk.subdomains[0]
        page = formulas.write_latex(of(muscle.name, trunk))["trunk_formulas.tex"]
        whole = re.sub(r"\\\\\n&\\quad", "", page)  # long sums are broken
        for formula in formulas_of(trunk, muscle):
            parser.parse(f"${formula.tex_name} = {formula.tex}$")
            assert formula.tex in whole


def test_every_formula_of_the_page_is_in_the_module():
    trunk = kinds()["steep"]
    source = formulas.write_sympy(of("R1-own", trunk))["trunk_formulas.py"]
    plain = re.sub(r"[\s()]", "", source)
    for formula in formulas_of(trunk, trunk.subdomains[0]):
        if not formula.name.startswith("D_"):  # the module has the integrals done
            assert re.sub(r"[\s()]", "", formula.python) in plain


@pytest.mark.parametrize("kind", kinds())
def test_the_page_compiles_without_a_line_that_is_too_wide(tmp_path, kind):
    files = formulas.write_latex(of("R1-own", kinds()[kind]))
    assert "compile" in formulas.check_latex(write(tmp_path, files))


def test_a_name_may_have_any_characters(tmp_path):
    trunk = one_muscle(3.0, "helical", 25.0, name=r'50% "a_b" \& {#} $x$ ~^ """ <<side>>')
    request = of("R1-own", trunk)
    write(tmp_path, formulas.write_sympy(request) | formulas.write_latex(request))
    assert "compile" in formulas.check_latex(tmp_path)
    assert "formulas position" in formulas.check_sympy(tmp_path)


def test_a_page_that_does_not_compile_is_found_out(tmp_path):
    files = formulas.write_latex(of("R1-dl"))
    write(tmp_path, {"trunk_formulas.tex": files["trunk_formulas.tex"].replace(r"\frac", r"\frc")})
    with pytest.raises(CheckError, match="Undefined control sequence"):
        formulas.check_latex(tmp_path)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("R1dl", "not a muscle of asian-elephant. Did you mean R1-dl?"),
        ("r2-IVO", "Did you mean R2-ivo?"),
        ("trapezius", "It has R1- and L1- dl, ovo, ivo, dr, vr; R2- and L2- "),
        (None, "--muscle: formulas are for one muscle; asian-elephant has R1- and L1- dl"),
    ],
)
@pytest.mark.parametrize("to", [formulas.write_sympy, formulas.write_latex])
def test_an_unknown_muscle_gets_a_clear_error(name, told, to):
    with pytest.raises(InputError) as raised:
        to(dataclasses.replace(of("R1-dl"), muscle=name))
    assert told in str(raised.value)
    assert len(str(raised.value)) < 220


def test_without_sympy_the_error_has_the_line_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "sympy", None)
    for to in (formulas.write_sympy, formulas.write_latex):
        with pytest.raises(ToolMissingError, match="pip install sympy"):
            to(of("R1-dl"))


def test_without_latex_the_error_has_the_line_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ToolMissingError, match="apt-get install texlive-latex-base"):
        formulas.check_latex(tmp_path)
