/* The curve of a few joint points on their laws, all others on their tangents.

   On one factor of the structure the tangents lead to x = x0 + part c + s t, and forces in excess of
   those of the springs answer by displacements C f. Let D(p, q) be what the laws of the chosen points
   differ by from their tangents, with displacements d(D) by the blocks alone and excess forces f(D).
   Their equations, two a point, are

       d(D) - C f(D) = 0,    D = x(p, q, mu(s)) - x0 - part c - s t,    mu(s) = mu exp(rate s).

   On a line (part, s) = begin + tau direction the solutions x = (p, q, tau) are a curve that may turn
   back: it is followed by its length, as far as the other points stay near their laws. Lengths,
   errors and distances are relative to the sizes of p and q. */

#include <stdlib.h>
#include <string.h>

enum { CURVE_STEPS = 80, NEWTON_STEPS = 7 };  /* along a curve; of one such step */
static const double LONGEST = 3.0, SHORTEST = 3e-2; /* steps */

/* Joint points, of which a table has these rows. */
enum {
    LAW,                         /* friction, strength, dilatancy, carried */
    START = LAW + 4,             /* x0 */
    CORRECTION = START + 5,      /* c */
    TANGENT = CORRECTION + 5,    /* t */
    SPRINGS = TANGENT + 5,       /* normal, tangential, coupling, slope, give */
    COMPLIANCE = SPRINGS + 5     /* normal, tangential */
};

typedef struct {
    int count;
    double smallest, mu, log_mu_rate; /* size of p and q at least; product at x0; d(log mu)/ds */
    const double *table;
} points;

static inline const double *rows_of(const points *of, int row)
{
    return of->table + (size_t)row * of->count;
}

static inline laws laws_of_points(const points *of)
{
    int n = of->count;
    const double *friction = rows_of(of, LAW);
    laws found = {n, 1.0, friction, friction + n, friction + 2 * n, friction + 3 * n};
    return found;
}

static inline double mu_at(const points *of, double s)
{
    double grown = of->log_mu_rate * s;
    return of->mu * exp(709.0 < grown ? 709.0 : grown); /* no number is larger */
}

/* States on the laws that belong to x, p and q, shape (5, count). */
void on_laws(const points *of, double s, const double *x, double *values)
{
    laws law = laws_of_points(of);
    for (int i = 0; i < of->count; i++)
        put(law_at(&law, i, x[i], x[of->count + i], mu_at(of, s), 6).at, values + i, of->count);
}

/* Where the tangents lead at (part, s) under openings and slips by the blocks: springs answer. */
static inline state on_tangent(const double *x0, const double *c, const double *t, const double *k,
                               const double *compliance, int next, double part, double s,
                               double opening, double slip)
{
    double k_n = k[0], k_t = k[next], coupling = k[2 * next], slope = k[3 * next], give = k[4 * next];
    double moved = opening + slope * slip;
    double r = -k_n * moved, shear = -k_t * slip - coupling * moved;
    state x;
    x.y = x0[0] + part * c[0] + s * t[0] + (moved + (compliance[0] + give) * r);
    x.r = x0[next] + part * c[next] + s * t[next] + r;
    x.w = x0[2 * next] + part * c[2 * next] + s * t[2 * next] + (slip + compliance[next] * shear);
    x.shear = x0[3 * next] + part * c[3 * next] + s * t[3 * next] + shear;
    x.dilation = x0[4 * next] + part * c[4 * next] + s * t[4 * next] + (-slope * slip - give * r);
    return x;
}

/* States on the tangents, shape (5, count), under openings and slips, shape (2, count). */
void on_tangents(const points *of, double part, double s, const double *motion, double *values)
{
    int n = of->count;
    for (int i = 0; i < n; i++)
        put(on_tangent(rows_of(of, START) + i, rows_of(of, CORRECTION) + i, rows_of(of, TANGENT) + i,
                       rows_of(of, SPRINGS) + i, rows_of(of, COMPLIANCE) + i, n, part, s, motion[i],
                       motion[n + i]),
            values + i, n);
}

/* Distances of states on the tangents from the states on the laws with equal p and q: the larger of
   the differences of clearances and of slips, to six digits; infinite where a tangent leads nowhere.
   Some points at a time, in short loops: a long one has more numbers than the processor holds. */
WIDE
void distances(const points *of, double part, double s, const double *motion,
               double *restrict found)
{
    enum { SOME = 64 };
    int n = of->count;
    double mu = mu_at(of, s), smallest = of->smallest;
    laws law = laws_of_points(of);
    const double *x0 = rows_of(of, START), *c = rows_of(of, CORRECTION), *t = rows_of(of, TANGENT);
    const double *springs = rows_of(of, SPRINGS), *compliance = rows_of(of, COMPLIANCE);
    double y[SOME], w[SOME], p[SOME], q[SOME], gamma[SOME], of_p[SOME], left[SOME];
    for (int first = 0; first < n; first += SOME) {
        int count = n - first < SOME ? n - first : SOME;
        const double *friction = law.friction + first, *strength = law.strength + first;
        const double *carried = law.carried + first;
        for (int k = 0; k < count; k++) {
            int i = first + k;
            state at = on_tangent(x0 + i, c + i, t + i, springs + i, compliance + i, n, part, s,
                                  motion[i], motion[n + i]);
            y[k] = at.y;
            w[k] = at.w;
            p[k] = at.r - at.y;
            q[k] = at.shear - at.w;
        }
        for (int k = 0; k < count; k++) {
            double on_law, r;
            normal_law(p[k], mu, &on_law, &r);
            gamma[k] = carried[k] > 0.0 ? friction[k] * r + strength[k] : 1.0;
            of_p[k] = fabs(on_law - y[k]) / larger(r + on_law, smallest);
        }
        for (int k = 0; k < count; k++)
            left[k] = distance_from_bound(fabs(q[k]), gamma[k], mu, 4);
        for (int k = 0; k < count; k++) {
            double slip = copysign(gamma[k] - left[k], q[k]) - q[k];
            double of_q = fabs(slip - w[k]) / larger(gamma[k] + fabs(slip), smallest);
            double distance = larger(of_p[k], carried[k] > 0.0 ? of_q : 0.0);
            found[first + k] = distance == distance ? distance : INFINITY;
        }
    }
}

/* Openings, or slips, of joint points by displacements x, column by column, times a unit. The entries
   of point i are those from start[i] to start[i + 1] - 1. Many columns at a time: the points of a
   joint meet the same displacements again. -1: no memory. */
typedef double four __attribute__((vector_size(32), aligned(8)));

WIDE
int motions(int points, const long long *start, const long long *place, const double *entry,
            int size, int columns, const double *x, double unit, double *restrict found)
{
    enum { SOME = 16 };
    double *by_place = malloc((size_t)size * SOME * sizeof(double));
    if (!by_place)
        return -1;
    for (int first = 0; first < columns; first += SOME) {
        int count = columns - first < SOME ? columns - first : SOME;
        for (int k = 0; k < SOME; k++) {
            const double *column = x + (size_t)(first + (k < count ? k : 0)) * size;
            for (int i = 0; i < size; i++)
                by_place[(size_t)i * SOME + k] = column[i];
        }
        for (int i = 0; i < points; i++) {
            four a = {0.0}, b = {0.0}, c = {0.0}, d = {0.0}; /* in registers */
            for (long long m = start[i]; m < start[i + 1]; m++) {
                const four *here = (const four *)(by_place + place[m] * SOME);
                a += entry[m] * here[0];
                b += entry[m] * here[1];
                c += entry[m] * here[2];
                d += entry[m] * here[3];
            }
            const four sums[SOME / 4] = {a, b, c, d};
            for (int k = 0; k < count; k++)
                found[(size_t)(first + k) * points + i] = unit * sums[k / 4][k % 4];
        }
    }
    free(by_place);
    return 0;
}

/* Displacements d by blocks alone, and forces f in excess of those of the springs. */
static inline void split(state x, const double *k, const double *compliance, int next, double carried,
                         double *moved, double *excess, int step)
{
    double opening = x.y + x.dilation - compliance[0] * x.r, slip = x.w - compliance[next] * x.shear;
    double by_both = opening + k[3 * next] * slip;
    moved[0] = opening;
    moved[step] = slip;
    excess[0] = x.r + k[0] * by_both;
    excess[step] = (x.shear + k[next] * slip + k[2 * next] * by_both) * carried;
}

/* Equations of the chosen points at x on a line: d and f of D and of its change by tau, shape
   (2, 2 count) each; sizes of p, q, tau; and slopes by p and q column by column, shape (2 count,
   2 count + 1), whose last column is left out. C is given column by column. */
void chosen_points(const points *of, const double *c, double part, double s, double of_part,
                   double of_s, const double *x, double *moved, double *excess, double *sizes,
                   double *slopes)
{
    int n = of->count, rows = 2 * n;
    double mu = mu_at(of, s), smallest = of->smallest, rate = of->log_mu_rate;
    laws law = laws_of_points(of);
    for (int j = 0; j < n; j++) {
        tangents on = law_at(&law, j, x[j], x[n + j], mu, 4);
        const double states[5] = {on.at.y, on.at.r, on.at.w, on.at.shear, on.at.dilation};
        const double by_mu[5] = {on.by_mu.y, on.by_mu.r, on.by_mu.w, on.by_mu.shear, on.by_mu.dilation};
        const double *x0 = rows_of(of, START) + j, *correction = rows_of(of, CORRECTION) + j;
        const double *tangent = rows_of(of, TANGENT) + j, *k = rows_of(of, SPRINGS) + j;
        const double *compliance = rows_of(of, COMPLIANCE) + j;
        double d[5], change[5];
        for (int m = 0; m < 5; m++) {
            int i = m * n;
            d[m] = states[m] - (x0[i] + part * correction[i] + s * tangent[i]);
            change[m] = of_s * (rate * by_mu[m] - tangent[i]) - of_part * correction[i];
        }
        state here = {d[0], d[1], d[2], d[3], d[4]};
        state along = {change[0], change[1], change[2], change[3], change[4]};
        double carried = law.carried[j];
        split(here, k, compliance, n, carried, moved + j, excess + j, n);
        split(along, k, compliance, n, carried, moved + rows + j, excess + rows + j, n);
        for (int side = 0; side < 2; side++) { /* p and q of a point change its own forces alone */
            double own[2], forces[2];
            split(side ? on.by_q : on.by_p, k, compliance, n, carried, own, forces, 1);
            double *slope = slopes + (side * n + j) * rows;
            const double *to_normal = c + j * rows, *to_shear = c + (n + j) * rows;
            for (int i = 0; i < rows; i++)
                slope[i] = -(to_normal[i] * forces[0] + to_shear[i] * forces[1]);
            slope[j] += own[0];
            slope[n + j] += own[1];
        }
        sizes[j] = larger(on.at.r + on.at.y, smallest);
        sizes[n + j] = larger(on.gamma + fabs(on.at.w), smallest);
    }
    sizes[2 * n] = 1.0;
}

/* ---- the curve on a line */

typedef struct {
    const points *chosen, *all;
    const double *c;             /* of the chosen points, column by column */
    const double *answers;       /* openings of all points for unit forces in turn, then slips */
    const unsigned char *others; /* points that are not chosen */
    double part, s, of_part, of_s; /* where the line begins, and its direction */
    double low, high;              /* values of tau at which the curve ends */
    double allowed, solved;        /* distance of the other points; error of the chosen ones */
} curve;

typedef void dgemv(char *, int *, int *, double *, double *, int *, double *, int *, double *,
                   double *, int *);
typedef void dgesv(int *, int *, double *, int *, int *, double *, int *, int *);

static dgemv *multiply;
static dgesv *solve;

void use_lapack(void *of_multiply, void *of_solve)
{
    multiply = (dgemv *)of_multiply;
    solve = (dgesv *)of_solve;
}

/* A x for a matrix of so many rows and columns, column by column. */
static void product(int rows, int columns, const double *a, const double *x, double *found)
{
    double one = 1.0, zero = 0.0;
    int next = 1;
    if (rows > 0 && columns > 0)
        multiply("N", &rows, &columns, &one, (double *)a, &rows, (double *)x, &next, &zero, found,
                 &next);
    else
        memset(found, 0, rows * sizeof(double));
}

/* A place on or near the curve: part and s, the largest error, what is left of the equations, d and f
   and their changes by tau, sizes of x, and slopes. */
typedef struct {
    double part, s, error;
    double *x, *rest, *moved, *excess, *sizes, *slopes;
} place;

/* What the steps along a curve work with. */
typedef struct {
    const curve *on;
    int rows, width; /* equations, unknowns */
    place here, new;
    double *along, *forward, *change, *row, *matrix, *motion;
    int *pivots;
    double *distances; /* of all points, those last asked for */
} tracing;

/* What is left of the equations at the x of a place, d - C f, with derivatives by x. */
static void look_at(const tracing *of, place *at)
{
    const curve *on = of->on;
    int rows = of->rows;
    double tau = at->x[rows], *along = at->slopes + rows * rows;
    at->part = on->part + tau * on->of_part;
    at->s = on->s + tau * on->of_s;
    chosen_points(on->chosen, on->c, at->part, at->s, on->of_part, on->of_s, at->x, at->moved,
                  at->excess, at->sizes, at->slopes);
    product(rows, rows, on->c, at->excess, at->rest);
    product(rows, rows, on->c, at->excess + rows, along);
    at->error = 0.0;
    for (int i = 0; i < rows; i++) {
        at->rest[i] = at->moved[i] - at->rest[i];
        along[i] = at->moved[rows + i] - along[i];
        at->error = larger(at->error, fabs(at->rest[i]) / at->sizes[i]);
    }
}

/* A change of x that takes a part of the rest away and has a product with a row; whether found. */
static int solved(const tracing *of, const place *at, const double *row, double part, double product,
                  double *found)
{
    int rows = of->rows, width = of->width, one = 1, failed;
    for (int j = 0; j < width; j++) {
        memcpy(of->matrix + j * width, at->slopes + j * rows, rows * sizeof(double));
        of->matrix[j * width + rows] = row[j];
    }
    for (int i = 0; i < rows; i++)
        found[i] = part != 0.0 ? -at->rest[i] : 0.0;
    found[rows] = product;
    solve(&width, &one, of->matrix, &width, of->pivots, found, &width, &failed);
    return failed == 0;
}

/* Direction of the curve here, largest relative change one, into along; whether there is one. */
static int direction(const tracing *of)
{
    const place *here = &of->here;
    double largest = 0.0;
    if (!solved(of, here, of->forward, 0.0, 1.0, of->along))
        return 0;
    for (int i = 0; i < of->width; i++) {
        if (!isfinite(of->along[i]))
            return 0;
        largest = larger(largest, fabs(of->along[i] / here->sizes[i]));
    }
    for (int i = 0; i < of->width; i++)
        of->along[i] /= largest;
    return 1;
}

static double within(double value, double least, double largest) /* nan stays nan */
{
    value = least > value ? least : value;
    return largest < value ? largest : value;
}

static void hold_tau(const tracing *of, double *row)
{
    memset(row, 0, of->rows * sizeof(double));
    row[of->rows] = 1.0;
}

/* The point a step on, not beyond the ends of tau; Newton's steps, or -1 where it is not found. */
static int step(const tracing *of, double length, place *new)
{
    const curve *on = of->on;
    int width = of->width, last = of->rows;
    const place *here = &of->here;
    double *row = of->row, tau = here->x[last], ahead = tau + length * of->along[last];
    double end = within(ahead, on->low, on->high);
    double whole = end != ahead ? length * (end - tau) / (ahead - tau) : length;
    for (int i = 0; i < width; i++) {
        row[i] = of->along[i] / (here->sizes[i] * here->sizes[i]);
        new->x[i] = here->x[i] + whole * of->along[i];
    }
    if (end != ahead) {
        new->x[last] = end;
        hold_tau(of, row);
    }
    look_at(of, new);
    for (int corrections = 0; corrections <= NEWTON_STEPS; corrections++) {
        if (new->error <= on->solved) {
            if (on->low <= new->x[last] && new->x[last] <= on->high)
                return corrections;
            new->x[last] = end = within(new->x[last], on->low, on->high);
            hold_tau(of, row);
        } else {
            if (!isfinite(new->error) || fabs(new->x[last] - end) > LONGEST)
                return -1;
            if (!solved(of, new, row, -1.0, 0.0, of->change)
                || !(fabs(new->x[last] + of->change[last] - tau) <= LONGEST))
                return -1;
            for (int i = 0; i < width; i++)
                new->x[i] += of->change[i];
        }
        look_at(of, new);
    }
    return -1;
}

/* Largest distance of the points that are not chosen from their laws. */
static double distance(tracing *of, const place *at)
{
    const curve *on = of->on;
    int count = on->chosen->count, all = on->all->count;
    double *in_turn = of->change, largest = 0.0;
    for (int k = 0; k < count; k++) {
        in_turn[2 * k] = at->excess[k];
        in_turn[2 * k + 1] = at->excess[count + k];
    }
    for (int side = 0; side < 2; side++)
        product(all, 2 * count, on->answers + side * 2 * count * all, in_turn,
                of->motion + side * all);
    distances(on->all, at->part, at->s, of->motion, of->distances);
    for (int i = 0; i < all; i++) {
        of->distances[i] = on->others[i] ? of->distances[i] : 0.0;
        largest = larger(largest, of->distances[i]);
    }
    return largest;
}

/* The step along the curve, into new, shortened until the other points stay near their
   laws. Newton's steps, or -1; its length, and the distance at its end, or of the last one tried. */
static int step_near_laws(tracing *of, double *length, double *near)
{
    const curve *on = of->on;
    double leaving = 0.0;
    while (*length > SHORTEST) {
        int corrections = step(of, *length, &of->new);
        if (corrections < 0) {
            *length *= 0.4;
            leaving = 0.0;
            continue;
        }
        leaving = distance(of, &of->new);
        if (leaving <= on->allowed) {
            *near = leaving;
            return corrections;
        }
        *length *= within((on->allowed - *near) / (leaving - *near), 0.1, 0.5);
    }
    *near = leaving;
    return -1;
}

/* Follow the curve from here to its end, forward becomes the direction there; whether a point that is
   not chosen bends beyond. */
static int followed(tracing *of)
{
    const curve *on = of->on;
    double length = 1.0, near = 0.0;
    look_at(of, &of->here);
    for (int k = 0; k < CURVE_STEPS && direction(of); k++) {
        int corrections = step_near_laws(of, &length, &near);
        if (corrections < 0)
            return near > on->allowed;
        for (int i = 0; i < of->width; i++)
            of->forward[i] = of->along[i] / (of->new.sizes[i] * of->new.sizes[i]);
        place before = of->here;
        of->here = of->new;
        of->new = before;
        length = smaller(corrections <= 3 ? 3.0 * length : length, LONGEST);
        double tau = of->here.x[of->rows];
        if (!(on->low < tau && tau < on->high))
            break;
    }
    return 0;
}

/* Newton's method with tau held, from the x of new; whether a point of the curve was found. */
static int nearest(tracing *of)
{
    const curve *on = of->on;
    place *new = &of->new;
    hold_tau(of, of->row);
    for (int k = 0; k < NEWTON_STEPS; k++) {
        look_at(of, new);
        if (new->error <= on->solved)
            return 1;
        if (!solved(of, new, of->row, -1.0, 0.0, of->change))
            return 0;
        for (int i = 0; i < of->width; i++) {
            if (!isfinite(of->change[i]))
                return 0;
            new->x[i] += of->change[i];
        }
    }
    return 0;
}

static double *some(double **from, size_t count)
{
    *from += count;
    return *from - count;
}

static place new_place(double **from, size_t rows)
{
    place at;
    at.x = some(from, rows + 1);
    at.rest = some(from, rows);
    at.moved = some(from, 2 * rows);
    at.excess = some(from, 2 * rows);
    at.sizes = some(from, rows + 1);
    at.slopes = some(from, rows * (rows + 1));
    return at;
}

/* Take room for all of it; 0: there is none. To be freed: the room. */
static double *begin(tracing *of, const curve *on, double *forward, double *of_distances)
{
    size_t rows = 2 * on->chosen->count, width = rows + 1, all = on->all->count;
    double *room = malloc((3 * width * width + 20 * width + 2 * all) * sizeof(double)), *from = room;
    if (!room)
        return 0;
    of->on = on;
    of->rows = rows;
    of->width = width;
    of->here = new_place(&from, rows);
    of->new = new_place(&from, rows);
    of->along = some(&from, width);
    of->change = some(&from, width);
    of->row = some(&from, width);
    of->matrix = some(&from, width * width);
    of->motion = some(&from, 2 * all);
    of->pivots = (int *)some(&from, width);
    of->forward = forward;
    of->distances = of_distances;
    return room;
}

/* Follow a curve from x, which becomes its end, as forward does, a row whose product with the
   direction is positive; forces: excess ones at the end. 1: a point that is not chosen bends beyond,
   0: none does, -1: no memory. */
int trace(const curve *on, double *x, double *forward, double *forces, double *of_distances)
{
    tracing of;
    double *room = begin(&of, on, forward, of_distances);
    if (!room)
        return -1;
    memcpy(of.here.x, x, of.width * sizeof(double));
    int bends = followed(&of);
    memcpy(x, of.here.x, of.width * sizeof(double));
    memcpy(forces, of.here.excess, of.rows * sizeof(double));
    free(room);
    return bends;
}

/* The point of a curve next to x, which becomes it. 1: found, 0: not found, -1: no memory. */
int near(const curve *on, double *x)
{
    tracing of;
    double *room = begin(&of, on, 0, 0);
    if (!room)
        return -1;
    memcpy(of.new.x, x, of.width * sizeof(double));
    int found = nearest(&of);
    memcpy(x, of.new.x, of.width * sizeof(double));
    free(room);
    return found;
}
