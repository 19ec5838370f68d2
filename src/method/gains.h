/** Gains of the views by what a volume of all of them misses, less what it misses of a copy whose
 *  gains are known. REFERENCE.md 13. */
#ifndef V2V_METHOD_GAINS_H
#define V2V_METHOD_GAINS_H

#include "method/calibrator.h"

/** Iterations of a round. @kind Local. */
int v2v_gains_iterations(void);

/** One round, over the place where the calibrator is. @kind Collective(comm).
 *  @param  moved out: the largest change of a logarithm @return as v2v_calibrator_look */
enum v2v_status v2v_gains_step(struct v2v_calibrator *calibrator, double *moved) V2V_MUST_CHECK;

#endif
