/** A network that is trained: the interface that training, checkpoints, weight files,
 *  reconstruction and denoising know it by.
 *
 *  Purpose: one const table of functions a method (struct v2v_network_ops), all of them listed in
 *  method/networks.h. What a network computes, how its parameters are called and which of its
 *  volumes may not see which views is said by the method; everything else is written once, over it.
 *  Invariants: parameters lie in one arena, in the order of the schema's fields; everything is
 *  planned for one frame size; nothing is allocated in forward and backward.
 *
 *  Example (compiled by tests/unit/method):
 *
 *      struct v2v_network_spec spec = {.config = &config, .psf = &psf, .views = psf.views,
 *                                      .slices = psf.slices, .outputs = V2V_NETWORK_ALL};
 *      V2V_TRY(v2v_network_create(&network, "v2v", &spec));
 *      V2V_TRY(v2v_rule_weights(&network->schema.fields, network->weights, V2V_RULE_HE, 7));
 *      V2V_TRY(network->ops->plan(network, &plan));
 *      network->ops->forward(network, volume, views);
 *  done:
 *      v2v_network_destroy(&network);
 */
#ifndef V2V3D_NN_NETWORK_H
#define V2V3D_NN_NETWORK_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/arrays.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/par/grid.h"
#include "v2v3d/tensor/fields.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { V2V_NETWORK_MOST_OUTPUTS = 2, V2V_NETWORK_MOST_GROUPS = 4, V2V_NETWORK_MOST_SIZES = 2 };

/** All outputs, of however many there are. */
#define V2V_NETWORK_ALL 3u

/** A volume: the views that it may not see and is judged by; the mean of all volumes is the result.
 */
struct v2v_output {
    int32_t *held_out; /**< [count] */
    int64_t count;
};

/** Parameters [first, first + count) of the arena and the levels of the grid over which their
 *  gradients are summed after backward, as bits 1u << V2V_GRID_LEVEL_.. */
struct v2v_group {
    const char *name; /**< for people; the same on all ranks */
    int64_t first;
    int64_t count; /**< 0: only ranks that hold another output have it */
    unsigned levels;
};

/** Names and shapes of the parameters of some outputs; groups in the order in which backward
 *  finishes them, the same list on all ranks. */
struct v2v_schema {
    struct v2v_fields fields;
    struct v2v_group group[V2V_NETWORK_MOST_GROUPS];
    int64_t groups;
};

/** What a network is made for. */
struct v2v_network_spec {
    const struct v2v_config *config; /**< the method reads its own section */
    const struct v2v_psf_file *psf;  /**< borrowed at creation; NULL: for the schema alone */
    int64_t views, slices;
    unsigned outputs;             /**< bits 1u << output: what this rank holds */
    int precision;                /**< V2V_PRECISION_F32 or _BF16 */
    double skip;                  /**< 0: nothing; a method may not offer it, see traits */
    int64_t slabs;                /**< of rows that a frame is cut into; 0 and 1: it is not */
    const struct v2v_comm *shard; /**< ranks that compute one slab each; NULL: this one all */
};

/** Frames that a network is planned for. */
struct v2v_network_plan {
    int64_t height, width;           /**< multiples of what describe_work calls a unit */
    int training;                    /**< bool: keep what backward needs */
    struct v2v_projector *projector; /**< for frames of this size, over the shard; borrowed; NULL
                                          unless the method's traits ask for it */
};

/** What a method offers and asks for. */
enum {
    V2V_TRAIT_PROJECTS = 1,  /**< plan() needs a projector */
    V2V_TRAIT_SKIPS = 2,     /**< spec.skip leaves out what the scene doesn't need */
    V2V_TRAIT_BF16 = 4,      /**< spec.precision may be V2V_PRECISION_BF16 */
    V2V_TRAIT_SLABS = 8,     /**< spec.slabs and spec.shard may be more than one */
    V2V_TRAIT_CORRECTS = 16, /**< forward takes a frame's features (method/lessons.h) in the place
                                  of its views, and corrects the volume among them */
    V2V_TRAIT_ANY = 32,      /**< weights serve any number of views and slices */
    V2V_TRAIT_VIEWS = 64     /**< it makes views of views, and knows nothing of optics */
};

/** What the shapes of a network's parameters tell of it; 0: they don't. */
struct v2v_network_sizes {
    struct {
        const char *key; /**< "section.key"; NULL: no more */
        int64_t value;
    } setting[V2V_NETWORK_MOST_SIZES];
    int64_t views, slices;
};

struct v2v_network_ops;

/** What all networks have. The first fields are set by v2v_network_create, the rest by the method's
 *  create and plan. */
struct v2v_network {
    const struct v2v_network_ops *ops;
    struct v2v_schema schema;
    struct v2v_output output[V2V_NETWORK_MOST_OUTPUTS];
    int64_t views;
    int64_t inputs;   /**< images [inputs,y,x] that forward takes: the views, unless method's create
                           says otherwise */
    int64_t slices;   /**< that it makes [slices,y,x], likewise */
    unsigned held;    /**< outputs of this rank, as bits */
    float *weights;   /**< [schema.fields.total] the method's memory */
    float *gradients; /**< likewise, after a plan for training */
    void *self;       /**< the method's own */
};

/** What it is taught by: method/examples.h. */
struct v2v_examples_ops;

struct v2v_network_ops {
    const char *name;                        /**< in configurations and weight files */
    const struct v2v_examples_ops *examples; /**< NULL: views that its volumes have not seen */
    const char *const *keys;   /**< "section.key" .., NULL: settings that its parameters' shapes and
                                  its function depend on; weight files carry them */
    const char *const *before; /**< "section.key=value" .., NULL: what a file that does not name the
                                    key was made with, where that is not the default; may be NULL */
    const char *split; /**< which views which volume sees, in a word; NULL: model.view_split says */
    int outputs;
    unsigned traits;  /**< V2V_TRAIT_.. */
    double skip_auto; /**< the tolerance of skipping that is called auto */
    int64_t crop;     /**< the side of a crop in training that is called auto, a multiple of 32 */

    /** Append the parameters of the outputs in spec to an empty table. @kind Local.
     *  @return V2V_OK | V2V_E_MEMORY | V2V_E_CONFIG */
    enum v2v_status (*declare)(struct v2v_schema *schema, const struct v2v_network_spec *spec);

    /** What shapes tell, of arrays under its parameters' names that nobody has checked. May be
     *  NULL. @kind Local. */
    void (*sizes_of)(struct v2v_network_sizes *sizes, const struct v2v_arrays *arrays);

    /** network->schema is there already; weights are undefined. @kind Local.
     *  @return V2V_OK | V2V_E_MEMORY | V2V_E_INPUT | V2V_E_CONFIG (what doesn't go together) */
    enum v2v_status (*create)(struct v2v_network *network, const struct v2v_network_spec *spec);
    /** After whatever part of create was done; self may be NULL. @kind Local. */
    void (*destroy)(struct v2v_network *network);

    /** Rows, cuts, unit of the sides and an estimate of the memory that inference takes.
     *  @kind Local. */
    void (*describe_work)(struct v2v_grid_work *work, const struct v2v_network_spec *spec,
                          int64_t height, int64_t width);

    /** What the next plans leave free where memory is limited, for arrays that are taken later:
     *  these floats, and more for each row of the volumes of this rank. May be NULL. Local. */
    void (*leave_room)(struct v2v_network *network, int64_t floats, int64_t floats_a_row);
    /** Again with another size replaces the plan. @kind Collective(shard).
     *  @return V2V_OK | V2V_E_MEMORY | V2V_E_INTERNAL; not agreed */
    enum v2v_status (*plan)(struct v2v_network *network, const struct v2v_network_plan *plan);
    /** Rows of the volumes that a rank of the shard computes. @kind Local. */
    struct v2v_part (*rows_of)(const struct v2v_network *network, int rank);

    /** Weights were set or stepped. @kind Local. */
    void (*weights_changed)(struct v2v_network *network);
    /** volume[o] [z,rows,x] of every output held, from views [inputs,y,x]. Collective(shard). */
    void (*forward)(struct v2v_network *network, float *const *volume, const float *views);
    /** The part of the work that the last forward did, 0 .. 1; NULL: 1. @kind Local. */
    double (*computed_part)(const struct v2v_network *network);
    /** From now on backward tells `ready` of gradients [first, first + count) that it will not
     *  touch again, every float of the arena once. @kind Local. */
    void (*watch)(struct v2v_network *network,
                  void (*ready)(void *context, int64_t first, int64_t count), void *context);
    /** Set the gradients to what the last forward makes of dvolume[o] [z,rows,x].
     *  @kind Collective(shard) */
    void (*backward)(struct v2v_network *network, const float *const *dvolume);
};

/** Does this rank hold output `o`? @kind Local. */
static inline int v2v_network_holds(const struct v2v_network *network, int o)
{
    return (network->held >> o & 1) != 0;
}

#ifdef __cplusplus
}
#endif

#endif
