/*
 * The Gauss method (`rod.collocation`), made here so that the source is the same on every machine.
 */

/* One over the product of a point's gaps to all others: factors of the Lagrange basis. */
static void set_scale(const double *point, int count, double *scale)
{
    for (int i = 0; i < count; i++) {
        double gaps = 1;
        for (int j = 0; j < count; j++)
            if (j != i) gaps *= point[i] - point[j];
        scale[i] = 1 / gaps;
    }
}

/* Weights of the Lagrange basis at tau. */
static void lagrange(const double *point, const double *scale, int count, double tau,
                     double *weight)
{
    for (int i = 0; i < count; i++) {
        weight[i] = scale[i];
        for (int j = 0; j < count; j++)
            if (j != i) weight[i] *= tau - point[j];
    }
}

/* Weights of the values at an element's left edge and Gauss points for the value at tau. */
static void value_weights(double tau, double weight[NODES + 1])
{
    lagrange(value_node, value_scale, NODES + 1, tau, weight);
}

/* Weights of rates at Gauss points for their integral from 0 to tau. */
static void integral_weights(double tau, double weight[NODES])
{
    double part[NODES];
    clear(weight, NODES);
    for (int k = 0; k < NODES; k++) {
        lagrange(gauss_node, gauss_scale, NODES, tau * gauss_node[k], part);
        for (int j = 0; j < NODES; j++) weight[j] += tau * gauss_b[k] * part[j];
    }
}

/* Legendre's polynomial at x in [-1, 1], and its derivative. */
static double legendre(double x, double *slope)
{
    double before = 1, now = x;
    for (int n = 1; n < NODES; n++) {
        const double next = ((2 * n + 1) * x * now - n * before) / (n + 1);
        before = now;
        now = next;
    }
    *slope = NODES * (x * now - before) / (x * x - 1);
    return now;
}

static void set_gauss(void)
{
    for (int j = 0; j < NODES; j++) {
        double x = -cos(PI * (j + 0.75) / (NODES + 0.5)), slope;
        for (int i = 0; i < 10; i++) {
            const double value = legendre(x, &slope);
            x -= value / slope;
        }
        legendre(x, &slope);
        gauss_node[j] = value_node[j + 1] = (1 + x) / 2;
        gauss_b[j] = 1 / ((1 - x * x) * slope * slope);
    }
    set_scale(gauss_node, NODES, gauss_scale);
    set_scale(value_node, NODES + 1, value_scale);
    clear(gauss_end, NODES);
    for (int j = 0; j < NODES; j++) {
        double weight[NODES];
        integral_weights(gauss_node[j], weight);
        for (int k = 0; k < NODES; k++) gauss_A[k][j] = weight[k];
        /* Derivatives at node j: of a basis that vanishes at 0, and of constants none in all. */
        gauss_sum[j] = 0;
        for (int k = 0; k < NODES; k++) {
            double sum = 1 / gauss_node[j]; /* its derivative at its own node */
            for (int i = 0; i < NODES; i++)
                if (k == j && i != j) sum += 1 / (gauss_node[j] - gauss_node[i]);
            gauss_D[k][j] = k == j ? sum
                                   : value_scale[k + 1] / value_scale[j + 1]
                                         / (gauss_node[j] - gauss_node[k]);
            gauss_sum[j] += gauss_D[k][j];
        }
    }
    for (int k = 0; k < NODES; k++)
        for (int j = 0; j < NODES; j++) gauss_end[k] += gauss_b[j] * gauss_D[k][j];
}
