#include "cli/steps.h"
#include "cli/unused_settings.h"

#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/nn/rule.h"
#include <inttypes.h>

struct init_arguments {
    struct v2v_common common;
    const char *psf, *output;
    int rule;
    int64_t seed;
};

static const struct v2v_option init_options[] = {
    V2V_OPTION_PSF(struct init_arguments, psf, 1),
    V2V_OPTION_OUTPUT(struct init_arguments, output, "weights to write"),
    V2V_OPTION_SET("width", "model.width", "N", "channels of the U-Nets; the paper's n = 128"),
    V2V_OPTION_SET("features", "model.features", "N", "features of a view"),
    {.name = "rule",
     .kind = V2V_OPTION_CHOICE,
     .at = offsetof(struct init_arguments, rule),
     .value = "kaiming|hash|he",
     .help = "kaiming: PyTorch's default; he: He et al. 2015, biases 0, small last layer; hash: as "
             "the golden vectors",
     .initial = "kaiming"},
    {.name = "seed",
     .kind = V2V_OPTION_INTEGER,
     .at = offsetof(struct init_arguments, seed),
     .value = "N",
     .help = "of the numbers",
     .initial = "1",
     .least = 0,
     .most = 1e15},
    {0}};

/* Rank 0 alone: draw and write. */
static enum v2v_status write_weights(const struct init_arguments *given,
                                     const struct v2v_config *config,
                                     const struct v2v_psf_file *psf)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_schema schema = {0};
    float *weights = NULL;
    struct v2v_weights_info info;
    const struct v2v_network_spec spec = {
        .config = config, .views = psf->views, .slices = psf->slices, .outputs = V2V_NETWORK_ALL};
    V2V_TRY(v2v_network_describe(&info, config, psf->views, psf->slices, 0));
    info.psf_sum = v2v_psf_file_sum(psf);
    V2V_TRY(v2v_network_schema(&schema, config->model.method, &spec));
    V2V_TRY(V2V_ALLOC(weights, "weights.init", schema.fields.total));
    V2V_TRY(v2v_rule_weights(&schema.fields, weights, given->rule, given->seed));
    V2V_TRY(v2v_weights_file_write(given->output, &info, &schema.fields,
                                   (const float *const[V2V_WEIGHTS_GROUPS]){weights}, NULL, NULL));
done:
    v2v_mem_free(weights);
    v2v_schema_fini(&schema);
    return rc;
}

static enum v2v_status init(const void *arguments, struct v2v_session *session)
{
    const struct init_arguments *given = arguments;
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file psf = {0};
    const struct v2v_network_ops *network = NULL;
    V2V_TRY(v2v_step_output(session, given->output, &given->psf, 1));
    V2V_TRY(v2v_step_psf(session, &psf, given->psf));
    V2V_TRY(v2v_network_find(&network, session->config.model.method));
    if (v2v_step_on_root(session)) {
        v2v_unused_settings_warn_training(network, session);
        rc = write_weights(given, &session->config, &psf);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_log(V2V_LOG_INFO, "%s: %s, %" PRId64 " views, %" PRId64 " slices", given->output,
            session->config.model.method, psf.views, psf.slices);
done:
    v2v_psf_file_fini(&psf);
    return rc;
}

const struct v2v_command v2v_command_weights_init = {.name = "weights init",
                                                     .summary = "fresh weights, by initialiser",
                                                     .options = init_options,
                                                     .bytes = sizeof(struct init_arguments),
                                                     .run = init};
