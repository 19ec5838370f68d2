/* What the model's files share: what a model holds, and for which slabs of rows. */
#ifndef V2V3D_V2V_MODEL_STATE_H
#define V2V3D_V2V_MODEL_STATE_H

#include "v2v/encoder.h"
#include "v2v/scene.h"
#include "v2v/slabs.h"
#include "v2v/unet.h"
#include "v2v3d/v2v/model.h"

enum { V2V_BRANCHES = 2 };

/* What one slab of rows takes. Its index also counts the views: of every branch's views each slab
 * encodes its part, for all slabs. NULL for a branch not held. */
struct v2v_model_slab {
    struct v2v_encoder *encoder[V2V_BRANCHES];
    struct v2v_unet *unet[V2V_BRANCHES];
    float *workspace[V2V_BRANCHES]; /* one for both without training, and for the encoder before */
    float *encoding[V2V_BRANCHES];  /* the encoders' workspace, training */
    struct v2v_scene scene;         /* where tiles may be skipped */
    float *batch[V2V_BRANCHES];     /* [views of its part,y,x], training */
    float *dbatch[V2V_BRANCHES];    /* [views of its part,feature,y,x] training */
    float *dvolume;                 /* [z,rows computed,x] training */
    struct v2v_parameters parameters; /* the model's weights; gradients of this slab alone, which
                                         tell who watches when there is one slab */
};

struct v2v_model {
    struct v2v_model_spec spec;
    struct v2v_fields fields;
    float *weights, *gradients;
    int64_t encoding_floats; /* of workspace for one view, without training */
    int64_t encoder_floats;  /* of the arenas: the encoder's fields come first */
    int64_t ring;            /* of zeros about the feature planes: the farthest tap */
    int64_t height, width;
    int64_t room, room_a_row; /* floats that a plan leaves to others */
    int training;             /* enum v2v_training */
    int is_listed;            /* strips and tiles in bf16 */
    int64_t held;             /* slabs of this rank */
    struct v2v_model_slab *slab;
    struct v2v_padded *features, *dfeatures; /* [held] */
    struct v2v_slabs *slabs;
    int32_t *views[V2V_BRANCHES]; /* network order */
    int64_t view_count[V2V_BRANCHES];
    struct v2v_shifts shifts;    /* a copy: where light is seen */
    struct v2v_shifts alignment; /* of features: those, or none */
    double computed_part;
    void (*ready)(void *context, int64_t first, int64_t count); /* watches gradients; or NULL */
    void *ready_context;
    int32_t *round[2];            /* [ranks] views under way */
    float *encoder_sum, *scratch; /* of gradients over slabs, training */
    struct v2v_workspace shared;  /* of all convolutions, one after the other */
    struct v2v_pool packed; /* weights of the U-Nets; those of one branch at a time, if it shares */
};

static inline int64_t v2v_model_slabs(const struct v2v_model *model)
{
    return model->spec.slabs > 1 ? model->spec.slabs : 1;
}

static inline int v2v_model_holds(const struct v2v_model *model, int branch)
{
    return (model->spec.branches >> branch & 1) != 0;
}

static inline int v2v_model_first_branch(const struct v2v_model *model)
{
    return v2v_model_holds(model, 0) ? 0 : 1;
}

/* Of a branch's views, those that slab `index` encodes. */
static inline struct v2v_part v2v_model_view_part(const struct v2v_model *model, int branch,
                                                  int64_t index)
{
    return v2v_par_part(model->view_count[branch], v2v_model_slabs(model), index);
}

/* Is anything skipped? */
int v2v_model_skips(const struct v2v_model *model);

/* The slab has rows: its U-Nets are planned. */
static inline int v2v_model_is_used(const struct v2v_model *model, int64_t local)
{
    return v2v_slabs_at(model->slabs, local)->rows > 0;
}

#endif
