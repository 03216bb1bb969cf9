/*
 * MEX gateway to trunk.c for MATLAB and Octave; trunk_shape.m documents its calls. To build, in
 * MATLAB, or in a shell for Octave:
 *
 *     mex trunk_shape.c trunk.c
 *     mkoctfile --mex trunk_shape.c trunk.c
 */
#include "trunk.h"

#include <math.h>
#include <string.h>

#include "mex.h"

#define LARGEST (TRUNK_POINTS * TRUNK_OUTPUTS * TRUNK_INPUTS)

static trunk_work work; /* keeps the last shape: the next call starts from it */
static int started;
static double derivative[LARGEST];

static const char *const part_names[] = {"position", "directors", "strain", "moment"};
static const int part_starts[] = {TRUNK_POSITION, TRUNK_DIRECTORS, TRUNK_STRAIN, TRUNK_MOMENT,
                                  TRUNK_OUTPUTS};

/* --- inputs --- */

typedef struct {
    const char *name;
    int start, count;
} load;

static const load loads[] = {
    {"gravity", TRUNK_GRAVITY, 1},
    {"tip_force", TRUNK_TIP_FORCE, 3},
#if TRUNK_CONTACT
    {"contact_force", TRUNK_CONTACT_FORCE, 3},
    {"contact_couple", TRUNK_CONTACT_COUPLE, 3},
#endif
};
static const int load_count = (int)(sizeof loads / sizeof *loads);

static void read_numbers(const char *name, const mxArray *given, double *to, int count)
{
    const int there = (int)mxGetNumberOfElements(given);
    const double *from;
    if (!mxIsDouble(given) || mxIsComplex(given) || mxIsSparse(given))
        mexErrMsgIdAndTxt("trunk:input", "%s: expected a full array of real doubles.", name);
    if (there != count)
        mexErrMsgIdAndTxt("trunk:input", "%s: has %d values; expected %d.", name, there, count);
    from = mxGetPr(given);
    for (int i = 0; i < count; i++) {
        if (!isfinite(from[i]))
            mexErrMsgIdAndTxt("trunk:input", "%s: value %d is not finite.", name, i + 1);
        to[i] = from[i];
    }
}

static void read_loads(const mxArray *given, double *x)
{
    if (!mxIsStruct(given) || mxGetNumberOfElements(given) != 1)
        mexErrMsgIdAndTxt("trunk:input", "loads: expected a struct, such as "
                                         "struct('gravity', 9.8, 'tip_force', [0 0 10]).");
    for (int field = 0; field < mxGetNumberOfFields(given); field++) {
        const char *name = mxGetFieldNameByNumber(given, field);
        int i = 0;
        while (i < load_count && strcmp(name, loads[i].name)) i++;
        if (i == load_count)
            mexErrMsgIdAndTxt("trunk:input",
                              "loads.%s: no such load; expected gravity, tip_force%s.", name,
                              TRUNK_CONTACT ? ", contact_force, contact_couple"
                                            : " (this trunk was exported without contact)");
        read_numbers(name, mxGetFieldByNumber(given, 0, field), x + loads[i].start,
                     loads[i].count);
    }
}

/* x from (activation, head, loads), of which the last two may be missing or []. */
static void read_inputs(int count, const mxArray *given[], double *x)
{
    memcpy(x, trunk_default_input, TRUNK_INPUTS * sizeof *x);
    if (count < 1)
        mexErrMsgIdAndTxt("trunk:usage", "expected activations; see: help trunk_shape");
    read_numbers("activation", given[0], x + TRUNK_ACTIVATION, TRUNK_MUSCLES);
    if (count > 1 && !mxIsEmpty(given[1])) read_numbers("head", given[1], x + TRUNK_HEAD, 2);
    if (count > 2 && !mxIsEmpty(given[2])) read_loads(given[2], x);
}

/* --- outputs --- */

/*
 * A struct of the parts of y, each with its components first, then the points, then `width`
 * inputs that it is differentiated by (0: none). Each point has `outputs` numbers.
 */
static mxArray *parts(const double *y, int outputs, int width)
{
    const int columns = width ? width : 1, part_count = outputs > TRUNK_MOMENT ? 4 : 3;
    mxArray *made = mxCreateStructMatrix(1, 1, part_count, (const char **)part_names);
    for (int part = 0; part < part_count; part++) {
        const int start = part_starts[part], size = part_starts[part + 1] - start;
        mwSize dimensions[4] = {(mwSize)size, TRUNK_POINTS, (mwSize)columns, 1};
        mwSize framed[4] = {3, 3, TRUNK_POINTS, (mwSize)columns};
        const int frames = part == 1;
        mxArray *array = mxCreateNumericArray(frames ? 4 : 3, frames ? framed : dimensions,
                                              mxDOUBLE_CLASS, mxREAL);
        double *to = mxGetPr(array);
        for (int column = 0; column < columns; column++)
            for (int point = 0; point < TRUNK_POINTS; point++)
                for (int i = 0; i < size; i++) {
                    /* MATLAB arrays are column-major, and row i of the frame is d_i. */
                    const int row = frames ? 3 * (i % 3) + i / 3 : i;
                    *to++ = y[(point * outputs + start + row) * columns + column];
                }
        mxSetField(made, 0, part_names[part], array);
    }
    return made;
}

static mxArray *shape(const double *y, int outputs)
{
    mxArray *made = parts(y, outputs, 0), *Z = mxCreateDoubleMatrix(1, TRUNK_POINTS, mxREAL);
    memcpy(mxGetPr(Z), trunk_Z, sizeof trunk_Z);
    mxSetFieldByNumber(made, 0, mxAddField(made, "Z"), Z);
    return made;
}

static void expect_success(int status)
{
    if (status != TRUNK_OK) mexErrMsgIdAndTxt("trunk:shape", "%s", trunk_message(status));
}

static void expect_at_most(int there, int most, const char *what, const char *otherwise)
{
    if (there > most)
        mexErrMsgIdAndTxt("trunk:usage", "at most %d %s%s; see: help trunk_shape", most, what,
                          otherwise);
}

/* --- calls --- */

static void reset(void)
{
    trunk_reset(&work);
    started = 1;
}

static void loaded(int nlhs, mxArray *plhs[], int nrhs, const mxArray *prhs[])
{
    double x[TRUNK_INPUTS], y[TRUNK_POINTS * TRUNK_OUTPUTS];
#if TRUNK_HAS_SECOND
    double along[TRUNK_INPUTS];
    expect_at_most(nlhs, nrhs > 3 ? 3 : 2, "outputs", nrhs > 3 ? "" : " without a direction");
    expect_at_most(nrhs, 4, "inputs", "");
    if (nrhs > 3) read_numbers("direction", prhs[3], along, TRUNK_INPUTS);
#else
    expect_at_most(nlhs, TRUNK_HAS_JACOBIAN ? 2 : 1, "output(s)",
                   TRUNK_HAS_JACOBIAN ? ": exported without --second"
                                      : ": exported without --what jacobian");
    expect_at_most(nrhs, 3, "inputs", "");
#endif
    read_inputs(nrhs, prhs, x);
    if (!started) reset();
    expect_success(trunk_loaded(x, &work, y));
    plhs[0] = shape(y, TRUNK_OUTPUTS);
#if TRUNK_HAS_JACOBIAN
    if (nlhs > 1) {
        expect_success(trunk_jacobian(&work, derivative));
        plhs[1] = parts(derivative, TRUNK_OUTPUTS, TRUNK_INPUTS);
    }
#endif
#if TRUNK_HAS_SECOND
    if (nlhs > 2) {
        expect_success(trunk_second(&work, along, derivative));
        plhs[2] = parts(derivative, TRUNK_OUTPUTS, TRUNK_INPUTS);
    }
#endif
}

static void unloaded(int nlhs, mxArray *plhs[], int nrhs, const mxArray *prhs[])
{
    double x[TRUNK_INPUTS], y[TRUNK_POINTS * TRUNK_UNLOADED_OUTPUTS];
    expect_at_most(nrhs, 2, "inputs after 'unloaded'", "");
    expect_at_most(nlhs, TRUNK_HAS_JACOBIAN ? 2 : 1, "output(s)",
                   TRUNK_HAS_JACOBIAN ? "" : ": exported without --what jacobian");
    read_inputs(nrhs, prhs, x);
    expect_success(trunk_unloaded(x, y, nlhs > 1 ? derivative : NULL));
    plhs[0] = shape(y, TRUNK_UNLOADED_OUTPUTS);
    if (nlhs > 1) plhs[1] = parts(derivative, TRUNK_UNLOADED_OUTPUTS, TRUNK_CONTROLS);
}

static mxArray *input_names(void)
{
    mxArray *made = mxCreateCellMatrix(1, TRUNK_INPUTS);
    for (int i = 0; i < TRUNK_INPUTS; i++)
        mxSetCell(made, (mwIndex)i, mxCreateString(trunk_input_names[i]));
    return made;
}

void mexFunction(int nlhs, mxArray *plhs[], int nrhs, const mxArray *prhs[])
{
    char mode[16];
    if (nrhs < 1 || !mxIsChar(prhs[0])) {
        loaded(nlhs, plhs, nrhs, prhs);
        return;
    }
    if (mxGetString(prhs[0], mode, sizeof mode)) mode[0] = 0;
    if (!strcmp(mode, "unloaded"))
        unloaded(nlhs, plhs, nrhs - 1, prhs + 1);
    else if (!strcmp(mode, "inputs") && nrhs == 1)
        plhs[0] = input_names();
    else if (!strcmp(mode, "reset") && nrhs == 1)
        reset();
    else
        mexErrMsgIdAndTxt("trunk:usage", "expected activations, or 'unloaded' before them, or "
                                         "'inputs' or 'reset' alone; see: help trunk_shape");
}
