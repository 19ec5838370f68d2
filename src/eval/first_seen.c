/* The frame by which settings are found that hold for all of them. */
#include "v2v3d/eval/first_seen.h"

#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/eval/structure.h"
#include "v2v3d/par/agreement.h"
#include "v2v3d/par/watchdog.h"
#include "v2v3d/tensor/blind.h"

static int has_light(const float *views, int64_t samples)
{
    int64_t i = 0;
    while (i < samples && !(views[i] > 0.0f)) {
        i++;
    }
    return i < samples;
}

/* Where to look, and what was found. */
struct look {
    struct v2v_recording *recording;
    const struct v2v_scaling *scaling;
    int64_t frame;
    int is_seen;
};

/* Frames that are looked at from the first one that shows something on, if a view of it is dark. */
enum { LOOK_ON = 8 };

/* Rank-0. */
static enum v2v_status look_for_seen(void *context)
{
    enum v2v_status rc = V2V_OK;
    struct look *look = context;
    const struct v2v_recording_info *info = v2v_recording_info(look->recording);
    const int64_t samples = v2v_mem_product(info->views, info->height, info->width);
    float *views = NULL;
    int64_t bright = -1, first = -1, whole = -1;
    V2V_TRY(V2V_ALLOC(views, "eval.views", samples));
    for (int64_t t = 0; t < info->frames && whole < 0 && (first < 0 || t < first + LOOK_ON); t++) {
        v2v_watchdog_beat("looking for a frame that shows something");
        V2V_TRY(v2v_recording_read_seen(look->recording, views, look->scaling->offset, NULL, t));
        v2v_scaling_apply(look->scaling, views, samples);
        v2v_blind_fill(views, info->views, samples / info->views);
        const int is_seen = v2v_structure_is_seen(views, info->views, info->height, info->width);
        const int lacks_view =
            is_seen && v2v_structure_lacks_view(views, info->views, info->height, info->width);
        bright = bright < 0 && has_light(views, samples) ? t : bright;
        first = first < 0 && is_seen ? t : first;
        whole = is_seen && !lacks_view ? t : whole;
    }
    look->is_seen = first >= 0;
    look->frame = whole >= 0 ? whole : first >= 0 ? first : v2v_larger(bright, 0);
done:
    v2v_mem_free(views);
    return rc;
}

enum v2v_status v2v_first_seen(int64_t *frame, int *is_seen, struct v2v_recording *recording,
                               const struct v2v_scaling *scaling, const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct look look = {.recording = recording, .scaling = scaling};
    V2V_TRY(v2v_agreement_alone(comm, look_for_seen, &look));
    v2v_par_broadcast(comm, &look.frame, (int64_t)sizeof look.frame, 0);
    v2v_par_broadcast(comm, &look.is_seen, (int64_t)sizeof look.is_seen, 0);
done:
    *frame = look.frame;
    *is_seen = look.is_seen;
    return rc;
}
