/* The folder RUN of a training run: its lock, configuration and log. Rank 0 works, all agree. */
#ifndef V2V3D_TRAIN_RUN_FOLDER_H
#define V2V3D_TRAIN_RUN_FOLDER_H

#include "train/trainer.h"
#include "v2v3d/par/time.h"

#include <stdio.h>

struct v2v_run_folder {
    const char *path;
    int is_new;                      /* bool: there was none before */
    int resumes;                     /* bool: it was asked to go on */
    const struct v2v_config *config; /* resolved */
    int lock;                        /* descriptor of the locked file, -1: none */
    FILE *log;                       /* metrics.jsonl, rank 0 only */
    char *config_text;               /* the same, rank 0 only; of v2v_text_open */
};

/* Make the folder and lock it against other runs. Collective(comm), agreed.
 * V2V_E_BUSY when another run holds it, V2V_E_USAGE when it has a run and neither resume nor force.
 */
enum v2v_status v2v_run_folder_enter(struct v2v_run_folder *folder, const struct v2v_train_job *job,
                                     const struct v2v_comm *comm) V2V_MUST_CHECK;

/* The run starts after step `step`; nothing in the folder has changed until here, and nothing does
 * where that is the last. At step 0 the checkpoints of an older run go, else what is set otherwise
 * than before is told; config.yaml is written; metrics.jsonl is opened and lines of later steps are
 * cut off. Local; rank 0 works. */
enum v2v_status v2v_run_folder_start(struct v2v_run_folder *folder, int64_t step) V2V_MUST_CHECK;

/* One line of a step that began then. Local; rank 0 works. */
enum v2v_status v2v_run_folder_log(struct v2v_run_folder *folder, int64_t step,
                                   const struct v2v_step_result *result,
                                   const struct v2v_par_time *began) V2V_MUST_CHECK;

/* A run that failed before its first step leaves no folder behind that was not there; one that does
 * not hold the lock, nothing of another's. Local; rank 0 works. */
void v2v_run_folder_leave(struct v2v_run_folder *folder, int has_failed);

#endif
