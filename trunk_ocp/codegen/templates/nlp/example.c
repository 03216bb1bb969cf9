/* Evaluates every function of the NLP at its start: sizes, nonzeros, values, times.
 *
 *     cc -std=c99 -O2 -o example example.c nlp.c nlp_data.c -lm && ./example
 */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "nlp.h"

typedef int evaluation(const double **, double **, casadi_int *, double *, int);

/* Number of nonzeros of a sparsity pattern: the last of its column starts. */
static size_t nonzeros(const casadi_int *sparsity) {
  return (size_t)sparsity[2 + sparsity[1]];
}

static double *room(size_t count) {
  double *made = malloc((count ? count : 1) * sizeof *made);
  if (!made) {
    fprintf(stderr, "out of memory\n");
    exit(2);
  }
  return made;
}

/* Repeats a call for a tenth of a second; returns the time of one call. */
static double timed(evaluation *evaluate, const double **arg, double **res, size_t work) {
  double *w = room(work), seconds;
  casadi_int iw[1];
  clock_t began = clock();
  int count = 0;
  do {
    if (evaluate(arg, res, iw, w, 0)) exit(1);
    count++;
    seconds = (double)(clock() - began) / CLOCKS_PER_SEC;
  } while (seconds < 0.1);
  free(w);
  return seconds / count;
}

int main(void) {
  size_t in_jacobian = nonzeros(nlp_jac_g_sparsity_out(1));
  size_t in_hessian = nonzeros(nlp_hess_l_sparsity_out(0));
  double f, lam_f = 1.0, *g = room(NLP_ROWS), *gradient = room(NLP_UNKNOWNS);
  double *jacobian = room(in_jacobian), *hessian = room(in_hessian), seconds;

  /* Inputs and outputs of each call, with the workspace that it needs. */
  const double *of_f[nlp_grad_f_SZ_ARG] = {nlp_start, NULL};
  const double *of_g[nlp_jac_g_SZ_ARG] = {nlp_start, NULL};
  const double *of_h[nlp_hess_l_SZ_ARG] = {nlp_start, NULL, &lam_f, NULL};
  double *to_f[nlp_grad_f_SZ_RES] = {&f, gradient};
  double *to_g[nlp_jac_g_SZ_RES] = {g, jacobian};
  double *to_h[nlp_hess_l_SZ_RES] = {hessian};

  printf("%d unknowns, %d constraints\n", NLP_UNKNOWNS, NLP_ROWS);
  seconds = timed(nlp_grad_f, of_f, to_f, nlp_grad_f_SZ_W);
  printf("objective %.12g, with its gradient in %.3f ms\n", f, 1e3 * seconds);
  seconds = timed(nlp_jac_g, of_g, to_g, nlp_jac_g_SZ_W);
  printf("Jacobian: %lu nonzeros, in %.3f ms\n", (unsigned long)in_jacobian, 1e3 * seconds);
  /* lam_g is NULL: the Hessian of the objective, at the cost of the full Hessian. */
  seconds = timed(nlp_hess_l, of_h, to_h, nlp_hess_l_SZ_W);
  printf("Hessian: %lu nonzeros, in %.3f ms\n", (unsigned long)in_hessian, 1e3 * seconds);

  free(g);
  free(gradient);
  free(jacobian);
  free(hessian);
  return 0;
}
