/* RUN/weights.h5 and RUN/weights.prev.h5: two generations of complete checkpoints. */
#ifndef V2V3D_TRAIN_CHECKPOINT_H
#define V2V3D_TRAIN_CHECKPOINT_H

#include "train/trainer.h"

/* Write a checkpoint after `step` steps; what was the newest becomes the previous one.
 * Collective(world), agreed. */
enum v2v_status v2v_checkpoint_write(struct v2v_trainer *trainer, const char *folder, int64_t step,
                                     const char *config) V2V_MUST_CHECK;

/* Weights and moments of the newest readable generation, *step how many steps it has; 0 and
 * untouched when there is none. Collective(world), agreed. */
enum v2v_status v2v_checkpoint_read(struct v2v_trainer *trainer, const char *folder,
                                    int64_t *step) V2V_MUST_CHECK;

/* Is there a run in this folder? Local. */
int v2v_checkpoint_exists(const char *folder);

#endif
