/*
 * Derivatives with respect to the inputs
 * --------------------------------------
 * First with respect to the PARAMETERS of the trunk: head, mean extension, loads, strains of the
 * segments. Activations act only through strains and mean extension, of which there are fewer.
 */

#define PARAMETERS TRUNK_PARAMETERS
#define MEAN 2
#define LOAD 3
#define STRAIN (3 + TRUNK_LOADS)

/* Row of an element's map that belongs to a parameter of the trunk; -1 if there is none. */
static int own_parameter(int parameter, int segment)
{
    if (parameter < MEAN) return -1;
    if (parameter == MEAN) return 4;
    if (parameter < STRAIN) return 5 + parameter - LOAD;
    parameter -= STRAIN + 4 * segment;
    return 0 <= parameter && parameter < 4 ? parameter : -1;
}

/* Add to the change of every edge the change of M(0) that keeps M(L) = 0. */
static void close_column(const trunk_work *work, double *edges, size_t stride)
{
    const double *tip = edges + TRUNK_ELEMENTS * stride + 4;
    double start[3];
    for (int i = 0; i < 3; i++) {
        start[i] = 0;
        for (int k = 0; k < 3; k++) start[i] -= work->closing[i][k] * tip[k];
    }
    for (int e = 0; e <= TRUNK_ELEMENTS; e++)
        for (int m = 0; m < 3; m++) add(edges + (size_t)e * stride, start[m], work->by_start[e][m]);
}

/* Change of an element's end due to the change at its start, without its own parameters. */
static void carry(const trunk_element *a, const double from[ENDS], double to[ENDS])
{
    for (int i = 0; i < ENDS; i++) to[i] = i < 7 ? 0 : from[i];
    for (int i = 0; i < 7; i++) add(to, from[i], a->map[i]);
}

/* Derivatives of the edges with respect to the parameters, at the shape in the work; a status. */
static int respond(trunk_work *work)
{
    double base[7], slopes[14];
    if (!work->found) return TRUNK_NOT_FOUND;
    if (work->responded) return TRUNK_OK;
    if (!linearize(work)) {
        trunk_reset(work);
        return TRUNK_NOT_FOUND;
    }
    base_slopes(work->head, head_numbers, base, slopes);
    clear(work->response[0][0], PARAMETERS * ENDS);
    for (int c = 0; c < 2; c++)
        for (int i = 0; i < 7; i++) work->response[0][c][i < 4 ? i : i + 3] = slopes[7 * c + i];
    for (int e = 0; e < TRUNK_ELEMENTS; e++) {
        const trunk_element *a = &work->element[e];
        for (int c = 0; c < PARAMETERS; c++) {
            const int own = own_parameter(c, element_segment[e]);
            double *to = work->response[e + 1][c];
            carry(a, work->response[e][c], to);
            if (own >= 0) add(to, 1, a->map[7 + own]);
        }
    }
    for (int c = 0; c < PARAMETERS; c++)
        close_column(work, work->response[0][c], sizeof work->response[0] / sizeof(double));
    work->responded = 1;
    return TRUNK_OK;
}

/* Derivative of w of `report` at a point with respect to a parameter. */
static void point_change(const trunk_work *work, int point, int parameter, double w[15])
{
    const double *edge = work->response[trunk_edge[point]][parameter];
    const int own = own_parameter(parameter, edge_segment[point]);
    for (int i = 0; i < 7; i++) w[i] = edge[i];
    for (int i = 7; i < 15; i++) w[i] = 0;
    if (own >= 5) {
        double load[TRUNK_LOADS] = {0};
        load[own - 5] = 1;
        section_force(load, edge_mass[point], edge_share[point], w + 12);
    } else if (own >= 0) {
        w[7 + own] = 1;
    }
}

/* Derivatives with respect to inputs, from those with respect to parameters (overwritten). */
static void chain(double by[PARAMETERS][TRUNK_OUTPUTS], double *J)
{
    for (int s = 0; s < TRUNK_SEGMENTS; s++)
        for (int i = 0; i < TRUNK_OUTPUTS; i++) by[STRAIN + 4 * s][i] += fraction[s] * by[MEAN][i];
    for (int i = 0; i < TRUNK_OUTPUTS; i++) {
        double *row = J + TRUNK_INPUTS * i;
        for (int m = 0; m < TRUNK_MUSCLES; m++) {
            const int first = STRAIN + 4 * muscle_segment[m];
            row[m] = 0;
            for (int k = 0; k < 4; k++) row[m] += muscle_strain[m][k] * by[first + k][i];
        }
        for (int k = 0; k < 2; k++) row[TRUNK_HEAD + k] = by[k][i];
        for (int k = 0; k < TRUNK_LOADS; k++) row[TRUNK_GRAVITY + k] = by[LOAD + k][i];
    }
}

int trunk_jacobian(trunk_work *work, double J[TRUNK_POINTS * TRUNK_OUTPUTS * TRUNK_INPUTS])
{
    const int status = respond(work);
    if (status) return status;
    for (int point = 0; point < TRUNK_POINTS; point++) {
        double w[15], value[16], slopes[15][16], by[PARAMETERS][TRUNK_OUTPUTS];
        edge_state(work, point, w);
        report_slopes(w, edge_section[point], value, slopes[0]);
        for (int c = 0; c < PARAMETERS; c++) {
            double *to = by[c] + 3;
            point_change(work, point, c, w);
            for (int i = 0; i < 3; i++) by[c][i] = work->response[trunk_edge[point]][c][7 + i];
            for (int i = 0; i < 16; i++) to[i] = 0;
            for (int k = 0; k < 15; k++) {
                if (k >= 7 && !(fabs(w[k]) > 0)) continue;
                for (int i = 0; i < 16; i++) to[i] += w[k] * slopes[k][i];
            }
        }
        chain(by, J + point * TRUNK_OUTPUTS * TRUNK_INPUTS);
    }
    return TRUNK_OK;
}
