#include "v2v3d/method/networks.h"

#include "method/backconv.h"
#include "method/deepcad.h"
#include "method/depth_net.h"
#include "method/synthesis/network.h"
#include "method/vcdnet.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/v2v/network.h"

#include <stdio.h>
#include <string.h>

/* One row a network. */
static const struct v2v_network_ops *const networks[] = {
    &v2v_network_v2v,    &v2v_network_backconv, &v2v_network_depth_net,
    &v2v_network_vcdnet, &v2v_network_deepcad,  &v2v_network_synthesis};

enum { NETWORKS = sizeof networks / sizeof *networks };

int64_t v2v_network_count(void)
{
    return NETWORKS;
}

const struct v2v_network_ops *v2v_network_at(int64_t index)
{
    V2V_ASSERT(index >= 0 && index < NETWORKS);
    return networks[index];
}

enum v2v_status v2v_network_find(const struct v2v_network_ops **ops, const char *name)
{
    const char *known[NETWORKS];
    for (int i = 0; i < NETWORKS; i++) {
        known[i] = networks[i]->name;
        if (strcmp(name, known[i]) == 0) {
            *ops = networks[i];
            return V2V_OK;
        }
    }
    const char *nearest = v2v_text_nearest(name, known, NETWORKS);
    return V2V_FAIL(V2V_E_CONFIG, "model.method: there is no network '%s'%s%s%s", name,
                    nearest != NULL ? "; did you mean '" : "", nearest != NULL ? nearest : "",
                    nearest != NULL ? "'?" : "");
}

/* Does the method offer what is asked for? */
static enum v2v_status check(const struct v2v_network_ops *ops, const struct v2v_network_spec *spec)
{
    const struct {
        unsigned trait;
        int asked;
        const char *what;
    } offers[] = {
        {V2V_TRAIT_SLABS, spec->slabs > 1, "does not compute slabs of a frame"},
        {V2V_TRAIT_SKIPS, spec->skip > 0.0, "skips nothing (--skip off)"},
        {V2V_TRAIT_BF16, spec->precision != V2V_PRECISION_F32, "does not compute in bf16"},
    };
    for (size_t i = 0; i < sizeof offers / sizeof *offers; i++) {
        if (offers[i].asked && !(ops->traits & offers[i].trait)) {
            return V2V_FAIL(V2V_E_CONFIG, "the network '%s' %s", ops->name, offers[i].what);
        }
    }
    if (spec->views < ops->outputs) {
        return V2V_FAIL(V2V_E_INPUT, "training view to view takes %d views or more, not %lld",
                        ops->outputs, (long long)spec->views);
    }
    return V2V_OK;
}

enum v2v_status v2v_network_schema(struct v2v_schema *schema, const char *name,
                                   const struct v2v_network_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_network_ops *ops = NULL;
    *schema = (struct v2v_schema){0};
    V2V_TRY(v2v_network_find(&ops, name));
    V2V_TRY(check(ops, spec));
    V2V_TRY(ops->declare(schema, spec));
done:
    if (rc != V2V_OK) {
        v2v_schema_fini(schema);
    }
    return rc;
}

void v2v_schema_fini(struct v2v_schema *schema)
{
    v2v_fields_fini(&schema->fields);
    schema->groups = 0;
}

enum v2v_status v2v_network_create(struct v2v_network **network, const char *name,
                                   const struct v2v_network_spec *spec)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_network *self = NULL;
    const struct v2v_network_ops *ops = NULL;
    V2V_TRY(v2v_network_find(&ops, name));
    V2V_TRY(V2V_ALLOC(self, "network", 1));
    *self = (struct v2v_network){.ops = ops,
                                 .views = spec->views,
                                 .slices = spec->slices,
                                 .inputs = spec->views,
                                 .held = spec->outputs & ((1u << ops->outputs) - 1)};
    V2V_TRY(v2v_network_schema(&self->schema, name, spec));
    V2V_TRY(ops->create(self, spec));
done:
    if (rc != V2V_OK) {
        v2v_network_destroy(&self);
    }
    *network = self;
    return rc;
}

void v2v_network_destroy(struct v2v_network **network)
{
    struct v2v_network *self = *network;
    if (self != NULL) {
        self->ops->destroy(self);
        for (int o = 0; o < V2V_NETWORK_MOST_OUTPUTS; o++) {
            v2v_mem_free(self->output[o].held_out);
        }
        v2v_schema_fini(&self->schema);
        v2v_mem_free(self);
        *network = NULL;
    }
}

enum v2v_status v2v_network_describe(struct v2v_weights_info *info, const struct v2v_config *config,
                                     int64_t views, int64_t slices, int64_t step)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_network_ops *ops = NULL;
    size_t used = 0;
    *info = (struct v2v_weights_info){.views = views, .slices = slices, .step = step};
    V2V_TRY(v2v_network_find(&ops, config->model.method));
    V2V_TRY(v2v_text_format(info->method, sizeof info->method, "%s", ops->name));
    rc = ops->split != NULL
             ? v2v_text_format(info->split, sizeof info->split, "%s", ops->split)
             : v2v_config_get(info->split, sizeof info->split, config, "model.view_split");
    V2V_TRY(rc);
    for (int i = 0; ops->keys[i] != NULL; i++) {
        char value[V2V_CONFIG_TEXT_BYTES];
        V2V_TRY(v2v_config_get(value, sizeof value, config, ops->keys[i]));
        V2V_TRY(v2v_text_format(info->settings + used, sizeof info->settings - used, "%s=%s\n",
                                ops->keys[i], value));
        used += strlen(info->settings + used);
    }
done:
    return rc;
}

enum v2v_status v2v_network_of_weights(const struct v2v_network_ops **ops,
                                       const struct v2v_weights_info *info, const char *path)
{
    if (v2v_network_find(ops, info->method) != V2V_OK) {
        return V2V_FAIL(V2V_E_INPUT, "%s: its network '%s' is none that this program knows", path,
                        info->method);
    }
    return V2V_OK;
}

/* What a file does not name is younger than the file, which was made as the default has it, or the
 * network says by what. */
static enum v2v_status set_defaults(struct v2v_config *config, const struct v2v_network_ops *ops)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_config defaults;
    v2v_config_defaults(&defaults);
    for (int i = 0; ops->keys[i] != NULL; i++) {
        char value[V2V_CONFIG_TEXT_BYTES], line[V2V_WEIGHTS_SETTINGS_BYTES];
        V2V_TRY(v2v_config_get(value, sizeof value, &defaults, ops->keys[i]));
        V2V_TRY(v2v_text_format(line, sizeof line, "%s=%s", ops->keys[i], value));
        V2V_TRY(v2v_config_set(config, line));
    }
    for (int i = 0; ops->before != NULL && ops->before[i] != NULL; i++) {
        V2V_TRY(v2v_config_set(config, ops->before[i]));
    }
done:
    return rc;
}

enum v2v_status v2v_network_adopt(struct v2v_config *config, const struct v2v_weights_info *info,
                                  const char *path)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_network_ops *ops = NULL;
    char line[V2V_WEIGHTS_SETTINGS_BYTES];
    V2V_TRY(v2v_network_of_weights(&ops, info, path));
    V2V_TRY(v2v_text_format(line, sizeof line, "model.method=%s", info->method));
    V2V_TRY(v2v_config_set(config, line));
    V2V_TRY(set_defaults(config, ops));
    for (const char *at = info->settings; *at != '\0';) {
        size_t bytes = strcspn(at, "\n");
        V2V_TRY(v2v_text_format(line, sizeof line, "%.*s", (int)bytes, at));
        if (v2v_config_set(config, line) != V2V_OK) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: the setting %s of its network is not valid here",
                             path, line));
        }
        at += bytes + (at[bytes] == '\n');
    }
done:
    return rc;
}

unsigned v2v_network_outputs_of(const struct v2v_network_ops *ops, const struct v2v_grid *grid)
{
    if (grid->branch_size == 1) {
        return (1u << ops->outputs) - 1;
    }
    return 1u << (grid->idle ? ops->outputs - 1 : grid->branch_rank);
}
