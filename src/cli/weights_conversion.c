#include "cli/weights_conversion.h"

#include "cli/steps.h"
#include "v2v3d/base/log.h"
#include "v2v3d/method/weights.h"
#include <inttypes.h>
#include <string.h>

/* What the file did not say: the rest is as configured. */
static void tell(const char *path, const struct v2v_weights *weights)
{
    const struct v2v_weights_info *info = &weights->info;
    char settings[V2V_WEIGHTS_SETTINGS_BYTES] = "";
    if (weights->is_ours) {
        return;
    }
    for (size_t i = 0; info->settings[i] != '\0'; i++) { /* lines become words */
        settings[i] = info->settings[i] != '\n' ? info->settings[i] : ' ';
    }
    v2v_log(V2V_LOG_INFO,
            "%s: by its names the network %s, by its shapes of %" PRId64 " views and %" PRId64
            " slices; taken to be %ssplit=%s",
            path, info->method, info->views, info->slices, settings, info->split);
}

static enum v2v_status convert(const struct v2v_session *session, const char *input,
                               const char *output)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_weights weights = {0};
    const struct v2v_weights_hints hints = {.config = &session->config,
                                            .views = session->config.input.views,
                                            .slices = session->config.input.slices};
    V2V_TRY(v2v_weights_read(&weights, input, &hints));
    tell(input, &weights);
    V2V_TRY(
        v2v_weights_write(&weights, output, v2v_file_kind_of_name(output) == V2V_FILE_SAFETENSORS));
done:
    v2v_weights_fini(&weights);
    return rc;
}

enum v2v_status v2v_convert_weights(const struct v2v_session *session, const char *input,
                                    const char *output)
{
    enum v2v_status rc = V2V_OK;
    const enum v2v_file_kind kind = v2v_file_kind_of_name(output);
    if (kind != V2V_FILE_HDF5 && kind != V2V_FILE_SAFETENSORS) {
        rc = V2V_FAIL(V2V_E_USAGE, "%s: weights are written as .h5 or .safetensors", output);
    } else if (v2v_step_on_root(session)) {
        rc = convert(session, input, output);
    }
    return v2v_par_agree(session->world, rc);
}
