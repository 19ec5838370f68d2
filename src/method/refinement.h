/** Gains and shifts of the views by what a volume of all of them misses, less what it misses of a
 *  copy whose gains and shifts are known. REFERENCE.md 13. */
#ifndef V2V_METHOD_REFINEMENT_H
#define V2V_METHOD_REFINEMENT_H

#include "method/calibrator.h"

/** Iterations of a round. @kind Local. */
int v2v_refinement_iterations(void);

/** One round, over the place where the calibrator is. @kind Collective(comm).
 *  @param has_shifts whether shifts may change, too
 *  @return as v2v_calibrator_look */
enum v2v_status v2v_refinement_step(struct v2v_calibrator *calibrator,
                                    int has_shifts) V2V_MUST_CHECK;

#endif
