#include "conf/table.h"

#include "v2v3d/base/text.h"

#include <stdio.h>
#include <string.h>

static void *member(struct v2v_config *config, const struct v2v_key *key)
{
    return (char *)config + key->offset;
}

enum v2v_status v2v_key_find_section(const char *section, const char *where)
{
    const char *name[V2V_KEY_MOST] = {0};
    int64_t count = 0;
    for (int64_t i = 0; i < v2v_key_count; i++) {
        const struct v2v_key *key = &v2v_key_table[i];
        if (strcmp(key->section, section) == 0) {
            return V2V_OK;
        }
        if (strcmp(key->name, section) == 0) {
            return V2V_FAIL(V2V_E_CONFIG, "%s: '%s' is a key of section '%s', not a section", where,
                            section, key->section);
        }
        name[count++] = key->section;
    }
    const char *nearest = v2v_text_nearest(section, name, count);
    if (nearest != NULL) {
        return V2V_FAIL(V2V_E_CONFIG, "%s: unknown section '%s'; did you mean '%s'?", where,
                        section, nearest);
    }
    return V2V_FAIL(V2V_E_CONFIG, "%s: unknown section '%s'", where, section);
}

enum v2v_status v2v_key_find(int64_t *index, const char *section, const char *name,
                             const char *where)
{
    enum v2v_status rc = V2V_OK;
    const char *sibling[V2V_KEY_MOST] = {0};
    const struct v2v_key *elsewhere = NULL;
    int64_t count = 0;
    V2V_TRY(v2v_key_find_section(section, where));
    for (int64_t i = 0; i < v2v_key_count; i++) {
        const struct v2v_key *key = &v2v_key_table[i];
        int same_section = strcmp(key->section, section) == 0;
        int same_name = strcmp(key->name, name) == 0;
        if (same_section && same_name) {
            *index = i;
            return V2V_OK;
        }
        if (same_section) {
            sibling[count++] = key->name;
        }
        elsewhere = same_name && elsewhere == NULL ? key : elsewhere;
    }
    const char *nearest = v2v_text_nearest(name, sibling, count);
    if (nearest == NULL && elsewhere != NULL) {
        section = elsewhere->section;
        nearest = elsewhere->name;
    }
    if (nearest != NULL) {
        rc = V2V_FAIL(V2V_E_CONFIG, "%s: unknown key '%s'; did you mean '%s.%s'?", where, name,
                      section, nearest);
    } else {
        rc = V2V_FAIL(V2V_E_CONFIG, "%s: unknown key '%s' of section '%s'", where, name, section);
    }
done:
    return rc;
}

static enum v2v_status assign_word(int *value, const struct v2v_key *key, const char *text,
                                   const char *where)
{
    char known[256] = "";
    for (int i = 0; i < V2V_KEY_MOST_WORDS && key->words[i] != NULL; i++) {
        if (strcmp(text, key->words[i]) == 0) {
            *value = i;
            return V2V_OK;
        }
        size_t used = strlen(known);
        snprintf(known + used, sizeof known - used, "%s%s", i > 0 ? " or " : "", key->words[i]);
    }
    return V2V_FAIL(V2V_E_CONFIG, "%s: '%s' is not %s", where, text, known);
}

static enum v2v_status assign_whole(int64_t *value, const struct v2v_key *key, const char *text,
                                    const char *where)
{
    enum v2v_status rc = V2V_OK;
    int64_t number = 0;
    if (key->whole.is_open && strcmp(text, "auto") == 0) {
        *value = V2V_WHOLE_AUTO;
        return V2V_OK;
    }
    V2V_TRY(v2v_text_to_i64(&number, text, key->whole.least, key->whole.most, where, V2V_E_CONFIG));
    if (number % key->whole.multiple != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: %s is not a multiple of %lld", where, text,
                         (long long)key->whole.multiple));
    }
    *value = number;
done:
    return rc;
}

static int is_none(const struct v2v_key *key, const char *text)
{
    const char *word = strcmp(text, "off") == 0 ? "none" : text;
    return key->none != NULL && strcmp(word, key->none) == 0;
}

static enum v2v_status assign_number(struct v2v_number *value, const struct v2v_key *key,
                                     const char *text, const char *where)
{
    int mode = V2V_NUMBER_GIVEN;
    double number = key->real.fallback;
    if (strcmp(text, "auto") == 0) {
        mode = V2V_NUMBER_AUTO;
    } else if (is_none(key, text)) {
        mode = V2V_NUMBER_NONE;
    } else {
        enum v2v_status rc =
            v2v_text_to_f64(&number, text, key->real.least, key->real.most, where, V2V_E_CONFIG);
        if (rc != V2V_OK) {
            return rc;
        }
    }
    /* By member: the padding between them stays zero. */
    value->mode = mode;
    value->value = number;
    return V2V_OK;
}

static enum v2v_status assign_name(char *value, const char *text, const char *where)
{
    static const char known[] = "abcdefghijklmnopqrstuvwxyz0123456789-_";
    if (strlen(text) >= V2V_CONFIG_NAME_BYTES || strspn(text, known) != strlen(text)) {
        return V2V_FAIL(V2V_E_CONFIG, "%s: '%.64s' is no method's name", where, text);
    }
    memset(value, 0, V2V_CONFIG_NAME_BYTES);
    memcpy(value, text, strlen(text));
    return V2V_OK;
}

static enum v2v_status assign_text(char *value, const char *text, const char *where)
{
    const size_t length = strlen(text);
    for (size_t i = 0; i < length; i++) {
        if ((unsigned char)text[i] < 0x20 || text[i] == 0x7f) {
            return V2V_FAIL(V2V_E_CONFIG, "%s: holds more than one line of text", where);
        }
    }
    if (length >= V2V_CONFIG_TEXT_BYTES) {
        return V2V_FAIL(V2V_E_CONFIG, "%s: is longer than %d characters", where,
                        V2V_CONFIG_TEXT_BYTES - 1);
    }
    memset(value, 0, V2V_CONFIG_TEXT_BYTES);
    memcpy(value, text, length);
    return V2V_OK;
}

enum v2v_status v2v_key_assign(struct v2v_config *config, int64_t index, const char *text,
                               const char *where)
{
    const struct v2v_key *key = &v2v_key_table[index];
    void *value = member(config, key);
    char what[512];
    snprintf(what, sizeof what, "%s: %s.%s", where, key->section, key->name);
    if (text[0] == '\0' && key->kind != V2V_KEY_TEXT) {
        return V2V_FAIL(V2V_E_CONFIG, "%s has no value", what);
    }
    switch (key->kind) {
    case V2V_KEY_WHOLE:
        return assign_whole(value, key, text, what);
    case V2V_KEY_REAL:
        return v2v_text_to_f64(value, text, key->real.least, key->real.most, what, V2V_E_CONFIG);
    case V2V_KEY_BOOL:
    case V2V_KEY_WORD:
        return assign_word(value, key, text, what);
    case V2V_KEY_NUMBER:
        return assign_number(value, key, text, what);
    case V2V_KEY_NAME:
        return assign_name(value, text, what);
    case V2V_KEY_TEXT:
        return assign_text(value, text, what);
    }
    V2V_ASSERT(0);
}

void v2v_config_defaults(struct v2v_config *config)
{
    memset(config, 0, sizeof *config); /* padding too: a saved struct has the same bytes */
    for (int64_t i = 0; i < v2v_key_count; i++) {
        const struct v2v_key *key = &v2v_key_table[i];
        void *value = member(config, key);
        switch (key->kind) {
        case V2V_KEY_WHOLE:
            *(int64_t *)value = key->whole.fallback;
            break;
        case V2V_KEY_REAL:
            *(double *)value = key->real.fallback;
            break;
        case V2V_KEY_BOOL:
        case V2V_KEY_WORD:
            *(int *)value = (int)key->whole.fallback;
            break;
        case V2V_KEY_NUMBER:
            ((struct v2v_number *)value)->mode = key->mode;
            ((struct v2v_number *)value)->value = key->real.fallback;
            break;
        case V2V_KEY_NAME:
            snprintf(value, V2V_CONFIG_NAME_BYTES, "%s", key->words[0]);
            break;
        case V2V_KEY_TEXT: /* empty as it is */
            break;
        }
    }
}

static int64_t place_of(size_t offset)
{
    for (int64_t i = 0; i < v2v_key_count; i++) {
        if (v2v_key_table[i].offset == offset) {
            return i;
        }
    }
    return -1;
}

int64_t v2v_key_conflict(const struct v2v_config *config, char *why, size_t bytes)
{
    if (config->train.crop > 0 && config->train.crop <= 2 * config->train.halo) {
        snprintf(why, bytes, "train.crop: %lld leaves nothing inside a train.halo of %lld",
                 (long long)config->train.crop, (long long)config->train.halo);
        return place_of(offsetof(struct v2v_config, train.crop));
    }
    if (config->optics.numerical_aperture >= config->optics.refractive_index) {
        snprintf(why, bytes,
                 "optics.numerical_aperture: %g is not below optics.refractive_index, %g",
                 config->optics.numerical_aperture, config->optics.refractive_index);
        return place_of(offsetof(struct v2v_config, optics.numerical_aperture));
    }
    if (config->optics.needle_aperture > config->optics.numerical_aperture) {
        snprintf(why, bytes, "optics.needle_aperture: %g is above optics.numerical_aperture, %g",
                 config->optics.needle_aperture, config->optics.numerical_aperture);
        return place_of(offsetof(struct v2v_config, optics.needle_aperture));
    }
    return -1;
}

/* "section.name" of an assignment up to `bytes`. Index, or a failure that starts with `where`. */
static enum v2v_status find_path(int64_t *index, const char *path, size_t bytes, const char *where)
{
    char section[V2V_KEY_NAME_BYTES], name[V2V_KEY_NAME_BYTES];
    const char *dot = memchr(path, '.', bytes);
    size_t section_bytes = dot != NULL ? (size_t)(dot - path) : bytes;
    if (dot == NULL || section_bytes >= sizeof section ||
        bytes - section_bytes - 1 >= sizeof name) {
        return V2V_FAIL(V2V_E_CONFIG, "%s: '%.200s' names no key", where, path);
    }
    snprintf(section, sizeof section, "%.*s", (int)section_bytes, path);
    snprintf(name, sizeof name, "%.*s", (int)(bytes - section_bytes - 1), dot + 1);
    return v2v_key_find(index, section, name, where);
}

enum v2v_status v2v_config_check(const struct v2v_config *config)
{
    char why[256];
    return v2v_key_conflict(config, why, sizeof why) < 0 ? V2V_OK
                                                         : V2V_FAIL(V2V_E_CONFIG, "%s", why);
}

enum v2v_status v2v_config_set(struct v2v_config *config, const char *assignment)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_config changed = *config;
    int64_t index = -1;
    const char *equals = strchr(assignment, '=');
    if (equals == NULL || memchr(assignment, '.', (size_t)(equals - assignment)) == NULL) {
        return V2V_FAIL(V2V_E_CONFIG, "--set: '%.200s' is not section.key=value", assignment);
    }
    V2V_TRY(find_path(&index, assignment, (size_t)(equals - assignment), "--set"));
    V2V_TRY(v2v_key_assign(&changed, index, equals + 1, "--set"));
    *config = changed;
done:
    return rc;
}

enum v2v_status v2v_config_get(char *text, size_t bytes, const struct v2v_config *config,
                               const char *key)
{
    enum v2v_status rc = V2V_OK;
    char value[V2V_KEY_VALUE_BYTES];
    int64_t index = -1;
    V2V_TRY(find_path(&index, key, strlen(key), "settings"));
    v2v_key_format(value, config, &v2v_key_table[index]);
    V2V_TRY(v2v_text_format(text, bytes, "%s", value));
done:
    return rc;
}
