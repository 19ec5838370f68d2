/* The features of all views with a ring of zeros wide enough for every tap. */
#ifndef V2V3D_NN_PADDED_H
#define V2V3D_NN_PADDED_H

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

/* First pixel inside the ring of a plane, counted from `data`. */
int64_t v2v_padded_offset(const struct v2v_padded *padded, int64_t view, int64_t feature);

/* Copy one view's features [feature,y,x] in, and what the ring's inside holds back to them. */
void v2v_padded_put(struct v2v_padded *padded, int64_t view, const float *features);
void v2v_padded_get(const struct v2v_padded *padded, int64_t view, float *features);

#endif
