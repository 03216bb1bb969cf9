#include "trunk.h"

#include <math.h>

#if defined __FAST_MATH__ || __FINITE_MATH_ONLY__
#error "trunk.c has to know what is not a number: compile it without -ffast-math (-Ofast)"
#endif

#define NODES TRUNK_NODES

/* Numbers of this trunk. */

/* @tables@ */

#if TRUNK_CONTACT
#define element_density(e) couple_density[e]
#else
#define element_density(e) 0
#endif

/* Kernels: equations at one place and their derivatives, written by CasADi. */

static double square(double x) { return x * x; }

/* @kernels@ */
