/* A frame cut into slabs of rows, over the ranks of a shard group. Every slab is computed with a
 * margin of rows, so that layers of full and half size need nothing of the neighbours: what is
 * wrong at the cut has not grown through the margin when the volume is reached. What has a quarter
 * of the frame's sides or less is whole on every rank. */
#ifndef V2V3D_V2V_SLABS_H
#define V2V3D_V2V_SLABS_H

#include "v2v/padded.h"
#include "v2v3d/par/comm.h"

/* Rows of the margin. The alignment's convolution and three layers spoil three rows of E0's input,
 * two of E0 itself (half size); the last joint then has two spoiled rows, which are four of full
 * size, and four layers spoil one more each. */
enum { V2V_SLAB_MARGIN = 8 };

struct v2v_slab {
    int64_t first, rows;  /* its own rows of the frame; rows may be 0: more slabs than rows */
    int64_t above, below; /* margins: none at the frame's edges */
};

/* Rows computed, and the first of them. */
static inline int64_t v2v_slab_computed(const struct v2v_slab *slab)
{
    return slab->above + slab->rows + slab->below;
}

static inline int64_t v2v_slab_start(const struct v2v_slab *slab)
{
    return slab->first - slab->above;
}

/* Slab `index` of a frame of `height` rows, cut into `count` at multiples of `unit` rows. */
struct v2v_slab v2v_slab_cut(int64_t height, int64_t unit, int64_t count, int64_t index);

struct v2v_slabs;

struct v2v_slabs_spec {
    const struct v2v_comm *comm; /* of the shard group: one slab a rank, or one rank with all */
    int64_t count;
    int64_t unit;
    int64_t height, width;   /* of the frame */
    int64_t features, ring;  /* of the padded features */
    int64_t gathered_floats; /* at most in all parts of one call of gather or sum, ..._floats */
};

/* Collective(comm), agreed by the caller. */
enum v2v_status v2v_slabs_create(struct v2v_slabs **slabs,
                                 const struct v2v_slabs_spec *spec) V2V_MUST_CHECK;
void v2v_slabs_destroy(struct v2v_slabs **slabs);

/* This rank's slab number `local`: of all where it is alone, else of its one. */
const struct v2v_slab *v2v_slabs_at(const struct v2v_slabs *slabs, int64_t local);
/* The slab's index in the frame. */
int64_t v2v_slabs_index(const struct v2v_slabs *slabs, int64_t local);

/* A view's features [feature,y,x] (`mine`: of view[own rank]) go to the rows of all slabs that read
 * them; view[r] is the one that rank r has, -1 for none. Between begin and end `mine` may change.
 * Collective(comm). */
void v2v_slabs_begin_features(struct v2v_slabs *slabs, struct v2v_padded *features,
                              const int32_t *view, const float *mine);
void v2v_slabs_end_features(struct v2v_slabs *slabs, struct v2v_padded *features,
                            const int32_t *view);

/* The adjoint: mine [feature,y,x] = sum of all slabs' gradients of view[own rank], in the order of
 * the slabs. Collective(comm). */
void v2v_slabs_return_features(struct v2v_slabs *slabs, float *mine,
                               const struct v2v_padded *dfeatures, const int32_t *view);

/* Images whose sides are halved `half` times. `part`: of this rank's slabs, [channels,rows
 * computed,x]; with is_own [channels,own rows,x]. */
struct v2v_slabs_images {
    int64_t channels;
    int half;
    int is_own;
};
int64_t v2v_slabs_gathered_floats(const struct v2v_slabs_spec *spec,
                                  const struct v2v_slabs_images *images);

/* whole [channels,y,x] = every slab's own rows; NULL: this rank has no use for them. It may be a
 * part's memory. Collective(comm). */
void v2v_slabs_gather(struct v2v_slabs *slabs, float *whole, const float *const *part,
                      const struct v2v_slabs_images *images);

/* whole = sum of all rows computed, in the order of the slabs: the adjoint of cutting them out.
 * Collective(comm). */
void v2v_slabs_sum(struct v2v_slabs *slabs, float *whole, const float *const *part,
                   const struct v2v_slabs_images *images);

/* part [channels,rows computed,x] = the rows of slab `local` of whole [channels,y,x]; with is_own
 * the margins are zero. Local. */
void v2v_slabs_cut_out(const struct v2v_slabs *slabs, float *part, const float *whole,
                       int64_t local, const struct v2v_slabs_images *images);

#endif
