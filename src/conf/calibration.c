#include "v2v3d/conf/calibration.h"

#include "conf/text_file.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/conf/kept_views.h"

#include <stddef.h>
#include <string.h>
#include <yaml.h>

enum { MOST_VIEWS = 4096, MOST_SIDE = 1 << 20 };

/* Of a field's terms. */
enum { MOST_SHADING = 8 };

/* What a file says of a view. */
struct quantity {
    const char *name;
    int count; /* of numbers; left out, they are as in a view without a calibration */
    size_t at;
    double least, most;
    const char *meaning;
};
#define QUANTITY(name, count, least, most, meaning)                                                \
    {                                                                                              \
#name, count, offsetof(struct v2v_view_calibration, name), least, most, meaning            \
    }
#define PIXELS(name, meaning) QUANTITY(name, 2, -V2V_MOST_PIXELS, V2V_MOST_PIXELS, meaning)
#define FIELD(name, most, meaning) QUANTITY(name, V2V_FIELD_TERMS, -most, most, meaning)

static const struct quantity table[] = {
    QUANTITY(gain, 1, V2V_LEAST_GAIN, V2V_MOST_GAIN, "of the view"),
    PIXELS(shift, "y, x: pixels"),
    PIXELS(slope, "y, x: pixels from the middle slice to the last"),
    FIELD(distortion_y, V2V_MOST_PIXELS,
          "pixels times P1(x), P1(y), P2(x), P1(x) P1(y), P2(y), P3(x) .. P10(y): Legendre "
          "polynomials, -1 to 1 from edge to edge"),
    FIELD(distortion_x, V2V_MOST_PIXELS, "likewise"),
    FIELD(shading, MOST_SHADING, "likewise: logarithm of the gain"),
};
enum { QUANTITIES = sizeof table / sizeof *table };

struct reader {
    yaml_document_t document;
    const char *path;
};

static const char *text_of(const yaml_node_t *node)
{
    return node->type == YAML_SCALAR_NODE ? (const char *)node->data.scalar.value : "";
}

static long long line_of(const yaml_node_t *node)
{
    return (long long)node->start_mark.line + 1;
}

static int is_field(const struct quantity *quantity)
{
    return quantity->count == V2V_FIELD_TERMS;
}

/* A number or, where `count` is above 1, a list of so many. */
static enum v2v_status read_numbers(double *to, struct reader *reader, yaml_node_t *node,
                                    const struct quantity *quantity)
{
    enum v2v_status rc = V2V_OK;
    char what[128];
    yaml_node_t *item = node;
    const int is_list = node->type == YAML_SEQUENCE_NODE;
    const int64_t count =
        is_list ? node->data.sequence.items.top - node->data.sequence.items.start : 1;
    V2V_TRY(v2v_text_format(what, sizeof what, "%.80s:%lld: %s", reader->path, line_of(node),
                            quantity->name));
    if (is_list != (quantity->count > 1) || count != quantity->count) {
        V2V_TRY(V2V_FAIL(
            V2V_E_CONFIG, "%s wants %s%d number%s%s", what, is_list ? "" : "a list of ",
            quantity->count, quantity->count > 1 ? "s" : "",
            is_field(quantity) ? "; files of earlier versions have fewer: calibrate again" : ""));
    }
    for (int64_t i = 0; i < count; i++) {
        if (is_list) {
            item = yaml_document_get_node(&reader->document, node->data.sequence.items.start[i]);
        }
        V2V_TRY(v2v_text_to_f64(&to[i], text_of(item), quantity->least, quantity->most, what,
                                V2V_E_CONFIG));
    }
done:
    return rc;
}

static enum v2v_status wrong_key(const struct reader *reader, const yaml_node_t *key,
                                 const char *wanted)
{
    return V2V_FAIL(V2V_E_CONFIG,
                    "%s:%lld: '%.40s' is not one of the keys %s, or stands there twice",
                    reader->path, line_of(key), text_of(key), wanted);
}

/* @param least behind the view before it */
static enum v2v_status read_number(int64_t *number, const struct reader *reader,
                                   const yaml_node_t *node, int64_t least)
{
    enum v2v_status rc = V2V_OK;
    char what[128];
    V2V_TRY(v2v_text_format(what, sizeof what, "%.80s:%lld: view", reader->path, line_of(node)));
    V2V_TRY(v2v_text_to_i64(number, text_of(node), least, MOST_VIEWS - 1, what, V2V_E_CONFIG));
done:
    return rc;
}

/* @param number of the view, where it is not said; what it is */
static enum v2v_status read_view(struct v2v_view_calibration *view, int64_t *number,
                                 struct reader *reader, const yaml_node_t *node)
{
    enum v2v_status rc = V2V_OK;
    unsigned seen = 0;
    const int64_t least = *number;
    if (node->type != YAML_MAPPING_NODE) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s:%lld: a view wants 'key: value' lines", reader->path,
                         line_of(node)));
    }
    for (const yaml_node_pair_t *pair = node->data.mapping.pairs.start;
         pair < node->data.mapping.pairs.top; pair++) {
        const yaml_node_t *key = yaml_document_get_node(&reader->document, pair->key);
        yaml_node_t *value = yaml_document_get_node(&reader->document, pair->value);
        const int is_number = strcmp(text_of(key), "view") == 0;
        int q = is_number ? QUANTITIES : 0;
        while (q < QUANTITIES && strcmp(table[q].name, text_of(key)) != 0) {
            q++;
        }
        if ((q == QUANTITIES && !is_number) || (seen >> q & 1) != 0) {
            V2V_TRY(wrong_key(reader, key,
                              "view, gain, shift, slope, distortion_y, distortion_x, shading"));
        }
        seen |= 1u << q;
        V2V_TRY(is_number ? read_number(number, reader, value, least)
                          : read_numbers((double *)(void *)((char *)view + table[q].at), reader,
                                         value, &table[q]));
    }
done:
    return rc;
}

static enum v2v_status read_views(struct v2v_calibration *calibration, struct reader *reader,
                                  const yaml_node_t *node)
{
    enum v2v_status rc = V2V_OK;
    const int64_t count = node->type == YAML_SEQUENCE_NODE
                              ? node->data.sequence.items.top - node->data.sequence.items.start
                              : 0;
    if (count < 1 || count > MOST_VIEWS) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s:%lld: views wants a list of 1 to %d views", reader->path,
                         line_of(node), MOST_VIEWS));
    }
    V2V_TRY(v2v_calibration_init(calibration, count, 0, 0));
    for (int64_t v = 0; v < count; v++) {
        calibration->number[v] = v > 0 ? calibration->number[v - 1] + 1 : 0;
        V2V_TRY(read_view(
            &calibration->view[v], &calibration->number[v], reader,
            yaml_document_get_node(&reader->document, node->data.sequence.items.start[v])));
    }
done:
    return rc;
}

/* A side of the frame, pixels. */
static enum v2v_status read_side(int64_t *side, const struct reader *reader,
                                 const yaml_node_t *node)
{
    enum v2v_status rc = V2V_OK;
    char what[128];
    V2V_TRY(v2v_text_format(what, sizeof what, "%.80s:%lld: a side of the frame", reader->path,
                            line_of(node)));
    V2V_TRY(v2v_text_to_i64(side, text_of(node), 1, MOST_SIDE, what, V2V_E_CONFIG));
done:
    return rc;
}

static enum v2v_status read_document(struct v2v_calibration *calibration, struct reader *reader)
{
    enum v2v_status rc = V2V_OK;
    static const char keys[] = "height, width, views";
    int64_t height = 0, width = 0;
    const yaml_node_t *root = yaml_document_get_root_node(&reader->document);
    if (root == NULL || root->type != YAML_MAPPING_NODE) {
        V2V_TRY(
            V2V_FAIL(V2V_E_CONFIG, "%s: no calibration: it wants the keys %s", reader->path, keys));
    }
    for (const yaml_node_pair_t *pair = root->data.mapping.pairs.start;
         pair < root->data.mapping.pairs.top; pair++) {
        const yaml_node_t *key = yaml_document_get_node(&reader->document, pair->key);
        yaml_node_t *value = yaml_document_get_node(&reader->document, pair->value);
        if (strcmp(text_of(key), "height") == 0 && height == 0) {
            V2V_TRY(read_side(&height, reader, value));
        } else if (strcmp(text_of(key), "width") == 0 && width == 0) {
            V2V_TRY(read_side(&width, reader, value));
        } else if (strcmp(text_of(key), "views") == 0 && calibration->view == NULL) {
            V2V_TRY(read_views(calibration, reader, value));
        } else {
            V2V_TRY(wrong_key(reader, key, keys));
        }
    }
    if (height == 0 || width == 0 || calibration->view == NULL) {
        V2V_TRY(
            V2V_FAIL(V2V_E_CONFIG, "%s: no calibration: it wants the keys %s", reader->path, keys));
    }
    calibration->height = height;
    calibration->width = width;
done:
    return rc;
}

enum v2v_status v2v_calibration_init(struct v2v_calibration *calibration, int64_t views,
                                     int64_t height, int64_t width)
{
    enum v2v_status rc = V2V_OK;
    *calibration = (struct v2v_calibration){.views = views, .height = height, .width = width};
    V2V_TRY(V2V_ALLOC(calibration->view, "conf.calibration", views));
    V2V_TRY(V2V_ALLOC(calibration->number, "conf.calibration", views));
    for (int64_t v = 0; v < views; v++) {
        calibration->view[v] = (struct v2v_view_calibration){.gain = 1.0};
        calibration->number[v] = v;
    }
done:
    return rc;
}

void v2v_calibration_fini(struct v2v_calibration *calibration)
{
    v2v_mem_free(calibration->view);
    v2v_mem_free(calibration->number);
    *calibration = (struct v2v_calibration){0};
}

/* The next document of a file; of none left an empty one. */
static enum v2v_status load(yaml_document_t *document, yaml_parser_t *parser, const char *path)
{
    if (!yaml_parser_load(parser, document)) {
        return V2V_FAIL(V2V_E_CONFIG, "%s:%lld: %s", path, (long long)parser->problem_mark.line + 1,
                        parser->problem != NULL ? parser->problem : "not YAML");
    }
    return V2V_OK;
}

static enum v2v_status refuse_second(yaml_parser_t *parser, const char *path)
{
    enum v2v_status rc = V2V_OK;
    yaml_document_t document;
    V2V_TRY(load(&document, parser, path));
    if (yaml_document_get_root_node(&document) != NULL) {
        rc = V2V_FAIL(V2V_E_CONFIG, "%s:%lld: only one YAML document is allowed", path,
                      (long long)document.start_mark.line + 1);
    }
    yaml_document_delete(&document);
done:
    return rc;
}

enum v2v_status v2v_calibration_read(struct v2v_calibration *calibration, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct reader reader = {.path = path};
    yaml_parser_t parser;
    char *text = NULL;
    int64_t bytes = 0;
    int started = 0, loaded = 0;
    *calibration = (struct v2v_calibration){0};
    V2V_TRY(v2v_text_file_read(&text, &bytes, path));
    started = yaml_parser_initialize(&parser);
    if (!started) {
        V2V_TRY(V2V_FAIL(V2V_E_MEMORY, "%s: out of memory", path));
    }
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, (size_t)bytes);
    V2V_TRY(load(&reader.document, &parser, path));
    loaded = 1;
    V2V_TRY(read_document(calibration, &reader));
    V2V_TRY(refuse_second(&parser, path));
done:
    if (loaded) {
        yaml_document_delete(&reader.document);
    }
    if (started) {
        yaml_parser_delete(&parser);
    }
    v2v_mem_free(text);
    if (rc != V2V_OK) {
        v2v_calibration_fini(calibration);
    }
    return rc;
}

int v2v_calibration_has_distortion(const struct v2v_calibration *calibration)
{
    for (int64_t v = 0; v < calibration->views; v++) {
        const struct v2v_view_calibration *view = &calibration->view[v];
        if (!v2v_field_is_zero(view->distortion_y) || !v2v_field_is_zero(view->distortion_x)) {
            return 1;
        }
    }
    return 0;
}

int v2v_calibration_has_fields(const struct v2v_calibration *calibration)
{
    int has_fields = v2v_calibration_has_distortion(calibration);
    for (int64_t v = 0; v < calibration->views; v++) {
        has_fields |= !v2v_field_is_zero(calibration->view[v].shading);
    }
    return has_fields;
}

enum v2v_status v2v_calibration_leave(struct v2v_calibration *calibration, const char *without,
                                      const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_kept_views kept;
    int64_t left = 0;
    V2V_TRY(v2v_kept_views_init(&kept, without, MOST_VIEWS + 1));
    for (int64_t v = 0; v < calibration->views; v++) {
        const int64_t number = calibration->number[v];
        int64_t place = left;
        while (kept.view[place] < number) {
            place++;
        }
        if (kept.view[place] > number) {
            continue; /* it is listed */
        }
        if (place > left) {
            V2V_TRY(V2V_FAIL(V2V_E_CONFIG,
                             "%s: has a view %lld, but no view %lld (--without-views leaves views "
                             "out)",
                             path, (long long)number, (long long)kept.view[left]));
        }
        calibration->number[left] = number;
        calibration->view[left++] = calibration->view[v];
    }
    if (left == 0) {
        V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: has no view but those of --without-views %s", path,
                         without));
    }
    calibration->views = left;
done:
    v2v_kept_views_fini(&kept);
    return rc;
}

enum v2v_status v2v_calibration_check(const struct v2v_calibration *calibration, int64_t views,
                                      int64_t height, int64_t width, const char *what)
{
    const int has_fields = v2v_calibration_has_fields(calibration);
    if (calibration->views == views &&
        (!has_fields || (calibration->height == height && calibration->width == width))) {
        return V2V_OK;
    }
    return V2V_FAIL(V2V_E_INPUT,
                    "%s: %lld views of %lld x %lld, but the calibration was made from %lld of "
                    "%lld x %lld",
                    what, (long long)views, (long long)height, (long long)width,
                    (long long)calibration->views, (long long)calibration->height,
                    (long long)calibration->width);
}

static const double *numbers_of(const struct v2v_view_calibration *view,
                                const struct quantity *quantity)
{
    return (const double *)(const void *)((const char *)view + quantity->at);
}

int v2v_calibration_is_within_bounds(const struct v2v_calibration *calibration)
{
    for (int64_t v = 0; v < calibration->views; v++) {
        for (int q = 0; q < QUANTITIES; q++) {
            const double *number = numbers_of(&calibration->view[v], &table[q]);
            for (int i = 0; i < table[q].count; i++) {
                if (!(number[i] >= table[q].least && number[i] <= table[q].most)) {
                    return 0; /* NaN, too */
                }
            }
        }
    }
    return 1;
}

void v2v_calibration_print(const struct v2v_calibration *calibration, FILE *stream)
{
    fprintf(stream, "# How the views differ from what their PSFs say: v2v3d calibrate\n"
                    "# view: from 0, among all of the set\n");
    for (int q = 0; q < QUANTITIES; q++) {
        fprintf(stream, "# %s: %s\n", table[q].name, table[q].meaning);
    }
    fprintf(stream, "views:\n");
    for (int64_t v = 0; v < calibration->views; v++) {
        fprintf(stream, "  - view: %lld\n", (long long)calibration->number[v]);
        for (int q = 0; q < QUANTITIES; q++) {
            const double *number = numbers_of(&calibration->view[v], &table[q]);
            if (is_field(&table[q]) && v2v_field_is_zero(number)) {
                continue;
            }
            fprintf(stream, "    %s: %s", table[q].name, table[q].count > 1 ? "[" : "");
            for (int i = 0; i < table[q].count; i++) {
                fprintf(stream, "%s%.6g", i > 0 ? ", " : "", number[i]);
            }
            fprintf(stream, "%s\n", table[q].count > 1 ? "]" : "");
        }
    }
    /* last: a file that is cut off lacks one, or digits of it */
    fprintf(stream, "height: %lld\nwidth: %lld\n", (long long)calibration->height,
            (long long)calibration->width);
}
