/*
 * Derivative of the Jacobian along a direction: the same linear equations, forced by the second
 * derivatives of the rates along two changes of w, a parameter's and the direction's.
 */

/* Add the rates q' (4), M' (3), r' (3) at Gauss point j to an element's end. */
static void add_rates(double to[ENDS], const trunk_element *a, double h, int j, const double f[10])
{
    for (int c = 0; c < 4; c++) add(to, h * f[c], a->lu[NODES * c + j] + TRUNK_Q);
    for (int m = 0; m < 3; m++) {
        add(to, f[4 + m], a->on_moment[NODES * m + j]);
        to[7 + m] += h * gauss_b[j] * f[7 + m];
    }
}

/* Linear combination of columns of numbers. */
static void combine(const double *weights, const double *columns, int count, double *to)
{
    for (int i = 0; i < count; i++) to[i] = 0;
    for (int c = 0; c < PARAMETERS; c++)
        for (int i = 0; i < count; i++) to[i] += weights[c] * columns[c * count + i];
}

/* Derivative of w at an element's Gauss points with respect to a parameter. */
static void spread(trunk_work *work, int e, int parameter, const double *frame,
                   const double *force, double dw[18 * NODES])
{
    static const int force_place[9] = {0, 1, 2, 3, 7, 11, 12, 13, 14};
    trunk_element *a = &work->element[e];
    const double *start = work->response[e][parameter], h = width[e];
    const int own = own_parameter(parameter, element_segment[e]);
    double dM[3 * NODES];
    clear(dw, 18 * NODES);
    for (int j = 0; j < NODES; j++) {
        if (own >= 5) {
            double load[TRUNK_LOADS] = {0}, N[3];
            load[own - 5] = 1;
            section_force(load, point_mass[e][j], point_share[e][j], N);
            for (int i = 0; i < 3; i++) dw[NODES * (12 + i) + j] = N[i];
            for (int i = 0; i < 3; i++)
                if (own == 12 + i) dw[NODES * (15 + i) + j] = element_density(e);
        } else if (own >= 0) {
            dw[NODES * (7 + own) + j] = 1;
        }
    }
    for (int turn = 0; turn < 2; turn++) { /* M from parameters, then q, then M from q as well */
        for (int m = 0; m < 3; m++) {
            double rate[NODES];
            for (int j = 0; j < NODES; j++) {
                rate[j] = -dw[NODES * (15 + m) + j];
                for (int k = 0; k < 9; k++)
                    rate[j] += force[NODES * (6 * k + m) + j] * dw[NODES * force_place[k] + j];
            }
            integrate(start[4 + m], h, rate, dM + NODES * m);
        }
        for (int i = 0; i < 3 * NODES; i++) dw[4 * NODES + i] = dM[i];
        if (turn) break;
        for (int c = 0; c < 4; c++)
            for (int j = 0; j < NODES; j++) {
                double f = 0;
                for (int k = 4; k < 12; k++)
                    f += frame[NODES * (4 * k + c) + j] * dw[NODES * k + j];
                dw[NODES * c + j] = gauss_sum[j] * start[c] + h * f;
            }
        solve_transposed(a, dw);
    }
}

/* Second derivatives of the edges with respect to each parameter and the direction `along`. */
static void respond_twice(trunk_work *work, const double along[PARAMETERS])
{
    double (*const second)[PARAMETERS][ENDS] = work->second;
    clear(second[0][0], PARAMETERS * ENDS);
    for (int c = 0; c < 2; c++) {
        const double direction[2] = {c == 0, c == 1};
        double value[7];
        base_second(work->head, head_numbers, direction, along, value);
        for (int i = 0; i < 7; i++) second[0][c][i < 4 ? i : i + 3] = value[i];
    }
    for (int e = 0; e < TRUNK_ELEMENTS; e++) {
        const trunk_element *a = &work->element[e];
        double w[18 * NODES], rate[6 * NODES], frame[48 * NODES], force[54 * NODES];
        double dw[PARAMETERS][18 * NODES], v[18 * NODES];
        gather(work, e, w);
        force_slopes(w, section[e], rate, force);
        for (int i = 0; i < 3; i++) {
            integrate(work->shape.moment[e][i], width[e], rate + NODES * i,
                      w + NODES * (4 + i));
        }
        frame_slopes(w, section[e], rate, frame);
        for (int c = 0; c < PARAMETERS; c++) spread(work, e, c, frame, force, dw[c]);
        combine(along, dw[0], 18 * NODES, v);
        for (int c = 0; c < PARAMETERS; c++) {
            double f[10 * NODES];
            carry(a, second[e][c], second[e + 1][c]);
            rates_second(w, section[e], dw[c], v, f);
            for (int j = 0; j < NODES; j++) {
                double at[10];
                for (int i = 0; i < 10; i++) at[i] = f[NODES * i + j];
                add_rates(second[e + 1][c], a, width[e], j, at);
            }
        }
    }
    for (int c = 0; c < PARAMETERS; c++) close_column(work, second[0][c], PARAMETERS * ENDS);
}

/* The direction v of the inputs as one of the parameters. */
static void set_direction(const double *v, double along[PARAMETERS])
{
    clear(along, PARAMETERS);
    for (int k = 0; k < 2; k++) along[k] = v[TRUNK_HEAD + k];
    for (int k = 0; k < TRUNK_LOADS; k++) along[LOAD + k] = v[TRUNK_GRAVITY + k];
    for (int m = 0; m < TRUNK_MUSCLES; m++)
        for (int k = 0; k < 4; k++)
            along[STRAIN + 4 * muscle_segment[m] + k] += muscle_strain[m][k] * v[m];
    for (int s = 0; s < TRUNK_SEGMENTS; s++) along[MEAN] += fraction[s] * along[STRAIN + 4 * s];
}

int trunk_second(trunk_work *work, const double v[TRUNK_INPUTS],
                 double dJ[TRUNK_POINTS * TRUNK_OUTPUTS * TRUNK_INPUTS])
{
    double along[PARAMETERS];
    const int status = all_finite(v, TRUNK_INPUTS) ? respond(work) : TRUNK_NOT_FINITE;
    if (status) return status;
    set_direction(v, along);
    respond_twice(work, along);
    for (int point = 0; point < TRUNK_POINTS; point++) {
        double w[15], value[16], slopes[15][16], by[PARAMETERS][TRUNK_OUTPUTS];
        double dw[PARAMETERS][15], dv[15];
        edge_state(work, point, w);
        report_slopes(w, edge_section[point], value, slopes[0]);
        for (int c = 0; c < PARAMETERS; c++) point_change(work, point, c, dw[c]);
        combine(along, dw[0], 15, dv);
        for (int c = 0; c < PARAMETERS; c++) {
            const double *edge = work->second[trunk_edge[point]][c];
            report_second(w, edge_section[point], dw[c], dv, by[c] + 3);
            for (int i = 0; i < 3; i++) by[c][i] = edge[7 + i];
            for (int k = 0; k < 7; k++)
                for (int i = 0; i < 16; i++) by[c][3 + i] += edge[k] * slopes[k][i];
        }
        chain(by, dJ + point * TRUNK_OUTPUTS * TRUNK_INPUTS);
    }
    return TRUNK_OK;
}
