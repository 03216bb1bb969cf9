/* MEX gateway to the NLP of the motion @NAME@, exported by trunk_ocp @VERSION@.
 * nlp.m documents its calls. To build, in MATLAB, or in a shell for Octave:
 *
 *     mex -output nlp nlp_mex.c nlp.c nlp_data.c
 *     mkoctfile --mex -o nlp.mex nlp_mex.c nlp.c nlp_data.c
 */
#include <string.h>

#include "mex.h"
#include "nlp.h"

typedef struct {
  const char *name;
  int (*evaluate)(const double **, double **, casadi_int *, double *, int);
  casadi_int (*n_in)(void);
  casadi_int (*n_out)(void);
  const char *(*name_in)(casadi_int);
  const casadi_int *(*sparsity_in)(casadi_int);
  const casadi_int *(*sparsity_out)(casadi_int);
  int (*work)(casadi_int *, casadi_int *, casadi_int *, casadi_int *);
} function;

#define FUNCTION(name)                                                                     \
  {#name, name, name##_n_in, name##_n_out, name##_name_in, name##_sparsity_in,             \
   name##_sparsity_out, name##_work}

static const function functions[] = {FUNCTION(nlp),        FUNCTION(nlp_f),
                                     FUNCTION(nlp_g),      FUNCTION(nlp_grad_f),
                                     FUNCTION(nlp_jac_g),  FUNCTION(nlp_hess_l)};

typedef struct {
  const char *name;
  const double *values;
  int count;
} table;

static const table tables[] = {{"lower", nlp_lower, NLP_UNKNOWNS},
                               {"upper", nlp_upper, NLP_UNKNOWNS},
                               {"start", nlp_start, NLP_UNKNOWNS},
                               {"row_lower", nlp_row_lower, NLP_ROWS},
                               {"row_upper", nlp_row_upper, NLP_ROWS}};

/* The numbers of an input, or NULL (zeros) for []. */
static const double *numbers(const function *f, int i, const mxArray *given) {
  int expected = (int)f->sparsity_in(i)[0];
  int count = (int)mxGetNumberOfElements(given);
  if (mxIsEmpty(given) && i > 0) return NULL;
  if (!mxIsDouble(given) || mxIsComplex(given) || mxIsSparse(given) || count != expected) {
    mexErrMsgIdAndTxt("trunk:input", "%s: expected %s as %d full real doubles, got %d values.",
                      f->name, f->name_in(i), expected, count);
  }
  return mxGetPr(given);
}

/* A new array for an output: full, or sparse with CasADi's pattern. */
static mxArray *output(const casadi_int *sparsity, double **values) {
  casadi_int rows = sparsity[0], columns = sparsity[1], i;
  casadi_int count = sparsity[2 + columns];
  const casadi_int *start = sparsity + 2, *row = sparsity + 3 + columns;
  mxArray *made;
  if (count == rows * columns) {
    made = mxCreateDoubleMatrix((mwSize)rows, (mwSize)columns, mxREAL);
  } else {
    made = mxCreateSparse((mwSize)rows, (mwSize)columns, (mwSize)count, mxREAL);
    for (i = 0; i <= columns; i++) mxGetJc(made)[i] = (mwIndex)start[i];
    for (i = 0; i < count; i++) mxGetIr(made)[i] = (mwIndex)row[i];
  }
  *values = mxGetPr(made);
  return made;
}

static void evaluate(const function *f, int nlhs, mxArray *plhs[], int nrhs,
                     const mxArray *prhs[]) {
  casadi_int sizes[4];
  const double **arg;
  double **res, *w;
  casadi_int *iw;
  int i;
  if (nrhs < 1 || nrhs > f->n_in() || nlhs > f->n_out()) {
    mexErrMsgIdAndTxt("trunk:usage", "%s: expected 1 to %d inputs and at most %d outputs.",
                      f->name, (int)f->n_in(), (int)f->n_out());
  }
  f->work(&sizes[0], &sizes[1], &sizes[2], &sizes[3]);
  arg = mxCalloc((size_t)sizes[0], sizeof *arg);
  res = mxCalloc((size_t)sizes[1], sizeof *res);
  iw = mxCalloc((size_t)sizes[2] + 1, sizeof *iw);
  w = mxCalloc((size_t)sizes[3] + 1, sizeof *w);
  for (i = 0; i < nrhs; i++) arg[i] = numbers(f, i, prhs[i]);
  for (i = 0; i < (nlhs ? nlhs : 1); i++) plhs[i] = output(f->sparsity_out(i), &res[i]);
  if (f->evaluate(arg, res, iw, w, 0)) {
    mexErrMsgIdAndTxt("trunk:failed", "%s: the evaluation failed.", f->name);
  }
  mxFree((void *)arg);
  mxFree(res);
  mxFree(iw);
  mxFree(w);
}

/* Rows and columns, from 1, of the nonzeros of a function's matrix. */
static void pattern(const function *f, int nlhs, mxArray *plhs[]) {
  const casadi_int *sparsity = f->sparsity_out(f->n_out() - 1), *start = sparsity + 2;
  casadi_int columns = sparsity[1], count = start[columns], column, i;
  const casadi_int *row = start + columns + 1;
  plhs[0] = mxCreateDoubleMatrix((mwSize)count, 1, mxREAL);
  for (i = 0; i < count; i++) mxGetPr(plhs[0])[i] = (double)(row[i] + 1);
  if (nlhs < 2) return;
  plhs[1] = mxCreateDoubleMatrix((mwSize)count, 1, mxREAL);
  for (column = 0; column < columns; column++) {
    for (i = start[column]; i < start[column + 1]; i++) {
      mxGetPr(plhs[1])[i] = (double)(column + 1);
    }
  }
}

void mexFunction(int nlhs, mxArray *plhs[], int nrhs, const mxArray *prhs[]) {
  char name[32], of[32];
  size_t i;
  if (nrhs < 1 || mxGetString(prhs[0], name, sizeof name)) {
    mexErrMsgIdAndTxt("trunk:usage", "expected a name first; see: help nlp");
  }
  for (i = 0; i < sizeof tables / sizeof *tables; i++) {
    if (strcmp(name, tables[i].name)) continue;
    plhs[0] = mxCreateDoubleMatrix((mwSize)tables[i].count, 1, mxREAL);
    memcpy(mxGetPr(plhs[0]), tables[i].values, (size_t)tables[i].count * sizeof(double));
    return;
  }
  if (!strcmp(name, "pattern") && (nrhs != 2 || mxGetString(prhs[1], of, sizeof of))) {
    mexErrMsgIdAndTxt("trunk:usage", "expected nlp('pattern', 'nlp_jac_g' or 'nlp_hess_l')");
  }
  for (i = 0; i < sizeof functions / sizeof *functions; i++) {
    if (!strcmp(name, functions[i].name)) {
      evaluate(&functions[i], nlhs, plhs, nrhs - 1, prhs + 1);
      return;
    }
    if (!strcmp(name, "pattern") && i >= 4 && !strcmp(of, functions[i].name)) {
      pattern(&functions[i], nlhs, plhs);
      return;
    }
  }
  mexErrMsgIdAndTxt("trunk:usage", "'%s': no such function; see: help nlp", name);
}
