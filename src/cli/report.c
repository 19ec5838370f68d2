#include "cli/report.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/json.h"
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <string.h>

enum { HEADLINE_BYTES = 512, FIRST_ROOM = 64, MOST_LINES = 1000 };

enum v2v_status v2v_report_init(struct v2v_report *report, const char *kind)
{
    enum v2v_status rc = V2V_OK;
    *report = (struct v2v_report){.kind = kind};
    V2V_TRY(V2V_ALLOC(report->headline, "report", HEADLINE_BYTES));
    V2V_TRY(V2V_ALLOC(report->row, "report", FIRST_ROOM));
    report->room = FIRST_ROOM;
done:
    return rc;
}

void v2v_report_fini(struct v2v_report *report)
{
    for (int64_t i = 0; i < report->rows; i++) {
        v2v_mem_free(report->row[i].text);
    }
    v2v_mem_free(report->headline);
    v2v_mem_free(report->row);
    *report = (struct v2v_report){0};
}

void v2v_report_headline(struct v2v_report *report, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(report->headline, HEADLINE_BYTES, format, arguments);
    va_end(arguments);
}

/* Least, most, and the others. */
#define FIGURES "%.4g to %.4g, mean %.4g, standard deviation %.4g"

/* Twice the room. */
static enum v2v_status grow(struct v2v_report *report)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_report_row *row = NULL;
    V2V_TRY(V2V_ALLOC(row, "report", 2 * report->room));
    memcpy(row, report->row, (size_t)report->rows * sizeof *row);
    v2v_mem_free(report->row);
    report->row = row;
    report->room *= 2;
done:
    return rc;
}

/* Empty row behind the last one, which counts from now on. Where there is no memory for it, the
 * report has failed: the last row is written over. */
static struct v2v_report_row *add(struct v2v_report *report, const char *name, const char *unit,
                                  int count)
{
    if (report->rows == report->room && report->rc == V2V_OK) {
        report->rc = grow(report);
    }
    if (report->rows < report->room) {
        report->rows++;
    }
    struct v2v_report_row *row = &report->row[report->rows - 1];
    v2v_mem_free(row->text);
    *row = (struct v2v_report_row){.unit = unit, .count = count};
    snprintf(row->name, sizeof row->name, "%s", name);
    return row;
}

void v2v_report_count(struct v2v_report *report, const char *name, int64_t count)
{
    add(report, name, NULL, 1)->value[0] = (double)count;
}

void v2v_report_number(struct v2v_report *report, const char *name, double value, const char *unit)
{
    add(report, name, unit, 1)->value[0] = value;
}

void v2v_report_length(struct v2v_report *report, const char *name, double value, const char *unit)
{
    if (value > 0.0) {
        v2v_report_number(report, name, value, unit);
    }
}

void v2v_report_range(struct v2v_report *report, const char *name, double from, double to,
                      const char *unit)
{
    struct v2v_report_row *row = add(report, name, unit, 2);
    row->value[0] = from;
    row->value[1] = to;
}

void v2v_report_figures_text(char *text, size_t bytes, const struct v2v_figures *figures)
{
    snprintf(text, bytes, FIGURES, figures->least, figures->most, v2v_figures_mean(figures),
             v2v_figures_deviation(figures));
}

void v2v_report_figures(struct v2v_report *report, const char *name,
                        const struct v2v_figures *figures)
{
    struct v2v_report_row *row = add(report, name, "", 4);
    row->value[0] = figures->least;
    row->value[1] = figures->most;
    row->value[2] = v2v_figures_mean(figures);
    row->value[3] = v2v_figures_deviation(figures);
}

void v2v_report_text(struct v2v_report *report, const char *name, const char *text)
{
    const int64_t bytes = (int64_t)strlen(text) + 1;
    char *copy = NULL;
    if (V2V_ALLOC(copy, "report", bytes) != V2V_OK) {
        report->rc = V2V_E_MEMORY;
        return;
    }
    memcpy(copy, text, (size_t)bytes);
    add(report, name, "", 0)->text = copy;
}

/* Texts come from files: one line of what can be shown. */
static void print_text(FILE *stream, const char *text)
{
    const char *end = strchr(text, '\n');
    if (end != NULL && end[1] != '\0') {
        int64_t lines = text[strlen(text) - 1] != '\n';
        for (const char *at = text; *at != '\0'; at++) {
            lines += *at == '\n';
        }
        fprintf(stream, "%" PRId64 " lines, which --json shows", lines);
        return;
    }
    for (; *text != '\0' && *text != '\n'; text++) {
        fputc((unsigned char)*text < ' ' || *text == 0x7f ? '?' : *text, stream);
    }
}

static void print_row(FILE *stream, const struct v2v_report_row *row)
{
    const double *v = row->value;
    fprintf(stream, "%s: ", row->name);
    if (row->text != NULL) {
        print_text(stream, row->text);
    } else if (row->count == 1 && v[0] == floor(v[0]) && fabs(v[0]) < 1e15) {
        fprintf(stream, "%.0f", v[0]);
    } else if (row->count == 1) {
        fprintf(stream, "%.4g", v[0]);
    } else if (row->count == 2) {
        fprintf(stream, "%.4g to %.4g", v[0], v[1]);
    } else {
        fprintf(stream, FIGURES, v[0], v[1], v[2], v[3]);
    }
    fprintf(stream, "%s%s\n", row->unit[0] != '\0' ? " " : "", row->unit);
}

static enum v2v_status print_json(const struct v2v_report *report, const char *path, FILE *stream)
{
    enum v2v_status rc = V2V_OK;
    enum { FIRST = 2 };
    struct v2v_json_item *item = NULL;
    V2V_TRY(V2V_ALLOC(item, "report", report->rows + FIRST));
    item[0] = (struct v2v_json_item){.name = "file", .text = path};
    item[1] = (struct v2v_json_item){.name = "kind", .text = report->kind};
    for (int64_t i = 0; i < report->rows; i++) {
        struct v2v_report_row *row = &report->row[i];
        for (char *c = row->name; *c != '\0'; c++) {
            *c = *c == ' ' ? '_' : *c;
        }
        item[i + FIRST] = (struct v2v_json_item){.name = row->name,
                                                 .text = row->text,
                                                 .number = row->value[0],
                                                 .values = row->count > 1 ? row->value : NULL,
                                                 .count = row->count};
    }
    V2V_TRY(v2v_json_print(stream, item, report->rows + FIRST));
done:
    v2v_mem_free(item);
    return rc;
}

enum v2v_status v2v_report_print(const struct v2v_report *report, const char *path, FILE *stream,
                                 int as_json)
{
    if (report->rc != V2V_OK || as_json) {
        return report->rc != V2V_OK ? report->rc : print_json(report, path, stream);
    }
    fprintf(stream, "%s: %s\n", path, report->headline);
    for (int64_t i = 0; i < report->rows && i < MOST_LINES; i++) {
        if (report->row[i].unit != NULL) {
            print_row(stream, &report->row[i]);
        }
    }
    if (report->rows > MOST_LINES) {
        fprintf(stream, "%" PRId64 " more, which --json shows\n", report->rows - MOST_LINES);
    }
    return V2V_OK;
}
