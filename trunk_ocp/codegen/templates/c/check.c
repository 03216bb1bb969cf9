/*
 * Self-check: compares this build of trunk.c with the check files.
 *
 *     cc -std=c99 -O2 trunk.c check.c -o check -lm && ./check [folder of the check files]
 *
 * Prints the largest error of each part of the outputs, relative to the part's largest value;
 * exits with 0 if all are below 1e-10. Loaded shapes are solved twice: from scratch, and "warm",
 * starting from the case before (the first case from the last one). The files have one case per
 * row:
 *     check.csv            x, y, then J, v, dJ if trunk.c has them
 *     check_unloaded.csv   controls, y, then J if trunk.c has derivatives
 */
#include "trunk.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#define LIMIT 1e-10
#define ROUND_OFF 1e-9 /* a part that is zero up to round-off is compared by absolute error */
#define LOADED (TRUNK_POINTS * TRUNK_OUTPUTS)
#define UNLOADED (TRUNK_POINTS * TRUNK_UNLOADED_OUTPUTS)

static trunk_work work;
static double expected[LOADED * TRUNK_INPUTS], found[LOADED * TRUNK_INPUTS];

/* A kind of output, with the largest error and value of each part. */
typedef struct {
    const char *name;
    int outputs, width; /* outputs of a point, and numbers of each output */
    double error[4], size[4];
} block;

static const char *const part_names[4] = {"position", "directors", "strain", "moment"};
static const int part_ends[4] = {TRUNK_DIRECTORS, TRUNK_STRAIN, TRUNK_MOMENT, TRUNK_OUTPUTS};

static void stop(const char *what, const char *why)
{
    fprintf(stderr, "%s: %s\n", what, why);
    exit(2);
}

/* Read numbers of a row; returns 0 at the end of the file. */
static int read_numbers(FILE *file, double *to, int count)
{
    for (int i = 0; i < count; i++) {
        if (fscanf(file, "%lf", &to[i]) != 1) {
            if (i == 0 && feof(file)) return 0;
            stop("check file", "expected another number");
        }
        (void)!fscanf(file, ","); /* no comma at the end of a row */
    }
    return 1;
}

/* Read the expected numbers and compare the computed ones. */
static void compare(FILE *file, block *to)
{
    const int count = TRUNK_POINTS * to->outputs * to->width;
    if (!read_numbers(file, expected, count)) stop(to->name, "the check file ends within a case");
    for (int i = 0; i < count; i++) {
        const int output = i / to->width % to->outputs;
        const double error = fabs(found[i] - expected[i]), size = fabs(expected[i]);
        int part = 0;
        while (output >= part_ends[part]) part++;
        if (!(error <= to->error[part])) to->error[part] = isnan(error) ? HUGE_VAL : error;
        if (size > to->size[part]) to->size[part] = size;
    }
}

/* Print a block's errors; returns how many are too large. */
static int report(const block *of)
{
    int bad = 0;
    for (int part = 0; part == 0 || (part < 4 && part_ends[part - 1] < of->outputs); part++) {
        const double error = of->error[part] / (of->size[part] > ROUND_OFF ? of->size[part] : 1);
        printf("%s %s %.1e\n", of->name, part_names[part], error);
        bad += !(error <= LIMIT);
    }
    return bad;
}

static FILE *open_file(const char *folder, const char *name)
{
    char path[4096];
    FILE *file;
    if (snprintf(path, sizeof path, "%s/%s", folder, name) >= (int)sizeof path)
        stop(folder, "the path is too long");
    file = fopen(path, "r");
    if (!file) stop(path, "cannot be read");
    return file;
}

static void expect_success(int status)
{
    if (status != TRUNK_OK) stop("case", trunk_message(status));
}

/* All loaded cases; warm: each starts from the shape in the work. */
static int check_loaded(const char *folder, int warm)
{
    block y = {warm ? "warm" : "loaded", TRUNK_OUTPUTS, 1, {0}, {0}};
#if TRUNK_HAS_JACOBIAN
    block J = {warm ? "warm jacobian" : "jacobian", TRUNK_OUTPUTS, TRUNK_INPUTS, {0}, {0}};
#endif
#if TRUNK_HAS_SECOND
    block dJ = {warm ? "warm second" : "second", TRUNK_OUTPUTS, TRUNK_INPUTS, {0}, {0}};
    double v[TRUNK_INPUTS];
#endif
    double x[TRUNK_INPUTS];
    FILE *file = open_file(folder, "check.csv");
    int cases = 0, bad;
    while (read_numbers(file, x, TRUNK_INPUTS)) {
        if (!warm) trunk_reset(&work);
        expect_success(trunk_loaded(x, &work, found));
        compare(file, &y);
#if TRUNK_HAS_JACOBIAN
        expect_success(trunk_jacobian(&work, found));
        compare(file, &J);
#endif
#if TRUNK_HAS_SECOND
        if (!read_numbers(file, v, TRUNK_INPUTS))
            stop("second", "the check file ends within a case");
        expect_success(trunk_second(&work, v, found));
        compare(file, &dJ);
#endif
        cases++;
    }
    fclose(file);
    if (!cases) stop("check.csv", "there are no cases");
    bad = report(&y);
#if TRUNK_HAS_JACOBIAN
    bad += report(&J);
#endif
#if TRUNK_HAS_SECOND
    bad += report(&dJ);
#endif
    return bad;
}

static int check_unloaded(const char *folder)
{
    static double slopes[UNLOADED * TRUNK_CONTROLS];
    block y = {"unloaded", TRUNK_UNLOADED_OUTPUTS, 1, {0}, {0}};
    block J = {"unloaded_jacobian", TRUNK_UNLOADED_OUTPUTS, TRUNK_CONTROLS, {0}, {0}};
    double controls[TRUNK_CONTROLS];
    FILE *file = open_file(folder, "check_unloaded.csv");
    int cases = 0;
    while (read_numbers(file, controls, TRUNK_CONTROLS)) {
        expect_success(trunk_unloaded(controls, found, TRUNK_HAS_JACOBIAN ? slopes : NULL));
        compare(file, &y);
        if (TRUNK_HAS_JACOBIAN) {
            for (int i = 0; i < UNLOADED * TRUNK_CONTROLS; i++) found[i] = slopes[i];
            compare(file, &J);
        }
        cases++;
    }
    fclose(file);
    if (!cases) stop("check_unloaded.csv", "there are no cases");
    return report(&y) + (TRUNK_HAS_JACOBIAN ? report(&J) : 0);
}

int main(int count, char **arguments)
{
    const char *folder = count > 1 ? arguments[1] : ".";
    int bad = check_loaded(folder, 0);
    bad += check_loaded(folder, 1);
    bad += check_unloaded(folder);
    printf(bad ? "some DISAGREE\n" : "all agree\n");
    return bad ? 1 : 0;
}
