/* Recordings, and their truths, that the samples of a training are drawn from. */
#ifndef V2V3D_TRAIN_SOURCES_H
#define V2V3D_TRAIN_SOURCES_H

#include "v2v3d/io/level.h"
#include "v2v3d/method/examples.h"
#include "v2v3d/train/train.h"

struct v2v_source {
    struct v2v_example_source of;
    int64_t first; /* number of its frame 0 among all frames that are drawn from */
};

struct v2v_sources {
    struct v2v_source *list; /* [count] */
    int64_t count;
    const struct v2v_examples *examples; /* made of them; borrowed; NULL: frames are drawn */
    int64_t frames;                      /* that are drawn from */
    int64_t frame_pixels;                /* of the largest frame */
    struct v2v_level_range levels;       /* of the frames of all recordings */
};

/* Decides offset and gain of every recording (reads them once), and the units of their truths, if
 * examples want these; refuses what can't be learnt from. Collective(comm), agreed.
 * @return V2V_OK | V2V_E_INPUT | V2V_E_MEMORY; v2v_sources_fini after both */
enum v2v_status v2v_sources_init(struct v2v_sources *sources, const struct v2v_train_job *job,
                                 const struct v2v_examples *examples,
                                 const struct v2v_comm *comm) V2V_MUST_CHECK;
void v2v_sources_fini(struct v2v_sources *sources);

const struct v2v_recording_info *v2v_source_info(const struct v2v_source *source);

/* That which a frame of all is of. Local. */
const struct v2v_source *v2v_sources_of(const struct v2v_sources *sources, int64_t frame);

/* Of what is suspicious about the recordings (v2v_scaling_warn). Local. */
void v2v_sources_warn(const struct v2v_sources *sources, const struct v2v_comm *comm);

#endif
