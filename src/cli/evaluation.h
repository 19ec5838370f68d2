/** Scores of a volume file, frame by frame: `evaluate` prints them, `demo` puts them in a table. */
#ifndef V2V_CLI_EVALUATION_H
#define V2V_CLI_EVALUATION_H

#include "cli/command.h"

enum v2v_figure {
    V2V_FIGURE_PSNR,
    V2V_FIGURE_SSIM,
    V2V_FIGURE_BACKGROUND_TRUTH,
    V2V_FIGURE_BACKGROUND_VOLUME,
    V2V_FIGURE_SCALE,
    V2V_FIGURE_RESIDUAL,
    V2V_FIGURE_COUNT
};

/** Names of the figures, as in the JSON. */
extern const char *const v2v_figure_names[V2V_FIGURE_COUNT];

struct v2v_evaluation {
    int64_t frames;
    double *value[V2V_FIGURE_COUNT]; /**< [t]; NULL: not asked for */
    double mean[V2V_FIGURE_COUNT];
};

/** What to evaluate; NULL paths are left out. */
struct v2v_evaluation_job {
    const char *volume;
    const char *truth;
    const char *psf, *input; /**< both or none: residual of the views */
    int64_t slices;          /**< of a TIFF volume that does not say; 0: all pages are one frame */
    int fit_scale;
};

/** Frames go round the ranks. @kind Collective(world), agreed; v2v_evaluation_fini after both */
enum v2v_status v2v_evaluation_run(struct v2v_evaluation *evaluation,
                                   const struct v2v_evaluation_job *job,
                                   const struct v2v_session *session) V2V_MUST_CHECK;
void v2v_evaluation_fini(struct v2v_evaluation *evaluation);

#endif
