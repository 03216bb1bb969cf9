/*
 * Meshes
 * ------
 * Numbers of the trunk at any Z, elements with an edge on every jump, and shapes carried over from
 * one mesh to another.
 */

#define SAME_POINT 1e-9 /* of the length: nearer points share an edge */

typedef struct {
    double contact_from; /* m; NaN without contact */
    double asked;        /* a further point Z with an edge, or NaN */
} trunk_jumps;

static trunk_jumps jumps;
static trunk_work work;

/* Stretched length int dZ / f in m from `start` to Z. */
static double reach(double start, double Z)
{
    const double k = anatomy.taper_rate, f = 1 - k * start;
    return k > 0 ? -log1p(-k * (Z - start) / f) / k : (Z - start) / f;
}

/* f(Z) and stiffness K_0 .. K_3 (eq. 7), component by component with a stride. */
static void set_section(double Z, double *p, int stride)
{
    const double f = 1 - anatomy.taper_rate * Z, R = anatomy.base_radius * f;
    const double area = PI * R * R;
    const double bend = anatomy.youngs_modulus * area * R * R / 4;
    p[0] = f;
    p[stride] = anatomy.youngs_modulus * area;
    p[2 * stride] = p[3 * stride] = bend;
    p[4 * stride] = bend / (1 + anatomy.poisson_ratio);
}

/* Mass in kg beyond Z (eq. 28). */
static double mass_beyond(double Z)
{
    const double L = anatomy.length, a = anatomy.base_radius, rest = L - Z;
    const double b = a * (1 - anatomy.taper_rate * L);
    const double frustum = rest * rest * rest * a * a + rest * rest * (L + 2 * Z) * a * b
                           + (L * L * L - Z * Z * Z) * b * b;
    return PI * anatomy.density / (3 * L * L) * frustum;
}

/* Share of the contact force beyond Z (eq. 15). */
static double contact_share(double Z)
{
    const double L = anatomy.length, from = jumps.contact_from;
    if (isnan(from)) return 0;
    return (L - (Z > from ? Z : from)) / (L - from);
}

/* Segment that contains Z; a boundary belongs to the segment that it ends. */
static int segment_at(double Z)
{
    int s = 0;
    while (s < anatomy.segments - 1 && Z > anatomy.segment_edge[s + 1]) s++;
    return s;
}

/* Whether the equations jump at Z. */
static int is_jump(double Z)
{
    const double near = SAME_POINT * anatomy.length;
    for (int s = 0; s <= anatomy.segments; s++)
        if (fabs(anatomy.segment_edge[s] - Z) <= near) return 1;
    return fabs(jumps.contact_from - Z) <= near || fabs(jumps.asked - Z) <= near;
}

/* Add a number to a sorted list unless it is there. */
static int insert(double *list, int count, double value)
{
    int at = count;
    for (int i = 0; i < count; i++)
        if (fabs(list[i] - value) <= SAME_POINT * anatomy.length) return count;
    for (; at > 0 && list[at - 1] > value; at--) list[at] = list[at - 1];
    list[at] = value;
    return count + 1;
}

/*
 * About `elements` elements, at least one between any two jumps; the others go where elements are
 * longest in local radii, the scale on which a tapered trunk bends.
 */
static void set_edges(int elements)
{
    static double jump[MAX_SEGMENTS + 3];
    static int pieces[MAX_SEGMENTS + 2];
    const double k = anatomy.taper_rate;
    int stretches = 0, total, at = 0;
    for (int s = 0; s <= anatomy.segments; s++)
        stretches = insert(jump, stretches, anatomy.segment_edge[s]);
    if (!isnan(jumps.contact_from)) stretches = insert(jump, stretches, jumps.contact_from);
    if (!isnan(jumps.asked)) stretches = insert(jump, stretches, jumps.asked);
    stretches--;
    for (int i = 0; i < stretches; i++) pieces[i] = 1;
    for (total = stretches; total < elements; total++) {
        int longest = 0;
        for (int i = 1; i < stretches; i++)
            if (reach(0, jump[i + 1]) - reach(0, jump[i])
                > (reach(0, jump[longest + 1]) - reach(0, jump[longest])) * pieces[i]
                      / pieces[longest])
                longest = i;
        pieces[longest]++;
    }
    for (int i = 0; i < stretches; i++) {
        const double first = reach(0, jump[i]), last = reach(0, jump[i + 1]);
        mesh.edge[at++] = jump[i];
        for (int j = 1; j < pieces[i]; j++) {
            const double l = first + (last - first) * j / pieces[i];
            mesh.edge[at++] = k > 0 ? -expm1(-k * l) / k : l;
        }
    }
    mesh.edge[at] = jump[stretches];
    mesh.count = at;
}

/* Parameters of `rod_space_axes.spiral` from start to Z, for short pieces. */
static void set_piece(double start, double Z, double p[4 + MOMENTS])
{
    p[0] = reach(start, Z);
    p[1] = 1 - anatomy.taper_rate * start;
    p[2] = 1 - anatomy.taper_rate * Z;
    p[3] = anatomy.taper_rate;
    clear(p + 4, MOMENTS);
    for (int j = 0; j < NODES; j++) {
        const double l = reach(start, start + (Z - start) * gauss_node[j]);
        double power = (Z - start) * gauss_b[j];
        for (int i = 0; i < MOMENTS; i++, power *= l) p[4 + i] += power;
    }
}

/* The tables of the point that is asked for. */
static void set_point(void)
{
    const double Z = isnan(jumps.asked) ? anatomy.length : jumps.asked;
    int e = 0;
    while (e < mesh.count && mesh.edge[e] < Z - SAME_POINT * anatomy.length) e++;
    trunk_edge[0] = e;
    edge_segment[0] = segment_at(mesh.edge[e]);
    set_section(mesh.edge[e], edge_section[0], 1);
    edge_mass[0] = mass_beyond(mesh.edge[e]);
    edge_share[0] = contact_share(mesh.edge[e]);
}

/* All tables of the mesh. */
static void set_tables(void)
{
    for (int e = 0; e < mesh.count; e++) {
        const double start = mesh.edge[e], middle = (start + mesh.edge[e + 1]) / 2;
        width[e] = mesh.edge[e + 1] - start;
        element_segment[e] = segment_at(middle);
        couple_density[e] =
            middle >= jumps.contact_from ? 1 / (anatomy.length - jumps.contact_from) : 0;
        piece[e][0] = reach(start, mesh.edge[e + 1]);
        for (int j = 0; j < NODES; j++) {
            const double Z = start + width[e] * gauss_node[j];
            set_section(Z, section[e] + j, NODES);
            point_mass[e][j] = mass_beyond(Z);
            point_share[e][j] = contact_share(Z);
            point_reach[e][j] = reach(start, Z);
        }
    }
    set_point();
}

/* The mesh for the unloaded start of a shape. */
static void set_mesh(int elements)
{
    set_edges(elements);
    set_tables();
    trunk_reset(&work);
}

/* Element that contains Z, and the position tau in [0, 1] in it. */
static int locate(const trunk_mesh *in, double Z, double *tau)
{
    int low = 0, high = in->count - 1;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (Z > in->edge[middle + 1]) low = middle + 1;
        else high = middle;
    }
    *tau = (Z - in->edge[low]) / (in->edge[low + 1] - in->edge[low]);
    return low;
}

/* Orientation (4) of a shape at tau in an element. */
static void orientation(const trunk_shape *shape, int e, const double weight[NODES + 1],
                        double q[4])
{
    for (int c = 0; c < 4; c++) {
        q[c] = weight[0] * shape->edge[e][c];
        for (int j = 0; j < NODES; j++) q[c] += weight[j + 1] * shape->q[e][NODES * c + j];
    }
}

/* Directors (9) of an orientation, which need not have length 1. */
static void set_directors(const double q[4], double d[9])
{
    const double anywhere[5] = {1, 1, 1, 1, 1};
    double state[15] = {0}, value[16];
    for (int c = 0; c < 4; c++) state[c] = q[c];
    report_values(state, anywhere, value);
    for (int i = 0; i < 9; i++) d[i] = value[i];
}

/* Carry the shape in the work over from an old mesh. */
static void resample(const trunk_mesh *old)
{
    static trunk_shape from;
    double weight[NODES + 1], q[4], tau;
    from = work.shape;
    for (int e = 0; e <= mesh.count; e++) {
        const int in = locate(old, mesh.edge[e], &tau);
        value_weights(tau, weight);
        orientation(&from, in, weight, work.shape.edge[e]);
        for (int j = 0; j < NODES && e < mesh.count; j++) {
            const int inner = locate(old, mesh.edge[e] + width[e] * gauss_node[j], &tau);
            value_weights(tau, weight);
            orientation(&from, inner, weight, q);
            for (int c = 0; c < 4; c++) work.shape.q[e][NODES * c + j] = q[c];
        }
    }
    work.linear = 0;
    work.responded = 0;
}

/* Halve every element whose defect is above a limit; returns how many, or -1 without room. */
static int halve(double max_defect)
{
    static trunk_mesh old;
    int rough = 0;
    old = mesh;
    for (int e = 0; e < old.count; e++) rough += !(defect(&work, e) <= max_defect);
    if (!rough) return 0;
    if (old.count + 2 * rough > MAX_ELEMENTS) return -1;
    mesh.count = 0;
    for (int e = 0; e < old.count; e++) {
        mesh.edge[mesh.count++] = old.edge[e];
        if (!(defect(&work, e) <= max_defect))
            mesh.edge[mesh.count++] = (old.edge[e] + old.edge[e + 1]) / 2;
    }
    mesh.edge[mesh.count] = anatomy.length;
    set_tables();
    resample(&old);
    return rough;
}
