#ifndef V2V3D_BASE_RANDOM_H
#define V2V3D_BASE_RANDOM_H
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Counter-based random numbers: the number depends on (seed, stream, index) alone, so any rank
 *  can draw any sample. Philox 4x32-10 (Salmon et al., SC 2011). All @kind Local. */
uint64_t v2v_random_bits(uint64_t seed, uint64_t stream, uint64_t index);

/** Uniform in [0, 1), 53 bits. */
double v2v_random_uniform(uint64_t seed, uint64_t stream, uint64_t index);

/** Uniform integer in [0, n), n >= 1. */
int64_t v2v_random_below(uint64_t seed, uint64_t stream, uint64_t index, int64_t n);

/** Standard normal (Box-Muller). */
double v2v_random_normal(uint64_t seed, uint64_t stream, uint64_t index);

/** Poisson of the given mean >= 0; exact (inversion, or Hoermann's PTRS above 30). */
int64_t v2v_random_poisson(uint64_t seed, uint64_t stream, uint64_t index, double mean);

/** splitmix64 and FNV-1a 64 as in REFERENCE.md 9, and their uniform number in [-1, 1):
 *  (splitmix64(fnv1a64(name) + seed + index) >> 40) * 2^-23 - 1. */
uint64_t v2v_random_splitmix64(uint64_t x);
uint64_t v2v_random_fnv1a64(const char *text);
double v2v_random_rule(const char *name, uint64_t seed, uint64_t index);

#ifdef __cplusplus
}
#endif

#endif
