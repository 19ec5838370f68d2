/* Rows of a volume on every rank become whole slices, some on every rank: what files are written
 * in.
 */
#ifndef V2V3D_RECON_SLICES_H
#define V2V3D_RECON_SLICES_H

#include "v2v3d/par/comm.h"

struct v2v_slices;

/* Volumes [slices,height,width], of which this rank has `rows`; the ranks' rows are all of them, in
 * their order. `scratch`: two times v2v_slices_floats, borrowed. Local. */
int64_t v2v_slices_floats(int64_t count, int64_t height, int64_t width,
                          const struct v2v_comm *comm);
enum v2v_status v2v_slices_create(struct v2v_slices **slices, int64_t count, int64_t height,
                                  int64_t width, struct v2v_part rows, float *const scratch[2],
                                  const struct v2v_comm *comm) V2V_MUST_CHECK;
void v2v_slices_destroy(struct v2v_slices **slices);

/* The slices that this rank gets. */
struct v2v_part v2v_slices_own(const struct v2v_slices *slices);

/* Those slices [own,height,width] of a volume from all ranks' rows of it [slices,rows,width]; they
 * live in scratch[1] until the next call, or in `rows` on a rank alone. Collective(comm). */
const float *v2v_slices_make(struct v2v_slices *slices, const float *rows);

#endif
