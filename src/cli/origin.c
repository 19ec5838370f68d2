#include "cli/origin.h"

#include "cli/steps.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/attributes.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/file_sum.h"
#include "v2v3d/io/tiff.h"
#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

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
    if (strcmp(name, V2V_VOLUME_RECORDING) == 0) {
        snprintf(origin->recording, sizeof origin->recording, "%s", text);
    } else if (strcmp(name, V2V_VOLUME_PSF) == 0) {
        snprintf(origin->psf, sizeof origin->psf, "%s", text);
    }
}

static void take_number(void *context, const char *name, double number)
{
    struct v2v_origin *origin = context;
    if (strcmp(name, V2V_VOLUME_FIRST_FRAME) == 0 && number >= 0.0 && number <= most_frames) {
        origin->first_frame = (int64_t)number;
    } else if (strcmp(name, V2V_VOLUME_OFFSET) == 0) {
        origin->offset = number;
    }
}

/* Of a TIFF: what is no number there is as good as none. */
static enum v2v_status read_tiff(struct v2v_origin *origin, const char *path)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_tiff *tiff = NULL;
    V2V_TRY(v2v_tiff_open(&tiff, path));
    const struct v2v_tiff_told *told = &v2v_tiff_info(tiff)->told;
    const struct {
        const char *name, *text;
    } numbers[] = {{V2V_VOLUME_FIRST_FRAME, told->first_frame}, {V2V_VOLUME_OFFSET, told->offset}};
    take_text(origin, V2V_VOLUME_RECORDING, told->recording_sum);
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        double number = 0.0;
        if (v2v_text_to_f64(&number, numbers[i].text, -FLT_MAX, FLT_MAX, numbers[i].name,
                            V2V_E_INPUT) == V2V_OK) {
            take_number(origin, numbers[i].name, number);
        }
    }
done:
    v2v_tiff_close(&tiff);
    return rc;
}

enum v2v_status v2v_origin_read(struct v2v_origin *origin, const char *path,
                                const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_attribute_reader reader = {
        .context = origin, .text = take_text, .number = take_number};
    *origin = (struct v2v_origin){.first_frame = -1, .offset = NAN};
    if (v2v_step_on_root(session)) {
        rc = v2v_file_is_hdf5(path) ? v2v_attributes_read(path, &reader) : read_tiff(origin, path);
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
        item[count++] = (struct v2v_attribute){.name = V2V_VOLUME_FIRST_FRAME,
                                               .number = (double)origin->first_frame};
    }
    if (origin->recording[0] != '\0') {
        item[count++] =
            (struct v2v_attribute){.name = V2V_VOLUME_RECORDING, .text = origin->recording};
    }
    if (isfinite(origin->offset)) {
        item[count++] = (struct v2v_attribute){.name = V2V_VOLUME_OFFSET, .number = origin->offset};
    }
    return count;
}

int v2v_origin_is_same(const struct v2v_origin *a, const struct v2v_origin *b)
{
    return a->first_frame >= 0 && b->first_frame >= 0 && a->recording[0] != '\0' &&
           strcmp(a->recording, b->recording) == 0;
}
