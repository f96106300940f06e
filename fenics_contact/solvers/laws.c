/* Joint points on their laws and on their tangents, point by point.

   What SmoothedLaws, TangentModel.distances and ChosenPoints.at say in Python, operation by
   operation in the same order, so that both give the same numbers bit for bit. Arrays of values of
   points hold them row by row: y, r_N, w, r_T and dilation of states; normal, tangential of forces;
   normal, tangential, coupling, slope and give of springs. */

#include <math.h>

/* Some points on their tangents, x0 + part c + s t: TangentModel. */
typedef struct {
    int count;
    double smallest, mu, log_mu_rate;
    const double *friction, *strength, *dilatancy, *carried;
    const double *start, *correction, *tangent, *springs, *compliance;
} points;

static inline double mu_at(const points *of, double s)
{
    double grown = of->log_mu_rate * s;
    return of->mu * exp(709.0 < grown ? 709.0 : grown);
}

typedef struct {
    double y, r, w, shear, dilation;
} state;

static inline double larger(double a, double b) /* nan where any is nan */
{
    return (a >= b) | (a != a) ? a : b;
}

static inline double smaller(double a, double b)
{
    return (a <= b) | (a != a) ? a : b;
}

static inline void normal_law(double p, double mu, double *y, double *r)
{
    double large = 0.5 * (sqrt(p * p + 4.0 * mu) + fabs(p)), small = mu / large;
    *y = p > 0.0 ? small : large;
    *r = p > 0.0 ? large : small;
}

static inline double distance_from_bound(double q, double gamma, double mu, int newton_steps)
{
    double rest = gamma - q, large = 0.5 * (sqrt(rest * rest + 4.0 * mu) + fabs(rest));
    double s = smaller(rest > 0.0 ? large : mu / large, gamma);
    for (int k = 0; k < newton_steps; k++) {
        double other = 2.0 * gamma - s, near = mu / s, far = mu / other;
        s = s - (s - near + far - rest) / (1.0 + near / s + far / other);
    }
    return smaller(s, gamma);
}

/* Four points at a time where the processor can: chosen when it runs. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif

/* Distances from the laws at x0 + part c + s t, moved by given openings and slips. */
WIDE
void distances(const points *of, double part, double s, const double *motion,
               double *restrict found)
{
    int count = of->count;
    double mu = mu_at(of, s), smallest = of->smallest;
    const double *friction = of->friction, *strength = of->strength, *carried = of->carried;
    const double *start = of->start, *correction = of->correction, *tangent = of->tangent;
    const double *springs = of->springs, *compliance = of->compliance;
    const double *k_n = springs, *k_t = k_n + count, *coupling = k_t + count;
    const double *slope = coupling + count, *give = slope + count;
    const double *c_n = compliance, *c_t = c_n + count;
    for (int i = 0; i < count; i++) {
        int j = i + count, k = j + count, l = k + count;
        double opening = motion[i], slip = motion[j];
        double moved = opening + slope[i] * slip;
        double r = -k_n[i] * moved, shear = -k_t[i] * slip - coupling[i] * moved;
        double at_y = start[i] + part * correction[i] + s * tangent[i]
                      + (moved + (c_n[i] + give[i]) * r);
        double at_r = start[j] + part * correction[j] + s * tangent[j] + r;
        double at_w = start[k] + part * correction[k] + s * tangent[k] + (slip + c_t[i] * shear);
        double at_shear = start[l] + part * correction[l] + s * tangent[l] + shear;
        double y, q = at_shear - at_w;
        normal_law(at_r - at_y, mu, &y, &r);
        double bound = friction[i] * r + strength[i], gamma = carried[i] > 0.0 ? bound : 1.0;
        double w = copysign(gamma - distance_from_bound(fabs(q), gamma, mu, 4), q) - q;
        double of_p = fabs(y - at_y) / larger(r + y, smallest);
        double of_q = fabs(w - at_w) / larger(gamma + fabs(w), smallest);
        double distance = larger(of_p, carried[i] > 0.0 ? of_q : 0.0);
        found[i] = distance == distance ? distance : INFINITY;
    }
}

/* Displacements by blocks alone, and forces in excess of those of the springs. */
static inline void split(state x, double k_n, double k_t, double coupling, double slope,
                         double c_n, double c_t, double carried, double *moved, double *excess,
                         int next)
{
    double opening = x.y + x.dilation - c_n * x.r, slip = x.w - c_t * x.shear;
    double by_both = opening + slope * slip;
    moved[0] = opening;
    moved[next] = slip;
    excess[0] = x.r + k_n * by_both;
    excess[next] = (x.shear + k_t * slip + coupling * by_both) * carried;
}

/* Equations of the chosen points at x on a line: displacements and excess forces of what the laws
   differ by from the tangents and of its change along the line, shape (2, 2 count) each; sizes of
   p, q, tau; and slopes by p and q column by column, shape (2 count, 2 count + 1), whose last column
   is left out. C is given column by column. */
void chosen_points(const points *of, const double *c, double part, double s, double of_part,
                   double of_s, const double *x, double *moved, double *excess, double *sizes,
                   double *slopes)
{
    int count = of->count, rows = 2 * count;
    double mu = mu_at(of, s), smallest = of->smallest, log_mu_rate = of->log_mu_rate;
    const double *friction = of->friction, *strength = of->strength, *dilatancy = of->dilatancy;
    const double *start = of->start, *correction = of->correction, *tangent = of->tangent;
    const double *springs = of->springs, *compliance = of->compliance, *carried = of->carried;
    for (int j = 0; j < count; j++) {
        double p = x[j], q = x[count + j], y, r;
        normal_law(p, mu, &y, &r);
        double root = y + r, gamma = carried[j] > 0.0 ? friction[j] * r + strength[j] : 1.0;
        double r_p = r / root, y_p = -y / root, r_mu = mu / root;
        double near = distance_from_bound(fabs(q), gamma, mu, 4), far = 2.0 * gamma - near;
        double of_near = mu / near, of_far = mu / far;
        double by_s = 1.0 + of_near / near + of_far / far;
        double by_gamma = -1.0 - 2.0 * of_far / far;
        double side = carried[j] > 0.0 ? copysign(1.0, q) : 0.0;
        double shear = side * (gamma - near), w = shear - q;
        double shear_r = side * (1.0 + by_gamma / by_s) * friction[j];
        double shear_p = shear_r * r_p, shear_q = carried[j] > 0.0 ? 1.0 / by_s : 0.0;
        double shear_mu = shear_r * r_mu + side * (of_far - of_near) / by_s;
        double d = dilatancy[j], slid_s = of_far / far - of_near / near;
        double slid_r = (-slid_s * by_gamma / by_s - 2.0 * of_far / far) * friction[j];
        double slid_q = copysign(1.0, q) * -slid_s / by_s;
        double slid_mu = slid_r * r_mu + slid_s * (of_near - of_far) / by_s + (of_near + of_far);
        double states[5] = {y, r, w, shear, d * (of_near + of_far)};
        double by_mu[5] = {r_mu, r_mu, shear_mu, shear_mu, d * slid_mu};
        double change[2][5];
        for (int k = 0; k < 5; k++) {
            int i = k * count + j;
            change[0][k] = states[k] - (start[i] + part * correction[i] + s * tangent[i]);
            change[1][k] = of_s * (log_mu_rate * by_mu[k] - tangent[i]) - of_part * correction[i];
        }
        state of[4] = {{change[0][0], change[0][1], change[0][2], change[0][3], change[0][4]},
                       {change[1][0], change[1][1], change[1][2], change[1][3], change[1][4]},
                       {y_p, r_p, shear_p, shear_p, d * (slid_r * r_p)},
                       {0.0, 0.0, shear_q - 1.0, shear_q, d * slid_q}};
        double k_n = springs[j], k_t = springs[count + j], coupling = springs[2 * count + j];
        double slope_of = springs[3 * count + j];
        double c_n = compliance[j], c_t = compliance[count + j];
        for (int k = 0; k < 2; k++) {
            int i = 2 * k * count + j;
            split(of[k], k_n, k_t, coupling, slope_of, c_n, c_t, carried[j], moved + i, excess + i,
                  count);
        }
        for (int k = 0; k < 2; k++) { /* p and q of a point change its own forces alone */
            double own[2], forces[2];
            split(of[2 + k], k_n, k_t, coupling, slope_of, c_n, c_t, carried[j], own, forces, 1);
            double *slope = slopes + (k * count + j) * rows;
            const double *to_normal = c + j * rows, *to_shear = c + (count + j) * rows;
            for (int i = 0; i < rows; i++)
                slope[i] = -(to_normal[i] * forces[0] + to_shear[i] * forces[1]);
            slope[j] += own[0];
            slope[count + j] += own[1];
        }
        sizes[j] = larger(r + y, smallest);
        sizes[count + j] = larger(gamma + fabs(w), smallest);
    }
    sizes[2 * count] = 1.0;
}

/* Slacks with all products equal to mu, from p and q: slacks_next_to. Slacks are y, r_N, r_T, s1,
   s2, z1, z2, shape (7, count); displacements and forces in typical ones. */
WIDE
void slacks_of(int count, double mu, double displacement, double force, double nearest,
               const double *friction, const double *strength, const double *carried,
               const double *p, const double *q, double *restrict slacks)
{
    double product = mu * force * displacement;
    for (int i = 0; i < count; i++) {
        double y, r;
        normal_law(p[i], mu, &y, &r);
        r *= force;
        double bound = (friction[i] * r + strength[i]) / force;
        double gamma = carried[i] > 0.0 ? bound : 1.0;
        double near = larger(distance_from_bound(fabs(q[i]), gamma, mu, 6), nearest * gamma);
        double far = 2.0 * gamma - near;
        double s1 = (q[i] > 0.0 ? near : far) * force, s2 = (q[i] > 0.0 ? far : near) * force;
        slacks[i] = y * displacement;
        slacks[count + i] = r;
        slacks[2 * count + i] = carried[i] > 0.0 ? 0.5 * (s2 - s1) : 0.0;
        slacks[3 * count + i] = s1;
        slacks[4 * count + i] = s2;
        slacks[5 * count + i] = product / s1;
        slacks[6 * count + i] = product / s2;
    }
}

/* The laws linearised at some slacks: LinearLaws. */
typedef struct {
    int count;
    double unit;
    const double *friction, *dilatancy, *y, *s1, *s2, *z1, *z2;
    const double *k_n, *k_t, *share_n, *share_t, *q, *slope, *compliance, *carried;
} linear;

/* Opening and slip that residuals and products ask for: LinearLaws._drives. */
static inline void drives(const linear *at, int i, double opening, double slip, double lower,
                          double upper, double *of_opening, double *of_slip)
{
    lower /= at->s1[i];
    upper /= at->s2[i];
    *of_slip = at->carried[i] > 0.0 ? upper - lower + slip : 0.0;
    *of_opening = opening + (at->dilatancy[i] * (lower + upper) + at->slope[i] * *of_slip);
}

/* Changes of r_N and r_T that a step asks for where nothing moves: LinearLaws.forces. */
void asked_forces(const linear *at, const double *opening, const double *slip,
                  const double *products, double *restrict forces)
{
    int count = at->count;
    const double *of_lower = products + count, *of_upper = of_lower + count;
    for (int i = 0; i < count; i++) {
        double drive, opens;
        drives(at, i, opening[i], slip[i], of_lower[i], of_upper[i], &opens, &drive);
        double push = at->share_n[i] * (products[i] / at->y[i] + at->k_n[i] * opens);
        forces[i] = push;
        forces[count + i] = at->share_t[i] * (at->k_t[i] * drive + at->q[i] * push);
    }
}

/* Changes of the slacks for openings and slips of the blocks: LinearLaws.changes. */
void changes(const linear *at, const double *asked_opening, const double *asked_slip,
             const double *products, const double *opening, const double *slip,
             double *restrict slacks)
{
    int count = at->count;
    const double *of_lower = products + count, *of_upper = of_lower + count;
    const double *c_n = at->compliance, *c_t = c_n + count;
    for (int i = 0; i < count; i++) {
        double drive, opens, lower = at->z1[i] / at->s1[i], upper = at->z2[i] / at->s2[i];
        drives(at, i, asked_opening[i], asked_slip[i], of_lower[i], of_upper[i], &opens, &drive);
        double moved = opening[i] + at->slope[i] * slip[i];
        double pressure = at->share_n[i] * (products[i] / at->y[i] - at->k_n[i] * (moved - opens));
        double stuck = at->carried[i] > 0.0 ? drive - slip[i] : 0.0;
        double shear = at->share_t[i] * (at->k_t[i] * stuck + at->q[i] * pressure);
        double slid = slip[i] + c_t[i] * shear - asked_slip[i];
        double s1 = at->friction[i] * pressure - shear, s2 = at->friction[i] * pressure + shear;
        double first = (of_lower[i] - at->z1[i] * s1) / at->s1[i];
        double second = (of_upper[i] - at->z2[i] * s2) / at->s2[i];
        int down = lower > larger(upper, at->unit), up = upper > larger(lower, at->unit);
        double z1 = down ? second - slid : first, z2 = up ? first + slid : second;
        s1 = down ? (of_lower[i] - at->s1[i] * z1) / at->z1[i] : s1;
        s2 = up ? (of_upper[i] - at->s2[i] * z2) / at->z2[i] : s2;
        int carries = at->carried[i] > 0.0;
        z1 = carries ? z1 : 0.0;
        z2 = carries ? z2 : 0.0;
        slacks[i] = opening[i] + c_n[i] * pressure - asked_opening[i]
                    - at->dilatancy[i] * (z1 + z2);
        slacks[count + i] = pressure;
        slacks[2 * count + i] = shear;
        slacks[3 * count + i] = carries ? s1 : 0.0;
        slacks[4 * count + i] = carries ? s2 : 0.0;
        slacks[5 * count + i] = z1;
        slacks[6 * count + i] = z2;
    }
}

/* Add values at places of others, -1: none. */
void add_at(int count, const long long *place, const double *added, double *values)
{
    for (int i = 0; i < count; i++)
        if (place[i] >= 0)
            values[place[i]] += added[i];
}
