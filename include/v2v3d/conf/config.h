/** The settings of a run, from a strict YAML file.
 *
 *  Purpose: one table of keys (type, default, range, meaning) from which files are read, `--set` is
 *  applied, the resolved configuration is written and `v2v3d init` prints its commented template.
 *  Invariants: after a successful load every value is in its range; unknown, duplicate and
 *  out-of-range keys are errors that name file, line and the nearest known key.
 *
 *  Example (compiled by tests/unit/conf):
 *
 *      struct v2v_config config;
 *      v2v_config_defaults(&config);
 *      V2V_TRY(v2v_config_load(&config, "configs/tiny.yaml"));
 *      V2V_TRY(v2v_config_set(&config, "train.steps=20"));
 *      V2V_TRY(v2v_config_check(&config));
 *      printf("%lld steps\n", (long long)config.train.steps);
 *  done:
 *      return rc;
 */
#ifndef V2V3D_CONF_CONFIG_H
#define V2V3D_CONF_CONFIG_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/loss_terms.h"
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

/** A number, or the word "auto" (decide from the data), or the word "none" (leave as it is). */
enum v2v_number_mode { V2V_NUMBER_AUTO, V2V_NUMBER_NONE, V2V_NUMBER_GIVEN };
struct v2v_number {
    int mode; /**< enum v2v_number_mode */
    double value;
};

/** A whole number that says "auto", of those that may. */
enum { V2V_WHOLE_AUTO = -1 };

enum v2v_normalize { V2V_NORMALIZE_VIEW, V2V_NORMALIZE_NONE };
/** How ranks share a projection: see optics/projector.h. AUTO: what the cost model predicts faster.
 *  Training takes slabs whatever is asked for: the same bits at any rank count. */
enum v2v_split {
    V2V_SPLIT_AUTO,
    V2V_SPLIT_SLICES,
    V2V_SPLIT_SLABS,
    V2V_SPLIT_SLABS_FFTW3_MPI, /**< slabs with V2V_TRANSFORM_FFTW3_MPI; no word of parallel.split */
};
/** How slabs exchange rows for columns: see fft/slabs.h. AUTO: as the cost model predicts
 *  faster; training, where it isn't asked, takes the own one. */
enum v2v_transform { V2V_TRANSFORM_AUTO, V2V_TRANSFORM_OWN, V2V_TRANSFORM_FFTW3_MPI };
enum v2v_reduce { V2V_REDUCE_SUM, V2V_REDUCE_MEAN };
/** Which views the two volumes of the paper's network see: halves, each judged by the other one; or
 *  both all, judged by what they see. */
enum v2v_view_split { V2V_VIEWS_EVEN_ODD, V2V_VIEWS_RANDOM, V2V_VIEWS_ALL };
/** What becomes of two volumes of a frame: their mean, the larger voxel, or a mean by weights of
 *  slices, with which it explains the frame's views best. */
enum v2v_combine { V2V_COMBINE_MEAN, V2V_COMBINE_MAX, V2V_COMBINE_LEARNED };
enum v2v_backend { V2V_BACKEND_ONEDNN, V2V_BACKEND_OPENBLAS };
/** Of the convolutions. BF16: on processors with the instructions, else float32; BF16_ALWAYS: also
 *  where they are emulated. */
enum v2v_precision { V2V_PRECISION_F32, V2V_PRECISION_BF16, V2V_PRECISION_BF16_ALWAYS };
enum v2v_rule { V2V_RULE_KAIMING, V2V_RULE_HASH, V2V_RULE_HE };

/** Of a method: letters, digits, - and _. */
#define V2V_CONFIG_NAME_BYTES 32
/** Of any other text: one line. */
#define V2V_CONFIG_TEXT_BYTES 2048

/** Of a folder of TIFFs: each is a view of all frames, or holds frames, one file after the other.
 *  AUTO: what the number of views fits alone. */
enum v2v_layout { V2V_LAYOUT_AUTO, V2V_LAYOUT_VIEWS, V2V_LAYOUT_FRAMES };

/** What becomes of pixels brighter than light through the PSFs can make one. */
enum v2v_hot_pixels { V2V_HOT_PIXELS_MEND, V2V_HOT_PIXELS_KEEP };

/** Where the frames of a recording or volume lie in a file, and how they are read. */
struct v2v_input_settings {
    int64_t views;                             /**< 0: as many as the PSF set has */
    char without_views[V2V_CONFIG_TEXT_BYTES]; /**< "3, 7": not used, nor their PSFs */
    int64_t first_view;                        /**< page of the first frame's first view */
    int64_t stride;                            /**< pages from frame to frame; 0: `views` */
    int layout;                                /**< enum v2v_layout: of a folder */
    int64_t channel;                     /**< of a TIFF hyperstack, from 1; 0: it has but one */
    char dataset[V2V_CONFIG_TEXT_BYTES]; /**< of an HDF5 file; "": /views, /volume */
    int64_t slices; /**< of a frame of a TIFF volume that does not say; 0: all pages */
    double pixel_size_um, slice_spacing_um, frame_interval_s; /**< 0: as the file says */
    /** Subtracted from the counts; auto: as the file states, else a guess (io/scaling.h). */
    struct v2v_number offset;
    struct v2v_number gain; /**< multiplied on; auto: the recording's mean becomes 0.2 */
    int hot_pixels;         /**< enum v2v_hot_pixels */
};

/** Samples of the field that `psf simulate` propagates. BAND: as fine as its band asks for, a pixel
 *  is the mean of its samples. PIXEL: one in the middle of each pixel, on a grid as wide as the PSF
 *  that repeats itself; frequencies beyond 1/(2 pixels) fold. */
enum v2v_optics_sampling { V2V_OPTICS_SAMPLING_BAND, V2V_OPTICS_SAMPLING_PIXEL };

/** The largest of Noll's indices that an aberration may have: radial orders 0 .. 7. */
enum { V2V_ZERNIKE_MOST = 36 };

/** What `psf simulate` divides by. */
enum v2v_optics_normalize {
    V2V_OPTICS_NORMALIZE_VIEW,
    V2V_OPTICS_NORMALIZE_SLICE,
    V2V_OPTICS_NORMALIZE_NONE,
};

/** The scalar wave-optics model of `psf simulate`: sub-apertures of a pupil, a view each. Two
 *  photons: needle beams (2pSAM); one: microlenses in the pupil plane (Fourier light field), or,
 *  with a single one that fills the pupil, a wide-field stack. */
struct v2v_optics_settings {
    int64_t rings; /**< rings of tilted views about the central one */
    int64_t views_per_ring;
    /** "y x, y x, ..", of the pupil's radius, a pair a view; "": the rings */
    char tilts[V2V_CONFIG_TEXT_BYTES];
    double numerical_aperture; /**< of the objective: bounds the tilt */
    double needle_aperture;    /**< of one sub-aperture */
    double beam_radius;        /**< of a Gaussian beam where its intensity falls to 1/e^2, of the
                             sub-aperture's; 0: uniform */
    double pinhole_um;         /**< radius, in the sample; 0: none */
    double pinhole_defocus_um; /**< of the beam in the pinhole, in the sample */
    double refractive_index;
    double immersion_index;              /**< where it differs from the sample's; 0: it doesn't */
    double depth_um;                     /**< of the focus below the boundary of both indices */
    double wavelength_um;                /**< in vacuum: excitation, or emission of one photon */
    int64_t photons;                     /**< 1 or 2: the power of the intensity */
    char zernike[V2V_CONFIG_TEXT_BYTES]; /**< "4:0.1, 11:-0.05": waves RMS by Noll's index */
    double pixel_size_um;
    double slice_spacing_um;
    double focus_slice; /**< of the focus, slices from the middle one */
    int64_t slices;
    int64_t size;  /**< pixels of a PSF's side */
    int64_t shift; /**< pixels down and right from the PSF's centre, of all views */
    int sampling;  /**< enum v2v_optics_sampling */
    int normalize; /**< enum v2v_optics_normalize */
};

struct v2v_loss_settings {
    int profile; /**< enum v2v_loss_profile: what the weights below mean and their auto values */
    struct v2v_number weight[V2V_LOSS_TOTAL]; /**< in the order of conf/loss_terms.h */
};

/** How the learning rate goes: by decay and decay_at, or up in a few steps and down in a straight
 *  line to the end, which is that of the steps or of the time that is given. */
enum v2v_schedule { V2V_SCHEDULE_STEPS, V2V_SCHEDULE_LINEAR };

struct v2v_train_settings {
    int64_t steps;
    int64_t batch;         /**< crops of one step over all ranks */
    int64_t crop;          /**< pixels of a side, a multiple of 32; 0: the whole frame; or
                                V2V_WHOLE_AUTO: the network's, less where frames are smaller */
    int64_t halo;          /**< ring of a crop that the views' loss leaves out, pixels */
    int64_t candidates;    /**< positions of which the brightest becomes the crop; 1: any */
    int flips;             /**< bool: flips that map the view set onto itself */
    double flip_tolerance; /**< relative L2 distance of a flipped PSF to its partner */
    double learning_rate;
    int schedule;     /**< enum v2v_schedule */
    double decay;     /**< learning rate factor .. */
    int64_t decay_at; /**< .. from this step on; 0: never */
    double average;   /**< memory of the weights' running mean, which is the result; 0: the last */
    double clip_norm; /**< a longer gradient is scaled down to it; 0: none is */
    double beta1, beta2, epsilon;
    int64_t seed;
    int init;      /**< enum v2v_rule: fresh weights */
    int precision; /**< enum v2v_precision */
    double checkpoint_every_s;
    int64_t log_every;
    int64_t check_every; /**< steps between comparisons of the ranks' weights; 0: none */
};

struct v2v_recon_settings {
    int precision;              /**< enum v2v_precision */
    struct v2v_number skip;     /**< of the brightest light; none: nothing is skipped */
    int64_t refresh;            /**< with skip, frames from one whole frame to the next */
    struct v2v_number strength; /**< unrolled: part of the correction that is made, 0 .. 1 */
    int64_t neighbours;         /**< frames on either side that a frame is fused with */
    int combine;                /**< enum v2v_combine */
};

/** When a deconvolution ends: after all iterations, or when views that are held out are predicted
 *  hardly better any more. */
enum v2v_stop { V2V_STOP_FIXED, V2V_STOP_HELDOUT };

/** Of the views: the same for every sample; or of photons, its variance growing with the light.
 *  AUTO: the second where the views show it; of a recording its first frame decides. */
enum v2v_noise_model { V2V_NOISE_MODEL_AUTO, V2V_NOISE_MODEL_GAUSSIAN, V2V_NOISE_MODEL_POISSON };

/** Methods that deconvolve by iteration. */
struct v2v_deconv_settings {
    char method[V2V_CONFIG_NAME_BYTES]; /**< an estimator of method/estimator.h */
    int64_t iterations;                 /**< over all views; with a rule, the most; 0: the
                                             method's own */
    double weight;                      /**< of a view's correction */
    int stop;                           /**< enum v2v_stop */
    struct v2v_number
        lambda; /**< tv: weight of the variation, in units of the noise of the views */
    int noise;  /**< tv: enum v2v_noise_model */
    struct v2v_number electrons_per_count; /**< tv: of the camera, for noise of photons .. */
    struct v2v_number read_noise;          /**< .. and, in electrons, beside it; auto: estimated */
    double depth;     /**< tv: of differences along z, against those along x and y */
    double curvature; /**< tv: weight of curvature in the plane, of lambda; 0: variation alone */
    struct v2v_number
        sparsity; /**< tv: weight of the volume itself, in noise that a voxel sees of the views */
    double tolerance; /**< tv: change of an iteration that ends them, of the volume */
};

/** diner: an implicit field that is fitted to a frame. */
struct v2v_diner_settings {
    int64_t width;       /**< of the network's hidden layers */
    double table_rate;   /**< learning rate of the voxels' coordinates .. */
    double network_rate; /**< .. and of the network */
};

/** Views of cameras side by side, and the network that makes each of the others. A point is at its
 *  place less disparity * position in the view of a camera at this position. */
struct v2v_synthesis_settings {
    int64_t planes;           /**< disparities that views are warped by, evenly from .. */
    double nearest, farthest; /**< .. to: pixels a unit of baseline */
    char cameras[V2V_CONFIG_TEXT_BYTES]; /**< "y x, y x, ..", units of baseline; "": a grid */
    int64_t width;                       /**< channels of the U-Net's first level */
    int64_t levels;                      /**< of the U-Net */
};

/** The scene and the noise of `v2v3d demo`. */
struct v2v_demo_settings {
    int64_t size; /**< pixels of a side */
    int64_t frames;
    double noise; /**< gaussian:S */
    int64_t seed;
    int64_t rld_iterations;
};

struct v2v_config {
    struct {
        int64_t branches; /**< ranks of a slab, with a branch each; 0: chosen */
        int64_t shards;   /**< ranks of a frame or crop, with a slab of its rows each; 0: chosen */
        int64_t slabs;    /**< of rows in training, on one rank or on `shards`: the results' bits
                               depend on their number; 0: as shards, or one */
        int64_t threads;  /**< 0: cores / ranks on this host */
        int split;        /**< enum v2v_split */
        int transform;    /**< enum v2v_transform */
        double watchdog_s;
        double max_mem_gb; /**< of a rank; 0: no limit */
        int reproducible;  /**< bool: the same bits at any rank count and grid, or a refusal */
    } parallel;
    struct v2v_input_settings input;
    struct {
        int normalize; /**< enum v2v_normalize */
        int reduce;    /**< enum v2v_reduce: of networks, project and evaluate */
    } psf;
    struct v2v_optics_settings optics;
    struct {
        char method[V2V_CONFIG_NAME_BYTES]; /**< a trainable network of method/networks.h */
        int64_t width;                      /**< the paper's n = 128 */
        int64_t features;                   /**< per view, 4 */
        int backend;                        /**< enum v2v_backend */
        int winograd, merge;                /**< how the network's convolutions are computed */
        double volume_scale;                /**< volume = this * the network's output */
        int view_split;                     /**< enum v2v_view_split */
        int64_t view_seed;                  /**< of V2V_VIEWS_RANDOM */
        int align;                          /**< bool: features are shifted as the PSFs say */
        int homogeneous;                    /**< bool: every frame is brought to one level and its
                                                 volume back, io/scaling.h */
    } model;
    struct {
        int64_t width; /**< channels between its layers */
    } backconv;
    struct {
        int64_t width, levels; /**< of the U-Net */
    } vcdnet;
    struct {
        int64_t width, levels; /**< of the U-Net */
        int64_t frames;        /**< that it sees at once, a multiple of 1 << (levels - 1) */
    } deepcad;
    struct v2v_synthesis_settings synthesis;
    struct v2v_loss_settings loss;
    struct v2v_train_settings train;
    struct v2v_recon_settings recon;
    struct v2v_deconv_settings deconv;
    struct v2v_diner_settings diner;
    struct v2v_demo_settings demo;
};

/** @kind Local. */
void v2v_config_defaults(struct v2v_config *config);

/** Apply a YAML file. @kind Local (read on rank 0 and broadcast the struct, or on every rank).
 *  @return V2V_OK | V2V_E_CONFIG (names file, line, key, nearest key or range; also when the file
 *          can't be read, is larger than 1 MiB or holds NUL bytes) | V2V_E_MEMORY */
enum v2v_status v2v_config_load(struct v2v_config *config, const char *path) V2V_MUST_CHECK;

/** Apply one "section.key=value", which may contradict others until they are set, too:
 *  v2v_config_check after the last. @kind Local. @return V2V_OK | V2V_E_CONFIG */
enum v2v_status v2v_config_set(struct v2v_config *config, const char *assignment) V2V_MUST_CHECK;

/** The rules between settings, as v2v_config_load checks them. @kind Local. @return V2V_OK |
 *  V2V_E_CONFIG (names the key that breaks one) */
enum v2v_status v2v_config_check(const struct v2v_config *config) V2V_MUST_CHECK;

/** The value of "section.key" as v2v_config_set takes it. @kind Local. @param text of `bytes`; 64
 *  are enough for all but texts. @return V2V_OK | V2V_E_CONFIG (no such key) | V2V_E_INPUT (it
 *  does not fit) */
enum v2v_status v2v_config_get(char *text, size_t bytes, const struct v2v_config *config,
                               const char *key) V2V_MUST_CHECK;

/** Write the resolved configuration as YAML that v2v_config_load takes back to the same bits; with
 *  `comments` each key's meaning, default and range beside it. @kind Local. @param only this
 *  section alone; NULL: all */
void v2v_config_print(const struct v2v_config *config, FILE *stream, const char *only,
                      int comments);

/** The same as a text, which free() takes back. @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_config_text(char **text, const struct v2v_config *config, const char *only,
                                int comments) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
