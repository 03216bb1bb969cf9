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
 *     static trunk_work work;                          (one for each thread or each trunk)
 *     double x[TRUNK_INPUTS], y[TRUNK_POINTS * TRUNK_OUTPUTS];
 *     trunk_reset(&work);                              (once, before the first call)
 *     memcpy(x, trunk_default_input, sizeof x);
 *     x[TRUNK_ACTIVATION + 3] = -0.2;                  (contract the fourth muscle)
 *     if (trunk_loaded(x, &work, y) == TRUNK_OK) ...   (the tip: y[TRUNK_POSITION + 0 .. 2])
 *
 * All memory is in trunk_work: nothing is allocated, no function keeps a state of its own, and
 * calls with different works may run at the same time. sizeof(trunk_work) is about 11 kB for each
 * of the TRUNK_ELEMENTS elements, and for each 80 TRUNK_PARAMETERS bytes more for the Jacobian and
 * as much again for second derivatives.
 *
 * How to compile
 * --------------
 * trunk.c is C99, not C++; C++ programs link to it by this header. Use -O3: it is much faster than
 * -O0. Not -ffast-math: then a compiler takes the tests for what is not a number away, so that
 * trunk.c refuses it. The symbols are the same in every export: one trunk to a program or shared
 * library.
 *
 * Axes and units
 * --------------
 * Space axes X, Y, Z with +Z down; the trunk hangs from its base at Z = 0, and a place on it is
 * named by Z in m of the trunk at rest. SI units; angles in rad.
 *
 * Inputs x
 * --------
 *   TRUNK_ACTIVATION      activations of the muscles, negative where they contract; the names are
 *                         in trunk_input_names
 *   TRUNK_HEAD            psi_Z, psi_Y: the head's angles in rad
 *   TRUNK_GRAVITY         acceleration along +Z in m/s^2
 *   TRUNK_TIP_FORCE       force on the tip in N, in space axes
 *   TRUNK_CONTACT_FORCE   force in N, spread evenly from TRUNK_CONTACT_FROM to the tip
 *   TRUNK_CONTACT_COUPLE  couple in N m, spread likewise
 * The last two exist only if TRUNK_CONTACT is 1. The first TRUNK_CONTROLS inputs, activations and
 * head, are all that an unloaded shape depends on.
 *
 * Outputs y, for the points trunk_Z in turn, TRUNK_OUTPUTS numbers each
 * ----------------------------------------------------------------------
 *   TRUNK_POSITION    r in m, in space axes (3)
 *   TRUNK_DIRECTORS   d1, d2, d3 (9): a frame that turns with the section, d3 along the trunk;
 *                     three numbers in space axes each
 *   TRUNK_STRAIN      zeta (extension, 1 at rest), then u1, u2 (bending) and u3 (twist) in 1/m
 *   TRUNK_MOMENT      m in N m, its components along d1, d2, d3 (3); not of an unloaded shape
 * The number i of point k is y[k * TRUNK_OUTPUTS + i]. Strains jump from one segment to the next:
 * a point between two reports those of the segment that ends there.
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
    TRUNK_COLLAPSED,  /* the activations shorten a segment to nothing */
    TRUNK_NOT_FINITE, /* an input, or what follows from it, is infinite or not a number */
    TRUNK_COARSE      /* the shape bends too sharply for this mesh, and may be wrong */
};

typedef struct trunk_work trunk_work;

extern const double trunk_Z[TRUNK_POINTS];
extern const char *const trunk_input_names[TRUNK_INPUTS];
/* The trunk at rest under the loads it was exported with. */
extern const double trunk_default_input[TRUNK_INPUTS];

/* What a status means, as a sentence. */
const char *trunk_message(int status);

/* sizeof(trunk_work), for programs that cannot see this header. */
size_t trunk_work_size(void);

/* Forget the last shape. Needed before the first use of a work; also starts anew from the
 * unloaded shape where a trunk has several equilibria. */
void trunk_reset(trunk_work *work);

/*
 * The shape y in equilibrium under the inputs x; returns a status.
 *
 * Starts from the last shape in the work, if there is one, and then from the unloaded shape; where
 * that does not lead to an equilibrium, the loads are raised in steps. Unless the status is
 * TRUNK_OK, y is left as it was and the work is as after trunk_reset.
 *
 * A shape that bends too sharply for the elements is not reported but TRUNK_COARSE: reduce the load
 * or the activation, or export with a finer mesh.
 *
 * Time is spent in steps of Newton's method: 10 at most in an ordinary call, 30 to 250 where the
 * loads are raised, and never more than TRUNK_MOST_STEPS; a call that runs out of them is
 * TRUNK_NOT_FOUND.
 */
#define TRUNK_MOST_STEPS 400
int trunk_loaded(const double x[TRUNK_INPUTS], trunk_work *work,
                 double y[TRUNK_POINTS * TRUNK_OUTPUTS]);

#if TRUNK_HAS_JACOBIAN
/*
 * Derivative of the last shape in the work by its inputs: d y[i] / d x[j] is
 * J[i * TRUNK_INPUTS + j]. Exact, by the implicit function theorem. TRUNK_NOT_FOUND if there is
 * no last shape. A later trunk_loaded is faster for it.
 */
int trunk_jacobian(trunk_work *work, double J[TRUNK_POINTS * TRUNK_OUTPUTS * TRUNK_INPUTS]);
#endif

#if TRUNK_HAS_SECOND
/* Rate of change of that Jacobian as the inputs move along v: d J(x + e v) / d e at e = 0. */
int trunk_second(trunk_work *work, const double v[TRUNK_INPUTS],
                 double dJ[TRUNK_POINTS * TRUNK_OUTPUTS * TRUNK_INPUTS]);
#endif

/*
 * The shape without loads, in closed form; returns a status. Each point has
 * TRUNK_UNLOADED_OUTPUTS numbers, in the order above. J is its derivative by the controls,
 * d y[i] / d controls[j] at J[i * TRUNK_CONTROLS + j], or NULL where it is not wanted. Unless the
 * status is TRUNK_OK, y is left as it was, and J is not to be used.
 */
int trunk_unloaded(const double controls[TRUNK_CONTROLS],
                   double y[TRUNK_POINTS * TRUNK_UNLOADED_OUTPUTS], double *J);

/*
 * What follows is private: it stands here only so that a work can be declared.
 */

#define TRUNK_Q (4 * TRUNK_NODES) /* unknowns of an element: q at its Gauss points */
#define TRUNK_ENDS 10             /* what an element hands on: q (4), M (3), r (3) */
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
    int steps_left; /* of Newton's method, in this call */
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
