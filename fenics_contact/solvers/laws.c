/* The law of joint points: what runs is what is read here.

   A point opens by w_N, slips by w_T and carries r_N and r_T. F is its friction, c its strength and
   D its dilatancy (joint_law.py). Its clearance y, slips z1, z2 and distances s1, s2 of the shear
   force from its bounds are all positive, with products mu:

       w_N = y + D (z1 + z2),   w_T = z2 - z1,   s1 = F r_N + c - r_T,   s2 = F r_N + c + r_T,
       y r_N = mu,   s1 z1 = mu,   s2 z2 = mu.

   Every p = r_N - y and q = r_T - w_T belong to one such state (B. Chen, P.T. Harker, SIAM J. Matrix
   Anal. Appl. 14 (1993) 1168; C. Kanzow, SIAM J. Matrix Anal. Appl. 17 (1996) 851):

       r_N, y = (sqrt(p^2 + 4 mu) +- p) / 2,   gamma = F r_N + c,
       s - mu/s + mu/(2 gamma - s) = gamma - |q|,   r_T = sign(q) (gamma - s).

   As mu falls to zero these become the laws. A point that is not `carried` transmits no shear.

   Forces and displacements are in typical units, f and d, where nothing else is said. Arrays hold
   points row by row: y, r_N, w_T, r_T and dilation D (z1 + z2) of states; normal, tangential of
   forces, motions and compliances; y, r_N, r_T, s1, s2, z1, z2 of slacks. */

#include <math.h>

typedef struct {
    int count;
    double force; /* the typical one, in the unit of strength */
    const double *friction, *strength, *dilatancy, *carried;
} laws;

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

/* Clearance and normal force with the product mu and the difference p. */
static inline void normal_law(double p, double mu, double *y, double *r)
{
    double large = 0.5 * (sqrt(p * p + 4.0 * mu) + fabs(p)), small = mu / large;
    *y = p > 0.0 ? small : large;
    *r = p > 0.0 ? large : small;
}

/* Distance s of the shear force from the bound that it is nearer to, 0 < s <= gamma, for |q|.

   Six of Newton's steps leave nothing but rounding, four 1e-6 of s. Without the third term s is
   larger, and the first step goes too far: the left-hand side is concave. From there Newton's method
   climbs to the solution and never passes it. */
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

/* The state that belongs to p and q, its derivatives by p, q and log mu, and the bound gamma. */
typedef struct {
    state at, by_p, by_q, by_mu;
    double gamma;
} tangents;

static inline tangents law_at(const laws *of, int i, double p, double q, double mu, int newton_steps)
{
    double friction = of->friction[i], d = of->dilatancy[i], y, r;
    int carried = of->carried[i] > 0.0;
    normal_law(p, mu, &y, &r);
    double root = y + r, r_p = r / root, y_p = -y / root, r_mu = mu / root;
    /* s(gamma, q, mu): derivatives of s - mu/s + mu/(2 gamma - s) - gamma + |q| = 0 */
    double gamma = carried ? friction * r + of->strength[i] / of->force : 1.0;
    double s = distance_from_bound(fabs(q), gamma, mu, newton_steps), far = 2.0 * gamma - s;
    double of_s = mu / s, of_far = mu / far;
    double by_s = 1.0 + of_s / s + of_far / far, by_gamma = -1.0 - 2.0 * of_far / far;
    double side = carried ? copysign(1.0, q) : 0.0;
    double shear = side * (gamma - s), shear_r = side * (1.0 + by_gamma / by_s) * friction;
    double shear_p = shear_r * r_p, shear_q = carried ? 1.0 / by_s : 0.0;
    double shear_mu = shear_r * r_mu + side * (of_far - of_s) / by_s;
    /* z1 + z2 = mu/s + mu/(2 gamma - s) */
    double slid_s = of_far / far - of_s / s;
    double slid_r = (-slid_s * by_gamma / by_s - 2.0 * of_far / far) * friction;
    double slid_q = copysign(1.0, q) * -slid_s / by_s;
    double slid_mu = slid_r * r_mu + slid_s * (of_s - of_far) / by_s + (of_s + of_far);
    tangents found = {{y, r, shear - q, shear, d * (of_s + of_far)},
                      {y_p, r_p, shear_p, shear_p, d * (slid_r * r_p)},
                      {0.0, 0.0, shear_q - 1.0, shear_q, d * slid_q},
                      {r_mu, r_mu, shear_mu, shear_mu, d * slid_mu},
                      gamma};
    return found;
}

static inline void put(state x, double *values, int next)
{
    values[0] = x.y;
    values[next] = x.r;
    values[2 * next] = x.w;
    values[3 * next] = x.shear;
    values[4 * next] = x.dilation;
}

/* p of the state with given r_N - w_N and q: the root of p = r_N - w_N + D (z1 + z2).

   The last term falls as p grows, so there is one: Newton's method, kept between two values that it
   lies between, until nothing but rounding is left. */
static double p_of(const laws *of, int i, double difference, double q, double mu)
{
    double p = difference, low = difference, high = INFINITY, change = INFINITY;
    for (int k = 0; k < 60; k++) {
        tangents now = law_at(of, i, p, q, mu, 6);
        double beyond = difference + now.at.dilation; /* on the other side of the root */
        low = larger(low, smaller(p, beyond));
        high = smaller(high, larger(p, beyond));
        double next = p + (beyond - p) / (1.0 - now.by_p.dilation);
        if (!(fabs(next - p) <= 0.5 * change && next >= low && next <= high))
            next = 0.5 * (low + high);
        change = fabs(next - p);
        p = next;
        if (!(change > 1e-14 * (fabs(p) + sqrt(mu))))
            break;
    }
    return p;
}

/* Four points at a time where the processor can: chosen when it runs. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif

/* Slacks in N and m with products mu in the place of p and q, which are in the rows of y and r_T. */
WIDE
void slacks_of(const laws *of, double mu, double d, double nearest, double *slacks)
{
    int count = of->count;
    double f = of->force;
    const double *friction = of->friction, *strength = of->strength, *carried = of->carried;
    for (int i = 0; i < count; i++) {
        double p = slacks[i], q = slacks[2 * count + i], y, r;
        normal_law(p, mu, &y, &r);
        r *= f;
        double bound = (friction[i] * r + strength[i]) / f;
        double gamma = carried[i] > 0.0 ? bound : 1.0;
        double near = larger(distance_from_bound(fabs(q), gamma, mu, 6), nearest * gamma);
        double far = 2.0 * gamma - near;
        double s1 = (q > 0.0 ? near : far) * f, s2 = (q > 0.0 ? far : near) * f;
        slacks[i] = y * d;
        slacks[count + i] = r;
        slacks[2 * count + i] = carried[i] > 0.0 ? 0.5 * (s2 - s1) : 0.0;
        slacks[3 * count + i] = s1;
        slacks[4 * count + i] = s2;
        slacks[5 * count + i] = mu * f * d / s1;
        slacks[6 * count + i] = mu * f * d / s2;
    }
}

/* Slacks with products mu next to a state in N and m, which need not be admissible: they keep
   r_N/f - w_N/d and r_T/f - w_T/d. Shear is off its bound by a part `nearest` of it at least. */
void slacks_next_to(const laws *of, double mu, double d, double nearest, const double *opening,
                    const double *slip, const double *pressure, const double *shear, double *slacks)
{
    for (int i = 0; i < of->count; i++) {
        double p = pressure[i] / of->force - opening[i] / d;
        double q = shear[i] / of->force - slip[i] / d;
        slacks[i] = of->dilatancy[i] > 0.0 ? p_of(of, i, p, q, mu) : p;
        slacks[2 * of->count + i] = q;
    }
    slacks_of(of, mu, d, nearest, slacks);
}

/* ---- the laws as springs of Newton's method, in N and m

   Let k_N = r_N / y, a = z1 / s1, b = z2 / s2, k_T = 1 / (a + b), and c_N, c_T the compliance of the
   point itself. Changes of forces by those of openings and slips of the blocks are

       dr_N = -normal (dw_N + slope dw_T),
       dr_T = -tangential dw_T - coupling (dw_N + slope dw_T),

       tangential = 1 / (a + b + c_T),         coupling = F (a - b) tangential normal,
       slope      = D (a - b) tangential,      normal   = k_N / (1 + (c_N + give) k_N),
       give       = D F (4 a b + c_T (a + b)) tangential.

   Without dilatancy slope and give are zero, with D = F they make the springs symmetric. */

typedef struct {
    const laws *law;
    double unit; /* d / f: above it a side slides */
    const double *y, *pressure, *s1, *s2, *z1, *z2, *compliance;
    double *k; /* shape (7, count): normal, tangential, coupling, slope and give, k_N and k_T */
    double *shares; /* shape (3, count): of k_N and k_T beside compliances, and F (a - b) k_T */
} linear;

/* Springs at some slacks, k_N and k_T of at most `largest`. */
void linearize(const linear *at, double largest)
{
    int count = at->law->count;
    for (int i = 0; i < count; i++) {
        double friction = at->law->friction[i], dilatancy = at->law->dilatancy[i];
        double c_n = at->compliance[i], c_t = at->compliance[count + i];
        double a = at->z1[i] / at->s1[i], b = at->z2[i] / at->s2[i];
        double k_n = smaller(at->pressure[i] / at->y[i], largest);
        double k_t = at->law->carried[i] > 0.0 ? smaller(1.0 / (a + b), largest) : 0.0;
        double share_t = 1.0 / (1.0 + c_t * k_t), tangential = share_t * k_t;
        double q = friction * k_t * (a - b), slope = dilatancy * (a - b) * tangential;
        double give = dilatancy * friction * (4.0 * a * b + c_t * (a + b)) * tangential;
        double share_n = 1.0 / (1.0 + (c_n + give) * k_n), normal = share_n * k_n;
        double *k = at->k + i, *share = at->shares + i;
        k[0] = normal;
        k[count] = tangential;
        k[2 * count] = share_t * q * normal;
        k[3 * count] = slope;
        k[4 * count] = give;
        k[5 * count] = k_n;
        k[6 * count] = k_t;
        share[0] = share_n;
        share[count] = share_t;
        share[2 * count] = q;
    }
}

/* A step is to take residuals y + D (z1 + z2) - w_N and z2 - z1 - w_T away, and to change y r_N,
   s1 z1 and s2 z2 by `products`. For point i: the opening and slip that this asks for. */
static inline void asked(const linear *at, int i, double opening, double slip,
                         const double *products, double *of_opening, double *of_slip)
{
    int count = at->law->count;
    double lower = products[count + i] / at->s1[i], upper = products[2 * count + i] / at->s2[i];
    *of_slip = at->law->carried[i] > 0.0 ? upper - lower + slip : 0.0;
    *of_opening = opening + (at->law->dilatancy[i] * (lower + upper) + at->k[3 * count + i] * *of_slip);
}

/* Changes of r_N and r_T that a step asks for where nothing moves. */
void asked_forces(const linear *at, const double *opening, const double *slip,
                  const double *products, double *restrict forces)
{
    int count = at->law->count;
    const double *k_n = at->k + 5 * count, *k_t = k_n + count;
    const double *share_n = at->shares, *share_t = share_n + count, *q = share_t + count;
    for (int i = 0; i < count; i++) {
        double drive, opens;
        asked(at, i, opening[i], slip[i], products, &opens, &drive);
        double push = share_n[i] * (products[i] / at->y[i] + k_n[i] * opens);
        forces[i] = push;
        forces[count + i] = share_t[i] * (k_t[i] * drive + q[i] * push);
    }
}

/* Changes of the slacks for openings and slips of the blocks: the eliminated equations. */
void changes(const linear *at, const double *asked_opening, const double *asked_slip,
             const double *products, const double *opening, const double *slip,
             double *restrict slacks)
{
    int count = at->law->count;
    const double *of_lower = products + count, *of_upper = of_lower + count;
    const double *slope = at->k + 3 * count, *k_n = slope + 2 * count, *k_t = k_n + count;
    const double *share_n = at->shares, *share_t = share_n + count, *q = share_t + count;
    const double *c_n = at->compliance, *c_t = c_n + count, *friction = at->law->friction;
    for (int i = 0; i < count; i++) {
        int carried = at->law->carried[i] > 0.0;
        double drive, opens, a = at->z1[i] / at->s1[i], b = at->z2[i] / at->s2[i];
        asked(at, i, asked_opening[i], asked_slip[i], products, &opens, &drive);
        double moved = opening[i] + slope[i] * slip[i];
        double pressure = share_n[i] * (products[i] / at->y[i] - k_n[i] * (moved - opens));
        double stuck = carried ? drive - slip[i] : 0.0;
        double shear = share_t[i] * (k_t[i] * stuck + q[i] * pressure);
        double s1 = friction[i] * pressure - shear, s2 = friction[i] * pressure + shear;
        double z1 = (of_lower[i] - at->z1[i] * s1) / at->s1[i];
        double z2 = (of_upper[i] - at->z2[i] * s2) / at->s2[i];
        /* Next to its bound the shear force has lost the digits that tell how far a point slides. */
        double slid = slip[i] + c_t[i] * shear - asked_slip[i];
        int down = a > larger(b, at->unit), up = b > larger(a, at->unit);
        double lower = down ? z2 - slid : z1, upper = up ? z1 + slid : z2;
        s1 = down ? (of_lower[i] - at->s1[i] * lower) / at->z1[i] : s1;
        s2 = up ? (of_upper[i] - at->s2[i] * upper) / at->z2[i] : s2;
        lower = carried ? lower : 0.0;
        upper = carried ? upper : 0.0;
        slacks[i] = opening[i] + c_n[i] * pressure - asked_opening[i]
                    - at->law->dilatancy[i] * (lower + upper);
        slacks[count + i] = pressure;
        slacks[2 * count + i] = shear;
        slacks[3 * count + i] = carried ? s1 : 0.0;
        slacks[4 * count + i] = carried ? s2 : 0.0;
        slacks[5 * count + i] = lower;
        slacks[6 * count + i] = upper;
    }
}

/* Add values at places of others, -1: none. */
void add_at(int count, const long long *place, const double *added, double *values)
{
    for (int i = 0; i < count; i++)
        if (place[i] >= 0)
            values[place[i]] += added[i];
}
