/*
 * The shape under load
 * --------------------
 * In space axes q' = q o (0, zeta_hat u) / 2, M' = -zeta d3 x N - l and r' = zeta d3, collocated
 * at TRUNK_NODES Gauss points of each element. M is a quadrature of M', so the unknowns of an
 * element are only the orientations q at its Gauss points. Newton's method condenses each element
 * onto q and M at its start; M(L) = 0 then gives M(0).
 *
 * Arrays over the Gauss points of an element are stored component by component: component c at
 * point j is at [NODES * c + j], so that a compiler can vectorize over the points.
 */

#define ENDS TRUNK_ENDS

static void clear(double *to, size_t count)
{
    for (size_t i = 0; i < count; i++) to[i] = 0;
}

static int all_finite(const double *x, int count)
{
    for (int i = 0; i < count; i++)
        if (!isfinite(x[i])) return 0;
    return 1;
}

static double largest(double bound, const double *x, int count)
{
    for (int i = 0; i < count; i++) {
        const double size = fabs(x[i]);
        if (size > bound || isnan(size)) bound = size; /* keeps NaN */
    }
    return bound;
}

/* Set the strains of the segments; returns a status. */
static int set_strain(const double *activation, double strain[TRUNK_SEGMENTS][4], double *mean)
{
    for (int s = 0; s < TRUNK_SEGMENTS; s++)
        for (int i = 0; i < 4; i++) strain[s][i] = i == 0;
    for (int m = 0; m < TRUNK_MUSCLES; m++)
        for (int i = 0; i < 4; i++)
            strain[muscle_segment[m]][i] += muscle_strain[m][i] * activation[m];
    *mean = 0;
    for (int s = 0; s < TRUNK_SEGMENTS; s++) {
        if (!(strain[s][0] > 0)) return TRUNK_COLLAPSED;
        *mean += fraction[s] * strain[s][0];
    }
    return TRUNK_OK;
}

/* Force N on a section, from the mass and the share of the contact force beyond it. */
static void section_force(const double *load, double mass, double share, double N[3])
{
    for (int i = 0; i < 3; i++) N[i] = load[1 + i];
    N[2] += mass * load[0];
#if TRUNK_CONTACT
    for (int i = 0; i < 3; i++) N[i] += share * load[4 + i];
#else
    (void)share;
#endif
}

/* Set the loads, times a factor, at the Gauss points. */
static void set_loads(trunk_work *work, const double *x, double factor)
{
    for (int i = 0; i < TRUNK_LOADS; i++) work->load[i] = factor * x[TRUNK_GRAVITY + i];
    for (int e = 0; e < TRUNK_ELEMENTS; e++) {
        for (int j = 0; j < NODES; j++) {
            double N[3];
            section_force(work->load, point_mass[e][j], point_share[e][j], N);
            for (int i = 0; i < 3; i++) work->force[e][NODES * i + j] = N[i];
        }
        for (int i = 0; i < 3; i++) {
#if TRUNK_CONTACT
            work->couple[e][i] = couple_density[e] * work->load[7 + i];
#else
            work->couple[e][i] = 0;
#endif
        }
    }
}

/* Set w at an element's Gauss points, all but M. */
static void gather(const trunk_work *work, int e, double w[18 * NODES])
{
    const double *strain = work->strain[element_segment[e]];
    for (int i = 0; i < 4 * NODES; i++) w[i] = work->shape.q[e][i];
    for (int i = 0; i < 3 * NODES; i++) w[12 * NODES + i] = work->force[e][i];
    for (int j = 0; j < NODES; j++) {
        for (int i = 0; i < 4; i++) w[NODES * (7 + i) + j] = strain[i];
        w[NODES * 11 + j] = work->mean;
        for (int i = 0; i < 3; i++) w[NODES * (15 + i) + j] = work->couple[e][i];
    }
}

/* Integrate rates from an element's start to its Gauss points; returns the value at the end. */
static double integrate(double start, double h, const double *rate, double *at)
{
    double end = 0;
    for (int j = 0; j < NODES; j++) at[j] = 0;
    for (int k = 0; k < NODES; k++) {
        for (int j = 0; j < NODES; j++) at[j] += gauss_A[k][j] * rate[k];
        end += gauss_b[k] * rate[k];
    }
    for (int j = 0; j < NODES; j++) at[j] = start + h * at[j];
    return start + h * end;
}

/* Set M in w and at the element's end. */
static void set_moments(trunk_work *work, int e, const double *rate, double w[18 * NODES])
{
    for (int i = 0; i < 3; i++)
        work->shape.moment[e + 1][i] = integrate(
            work->shape.moment[e][i], width[e], rate + NODES * i, w + NODES * (4 + i));
}

/* to[c] -= sum_k factor[k] row[k][c] for four rows of factors, and c from first to last. */
static void subtract(double *restrict to, const double factor[4],
                     double (*restrict row)[TRUNK_Q + ENDS], int first, int last)
{
    const double f0 = factor[0], f1 = factor[1], f2 = factor[2], f3 = factor[3];
    for (int c = first; c < last; c++)
        to[c] -= f0 * row[0][c] + f1 * row[1][c] + f2 * row[2][c] + f3 * row[3][c];
}

/* Eliminate column k below the diagonal with row pivoting, in the columns before `last`. */
static int eliminate_column(trunk_element *a, int k, int last)
{
    double *row = a->lu[k];
    int best = k;
    for (int i = k + 1; i < TRUNK_Q; i++)
        if (fabs(a->lu[i][k]) > fabs(a->lu[best][k])) best = i;
    a->order[k] = best;
    if (best != k)
        for (int c = 0; c < TRUNK_Q + ENDS; c++) {
            const double swapped = row[c];
            row[c] = a->lu[best][c];
            a->lu[best][c] = swapped;
        }
    if (!(fabs(row[k]) > 0)) return 0;
    a->pivot[k] = 1 / row[k];
    for (int i = k + 1; i < TRUNK_Q; i++) {
        a->lu[i][k] *= a->pivot[k];
        for (int c = k + 1; c < last; c++) a->lu[i][c] -= a->lu[i][k] * row[c];
    }
    return 1;
}

/*
 * Gaussian elimination of [matrix | right-hand sides] with row pivoting, four columns at a time so
 * that most work is in `subtract`; the solutions replace the right-hand sides.
 */
static int eliminate(trunk_element *a)
{
    for (int k = 0; k < TRUNK_Q; k += 4) {
        for (int i = k; i < k + 4; i++) {
            if (!eliminate_column(a, i, k + 4)) return 0;
        }
        for (int i = k + 1; i < k + 4; i++)
            for (int j = k; j < i; j++)
                for (int c = k + 4; c < TRUNK_Q + ENDS; c++)
                    a->lu[i][c] -= a->lu[i][j] * a->lu[j][c];
        for (int i = k + 4; i < TRUNK_Q; i++)
            subtract(a->lu[i], a->lu[i] + k, a->lu + k, k + 4, TRUNK_Q + ENDS);
    }
    for (int i = TRUNK_Q - 1; i >= 0; i--) {
        double sum[ENDS];
        for (int c = 0; c < ENDS; c++) sum[c] = a->lu[i][TRUNK_Q + c];
        for (int k = i + 1; k < TRUNK_Q; k++)
            for (int c = 0; c < ENDS; c++) sum[c] -= a->lu[i][k] * a->lu[k][TRUNK_Q + c];
        for (int c = 0; c < ENDS; c++) a->lu[i][TRUNK_Q + c] = a->pivot[i] * sum[c];
    }
    return 1;
}

/* Solve with the transpose of the eliminated matrix, in place. */
static void solve_transposed(trunk_element *a, double x[TRUNK_Q])
{
    for (int k = 0; k < TRUNK_Q; k += 4) {
        for (int i = k; i < k + 4; i++) {
            x[i] *= a->pivot[i];
            for (int j = i + 1; j < k + 4; j++) x[j] -= a->lu[i][j] * x[i];
        }
        subtract(x, x + k, a->lu + k, k + 4, TRUNK_Q);
    }
    for (int k = TRUNK_Q - 4; k >= 0; k -= 4) {
        for (int i = k + 3; i > k; i--)
            for (int j = k; j < i; j++) x[j] -= a->lu[i][j] * x[i];
        subtract(x, x + k, a->lu + k, 0, k);
    }
    for (int i = TRUNK_Q - 1; i >= 0; i--) {
        const int other = a->order[i];
        const double swapped = x[i];
        x[i] = x[other];
        x[other] = swapped;
    }
}

/*
 * The equations of an element, differentiated and multiplied by the inverse of gauss_A,
 *     sum_k D_jk (dq_k - dq_a) = h [Qq_j dq_j + Qm_j (dM_a + h sum_k A_jk mq_k dq_k)] + h f_j,
 * stored as the transpose of their matrix, next to the weights of dq in the element's ends.
 */
static void set_matrix(trunk_element *a, double h, const double *frame, const double *force)
{
    for (int c = 0; c < 4; c++) {
        for (int k = 0; k < NODES; k++) {
            double *row = a->lu[NODES * c + k];
            double mq[3];
            for (int m = 0; m < 3; m++) mq[m] = h * h * force[NODES * (6 * c + m) + k];
            for (int r = 0; r < 4; r++) {
                const double *Qm = a->by_moment + NODES * r;
                for (int j = 0; j < NODES; j++)
                    row[NODES * r + j] =
                        -gauss_A[k][j] * (Qm[j] * mq[0] + Qm[4 * NODES + j] * mq[1]
                                          + Qm[8 * NODES + j] * mq[2]);
                row[NODES * r + k] -= h * frame[NODES * (4 * c + r) + k];
            }
            for (int j = 0; j < NODES; j++) row[NODES * c + j] += gauss_D[k][j];
            for (int r = 0; r < 4; r++) row[TRUNK_Q + r] = r == c ? gauss_end[k] : 0;
            for (int r = 0; r < 6; r++)
                row[TRUNK_Q + 4 + r] = h * gauss_b[k] * force[NODES * (6 * c + r) + k];
        }
    }
}

/* to += factor * from, for the state at an element's end. */
static void add(double *restrict to, double factor, const double *restrict from)
{
    for (int i = 0; i < ENDS; i++) to[i] += factor * from[i];
}

/* Weights on M', and derivatives of the ends with respect to q and M at the start. */
static void set_start_map(trunk_element *a, double h)
{
    double on_turn[3 * NODES][ENDS];
    clear(on_turn[0], sizeof on_turn / sizeof(double));
    clear(a->map[0], sizeof a->map / sizeof(double));
    clear(a->on_moment[0], sizeof a->on_moment / sizeof(double));
    for (int m = 0; m < 3; m++) {
        a->map[4 + m][4 + m] = 1;
        for (int j = 0; j < NODES; j++) {
            double *weights = on_turn[NODES * m + j];
            for (int c = 0; c < 4; c++)
                add(weights, h * a->by_moment[NODES * (4 * m + c) + j],
                    a->lu[NODES * c + j] + TRUNK_Q);
            add(a->map[4 + m], 1, weights);
        }
        for (int k = 0; k < NODES; k++) {
            double *weights = a->on_moment[NODES * m + k];
            weights[4 + m] = h * gauss_b[k];
            for (int j = 0; j < NODES; j++) add(weights, h * gauss_A[k][j], on_turn[NODES * m + j]);
        }
    }
    for (int c = 0; c < 4; c++) {
        a->map[c][c] = 1;
        for (int j = 0; j < NODES; j++) {
            a->map[c][c] -= gauss_end[j];
            add(a->map[c], gauss_sum[j], a->lu[NODES * c + j] + TRUNK_Q);
        }
    }
}

/* Derivatives of an element's ends with respect to its parameters. */
static void set_own_map(trunk_element *a, int e, const double *frame, const double *force)
{
    /* Columns of zeta and mean extension in the slopes of the force; c has none. */
    static const int place[5] = {4, 0, 0, 0, 5};
    double (*const map)[ENDS] = a->map + 7, h = width[e];
    for (int j = 0; j < NODES; j++) {
        double by_force[3][ENDS];
        for (int own = 0; own < 5; own++) {
            const double *by = force + NODES * 6 * place[own] + j;
            for (int c = 0; c < 4; c++)
                add(map[own], h * frame[NODES * (4 * (7 + own) + c) + j],
                    a->lu[NODES * c + j] + TRUNK_Q);
            for (int m = 0; m < 3 && place[own]; m++) {
                add(map[own], by[NODES * m], a->on_moment[NODES * m + j]);
                map[own][7 + m] += h * gauss_b[j] * by[NODES * (3 + m)];
            }
        }
        clear(by_force[0], sizeof by_force / sizeof(double));
        for (int i = 0; i < 3; i++) {
            for (int m = 0; m < 3; m++) {
                add(by_force[i], force[NODES * (6 * (6 + i) + m) + j], a->on_moment[NODES * m + j]);
                by_force[i][7 + m] += h * gauss_b[j] * force[NODES * (6 * (6 + i) + 3 + m) + j];
            }
            add(map[6 + i], 1, by_force[i]);
#if TRUNK_CONTACT
            add(map[9 + i], point_share[e][j], by_force[i]);
            add(map[12 + i], -couple_density[e], a->on_moment[NODES * i + j]);
#endif
        }
        add(map[5], point_mass[e][j], by_force[2]);
    }
}

/* Inverse of a 3 x 3 matrix whose columns are numbers [4 .. 6]; 0 if it is singular. */
static int invert(double inverse[3][3], double columns[3][ENDS])
{
    double determinant = 0;
    for (int i = 0; i < 3; i++) {
        const double *b = columns[(i + 1) % 3] + 4, *c = columns[(i + 2) % 3] + 4;
        for (int k = 0; k < 3; k++)
            inverse[i][k] = b[(k + 1) % 3] * c[(k + 2) % 3] - b[(k + 2) % 3] * c[(k + 1) % 3];
    }
    for (int k = 0; k < 3; k++) determinant += columns[0][4 + k] * inverse[0][k];
    if (!(fabs(determinant) > 0)) return 0;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) inverse[i][k] /= determinant;
    return 1;
}
