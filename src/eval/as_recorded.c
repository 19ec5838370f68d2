#include "v2v3d/eval/as_recorded.h"

#include "v2v3d/optics/calibration.h"
#include "v2v3d/tensor/saturation.h"

enum v2v_status v2v_as_recorded_read(float *views, int64_t *saturated, int64_t *blind,
                                     struct v2v_recording *recording,
                                     const struct v2v_scaling *scaling, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const int64_t samples = info->views * info->height * info->width;
    struct v2v_scaling unshaded = *scaling;
    unshaded.calibration = NULL;
    V2V_TRY(v2v_recording_read_distorted(recording, views, scaling->offset, blind, t));
    if (saturated != NULL) {
        *saturated = v2v_saturated_pixels(views, samples);
    }
    v2v_scaling_apply(&unshaded, views, samples);
done:
    return rc;
}

void v2v_as_recorded_predict(float *predicted, float *scratch,
                             const struct v2v_recording *recording, int64_t v, int64_t count)
{
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    const struct v2v_calibration *calibration = v2v_recording_calibration(recording);
    for (int64_t i = 0; i < count && calibration != NULL; i++) {
        v2v_calibration_distort_view(predicted + i * info->height * info->width, scratch,
                                     &calibration->view[v + i], info->height, info->width);
    }
}
