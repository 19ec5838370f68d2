#include "cli/origin.h"

#include "cli/steps.h"
#include "v2v3d/io/attributes.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/file_sum.h"
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define FIRST_FRAME "first_frame"
#define RECORDING "recording_sum"
#define OFFSET "offset" /* as v2v_provenance_init has it */

/* Frames are counted in doubles, as attributes are. */
static const double most_frames = 1e15;

enum v2v_status v2v_origin_of(struct v2v_origin *origin, const char *recording, int64_t first_frame,
                              const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    uint64_t sum = 0;
    *origin = (struct v2v_origin){.first_frame = first_frame, .offset = NAN};
    V2V_TRY(v2v_file_sum(&sum, recording, session->world));
    snprintf(origin->recording, sizeof origin->recording, "%016" PRIx64, sum);
done:
    return rc;
}

static void take_text(void *context, const char *name, const char *text)
{
    struct v2v_origin *origin = context;
    if (strcmp(name, RECORDING) == 0) {
        snprintf(origin->recording, sizeof origin->recording, "%s", text);
    }
}

static void take_number(void *context, const char *name, double number)
{
    struct v2v_origin *origin = context;
    if (strcmp(name, FIRST_FRAME) == 0 && number >= 0.0 && number <= most_frames) {
        origin->first_frame = (int64_t)number;
    } else if (strcmp(name, OFFSET) == 0) {
        origin->offset = number;
    }
}

enum v2v_status v2v_origin_read(struct v2v_origin *origin, const char *path,
                                const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_attribute_reader reader = {
        .context = origin, .text = take_text, .number = take_number};
    *origin = (struct v2v_origin){.first_frame = -1, .offset = NAN};
    if (v2v_step_on_root(session) && v2v_file_is_hdf5(path)) {
        rc = v2v_attributes_read(path, &reader);
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_par_broadcast(session->world, origin, (int64_t)sizeof *origin, 0);
done:
    return rc;
}

int64_t v2v_origin_attributes(struct v2v_attribute *item, const struct v2v_origin *origin)
{
    int64_t count = 0;
    if (origin->first_frame >= 0) {
        item[count++] =
            (struct v2v_attribute){.name = FIRST_FRAME, .number = (double)origin->first_frame};
    }
    if (origin->recording[0] != '\0') {
        item[count++] = (struct v2v_attribute){.name = RECORDING, .text = origin->recording};
    }
    if (isfinite(origin->offset)) {
        item[count++] = (struct v2v_attribute){.name = OFFSET, .number = origin->offset};
    }
    return count;
}

int v2v_origin_is_same(const struct v2v_origin *a, const struct v2v_origin *b)
{
    return a->first_frame >= 0 && b->first_frame >= 0 && a->recording[0] != '\0' &&
           strcmp(a->recording, b->recording) == 0;
}
