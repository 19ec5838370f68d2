#include "io/tiff_internal.h"
#include "io/volume_tiff.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/volume.h"

#include <float.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#define PROGRAM "v2v3d"
#define STEP "step"

/* The words of struct v2v_tiff_told, in the order of the tag. */
static const struct word {
    const char *name;
    size_t at, bytes;
} words[] = {
#define WORD(name, member)                                                                         \
    {                                                                                              \
        name, offsetof(struct v2v_tiff_told, member), sizeof((struct v2v_tiff_told *)0)->member    \
    }
    WORD(V2V_VOLUME_TASK, task),
    WORD(V2V_VOLUME_FIRST_FRAME, first_frame),
    WORD(V2V_VOLUME_RECORDING, recording_sum),
    WORD(V2V_VOLUME_OFFSET, offset),
#undef WORD
};
enum { WORDS = sizeof words / sizeof words[0] };

enum v2v_status v2v_tiff_told_of(struct v2v_tiff_told *told, const struct v2v_attribute *attributes,
                                 int64_t count)
{
    enum v2v_status rc = V2V_OK;
    *told = (struct v2v_tiff_told){.task = ""};
    for (int64_t i = 0; i < count; i++) {
        const struct v2v_attribute *item = &attributes[i];
        for (int w = 0; w < WORDS; w++) {
            char *to = (char *)told + words[w].at;
            if (strcmp(item->name, words[w].name) != 0) {
                continue;
            }
            V2V_TRY(item->text != NULL
                        ? v2v_text_format(to, words[w].bytes, "%s", item->text)
                        : v2v_text_format(to, words[w].bytes, "%.17g", item->number));
        }
    }
done:
    return rc;
}

/* One word more. */
static enum v2v_status add(char *text, size_t bytes, const char *name, const char *value)
{
    const size_t used = strlen(text);
    if (value[0] == '\0') {
        return V2V_OK;
    }
    return v2v_text_format(text + used, bytes - used, "%s; %s %s", used == 0 ? PROGRAM : "", name,
                           value);
}

enum v2v_status v2v_tiff_software_format(char *text, size_t bytes, const struct v2v_tiff_info *info)
{
    enum v2v_status rc = V2V_OK;
    char step[32] = "";
    text[0] = '\0';
    for (int w = 0; w < WORDS; w++) {
        V2V_TRY(add(text, bytes, words[w].name, (const char *)&info->told + words[w].at));
    }
    if (info->step > 0.0) {
        V2V_TRY(v2v_text_format(step, sizeof step, "%.17g", info->step));
    }
    V2V_TRY(add(text, bytes, STEP, step));
done:
    return rc;
}

/* The value behind a name, up to the next one. */
static void find(char *value, size_t bytes, const char *software, const char *name)
{
    char key[32];
    (void)snprintf(key, sizeof key, "; %s ", name);
    const char *at = strstr(software, key);
    if (at != NULL) {
        at += strlen(key);
        (void)snprintf(value, bytes, "%.*s", (int)strcspn(at, ";"), at);
    }
}

void v2v_tiff_software_parse(struct v2v_tiff_info *info, const char *software)
{
    char step[64] = "";
    if (strncmp(software, PROGRAM ";", strlen(PROGRAM ";")) != 0) {
        return;
    }
    for (int w = 0; w < WORDS; w++) {
        find((char *)&info->told + words[w].at, words[w].bytes, software, words[w].name);
    }
    find(step, sizeof step, software, STEP);
    if (v2v_text_to_f64(&info->step, step, FLT_MIN, FLT_MAX, STEP, V2V_E_INPUT) != V2V_OK) {
        info->step = 0.0; /* as good as none */
    }
}
