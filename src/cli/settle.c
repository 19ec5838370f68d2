#include "cli/settle.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/structure.h"
#include "v2v3d/method/fusion.h"
#include "v2v3d/par/agreement.h"
#include "v2v3d/par/watchdog.h"

static int has_light(const float *views, int64_t samples)
{
    int64_t i = 0;
    while (i < samples && !(views[i] > 0.0f)) {
        i++;
    }
    return i < samples;
}

/* The views of the first frame that shows something above its noise; where none does, of the first
 * with a sample above the offset, or of frame 0. Local. */
static enum v2v_status read_lit(float *views, int64_t *frame, struct v2v_fusion *fusion,
                                struct v2v_recording *recording, const struct v2v_scaling *scaling)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t samples = info->views * info->height * info->width;
    int64_t bright = -1;
    for (int64_t t = 0; t < info->frames; t++) {
        v2v_watchdog_beat("looking for a frame that shows something");
        V2V_TRY(v2v_fusion_read(fusion, views, recording, scaling, t));
        if (v2v_structure_is_seen(views, info->views, info->height, info->width)) {
            *frame = t;
            return V2V_OK;
        }
        bright = bright < 0 && has_light(views, samples) ? t : bright;
    }
    *frame = v2v_larger(bright, 0);
    V2V_TRY(v2v_fusion_read(fusion, views, recording, scaling, *frame));
done:
    return rc;
}

enum v2v_status v2v_settle_by_frame(struct v2v_session *session,
                                    const struct v2v_estimator_ops *ops,
                                    const struct v2v_problem *problem,
                                    struct v2v_recording *recording,
                                    const struct v2v_scaling *scaling)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_config *config = &session->config;
    const int64_t count = problem->psf->views;
    const int64_t samples = v2v_mem_product(count, problem->height, problem->width);
    int64_t frame = 0;
    const int noise = config->deconv.noise;
    struct v2v_fusion *fusion = NULL;
    float *views = NULL;
    if (!v2v_estimator_is_open(ops, config)) {
        return V2V_OK;
    }
    rc = V2V_ALLOC(views, "cli.settle", samples);
    if (rc == V2V_OK) {
        rc = v2v_fusion_create(&fusion, config->recon.neighbours, count, problem->height,
                               problem->width);
    }
    if (rc == V2V_OK) {
        rc = read_lit(views, &frame, fusion, recording, scaling);
    }
    v2v_fusion_destroy(&fusion);
    V2V_TRY(v2v_par_agree(session->world, rc));
    V2V_TRY(v2v_estimator_settle(config, ops, problem, views, session->world));
    if (config->deconv.noise != noise) {
        v2v_log(V2V_LOG_INFO, "noise %s, by the first frame%s",
                config->deconv.noise == V2V_NOISE_MODEL_POISSON ? "poisson" : "gaussian",
                frame > 0 ? " that shows something" : "");
    }
done:
    v2v_mem_free(views);
    return rc;
}
