#include "v2v3d/tensor/saturation.h"

#include <math.h>

/* Pixels of a plateau at least, times those of the value below it, and the part of all that is no
 * plateau but a level of coarse counts. */
enum { LEAST = 10, TIMES_NEXT = 2, MOST_PART = 2 };

/* @param value out: the highest @return how many have it, if it is where the camera ends; else 0 */
static int64_t count_of(float *value, const float *views, int64_t count)
{
    float highest = -INFINITY, next = -INFINITY;
    int64_t at_highest = 0, at_next = 0, seen = 0;
    for (int64_t i = 0; i < count; i++) {
        seen += views[i] != V2V_BLIND;
        if (views[i] > highest) {
            next = highest;
            at_next = at_highest;
            highest = views[i];
            at_highest = 1;
        } else if (views[i] == highest) {
            at_highest++;
        } else if (views[i] > next) {
            next = views[i];
            at_next = 1;
        } else if (views[i] == next) {
            at_next++;
        }
    }
    *value = highest;
    const int is_plateau = next > V2V_BLIND && at_highest >= LEAST &&
                           at_highest / TIMES_NEXT >= at_next && at_highest < seen / MOST_PART;
    return is_plateau ? at_highest : 0;
}

int64_t v2v_saturated_pixels(const float *views, int64_t count)
{
    float value = 0.0f;
    return count_of(&value, views, count);
}

int64_t v2v_saturated_leave(float *views, int64_t count, int64_t pixels)
{
    int64_t most = 0;
    for (int64_t v = 0; v < count; v++) {
        float *view = views + v * pixels, highest = 0.0f;
        const int64_t saturated = count_of(&highest, view, pixels);
        for (int64_t i = 0; saturated > 0 && i < pixels; i++) {
            view[i] = view[i] == highest ? V2V_BLIND : view[i];
        }
        most = saturated > most ? saturated : most;
    }
    return most;
}

void v2v_saturated_cap(float *projected, const float *views, int64_t count, int64_t pixels)
{
#pragma omp parallel for schedule(static)
    for (int64_t v = 0; v < count; v++) {
        const float *view = views + v * pixels;
        const float highest = v2v_saturated_value(view, pixels);
        float *seen = projected + v * pixels;
        for (int64_t i = 0; isfinite(highest) && i < pixels; i++) {
            seen[i] = view[i] == highest && seen[i] > highest ? highest : seen[i];
        }
    }
}

float v2v_saturated_value(const float *views, int64_t count)
{
    float value = 0.0f;
    return count_of(&value, views, count) > 0 ? value : INFINITY;
}
