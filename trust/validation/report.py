"""docs/validation.md: a table a subject, made from the cases, and what they taught."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from . import elastica, limits
from .balance import asymmetry_with_couple
from .case import Case, HeldByTest

Cases = Sequence[Case | HeldByTest]

HEAD = """# Validation

Is the rod solved right? Every row below compares what the package computes with something it does
not know: a published figure, a closed form, a balance, a symmetry, an integrator of its own.
`tests/project/test_validation.py` holds each to its tolerance, which has its reason beside it.
Errors are the largest of all entries compared, in the unit of the tolerance, as one run found
them; their last digits differ from machine to machine.

This page and its figures are made by `python -m trust.validate` from the cases in
[trust/validation](../trust/validation); a test fails when cases and page differ. "Second writing"
is [trust/reference.py](../trust/reference.py), the paper's equations once more with rotation
matrices, adaptive quadrature and scipy's Runge-Kutta codes; it calls nothing of the package.
"""

LESSONS = """## What did not hold as expected

**The critical helix angle is two angles.** Section 4 of the paper has the effects on extension
and on both curvatures change sign above one angle for each muscle. Extension weighs fibers by R
and bending by R squared, so in a layer of any thickness the two part (degrees; both sides alike):

| muscle | extension | bending |
| --- | --- | --- |
{angles}

Between the two a contraction still shortens the trunk, but bends it the other way. All oblique
muscles have 30 degrees, far from either. With eq. (29) neither depends on Z, although section 4
writes them as functions of radii that do. Taper lowers them, thickness raises them: 54.7356
degrees, which the paper cuts to 54.73, is the limit without both, and for nu = 1/2 only.

**Eq. (A.4) is right, but in its limits it cannot be computed as printed.** Its delta_3 is a
difference of terms that grow as 1 / taper^2 and 1 / helix^2: at the elephant's taper it keeps 12
digits, at a hundred-thousandth of it four. The package integrates instead.

**A couple fixed in space has no potential.** Without the contact couple the compliance of the tip
is symmetric, as Maxwell and Betti ask, and the energy's slope is the displacement. With the couple
of these cases it is asymmetric by {asymmetry:.0f} %. The solver is right about that. Whether
such a shape is stable, no energy decides; `stability` judges the symmetric part of its tangent,
which excludes static buckling but not flutter.

**Which equilibrium.** A rod raised by 45 degrees with w L^3 / E I = 50 has several. Started from
the unloaded shape the solver finds one with its tip at ({x:.2f}, {up:.2f}) L, up and behind the
clamp; at 20 and at 60 it finds the drooping one. It is an equilibrium to all digits, and unstable:
its energy's second variation goes down to {lowest:.0f} E I / L^2 in the plane alone. `stability`
says so of any shape, and a plan with such a step is not called solved.

**The 45-degree bend.** Published tips scatter by 0.3 in. BeamDyn's converged one, (-13.72, 53.58,
-23.65) in as Kynema's documentation gives it, is 0.12 in from ours, while a rod that shears with
the stiffness stated there is 0.004 in from ours. GXBeam's test, 16 elements, is 0.03 in away.

**Known before:** eq. (30) lacks 1/L; eq. (40) divides the twist by the extension once too often
(both held by tests above); eq. (30) keeps the volume only where sections extend alike
(`trunk_ocp/scene/body.py`).
"""

COLUMNS = ("case", "source", "error", "tolerance, and why")

UNDER = {
    elastica.SUBJECT: """![Large deflections](figures/validation-beams.png)

*Lines: the package. Dots: printed figures (left), scalar equations (middle), quadrature (right).*
""",
    limits.SUBJECT: """![Limits](figures/validation-limits.png)

*Left: where the effect of a helical layer changes its sign; dots are the trunk's own oblique
muscles. Middle and right: eq. (A.4) as printed, evaluated in double precision, beside our
quadrature, which needs no special case; dashed, the elephant.*
""",
    "Convergence": """![Orders of convergence](figures/validation-convergence.png)

*A tapered rod whose one oblique muscle turns it by 13 radians, under a tip force.*
""",
}


def text(value: str) -> str:
    """Text that Markdown takes as it is, in a table."""
    for mark in "\\*_|<>":
        value = value.replace(mark, "\\" + mark)
    return value


def cells(case: Case | HeldByTest, error: str) -> tuple[str, ...]:
    """A row of the table."""
    if isinstance(case, HeldByTest):
        file, name = case.test.split("::")
        return text(case.name), text(case.source), "", f"held by `{file}`, `{name}`"
    unit = f"({case.unit})" if "," in case.unit else case.unit
    limit = f"{case.tolerance:.2g} {unit}".rstrip()
    return text(case.name), text(case.source), error, text(f"{limit}: {case.reason}")


def table(cases: Cases, errors: Mapping[str, float]) -> list[str]:
    """Lines of a table of some cases."""
    rows = [COLUMNS, ("---",) * len(COLUMNS)]
    rows += [
        cells(case, "" if isinstance(case, HeldByTest) else f"{errors[case.name]:.1e}")
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
    return "\n".join([*lines, lessons()])


def lessons() -> str:
    """What did not hold as expected, with its figures."""
    x, z, _ = elastica.other_branch()[0]
    return LESSONS.format(
        angles="\n".join(
            f"| {name} | {extension:.2f} | {bending:.2f} |"
            for name, extension, bending in limits.oblique_angles()
        ),
        asymmetry=100 * asymmetry_with_couple(),
        x=x,
        up=-z,
        lowest=elastica.second_variation(50.0, elastica.RAISED),
    )
