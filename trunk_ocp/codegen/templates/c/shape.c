/* Largest | |q|^2 - 1 | at the Gauss points of a resolved shape. Shapes below it were within 8e-7
 * of those on a mesh four times as fine, whatever the load; above it, some are plainly wrong. */
#define MAX_DEFECT 1e-5

/* State at an element's edge, as w of `report`. */
static void edge_state(const trunk_work *work, int point, double w[15])
{
    const int e = trunk_edge[point];
    const double *strain = work->strain[edge_segment[point]];
    for (int i = 0; i < 4; i++) w[i] = work->shape.edge[e][i];
    for (int i = 0; i < 3; i++) w[4 + i] = work->shape.moment[e][i];
    for (int i = 0; i < 4; i++) w[7 + i] = strain[i];
    w[11] = work->mean;
    section_force(work->load, edge_mass[point], edge_share[point], w + 12);
}

/* Outputs of the shape in the work; also updates M at the edges. */
static void describe(trunk_work *work, double *y)
{
    double base[7], position[TRUNK_ELEMENTS + 1][3];
    base_values(work->head, head_numbers, base);
    for (int i = 0; i < 3; i++) position[0][i] = base[4 + i];
    for (int e = 0; e < TRUNK_ELEMENTS; e++) {
        double w[18 * NODES], rate[6 * NODES], unused[NODES];
        gather(work, e, w);
        force_rates(w, section[e], rate);
        set_moments(work, e, rate, w);
        for (int i = 0; i < 3; i++)
            position[e + 1][i] =
                integrate(position[e][i], width[e], rate + NODES * (3 + i), unused);
    }
    for (int point = 0; point < TRUNK_POINTS; point++) {
        double w[15], *to = y + TRUNK_OUTPUTS * point;
        edge_state(work, point, w);
        for (int i = 0; i < 3; i++) to[i] = position[trunk_edge[point]][i];
        report_values(w, edge_section[point], to + 3);
    }
}

/* Set the unloaded shape, with M = 0 at the base, as start of Newton's method. */
static void set_unloaded(trunk_work *work)
{
    double w[8], end[7];
    trunk_shape *shape = &work->shape;
    clear(shape->moment[0], 3);
    base_values(work->head, head_numbers, end);
    for (int e = 0; e < TRUNK_ELEMENTS; e++) {
        for (int i = 0; i < 4; i++) w[i] = shape->edge[e][i] = end[i];
        for (int i = 0; i < 4; i++) w[4 + i] = work->strain[element_segment[e]][i];
        for (int j = 0; j < NODES; j++) {
            turned_values(w, &point_reach[e][j], end);
            for (int i = 0; i < 4; i++) shape->q[e][NODES * i + j] = end[i];
        }
        turned_values(w, piece[e], end); /* its first number is the element's whole length */
    }
    for (int i = 0; i < 4; i++) shape->edge[TRUNK_ELEMENTS][i] = end[i];
}

/* Raise the loads from zero to those of x in steps; returns whether the shape was found. */
static int raise_loads(trunk_work *work, const double *x)
{
    double reached = 0, ahead = 0.25;
    trunk_shape last;
    set_unloaded(work);
    last = work->shape;
    while (reached < 1) {
        const double target = reached + ahead < 1 ? reached + ahead : 1;
        set_loads(work, x, target);
        work->linear = 0;
        if (newton(work)) {
            last = work->shape;
            reached = target;
            ahead *= 2;
        } else {
            work->shape = last;
            ahead /= 2;
            if (ahead < MIN_LOAD_STEP) return 0;
        }
    }
    return 1;
}

/*
 * How well an element resolves the shape in the work: its largest | |q|^2 - 1 |. Gauss collocation
 * keeps |q| = 1 at the edges on any mesh, but at the Gauss points only if it resolves the bend.
 */
static double defect(const trunk_work *work, int e)
{
    double found = 0;
    for (int j = 0; j < NODES; j++) {
        double norm = 0;
        for (int c = 0; c < 4; c++) norm += square(work->shape.q[e][NODES * c + j]);
        norm -= 1;
        found = largest(found, &norm, 1);
    }
    return found;
}

/* Whether the mesh resolves the shape in the work. */
static int resolved(const trunk_work *work)
{
    for (int e = 0; e < TRUNK_ELEMENTS; e++)
        if (!(defect(work, e) <= MAX_DEFECT)) return 0;
    return 1;
}

/* Find the equilibrium under the inputs x; returns a status. */
static int find(trunk_work *work, const double *x)
{
    work->steps_left = TRUNK_MAX_STEPS;
    set_loads(work, x, 1);
    if (work->found && newton(work) && resolved(work)) return TRUNK_OK;
    work->linear = 0;
    set_unloaded(work);
    if (!newton(work) && !raise_loads(work, x)) return TRUNK_NOT_FOUND;
    return resolved(work) ? TRUNK_OK : TRUNK_COARSE;
}

void trunk_reset(trunk_work *work)
{
    work->found = 0;
    work->linear = 0;
    work->responded = 0;
}

size_t trunk_work_size(void) { return sizeof(trunk_work); }

const char *trunk_message(int status)
{
    switch (status) {
    case TRUNK_OK: return "an equilibrium was found";
    case TRUNK_NOT_FOUND:
        return "no equilibrium found: the trunk may buckle or coil; reduce loads or activations";
    case TRUNK_COLLAPSED: return "the activations shorten a segment to zero length";
    case TRUNK_NOT_FINITE:
        return "an input or a result is infinite or NaN";
    case TRUNK_COARSE:
        return "the shape bends too sharply for this mesh; reduce the load or the activation, or "
               "export with a finer mesh";
    default: return "unknown status";
    }
}

int trunk_loaded(const double x[TRUNK_INPUTS], trunk_work *work,
                 double y[TRUNK_POINTS * TRUNK_OUTPUTS])
{
    double value[TRUNK_POINTS * TRUNK_OUTPUTS];
    int status = all_finite(x, TRUNK_INPUTS) ? TRUNK_OK : TRUNK_NOT_FINITE;
    if (!status) status = set_strain(x, work->strain, &work->mean);
    if (!status) {
        work->responded = 0;
        for (int i = 0; i < 2; i++) work->head[i] = x[TRUNK_HEAD + i];
        status = find(work, x);
    }
    if (!status) {
        describe(work, value);
        if (!all_finite(value, TRUNK_POINTS * TRUNK_OUTPUTS)) status = TRUNK_NOT_FINITE;
    }
    if (status) {
        trunk_reset(work);
        return status;
    }
    work->found = 1;
    for (int i = 0; i < TRUNK_POINTS * TRUNK_OUTPUTS; i++) y[i] = value[i];
    return TRUNK_OK;
}
