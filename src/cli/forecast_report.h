/** `v2v3d check --scaling`: what this machine's figures make of more ranks than it has. */
#ifndef V2V_CLI_FORECAST_REPORT_H
#define V2V_CLI_FORECAST_REPORT_H

#include "cli/command.h"

struct v2v_forecast_options {
    const char *psf;     /**< NULL: simulated as section optics says */
    const char *scratch; /**< folder to write to; NULL: files take no time */
    int64_t frames, side;
    double link_gb_s, link_delay_us; /**< between hosts, where that cannot be measured */
};

/** Measure and print: the machine's figures, then a step of training as section train says and a
 *  recording of `frames` frames of `side` x `side` over 1, 2, 4, 8, 64 and 512 ranks: the same work
 *  on more ranks (strong), and as much more work (weak).
 *  @kind Collective(world), agreed */
enum v2v_status v2v_forecast_report(const struct v2v_forecast_options *options,
                                    const struct v2v_session *session) V2V_MUST_CHECK;

#endif
