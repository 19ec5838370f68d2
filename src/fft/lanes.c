#include "fft/lanes.h"
#include "v2v3d/base/clones.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/pi.h"
#include <math.h>

/* 3^39 < 2^63: no length has more. */
enum { MOST_STEPS = 40 };

/* Stockham's algorithm, decimation in frequency: after steps of s in all, one of radix r makes
 *   y[s (r p + j) + i] = exp(-2 pi i j p s/n) sum_q x[s (p + m q) + i] exp(-2 pi i j q/r)
 * for p < m = n / (s r), j < r, i < s. */
struct v2v_fft_lanes {
    int64_t n;
    int steps, radix[MOST_STEPS];
    struct v2v_complex *twiddles;      /* [step,p,j-1], n-1 in all */
    struct v2v_complex *real_twiddles; /* [n/2+1]: exp(-pi i k / n) */
};

static const int radices[] = {7, 5, 3, 4, 2};

static struct v2v_complex twiddle_of(int64_t part, int64_t whole)
{
    const double angle = -2.0 * V2V_PI * (double)(part % whole) / (double)whole;
    return (struct v2v_complex){(float)cos(angle), (float)sin(angle)};
}

int64_t v2v_fft_lanes_bytes(int64_t n)
{
    return (n + n / 2 + 1) * (int64_t)sizeof(struct v2v_complex) +
           (int64_t)sizeof(struct v2v_fft_lanes);
}

static void plan_steps(struct v2v_fft_lanes *plan)
{
    struct v2v_complex *twiddle = plan->twiddles;
    int64_t left = plan->n;
    for (size_t k = 0; k < sizeof radices / sizeof *radices; k++) {
        while (left % radices[k] == 0) {
            const int r = plan->radix[plan->steps++] = radices[k];
            for (int64_t p = 0; p < left / r; p++) {
                for (int64_t j = 1; j < r; j++) {
                    *twiddle++ = twiddle_of(j * p, left);
                }
            }
            left /= r;
        }
    }
    V2V_ASSERT(left == 1);
}

enum v2v_status v2v_fft_lanes_create(struct v2v_fft_lanes **plan, int64_t n)
{
    enum v2v_status rc = V2V_OK;
    V2V_ASSERT(n >= 1);
    V2V_TRY(V2V_ALLOC(*plan, "fft.plan", 1));
    (*plan)->n = n;
    V2V_TRY(V2V_ALLOC((*plan)->twiddles, "fft.plan", n));
    V2V_TRY(V2V_ALLOC((*plan)->real_twiddles, "fft.plan", n / 2 + 1));
    plan_steps(*plan);
    for (int64_t k = 0; k <= n / 2; k++) {
        (*plan)->real_twiddles[k] = twiddle_of(k, 2 * n);
    }
done:
    if (rc != V2V_OK) {
        v2v_fft_lanes_destroy(plan);
    }
    return rc;
}

void v2v_fft_lanes_destroy(struct v2v_fft_lanes **plan)
{
    struct v2v_fft_lanes *old = *plan;
    *plan = NULL;
    if (old != NULL) {
        v2v_mem_free(old->twiddles);
        v2v_mem_free(old->real_twiddles);
        v2v_mem_free(old);
    }
}

/* ---- one step ---- */

struct planes {
    float *re, *im;
};

/* From x to y. */
struct step {
    struct planes x, y;
    int64_t runs, length;               /* m; s, in floats */
    const struct v2v_complex *twiddles; /* [m,r-1] */
};

static inline struct v2v_complex add(struct v2v_complex a, struct v2v_complex b)
{
    return (struct v2v_complex){a.re + b.re, a.im + b.im};
}

static inline struct v2v_complex subtract(struct v2v_complex a, struct v2v_complex b)
{
    return (struct v2v_complex){a.re - b.re, a.im - b.im};
}

static inline struct v2v_complex times(struct v2v_complex a, struct v2v_complex b)
{
    return (struct v2v_complex){a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
}

/* a + c b. */
static inline struct v2v_complex plus(struct v2v_complex a, float c, struct v2v_complex b)
{
    return (struct v2v_complex){a.re + c * b.re, a.im + c * b.im};
}

/* -i a. */
static inline struct v2v_complex rotated(struct v2v_complex a)
{
    return (struct v2v_complex){a.im, -a.re};
}

static inline struct v2v_complex at(struct planes x, int64_t i)
{
    return (struct v2v_complex){x.re[i], x.im[i]};
}

static inline void put(struct planes y, int64_t i, struct v2v_complex a)
{
    y.re[i] = a.re;
    y.im[i] = a.im;
}

/* From float `first` on. */
static inline struct planes from(struct planes x, int64_t first)
{
    return (struct planes){x.re + first, x.im + first};
}

V2V_SIMD_CLONES
static void step_2(const struct step *step)
{
    const int64_t s = step->length, apart = step->runs * s;
    for (int64_t p = 0; p < step->runs; p++) {
        const struct planes x = from(step->x, p * s), y = from(step->y, 2 * p * s);
        const struct v2v_complex w = step->twiddles[p];
#pragma omp simd
        for (int64_t i = 0; i < s; i++) {
            const struct v2v_complex a = at(x, i), b = at(x, i + apart);
            put(y, i, add(a, b));
            put(y, i + s, times(subtract(a, b), w));
        }
    }
}

V2V_SIMD_CLONES
static void step_3(const struct step *step)
{
    const float sine = 0.866025403784438647f; /* of 2 pi / 3 */
    const int64_t s = step->length, apart = step->runs * s;
    for (int64_t p = 0; p < step->runs; p++) {
        const struct planes x = from(step->x, p * s), y = from(step->y, 3 * p * s);
        const struct v2v_complex w1 = step->twiddles[2 * p], w2 = step->twiddles[2 * p + 1];
#pragma omp simd
        for (int64_t i = 0; i < s; i++) {
            const struct v2v_complex a = at(x, i), b = at(x, i + apart), c = at(x, i + 2 * apart);
            const struct v2v_complex sum = add(b, c), even = plus(a, -0.5f, sum);
            const struct v2v_complex odd = rotated(subtract(b, c));
            put(y, i, add(a, sum));
            put(y, i + s, times(plus(even, sine, odd), w1));
            put(y, i + 2 * s, times(plus(even, -sine, odd), w2));
        }
    }
}

V2V_SIMD_CLONES
static void step_4(const struct step *step)
{
    const int64_t s = step->length, apart = step->runs * s;
    for (int64_t p = 0; p < step->runs; p++) {
        const struct planes x = from(step->x, p * s), y = from(step->y, 4 * p * s);
        const struct v2v_complex *w = step->twiddles + 3 * p;
        const struct v2v_complex w1 = w[0], w2 = w[1], w3 = w[2];
#pragma omp simd
        for (int64_t i = 0; i < s; i++) {
            const struct v2v_complex a = at(x, i), b = at(x, i + apart);
            const struct v2v_complex c = at(x, i + 2 * apart), d = at(x, i + 3 * apart);
            const struct v2v_complex ac = add(a, c), a_c = subtract(a, c);
            const struct v2v_complex bd = add(b, d), b_d = rotated(subtract(b, d));
            put(y, i, add(ac, bd));
            put(y, i + s, times(add(a_c, b_d), w1));
            put(y, i + 2 * s, times(subtract(ac, bd), w2));
            put(y, i + 3 * s, times(subtract(a_c, b_d), w3));
        }
    }
}

V2V_SIMD_CLONES
static void step_5(const struct step *step)
{
    const float c1 = 0.309016994374947424f, c2 = -0.809016994374947424f; /* cos 2 pi k / 5 */
    const float s1 = 0.951056516295153572f, s2 = 0.587785252292473129f;  /* sin */
    const int64_t s = step->length, apart = step->runs * s;
    for (int64_t p = 0; p < step->runs; p++) {
        const struct planes x = from(step->x, p * s), y = from(step->y, 5 * p * s);
        const struct v2v_complex *w = step->twiddles + 4 * p;
        const struct v2v_complex w1 = w[0], w2 = w[1], w3 = w[2], w4 = w[3];
#pragma omp simd
        for (int64_t i = 0; i < s; i++) {
            const struct v2v_complex a = at(x, i), b = at(x, i + apart), c = at(x, i + 2 * apart);
            const struct v2v_complex d = at(x, i + 3 * apart), e = at(x, i + 4 * apart);
            const struct v2v_complex be = add(b, e), b_e = rotated(subtract(b, e));
            const struct v2v_complex cd = add(c, d), c_d = rotated(subtract(c, d));
            const struct v2v_complex even_1 = plus(plus(a, c1, be), c2, cd);
            const struct v2v_complex even_2 = plus(plus(a, c2, be), c1, cd);
            const struct v2v_complex none = {0.0f, 0.0f};
            const struct v2v_complex odd_1 = plus(plus(none, s1, b_e), s2, c_d);
            const struct v2v_complex odd_2 = plus(plus(none, s2, b_e), -s1, c_d);
            put(y, i, add(add(a, be), cd));
            put(y, i + s, times(add(even_1, odd_1), w1));
            put(y, i + 2 * s, times(add(even_2, odd_2), w2));
            put(y, i + 3 * s, times(subtract(even_2, odd_2), w3));
            put(y, i + 4 * s, times(subtract(even_1, odd_1), w4));
        }
    }
}

/* Cosines or sines of 2 pi k / 7 times three numbers, to which `first` is added. */
static inline struct v2v_complex plus_three(struct v2v_complex first, float f, struct v2v_complex a,
                                            float g, struct v2v_complex b, float h,
                                            struct v2v_complex c)
{
    return plus(plus(plus(first, f, a), g, b), h, c);
}

V2V_SIMD_CLONES
static void step_7(const struct step *step)
{
    const float c1 = 0.623489801858733531f, c2 = -0.222520933956314404f; /* cos 2 pi k / 7 */
    const float c3 = -0.900968867902419126f;
    const float s1 = 0.781831482468029809f, s2 = 0.974927912181823607f; /* sin */
    const float s3 = 0.433883739117558120f;
    const int64_t s = step->length, apart = step->runs * s;
    for (int64_t p = 0; p < step->runs; p++) {
        const struct planes x = from(step->x, p * s), y = from(step->y, 7 * p * s);
        const struct v2v_complex *w = step->twiddles + 6 * p;
        const struct v2v_complex w1 = w[0], w2 = w[1], w3 = w[2], w4 = w[3], w5 = w[4], w6 = w[5];
#pragma omp simd
        for (int64_t i = 0; i < s; i++) {
            const struct v2v_complex a = at(x, i), none = {0.0f, 0.0f};
            const struct v2v_complex b = at(x, i + apart), g = at(x, i + 6 * apart);
            const struct v2v_complex c = at(x, i + 2 * apart), f = at(x, i + 5 * apart);
            const struct v2v_complex d = at(x, i + 3 * apart), e = at(x, i + 4 * apart);
            const struct v2v_complex bg = add(b, g), b_g = rotated(subtract(b, g));
            const struct v2v_complex cf = add(c, f), c_f = rotated(subtract(c, f));
            const struct v2v_complex de = add(d, e), d_e = rotated(subtract(d, e));
            const struct v2v_complex even_1 = plus_three(a, c1, bg, c2, cf, c3, de);
            const struct v2v_complex even_2 = plus_three(a, c2, bg, c3, cf, c1, de);
            const struct v2v_complex even_3 = plus_three(a, c3, bg, c1, cf, c2, de);
            const struct v2v_complex odd_1 = plus_three(none, s1, b_g, s2, c_f, s3, d_e);
            const struct v2v_complex odd_2 = plus_three(none, s2, b_g, -s3, c_f, -s1, d_e);
            const struct v2v_complex odd_3 = plus_three(none, s3, b_g, -s1, c_f, s2, d_e);
            put(y, i, add(add(add(a, bg), cf), de));
            put(y, i + s, times(add(even_1, odd_1), w1));
            put(y, i + 2 * s, times(add(even_2, odd_2), w2));
            put(y, i + 3 * s, times(add(even_3, odd_3), w3));
            put(y, i + 4 * s, times(subtract(even_3, odd_3), w4));
            put(y, i + 5 * s, times(subtract(even_2, odd_2), w5));
            put(y, i + 6 * s, times(subtract(even_1, odd_1), w6));
        }
    }
}

static void (*const step_of[])(const struct step *step) = {
    [2] = step_2, [3] = step_3, [4] = step_4, [5] = step_5, [7] = step_7};

void v2v_fft_lanes_forward(const struct v2v_fft_lanes *plan, struct v2v_lanes *lanes)
{
    struct step step = {{lanes->re, lanes->im},
                        {lanes->other_re, lanes->other_im},
                        plan->n,
                        V2V_LANES,
                        plan->twiddles};
    for (int q = 0; q < plan->steps; q++) {
        const int r = plan->radix[q];
        const struct planes x = step.x;
        step.runs /= r;
        step_of[r](&step);
        step.twiddles += step.runs * (r - 1);
        step.length *= r;
        step.x = step.y;
        step.y = x;
    }
    *lanes = (struct v2v_lanes){step.x.re, step.x.im, step.y.re, step.y.im};
}

/* The inverse of re + i im is what the transform makes of im + i re, its parts exchanged. */
void v2v_fft_lanes_inverse(const struct v2v_fft_lanes *plan, struct v2v_lanes *lanes)
{
    struct v2v_lanes swapped = {lanes->im, lanes->re, lanes->other_im, lanes->other_re};
    v2v_fft_lanes_forward(plan, &swapped);
    *lanes = (struct v2v_lanes){swapped.im, swapped.re, swapped.other_im, swapped.other_re};
}

/* ---- real signals ---- */

static inline struct v2v_complex conjugate(struct v2v_complex a)
{
    return (struct v2v_complex){a.re, -a.im};
}

/* z, of x[2i] + i x[2i+1], becomes the spectrum of x: of numbers k and n-k the even samples' and,
 * turned, the odd samples'. */
V2V_SIMD_CLONES
static void untangle(struct planes z, const struct v2v_complex *twiddles, int64_t n)
{
    for (int64_t f = 0; f < V2V_LANES; f++) {
        const struct v2v_complex a = at(z, f);
        put(z, f, (struct v2v_complex){a.re + a.im, 0.0f});
        put(z, n * V2V_LANES + f, (struct v2v_complex){a.re - a.im, 0.0f});
    }
    for (int64_t k = 1; k <= n / 2; k++) {
        const struct planes z_k = from(z, k * V2V_LANES), z_l = from(z, (n - k) * V2V_LANES);
        const struct v2v_complex w = twiddles[k];
#pragma omp simd
        for (int64_t f = 0; f < V2V_LANES; f++) {
            const struct v2v_complex a = at(z_k, f), b = conjugate(at(z_l, f));
            const struct v2v_complex even = add(a, b), odd = times(rotated(subtract(a, b)), w);
            const struct v2v_complex none = {0.0f, 0.0f};
            put(z_k, f, plus(none, 0.5f, add(even, odd)));
            put(z_l, f, plus(none, 0.5f, conjugate(subtract(even, odd))));
        }
    }
}

/* The way back, times 2. */
V2V_SIMD_CLONES
static void tangle(struct planes z, const struct v2v_complex *twiddles, int64_t n)
{
    for (int64_t f = 0; f < V2V_LANES; f++) {
        const float first = z.re[f], last = z.re[n * V2V_LANES + f];
        put(z, f, (struct v2v_complex){first + last, first - last});
    }
    for (int64_t k = 1; k <= n / 2; k++) {
        const struct planes z_k = from(z, k * V2V_LANES), z_l = from(z, (n - k) * V2V_LANES);
        const struct v2v_complex w = conjugate(twiddles[k]);
#pragma omp simd
        for (int64_t f = 0; f < V2V_LANES; f++) {
            const struct v2v_complex a = at(z_k, f), b = conjugate(at(z_l, f));
            const struct v2v_complex even = add(a, b), odd = rotated(times(subtract(a, b), w));
            put(z_k, f, subtract(even, odd));
            put(z_l, f, conjugate(add(even, odd)));
        }
    }
}

void v2v_fft_lanes_real_forward(const struct v2v_fft_lanes *plan, struct v2v_lanes *lanes)
{
    v2v_fft_lanes_forward(plan, lanes);
    untangle((struct planes){lanes->re, lanes->im}, plan->real_twiddles, plan->n);
}

void v2v_fft_lanes_real_inverse(const struct v2v_fft_lanes *plan, struct v2v_lanes *lanes)
{
    tangle((struct planes){lanes->re, lanes->im}, plan->real_twiddles, plan->n);
    v2v_fft_lanes_inverse(plan, lanes);
}
