/* The curve of the chosen points on a line, followed by its length.

   What ChosenPoints says in Python where all points are on one rank, in the same order and with the
   same routines of BLAS and LAPACK. x are p and q of the chosen points, and tau. */

#include <stdlib.h>
#include <string.h>

typedef struct {
    const points *chosen, *all;
    const double *c;             /* of the chosen points, column by column */
    const double *answers;       /* openings of all points for unit forces in turn, then slips */
    const unsigned char *others; /* points that are not chosen */
    double part, s, of_part, of_s; /* where the line begins, and its direction */
    double low, high;              /* values of tau at which the curve ends */
    double allowed, longest, shortest, solved;
    int curve_steps, newton_steps;
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

/* A place on or near the curve: CurvePoint. */
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

static void look_at(const tracing *of, place *at) /* ChosenPoints.at */
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

static int direction(const tracing *of) /* ChosenPoints.direction, into along */
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

/* The point a step on; Newton's steps, or -1 where it is not found: ChosenPoints.step. */
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
    for (int corrections = 0; corrections <= on->newton_steps; corrections++) {
        if (new->error <= on->solved) {
            if (on->low <= new->x[last] && new->x[last] <= on->high)
                return corrections;
            new->x[last] = end = within(new->x[last], on->low, on->high);
            hold_tau(of, row);
        } else {
            if (!isfinite(new->error) || fabs(new->x[last] - end) > on->longest)
                return -1;
            if (!solved(of, new, row, -1.0, 0.0, of->change)
                || !(fabs(new->x[last] + of->change[last] - tau) <= on->longest))
                return -1;
            for (int i = 0; i < width; i++)
                new->x[i] += of->change[i];
        }
        look_at(of, new);
    }
    return -1;
}

/* Largest distance of the points that are not chosen from their laws: TangentModel.distances. */
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

/* The step along the curve, into new, shortened until the other points stay near their laws:
   ChosenPoints._step_near_laws. Newton's steps, or -1; its length, and the distance at its end. */
static int step_near_laws(tracing *of, double *length, double *near)
{
    const curve *on = of->on;
    double leaving = 0.0;
    while (*length > on->shortest) {
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

/* ChosenPoints.trace from x, which becomes the end, as forward does; whether a point bends there. */
static int followed(tracing *of)
{
    const curve *on = of->on;
    double length = 1.0, near = 0.0;
    look_at(of, &of->here);
    for (int k = 0; k < on->curve_steps && direction(of); k++) {
        int corrections = step_near_laws(of, &length, &near);
        if (corrections < 0)
            return near > on->allowed;
        for (int i = 0; i < of->width; i++)
            of->forward[i] = of->along[i] / (of->new.sizes[i] * of->new.sizes[i]);
        place before = of->here;
        of->here = of->new;
        of->new = before;
        length = smaller(corrections <= 3 ? 3.0 * length : length, on->longest);
        double tau = of->here.x[of->rows];
        if (!(on->low < tau && tau < on->high))
            break;
    }
    return 0;
}

/* ChosenPoints.near from the x of new; whether a point of the curve was found, its x in new. */
static int nearest(tracing *of)
{
    const curve *on = of->on;
    place *new = &of->new;
    hold_tau(of, of->row);
    for (int k = 0; k < on->newton_steps; k++) {
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
    size_t rows = 2 * on->chosen->count, width = rows + 1, all = on->all ? on->all->count : 0;
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

/* ChosenPoints.trace from x, which becomes the end, as forward does. 1: a point that is not chosen
   bends beyond, 0: none does, -1: no memory. */
int trace(const curve *on, double *x, double *forward, double *of_distances)
{
    tracing of;
    double *room = begin(&of, on, forward, of_distances);
    if (!room)
        return -1;
    memcpy(of.here.x, x, of.width * sizeof(double));
    int bends = followed(&of);
    memcpy(x, of.here.x, of.width * sizeof(double));
    free(room);
    return bends;
}

/* ChosenPoints.near for x, which becomes that point. 1: found, 0: not found, -1: no memory. */
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
