/* The motion @NAME@ as an NLP, exported by trunk_ocp @VERSION@.
 *
 *     minimize f(x)  subject to  lower <= x <= upper  and  row_lower <= g(x) <= row_upper
 *
 * @STEPS@ time steps: @UNKNOWNS@ unknowns x, @ROWS@ constraints g. Lengths are in units of
 * @LENGTH@ m, forces of @FORCE@ N and moments of @MOMENT@ N m; angles are in rad, f is in m^2.
 * layout.json says what each unknown, row and parameter is.
 *
 * The functions, in C by CasADi's code generator. There is no allocation and no state, so they
 * may run in several threads at once:
 *
 *     nlp         (x, p)                ->  f, g
 *     nlp_f       (x, p)                ->  f
 *     nlp_g       (x, p)                ->  g
 *     nlp_grad_f  (x, p)                ->  f, gradient of f
 *     nlp_jac_g   (x, p)                ->  g, Jacobian of g
 *     nlp_hess_l  (x, p, lam_f, lam_g)  ->  Hessian of lam_f f + lam_g . g, upper triangle
 *
 * The call, say of nlp_jac_g:
 *
 *     const double *arg[nlp_jac_g_SZ_ARG] = {x, NULL};  inputs; NULL stands for zeros
 *     double *res[nlp_jac_g_SZ_RES] = {g, jacobian};    outputs; NULL: not wanted
 *     double *w = malloc(nlp_jac_g_SZ_W * sizeof *w);   room to work in
 *     long long iw[nlp_jac_g_SZ_IW + 1];
 *     int failed = nlp_jac_g(arg, res, iw, w, 0);
 *
 * A function works in what is left of arg and res, so give each function arrays of its own.
 *
 * p is a change of the motion's own @PARAMETERS@ parameters (parameters.csv), such as a target that
 * moves, so NULL is the motion as it is. A matrix is the list of its nonzeros, column by column;
 * nlp_jac_g_sparsity_out(1) says where they are, as (rows, columns, where each column starts in
 * the list - columns + 1 numbers -, row of each nonzero).
 *
 * To build: cc -O2 -c nlp.c nlp_data.c, or CMakeLists.txt; example.c calls them all.
 * From CasADi, the shared library is a problem for nlpsol as it is:
 *
 *     options = {"no_nlp_grad": True, "calc_lam_p": False}
 *     solver = casadi.nlpsol("solver", "ipopt", "./libnlp.so", options)
 *
 * A first barrier of 1e-6 (ipopt.mu_init) keeps Ipopt near its start; its own 0.1 leaves it, and
 * ends in worse optima.
 */
#ifndef TRUNK_NLP_H
#define TRUNK_NLP_H

#define NLP_UNKNOWNS @UNKNOWNS@
#define NLP_ROWS @ROWS@
#define NLP_PARAMETERS @PARAMETERS@

/* CasADi's declarations */

#ifdef __cplusplus
extern "C" {
#endif

/* Bounds of x, the passive trunk to start from, and bounds of g; INFINITY where there is none. */
extern const double nlp_lower[NLP_UNKNOWNS];
extern const double nlp_upper[NLP_UNKNOWNS];
extern const double nlp_start[NLP_UNKNOWNS];
extern const double nlp_row_lower[NLP_ROWS];
extern const double nlp_row_upper[NLP_ROWS];

#ifdef __cplusplus
}
#endif

#endif
