/** How the voxels of a volume that a command writes are stored. */
#ifndef V2V_CLI_STORAGE_H
#define V2V_CLI_STORAGE_H

#include "cli/options.h"
#include "v2v3d/io/volume.h"

/** As on the command line. */
struct v2v_storage_options {
    int type; /* enum v2v_sample */
    double peak;
    const char *compression;
};

/** Rows of the options. */
#define V2V_OPTIONS_STORAGE(type_, member)                                                         \
    {.name = "output-type",                                                                        \
     .kind = V2V_OPTION_CHOICE,                                                                    \
     .at = offsetof(type_, member) + offsetof(struct v2v_storage_options, type),                   \
     .value = "float32|uint16",                                                                    \
     .help = "of the volume's voxels; uint16: in steps that the file states",                      \
     .initial = "float32"},                                                                        \
        {.name = "output-peak",                                                                    \
         .kind = V2V_OPTION_NUMBER,                                                                \
         .at = offsetof(type_, member) + offsetof(struct v2v_storage_options, peak),               \
         .value = "P",                                                                             \
         .help = "what 65535 of uint16 stands for; default: the brightest voxel of all frames",    \
         .least = 1e-30,                                                                           \
         .most = 1e30},                                                                            \
    {                                                                                              \
        .name = "compression", .kind = V2V_OPTION_TEXT,                                            \
        .at = offsetof(type_, member) + offsetof(struct v2v_storage_options, compression),         \
        .value = "none|gzip[:LEVEL]",                                                              \
        .help = "of an HDF5 volume, level 1 to 9 (2), once all frames are there",                  \
        .initial = "none"                                                                          \
    }

/** @kind Local. @return V2V_OK | V2V_E_USAGE (no such compression, or not with this output) */
enum v2v_status v2v_storage_settle(struct v2v_volume_storage *storage,
                                   const struct v2v_storage_options *given,
                                   const char *output) V2V_MUST_CHECK;

#endif
