/** The program `v2v3d`: one file a command, one row a command in the table of main.c.
 *
 *  Purpose: parse the command line, settle configuration, threads and watchdog, call the library,
 *  print. No numerics live here.
 *  Invariants: results go to stdout, everything else to stderr, both from rank 0; a failure is
 *  agreed over ranks and printed once; all ranks leave with the same exit code; a failed command
 *  leaves no output behind.
 */
#ifndef V2V_CLI_COMMAND_H
#define V2V_CLI_COMMAND_H

#include "cli/options.h"
#include "v2v3d/conf/calibration.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/par/comm.h"

/** What a running command knows of its surroundings. */
struct v2v_session {
    struct v2v_comm *world;
    const struct v2v_common *common; /**< what the command line says */
    struct v2v_config config;        /**< resolved: defaults, preset, file, command line */
    int force, quiet;
    int threads;                        /**< of this rank */
    const char *command_line;           /**< for provenance */
    struct v2v_calibration calibration; /**< v2v_step_calibration; no views: none */
};

struct v2v_command {
    const char *name;                 /**< "project", or two words: "psf info" */
    const char *summary;              /**< one line */
    const struct v2v_option *options; /**< closed by {0} */
    size_t bytes;                     /**< of the arguments struct: struct v2v_common first */
    const char *const *preset;        /**< settings over the defaults, NULL-terminated; or NULL */
    /** The file of settings where none is given, but what it says of ranks; NULL: none.
     *  @kind Rank-0. @return bool: there is one; then path is set */
    int (*usual_config)(char *path, size_t bytes, const void *arguments);
    /** @kind Collective(world). @return agreed or not: the caller agrees again */
    enum v2v_status (*run)(const void *arguments, struct v2v_session *session);
};

/** Run the words of one command line (without the program's name).
 *  @kind Collective(world). @return agreed; the message begins with the command's name */
enum v2v_status v2v_cli_run(int argc, char *const *argv, struct v2v_comm *world) V2V_MUST_CHECK;

/** The whole program: starts and ends MPI. @return the exit code. */
int v2v_cli_main(int argc, char **argv);

extern const struct v2v_command v2v_command_bench;
extern const struct v2v_command v2v_command_calibrate;
extern const struct v2v_command v2v_command_check;
extern const struct v2v_command v2v_command_convert;
extern const struct v2v_command v2v_command_dataset;
extern const struct v2v_command v2v_command_deconvolve;
extern const struct v2v_command v2v_command_demo;
extern const struct v2v_command v2v_command_denoise;
extern const struct v2v_command v2v_command_evaluate;
extern const struct v2v_command v2v_command_info;
extern const struct v2v_command v2v_command_init;
extern const struct v2v_command v2v_command_preview;
extern const struct v2v_command v2v_command_project;
extern const struct v2v_command v2v_command_psf_fit;
extern const struct v2v_command v2v_command_psf_info;
extern const struct v2v_command v2v_command_psf_simulate;
extern const struct v2v_command v2v_command_reconstruct;
extern const struct v2v_command v2v_command_simulate;
extern const struct v2v_command v2v_command_slurm;
extern const struct v2v_command v2v_command_train;
extern const struct v2v_command v2v_command_weights_info;
extern const struct v2v_command v2v_command_weights_init;

/* Rows that several tables share; behind the text of those that end with it, `.needs = "name"`. */
#define V2V_OPTION_FILE(type, field, word, is_required, ...)                                       \
    {                                                                                              \
        .name = (word), .kind = V2V_OPTION_TEXT, .at = offsetof(type, field), .value = "FILE",     \
        .required = (is_required), .help = __VA_ARGS__                                             \
    }
#define V2V_OPTION_NAMELESS(type, field, values, text)                                             \
    {                                                                                              \
        .name = #field, .kind = V2V_OPTION_OPERAND, .at = offsetof(type, field),                   \
        .value = (values), .help = (text), .required = 1                                           \
    }
#define V2V_OPTION_OUTPUT(type, field, text)                                                       \
    {                                                                                              \
        .name = "output", .letter = 'o', .kind = V2V_OPTION_TEXT, .at = offsetof(type, field),     \
        .value = "FILE", .help = (text), .required = 1                                             \
    }
#define V2V_OPTION_SET(word, setting, values, ...)                                                 \
    {                                                                                              \
        .name = (word), .kind = V2V_OPTION_SETTING, .key = (setting), .value = (values),           \
        .help = __VA_ARGS__                                                                        \
    }
#define V2V_OPTION_SWITCH(type, field, word, ...)                                                  \
    {                                                                                              \
        .name = (word), .kind = V2V_OPTION_FLAG, .at = offsetof(type, field), .help = __VA_ARGS__  \
    }
#define V2V_OPTION_NOISE(type, field, usual)                                                       \
    {                                                                                              \
        .name = "noise", .kind = V2V_OPTION_TEXT, .at = offsetof(type, field), .value = "KIND",    \
        .help =                                                                                    \
            "none; gaussian:S, S times the level (99.5th percentile of frame 0 without noise); "   \
            "poisson:N, N photons at the level; camera:N[:GAIN[:OFFSET[:READ]]], uint16 "          \
            "counts of them (1, 100, 1.6)",                                                        \
        .initial = (usual)                                                                         \
    }
#define V2V_SCENE_KINDS "neurons, vessels, cells, microglia, beads, filaments, dense, mixed"
#define V2V_OPTION_SIZE(type, field)                                                               \
    {                                                                                              \
        .name = "size", .kind = V2V_OPTION_TEXT, .at = offsetof(type, field), .value = "HxW",      \
        .help = "pixels of a scene's frames, or N for NxN; default: 512"                           \
    }
#define V2V_OPTION_FRAME(type, field, text)                                                        \
    {                                                                                              \
        .name = "frame", .kind = V2V_OPTION_INTEGER, .at = offsetof(type, field), .value = "T",    \
        .help = (text), .initial = "0", .least = 0, .most = 1e9                                    \
    }
#define V2V_OPTION_FRAMES(type, field, text)                                                       \
    {                                                                                              \
        .name = "frames", .kind = V2V_OPTION_TEXT, .at = offsetof(type, field),                    \
        .value = "FIRST:COUNT", .help = (text)                                                     \
    }
#define V2V_OPTION_PSF(type, field, ...)                                                           \
    {                                                                                              \
        .name = "psf", .kind = V2V_OPTION_TEXT, .at = offsetof(type, field), .value = "FILE",      \
        .help = "point spread functions: folder of psf_1.tif .. or HDF5 /psf",                     \
        .required = __VA_ARGS__                                                                    \
    }
#define V2V_OPTION_NORMALIZE                                                                       \
    V2V_OPTION_SET("normalize", "psf.normalize", "view|none",                                      \
                   "PSFs: each view sums to 1, or as they are")
#define V2V_OPTION_CALIBRATION(type, field)                                                        \
    V2V_OPTION_FILE(type, field, "calibration", 0, "of the views: v2v3d calibrate")
/* Of a recording; more: what else the options have, as .needs. */
#define V2V_OPTIONS_PAGES_WITH(more)                                                               \
    V2V_OPTION_SET("views", "input.views", "V",                                                    \
                   "TIFF input: views of a frame; 0: as PSFs or file", more),                      \
        V2V_OPTION_SET("without-views", "input.without_views", "LIST",                             \
                       "views, from 0, that are not used, nor their PSFs: 3,7", more),             \
        V2V_OPTION_SET("first-view", "input.first_view", "K",                                      \
                       "page (HDF5: view) of the first frame's first view, from 0", more),         \
        V2V_OPTION_SET("stride", "input.stride", "S",                                              \
                       "pages (HDF5: views) from frame to frame; 1: sliding window", more),        \
        V2V_OPTION_SET("layout", "input.layout", "auto|views|frames",                              \
                       "a folder of TIFFs: a file a view, or files of whole frames", more)
#define V2V_OPTIONS_PAGES V2V_OPTIONS_PAGES_WITH(.needs = NULL)
#define V2V_OPTION_SLICES                                                                          \
    V2V_OPTION_SET("slices", "input.slices", "Z", "slices, where the file does not say")
#define V2V_OPTION_CHANNEL                                                                         \
    V2V_OPTION_SET("channel", "input.channel", "K",                                                \
                   "TIFF with channels: read this one, counted from 1 as in Fiji")
#define V2V_OPTION_DATASET(text) V2V_OPTION_SET("dataset", "input.dataset", "NAME", text)
#define V2V_OPTION_PIXEL_SIZE                                                                      \
    V2V_OPTION_SET("pixel-size", "input.pixel_size_um", "UM", "of the input, whatever it says")
/* Of any recording or volume that is read. */
#define V2V_OPTIONS_INPUT                                                                          \
    V2V_OPTION_CHANNEL, V2V_OPTION_DATASET("HDF5: read this dataset, not /views or /volume"),      \
        V2V_OPTION_PIXEL_SIZE
#define V2V_OPTION_SLICE_SPACING                                                                   \
    V2V_OPTION_SET("slice-spacing", "input.slice_spacing_um", "UM",                                \
                   "of the volume, whatever input and PSFs say")
#define V2V_OPTIONS_SIZES                                                                          \
    V2V_OPTION_SLICE_SPACING, V2V_OPTION_SET("frame-interval", "input.frame_interval_s", "S",      \
                                             "from frame to frame of the input, whatever it says")
#define V2V_OPTION_OFFSET                                                                          \
    V2V_OPTION_SET("offset", "input.offset", "none|auto|N", "subtracted from the counts")
#define V2V_OPTION_GAIN                                                                            \
    V2V_OPTION_SET("gain", "input.gain", "none|auto|N", "multiplied on, divided out again")

#endif
