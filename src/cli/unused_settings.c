#include "cli/unused_settings.h"

#include "cli/volumes.h"
#include "v2v3d/base/log.h"
#include <string.h>

static const char *const gain[] = {"input.gain", NULL}, *const method[] = {"deconv.method", NULL};

/* Of section recon; the others are every method's, or are refused where a method can't do it. */
static const char *const of_some[] = {"recon.strength", "recon.combine", "recon.refresh",
                                      "recon.precision", NULL};

/* Keys, and whole sections, which end in a point. */
static int is_among(const char *const *keys, const char *key, int length)
{
    for (; *keys != NULL; keys++) {
        const int known = (int)strlen(*keys);
        const int is_section = known > 0 && (*keys)[known - 1] == '.';
        if (length >= known && strncmp(*keys, key, (size_t)known) == 0 &&
            (is_section || length == known)) {
            return 1;
        }
    }
    return 0;
}

/* What calibrate decides itself, demo of its RLD, and evaluate where it leaves views out (by tv, as
 * calibrate), and what is of volumes. */
static const struct {
    const char *command;
    const char *const *keys;
} left_aside[] = {
    {"calibrate",
     (const char *const[]){"deconv.method", "deconv.iterations", "deconv.stop", "deconv.weight",
                           "deconv.lambda", "deconv.noise", "deconv.curvature", "deconv.sparsity",
                           "deconv.electrons_per_count", "deconv.read_noise", "recon.",
                           "input.gain", "psf.reduce", NULL}},
    {"demo", (const char *const[]){"deconv.method", "deconv.iterations", "deconv.stop", NULL}},
    {"denoise", (const char *const[]){"deconv.", "recon.", NULL}},
    {"evaluate", (const char *const[]){"deconv.method", "deconv.iterations", "deconv.stop",
                                       "deconv.weight", NULL}}};

/* Those that a network's training goes by where it lists them, and terms of the loss that only
 * views which it has not seen have. */
static const char *const of_some_networks[] = {
    "model.width", "model.features",    "model.volume_scale", "model.view_split", "model.view_seed",
    "model.align", "model.homogeneous", "model.merge",        "recon.neighbours", NULL};
static const char *const of_unseen_views[] = {"loss.fft", "loss.pos",     "loss.dc",
                                              "loss.tv",  "loss.profile", NULL};

/* Of one network, or method, each. */
static const char *const sections[] = {"vcdnet.",    "backconv.", "deepcad.",
                                       "synthesis.", "diner.",    NULL};

static int is_of_another(const struct v2v_network_ops *ops, const char *key, int length)
{
    const size_t own = strlen(ops->name);
    const int is_own = strncmp(key, ops->name, own) == 0 && key[own] == '.';
    return is_among(sections, key, length) && !is_own;
}

/* Of the other schedule of the learning rate. */
static const char *const of_steps[] = {"train.decay", "train.decay_at", NULL};

static int is_of_a_method(const struct v2v_estimator_ops *ops, const char *key, int length)
{
    static const char section[] = "deconv.";
    const int is_deconv = strncmp(key, section, strlen(section)) == 0 &&
                          (ops->is_learned || !is_among(method, key, length));
    const int is_gain = !ops->has_gain && is_among(gain, key, length);
    return is_deconv || is_gain || is_among(of_some, key, length);
}

/* The key of setting i of the command line. */
static const char *key_of(const struct v2v_common *common, int64_t i, int *length)
{
    const struct v2v_assignment *given = &common->assignments[i];
    const char *key = given->key != NULL ? given->key : given->text;
    *length = (int)strcspn(key, "=");
    return key;
}

void v2v_unused_settings_warn(const struct v2v_estimator_ops *ops,
                              const struct v2v_session *session)
{
    const struct v2v_common *common = session->common;
    for (int64_t i = 0; i < common->assignment_count; i++) {
        int length = 0;
        const char *key = key_of(common, i, &length);
        if (is_of_a_method(ops, key, length) && !is_among(ops->keys, key, length)) {
            v2v_log(V2V_LOG_WARNING, "%.*s is not a setting of %s%s", length, key,
                    ops->is_learned ? "this network" : "--method ",
                    ops->is_learned ? "" : ops->name);
        }
    }
    if (v2v_options_set(common, "recon.refresh") &&
        !(v2v_volumes_skip(&session->config.recon.skip, ops, NULL) > 0.0)) {
        v2v_log(V2V_LOG_WARNING, "recon.refresh is of skipping over time, which is off (--skip)");
    }
}

void v2v_unused_settings_warn_training(const struct v2v_network_ops *ops,
                                       const struct v2v_session *session)
{
    const struct v2v_common *common = session->common;
    const int is_falling = session->config.train.schedule == V2V_SCHEDULE_LINEAR;
    v2v_unused_settings_warn(v2v_estimator_of_network(ops), session);
    for (int64_t i = 0; i < common->assignment_count; i++) {
        int length = 0;
        const char *key = key_of(common, i, &length);
        if ((is_among(of_some_networks, key, length) && !is_among(ops->keys, key, length)) ||
            (ops->examples != NULL && is_among(of_unseen_views, key, length)) ||
            is_of_another(ops, key, length)) {
            v2v_log(V2V_LOG_WARNING, "%.*s is not a setting of the network '%s'", length, key,
                    ops->name);
        } else if (is_falling && is_among(of_steps, key, length)) {
            v2v_log(V2V_LOG_WARNING, "%.*s is not a setting of train.schedule linear", length, key);
        }
    }
}

void v2v_unused_settings_warn_command(const char *command, const struct v2v_session *session)
{
    const struct v2v_common *common = session->common;
    size_t of = 0;
    while (strcmp(left_aside[of].command, command) != 0) {
        of++;
        V2V_ASSERT(of < sizeof left_aside / sizeof *left_aside);
    }
    for (int64_t i = 0; i < common->assignment_count; i++) {
        int length = 0;
        const char *key = key_of(common, i, &length);
        if (is_among(left_aside[of].keys, key, length)) {
            v2v_log(V2V_LOG_WARNING, "%.*s is not a setting of %s", length, key, command);
        }
    }
}
