#include "cli/unused_settings.h"

#include "v2v3d/base/log.h"
#include <string.h>

static const char *const gain[] = {"input.gain", NULL}, *const method[] = {"deconv.method", NULL};

/* Of section recon; the others are every method's, or are refused where a method can't do it. */
static const char *const of_some[] = {"recon.strength", "recon.combine", "recon.refresh",
                                      "recon.precision", NULL};

static int is_among(const char *const *keys, const char *key, int length)
{
    while (*keys != NULL && (strncmp(*keys, key, (size_t)length) != 0 || (*keys)[length] != '\0')) {
        keys++;
    }
    return *keys != NULL;
}

static int is_of_a_method(const struct v2v_estimator_ops *ops, const char *key, int length)
{
    static const char section[] = "deconv.";
    const int is_deconv =
        strncmp(key, section, strlen(section)) == 0 && !is_among(method, key, length);
    const int is_gain = !ops->has_gain && is_among(gain, key, length);
    return (is_deconv && !ops->is_learned) || is_gain || is_among(of_some, key, length);
}

void v2v_unused_settings_warn(const struct v2v_estimator_ops *ops,
                              const struct v2v_session *session)
{
    const struct v2v_common *common = session->common;
    for (int64_t i = 0; i < common->assignment_count; i++) {
        const struct v2v_assignment *given = &common->assignments[i];
        const char *key = given->key != NULL ? given->key : given->text;
        const int length = (int)strcspn(key, "=");
        if (is_of_a_method(ops, key, length) && !is_among(ops->keys, key, length)) {
            v2v_log(V2V_LOG_WARNING, "%.*s is not a setting of %s%s", length, key,
                    ops->is_learned ? "this network" : "--method ",
                    ops->is_learned ? "" : ops->name);
        }
    }
}
