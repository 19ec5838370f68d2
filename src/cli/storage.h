/** How the voxels of a volume that a command writes are stored. */
#ifndef V2V_CLI_STORAGE_H
#define V2V_CLI_STORAGE_H

#include "cli/options.h"
#include "v2v3d/io/volume.h"

enum { V2V_STORAGE_AUTO = 0 }; /**< uint16 for BigDataViewer, else float32 */

/** As on the command line. */
struct v2v_storage_options {
    int type; /* V2V_STORAGE_AUTO, or 1 + enum v2v_sample */
    double peak;
    const char *compression;
};

/** Rows of the options. */
#define V2V_OPTIONS_STORAGE(type_, member)                                                         \
    {.name = "output-type",                                                                        \
     .kind = V2V_OPTION_CHOICE,                                                                    \
     .at = offsetof(type_, member) + offsetof(struct v2v_storage_options, type),                   \
     .value = "auto|float32|uint16",                                                               \
     .help = "of the volume's voxels (float32; uint16 for BigDataViewer); uint16: in steps that "  \
             "the file states",                                                                    \
     .initial = "auto"},                                                                           \
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

/** For what is no volume: are the options those that change nothing?
 *  @kind Local. @return V2V_OK | V2V_E_USAGE */
enum v2v_status v2v_storage_refuse(const struct v2v_storage_options *given,
                                   const char *input) V2V_MUST_CHECK;

#endif
