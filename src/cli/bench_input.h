/** What `v2v3d bench` computes on: PSFs, one square frame, its truth. */
#ifndef V2V_CLI_BENCH_INPUT_H
#define V2V_CLI_BENCH_INPUT_H

#include "cli/command.h"
#include "v2v3d/io/psf_file.h"

/** NULL paths are left out. */
struct v2v_bench_paths {
    const char *psf, *input, *truth;
};

struct v2v_bench_input {
    struct v2v_psf_file psf; /**< read, or simulated as section optics says */
    float *views;            /**< [v,size,size]: middle of the first frame, scaled; or by rule */
    float *truth;            /**< [z,size,size]: middle of the first frame; or NULL */
    double gain;             /**< of the views */
};

/** @kind Collective(world) of one rank. @return V2V_OK | V2V_E_INPUT (a frame smaller than `size`;
 *  truth and input that differ) | as the readers; v2v_bench_input_fini after all */
enum v2v_status v2v_bench_input_init(struct v2v_bench_input *input,
                                     const struct v2v_bench_paths *paths, int64_t size,
                                     const struct v2v_session *session) V2V_MUST_CHECK;
void v2v_bench_input_fini(struct v2v_bench_input *input);

#endif
