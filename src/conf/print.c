#include "conf/table.h"

#include "v2v3d/base/text.h"

#include <locale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { VALUE_BYTES = V2V_KEY_VALUE_BYTES, COMMENT_COLUMN = 32 };

/** The shortest decimal that reads back as the same double; small whole numbers without exponent.
 */
static void format_real(char *text, double value)
{
    if (fabs(value) < 1e6 && value == floor(value)) {
        snprintf(text, VALUE_BYTES, "%.0f", value);
        return;
    }
    for (int digits = 1; digits <= 17; digits++) {
        snprintf(text, VALUE_BYTES, "%.*g", digits, value);
        if (strtod(text, NULL) == value) {
            return;
        }
    }
}

static void format_whole(char *text, int64_t value)
{
    snprintf(text, VALUE_BYTES, "%lld", (long long)value);
}

static void format_whole_or_auto(char *text, int64_t value, const struct v2v_key *key)
{
    if (key->whole.is_open && value == V2V_WHOLE_AUTO) {
        snprintf(text, VALUE_BYTES, "auto");
    } else {
        format_whole(text, value);
    }
}

static void format_number(char *text, struct v2v_number number, const struct v2v_key *key)
{
    if (number.mode == V2V_NUMBER_GIVEN) {
        format_real(text, number.value);
    } else {
        snprintf(text, VALUE_BYTES, "%s", number.mode == V2V_NUMBER_AUTO ? "auto" : key->none);
    }
}

void v2v_key_format(char *text, const struct v2v_config *config, const struct v2v_key *key)
{
    const void *value = (const char *)config + key->offset;
    switch (key->kind) {
    case V2V_KEY_WHOLE:
        format_whole_or_auto(text, *(const int64_t *)value, key);
        break;
    case V2V_KEY_REAL:
        format_real(text, *(const double *)value);
        break;
    case V2V_KEY_BOOL:
    case V2V_KEY_WORD:
        snprintf(text, VALUE_BYTES, "%s", key->words[*(const int *)value]);
        break;
    case V2V_KEY_NUMBER:
        format_number(text, *(const struct v2v_number *)value, key);
        break;
    case V2V_KEY_NAME:
    case V2V_KEY_TEXT:
        snprintf(text, VALUE_BYTES, "%s", (const char *)value);
        break;
    }
}

/** "1 to 65536", "f32 or bf16", "auto, none or 0 to 1". */
static void print_range(const struct v2v_key *key, FILE *stream)
{
    char least[VALUE_BYTES], most[VALUE_BYTES];
    if (key->kind == V2V_KEY_WORD || key->kind == V2V_KEY_BOOL) {
        for (int i = 0; i < V2V_KEY_MOST_WORDS && key->words[i] != NULL; i++) {
            fprintf(stream, "%s%s", i > 0 ? " or " : "", key->words[i]);
        }
        return;
    }
    if (key->kind == V2V_KEY_NAME || key->kind == V2V_KEY_TEXT) {
        fprintf(stream, key->kind == V2V_KEY_NAME ? "a name" : "a text");
        return;
    }
    if (key->kind == V2V_KEY_WHOLE) {
        format_whole(least, key->whole.least);
        format_whole(most, key->whole.most);
    } else {
        format_real(least, key->real.least);
        format_real(most, key->real.most);
    }
    if (key->kind == V2V_KEY_WHOLE && key->whole.is_open) {
        fprintf(stream, "auto or ");
    }
    if (key->kind == V2V_KEY_NUMBER) {
        fprintf(stream, "auto%s%s or ", key->none != NULL ? ", " : "",
                key->none != NULL ? key->none : "");
    }
    fprintf(stream, "%s to %s", least, most);
    if (key->kind == V2V_KEY_WHOLE && key->whole.multiple > 1) {
        fprintf(stream, " in steps of %lld", (long long)key->whole.multiple);
    }
}

/** As YAML takes it back: any text between quotes, which are doubled inside. @return columns */
static int print_value(const char *value, const struct v2v_key *key, FILE *stream)
{
    int column = 0;
    if (key->kind != V2V_KEY_TEXT) {
        return fprintf(stream, "%s", value);
    }
    column += fprintf(stream, "'");
    for (; *value != '\0'; value++) {
        column += fprintf(stream, *value == '\'' ? "''" : "%c", *value);
    }
    return column + fprintf(stream, "'");
}

static void print_key(const struct v2v_config *config, const struct v2v_key *key,
                      const struct v2v_config *defaults, FILE *stream, int comments)
{
    char value[VALUE_BYTES], fallback[VALUE_BYTES];
    v2v_key_format(value, config, key);
    int column = fprintf(stream, "  %s: ", key->name);
    column += print_value(value, key, stream);
    if (comments) {
        v2v_key_format(fallback, defaults, key);
        fprintf(stream, "%*s # %s (", column < COMMENT_COLUMN ? COMMENT_COLUMN - column : 0, "",
                key->meaning);
        print_range(key, stream);
        fprintf(stream, "; default %s)", fallback[0] != '\0' ? fallback : "none");
    }
    fputc('\n', stream);
}

void v2v_config_print(const struct v2v_config *config, FILE *stream, const char *only, int comments)
{
    const char *section = "";
    struct v2v_config defaults;
    /* A decimal comma would not read back. */
    locale_t plain = newlocale(LC_NUMERIC_MASK, "C", (locale_t)0);
    locale_t before = plain != (locale_t)0 ? uselocale(plain) : (locale_t)0;
    v2v_config_defaults(&defaults);
    for (int64_t i = 0; i < v2v_key_count; i++) {
        const struct v2v_key *key = &v2v_key_table[i];
        if (only != NULL && strcmp(only, key->section) != 0) {
            continue;
        }
        if (strcmp(section, key->section) != 0) {
            fprintf(stream, "%s%s:\n", i > 0 && comments ? "\n" : "", key->section);
            section = key->section;
        }
        print_key(config, key, &defaults, stream, comments);
    }
    if (plain != (locale_t)0) {
        uselocale(before);
        freelocale(plain);
    }
}

enum v2v_status v2v_config_text(char **text, const struct v2v_config *config, const char *only,
                                int comments)
{
    static const char what[] = "the configuration's text";
    enum v2v_status rc = V2V_OK;
    FILE *stream = NULL;
    size_t bytes = 0;
    V2V_TRY(v2v_text_open(&stream, text, &bytes, what));
    v2v_config_print(config, stream, only, comments);
    V2V_TRY(v2v_text_close(V2V_OK, stream, text, what));
done:
    return rc;
}
