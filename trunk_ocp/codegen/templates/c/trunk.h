/* @title@ */
#ifndef TRUNK_H
#define TRUNK_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/*
 * How to call
 * -----------
 *     static trunk_work work;                          (one for each thread)
 *     double x[TRUNK_INPUTS], y[TRUNK_POINTS * TRUNK_OUTPUTS];
 *     trunk_reset(&work);                              (once, before the first call)
 *     memcpy(x, trunk_default_input, sizeof x);
 *     x[TRUNK_ACTIVATION + 3] = -0.2;                  (contract the fourth muscle)
 *     if (trunk_loaded(x, &work, y) == TRUNK_OK) ...   (the tip: y[TRUNK_POSITION + 0 .. 2])
 *
 * All memory is in trunk_work: nothing is allocated, there is no global state, and calls with
 * different trunk_work objects may run at the same time. sizeof(trunk_work) is about 11 kB for
 * each of the TRUNK_ELEMENTS elements, plus 80 TRUNK_PARAMETERS bytes each for the Jacobian, and
 * the same again for second derivatives.
 *
 * How to compile
 * --------------
 * trunk.c is C99, not C++; C++ programs include this header and link to it. Use -O3, which is much
 * faster than -O0. Do not use -ffast-math: it removes the tests for NaN, so trunk.c refuses to
 * compile with it. All exports use the same symbols: link only one trunk into a program or shared
 * library.
 *
 * Axes and units
 * --------------
 * Space axes X, Y, Z with +Z down. The trunk hangs from its base at Z = 0; a point on it is given
 * by its coordinate Z in m in the trunk at rest. SI units; angles in rad.
 *
 * Inputs x
 * --------
 *   TRUNK_ACTIVATION      activations of the muscles, negative in contraction; their names are in
 *                         trunk_input_names
 *   TRUNK_HEAD            psi_Z, psi_Y: head angles in rad
 *   TRUNK_GRAVITY         acceleration along +Z in m/s^2
 *   TRUNK_TIP_FORCE       force on the tip in N, in space axes
 *   TRUNK_CONTACT_FORCE   force in N, distributed evenly from TRUNK_CONTACT_FROM to the tip
 *   TRUNK_CONTACT_COUPLE  couple in N m, distributed in the same way
 * The last two exist only if TRUNK_CONTACT is 1. An unloaded shape depends only on the first
 * TRUNK_CONTROLS inputs, activations and head.
 *
 * Outputs y: TRUNK_OUTPUTS numbers for each point in trunk_Z
 * -----------------------------------------------------------
 *   TRUNK_POSITION    r in m, in space axes (3)
 *   TRUNK_DIRECTORS   d1, d2, d3 in space axes (9): a frame that rotates with the section, d3
 *                     along the trunk
 *   TRUNK_STRAIN      zeta (extension, 1 at rest), then u1, u2 (bending) and u3 (twist) in 1/m
 *   TRUNK_MOMENT      m in N m, components along d1, d2, d3 (3); loaded shapes only
 * Output i of point k is y[k * TRUNK_OUTPUTS + i]. Strains jump between segments: a point on the
 * boundary reports those of the segment that ends there.
 */

/* @sizes@ */

enum {
    TRUNK_POSITION = 0,
    TRUNK_DIRECTORS = 3,
    TRUNK_STRAIN = 12,
    TRUNK_MOMENT = 16,
    TRUNK_OUTPUTS = 19,
    TRUNK_UNLOADED_OUTPUTS = 16
};

enum {
    TRUNK_OK = 0,
    TRUNK_NOT_FOUND,  /* no equilibrium found, or no shape in the work yet */
    TRUNK_COLLAPSED,  /* the activations shorten a segment to zero length */
    TRUNK_NOT_FINITE, /* an input or a result is infinite or NaN */
    TRUNK_COARSE      /* the shape bends too sharply for this mesh and may be wrong */
};

typedef struct trunk_work trunk_work;

extern const double trunk_Z[TRUNK_POINTS];
extern const char *const trunk_input_names[TRUNK_INPUTS];
/* The trunk at rest under the loads it was exported with. */
extern const double trunk_default_input[TRUNK_INPUTS];

/* Message for a status. */
const char *trunk_message(int status);

/* sizeof(trunk_work), for programs that cannot see this header. */
size_t trunk_work_size(void);

/* Forget the last shape. Required before the first use of a trunk_work. Where a trunk has several
 * equilibria, it makes the next call start from the unloaded shape. */
void trunk_reset(trunk_work *work);

/*
 * Equilibrium shape y under the inputs x; returns a status.
 *
 * Newton's method starts from the last shape in the work, if there is one, then from the unloaded
 * shape; if neither converges, the loads are raised in steps. Unless the status is TRUNK_OK, y is
 * unchanged and the work is as after trunk_reset.
 *
 * A shape that bends too sharply for the elements is not returned; the status is TRUNK_COARSE.
 * Reduce the load or the activation, or export with a finer mesh.
 *
 * An ordinary call takes at most 10 Newton steps, a call that raises the loads 30 to 250. The limit
 * is TRUNK_MAX_STEPS, after which the status is TRUNK_NOT_FOUND.
 */
#define TRUNK_MAX_STEPS 400
int trunk_loaded(const double x[TRUNK_INPUTS], trunk_work *work,
                 double y[TRUNK_POINTS * TRUNK_OUTPUTS]);

#if TRUNK_HAS_JACOBIAN
/*
 * Derivative of the last shape in the work with respect to its inputs: d y[i] / d x[j] is
 * J[i * TRUNK_INPUTS + j]. Exact, by the implicit function theorem. TRUNK_NOT_FOUND if the work
 * has no shape. The next trunk_loaded is faster after it.
 */
int trunk_jacobian(trunk_work *work, double J[TRUNK_POINTS * TRUNK_OUTPUTS * TRUNK_INPUTS]);
#endif

#if TRUNK_HAS_SECOND
/* Derivative of that Jacobian along v: d J(x + e v) / d e at e = 0. */
int trunk_second(trunk_work *work, const double v[TRUNK_INPUTS],
                 double dJ[TRUNK_POINTS * TRUNK_OUTPUTS * TRUNK_INPUTS]);
#endif

/*
 * Shape without loads, in closed form; returns a status. Each point has TRUNK_UNLOADED_OUTPUTS
 * numbers, in the order above. J is the derivative with respect to the controls, d y[i] /
 * d controls[j] at J[i * TRUNK_CONTROLS + j]; pass NULL if you do not need it. Unless the status is
 * TRUNK_OK, y is unchanged and J is undefined.
 */
int trunk_unloaded(const double controls[TRUNK_CONTROLS],
                   double y[TRUNK_POINTS * TRUNK_UNLOADED_OUTPUTS], double *J);

/*
 * The rest is private; it is here only so that a trunk_work can be declared.
 */

#define TRUNK_Q (4 * TRUNK_NODES) /* unknowns of an element: q at its Gauss points */
#define TRUNK_ENDS 10             /* state at an element's end: q (4), M (3), r (3) */
/* Parameters of an element: zeta, c (3) of its segment, mean extension, loads. */
#define TRUNK_OWN (5 + TRUNK_LOADS)
/* Parameters of a trunk: head (2), mean extension, loads, and four strains of each segment. */
#define TRUNK_PARAMETERS (3 + TRUNK_LOADS + 4 * TRUNK_SEGMENTS)

typedef struct {
    double q[TRUNK_ELEMENTS][TRUNK_Q];     /* orientation at Gauss points, component by component */
    double edge[TRUNK_ELEMENTS + 1][4];    /* orientation at element edges */
    double moment[TRUNK_ELEMENTS + 1][3];  /* M at element edges in N m, in space axes */
} trunk_shape;

typedef struct {
    double lu[TRUNK_Q][TRUNK_Q + TRUNK_ENDS]; /* factors, and weights of the ends on q' */
    double pivot[TRUNK_Q];                    /* one over the diagonal */
    int order[TRUNK_Q];
    double on_moment[3 * TRUNK_NODES][TRUNK_ENDS]; /* weights of the ends on M' */
    double by_moment[12 * TRUNK_NODES];            /* dq'/dM */
    double map[7 + TRUNK_OWN][TRUNK_ENDS]; /* ends by q, M at the start and parameters */
} trunk_element;

struct trunk_work {
    int found;      /* whether shape is an equilibrium */
    int linear;     /* whether the elements hold a linearization, perhaps at an older shape */
    int responded;  /* whether response is that of shape */
    int steps_left; /* Newton steps left in this call */
    double strain[TRUNK_SEGMENTS][4];
    double mean;
    double load[TRUNK_LOADS];
    double head[2];
    double force[TRUNK_ELEMENTS][3 * TRUNK_NODES]; /* N at Gauss points */
    double couple[TRUNK_ELEMENTS][3];              /* l of each element */
    trunk_shape shape;
    trunk_element element[TRUNK_ELEMENTS];
    double by_start[TRUNK_ELEMENTS + 1][3][TRUNK_ENDS]; /* edges by M(0) */
    double closing[3][3];                               /* M(0) by M(L) */
#if TRUNK_HAS_JACOBIAN
    double response[TRUNK_ELEMENTS + 1][TRUNK_PARAMETERS][TRUNK_ENDS]; /* edges by parameters */
#endif
#if TRUNK_HAS_SECOND
    double second[TRUNK_ELEMENTS + 1][TRUNK_PARAMETERS][TRUNK_ENDS]; /* its change along v */
#endif
};

#ifdef __cplusplus
}
#endif

#endif
