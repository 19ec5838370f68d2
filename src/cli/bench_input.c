#include "cli/bench_input.h"

#include "cli/steps.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/psf.h"
#include <inttypes.h>
#include <string.h>

static enum v2v_status take_psf(struct v2v_psf_file *psf, const char *path,
                                const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    if (path != NULL) {
        return v2v_step_psf(session, psf, path);
    }
    V2V_TRY(v2v_psf_simulate(psf, &session->config.optics));
    if (session->config.psf.normalize == V2V_NORMALIZE_VIEW) {
        v2v_psf_normalize_views(psf);
    }
done:
    return rc;
}

/* The middle of planes [planes,height,width]. */
static enum v2v_status cut_middle(float **out, const float *in, int64_t planes, int64_t height,
                                  int64_t width, int64_t size, const char *path)
{
    enum v2v_status rc = V2V_OK;
    if (height < size || width < size) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: frames of %" PRId64 " x %" PRId64
                         " pixels are smaller than --size %" PRId64,
                         path, height, width, size));
    }
    V2V_TRY(V2V_ALLOC(*out, "bench.frame", v2v_mem_product(planes, size, size)));
    const float *corner = in + (height - size) / 2 * width + (width - size) / 2;
    for (int64_t row = 0; row < planes * size; row++) {
        memcpy(*out + row * size, corner + (row / size * height + row % size) * width,
               (size_t)size * sizeof **out);
    }
done:
    return rc;
}

static enum v2v_status read_views(struct v2v_bench_input *input, const char *path, int64_t size,
                                  struct v2v_recording *recording,
                                  const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_scaling scaling;
    float *frame = NULL;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    int64_t count = v2v_mem_product(info->views, info->height, info->width);
    V2V_TRY(v2v_scaling_decide(&scaling, recording, &session->config.input, session->world));
    V2V_TRY(V2V_ALLOC(frame, "bench.frame", count));
    V2V_TRY(v2v_recording_read(recording, frame, 0));
    v2v_scaling_apply(&scaling, frame, count);
    V2V_TRY(cut_middle(&input->views, frame, info->views, info->height, info->width, size, path));
    input->gain = scaling.gain;
done:
    v2v_mem_free(frame);
    return rc;
}

static enum v2v_status read_truth(struct v2v_bench_input *input, const char *path, int64_t size,
                                  const struct v2v_recording *recording,
                                  const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume *volume = NULL;
    float *frame = NULL;
    const struct v2v_recording_info *views = v2v_recording_info(recording);
    V2V_TRY(v2v_step_volume(session, &volume, path, &input->psf));
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    if (info->height != views->height || info->width != views->width) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT,
                         "%s: %" PRId64 " x %" PRId64 " pixels, but the views have %" PRId64
                         " x %" PRId64,
                         path, info->height, info->width, views->height, views->width));
    }
    V2V_TRY(
        V2V_ALLOC(frame, "bench.frame", v2v_mem_product(info->slices, info->height, info->width)));
    V2V_TRY(v2v_volume_read(volume, frame, 0, 0, info->slices));
    V2V_TRY(cut_middle(&input->truth, frame, info->slices, info->height, info->width, size, path));
done:
    v2v_mem_free(frame);
    v2v_volume_close(&volume);
    return rc;
}

/* The golden frame's rule, REFERENCE.md 9. */
static enum v2v_status draw_views(struct v2v_bench_input *input, int64_t size)
{
    enum v2v_status rc = V2V_OK;
    int64_t count = v2v_mem_product(input->psf.views, size, size);
    V2V_TRY(V2V_ALLOC(input->views, "bench.frame", count));
    for (int64_t i = 0; i < count; i++) {
        input->views[i] = (float)(0.2 + 0.2 * v2v_random_rule("lfi", 0, (uint64_t)i));
    }
    input->gain = 1.0;
done:
    return rc;
}

enum v2v_status v2v_bench_input_init(struct v2v_bench_input *input,
                                     const struct v2v_bench_paths *paths, int64_t size,
                                     const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_recording *recording = NULL;
    *input = (struct v2v_bench_input){0};
    V2V_TRY(take_psf(&input->psf, paths->psf, session));
    if (paths->input == NULL) {
        V2V_TRY(draw_views(input, size));
        goto done;
    }
    V2V_TRY(v2v_step_recording(session, &recording, paths->input, &input->psf));
    V2V_TRY(read_views(input, paths->input, size, recording, session));
    if (paths->truth != NULL) {
        V2V_TRY(read_truth(input, paths->truth, size, recording, session));
    }
done:
    v2v_recording_close(&recording);
    return rc;
}

void v2v_bench_input_fini(struct v2v_bench_input *input)
{
    v2v_mem_free(input->truth);
    v2v_mem_free(input->views);
    v2v_psf_file_fini(&input->psf);
    *input = (struct v2v_bench_input){0};
}
