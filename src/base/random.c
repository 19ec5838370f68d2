#include "v2v3d/base/random.h"

#include "base/philox.h"
#include "v2v3d/base/status.h"

#include <math.h>

static const double two_pi = 6.283185307179586;
static const double two_to_minus_53 = 1.0 / 9007199254740992.0;
static const uint64_t golden_gamma = 0x9E3779B97F4A7C15;

/* Two 64-bit words of one Philox block. */
struct words {
    uint64_t a, b;
};

void v2v_philox(uint32_t counter[4], const uint32_t key[2])
{
    uint32_t k0 = key[0], k1 = key[1];
    for (int round = 0; round < 10; round++) {
        uint64_t p0 = (uint64_t)0xD2511F53u * counter[0];
        uint64_t p1 = (uint64_t)0xCD9E8D57u * counter[2];
        uint32_t c1 = counter[1], c3 = counter[3];
        counter[0] = (uint32_t)(p1 >> 32) ^ c1 ^ k0;
        counter[1] = (uint32_t)p1;
        counter[2] = (uint32_t)(p0 >> 32) ^ c3 ^ k1;
        counter[3] = (uint32_t)p0;
        k0 += 0x9E3779B9u;
        k1 += 0xBB67AE85u;
    }
}

/** The block of (seed, stream, index). A draw that is rejected asks for the next `attempt`: the
 * counter is full, so the attempt goes into the key. */
static struct words block(uint64_t seed, uint64_t stream, uint64_t index, uint64_t attempt)
{
    uint64_t k = attempt == 0 ? seed : v2v_random_splitmix64(seed + golden_gamma * attempt);
    uint32_t counter[4] = {(uint32_t)index, (uint32_t)(index >> 32), (uint32_t)stream,
                           (uint32_t)(stream >> 32)};
    uint32_t key[2] = {(uint32_t)k, (uint32_t)(k >> 32)};
    v2v_philox(counter, key);
    return (struct words){counter[0] | (uint64_t)counter[1] << 32,
                          counter[2] | (uint64_t)counter[3] << 32};
}

static double unit(uint64_t bits)
{
    return (double)(bits >> 11) * two_to_minus_53;
}

uint64_t v2v_random_bits(uint64_t seed, uint64_t stream, uint64_t index)
{
    return block(seed, stream, index, 0).a;
}

double v2v_random_uniform(uint64_t seed, uint64_t stream, uint64_t index)
{
    return unit(block(seed, stream, index, 0).a);
}

int64_t v2v_random_below(uint64_t seed, uint64_t stream, uint64_t index, int64_t n)
{
    V2V_ASSERT(n >= 1);
    /* Lemire, ACM TOMACS 29 (2019): the high word of bits * n, with the few low words rejected
     * that would favour some results. */
    uint64_t bound = (uint64_t)n;
    uint64_t least = (0 - bound) % bound;
    for (uint64_t attempt = 0;; attempt++) {
        unsigned __int128 product =
            (unsigned __int128)block(seed, stream, index, attempt).a * bound;
        if ((uint64_t)product >= least) {
            return (int64_t)(product >> 64);
        }
    }
}

double v2v_random_normal(uint64_t seed, uint64_t stream, uint64_t index)
{
    struct words w = block(seed, stream, index, 0);
    double radius = sqrt(-2.0 * log(1.0 - unit(w.a))); /* 1 - [0,1) is never 0 */
    return radius * cos(two_pi * unit(w.b));
}

/** Inversion: walk up the distribution function until it passes u. */
static int64_t poisson_small(double u, double mean)
{
    enum { MOST = 400 }; /* above mean 30 by 67 standard deviations: only round-off gets there */
    double p = exp(-mean);
    double sum = p;
    int64_t k = 0;
    while (u >= sum && k < MOST) {
        k++;
        p *= mean / (double)k;
        sum += p;
    }
    return k;
}

/** Hoermann's transformed rejection PTRS, Insurance: Mathematics and Economics 12 (1993) 39-45. */
static int64_t poisson_large(uint64_t seed, uint64_t stream, uint64_t index, double mean)
{
    const double log_mean = log(mean);
    const double b = 0.931 + 2.53 * sqrt(mean);
    const double a = -0.059 + 0.02483 * b;
    const double inverse_alpha = 1.1239 + 1.1328 / (b - 3.4);
    const double v_r = 0.9277 - 3.6224 / (b - 2.0);
    for (uint64_t attempt = 0;; attempt++) {
        struct words w = block(seed, stream, index, attempt);
        double u = unit(w.a) - 0.5;
        double v = unit(w.b);
        double us = 0.5 - fabs(u);
        double k = floor((2.0 * a / us + b) * u + mean + 0.43);
        if (us >= 0.07 && v <= v_r) {
            return (int64_t)k;
        }
        if (k < 0.0 || (us < 0.013 && v > us)) {
            continue;
        }
        int sign = 0; /* lgamma_r, because lgamma writes a global */
        if (log(v * inverse_alpha / (a / (us * us) + b)) <=
            k * log_mean - mean - lgamma_r(k + 1.0, &sign)) {
            return (int64_t)k;
        }
    }
}

int64_t v2v_random_poisson(uint64_t seed, uint64_t stream, uint64_t index, double mean)
{
    /* Above 1e15 a double no longer holds every whole number. */
    V2V_ASSERT(mean >= 0.0 && mean <= 1e15);
    if (mean <= 30.0) {
        return poisson_small(v2v_random_uniform(seed, stream, index), mean);
    }
    return poisson_large(seed, stream, index, mean);
}

uint64_t v2v_random_splitmix64(uint64_t x)
{
    x += golden_gamma;
    x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9;
    x = (x ^ (x >> 27)) * 0x94D049BB133111EB;
    return x ^ (x >> 31);
}

uint64_t v2v_random_fnv1a64(const char *text)
{
    uint64_t hash = 0xCBF29CE484222325;
    for (const char *c = text; *c != '\0'; c++) {
        hash = (hash ^ (unsigned char)*c) * 0x100000001B3;
    }
    return hash;
}

double v2v_random_rule(const char *name, uint64_t seed, uint64_t index)
{
    uint64_t bits = v2v_random_splitmix64(v2v_random_fnv1a64(name) + seed + index);
    return (double)(bits >> 40) * 0x1p-23 - 1.0;
}
