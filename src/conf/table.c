#include "conf/table.h"

#define AT(s, n) .section = #s, .name = #n, .offset = offsetof(struct v2v_config, s.n)

#define WHOLE(s, n, least_, most_, fallback_, meaning_)                                            \
    {                                                                                              \
        AT(s, n), .kind = V2V_KEY_WHOLE, .whole = {least_, most_, fallback_, 1},                   \
                  .meaning = meaning_                                                              \
    }

#define MULTIPLE(s, n, of, least_, most_, fallback_, meaning_)                                     \
    {                                                                                              \
        AT(s, n), .kind = V2V_KEY_WHOLE, .whole = {least_, most_, fallback_, of},                  \
                  .meaning = meaning_                                                              \
    }

/* The same, or "auto", as it is by itself. */
#define MULTIPLE_OR_AUTO(s, n, of, least_, most_, meaning_)                                        \
    {                                                                                              \
        AT(s, n), .kind = V2V_KEY_WHOLE, .whole = {least_, most_, V2V_WHOLE_AUTO, of, 1},          \
                  .meaning = meaning_                                                              \
    }

#define REAL(s, n, least_, most_, fallback_, meaning_)                                             \
    {                                                                                              \
        AT(s, n), .kind = V2V_KEY_REAL, .real = {least_, most_, fallback_}, .meaning = meaning_    \
    }

#define BOOL(s, n, fallback_, meaning_)                                                            \
    {                                                                                              \
        AT(s, n), .kind = V2V_KEY_BOOL, .whole = {0, 1, fallback_, 1}, .words = {"false", "true"}, \
                  .meaning = meaning_                                                              \
    }

#define WORD(s, n, fallback_, meaning_, ...)                                                       \
    {                                                                                              \
        AT(s, n), .kind = V2V_KEY_WORD, .whole = {0, 0, fallback_, 1}, .words = {__VA_ARGS__},     \
                  .meaning = meaning_                                                              \
    }

/* A number, "auto" or "none", `at` its place in the section. */
#define NUMBER(s, n, at, mode_, least_, most_, meaning_)                                           \
    {                                                                                              \
        .section = #s, .name = #n, .offset = offsetof(struct v2v_config, s.at),                    \
        .kind = V2V_KEY_NUMBER, .real = {least_, most_, 0.0}, .none = "none", .mode = mode_,       \
        .meaning = meaning_                                                                        \
    }

/* A number or "auto". */
#define AUTO(s, n, mode_, least_, most_, fallback_, meaning_)                                      \
    {                                                                                              \
        AT(s, n), .kind = V2V_KEY_NUMBER, .real = {least_, most_, fallback_}, .mode = mode_,       \
                  .meaning = meaning_                                                              \
    }

/* A number, "auto" or, as it is by itself, "default". */
#define USUAL(s, n, least_, most_, fallback_, meaning_)                                            \
    {                                                                                              \
        AT(s, n), .kind = V2V_KEY_NUMBER, .real = {least_, most_, fallback_}, .none = "default",   \
                  .mode = V2V_NUMBER_NONE, .meaning = meaning_                                     \
    }

/* The weight of a term of the loss, from its row. */
#define TERM(NAME, name_, meaning_, ...)                                                           \
    NUMBER(loss, name_, weight[V2V_LOSS_##NAME], V2V_NUMBER_AUTO, 0.0, 1e9, meaning_),

/* The name of a method; who knows the methods checks it. */
#define NAME(s, n, fallback_, meaning_)                                                            \
    {                                                                                              \
        AT(s, n), .kind = V2V_KEY_NAME, .words = {fallback_}, .meaning = meaning_                  \
    }

/* Any text of one line. */
#define TEXT(s, n, meaning_)                                                                       \
    {                                                                                              \
        AT(s, n), .kind = V2V_KEY_TEXT, .meaning = meaning_                                        \
    }

#define BILLION 1000000000

/* enum v2v_precision */
#define PRECISIONS "f32", "bf16", "bf16-always"
#define PRECISION_MEANING "of the convolutions; bf16: if processors have it; -always: or emulate it"

/* clang-format off */
const struct v2v_key v2v_key_table[] = {
    WHOLE(parallel, branches, 0, 2, 0, "ranks of a slab, with a branch each; 0: chosen"),
    WHOLE(parallel, shards, 0, 4096, 0, "ranks of a frame, with a slab of rows each; 0: chosen"),
    WHOLE(parallel, slabs, 0, 64, 0, "of rows in training: bits depend on it; 0: as shards"),
    WHOLE(parallel, threads, 0, 4096, 0, "OpenMP threads of a rank; 0: cores / ranks of this host"),
    WORD(parallel, split, V2V_SPLIT_AUTO, "how ranks share projections; tv and diner: by slabs",
         "auto", "slices", "slabs"),
    WORD(parallel, transform, V2V_TRANSFORM_AUTO, "how slabs exchange rows for columns",
         "auto", "own", "fftw3-mpi"),
    REAL(parallel, watchdog_s, 0.0, 86400.0, 600.0,
         "a longer time without progress ends the job, s; 0: off"),
    REAL(parallel, max_mem_gb, 0.0, 1e9, 0.0, "that a rank may hold, GB; 0: no limit"),
    BOOL(parallel, reproducible, 0, "the same bits at any rank count; threads 0 then is 1"),

    WHOLE(input, views, 0, 4096, 0, "views of a frame; 0: as many as the PSF set has"),
    TEXT(input, without_views, "3, 7, ..: from 0, of PSFs and recordings, that are not used"),
    WHOLE(input, first_view, 0, BILLION, 0, "page of the first frame's first view, from 0"),
    WHOLE(input, stride, 0, BILLION, 0, "pages from frame to frame; 0: as many as views"),
    WORD(input, layout, V2V_LAYOUT_AUTO, "of a folder: a file a view, or files of frames",
         "auto", "views", "frames"),
    WHOLE(input, channel, 0, 4096, 0, "of a TIFF hyperstack, from 1; 0: it has but one"),
    WHOLE(input, slices, 0, BILLION, 0, "of a frame of a TIFF volume that does not say; 0: all"),
    TEXT(input, dataset, "of an HDF5 file to read instead of /views or /volume"),
    REAL(input, pixel_size_um, 0.0, 1e6, 0.0, "um; 0: as the file says"),
    REAL(input, slice_spacing_um, 0.0, 1e6, 0.0, "um; 0: as the file says, or the PSFs"),
    REAL(input, frame_interval_s, 0.0, 1e9, 0.0, "s; 0: as the file says"),
    NUMBER(input, offset, offset, V2V_NUMBER_AUTO, -1e9, 1e9,
           "subtracted; auto: as the file states, else 32767 of what looks like signed counts"),
    NUMBER(input, gain, gain, V2V_NUMBER_AUTO, 1e-12, 1e12,
           "multiplied on; auto: the recording's mean becomes 0.2"),
    WORD(input, hot_pixels, V2V_HOT_PIXELS_MEND,
         "mend: pixels brighter than light through the PSFs, or darker than the dark, are taken "
         "from their neighbours",
         "mend", "keep"),

    WORD(psf, normalize, V2V_NORMALIZE_VIEW, "view: each view sums to 1", "view", "none"),
    WORD(psf, reduce, V2V_REDUCE_SUM,
         "how depth slices add up in a projection, of networks, project and evaluate; "
         "deconvolution and simulation sum",
         "sum", "mean"),

    WHOLE(optics, rings, 0, 16, 2, "rings of tilted views about the central one"),
    WHOLE(optics, views_per_ring, 1, 256, 6, "views of a ring"),
    TEXT(optics, tilts, "y x, y x, ..: of the pupil's radius, a pair a view; instead of rings"),
    REAL(optics, numerical_aperture, 0.01, 1.9, 0.95, "of the objective: bounds the tilt"),
    REAL(optics, needle_aperture, 0.005, 1.9, 0.25, "of one sub-aperture"),
    REAL(optics, beam_radius, 0.0, 100.0, 0.0,
         "of a Gaussian beam, 1/e^2, of the sub-aperture's; 0: uniform"),
    REAL(optics, pinhole_um, 0.0, 1e4, 0.0, "radius of the beam's pinhole, in the sample; 0: none"),
    REAL(optics, pinhole_defocus_um, -1e4, 1e4, 0.0, "of the beam in the pinhole, in the sample"),
    REAL(optics, refractive_index, 1.0, 2.0, 1.33, "of the sample"),
    REAL(optics, immersion_index, 0.0, 2.0, 0.0, "0: the sample's"),
    REAL(optics, depth_um, -1e4, 1e4, 0.0, "of the focus below the boundary of both indices"),
    REAL(optics, wavelength_um, 0.1, 10.0, 0.92, "in vacuum, um"),
    WHOLE(optics, photons, 1, 2, 2, "power of the intensity; 1: light field or wide field"),
    TEXT(optics, zernike, "aberration, 4:0.1, 11:-0.05: waves RMS by Noll's index"),
    REAL(optics, pixel_size_um, 0.01, 100.0, 0.5, "um"),
    REAL(optics, slice_spacing_um, 0.01, 1000.0, 0.5, "um"),
    REAL(optics, focus_slice, -1024.0, 1024.0, 0.0, "of the focus, slices from the middle one"),
    WHOLE(optics, slices, 1, 1024, 39, "depth slices"),
    WHOLE(optics, size, 3, 2048, 63, "pixels of a PSF's side"),
    WHOLE(optics, shift, -1024, 1024, 0, "pixels down and right from the PSF's centre, all views"),
    WORD(optics, sampling, V2V_OPTICS_SAMPLING_BAND,
         "band: as fine as needed; pixel: one a pixel, what is finer folds", "band", "pixel"),
    WORD(optics, normalize, V2V_OPTICS_NORMALIZE_VIEW, "what sums to 1", "view", "slice", "none"),

    NAME(model, method, "v2v", "v2v (the paper's), backconv, unrolled, vcdnet, deepcad, synthesis"),
    WHOLE(model, width, 1, 1024, 128, "channels of the U-Net's first level"),
    WHOLE(model, features, 1, 64, 4, "features of a view"),
    WORD(model, backend, V2V_BACKEND_ONEDNN, "library that convolves", "onednn", "openblas"),
    BOOL(model, winograd, 1, "3 x 3 convolutions by Winograd where it is faster"),
    BOOL(model, merge, 1, "merge the first convolution's taps that read the same pixel"),
    REAL(model, volume_scale, 1e-12, 1e12, 1.0, "volume = this * the network's output"),
    WORD(model, view_split, V2V_VIEWS_EVEN_ODD,
         "v2v: views of the two volumes; all: both see and are judged by all",
         "even-odd", "random", "all"),
    WHOLE(model, view_seed, 0, BILLION, 1, "v2v: of random halves"),
    BOOL(model, align, 1, "v2v: shift features as the PSFs say"),
    BOOL(model, homogeneous, 0, "views s times as bright give s times the volume, frame by frame"),

    WHOLE(backconv, width, 1, 1024, 32, "channels between the three convolutions"),

    WHOLE(vcdnet, width, 1, 1024, 64, "channels of the U-Net's first level"),
    WHOLE(vcdnet, levels, 1, 6, 4, "of the U-Net: each has half the sides, twice the channels"),

    WHOLE(deepcad, width, 1, 1024, 16, "channels of the U-Net's first level"),
    WHOLE(deepcad, levels, 1, 6, 4, "of the U-Net: each has half the sides, twice the channels"),
    WHOLE(deepcad, frames, 1, 4096, 32, "seen at once, a multiple of 2^(levels - 1)"),

    WHOLE(synthesis, planes, 2, 256, 16, "disparities that views are warped by"),
    REAL(synthesis, nearest, -1e3, 1e3, 8.0, "disparity, pixels a unit of baseline"),
    REAL(synthesis, farthest, -1e3, 1e3, 0.5, "likewise"),
    TEXT(synthesis, cameras, "y x, y x, ..: a pair a view, in units of baseline; a square grid"),
    WHOLE(synthesis, width, 1, 1024, 16, "channels of the U-Net's first level"),
    WHOLE(synthesis, levels, 1, 6, 3, "of the U-Net"),

    WORD(loss, profile, V2V_LOSS_REFERENCE, "what the weights below mean", "reference", "paper"),
    V2V_LOSS_VIEW_TERMS(TERM)
    V2V_LOSS_VOLUME_TERMS(TERM)

    WHOLE(train, steps, 1, BILLION, 2000, "optimiser steps"),
    WHOLE(train, batch, 1, 65536, 1, "crops of one step over all ranks"),
    MULTIPLE_OR_AUTO(train, crop, 32, 0, 65536,
                     "pixels of a crop's side; 0: the whole frame; auto: 128, or 64 of unrolled, "
                     "vcdnet and deepcad, less where frames are smaller"),
    WHOLE(train, halo, 0, 32768, 16, "ring of a crop that the views' loss leaves out, pixels"),
    WHOLE(train, candidates, 1, 1024, 1, "positions, of which the brightest is taken; 1: any"),
    BOOL(train, flips, 1, "flips that map the view set onto itself"),
    REAL(train, flip_tolerance, 0.0, 2.0, 0.1, "relative L2 distance, flipped PSF to partner"),
    REAL(train, learning_rate, 0.0, 1.0, 8e-5, "Adam's step"),
    WORD(train, schedule, V2V_SCHEDULE_STEPS,
         "steps: by decay and decay_at; linear: falling to the end of the steps or of --max-time",
         "steps", "linear"),
    REAL(train, decay, 0.0, 1.0, 0.3, "factor on the learning rate .."),
    WHOLE(train, decay_at, 0, BILLION, 0, ".. from this step on; 0: never"),
    REAL(train, average, 0.0, 0.999999, 0.0,
         "memory of the weights' running mean, which is the result; 0: the last ones"),
    REAL(train, clip_norm, 0.0, 1e12, 0.0, "a longer gradient is scaled down to it; 0: none is"),
    REAL(train, beta1, 0.0, 0.9999999, 0.9, "Adam: memory of the mean"),
    REAL(train, beta2, 0.0, 0.9999999, 0.999, "Adam: memory of the mean square"),
    REAL(train, epsilon, 1e-30, 1.0, 1e-8, "Adam: added to the root"),
    WHOLE(train, seed, 0, INT64_MAX, 1, "of crops, flips and initial weights"),
    WORD(train, init, V2V_RULE_KAIMING,
         "fresh weights; kaiming: PyTorch's default; he: He et al. 2015; hash: golden vectors",
         "kaiming", "hash", "he"),
    WORD(train, precision, V2V_PRECISION_F32, PRECISION_MEANING, PRECISIONS),
    REAL(train, checkpoint_every_s, 0.0, 1e9, 600.0, "s; 0: after every step"),
    WHOLE(train, log_every, 1, BILLION, 1, "steps from one line of metrics to the next"),
    WHOLE(train, check_every, 0, BILLION, 100, "steps; then the ranks compare weights; 0: never"),

    WORD(recon, precision, V2V_PRECISION_F32, PRECISION_MEANING, PRECISIONS),
    NUMBER(recon, skip, skip, V2V_NUMBER_NONE, 0.0, 1.0,
           "light, of the brightest, below which nothing is computed; tv, unrolled: change of it "
           "since the last whole frame"),
    WORD(recon, combine, V2V_COMBINE_MEAN, "what becomes of a network's two volumes",
         "mean", "max", "learned"),
    WHOLE(recon, refresh, 1, BILLION, 20, "with skip over time: from one whole frame to the next"),
    AUTO(recon, strength, V2V_NUMBER_AUTO, 0.0, 1.0, 0.0,
         "unrolled: of the correction; auto: by views left out of the first frame"),
    WHOLE(recon, neighbours, 0, 1000, 0,
          "frames on either side whose views are averaged in, moved along, where they then agree"),

    NAME(deconv, method, "tv", "tv (total variation), rl, rld, frl (Richardson-Lucy) or diner"),
    WHOLE(deconv, iterations, 0, 10000, 0, "at most; 0: rl 30, rld and frl 10, tv 500, diner 1500"),
    REAL(deconv, weight, 1e-6, 1.0, 0.5, "rld, frl: of a view's correction"),
    WORD(deconv, stop, V2V_STOP_FIXED, "when held-out views gain no more", "fixed", "heldout"),
    USUAL(deconv, lambda, 0.0, 1e3, 0.03,
          "tv: weight of the variation, in noise of the views; auto: by views left out; default: "
          "by the noise, auto where more than noise is missed, or less or more is wanted"),
    WORD(deconv, noise, V2V_NOISE_MODEL_AUTO,
         "tv: the same for all samples, or of photons; auto: as the first frame shows", "auto",
         "gaussian", "poisson"),
    AUTO(deconv, electrons_per_count, V2V_NUMBER_AUTO, 1e-9, 1e9, 0.0,
         "tv: of the camera, for noise of photons; auto: by the views"),
    AUTO(deconv, read_noise, V2V_NUMBER_AUTO, 0.0, 1e9, 0.0,
         "tv: of the camera, electrons, rms; auto: by the views"),
    REAL(deconv, depth, 0.0, 100.0, 0.25, "tv: of differences along z, of those along x and y"),
    REAL(deconv, curvature, 0.0, 100.0, 0.5, "tv: weight of curvature in the plane, of lambda"),
    AUTO(deconv, sparsity, V2V_NUMBER_AUTO, 0.0, 1e3, 0.0,
         "tv: weight of the volume itself, in noise that a voxel sees; auto: none, but where views "
         "left out want it, as of points of light"),
    REAL(deconv, tolerance, 0.0, 1.0, 0.015,
         "tv: least change of an iteration, of the volume; less where there is hardly any noise"),

    MULTIPLE(diner, width, 32, 32, 256, 64, "of the network's hidden layers"),
    REAL(diner, table_rate, 0.0, 10.0, 0.1, "learning rate of the voxels' coordinates"),
    REAL(diner, network_rate, 0.0, 10.0, 0.04, "of the network's weights"),

    MULTIPLE(demo, size, 32, 32, 8192, 128, "pixels of the scene's side"),
    WHOLE(demo, frames, 1, 1000000, 4, "of the recording"),
    REAL(demo, noise, 0.0, 100.0, 0.1, "Gaussian noise, fraction of the bright pixels"),
    WHOLE(demo, seed, 0, INT64_MAX, 1, "of scene and noise"),
    WHOLE(demo, rld_iterations, 1, 10000, 10, "most iterations of the deconvolution"),
};
/* clang-format on */

const int64_t v2v_key_count = (int64_t)(sizeof v2v_key_table / sizeof v2v_key_table[0]);
_Static_assert(sizeof v2v_key_table / sizeof v2v_key_table[0] <= V2V_KEY_MOST,
               "V2V_KEY_MOST bounds arrays over all keys");
