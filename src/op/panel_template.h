/* The body of a kernel set; included once by each panel_*.c, which defines
 *   LANES    floats of a vector
 *   ROWS     of sums that stay in registers at a time, two vectors each
 *   TARGET   the instruction set, as a function attribute
 *   KERNEL   the name of the table
 * No include guard: it is a template. */
#include "op/panel_kernel.h"

typedef float vector __attribute__((vector_size(LANES * 4), aligned(4), may_alias));

/* LINE: floats of a cache's line. */
enum { VECTORS = 2, LINE = 16 };

static inline __attribute__((always_inline)) void product_part(float *c, const float *a,
                                                               const float *b, int64_t k, int add)
{
    vector sum[ROWS][VECTORS];
#pragma GCC unroll 8
    for (int r = 0; r < ROWS; r++) {
#pragma GCC unroll 2
        for (int j = 0; j < VECTORS; j++) {
            sum[r][j] = (vector){0};
        }
    }
    for (int64_t i = 0; i < k; i++) {
        vector right[VECTORS];
#pragma GCC unroll 2
        for (int j = 0; j < VECTORS; j++) {
            right[j] = *(const vector *)(b + i * PANEL_COLUMNS + j * LANES);
        }
#pragma GCC unroll 8
        for (int r = 0; r < ROWS; r++) {
#pragma GCC unroll 2
            for (int j = 0; j < VECTORS; j++) {
                sum[r][j] += a[i * PANEL_ROWS + r] * right[j];
            }
        }
    }
#pragma GCC unroll 8
    for (int r = 0; r < ROWS; r++) {
#pragma GCC unroll 2
        for (int j = 0; j < VECTORS; j++) {
            vector *to = (vector *)(c + r * PANEL_COLUMNS + j * LANES);
            if (add) {
                sum[r][j] += *to;
            }
            *to = sum[r][j];
        }
    }
}

TARGET static void product(float *c, const float *a, const float *b, int64_t k, int add)
{
    for (int i = 0; add && i < PANEL_ROWS * PANEL_COLUMNS; i += LINE) {
        __builtin_prefetch(c + i, 1);
    }
    for (int r = 0; r < PANEL_ROWS; r += ROWS) {
        for (int x = 0; x < PANEL_COLUMNS; x += VECTORS * LANES) {
            product_part(c + r * PANEL_COLUMNS + x, a + r, b + x, k, add);
        }
    }
}

typedef float eight __attribute__((vector_size(32), aligned(4), may_alias));
typedef int32_t places __attribute__((vector_size(32)));

/* Three rounds that exchange blocks of 4, 2 and 1 between rows as far apart. */
static inline __attribute__((always_inline)) void exchange(eight *row, int apart, places low,
                                                           places high)
{
#pragma GCC unroll 8
    for (int i = 0; i < PANEL_ROWS; i++) {
        if ((i & apart) == 0) {
            eight a = row[i], b = row[i + apart];
            row[i] = __builtin_shuffle(a, b, low);
            row[i + apart] = __builtin_shuffle(a, b, high);
        }
    }
}

TARGET static void turn(float *to, int64_t to_row, const float *from, int64_t from_row)
{
    eight row[PANEL_ROWS];
#pragma GCC unroll 8
    for (int i = 0; i < PANEL_ROWS; i++) {
        row[i] = *(const eight *)(from + i * from_row);
    }
    exchange(row, 4, (places){0, 1, 2, 3, 8, 9, 10, 11}, (places){4, 5, 6, 7, 12, 13, 14, 15});
    exchange(row, 2, (places){0, 1, 8, 9, 4, 5, 12, 13}, (places){2, 3, 10, 11, 6, 7, 14, 15});
    exchange(row, 1, (places){0, 8, 2, 10, 4, 12, 6, 14}, (places){1, 9, 3, 11, 5, 13, 7, 15});
#pragma GCC unroll 8
    for (int i = 0; i < PANEL_ROWS; i++) {
        *(eight *)(to + i * to_row) = row[i];
    }
}

const struct panel_kernel KERNEL = {.product = product, .turn = turn};
