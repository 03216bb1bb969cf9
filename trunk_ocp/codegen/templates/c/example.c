/*
 * Example: the shape at rest, one contraction, and the time of a call.
 *
 *     cc -std=c99 -O3 trunk.c example.c -o example -lm && ./example
 */
#include "trunk.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define CALLS 20000
#define BATCH 20 /* calls per time measurement */

static trunk_work work; /* too large for a small stack */
static double x[TRUNK_INPUTS], y[TRUNK_POINTS * TRUNK_OUTPUTS];
#if TRUNK_HAS_JACOBIAN
static double J[TRUNK_POINTS * TRUNK_OUTPUTS * TRUNK_INPUTS];
#endif

/* Exit with a message if a call failed. */
static void check(int status)
{
    if (status == TRUNK_OK) return;
    fprintf(stderr, "%s\n", trunk_message(status));
    exit(EXIT_FAILURE);
}

static void print_points(const char *what)
{
    printf("%s\n%8s %10s %10s %10s %10s\n", what, "Z in m", "X", "Y", "Z", "extension");
    for (int k = 0; k < TRUNK_POINTS; k++) {
        const double *at = y + k * TRUNK_OUTPUTS, *r = at + TRUNK_POSITION;
        printf("%8.4f %10.6f %10.6f %10.6f %10.6f\n", trunk_Z[k], r[0], r[1], r[2],
               at[TRUNK_STRAIN]);
    }
}

/* One call of a controller: the shape and, if it is exported, the whole Jacobian. */
static void call(void)
{
    check(trunk_loaded(x, &work, y));
#if TRUNK_HAS_JACOBIAN
    check(trunk_jacobian(&work, J));
#endif
}

/* Activations of a slow motion: each oscillates by at most 0.01 a step. */
static void move_to(int step)
{
    for (int m = 0; m < TRUNK_MUSCLES; m++)
        x[TRUNK_ACTIVATION + m] = -0.1 - 0.1 * sin(0.1 * step + m);
}

static double microseconds(int from, int to, int cold)
{
    const clock_t start = clock();
    for (int step = from; step < to; step++) {
        if (cold) trunk_reset(&work);
        move_to(step);
        call();
    }
    return 1e6 * (double)(clock() - start) / CLOCKS_PER_SEC / (to - from);
}

static int compare(const void *a, const void *b)
{
    const double left = *(const double *)a, right = *(const double *)b;
    return (left > right) - (left < right);
}

static void time_calls(const char *what, int cold)
{
    static double times[CALLS / BATCH];
    const int count = CALLS / BATCH / (cold ? 10 : 1);
    double mean = 0;
    for (int i = 0; i < count; i++) {
        times[i] = microseconds(BATCH * i, BATCH * (i + 1), cold);
        mean += times[i] / count;
    }
    qsort(times, (size_t)count, sizeof times[0], compare);
    printf("%s: median %.1f, mean %.1f microseconds per call (%d calls)\n", what, times[count / 2],
           mean, count * BATCH);
}

int main(void)
{
    trunk_reset(&work);
    memcpy(x, trunk_default_input, sizeof x);
    check(trunk_loaded(x, &work, y));
    print_points("passive");
#if TRUNK_MUSCLES > 0
    x[TRUNK_ACTIVATION] = -0.3;
    check(trunk_loaded(x, &work, y));
    printf("\n%s contracted: activation -0.3\n", trunk_input_names[TRUNK_ACTIVATION]);
    print_points("active");
#if TRUNK_HAS_JACOBIAN
    check(trunk_jacobian(&work, J));
    printf("\nlast point per unit of that activation: %10.6f %10.6f %10.6f m\n",
           J[((TRUNK_POINTS - 1) * TRUNK_OUTPUTS + 0) * TRUNK_INPUTS],
           J[((TRUNK_POINTS - 1) * TRUNK_OUTPUTS + 1) * TRUNK_INPUTS],
           J[((TRUNK_POINTS - 1) * TRUNK_OUTPUTS + 2) * TRUNK_INPUTS]);
#endif
#endif
    printf("\n%s\n", TRUNK_HAS_JACOBIAN ? "shape and Jacobian" : "shape");
    time_calls("along a motion", 0);
    time_calls("from scratch", 1);
    return 0;
}
