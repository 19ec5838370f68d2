/* The terms of the loss: v2v_term_NAME for every row of v2v3d/conf/loss_terms.h. Each returns its
 * value and adds its gradient, times `weight`; sums in double precision. Many run side by side. */
#ifndef V2V3D_LOSS_TERMS_H
#define V2V3D_LOSS_TERMS_H

#include "v2v3d/conf/loss_terms.h"
#include "v2v3d/fft/fft2.h"
#include <stdint.h>

/* What a term of views knows beside one view's difference. */
struct v2v_term_view {
    int profile;                  /* enum v2v_loss_profile */
    int64_t ny, nx;               /* of the window */
    double compared;              /* pixels of all views that the volume is judged by */
    const struct v2v_fft2 *fft;   /* of the window */
    struct v2v_complex *spectrum; /* room for a half spectrum */
    float *scratch;               /* [ny,nx] */
};

/* This view's share of the term; gradient[ny,nx] by the difference[ny,nx], projection - view. */
typedef double v2v_view_term(const struct v2v_term_view *view, float *gradient,
                             const float *difference, double weight);

/* What a term of volumes knows beside one row of slice z. */
struct v2v_term_volume {
    int profile;
    int64_t slices, z;
    int64_t width, stride; /* of the row; numbers to the same row of the next slice */
    double slice;          /* pixels of a whole slice */
    double share;          /* this output's in a term of the mean volume */
    double background;     /* of the views, in units of the volume */
};

/* This row's share of the term; the gradient by own[x], where there is one by its neighbours in z,
 * too: rows are taken one slice after the other. The mean volume is that of own and other: the same
 * where there is one output. */
typedef double v2v_volume_term(const struct v2v_term_volume *volume, float *gradient,
                               const float *own, const float *other, double weight);

#define V2V_TERM_OF_VIEW(NAME, name, ...) v2v_view_term v2v_term_##name;
#define V2V_TERM_OF_VOLUME(NAME, name, ...) v2v_volume_term v2v_term_##name;
V2V_LOSS_VIEW_TERMS(V2V_TERM_OF_VIEW)
V2V_LOSS_VOLUME_TERMS(V2V_TERM_OF_VOLUME)
#undef V2V_TERM_OF_VIEW
#undef V2V_TERM_OF_VOLUME

#endif
