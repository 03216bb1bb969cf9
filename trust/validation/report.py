"""docs/validation.md: one table per subject, made from the cases, and surprises."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from . import elastica, limits
from .balance import asymmetry_with_couple
from .case import Case, CoveredByTest

Cases = Sequence[Case | CoveredByTest]

HEAD = """# Validation

Is the rod solved correctly? Each row compares a result of the package with an independent
reference: a published figure, a closed form, a balance, a symmetry or another integrator.
`tests/project/test_validation.py` checks every case against its tolerance, whose reason is stated.
Errors are the largest over all entries compared, in the unit of the tolerance, from one run;
their last digits vary between machines.

This page and its figures are made by `python -m trust.validate` from the cases in
[trust/validation](../trust/validation); a test fails if cases and page differ. "Implemented
independently" refers to [trust/reference.py](../trust/reference.py): the paper's equations with
rotation matrices, adaptive quadrature and scipy's Runge-Kutta codes. It does not call the package.
"""

SURPRISES = """## Surprises

**There are two critical helix angles.** According to section 4 of the paper, the effects on
extension and on both curvatures change sign at the same angle of each muscle. Extension weights
fibers by R and bending by R squared, so the two angles differ in any layer of finite thickness
(in degrees; the same on both sides):

| muscle | extension | bending |
| --- | --- | --- |
{angles}

Between the two, a contraction still shortens the trunk but bends it the other way. All oblique
muscles have 30 degrees, far from either. With eq. (29) neither angle depends on Z, although section
4 writes them as functions of radii that do. Taper lowers both and thickness raises them; 54.7356
degrees (54.73 in the paper) is the limit without either, and only for nu = 1/2.

**Eq. (A.4) is correct, but cannot be evaluated near its limits.** Its delta_3 is a difference of
terms that grow as 1 / taper^2 and 1 / helix^2: at the elephant's taper 12 digits remain, at a
hundred-thousandth of that taper only four. The package integrates numerically instead.

**A couple fixed in space has no potential.** Without the contact couple the compliance of the tip
is symmetric, as the Maxwell-Betti theorem requires, and the derivative of the energy is the
displacement. With the couple of these cases it is asymmetric by {asymmetry:.0f} %, which is
correct. No energy decides whether such a shape is stable; `stability` uses the symmetric part of
its tangent stiffness, which excludes static buckling but not flutter. `flutter` finds that.

**Several equilibria.** A rod raised by 45 degrees with w L^3 / E I = 50 has several. Starting from
the unloaded shape, the solver finds one with its tip at ({x:.2f}, {up:.2f}) L, above and behind
the clamp; at 20 and at 60 it finds the drooping one. The former is an equilibrium to all digits,
but unstable: the second variation of its energy is as low as {lowest:.0f} E I / L^2, even within
the plane. `stability` detects this for any shape, and a plan with such a step does not count as
solved.

**The 45-degree bend.** Published tips scatter by 0.3 in. The converged tip of BeamDyn, (-13.72,
53.58, -23.65) in according to Kynema's documentation, is 0.12 in from ours; a shear-deformable
rod with the stiffness stated there is 0.004 in from ours. GXBeam's test with 16 elements is 0.03 in
away.

**Known errors of the paper:** eq. (30) lacks 1/L; eq. (40) divides the twist by the extension once
too often (both covered by tests above); eq. (30) preserves volume only where sections extend
equally (`trunk_ocp/scene/body.py`).
"""

COLUMNS = ("case", "source", "error", "tolerance and reason")

UNDER = {
    elastica.SUBJECT: """![Large deflections](figures/validation-beams.png)

*Lines: the package. Dots: published figures (left), scalar equations (middle), quadrature
(right).*
""",
    limits.SUBJECT: """![Limits](figures/validation-limits.png)

*Left: helix angle at which the effect of a helical layer changes sign; dots are the trunk's
oblique muscles. Middle and right: error of eq. (A.4) in double precision relative to our
quadrature, which needs no special cases. Dashed: the elephant.*
""",
    "Convergence": """![Orders of convergence](figures/validation-convergence.png)

*A tapered rod under a tip force; its one oblique muscle turns it by 13 radians.*
""",
}


def text(value: str) -> str:
    """Text escaped for a Markdown table."""
    for mark in "\\*_|<>":
        value = value.replace(mark, "\\" + mark)
    return value


def cells(case: Case | CoveredByTest, error: str) -> tuple[str, ...]:
    """A row of the table."""
    if isinstance(case, CoveredByTest):
        file, name = case.test.split("::")
        return text(case.name), text(case.source), "", f"covered by `{file}`, `{name}`"
    unit = f"({case.unit})" if "," in case.unit else case.unit
    limit = f"{case.tolerance:.2g} {unit}".rstrip()
    return text(case.name), text(case.source), error, text(f"{limit}: {case.reason}")


def table(cases: Cases, errors: Mapping[str, float]) -> list[str]:
    """Lines of a table of cases."""
    rows = [COLUMNS, ("---",) * len(COLUMNS)]
    rows += [
        cells(case, "" if isinstance(case, CoveredByTest) else f"{errors[case.name]:.1e}")
        for case in cases
    ]
    return ["| " + " | ".join(row) + " |" for row in rows]


def page(cases: Cases, errors: Mapping[str, float]) -> str:
    """The whole page."""
    lines = [HEAD]
    for subject in dict.fromkeys(case.subject for case in cases):
        lines += [f"## {subject}", ""]
        lines += [*table([case for case in cases if case.subject == subject], errors), ""]
        if subject in UNDER:
            lines.append(UNDER[subject])
    return "\n".join([*lines, surprises()])


def surprises() -> str:
    """The section on surprises, with its figures."""
    x, z, _ = elastica.other_branch()[0]
    return SURPRISES.format(
        angles="\n".join(
            f"| {name} | {extension:.2f} | {bending:.2f} |"
            for name, extension, bending in limits.oblique_angles()
        ),
        asymmetry=100 * asymmetry_with_couple(),
        x=x,
        up=-z,
        lowest=elastica.second_variation(50.0, elastica.RAISED),
    )
