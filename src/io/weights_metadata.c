#include "io/arrays_internal.h"
#include "v2v3d/base/text.h"

#include <stdlib.h>
#include <string.h>

static enum v2v_status get_whole(int64_t *value, const struct v2v_arrays *self, const char *name,
                                 int64_t least, int64_t most)
{
    const char *text = v2v_arrays_text(self, name);
    char what[V2V_PATH_BYTES + 64];
    if (text == NULL) {
        return V2V_FAIL(V2V_E_INPUT, "%s: metadata %s: is missing", self->path, name);
    }
    snprintf(what, sizeof what, "%s: metadata %s", self->path, name);
    return v2v_text_to_i64(value, text, least, most, what, V2V_E_INPUT);
}

/* "LEAST MOST" */
static enum v2v_status get_level(double *least, double *most, const struct v2v_arrays *self,
                                 const char *name)
{
    enum v2v_status rc = V2V_OK;
    const char *text = v2v_arrays_text(self, name);
    const char *space = text != NULL ? strchr(text, ' ') : NULL;
    char first[64], what[V2V_PATH_BYTES + 64];
    if (space == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: metadata %s: is not two numbers", self->path, name));
    }
    snprintf(what, sizeof what, "%s: metadata %s", self->path, name);
    V2V_TRY(v2v_text_format(first, sizeof first, "%.*s", (int)(space - text), text));
    V2V_TRY(v2v_text_to_f64(least, first, -1e300, 1e300, what, V2V_E_INPUT));
    V2V_TRY(v2v_text_to_f64(most, space + 1, -1e300, 1e300, what, V2V_E_INPUT));
done:
    return rc;
}

enum v2v_status v2v_weights_from_metadata(struct v2v_weights_info *info,
                                          const struct v2v_arrays *self)
{
    enum v2v_status rc = V2V_OK;
    int64_t version = 0;
    if (v2v_arrays_text(self, "method") == NULL || v2v_arrays_text(self, "settings") == NULL) {
        return V2V_OK;
    }
    V2V_TRY(get_whole(&version, self, V2V_WEIGHTS_FORMAT, 1, V2V_WEIGHTS_VERSION));
    for (int i = 0; i < V2V_WEIGHTS_WORDS; i++) {
        const struct v2v_weights_word *word = &v2v_weights_words[i];
        const char *text = v2v_arrays_text(self, word->name);
        if (text == NULL ||
            v2v_text_format((char *)info + word->at, word->bytes, "%s", text) != V2V_OK) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: metadata %s: is %s", self->path, word->name,
                             text == NULL ? "missing" : "too long"));
        }
    }
    for (int i = 0; i < V2V_WEIGHTS_COUNTS; i++) {
        const struct v2v_weights_count *count = &v2v_weights_counts[i];
        if (!count->may_lack || v2v_arrays_text(self, count->name) != NULL) {
            V2V_TRY(get_whole((int64_t *)((char *)info + count->at), self, count->name,
                              count->least, INT64_MAX));
        }
    }
    V2V_TRY(get_whole(&info->levels.frames, self, V2V_WEIGHTS_FRAMES, 0, INT64_MAX));
    for (int f = 0; f < V2V_LEVEL_FIGURES && info->levels.frames > 0; f++) {
        V2V_TRY(get_level(&info->levels.least[f], &info->levels.most[f], self,
                          v2v_weights_level_names[f]));
    }
done:
    return rc;
}

static int set(json_t *metadata, const char *name, const char *text)
{
    return json_object_set_new(metadata, name, json_string(text)) == 0;
}

static int set_whole(json_t *metadata, const char *name, int64_t value)
{
    char text[32];
    snprintf(text, sizeof text, "%lld", (long long)value);
    return set(metadata, name, text);
}

enum v2v_status v2v_weights_to_metadata(json_t *metadata, const struct v2v_weights_info *info)
{
    int fine = set(metadata, "format", "pt") &&
               set_whole(metadata, V2V_WEIGHTS_FORMAT, V2V_WEIGHTS_VERSION);
    for (int i = 0; i < V2V_WEIGHTS_WORDS; i++) {
        const struct v2v_weights_word *word = &v2v_weights_words[i];
        fine = fine && set(metadata, word->name, (const char *)info + word->at);
    }
    for (int i = 0; i < V2V_WEIGHTS_COUNTS; i++) {
        const struct v2v_weights_count *count = &v2v_weights_counts[i];
        fine = fine &&
               set_whole(metadata, count->name, *(const int64_t *)((const char *)info + count->at));
    }
    fine = fine && set_whole(metadata, V2V_WEIGHTS_FRAMES, info->levels.frames);
    /* 17 digits give every double back. */
    for (int f = 0; f < V2V_LEVEL_FIGURES && info->levels.frames > 0; f++) {
        char text[64];
        snprintf(text, sizeof text, "%.17g %.17g", info->levels.least[f], info->levels.most[f]);
        fine = fine && set(metadata, v2v_weights_level_names[f], text);
    }
    return fine ? V2V_OK : V2V_FAIL(V2V_E_MEMORY, "metadata of weights: out of memory");
}
