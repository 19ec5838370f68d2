/** A matrix of complex numbers cut over ranks by its rows, then by its columns: FFTW3-MPI's
 *  distributed transposition. Numbers only change places: whatever way FFTW finds fastest, the bits
 *  are the same. Private to the room. */
#ifndef V2V3D_SRC_FFT_TRANSPOSITION_H
#define V2V3D_SRC_FFT_TRANSPOSITION_H

#include "v2v3d/fft/fft2.h"
#include "v2v3d/par/comm.h"

struct v2v_transposition;

/** Of `frames` (1, 2, 4 ..) frames at once or fewer; every rank has `rows` by ranks * `columns`
 *  numbers of a frame before and ranks * `rows` by `columns` after. Plans are measured, which
 *  writes to both arrays.
 *  @kind   Collective(comm); as is _destroy
 *  @param  rows_side    [rank,frame,column,row]: those of this rank's rows
 *  @param  columns_side [frame,column,rank,row]: those of this rank's columns
 *  @return V2V_OK | V2V_E_MEMORY; agreed */
enum v2v_status v2v_transposition_create(struct v2v_transposition **transposition,
                                         struct v2v_complex *rows_side,
                                         struct v2v_complex *columns_side, int64_t rows,
                                         int64_t columns, int64_t frames,
                                         const struct v2v_comm *comm) V2V_MUST_CHECK;
void v2v_transposition_destroy(struct v2v_transposition **transposition);

/** From the rows' side to the columns' or back; may destroy what it reads. @kind Collective(comm),
 *  no allocation. @param frames a power of two */
void v2v_transposition_run(const struct v2v_transposition *transposition, int64_t frames,
                           int forward);

#endif
