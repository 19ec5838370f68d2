/** A complete volume file, made of the float32 HDF5 file that a run wrote.
 *
 *  Integers of one scale need the largest voxel of all frames, and parallel HDF5 compresses in
 *  collective writes alone, which would keep all ranks in step, so that a killed run's file could
 *  not be gone on with. So frames go to the plain file, and this passes over it once they all are
 *  there. Ranks take frames in turn, hold them against their checksums, convert and compress them;
 *  rank 0 writes. The plain file is left as it is: a run that is killed here loses this pass alone.
 */
#ifndef V2V_IO_VOLUME_PACK_H
#define V2V_IO_VOLUME_PACK_H

#include "io/h5_writer.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/tiff.h"
#include "v2v3d/io/volume.h"

/** What to make. */
struct v2v_volume_pack {
    struct v2v_volume_info info;
    unsigned datasets; /**< as of v2v_volume_create */
    int is_tiff, is_ome;
    char path[V2V_PATH_BYTES]; /**< that it gets in the end */
    struct v2v_tiff_told told; /**< of a TIFF */
};

/** Integers of frame t that stand for nothing near their voxels, beside `/volume` [t]. */
#define V2V_H5_CLIPPED "/clipped"

/** Does a file that is stored so need a pass? @kind Local. */
int v2v_volume_pack_is_needed(const struct v2v_volume_storage *storage);

/** @kind Collective(comm). @param packed the file to make, removed when it fails @param part the
 *  plain one, closed. @return V2V_OK | V2V_E_INPUT (`part` is not as it was written) | V2V_E_IO |
 *  V2V_E_MEMORY; agreed. @cost each rank holds a frame; of integers for HDF5 as these too, half a
 *  frame; and where it is compressed the bytes to compress, shuffled, and room for what comes of
 *  them: up to two more frames, of integers one. The same bits at any rank count */
enum v2v_status v2v_volume_pack_run(const struct v2v_volume_pack *pack, const char *packed,
                                    const char *part, const struct v2v_comm *comm) V2V_MUST_CHECK;

#endif
