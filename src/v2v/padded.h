/* The features of all views in a ring wide enough for every tap: zeros beyond the frame, at a cut
 * between slabs the neighbour's rows. */
#ifndef V2V3D_V2V_PADDED_H
#define V2V3D_V2V_PADDED_H

#include "v2v3d/base/status.h"

#include <stdint.h>

struct v2v_padded {
    int64_t views, features, height, width;
    int64_t ring;
    float *data; /* [view,feature,height+2*ring,width+2*ring] */
};

enum v2v_status v2v_padded_init(struct v2v_padded *padded, int64_t views, int64_t features,
                                int64_t height, int64_t width, int64_t ring) V2V_MUST_CHECK;
void v2v_padded_fini(struct v2v_padded *padded);

static inline int64_t v2v_padded_pitch(const struct v2v_padded *padded)
{
    return padded->width + 2 * padded->ring;
}

/* All zeros, the ring too. */
void v2v_padded_clear(struct v2v_padded *padded);

/* First pixel inside the ring of a plane, counted from `data`. */
int64_t v2v_padded_offset(const struct v2v_padded *padded, int64_t view, int64_t feature);

/* Copy rows of one view's features in: rows [y, y + count) from [feature,height,x], and back to
 * [feature,count,x]. Rows above and below lie in the ring, at most `ring` of them. */
void v2v_padded_put_rows(struct v2v_padded *padded, int64_t view, const float *features,
                         int64_t height, int64_t y, int64_t count);
void v2v_padded_get_rows(const struct v2v_padded *padded, int64_t view, float *features, int64_t y,
                         int64_t count);

#endif
