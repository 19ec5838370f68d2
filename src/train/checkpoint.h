/* RUN/weights.h5 and RUN/weights.prev.h5: two generations of complete checkpoints. */
#ifndef V2V3D_TRAIN_CHECKPOINT_H
#define V2V3D_TRAIN_CHECKPOINT_H

#include "train/trainer.h"

/* Write a checkpoint after `step` steps; what was the newest becomes the previous one.
 * Collective(world), agreed. */
enum v2v_status v2v_checkpoint_write(struct v2v_trainer *trainer, const char *folder, int64_t step,
                                     const char *config) V2V_MUST_CHECK;

/* Weights and moments of the newest good generation, *step how many steps it has; 0 and untouched
 * when there is none. A damaged newest one is renamed to weights.bad.h5 and the previous one takes
 * its place; failures other than bad content are returned. Collective(world), agreed. */
enum v2v_status v2v_checkpoint_read(struct v2v_trainer *trainer, const char *folder,
                                    int64_t *step) V2V_MUST_CHECK;

/* Is there a run in this folder? Local. */
int v2v_checkpoint_exists(const char *folder);

/* Remove both generations of an older run. Rank 0. */
enum v2v_status v2v_checkpoint_forget(const char *folder) V2V_MUST_CHECK;

#endif
