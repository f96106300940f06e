/* Units of contact in a step of the interior point method on face forces: springs, and matrices.

   A unit carries m forces, m = 2 or 3 (faces/model.py). Arrays hold units row by row. What is asked
   of a unit is short: numpy would pass over memory once for each of its operations. Where there is
   no compiler faces/system.py has the same in numpy. */

#include <math.h>

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
        double moved[m * width], sums[width];
        for (int p = 0; p < m; p++)
            for (int c = 0; c < width; c++) {
                double sum = n[m * p] * h[c];
                for (int q = 1; q < m; q++)
                    sum += n[m * p + q] * h[width * q + c];
                moved[width * p + c] = sum;
            }
        for (int r = 0; r < width; r++, to += width) {
            for (int c = 0; c < width; c++)
                sums[c] = h[r] * moved[c];
            for (int p = 1; p < m; p++)
                for (int c = 0; c < width; c++)
                    sums[c] += h[width * p + r] * moved[width * p + c];
            for (int c = 0; c < width; c++)
                if (to[c] >= 0)
                    entries[to[c]] += sums[c];
        }
    }
}

/* Products of small matrices of the shape (rows, columns) with vectors, or of their transposes. */
void unit_products(int units, int rows, int columns, int transposed, const double *matrix,
                   const double *vector, double *out)
{
    for (int u = 0; u < units; u++) {
        const double *a = matrix + (long)u * rows * columns;
        const double *v = vector + (long)u * (transposed ? rows : columns);
        double *x = out + (long)u * (transposed ? columns : rows);
        if (transposed)
            for (int c = 0; c < columns; c++) {
                x[c] = a[c] * v[0];
                for (int r = 1; r < rows; r++)
                    x[c] += a[columns * r + c] * v[r];
            }
        else
            for (int r = 0; r < rows; r++)
                x[r] = dot(columns, a + columns * r, v);
    }
}

/* ---- cones s_0 > |(s_1, s_2)| and their scaling, the formulas of faces/cones.py */

#define TINY 1e-300

static inline double determinant(const double *v)
{
    double size = sqrt(v[1] * v[1] + v[2] * v[2]);
    double found = (v[0] - size) * (v[0] + size);
    return found < TINY ? TINY : found;
}

/* W v for the sign 1, W^-1 v for -1; the scaling's eta comes after its point. */
static inline void applied(const double *w, double sign, const double *v, double *out)
{
    double along = w[1] * v[1] + w[2] * v[2], eta = sign > 0.0 ? w[3] : 1.0 / w[3];
    double part = along / (1.0 + w[0]) + sign * v[0], first = w[0] * v[0] + sign * along;
    out[1] = (v[1] + part * w[1]) * eta;
    out[2] = (v[2] + part * w[2]) * eta;
    out[0] = first * eta;
}

static inline void jordan(const double *v, const double *w, double *out)
{
    double first = dot(3, v, w), a = v[0], b = w[0];
    out[1] = a * w[1] + b * v[1];
    out[2] = a * w[2] + b * v[2];
    out[0] = first;
}

/* Point and eta of the scaling, l = W z, and weights and vectors of the squares of W^-2. */
void disc_scaled(int units, const double *slack, const double *dual, double *scaling,
                 double *value, double *weights, double *frame)
{
    const double half = sqrt(0.5);
    for (int u = 0; u < units; u++) {
        const double *s = slack + 3L * u, *z = dual + 3L * u;
        double *w = scaling + 4L * u, *h = weights + 3L * u, *f = frame + 9L * u;
        double size = sqrt(determinant(s)), other = sqrt(determinant(z)), sharp, large, eta2;
        double unit[3], mirrored[3], dots;
        for (int i = 0; i < 3; i++) {
            unit[i] = s[i] / size;
            mirrored[i] = (i ? -z[i] : z[i]) / other;
        }
        dots = unit[0] * mirrored[0] - unit[1] * mirrored[1] - unit[2] * mirrored[2];
        sharp = 2.0 * sqrt(0.5 * (1.0 + dots));
        for (int i = 0; i < 3; i++)
            w[i] = (unit[i] + mirrored[i]) / sharp;
        w[3] = sqrt(size / other);
        applied(w, 1.0, z, value + 3L * u);
        size = sqrt(w[1] * w[1] + w[2] * w[2]);
        double x = size > 0.0 ? w[1] / size : 1.0, y = size > 0.0 ? w[2] / size : 0.0;
        large = (w[0] + size) * (w[0] + size);
        eta2 = w[3] * w[3];
        h[0] = large / eta2;
        h[1] = 1.0 / large / eta2;
        h[2] = 1.0 / eta2;
        f[0] = f[3] = half;
        f[1] = -half * x;
        f[2] = -half * y;
        f[4] = half * x;
        f[5] = half * y;
        f[6] = 0.0;
        f[7] = -y;
        f[8] = x;
    }
}

/* V = W^-1 (l \ r). */
void disc_shift(int units, const double *scaling, const double *value, const double *change,
                double *out)
{
    for (int u = 0; u < units; u++) {
        const double *l = value + 3L * u, *r = change + 3L * u;
        double first = (l[0] * r[0] - l[1] * r[1] - l[2] * r[2]) / determinant(l);
        double v[3] = {first, (r[1] - first * l[1]) / l[0], (r[2] - first * l[2]) / l[0]};
        applied(scaling + 4L * u, -1.0, v, out + 3L * u);
    }
}

/* (W^-1 ds) o (W dz), or, if it is `linear`, l o (W^-1 ds + W dz). */
void disc_products(int units, int linear, const double *scaling, const double *value,
                   const double *ds, const double *dz, double *out)
{
    for (int u = 0; u < units; u++) {
        double a[3], b[3];
        applied(scaling + 4L * u, -1.0, ds + 3L * u, a);
        applied(scaling + 4L * u, 1.0, dz + 3L * u, b);
        for (int i = 0; linear && i < 3; i++)
            b[i] += a[i];
        jordan(linear ? value + 3L * u : a, b, out + 3L * u);
    }
}

/* W^-2 ds. */
void disc_stretch(int units, const double *scaling, const double *ds, double *out)
{
    for (int u = 0; u < units; u++) {
        double once[3];
        applied(scaling + 4L * u, -1.0, ds + 3L * u, once);
        applied(scaling + 4L * u, -1.0, once, out + 3L * u);
    }
}

/* The longest step that stays in the cones; nan where any is. */
void disc_longest(int units, const double *place, const double *step, double *out)
{
    double longest = 1.0 / 0.0;
    for (int u = 0; u < units; u++) {
        const double *s = place + 3L * u, *d = step + 3L * u;
        double square = d[0] * d[0] - (d[1] * d[1] + d[2] * d[2]);
        double part = s[0] * d[0] - (s[1] * d[1] + s[2] * d[2]), inside = determinant(s);
        double root = part * part - square * inside;
        double nearest = sqrt(root > 0.0 ? root : 0.0) - part;
        double length = nearest > 0.0 && root >= 0.0 ? inside / nearest : 1.0 / 0.0;
        double apex = d[0] < 0.0 ? -s[0] / d[0] : 1.0 / 0.0;
        length = apex < length || apex != apex ? apex : length;
        if (length < longest || length != length)
            longest = length;
    }
    out[0] = longest;
}
