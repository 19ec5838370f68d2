/** What `info` found out about a file, as lines for people or one JSON object. */
#ifndef V2V_CLI_REPORT_H
#define V2V_CLI_REPORT_H

#include "v2v3d/base/status.h"
#include "v2v3d/tensor/statistics.h"
#include <stdint.h>
#include <stdio.h>

enum { V2V_REPORT_NAME_BYTES = 256, V2V_REPORT_VALUES = 4 };

struct v2v_report_row {
    char name[V2V_REPORT_NAME_BYTES]; /**< for people; in JSON, with _ for spaces */
    char *text;                       /**< NULL: numbers */
    const char *unit;                 /**< "" for none; NULL: JSON alone shows the row */
    double value[V2V_REPORT_VALUES];
    int count; /**< 1: a number; 2: from .. to; 4: least, most, mean, standard deviation */
};

struct v2v_report {
    const char *kind; /**< of file, a word; borrowed */
    char *headline;
    struct v2v_report_row *row; /**< [room] */
    int64_t rows, room;
    enum v2v_status rc; /**< of what was added; v2v_report_print returns it */
};

/** @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_report_init(struct v2v_report *report, const char *kind) V2V_MUST_CHECK;
void v2v_report_fini(struct v2v_report *report);

/** The first line, behind the file's name; printf. @kind Local. */
void v2v_report_headline(struct v2v_report *report, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/** A number that the headline says. @kind Local. */
void v2v_report_count(struct v2v_report *report, const char *name, int64_t count);
void v2v_report_text(struct v2v_report *report, const char *name, const char *text);
void v2v_report_number(struct v2v_report *report, const char *name, double value, const char *unit);
/** Nothing where the length is not stated (0). */
void v2v_report_length(struct v2v_report *report, const char *name, double value, const char *unit);
void v2v_report_range(struct v2v_report *report, const char *name, double from, double to,
                      const char *unit);
void v2v_report_figures(struct v2v_report *report, const char *name,
                        const struct v2v_figures *figures);

/** "-1 to 3, mean 0.5, standard deviation 0.1". @kind Local. */
void v2v_report_figures_text(char *text, size_t bytes, const struct v2v_figures *figures);

/** For people the first 1000 rows. @kind Local. @param path of the file
 *  @return V2V_OK | V2V_E_IO | V2V_E_MEMORY (also of a row) */
enum v2v_status v2v_report_print(const struct v2v_report *report, const char *path, FILE *stream,
                                 int as_json) V2V_MUST_CHECK;

#endif
