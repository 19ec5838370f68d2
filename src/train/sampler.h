/* Crops of noisy recordings, or of examples made of them, drawn by (seed, step, sample). */
#ifndef V2V3D_TRAIN_SAMPLER_H
#define V2V3D_TRAIN_SAMPLER_H

#include "train/sources.h"
#include "v2v3d/loss/loss.h"
#include "v2v3d/method/examples.h"
#include "v2v3d/train/train.h"

struct v2v_sampler;

/* What a network asks of the sides of its samples, pixels. */
struct v2v_sample_sides {
    int64_t unit; /* they are multiples of it */
    int64_t crop; /* of a crop that is called auto, where frames are as large */
};

/* Takes the job's recordings (train/sources.h), decides which flips are physical and the size of a
 * sample; whole frames are padded to a multiple of the unit. With a kind of examples (else NULL),
 * samples are crops of them, each of which is made when it is first drawn from.
 * Collective(comm), agreed. */
enum v2v_status v2v_sampler_create(struct v2v_sampler **sampler, const struct v2v_train_job *job,
                                   struct v2v_sample_sides sides,
                                   const struct v2v_examples_ops *kind,
                                   const struct v2v_comm *comm) V2V_MUST_CHECK;
void v2v_sampler_destroy(struct v2v_sampler **sampler);

/* Floats of the frames that it will take, one by one, and keep. */
int64_t v2v_sampler_room(const struct v2v_sampler *sampler);

int64_t v2v_sampler_height(const struct v2v_sampler *sampler);
int64_t v2v_sampler_width(const struct v2v_sampler *sampler);

/* The part of a sample in which views are compared: without halo and padding. */
struct v2v_window v2v_sampler_window(const struct v2v_sampler *sampler);

/* What samples are drawn from. */
const struct v2v_sources *v2v_sampler_sources(const struct v2v_sampler *sampler);

/* Images of a sample: the views, or those of an example. */
int64_t v2v_sampler_images(const struct v2v_sampler *sampler);

/* Sample `index` of step `step` into images [images,height,width]. Local: reads a frame, or makes
 * an example, when it is not kept already. */
enum v2v_status v2v_sampler_draw(struct v2v_sampler *sampler, float *images, int64_t step,
                                 int64_t index) V2V_MUST_CHECK;

#endif
