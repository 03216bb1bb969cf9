/*
 * The numbers of a trunk as data: the module gets its anatomy when it runs, and makes the tables
 * that an export has as constants. The header above declared arrays with room for any anatomy;
 * from here on the sizes are those of the trunk and mesh at hand.
 */

enum {
    MAX_SEGMENTS = TRUNK_SEGMENTS,
    MAX_MUSCLES = TRUNK_MUSCLES,
    MAX_ELEMENTS = TRUNK_ELEMENTS,
    MAX_DRAWN = 512, /* points Z that a shape is reported at */
    MAX_EDGES = MAX_ELEMENTS + 1
};

#define PI 3.14159265358979323846

typedef struct {
    int count;               /* elements */
    double edge[MAX_EDGES];  /* m */
} trunk_mesh;

static struct {
    int muscles, segments, drawn;
    double length, base_radius, taper_rate, youngs_modulus, poisson_ratio, density;
    double head[4]; /* pivot_radius in m; xi_z, xi_y, xi_d in rad */
    double segment_edge[MAX_SEGMENTS + 1], Z[MAX_DRAWN];
} anatomy;

static trunk_mesh mesh;

#undef TRUNK_SEGMENTS
#undef TRUNK_MUSCLES
#undef TRUNK_ELEMENTS
#undef TRUNK_CONTROLS
#undef TRUNK_INPUTS
#define TRUNK_SEGMENTS anatomy.segments
#define TRUNK_MUSCLES anatomy.muscles
#define TRUNK_ELEMENTS mesh.count
#define TRUNK_CONTROLS (anatomy.muscles + 2)
#define TRUNK_INPUTS (anatomy.muscles + 2 + TRUNK_LOADS)
#define TRUNK_HEAD anatomy.muscles
#define TRUNK_GRAVITY (anatomy.muscles + 2)

#define head_numbers anatomy.head
static double small_moment;
static double fraction[MAX_SEGMENTS];
static int muscle_segment[MAX_MUSCLES];
static double muscle_strain[MAX_MUSCLES][4];

static int element_segment[MAX_ELEMENTS];
static double width[MAX_ELEMENTS];
static double section[MAX_ELEMENTS][5 * TRUNK_NODES];
static double point_mass[MAX_ELEMENTS][TRUNK_NODES];
static double point_share[MAX_ELEMENTS][TRUNK_NODES];
static double point_reach[MAX_ELEMENTS][TRUNK_NODES];
static double couple_density[MAX_ELEMENTS];
static double piece[MAX_ELEMENTS][1]; /* its stretched length */

/* The one point whose derivatives are asked for: on an edge, like all points of an export. */
static int trunk_edge[1], edge_segment[1];
static double edge_section[1][5], edge_mass[1], edge_share[1];

/* The Gauss method: columns of A and of its inverse D, as in exports; and Lagrange bases. */
static double gauss_A[TRUNK_NODES][TRUNK_NODES], gauss_D[TRUNK_NODES][TRUNK_NODES];
static double gauss_b[TRUNK_NODES], gauss_end[TRUNK_NODES], gauss_sum[TRUNK_NODES];
static double gauss_node[TRUNK_NODES], gauss_scale[TRUNK_NODES];
static double value_node[TRUNK_NODES + 1], value_scale[TRUNK_NODES + 1];
