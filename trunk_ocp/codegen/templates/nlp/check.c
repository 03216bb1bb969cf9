/* Compares the NLP's functions with nlp_check.csv, whose lines are:
 * x, f, g, gradient, nonzeros of the Jacobian, lam_f, lam_g, nonzeros of the Hessian.
 *
 *     cc -std=c99 -O2 -o check check.c nlp.c nlp_data.c -lm && ./check
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "nlp.h"

#define BAR 1e-10 /* of the largest expected value of a block */

typedef struct {
  const char *name;
  double error, scale;
} block;

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

/* Reads numbers of a line; returns 0 at the end of the file. */
static int read_numbers(FILE *file, double *into, size_t count) {
  for (size_t i = 0; i < count; i++) {
    if (fscanf(file, "%lf", &into[i]) != 1) return 0;
    int next = fgetc(file);
    if (next != ',' && next != '\n' && next != EOF) return 0;
  }
  return 1;
}

static void compare(block *b, const double *ours, const double *expected, size_t count) {
  for (size_t i = 0; i < count; i++) {
    double error = fabs(ours[i] - expected[i]);
    if (!(error <= b->error)) b->error = error; /* a NaN stays */
    b->scale = fmax(b->scale, fabs(expected[i]));
  }
}

int main(void) {
  const size_t n = NLP_UNKNOWNS, m = NLP_ROWS;
  const size_t jac = nonzeros(nlp_jac_g_sparsity_out(1));
  const size_t hess = nonzeros(nlp_hess_l_sparsity_out(0));
  const size_t length = 2 * n + 2 * m + 2 + jac + hess;
  double *line = room(length), f, *g = room(m), *gradient = room(n);
  double *jacobian = room(jac), *hessian = room(hess);
  double *w = room(nlp_grad_f_SZ_W + nlp_jac_g_SZ_W + nlp_hess_l_SZ_W);
  block blocks[] = {{"objective", 0, 0}, {"constraints", 0, 0}, {"gradient", 0, 0},
                    {"jacobian", 0, 0}, {"hessian", 0, 0}};
  casadi_int iw[1];
  int lines = 0, bad = 0;
  FILE *file = fopen("nlp_check.csv", "r");
  if (!file) {
    perror("nlp_check.csv");
    return 2;
  }
  while (read_numbers(file, line, length)) {
    const double *x = line, *lam = line + 2 * n + 1 + m + jac;
    const double *arg_f[nlp_grad_f_SZ_ARG] = {x, NULL};
    const double *arg_g[nlp_jac_g_SZ_ARG] = {x, NULL};
    const double *arg_h[nlp_hess_l_SZ_ARG] = {x, NULL, lam, lam + 1};
    double *res_f[nlp_grad_f_SZ_RES] = {&f, gradient};
    double *res_g[nlp_jac_g_SZ_RES] = {g, jacobian};
    double *res_h[nlp_hess_l_SZ_RES] = {hessian};
    bad |= nlp_grad_f(arg_f, res_f, iw, w, 0);
    bad |= nlp_jac_g(arg_g, res_g, iw, w, 0);
    bad |= nlp_hess_l(arg_h, res_h, iw, w, 0);
    compare(&blocks[0], &f, line + n, 1);
    compare(&blocks[1], g, line + n + 1, m);
    compare(&blocks[2], gradient, line + n + 1 + m, n);
    compare(&blocks[3], jacobian, line + 2 * n + 1 + m, jac);
    compare(&blocks[4], hessian, lam + 1 + m, hess);
    lines++;
  }
  bad |= !feof(file) || lines == 0;
  fclose(file);
  for (int i = 0; i < 5; i++) {
    double share = blocks[i].scale > 0 ? blocks[i].error / blocks[i].scale : blocks[i].error;
    printf("nlp %s %.1e\n", blocks[i].name, share);
    bad |= !(share <= BAR);
  }
  free(line);
  free(g);
  free(gradient);
  free(jacobian);
  free(hessian);
  free(w);
  return bad ? 1 : 0;
}
