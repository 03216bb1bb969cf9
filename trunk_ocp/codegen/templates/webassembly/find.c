/*
 * The equilibrium, on a mesh that resolves it
 * -------------------------------------------
 * As `solve_statics`: Newton's method from the unloaded shape, on finer meshes if the shape is too
 * sharp; where it does not get there, the loads are raised in steps.
 */

#define FIRST_ELEMENTS 8
#define LAST_ELEMENTS 64
#define FINE_DEFECT 2e-10    /* of a finished shape; its positions are within 1e-9 of the length */
#define MAX_WORK 800         /* elements, summed over all tries while loads are raised */
#define NEWTON_STEPS 30      /* of one try */
#define TOO_FINE_DEFECT 1e-14 /* of two elements that are joined: that takes a factor of 512 */

/* Statuses of the module besides those of an export. */
enum { COMPRESSED = TRUNK_COARSE + 1, OUT_OF_WORK };

static double input[MAX_MUSCLES + 2 + TRUNK_LOADS];

/* Whether the loads leave nothing of the length somewhere: zeta <= 0 at a Gauss point or edge. */
static int compressed(void)
{
    double w[18 * NODES], rate[6 * NODES], zeta[NODES], weight[NODES];
    for (int e = 0; e < mesh.count; e++) {
        gather(&work, e, w);
        force_rates(w, section[e], rate);
        for (int j = 0; j < NODES; j++) {
            const double q[4] = {w[j], w[NODES + j], w[2 * NODES + j], w[3 * NODES + j]};
            double d[9];
            set_directors(q, d);
            zeta[j] = 0; /* but for |q|^2, from the rate */
            for (int i = 0; i < 3; i++) zeta[j] += d[6 + i] * rate[NODES * (3 + i) + j];
            if (!(zeta[j] > 0)) return 1;
        }
        for (int end = 0; end < 2; end++) {
            double at = 0;
            lagrange(gauss_node, gauss_scale, NODES, end, weight);
            for (int j = 0; j < NODES; j++) at += weight[j] * zeta[j];
            if (!(at > 0)) return 1;
        }
    }
    return 0;
}

/* Newton's method from the shape in the work, under a share of the loads; returns a status. */
static int converge(double share)
{
    set_loads(&work, input, share);
    work.steps_left = NEWTON_STEPS;
    if (!newton(&work)) return TRUNK_NOT_FOUND;
    return compressed() ? COMPRESSED : TRUNK_OK;
}

/* The same, with elements halved until all resolve the shape; returns a status. */
static int settle(double share, double max_defect)
{
    for (;;) {
        const int status = converge(share);
        const int halved = status ? 0 : halve(max_defect);
        if (halved < 0) return max_defect < MAX_DEFECT && resolved(&work) ? TRUNK_OK : TRUNK_COARSE;
        if (!halved) return status;
    }
}

/* Join halves that a warm shape no longer needs, if they are many: a join costs a linearization. */
static void join(void)
{
    static trunk_mesh old;
    int joined = 0;
    if (mesh.count <= 2 * FIRST_ELEMENTS) return;
    old = mesh;
    mesh.count = 0;
    for (int e = 0; e < old.count; e++) {
        const double w = old.edge[e + 1] - old.edge[e];
        const int alike = e + 1 < old.count && fabs(width[e + 1] - w) < 1e-6 * w
                          && !is_jump(old.edge[e + 1]) && defect(&work, e) < TOO_FINE_DEFECT
                          && defect(&work, e + 1) < TOO_FINE_DEFECT;
        mesh.edge[mesh.count++] = old.edge[e];
        joined += alike;
        e += alike;
    }
    mesh.edge[mesh.count] = anatomy.length;
    if (4 * joined < old.count) {
        mesh = old;
        return;
    }
    set_tables();
    resample(&old);
}

/* Raise the loads from zero in steps; returns a status. */
static int raise_gradually(void)
{
    static trunk_shape last;
    static trunk_mesh last_mesh;
    double reached = 0, ahead = 0.25;
    int spent = 0;
    set_unloaded(&work);
    last = work.shape;
    last_mesh = mesh;
    while (reached < 1) {
        const double target = reached + ahead < 1 ? reached + ahead : 1;
        int status;
        spent += mesh.count;
        work.linear = 0;
        status = settle(target, MAX_DEFECT);
        if (!status) {
            last = work.shape;
            last_mesh = mesh;
            reached = target;
            ahead *= 2;
            continue;
        }
        mesh = last_mesh;
        set_tables();
        work.shape = last;
        ahead /= status == TRUNK_COARSE ? 8 : 2;
        if (ahead < MIN_LOAD_STEP) return status;
        if (spent > MAX_WORK) return status == TRUNK_NOT_FOUND ? OUT_OF_WORK : status;
    }
    return TRUNK_OK;
}

/* From the unloaded shape; returns a status. */
static int find_cold(void)
{
    int status = TRUNK_NOT_FOUND;
    for (int elements = FIRST_ELEMENTS; elements <= LAST_ELEMENTS; elements *= 2) {
        set_mesh(elements);
        set_unloaded(&work);
        if (converge(1)) break;
        if (resolved(&work)) {
            status = TRUNK_OK;
            break;
        }
    }
    if (status) status = raise_gradually();
    return status ? status : settle(1, FINE_DEFECT);
}

/* From the shape in the work; returns a status. */
static int find_warm(void)
{
    join();
    return settle(1, FINE_DEFECT);
}
