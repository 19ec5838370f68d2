/** Matrix products of panels: the kernels, one set for each instruction set.
 *
 *  A panel of a matrix x[rows][columns] is 32 of its columns, [rows][32]; a product takes 8 rows of
 *  the left matrix, transposed, [k][8], and a panel of the right one, and its 8 x 32 sums stay in
 *  registers over all k.
 */
#ifndef OP_PANEL_KERNEL_H
#define OP_PANEL_KERNEL_H

#include <stdint.h>

enum { PANEL_ROWS = 8, PANEL_COLUMNS = 32 };

struct panel_kernel {
    /** c[8][32] = (add: +=) sum over k of a[k][8] b[k][32] */
    void (*product)(float *c, const float *a, const float *b, int64_t k, int add);
    /** to[8][8] = from[8][8] transposed; rows `to_row` and `from_row` floats apart */
    void (*turn)(float *to, int64_t to_row, const float *from, int64_t from_row);
};

extern const struct panel_kernel v2v_panel_avx512;
extern const struct panel_kernel v2v_panel_avx2;
extern const struct panel_kernel v2v_panel_any;

/** The set for this processor. @kind Local. */
const struct panel_kernel *v2v_panel_choose(void);

#endif
