#ifndef EVAL_UNCERTAINTY_H
#define EVAL_UNCERTAINTY_H

#include <stdint.h>

/** What a volume may be wrong by, from volumes of half of the views each: its jackknife root mean
 *  square error.
 *      a[z,y,x] <- root of the mean over 5 x 5 pixels of ((a - b) / 2)^2 + (c - (a + b) / 2)^2
 *  The first is the variance of the mean of a and b, where their errors are independent of each
 *  other. The second is the square of c's bias, where that is twice as large with half of the
 *  views: what a prior does to all volumes alike is in no difference of a and b. One voxel's
 *  figures are single draws, the neighbours' (fewer at a slice's edges) a spread.
 *  It tells where to look more than how much: tests/bench/views.md has it beside true errors.
 *  @kind   Local, no allocation
 *  @param  a, b [z,y,x] of disjoint halves of the views @param c of all @param scratch [y,x]
 *  @source M. H. Quenouille, Biometrika 43, 353 (1956); B. Efron, SIAM CBMS-NSF 38 (1982), with the
 *          two halves as groups */
void v2v_uncertainty_of(float *a, const float *b, const float *c, float *scratch, int64_t slices,
                        int64_t height, int64_t width);

#endif
