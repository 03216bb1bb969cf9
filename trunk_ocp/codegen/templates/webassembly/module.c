/*
 * What JavaScript calls; see viewer/physics.js
 * --------------------------------------------
 * One trunk, and the last shape found for it. Numbers are exchanged through fixed places in memory.
 */

#define EXPORT(name) __attribute__((export_name(#name)))

static double given[16 + MAX_SEGMENTS + 1 + MAX_DRAWN + 5 * MAX_MUSCLES];

/* The last shape, as reported. */
static struct {
    double position[MAX_DRAWN][3], directors[MAX_DRAWN][9], strain[MAX_DRAWN];
    double unloaded_position[MAX_DRAWN][3], unloaded_directors[MAX_DRAWN][9];
    double base_moment[3], point[3], scale;
} told;

/*
 * The last shape, to start another one from: jumps, number of elements, M(0), edges with their q,
 * and q at Gauss points.
 */
static double kept[6 + MAX_EDGES * (1 + 4) + MAX_ELEMENTS * TRUNK_Q];

static double slopes_by_input[TRUNK_OUTPUTS * (MAX_MUSCLES + 2 + TRUNK_LOADS)];

EXPORT(given) double *given_place(void) { return given; }
EXPORT(input) double *input_place(void) { return input; }
EXPORT(kept) double *kept_place(void) { return kept; }
EXPORT(position) double *position_place(void) { return told.position[0]; }
EXPORT(directors) double *directors_place(void) { return told.directors[0]; }
EXPORT(strain) double *strain_place(void) { return told.strain; }
EXPORT(unloaded_position) double *unloaded_position_place(void)
{
    return told.unloaded_position[0];
}
EXPORT(unloaded_directors) double *unloaded_directors_place(void)
{
    return told.unloaded_directors[0];
}
EXPORT(base_moment) double *base_moment_place(void) { return told.base_moment; }
EXPORT(point) double *point_place(void) { return told.point; }
EXPORT(slopes) double *slopes_place(void) { return slopes_by_input; }

/* Take the anatomy from `given`: numbers, edges of segments, Z, muscles; 1 if it is too large. */
EXPORT(set_anatomy) int set_anatomy(int muscles, int segments, int drawn)
{
    const double *next = given;
    double p[5];
    if (muscles > MAX_MUSCLES || segments > MAX_SEGMENTS || drawn > MAX_DRAWN) return 1;
    anatomy.muscles = muscles;
    anatomy.segments = segments;
    anatomy.drawn = drawn;
    anatomy.length = *next++;
    anatomy.base_radius = *next++;
    anatomy.taper_rate = *next++;
    anatomy.youngs_modulus = *next++;
    anatomy.poisson_ratio = *next++;
    anatomy.density = *next++;
    for (int i = 0; i < 4; i++) anatomy.head[i] = *next++;
    for (int s = 0; s <= segments; s++) anatomy.segment_edge[s] = *next++;
    for (int i = 0; i < drawn; i++) anatomy.Z[i] = *next++;
    for (int m = 0; m < muscles; m++) {
        muscle_segment[m] = (int)*next++;
        for (int i = 0; i < 4; i++) muscle_strain[m][i] = *next++;
    }
    for (int s = 0; s < segments; s++)
        fraction[s] =
            (anatomy.segment_edge[s + 1] - anatomy.segment_edge[s]) / anatomy.length;
    set_section(0, p, 1);
    small_moment = 1e-3 * p[2] / anatomy.length;
    jumps.contact_from = jumps.asked = NAN;
    set_gauss();
    set_mesh(FIRST_ELEMENTS);
    return 0;
}

/* Where the equations jump; a shape in the work is carried over to a mesh with these edges. */
static void set_jumps(double contact_from, double asked)
{
    static trunk_mesh old;
    const trunk_jumps wanted = {contact_from, asked};
    const int same_contact = contact_from == jumps.contact_from
                             || (isnan(contact_from) && isnan(jumps.contact_from));
    const int same_point = isnan(asked) || asked == jumps.asked;
    if (same_contact && same_point) return;
    old = mesh;
    jumps = wanted;
    set_edges(FIRST_ELEMENTS);
    set_tables();
    if (work.found) resample(&old);
}

/* Equilibrium under `input`: from the last shape, or from the unloaded one; returns a status. */
EXPORT(solve) int solve(double contact_from, double asked, int warm_only)
{
    int status = all_finite(input, TRUNK_INPUTS) ? TRUNK_OK : TRUNK_NOT_FINITE;
    if (!status) status = set_strain(input, work.strain, &work.mean);
    if (status) {
        trunk_reset(&work);
        return status;
    }
    set_jumps(contact_from, asked);
    work.head[0] = input[TRUNK_HEAD];
    work.head[1] = input[TRUNK_HEAD + 1];
    work.responded = 0;
    status = work.found ? find_warm() : TRUNK_NOT_FOUND;
    if (status && !warm_only) status = find_cold();
    if (status) trunk_reset(&work);
    else work.found = 1;
    return status;
}

/* Positions at the element edges, M there, and rates at the Gauss points. */
static double at_edge[MAX_EDGES][3], rate_at[MAX_ELEMENTS][6 * TRUNK_NODES];

static void integrate_shape(void)
{
    double base[7], volume = 0, stretched = 0;
    base_values(work.head, head_numbers, base);
    for (int i = 0; i < 3; i++) at_edge[0][i] = base[4 + i];
    for (int e = 0; e < mesh.count; e++) {
        double w[18 * NODES], unused[NODES], *rate = rate_at[e];
        gather(&work, e, w);
        force_rates(w, section[e], rate);
        set_moments(&work, e, rate, w);
        for (int i = 0; i < 3; i++)
            at_edge[e + 1][i] =
                integrate(at_edge[e][i], width[e], rate + NODES * (3 + i), unused);
        for (int j = 0; j < NODES; j++) {
            const double weight = width[e] * gauss_b[j] * square(section[e][j]);
            double stretch = 0;
            for (int i = 0; i < 3; i++) stretch += square(rate[NODES * (3 + i) + j]);
            volume += weight;
            stretched += weight * sqrt(stretch);
        }
    }
    told.scale = sqrt(volume / stretched);
}

/* State at Z as w of `report`, and the position there. */
static void state_at(double Z, double w[15], double r[3])
{
    double tau, value[NODES + 1], integral[NODES];
    const int e = locate(&mesh, Z, &tau);
    value_weights(tau, value);
    integral_weights(tau, integral);
    orientation(&work.shape, e, value, w);
    for (int i = 0; i < 3; i++) {
        const double *dM = rate_at[e] + NODES * i, *dr = rate_at[e] + NODES * (3 + i);
        w[4 + i] = work.shape.moment[e][i];
        r[i] = at_edge[e][i];
        for (int j = 0; j < NODES; j++) {
            w[4 + i] += width[e] * integral[j] * dM[j];
            r[i] += width[e] * integral[j] * dr[j];
        }
    }
    for (int i = 0; i < 4; i++) w[7 + i] = work.strain[element_segment[e]][i];
    w[11] = work.mean;
    section_force(work.load, mass_beyond(Z), contact_share(Z), w + 12);
}

/* Report the last shape, unless it was not found. */
EXPORT(describe) void describe_shape(void)
{
    double w[15], r[3], p[5], value[16];
    if (!work.found) return;
    integrate_shape();
    for (int i = 0; i < anatomy.drawn; i++) {
        state_at(anatomy.Z[i], w, told.position[i]);
        set_section(anatomy.Z[i], p, 1);
        report_values(w, p, value);
        for (int k = 0; k < 9; k++) told.directors[i][k] = value[k];
        told.strain[i] = value[9];
    }
    state_at(0, w, r);
    set_section(0, p, 1);
    report_values(w, p, value);
    for (int i = 0; i < 3; i++) told.base_moment[i] = value[13 + i];
}

EXPORT(scale) double scale_of_sections(void) { return told.scale; }
EXPORT(stable) int stable(void) { return work.found && is_stable(); }
/* Of the last shape, once `stable` has found it so. */
EXPORT(margin) double margin_of_shape(void) { return buckling_margin(); }

/* Position of the point that was asked for, and its derivatives by all inputs; a status. */
EXPORT(differentiate) int differentiate(void)
{
    if (!work.found) return TRUNK_NOT_FOUND;
    integrate_shape();
    for (int i = 0; i < 3; i++) told.point[i] = at_edge[trunk_edge[0]][i];
    return trunk_jacobian(&work, slopes_by_input);
}

/* Move the pose of an unloaded section, q (4) and r (3), along a segment from one Z to another. */
static void step_unloaded(double pose[7], const double strain[4], double from, double to)
{
    double w[8], p[4 + MOMENTS], end[7];
    for (int i = 0; i < 4; i++) w[i] = pose[i];
    for (int i = 0; i < 4; i++) w[4 + i] = strain[i];
    set_piece(from, to, p);
    stepped_values(w, p, end);
    for (int i = 0; i < 4; i++) pose[i] = end[i];
    for (int i = 0; i < 3; i++) pose[4 + i] += end[4 + i];
}

/* Shape without loads at the activations and head angles of `input`; returns a status. */
EXPORT(unloaded) int unloaded_shape(void)
{
    double strain[MAX_SEGMENTS][4], mean, pose[7], at = 0;
    int status = all_finite(input, TRUNK_CONTROLS) ? TRUNK_OK : TRUNK_NOT_FINITE, i = 0;
    if (!status) status = set_strain(input, strain, &mean);
    if (status) return status;
    base_values(input + TRUNK_HEAD, head_numbers, pose);
    for (int s = 0; s < anatomy.segments; s++) {
        const double end = anatomy.segment_edge[s + 1];
        for (; i < anatomy.drawn && anatomy.Z[i] <= end; i++) {
            if (anatomy.Z[i] > at) step_unloaded(pose, strain[s], at, anatomy.Z[i]);
            at = anatomy.Z[i];
            set_directors(pose, told.unloaded_directors[i]);
            for (int k = 0; k < 3; k++) told.unloaded_position[i][k] = pose[4 + k];
        }
        if (end > at) step_unloaded(pose, strain[s], at, end);
        at = end;
    }
    return TRUNK_OK;
}

/* Write the last shape to `kept`; returns how many numbers. */
EXPORT(keep) int keep(void)
{
    double *to = kept;
    if (!work.found) return 0;
    *to++ = jumps.contact_from;
    *to++ = jumps.asked;
    *to++ = mesh.count;
    for (int i = 0; i < 3; i++) *to++ = work.shape.moment[0][i];
    for (int e = 0; e <= mesh.count; e++) {
        *to++ = mesh.edge[e];
        for (int c = 0; c < 4; c++) *to++ = work.shape.edge[e][c];
    }
    for (int e = 0; e < mesh.count; e++)
        for (int i = 0; i < TRUNK_Q; i++) *to++ = work.shape.q[e][i];
    return (int)(to - kept);
}

/* Take the shape in `kept` as the last one. */
EXPORT(restart) void restart(void)
{
    const double *from = kept;
    jumps.contact_from = *from++;
    jumps.asked = *from++;
    mesh.count = (int)*from++;
    for (int i = 0; i < 3; i++) work.shape.moment[0][i] = *from++;
    for (int e = 0; e <= mesh.count; e++) {
        mesh.edge[e] = *from++;
        for (int c = 0; c < 4; c++) work.shape.edge[e][c] = *from++;
    }
    for (int e = 0; e < mesh.count; e++)
        for (int i = 0; i < TRUNK_Q; i++) work.shape.q[e][i] = *from++;
    set_tables();
    trunk_reset(&work);
    work.found = 1;
}

/* Forget the last shape. */
EXPORT(forget) void forget(void) { trunk_reset(&work); }
