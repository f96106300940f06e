/* Units of contact in a step of the interior point method on face forces: springs, and matrices.

   A unit carries m forces, m = 2 or 3 (faces/model.py). Arrays hold units row by row. What is asked
   of a unit is short: numpy would pass over memory once for each of its operations. Where there is
   no compiler faces/system.py has the same in numpy. */

/* a x b for m = 3; (-b, a) for m = 2, where there is one vector. */
static inline void across(int m, const double *u, const double *v, double *out)
{
    if (m == 2) {
        out[0] = -u[1];
        out[1] = u[0];
    } else {
        out[0] = u[1] * v[2] - u[2] * v[1];
        out[1] = u[2] * v[0] - u[0] * v[2];
        out[2] = u[0] * v[1] - u[1] * v[0];
    }
}

static inline double dot(int m, const double *u, const double *v)
{
    double sum = u[0] * v[0];
    for (int i = 1; i < m; i++)
        sum += u[i] * v[i];
    return sum;
}

/* One choice of m - 1 vectors, the last of which is number `last`, with the product w of their
   weights: its parts of adj M, and of det M with each vector that comes after them. */
static inline double chosen(int m, int k, int last, double w, const double *a, const double *b,
                            const double *left, const double *right, const double *weights,
                            double *adjugate)
{
    double det = 0.0;
    for (int p = 0; p < m; p++)
        for (int q = 0; q < m; q++)
            adjugate[m * p + q] += w * a[p] * b[q];
    for (int t = last + 1; t < k; t++)
        det += weights[t] * dot(m, a, right + m * t) * dot(m, b, left + m * t);
    return w * det;
}

static inline void spring(int m, int k, int same, const double *left, const double *right,
                          const double *weights, double *inverse)
{
    double adjugate[9] = {0.0}, det = 0.0, a[3], b[3];
    for (int i = 0; i < k; i++)
        for (int j = m == 2 ? k - 1 : i + 1; j < k; j++) {
            double w = m == 2 ? weights[i] : weights[i] * weights[j];
            across(m, right + m * i, right + m * j, a);
            if (!same)
                across(m, left + m * i, left + m * j, b);
            det += chosen(m, k, m == 2 ? i : j, w, a, same ? a : b, left, right, weights, adjugate);
        }
    for (int p = 0; p < m * m; p++)
        inverse[p] = adjugate[p] / det;
}

/* M^-1 of every unit, M = sum_k w_k l_k r_k^T, by choices of vectors (faces/system.py). */
void unit_springs(int units, int m, int k, const double *left, const double *right,
                  const double *weights, double *inverse)
{
    int same = left == right;
    for (int u = 0; u < units; u++) {
        long at = (long)u * k;
        const double *l = left + at * m, *r = right + at * m;
        double *out = inverse + (long)u * m * m;
        if (m == 3)
            spring(3, k, same, l, r, weights + at, out);
        else
            spring(2, k, same, l, r, weights + at, out);
    }
}

/* H^T M^-1 H of every unit, added to entries of A at their places; -1 where there is none. */
void unit_matrices(int units, int m, int width, const double *local, const double *inverse,
                   const int *place, double *entries)
{
    for (int u = 0; u < units; u++) {
        const double *h = local + (long)u * m * width, *n = inverse + (long)u * m * m;
        const int *to = place + (long)u * width * width;
        for (int c = 0; c < width; c++) {
            double moved[3];
            for (int p = 0; p < m; p++) {
                moved[p] = n[m * p] * h[c];
                for (int q = 1; q < m; q++)
                    moved[p] += n[m * p + q] * h[width * q + c];
            }
            for (int r = 0; r < width; r++)
                if (to[width * r + c] >= 0) {
                    double sum = h[r] * moved[0];
                    for (int p = 1; p < m; p++)
                        sum += h[width * p + r] * moved[p];
                    entries[to[width * r + c]] += sum;
                }
        }
    }
}
