/* Network, loss, moments and grid of a training run: what a step works on. */
#ifndef V2V3D_TRAIN_TRAINER_H
#define V2V3D_TRAIN_TRAINER_H

#include "train/sampler.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/nn/adam.h"
#include "v2v3d/par/bucket_sum.h"
#include "v2v3d/par/grid.h"

struct v2v_trainer {
    const struct v2v_config *config;
    struct v2v_grid grid;
    struct v2v_sampler *sampler;
    const struct v2v_network_ops *ops;
    struct v2v_network *network;
    struct v2v_projector *projector; /* lent to the loss and to the network */
    struct v2v_loss *loss;           /* by views; both NULL where there are examples */
    struct v2v_volume_loss volume_loss;
    float *m, *v;   /* Adam's moments, as the network's fields */
    float *average; /* running mean of the weights, likewise; NULL: not wanted */
    int64_t rounds; /* in which the ranks run a batch's samples */
    float *sum;     /* of gradients over rounds; NULL: one round, summed where they are */
    struct v2v_bucket_sum *buckets;
    double *tail; /* numbers of a step that all ranks must know */
    int64_t tail_count;
    int64_t *checksums; /* [rank,group] of weights */
    float *images;      /* of a sample [image,y,x]: views, or an example */
    int64_t image_floats;
    float *volume[V2V_NETWORK_MOST_OUTPUTS]; /* [z,rows,x] of all outputs, this rank's slab */
    int64_t voxels;                          /* of one */
    float *dvolume[V2V_NETWORK_MOST_OUTPUTS];
    int64_t slabs;   /* that a sample is cut into */
    int64_t psf_sum; /* struct v2v_weights_info's */
};

/* What a rank brings into a step beside its samples. */
struct v2v_step_votes {
    int stop;                /* this rank wants to stop after the step */
    int checkpoint;          /* .. wants a checkpoint after it */
    double spent;            /* part of the time that is given; of one rank, the others say 0 */
    enum v2v_status earlier; /* a failure since the last step that nobody else knows of yet */
};

/* What every rank knows after a step. */
struct v2v_step_result {
    double terms[V2V_LOSS_TERMS]; /* means over the batch */
    double grad_norm;
    int finite; /* loss and squared gradient, in float32; the weights were stepped only then */
    int stop, checkpoint; /* did any rank vote so? */
    double spent;
};

/* Collective(comm), agreed. */
enum v2v_status v2v_trainer_create(struct v2v_trainer *trainer, const struct v2v_train_job *job,
                                   struct v2v_comm *comm) V2V_MUST_CHECK;
void v2v_trainer_destroy(struct v2v_trainer *trainer);

/* Draws this rank's first sample of step `step`, which then is at hand: what it takes to make one
 * is found wanting here, before a run's files are touched. Collective(world), agreed. */
enum v2v_status v2v_trainer_try(struct v2v_trainer *trainer, int64_t step) V2V_MUST_CHECK;

/* One Adam step on the batch of step `step` (from 0). A rank's failure is known to all at the end
 * of the step, which then changes nothing. Collective(world), agreed. */
enum v2v_status v2v_trainer_step(struct v2v_trainer *trainer, struct v2v_step_result *result,
                                 int64_t step, const struct v2v_step_votes *votes) V2V_MUST_CHECK;

#endif
