#include "io/rounding.h"

#include "v2v3d/base/log.h"
#include <float.h>
#include <math.h>

double v2v_rounding_step(double peak)
{
    return fmax(peak / V2V_ROUNDING_MOST, (double)FLT_MIN);
}

double v2v_rounding_peak(double peak, const float *voxels, int64_t count)
{
    for (int64_t i = 0; i < count; i++) {
        peak = voxels[i] > peak ? (double)voxels[i] : peak;
    }
    return peak;
}

int64_t v2v_rounding_apply(float *voxels, int64_t count, double step)
{
    int64_t clipped = 0;
#pragma omp parallel for schedule(static) reduction(+ : clipped)
    for (int64_t i = 0; i < count; i++) {
        const double number = rint((double)voxels[i] / step);
        clipped += number < 0.0 || number > V2V_ROUNDING_MOST;
        voxels[i] = (float)fmin(fmax(number, 0.0), V2V_ROUNDING_MOST);
    }
    return clipped;
}

void v2v_rounding_report(const char *path, double step, int64_t clipped)
{
    v2v_log(clipped > 0 ? V2V_LOG_WARNING : V2V_LOG_INFO,
            "%s: uint16 in steps of %.4g, up to %.4g; %lld voxels were beyond it or below 0", path,
            step, step * V2V_ROUNDING_MOST, (long long)clipped);
}
