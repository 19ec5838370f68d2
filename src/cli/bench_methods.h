/** Run time against error of every method, on a recording of the user's. */
#ifndef V2V_CLI_BENCH_METHODS_H
#define V2V_CLI_BENCH_METHODS_H

#include "cli/command.h"

struct v2v_bench_methods {
    const char *psf, *input;
    const char *truth;        /**< NULL: no PSNR, no SSIM .. */
    int fit_scale;            /**< .. and one least-squares scale a volume */
    struct v2v_words weights; /**< of trained networks; may be none */
    struct v2v_words only;    /**< names of rows; none: all */
    int json;
};

/** One line a row on stdout, as soon as it was measured: the recording's first frame by
 *  deconvolvers with several settings, and by each network.
 *  @kind Local: one rank. @return as v2v_volumes_make */
enum v2v_status v2v_bench_methods(const struct v2v_bench_methods *given,
                                  const struct v2v_session *session) V2V_MUST_CHECK;

#endif
