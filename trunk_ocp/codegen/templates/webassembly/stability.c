/*
 * Stability
 * ---------
 * The second variation Q[y] of the energy (`rod.buckling`), element by element from the tip: in
 * unknowns s, the scaled rates of y at the Gauss points, and the turn y at the left edge. With
 * y_1 . P y_1 the least value of Q beyond an element,
 *     Q - share |s|^2 = s . (inner - share) s + 2 y . mixed s + y . edge y + y_1 . P y_1,
 * y_1 = y + over s. All eigenvalues of Q are above the share if every matrix of s is positive
 * definite.
 */

#define RATES (3 * NODES)
#define NEUTRAL_MARGIN 1e-5
#define MARGIN_HALVINGS 6

typedef struct {
    double inner[RATES][RATES], mixed[3][RATES], over[3][RATES], edge[3][3];
} trunk_variation;

static trunk_variation variation[MAX_ELEMENTS];

/* Integrand at a Gauss point: y' = rate s, and Q = |s|^2 + y . (by_turn y + by_rate s). Its weight
 * is in it. */
typedef struct {
    double rate[3][3], by_turn[3][3], by_rate[3][3];
} trunk_integrand;

static void set_integrand(trunk_integrand *at, int e, int j, const double *w, const double M[3])
{
    const double *p = section[e] + j;
    const double weight = width[e] * gauss_b[j], zeta_hat = w[NODES * 7 + j], mean = work.mean;
    double q[4], d[9], N[3], across[3], n3 = 0, zeta;
    const double *d3 = d + 6;
    for (int i = 0; i < 4; i++) q[i] = w[NODES * i + j];
    for (int i = 0; i < 3; i++) N[i] = w[NODES * (12 + i) + j];
    set_directors(q, d);
    for (int i = 0; i < 3; i++) n3 += N[i] * d3[i];
    for (int i = 0; i < 3; i++)
        across[i] = N[(i + 1) % 3] * d3[(i + 2) % 3] - N[(i + 2) % 3] * d3[(i + 1) % 3];
    zeta = zeta_hat * (1 + n3 * mean / p[NODES]);
    for (int i = 0; i < 3; i++) {
        const double B = p[NODES * (2 + i)] / (mean * mean * zeta_hat);
        for (int k = 0; k < 3; k++) at->rate[k][i] = d[3 * i + k] / sqrt(weight * B);
    }
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            at->by_turn[i][k] =
                weight * ((i == k) * zeta * n3 - zeta * (d3[i] * N[k] + d3[k] * N[i]) / 2
                          - zeta_hat * mean / p[NODES] * across[i] * across[k]);
    for (int k = 0; k < 3; k++) {
        const double c[3] = {at->rate[0][k], at->rate[1][k], at->rate[2][k]};
        for (int i = 0; i < 3; i++) /* M x y' */
            at->by_rate[i][k] =
                weight * (M[(i + 1) % 3] * c[(i + 2) % 3] - M[(i + 2) % 3] * c[(i + 1) % 3]);
    }
}

/* to += factor * a^T b for 3 x 3 matrices; `to` has rows of RATES numbers. */
static void add_product(double *to, double factor, double (*a)[3], double (*b)[3])
{
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            to[RATES * i + k] +=
                factor * (a[0][i] * b[0][k] + a[1][i] * b[1][k] + a[2][i] * b[2][k]);
}

static void set_variation(int e)
{
    trunk_variation *v = &variation[e];
    trunk_integrand at[NODES];
    double w[18 * NODES], rate[6 * NODES];
    const double h = width[e];
    gather(&work, e, w);
    force_rates(w, section[e], rate);
    set_moments(&work, e, rate, w);
    clear(v->inner[0], sizeof *v / sizeof(double));
    for (int j = 0; j < NODES; j++) {
        const double M[3] = {w[NODES * 4 + j], w[NODES * 5 + j], w[NODES * 6 + j]};
        set_integrand(&at[j], e, j, w, M);
    }
    for (int j = 0; j < NODES; j++) {
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++) {
                v->edge[i][k] += at[j].by_turn[i][k];
                v->over[i][3 * j + k] = h * gauss_b[j] * at[j].rate[i][k];
                v->mixed[i][3 * j + k] += at[j].by_rate[i][k] / 2;
            }
        for (int l = 0; l < NODES; l++) {
            double sum[3][3] = {{0}}, turned[3][3];
            for (int k = 0; k < NODES; k++) {
                const double factor = h * h * gauss_A[j][k] * gauss_A[l][k];
                for (int i = 0; i < 9; i++) sum[0][i] += factor * at[k].by_turn[0][i];
            }
            for (int i = 0; i < 3; i++)
                for (int k = 0; k < 3; k++)
                    turned[i][k] = sum[i][0] * at[l].rate[0][k] + sum[i][1] * at[l].rate[1][k]
                                   + sum[i][2] * at[l].rate[2][k];
            add_product(&v->inner[3 * j][3 * l], 1, at[j].rate, turned);
            /* y at point l by s at point j, times the moment's part at l; and its transpose. */
            add_product(&v->inner[3 * j][3 * l], h * gauss_A[j][l] / 2, at[j].rate, at[l].by_rate);
            add_product(&v->inner[3 * j][3 * l], h * gauss_A[l][j] / 2, at[j].by_rate, at[l].rate);
            for (int i = 0; i < 3; i++)
                for (int k = 0; k < 3; k++)
                    for (int n = 0; n < 3; n++)
                        v->mixed[i][3 * j + k] +=
                            h * gauss_A[j][l] * at[l].by_turn[i][n] * at[j].rate[n][k];
        }
        for (int i = 0; i < 3; i++) v->inner[3 * j + i][3 * j + i] += 1;
    }
}

/* Whether all eigenvalues of Q are above a share; wants `set_variation` of all elements. */
static int all_above(double share)
{
    double P[3][3] = {{0}};
    for (int e = mesh.count - 1; e >= 0; e--) {
        const trunk_variation *v = &variation[e];
        double row[RATES][RATES + 3]; /* upper triangle of the matrix of s, right-hand sides */
        for (int k = 0; k < RATES; k++) {
            double push[3];
            for (int i = 0; i < 3; i++) {
                push[i] = P[i][0] * v->over[0][k] + P[i][1] * v->over[1][k]
                          + P[i][2] * v->over[2][k];
                row[k][RATES + i] = v->mixed[i][k] + push[i];
            }
            for (int l = k; l < RATES; l++)
                row[k][l] = v->inner[k][l] + push[0] * v->over[0][l] + push[1] * v->over[1][l]
                            + push[2] * v->over[2][l];
            row[k][k] -= share;
        }
        for (int i = 0; i < 9; i++) P[0][i] += v->edge[0][i];
        for (int k = 0; k < RATES; k++) {
            const double *pivot = row[k];
            if (!(pivot[k] > 0)) return 0; /* NaN as well */
            for (int i = k + 1; i < RATES; i++) {
                const double factor = pivot[i] / pivot[k];
                for (int l = i; l < RATES + 3; l++) row[i][l] -= factor * pivot[l];
            }
            for (int i = 0; i < 3; i++)
                for (int l = 0; l < 3; l++)
                    P[i][l] -= pivot[RATES + i] * pivot[RATES + l] / pivot[k];
        }
    }
    return 1;
}

/* Whether the shape in the work is stable; also prepares `buckling_margin`. */
static int is_stable(void)
{
    for (int e = 0; e < mesh.count; e++) set_variation(e);
    return all_above(NEUTRAL_MARGIN);
}

/* Lower bound of the least eigenvalue of a stable shape, at most 1, to 2^-MARGIN_HALVINGS. */
static double buckling_margin(void)
{
    double low = NEUTRAL_MARGIN, high = 1;
    for (int i = 0; i < MARGIN_HALVINGS; i++) {
        const double middle = (low + high) / 2;
        if (all_above(middle)) low = middle;
        else high = middle;
    }
    return low;
}
