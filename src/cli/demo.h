/** Parts of `v2v3d demo`: the rival's curve, the pictures, the table. */
#ifndef V2V_CLI_DEMO_H
#define V2V_CLI_DEMO_H

#include "cli/command.h"
#include "cli/evaluation.h"
#include "v2v3d/io/file.h"

/** What the table compares. */
enum v2v_demo_row {
    V2V_DEMO_NETWORK,  /**< the trained network */
    V2V_DEMO_RLD,      /**< Richardson-Lucy, as many iterations as configured */
    V2V_DEMO_RLD_BEST, /**< the iteration that the truth likes best: no user could know it */
    V2V_DEMO_ROWS
};

struct v2v_demo {
    struct v2v_session *session;
    const char *folder;
    struct v2v_evaluation evaluation[V2V_DEMO_ROWS];
    double *curve;      /**< PSNR of RLD on frame 0, [0 .. iterations]; 0: the empty volume */
    int64_t iterations; /**< demo.rld_iterations */
    int64_t best;       /**< index of the curve's maximum from 1 on */
    double seconds;
    int lock; /**< rank 0: of the folder; -1: none */
    char lock_name[V2V_PATH_BYTES];
};

/** Path of a file in the demo's folder. @kind Local */
enum v2v_status v2v_demo_path(char path[V2V_PATH_BYTES], const struct v2v_demo *demo,
                              const char *name) V2V_MUST_CHECK;

/** rld.h5 after all iterations and rld_best.h5, of each frame the iteration that the truth likes
 *  best; sets curve and best, on the rank that prints. @kind Collective(world), agreed */
enum v2v_status v2v_demo_deconvolve(struct v2v_demo *demo) V2V_MUST_CHECK;

/** comparison.png: first view | RLD | V2V3D | truth, one grey scale.
 *  @kind Collective(world), agreed */
enum v2v_status v2v_demo_pictures(const struct v2v_demo *demo) V2V_MUST_CHECK;

/** results.txt (and the same on stdout) and results.json. @kind Rank-0 */
enum v2v_status v2v_demo_table(const struct v2v_demo *demo) V2V_MUST_CHECK;

#endif
