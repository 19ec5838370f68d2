/** Scores of a volume file, frame by frame: `evaluate` prints them, `demo` puts them in a table. */
#ifndef V2V_CLI_EVALUATION_H
#define V2V_CLI_EVALUATION_H

#include "cli/command.h"
#include "cli/origin.h"
#include "v2v3d/eval/consistency.h"

enum v2v_figure {
    V2V_FIGURE_PSNR,
    V2V_FIGURE_SSIM,
    V2V_FIGURE_BACKGROUND_TRUTH,
    V2V_FIGURE_BACKGROUND_VOLUME,
    V2V_FIGURE_SCALE,
    V2V_FIGURE_RESIDUAL,
    V2V_FIGURE_FLUX,
    V2V_FIGURE_COUNT
};

/** Means over frames of what is known of each view. */
enum v2v_view_figure {
    V2V_VIEW_RESIDUAL,
    V2V_VIEW_RESIDUAL_SIGMAS,
    V2V_VIEW_FLUX,
    V2V_VIEW_HELDOUT,
    V2V_VIEW_HELDOUT_SIGMAS,
    V2V_VIEW_SHIFT_Y,
    V2V_VIEW_SHIFT_X,
    V2V_VIEW_FIGURE_COUNT
};

/** Names of the figures, as in the JSON. */
extern const char *const v2v_figure_names[V2V_FIGURE_COUNT];
extern const char *const v2v_view_figure_names[V2V_VIEW_FIGURE_COUNT];

enum { V2V_WARNING_TEXT = 1024 };

struct v2v_evaluation {
    int64_t frames;
    struct v2v_origin origin;        /**< of the volume */
    double *value[V2V_FIGURE_COUNT]; /**< [t]; NULL: not asked for */
    double mean[V2V_FIGURE_COUNT];
    int64_t views, slices;                  /**< 0: without --psf and --input */
    const char *without_views;              /**< not used, the session's (conf/kept_views.h) */
    double *of_view[V2V_VIEW_FIGURE_COUNT]; /**< [v]; NULL: not asked for */
    struct v2v_consistency consistency;     /**< no frames: not asked for */
    /** Its means over frames; NaN: not known. */
    double heldout, heldout_sigmas, disagreement, resolution, resolution_um;
    double *disagreement_slices; /**< [z]; NULL: not asked for */
    int is_corrected;            /**< bool: a network corrected its volumes */
    char warnings[V2V_WARNING_TEXT];
};

/** What to evaluate; NULL paths are left out. */
struct v2v_evaluation_job {
    const char *volume, *volume_dataset; /**< dataset NULL: /volume */
    const char *truth, *truth_dataset;
    const char *psf, *input; /**< both or none: residual of the views */
    const char *weights;     /**< of the network that made the volume, or NULL; it corrects total
                                  variation where views are left out */
    int64_t heldout_frames;  /**< of which views are left out; 0: of none */
    const char *uncertainty; /**< HDF5 to write, of those frames */
    int fit_scale;
};

/** Frames go round the ranks. @kind Collective(world), agreed; v2v_evaluation_fini after both */
enum v2v_status v2v_evaluation_run(struct v2v_evaluation *evaluation,
                                   const struct v2v_evaluation_job *job,
                                   const struct v2v_session *session) V2V_MUST_CHECK;
/** The part of it that takes --psf and --input. @kind Collective(world), agreed or not */
enum v2v_status v2v_evaluation_of_views(struct v2v_evaluation *evaluation,
                                        const struct v2v_evaluation_job *job,
                                        struct v2v_volume *volume,
                                        const struct v2v_session *session) V2V_MUST_CHECK;
/** As a table, and as one JSON object, on stdout. @kind Local */
void v2v_evaluation_print(const struct v2v_evaluation *evaluation, int fit_scale);
enum v2v_status v2v_evaluation_json(const struct v2v_evaluation *evaluation,
                                    int fit_scale) V2V_MUST_CHECK;
void v2v_evaluation_fini(struct v2v_evaluation *evaluation);

#endif
