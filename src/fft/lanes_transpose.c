#include "fft/lanes.h"
#include "v2v3d/base/clones.h"

/* As many signals of half as many numbers, re and im in turn, are a square of floats. Without AVX
 * vectors of eight would be taken apart. */
#ifdef V2V_X86
enum { SIDE = 8 };
#else
enum { SIDE = 4 };
#endif
enum { NUMBERS = SIDE / 2 };
typedef float side __attribute__((vector_size(SIDE * 4), aligned(4), may_alias));

/* to = the transpose of from: halves, then pairs, then single floats change places. */
#ifdef V2V_X86
static inline __attribute__((always_inline)) void transpose(side to[SIDE], const side from[SIDE])
{
    side halves[SIDE], pairs[SIDE];
    for (int i = 0; i < 4; i++) {
        halves[i] = __builtin_shufflevector(from[i], from[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        halves[i + 4] = __builtin_shufflevector(from[i], from[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
    }
    for (int k = 0; k < 4; k++) {
        const int i = k / 2 * 4 + k % 2;
        pairs[i] = __builtin_shufflevector(halves[i], halves[i + 2], 0, 1, 8, 9, 4, 5, 12, 13);
        pairs[i + 2] =
            __builtin_shufflevector(halves[i], halves[i + 2], 2, 3, 10, 11, 6, 7, 14, 15);
    }
    for (int i = 0; i < SIDE; i += 2) {
        to[i] = __builtin_shufflevector(pairs[i], pairs[i + 1], 0, 8, 2, 10, 4, 12, 6, 14);
        to[i + 1] = __builtin_shufflevector(pairs[i], pairs[i + 1], 1, 9, 3, 11, 5, 13, 7, 15);
    }
}
#else
static inline __attribute__((always_inline)) void transpose(side to[SIDE], const side from[SIDE])
{
    side pairs[SIDE];
    for (int i = 0; i < 2; i++) {
        pairs[i] = __builtin_shufflevector(from[i], from[i + 2], 0, 1, 4, 5);
        pairs[i + 2] = __builtin_shufflevector(from[i], from[i + 2], 2, 3, 6, 7);
    }
    for (int i = 0; i < SIDE; i += 2) {
        to[i] = __builtin_shufflevector(pairs[i], pairs[i + 1], 0, 4, 2, 6);
        to[i + 1] = __builtin_shufflevector(pairs[i], pairs[i + 1], 1, 5, 3, 7);
    }
}
#endif

/* The numbers from `first` on, one by one. */
static void take_singly(float *re, float *im, const float *from, int64_t stride, int64_t first,
                        int64_t n, int64_t signals)
{
    for (int64_t i = first; i < n; i++) {
        for (int64_t s = 0; s < V2V_LANES; s++) {
            re[i * V2V_LANES + s] = s < signals ? from[s * stride + 2 * i] : 0.0f;
            im[i * V2V_LANES + s] = s < signals ? from[s * stride + 2 * i + 1] : 0.0f;
        }
    }
}

V2V_SIMD_CLONES
void v2v_lanes_take(float *re, float *im, const float *from, int64_t stride, int64_t n,
                    int64_t signals)
{
    const int64_t whole = n / NUMBERS * NUMBERS;
    for (int64_t i = 0; i < whole; i += NUMBERS) {
        for (int64_t s = 0; s < V2V_LANES; s += SIDE) {
            side rows[SIDE], columns[SIDE];
            for (int k = 0; k < SIDE; k++) {
                rows[k] = s + k < signals ? *(const side *)(from + (s + k) * stride + 2 * i)
                                          : (side){0.0f};
            }
            transpose(columns, rows);
            for (int k = 0; k < NUMBERS; k++) {
                *(side *)(re + (i + k) * V2V_LANES + s) = columns[2 * k];
                *(side *)(im + (i + k) * V2V_LANES + s) = columns[2 * k + 1];
            }
        }
    }
    take_singly(re, im, from, stride, whole, n, signals);
}

static void give_singly(float *to, int64_t stride, const float *re, const float *im, float factor,
                        int64_t first, int64_t n, int64_t signals)
{
    for (int64_t s = 0; s < signals; s++) {
        for (int64_t i = first; i < n; i++) {
            to[s * stride + 2 * i] = factor * re[i * V2V_LANES + s];
            to[s * stride + 2 * i + 1] = factor * im[i * V2V_LANES + s];
        }
    }
}

V2V_SIMD_CLONES
void v2v_lanes_give(float *to, int64_t stride, const float *re, const float *im, float factor,
                    int64_t n, int64_t signals)
{
    const int64_t whole = n / NUMBERS * NUMBERS;
    for (int64_t i = 0; i < whole; i += NUMBERS) {
        for (int64_t s = 0; s < V2V_LANES; s += SIDE) {
            side rows[SIDE], columns[SIDE];
            for (int k = 0; k < NUMBERS; k++) {
                rows[2 * k] = factor * *(const side *)(re + (i + k) * V2V_LANES + s);
                rows[2 * k + 1] = factor * *(const side *)(im + (i + k) * V2V_LANES + s);
            }
            transpose(columns, rows);
            for (int k = 0; k < SIDE && s + k < signals; k++) {
                *(side *)(to + (s + k) * stride + 2 * i) = columns[k];
            }
        }
    }
    give_singly(to, stride, re, im, factor, whole, n, signals);
}

V2V_SIMD_CLONES
void v2v_lanes_take_beside(float *re, float *im, const struct v2v_complex *from, int64_t stride,
                           int64_t n, int64_t signals)
{
    for (int64_t i = 0; i < n; i++, from += stride, re += V2V_LANES, im += V2V_LANES) {
        if (signals == V2V_LANES) {
#pragma omp simd
            for (int64_t s = 0; s < V2V_LANES; s++) {
                re[s] = from[s].re;
                im[s] = from[s].im;
            }
        } else {
            for (int64_t s = 0; s < V2V_LANES; s++) {
                re[s] = s < signals ? from[s].re : 0.0f;
                im[s] = s < signals ? from[s].im : 0.0f;
            }
        }
    }
}

V2V_SIMD_CLONES
void v2v_lanes_give_beside(struct v2v_complex *to, int64_t stride, const float *re, const float *im,
                           int64_t n, int64_t signals)
{
    for (int64_t i = 0; i < n; i++, to += stride, re += V2V_LANES, im += V2V_LANES) {
        if (signals == V2V_LANES) {
#pragma omp simd
            for (int64_t s = 0; s < V2V_LANES; s++) {
                to[s].re = re[s];
                to[s].im = im[s];
            }
        } else {
            for (int64_t s = 0; s < signals; s++) {
                to[s] = (struct v2v_complex){re[s], im[s]};
            }
        }
    }
}
