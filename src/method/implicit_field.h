/** A volume as an implicit field: two numbers a voxel, learned, and one small network over them.
 *
 *      volume[z,y,x] = |1 + w3 relu(W2 relu(W1 t[z,y,x] + b1) + b2) + b3|
 *
 *  The two numbers, a voxel's coordinates t, are an entry of a table: what a network has to express
 *  does not depend on the order of the voxels any more (S. Xie, H. Zhu et al., CVPR 2023: DINER).
 *  Ranks hold rows of the table; the network is the same on all. Sums over voxels are taken row by
 *  row, and rows added in order: the same bits at any number of ranks and threads. */
#ifndef METHOD_IMPLICIT_FIELD_H
#define METHOD_IMPLICIT_FIELD_H

#include "v2v3d/base/status.h"
#include "v2v3d/par/comm.h"
#include <stdint.h>

/** Coordinates of a voxel; and what the width is a multiple of. */
enum { V2V_IMPLICIT_COORDINATES = 2, V2V_IMPLICIT_WIDTHS = 32 };

/** Where the network's parameters are, one after the other: W1 [width,2], b1 [width], W2
 *  [width,width], b2 [width], w3 [width], b3. */
struct v2v_implicit_layout {
    int64_t w1, b1, w2, b2, w3, b3, count;
};

struct v2v_implicit_field {
    const struct v2v_comm *comm;
    int64_t slices, height, columns; /**< of the whole volume */
    struct v2v_part rows;            /**< of it, here */
    int64_t width;                   /**< of the network's two hidden layers */
    struct v2v_implicit_layout at;
    int64_t run;       /**< slices * columns, filled up to whole panels: voxels of a row */
    float *table;      /**< [rows,2,run], a row's voxels in the order [z,x] */
    float *weights;    /**< [at.count] */
    float *dtable;     /**< gradients, likewise */
    float *dweights;   /**< the same on all ranks */
    float *raised;     /**< [rows,run]: 1 + output, of the last forward pass .. */
    uint8_t *lit;      /**< [rows,width/8,run]: .. and which of 8 neurons of the second layer are
                            above 0, as bits */
    float *packed;     /**< W2 as the products take it, forward and backward */
    float *sums;       /**< [height, sums of a row over its voxels]; those of all ranks */
    int64_t row_sums;  /**< of a row */
    int64_t *spread;   /**< [2,ranks]: counts and offsets of their sums */
    float *scratch;    /**< [threads, of a thread] */
    int64_t a_scratch; /**< floats of a thread */
};

/** @kind Local. @return V2V_OK | V2V_E_MEMORY; v2v_implicit_field_fini after both
 *  @param height rows of the whole volume, of which a rank of `comm` holds v2v_par_part's
 *  @param comm NULL: this rank alone */
enum v2v_status v2v_implicit_field_init(struct v2v_implicit_field *field, int64_t width,
                                        int64_t slices, int64_t height, int64_t columns,
                                        const struct v2v_comm *comm) V2V_MUST_CHECK;
void v2v_implicit_field_fini(struct v2v_implicit_field *field);

/** Bytes that it holds of a volume. @kind Local. */
int64_t v2v_implicit_field_bytes(int64_t width, int64_t slices, int64_t height, int64_t columns);

/** Fresh: coordinates all next to 0, drawn by (seed, voxel), weights by (seed, number): a volume
 *  that is constant, nearly. @kind Local. */
void v2v_implicit_field_draw(const struct v2v_implicit_field *field, uint64_t seed);

/** @kind Local, no allocation. @param volume [slices,rows,columns] out
 *  @cost 2 (width^2 + 4 width) flop a voxel */
void v2v_implicit_field_forward(struct v2v_implicit_field *field, float *volume);

/** dtable and dweights of sum(dvolume * volume), for the volume of the last forward pass.
 *  @kind Collective(comm), no allocation. @param dvolume [slices,rows,columns]
 *  @cost 4 (width^2 + 4 width) flop a voxel; height * (width^2 + 4 width + 1) floats are gathered.
 *  The second layer's values are not kept but their signs: the gradient of w3 follows from that of
 *  W2, for both are sums of the same products (Euler, of a function that is homogeneous). */
void v2v_implicit_field_backward(struct v2v_implicit_field *field, const float *dvolume);

#endif
