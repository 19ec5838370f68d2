/** What a run over the frames of a recording holds: laid out in recon_create.c, used in recon.c. */
#ifndef RECON_RECON_STATE_H
#define RECON_RECON_STATE_H

#include "recon/combination.h"
#include "recon/key_frame.h"
#include "recon/still.h"
#include "v2v3d/method/fusion.h"
#include "v2v3d/par/agreement.h"
#include "v2v3d/par/slicing.h"
#include "v2v3d/recon/recon.h"

struct v2v_recon {
    struct v2v_estimator *estimator; /* NULL on an idle rank */
    struct v2v_grid grid;
    const char *title; /* of the progress */
    int outputs;
    struct v2v_combination *combination; /* of two outputs, else NULL */
    int64_t views, slices;
    int64_t height, width;     /* of a frame */
    struct v2v_part own;       /* slices that this rank writes */
    int64_t first_row, rows;   /* of the padded frame that this rank computes .. */
    int64_t own_rows;          /* .. and what of them is not padding */
    struct v2v_fusion *fusion; /* with neighbouring frames */
    struct v2v_fusion *of_key; /* of key frames, with some at least; NULL: as all frames */
    int64_t fused;             /* floats of both, on every rank */
    float *recorded;           /* [v,y,x] as recorded, or fused */
    float *padded;             /* [v,y,x] what the method takes */
    float *output[V2V_ESTIMATOR_MOST_OUTPUTS]; /* [z,rows,x] padded; NULL for one not held */
    float *cut[V2V_ESTIMATOR_MOST_OUTPUTS]; /* [z,own rows,x] in the recording's units; NULL so */
    float *mean;                 /* [z,own rows,x]; the cut output itself where there is one */
    struct v2v_slicing *slicing; /* rows of all ranks of the shard and whole slices; NULL: the
                                    method's slices are whole */
    float *whole;                /* [z of this rank,y,x], in an output that was cut already */
    int is_homogeneous;          /* every frame has a level of its own */
    double level;                /* what the frame at hand was multiplied by for that */
    double parts[2];             /* computed of the frames so far, and how many */
    int64_t rounds;              /* done: every attempt gets one further */
    struct v2v_still *still;     /* what did not change is taken over; NULL: nothing is */
    struct v2v_key_frames *keys; /* with that */
    int64_t refresh;             /* frames that share a key frame; 1: none do */
    int64_t group, key; /* the first of these at hand, and their key frame; may lie before a cut */
    struct v2v_agreement *agreement; /* of all ranks, on the rounds */
    /* of the run under way */
    struct v2v_recording *recording;
    const struct v2v_scaling *scaling;
    struct v2v_volume_writer *writer;
    const struct v2v_monitor *monitor;
    int branches;              /* are written, too */
    int64_t *todo;             /* [frames] those that are not done yet, in order */
    struct v2v_misfit *misfit; /* [the recording's frames] of those that this rank computed */
    struct v2v_misfit key_misfit;
    int64_t frames;
};

#endif
