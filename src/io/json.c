#include "v2v3d/io/json.h"

#include "io/file_internal.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"

#include <errno.h>
#include <inttypes.h>
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Every integer up to this is a double of its own: 2^53. */
static const double largest_integer = 9007199254740992.0;

static json_t *number_value(double number)
{
    if (!isfinite(number)) {
        return json_null();
    }
    if (number == trunc(number) && fabs(number) <= largest_integer) {
        return json_integer((json_int_t)number);
    }
    return json_real(number);
}

static json_t *array_value(const double *values, int64_t count)
{
    json_t *array = json_array();

    for (int64_t i = 0; array != NULL && i < count; i++) {
        if (json_array_append_new(array, number_value(values[i])) != 0) {
            json_decref(array);
            array = NULL;
        }
    }
    return array;
}

/* A file name need not be UTF-8, a JSON string must. */
static json_t *text_value(const char *text)
{
    json_t *value = json_string(text);
    char *plain = NULL;
    const size_t length = strlen(text);

    if (value != NULL || V2V_ALLOC(plain, "io.json_text", (int64_t)length + 1) != V2V_OK) {
        return value;
    }
    for (size_t i = 0; i < length; i++) {
        plain[i] = (unsigned char)text[i] < 0x80 ? text[i] : '?';
    }
    value = json_string(plain);
    v2v_mem_free(plain);
    return value;
}

static json_t *item_value(const struct v2v_json_item *item)
{
    if (item->text != NULL) {
        return text_value(item->text);
    }
    if (item->values != NULL) {
        return array_value(item->values, item->count);
    }
    return number_value(item->number);
}

enum v2v_status v2v_json_print(FILE *stream, const struct v2v_json_item *items, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    json_t *object = json_object();
    char *line = NULL;

    for (int64_t i = 0; i < count; i++) {
        if (json_object_set_new(object, items[i].name, item_value(&items[i])) != 0) {
            V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "JSON member %s: out of memory", items[i].name));
        }
    }
    /* 17 significant digits give every double back. */
    line = json_dumps(object, JSON_PRESERVE_ORDER | JSON_REAL_PRECISION(17));
    if (line == NULL) {
        V2V_TRY(
            V2V_FAIL(V2V_E_MEMORY, "a JSON object of %" PRId64 " members: out of memory", count));
    }
    V2V_TRY(V2V_FAULT_POINT("json.print"));
    if (fprintf(stream, "%s\n", line) < 0 || fflush(stream) != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "a JSON line cannot be written: %s", strerror(errno)));
    }
done:
    free(line);
    json_decref(object);
    return rc;
}

enum line_kind { LINE_TORN, LINE_WITHOUT_STEP, LINE_WITH_STEP };

static enum line_kind read_line(double *step, const char *line, size_t length)
{
    json_t *object = json_loadb(line, length, JSON_REJECT_DUPLICATES, NULL);
    const json_t *member = json_object_get(object, "step");
    enum line_kind kind = LINE_TORN;

    if (json_is_object(object)) {
        kind = json_is_number(member) ? LINE_WITH_STEP : LINE_WITHOUT_STEP;
        *step = json_number_value(member);
    }
    json_decref(object);
    return kind;
}

/* Copy whole lines from `in` to `out`; *kept is where `out` shall end: after the last line with a
 * step <= `step`, or after the lines that come before any step. */
static enum v2v_status copy_lines(FILE *in, FILE *out, off_t *kept, int64_t step,
                                  const char *temporary)
{
    enum v2v_status rc = V2V_OK;
    char *line = NULL;
    size_t room = 0;
    ssize_t length = 0;
    int steps_seen = 0;
    double found = 0;

    while ((length = getline(&line, &room, in)) > 0) {
        size_t text = (size_t)length - (line[length - 1] == '\n');
        enum line_kind kind = read_line(&found, line, text);
        if (kind == LINE_TORN) {
            continue;
        }
        if (fwrite(line, 1, text, out) != text || fputc('\n', out) == EOF) {
            V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", temporary, strerror(errno)));
        }
        steps_seen = steps_seen || kind == LINE_WITH_STEP;
        if (kind == LINE_WITH_STEP ? found <= (double)step : !steps_seen) {
            *kept = ftello(out);
        }
    }
done:
    free(line);
    return rc;
}

enum v2v_status v2v_json_lines_cut(const char *path, int64_t step)
{
    enum v2v_status rc = V2V_OK;
    char temporary[V2V_PATH_BYTES];
    off_t kept = 0;
    FILE *out = NULL;
    FILE *in = fopen(path, "re");

    if (in == NULL) {
        return errno == ENOENT ? V2V_OK : V2V_FAIL(V2V_E_IO, "%s: %s", path, strerror(errno));
    }
    V2V_TRY(v2v_file_begin(&out, temporary, path));
    V2V_TRY(copy_lines(in, out, &kept, step, temporary));
    if (ferror(in)) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: cannot be read", path));
    }
    if (fflush(out) != 0 || ftruncate(fileno(out), kept) != 0) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", temporary, strerror(errno)));
    }
done:
    (void)fclose(in);
    return v2v_file_close_and_commit(rc, out, temporary, path);
}

/* The number of members where there is no such. */
static int64_t index_of(const struct v2v_json_lines *lines, const char *name)
{
    int64_t i = 0;
    while (i < lines->members && strcmp(lines->member[i].name, name) != 0) {
        i++;
    }
    return i;
}

const struct v2v_json_member *v2v_json_lines_find(const struct v2v_json_lines *lines,
                                                  const char *name)
{
    const int64_t at = index_of(lines, name);
    return at < lines->members ? &lines->member[at] : NULL;
}

static void take_number(struct v2v_json_lines *lines, const char *name, double value, double step)
{
    const int64_t at = index_of(lines, name);
    struct v2v_json_member *member = &lines->member[at];
    if (at == V2V_JSON_MEMBERS || strlen(name) >= V2V_JSON_NAME_BYTES) {
        return;
    }
    if (at == lines->members) {
        lines->members++;
        *member = (struct v2v_json_member){.least = INFINITY};
        memcpy(member->name, name, strlen(name) + 1);
    }
    member->last = value;
    member->sum += value;
    if (value < member->least) {
        member->least = value;
        member->least_at = step;
    }
}

static void take_line(struct v2v_json_lines *lines, const char *line, size_t length)
{
    json_t *object = json_loadb(line, length, JSON_REJECT_DUPLICATES, NULL), *value = NULL;
    const double step = json_number_value(json_object_get(object, "step"));
    const char *name = NULL;
    lines->lines += json_is_object(object);
    json_object_foreach(object, name, value)
    {
        if (json_is_number(value)) {
            take_number(lines, name, json_number_value(value), step);
        }
    }
    json_decref(object);
}

enum v2v_status v2v_json_lines_read(struct v2v_json_lines *lines, const char *path)
{
    enum v2v_status rc = V2V_OK;
    char *line = NULL;
    size_t room = 0;
    ssize_t length = 0;
    FILE *in = NULL;
    *lines = (struct v2v_json_lines){0};
    V2V_TRY(v2v_file_check_input(path));
    in = fopen(path, "re");
    if (in == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s", path, strerror(errno)));
    }
    while ((length = getline(&line, &room, in)) > 0) {
        take_line(lines, line, (size_t)length);
    }
    if (ferror(in)) {
        V2V_TRY(V2V_FAIL(V2V_E_IO, "%s: %s", path, strerror(errno)));
    }
done:
    free(line);
    if (in != NULL) {
        (void)fclose(in);
    }
    return rc;
}
