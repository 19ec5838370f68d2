/** What networks are taught by that are not judged by views that they have not seen: examples,
 *  images that go in and those that the network should make of them.
 *
 *  Purpose: one const table of functions a kind of example, which a network's table names
 *  (v2v3d/nn/network.h); training draws crops of them, by one loss, whatever they are.
 *  Invariants: the same bits for the same (frame, number, train.seed) on any rank.
 *
 *  Example (compiled by tests/unit/train):
 *
 *      V2V_TRY(v2v_examples_create(&examples, network->examples, &config, &psf));
 *      count = (examples->inputs + examples->outputs) * height * width;
 *      V2V_TRY(V2V_ALLOC(images, "images", count));
 *      V2V_TRY(examples->ops->make(examples, images, &source, t, 0));
 *  done:
 *      v2v_examples_destroy(&examples);
 */
#ifndef V2V3D_METHOD_EXAMPLES_H
#define V2V3D_METHOD_EXAMPLES_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/io/volume.h"
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** A recording to learn from. */
struct v2v_example_source {
    struct v2v_recording *recording; /**< borrowed */
    struct v2v_scaling scaling;
    struct v2v_volume *truth; /**< of its frames; borrowed; NULL: not known */
    double units;             /**< its truth is multiplied by: v2v_examples_truth_units */
};

/** How an example may be mirrored along y and x. */
enum v2v_mirroring {
    V2V_MIRROR_IMAGES, /**< every image by itself; y and x may change places, too */
    V2V_MIRROR_VIEWS,  /**< views trade places, where the PSFs allow it; the other images by
                            themselves */
};

struct v2v_estimator_ops;
struct v2v_examples_ops;

struct v2v_examples {
    const struct v2v_examples_ops *ops;
    const struct v2v_config *config; /**< borrowed */
    const struct v2v_psf_file *psf;  /**< borrowed; without `data` where the method has no optics */
    int64_t inputs, outputs;         /**< images that go in, and that should come out */
    int64_t frames; /**< that one is made of: the one asked for and those after it */
    void *self;     /**< the kind's own */
};

struct v2v_examples_ops {
    const char *name;  /**< what the network learns from, for messages */
    int mirroring;     /**< enum v2v_mirroring */
    int is_of_view;    /**< bool: there is one of every view of a frame; else one of a frame */
    int needs_truth;   /**< bool: source->truth */
    int needs_cameras; /**< bool: what goes in goes by where the cameras of all views are */
    const struct v2v_estimator_ops *estimator; /**< that makes volumes for them; NULL: none */
    int64_t steps_of_one; /**< above 0: they take time to make, and one is added every so many
                               steps, of a frame that is drawn; 0: all are drawn from at once */

    /** Set inputs, outputs, frames (which is 1) and self. @kind Local.
     *  @return V2V_OK | V2V_E_MEMORY | V2V_E_CONFIG | V2V_E_INPUT */
    enum v2v_status (*create)(struct v2v_examples *examples);
    /** After whatever part of create was done; self may be NULL. @kind Local. */
    void (*destroy)(struct v2v_examples *examples);
    /** The example of frame t. @kind Local; may plan anew for frames of another size.
     *  @param images [inputs + outputs,y,x] out, of whole frames
     *  @param number of the view, or, with steps_of_one, how many were made before
     *  @return V2V_OK | V2V_STOPPED | V2V_E_INPUT | V2V_E_NUMERIC | V2V_E_CONFIG | V2V_E_MEMORY */
    enum v2v_status (*make)(struct v2v_examples *examples, float *images,
                            const struct v2v_example_source *source, int64_t t, int64_t number);
    /** For networks that make views of views: what goes in for view v of these frames, to make its
     *  `outputs` frames. NULL: others. @kind Local, no allocation.
     *  @param images [inputs,y,x] out @param frames [outputs,v,y,x], scaled */
    void (*inputs_of_view)(const struct v2v_examples *examples, float *images, const float *frames,
                           int64_t v, int64_t height, int64_t width);
};

/** @kind Local. @param config, psf borrowed @return V2V_OK or as the kind's create */
enum v2v_status v2v_examples_create(struct v2v_examples **examples,
                                    const struct v2v_examples_ops *ops,
                                    const struct v2v_config *config,
                                    const struct v2v_psf_file *psf) V2V_MUST_CHECK;
/** Accepts NULL; nulls the pointer. @kind Local. */
void v2v_examples_destroy(struct v2v_examples **examples);

/** Frame t and what was made of it by total variation: method/lessons.h. */
extern const struct v2v_examples_ops v2v_examples_lessons;
/** A frame's views, and its true volume, in the views' scale. */
extern const struct v2v_examples_ops v2v_examples_truth;
/** What brings the true volumes of a source to the units of its views: 1, but where they show twice
 *  their views' light and more, or half and less, all frames together.
 *  @kind Local. @param source units out @cost reads all frames of both
 *  @return V2V_OK | V2V_E_MEMORY | V2V_E_INPUT (reading: NaN or Inf in a truth, too) */
enum v2v_status v2v_examples_truth_units(struct v2v_example_source *source,
                                         const struct v2v_psf_file *psf) V2V_MUST_CHECK;
/** Of 2 n frames of a view the odd ones (the first, the third, ..), and the even ones. */
extern const struct v2v_examples_ops v2v_examples_odd_even;
/** A view, and mean and standard deviation of the others, moved to where they would show planes
 *  at synthesis.planes disparities as it does: [mean, deviation] of each. */
extern const struct v2v_examples_ops v2v_examples_left_out_view;

#ifdef __cplusplus
}
#endif

#endif
