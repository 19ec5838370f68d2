/* RUN/weights.h5 and RUN/weights.prev.h5: two generations of complete checkpoints. */
#ifndef V2V3D_TRAIN_CHECKPOINT_H
#define V2V3D_TRAIN_CHECKPOINT_H

#include "train/trainer.h"

/* How far a run has come, with all attempts. */
struct v2v_trained {
    int64_t steps, seconds;
};

/* Write a checkpoint; what was the newest becomes the previous one. Collective(world), agreed.
 * @param trained rank 0's counts */
enum v2v_status v2v_checkpoint_write(struct v2v_trainer *trainer, const char *folder,
                                     const struct v2v_trained *trained,
                                     const char *config) V2V_MUST_CHECK;

/* Weights and moments of the newest good generation, and how far it had come; 0 and untouched when
 * there is none. A damaged newest one is renamed to weights.bad.h5 and the previous one takes its
 * place; failures other than bad content are returned, settings of another run among them.
 * Collective(world), agreed. */
enum v2v_status v2v_checkpoint_read(struct v2v_trainer *trainer, const char *folder,
                                    struct v2v_trained *trained) V2V_MUST_CHECK;

/* Is there a run in this folder? Local. */
int v2v_checkpoint_exists(const char *folder);

/* Remove both generations of an older run. Rank 0. */
enum v2v_status v2v_checkpoint_forget(const char *folder) V2V_MUST_CHECK;

#endif
