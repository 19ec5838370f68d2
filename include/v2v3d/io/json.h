#ifndef V2V3D_IO_JSON_H
#define V2V3D_IO_JSON_H

#include "v2v3d/base/status.h"
#include <stdint.h>
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

/** One member of a flat JSON object: text when `text` is not NULL, else the array of `count`
 *  numbers when `values` is not NULL, else the number (an integer when it is one; NaN and Inf
 * become null). */
struct v2v_json_item {
    const char *name;
    const char *text;
    double number;
    const double *values;
    int64_t count;
};

/** A number. @kind Local. @param name borrowed */
static inline struct v2v_json_item v2v_json_number(const char *name, double number)
{
    const struct v2v_json_item item = {name, NULL, number, NULL, -1};
    return item;
}

/** Print one object on one line, flushed. @kind Local. @return V2V_OK | V2V_E_IO | V2V_E_MEMORY */
enum v2v_status v2v_json_print(FILE *stream, const struct v2v_json_item *items,
                               int64_t count) V2V_MUST_CHECK;

enum { V2V_JSON_MEMBERS = 24, V2V_JSON_NAME_BYTES = 32 };

/** A number that the objects of a JSON-lines file have. */
struct v2v_json_member {
    char name[V2V_JSON_NAME_BYTES];
    double last, least, sum;
    double least_at; /**< the "step" of the object with the least */
};

struct v2v_json_lines {
    int64_t lines; /**< that are an object */
    int64_t members;
    struct v2v_json_member member[V2V_JSON_MEMBERS]; /**< the first ones, in order */
};

/** What the numbers of a JSON-lines file came to. Lines that are no object are left out.
 *  @kind Local. @return V2V_OK | V2V_E_INPUT (it can't be read) */
enum v2v_status v2v_json_lines_read(struct v2v_json_lines *lines, const char *path) V2V_MUST_CHECK;

/** @kind Local. @return NULL: there is no such */
const struct v2v_json_member *v2v_json_lines_find(const struct v2v_json_lines *lines,
                                                  const char *name);

/** Cut a JSON-lines file after the last object whose "step" is <= `step`: what came after the
 *  checkpoint from which a run resumes. Lines that are no whole object (torn by a crash) go as
 * well, lines before the first step stay. A missing file is fine; crash-safe. @kind Local.
 *  @return V2V_OK | V2V_E_IO */
enum v2v_status v2v_json_lines_cut(const char *path, int64_t step) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
