/* Are the ranks of a run alike? */
#ifndef V2V3D_TRAIN_ALIKE_H
#define V2V3D_TRAIN_ALIKE_H

#include "train/trainer.h"

/* With parallel.reproducible: do all ranks compute with the same instructions and threads?
 * Collective(comm), agreed. V2V_E_CONFIG when they don't. */
enum v2v_status v2v_alike_processors(const struct v2v_config *config,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;

/* Do all ranks that hold a group of parameters hold the same weights after `step` steps?
 * Collective(world), agreed. V2V_E_INTERNAL names the ranks that don't. */
enum v2v_status v2v_alike_weights(struct v2v_trainer *trainer, int64_t step) V2V_MUST_CHECK;

#endif
