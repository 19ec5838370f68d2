/** The views' side of a data step: what is known of views on a torus, what they are missed by, and
 *  the weights of their samples (optics/data_step.h says what they mean). No spectra, no ranks.
 */
#ifndef V2V3D_SRC_OPTICS_TORUS_VIEWS_H
#define V2V3D_SRC_OPTICS_TORUS_VIEWS_H

#include "v2v3d/optics/data_step.h"

/** Of weights that go by the light; without them is_on is 0. */
struct v2v_view_weights {
    int is_on;            /* bool */
    float gain, floor;    /* of the noise's variance over A x */
    const float *frames;  /* [v,height,width]: weights go by these as well, .. */
    float frames_unit;    /* .. as parts of this; NULL: they don't */
    int64_t taken;        /* times that weights were taken */
    float *kept;          /* [v,rows,torus width]: y, where `recorded` is what weights make of it */
    float *light, *split; /* likewise: A x, by which weights go; p */
};

struct v2v_torus_views {
    int64_t views, height, width; /* of a frame */
    struct v2v_torus torus;
    struct v2v_part known_rows, known_columns; /* of the torus */
    const float *frame; /* [v,height,width]: as taken, lent; NULL: all of it is known */
    float *highest;     /* [v]: of the frame, where it is saturated; INFINITY: nowhere */
    float scale;        /* of y over the frame */
    float *recorded;    /* [v,rows,torus width]: y */
    float *missed;      /* likewise: y - A x */
    float *around;      /* likewise: views of light that isn't in x; NULL: weights have no room */
    struct v2v_view_weights weights;
};

/** Numbers of an array of views on this rank's rows. */
int64_t v2v_torus_views_samples(const struct v2v_torus_views *views);

/** Of this torus, its rows this rank's. Zeroed `views` may go to fini.
 *  @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_torus_views_init(struct v2v_torus_views *views, int64_t count, int64_t height,
                                     int64_t width, const struct v2v_torus *torus) V2V_MUST_CHECK;
void v2v_torus_views_fini(struct v2v_torus_views *views);

/** As v2v_data_step_begin and _begin_torus say. */
void v2v_torus_views_take(struct v2v_torus_views *views, const float *frame, double scale);
void v2v_torus_views_take_whole(struct v2v_torus_views *views, const float *samples);

/** As v2v_data_step_surround says, after `missed` = A volume. */
void v2v_torus_views_surround(struct v2v_torus_views *views, const float *seen, const float *frame,
                              const float *highest);

/** As v2v_data_step_take_weights, _weigh and _average say. */
enum v2v_status v2v_torus_views_take_weights(struct v2v_torus_views *views) V2V_MUST_CHECK;
void v2v_torus_views_weigh(struct v2v_torus_views *views, double gain, double floor);
void v2v_torus_views_average(struct v2v_torus_views *views, const float *frames, double unit);

/** After `missed` is there, as v2v_data_step_extend says: y where it is not known, and where
 *  weights make another of it. @param squares [torus height] out, this rank's rows: of what is
 *  known */
void v2v_torus_views_extend(struct v2v_torus_views *views, double *squares);

/** As v2v_data_step_known says. */
int64_t v2v_torus_views_known(const struct v2v_torus_views *views);

/** Squares of v2v_data_step_coarse. */
int64_t v2v_torus_views_squares(const struct v2v_torus_views *views);

/** Sums over what this rank has of each of them, [v2v_torus_views_squares]; NaN where some
 *  aren't known. */
void v2v_torus_views_coarse(const struct v2v_torus_views *views, double *sums);

#endif
