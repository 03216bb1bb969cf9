/*
 * The shape without loads: each element is a piece of a conical spiral, in closed form.
 */

#define UNLOADED_PARAMETERS (2 + 4 * TRUNK_SEGMENTS) /* head, strains of the segments */
#define UNLOADED TRUNK_UNLOADED_OUTPUTS

/* q and r at an edge, and their derivatives with respect to the parameters. */
typedef struct {
    double q[4], r[3], by[UNLOADED_PARAMETERS][7];
} unloaded_edge;

static void unloaded_base(const double *head, unloaded_edge *at)
{
    double base[7], slopes[14];
    base_slopes(head, head_numbers, base, slopes);
    for (int i = 0; i < 4; i++) at->q[i] = base[i];
    for (int i = 0; i < 3; i++) at->r[i] = base[4 + i];
    clear(at->by[0], UNLOADED_PARAMETERS * 7);
    for (int i = 0; i < 14; i++) at->by[i / 7][i % 7] = slopes[i];
}

/* Propagate from an element's start to its end. */
static void unloaded_step(unloaded_edge *at, int e, const double strain[4], int derivatives)
{
    double w[8], end[7], slopes[8][7];
    for (int i = 0; i < 4; i++) w[i] = at->q[i];
    for (int i = 0; i < 4; i++) w[4 + i] = strain[i];
    if (derivatives) {
        stepped_slopes(w, piece[e], end, slopes[0]);
        for (int c = 0; c < UNLOADED_PARAMETERS; c++) {
            const int own = c - 2 - 4 * element_segment[e];
            double to[7] = {0};
            for (int i = 0; i < 3; i++) to[4 + i] = at->by[c][4 + i];
            for (int k = 0; k < 4; k++)
                for (int i = 0; i < 7; i++) to[i] += at->by[c][k] * slopes[k][i];
            for (int i = 0; i < 7; i++) {
                if (0 <= own && own < 4) to[i] += slopes[4 + own][i];
                at->by[c][i] = to[i];
            }
        }
    } else {
        stepped_values(w, piece[e], end);
    }
    for (int i = 0; i < 4; i++) at->q[i] = end[i];
    for (int i = 0; i < 3; i++) at->r[i] += end[4 + i];
}

/* Derivatives of one point's outputs with respect to the controls. */
static void unloaded_jacobian(const unloaded_edge *at, int segment, double slopes[15][16],
                              double *J)
{
    double by[UNLOADED_PARAMETERS][UNLOADED];
    for (int c = 0; c < UNLOADED_PARAMETERS; c++) {
        const int own = c - 2 - 4 * segment;
        for (int i = 0; i < 3; i++) by[c][i] = at->by[c][4 + i];
        for (int i = 0; i < 13; i++) {
            by[c][3 + i] = 0 <= own && own < 4 ? slopes[7 + own][i] : 0;
            for (int k = 0; k < 4; k++) by[c][3 + i] += at->by[c][k] * slopes[k][i];
        }
    }
    for (int i = 0; i < UNLOADED; i++) {
        double *row = J + TRUNK_CONTROLS * i;
        for (int m = 0; m < TRUNK_MUSCLES; m++) {
            row[m] = 0;
            for (int k = 0; k < 4; k++)
                row[m] += muscle_strain[m][k] * by[2 + 4 * muscle_segment[m] + k][i];
        }
        for (int k = 0; k < 2; k++) row[TRUNK_HEAD + k] = by[k][i];
    }
}

/* Outputs of the points on an edge. */
static void unloaded_points(const unloaded_edge *at, int edge, double strain[][4], double *y,
                            double *J)
{
    for (int point = 0; point < TRUNK_POINTS; point++) {
        double w[15] = {0}, value[16], slopes[15][16], *to = y + UNLOADED * point;
        const int segment = edge_segment[point];
        if (trunk_edge[point] != edge) continue;
        for (int i = 0; i < 4; i++) w[i] = at->q[i];
        for (int i = 0; i < 4; i++) w[7 + i] = strain[segment][i];
        report_slopes(w, edge_section[point], value, slopes[0]);
        for (int i = 0; i < 3; i++) to[i] = at->r[i];
        for (int i = 0; i < 13; i++) to[3 + i] = value[i];
        if (J) unloaded_jacobian(at, segment, slopes, J + point * UNLOADED * TRUNK_CONTROLS);
    }
}

int trunk_unloaded(const double controls[TRUNK_CONTROLS],
                   double y[TRUNK_POINTS * TRUNK_UNLOADED_OUTPUTS], double *J)
{
    double strain[TRUNK_SEGMENTS][4], mean, value[TRUNK_POINTS * UNLOADED];
    unloaded_edge at;
    int status = all_finite(controls, TRUNK_CONTROLS) ? TRUNK_OK : TRUNK_NOT_FINITE;
    if (!status) status = set_strain(controls, strain, &mean);
    if (status) return status;
    unloaded_base(controls + TRUNK_HEAD, &at);
    unloaded_points(&at, 0, strain, value, J);
    for (int e = 0; e < TRUNK_ELEMENTS; e++) {
        unloaded_step(&at, e, strain[element_segment[e]], J != NULL);
        unloaded_points(&at, e + 1, strain, value, J);
    }
    if (!all_finite(value, TRUNK_POINTS * UNLOADED)) return TRUNK_NOT_FINITE;
    if (J && !all_finite(J, TRUNK_POINTS * UNLOADED * TRUNK_CONTROLS)) return TRUNK_NOT_FINITE;
    for (int i = 0; i < TRUNK_POINTS * UNLOADED; i++) y[i] = value[i];
    return TRUNK_OK;
}
