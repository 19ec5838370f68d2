/** How well does a method predict views that it does not see? */
#ifndef V2V_CLI_HELDOUT_H
#define V2V_CLI_HELDOUT_H

#include "cli/command.h"
#include "v2v3d/method/estimator.h"

/** Of the first frame, as recorded: |view - prediction| / |view|, and in units of the noise; NaN:
 *  not known. The same views for every method: two folds of v2v_left_out_folds. A method that takes
 *  any views makes a volume of the others; a network with halves has one already. */
struct v2v_heldout {
    double residual, sigmas;
};

/** @kind   Local: one rank
 *  @param  weights NULL where the method takes none
 *  @param  session with settings and network as v2v_volumes_make left them
 *  @return as v2v_volumes_make */
enum v2v_status v2v_heldout_of(struct v2v_heldout *heldout, const char *psf, const char *input,
                               const char *weights, const struct v2v_estimator_ops *ops,
                               const struct v2v_session *session) V2V_MUST_CHECK;

#endif
