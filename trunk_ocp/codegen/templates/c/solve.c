/* Newton's method for the whole trunk. */

#define MAX_STEPS 40 /* from one starting shape */
#define MIN_LOAD_STEP 1e-4

/* Linearize all elements at the shape in the work; 0 if the equations are singular. */
static int linearize(trunk_work *work)
{
    work->linear = 0;
    clear(work->by_start[0][0], 3 * ENDS);
    for (int m = 0; m < 3; m++) work->by_start[0][m][4 + m] = 1;
    for (int e = 0; e < TRUNK_ELEMENTS; e++) {
        trunk_element *a = &work->element[e];
        double w[18 * NODES], rate[6 * NODES], frame[48 * NODES], force[54 * NODES];
        gather(work, e, w);
        force_slopes(w, section[e], rate, force);
        set_moments(work, e, rate, w);
        frame_slopes(w, section[e], rate, frame);
        for (int i = 0; i < 12 * NODES; i++) a->by_moment[i] = frame[16 * NODES + i];
        set_matrix(a, width[e], frame, force);
        if (!eliminate(a)) return 0;
        set_start_map(a, width[e]);
        set_own_map(a, e, frame, force);
        for (int m = 0; m < 3; m++) {
            double *to = work->by_start[e + 1][m];
            for (int i = 0; i < ENDS; i++) to[i] = i < 7 ? 0 : work->by_start[e][m][i];
            for (int i = 0; i < 7; i++) add(to, work->by_start[e][m][i], a->map[i]);
        }
    }
    work->linear = invert(work->closing, work->by_start[TRUNK_ELEMENTS]);
    return work->linear;
}

/* Residuals of an element, as rates times h, and their effect on a change at its start. */
static void hand_on(trunk_work *work, int e, double residual[TRUNK_Q], const double from[7],
                    double to[ENDS])
{
    const trunk_element *a = &work->element[e];
    const double *q = work->shape.q[e], *start = work->shape.edge[e];
    double w[18 * NODES], rate[6 * NODES];
    gather(work, e, w);
    force_rates(w, section[e], rate);
    set_moments(work, e, rate, w);
    frame_rates(w, section[e], rate);
    for (int i = 0; i < ENDS; i++) to[i] = 0;
    for (int c = 0; c < 4; c++) {
        double *f = residual + NODES * c;
        to[c] += start[c] - work->shape.edge[e + 1][c];
        for (int j = 0; j < NODES; j++) f[j] = width[e] * rate[NODES * c + j];
        for (int k = 0; k < NODES; k++) {
            const double gap = start[c] - q[NODES * c + k];
            to[c] -= gauss_end[k] * gap;
            for (int j = 0; j < NODES; j++) f[j] += gauss_D[k][j] * gap;
        }
        for (int j = 0; j < NODES; j++) add(to, f[j], a->lu[NODES * c + j] + TRUNK_Q);
    }
    for (int i = 0; i < 7; i++) add(to, from[i], a->map[i]);
}

/* One Newton step with the current linearization; returns its relative size. */
static double correct(trunk_work *work, const double base[7])
{
    trunk_shape *shape = &work->shape;
    double residual[TRUNK_ELEMENTS][TRUNK_Q], change[TRUNK_ELEMENTS + 1][ENDS], start[3];
    double size = 0, moment = small_moment, moment_size = 0;
    clear(change[0], ENDS);
    for (int c = 0; c < 4; c++) change[0][c] = base[c] - shape->edge[0][c];
    for (int e = 0; e < TRUNK_ELEMENTS; e++)
        hand_on(work, e, residual[e], change[e], change[e + 1]);
    for (int i = 0; i < 3; i++) {
        start[i] = 0;
        for (int k = 0; k < 3; k++)
            start[i] -= work->closing[i][k]
                        * (shape->moment[TRUNK_ELEMENTS][k] + change[TRUNK_ELEMENTS][4 + k]);
    }
    for (int e = 0; e <= TRUNK_ELEMENTS; e++) {
        for (int m = 0; m < 3; m++) add(change[e], start[m], work->by_start[e][m]);
        for (int c = 0; c < 4; c++) shape->edge[e][c] += change[e][c];
        moment = largest(moment, shape->moment[e], 3);
        moment_size = largest(moment_size, change[e] + 4, 3);
        size = largest(size, change[e], 4);
    }
    for (int e = 0; e < TRUNK_ELEMENTS; e++) {
        trunk_element *a = &work->element[e];
        for (int c = 0; c < 4; c++)
            for (int j = 0; j < NODES; j++) {
                double f = gauss_sum[j] * change[e][c];
                for (int m = 0; m < 3; m++)
                    f += width[e] * a->by_moment[NODES * (4 * m + c) + j] * change[e][4 + m];
                residual[e][NODES * c + j] += f;
            }
        solve_transposed(a, residual[e]);
        size = largest(size, residual[e], TRUNK_Q);
        for (int i = 0; i < TRUNK_Q; i++) shape->q[e][i] += residual[e][i];
    }
    for (int i = 0; i < 3; i++) shape->moment[0][i] += start[i];
    moment_size /= moment;
    if (moment_size > size || isnan(moment_size)) size = moment_size;
    return size;
}

/*
 * Newton's method from the shape in the work; returns whether it converged. A linearization is
 * reused while steps shrink fast with it: near the last shape no new one is needed, and the first
 * step is the first-order prediction from that shape.
 */
static int newton(trunk_work *work)
{
    double base[7], last = work->linear ? HUGE_VAL : 0;
    int renew = !work->linear;
    base_values(work->head, head_numbers, base);
    for (int step = 0; step < MAX_STEPS && work->steps_left > 0; step++) {
        double size, error;
        work->steps_left--;
        if (renew && !linearize(work)) return 0;
        size = correct(work, base);
        if (!(size < 1e6)) return 0;
        /* Remaining error: quadratic after a new linearization, linear with an old one. */
        error = renew ? 1e3 * size * size : step ? size * (size / last) : size;
        if (error < 1e-13) return 1;
        renew = size > 0.1 * last;
        last = size;
    }
    return 0;
}
