#include "v2v3d/eval/settle.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/first_seen.h"
#include "v2v3d/method/fusion.h"
#include "v2v3d/par/agreement.h"

enum v2v_status v2v_settle_by_frame(struct v2v_config *config, const struct v2v_estimator_ops *ops,
                                    const struct v2v_problem *problem,
                                    struct v2v_recording *recording,
                                    const struct v2v_scaling *scaling, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int64_t count = problem->psf->views;
    const int64_t samples = v2v_mem_product(count, problem->height, problem->width);
    int64_t frame = 0;
    int is_seen = 0;
    const int noise = config->deconv.noise;
    struct v2v_fusion *fusion = NULL;
    float *views = NULL;
    if (!v2v_estimator_is_open(ops, config)) {
        return V2V_OK;
    }
    V2V_TRY(v2v_first_seen(&frame, &is_seen, recording, scaling, comm));
    rc = V2V_ALLOC(views, "eval.settle", samples);
    if (rc == V2V_OK) {
        rc = v2v_fusion_create(&fusion, config->recon.neighbours, count, problem->height,
                               problem->width, ops->leaves_blind);
    }
    if (rc == V2V_OK) {
        rc = v2v_fusion_read(fusion, views, recording, scaling, frame);
    }
    V2V_TRY(v2v_par_agree(comm, rc));
    V2V_TRY(v2v_estimator_settle(config, ops, problem, views, v2v_fusion_averaging(fusion), comm));
    if (config->deconv.noise != noise) {
        v2v_log(V2V_LOG_INFO, "noise %s, by the first frame%s",
                config->deconv.noise == V2V_NOISE_MODEL_POISSON ? "poisson" : "gaussian",
                frame > 0 ? " that shows something" : "");
    }
done:
    v2v_fusion_destroy(&fusion);
    v2v_mem_free(views);
    return rc;
}
