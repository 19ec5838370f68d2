#include "fft/transposition.h"
#include "par/comm_mpi.h"
#include "v2v3d/base/memory.h"
#include <fftw3-mpi.h>

/* Powers of two that an int of MPI's has room for. */
enum { PLANS = 31 };

struct v2v_transposition {
    fftwf_plan forward[PLANS], back[PLANS]; /* of 2^i frames; NULL: none */
};

static int power_of(int64_t frames)
{
    int i = 0;
    while ((int64_t)1 << (i + 1) <= frames) {
        i++;
    }
    return i;
}

enum v2v_status v2v_transposition_create(struct v2v_transposition **transposition,
                                         struct v2v_complex *rows_side,
                                         struct v2v_complex *columns_side, int64_t rows,
                                         int64_t columns, int64_t frames,
                                         const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    const int64_t ranks = v2v_comm_size(comm);
    float *by_rows = &rows_side->re, *by_columns = &columns_side->re;
    /* May be called again and again. No time limit: ranks would reach it at different places, and
     * wait for each other. */
    fftwf_mpi_init();
    V2V_TRY(v2v_par_agree(comm, V2V_ALLOC(*transposition, "fft.exchange", 1)));
    for (int i = 0; i <= power_of(frames); i++) {
        /* The columns of all frames of a batch are those of one matrix, in the order of their
         * ranks. A number is a pair of floats. */
        const int64_t wide = columns << i;
        fftwf_plan forward = fftwf_mpi_plan_many_transpose(
            ranks * rows, ranks * wide, 2, rows, wide, by_rows, by_columns, v2v_comm_mpi(comm),
            FFTW_MEASURE | FFTW_MPI_TRANSPOSED_IN);
        fftwf_plan back = fftwf_mpi_plan_many_transpose(ranks * wide, ranks * rows, 2, wide, rows,
                                                        by_columns, by_rows, v2v_comm_mpi(comm),
                                                        FFTW_MEASURE | FFTW_MPI_TRANSPOSED_OUT);
        (*transposition)->forward[i] = forward;
        (*transposition)->back[i] = back;
        if (forward == NULL || back == NULL) {
            rc = V2V_FAIL(V2V_E_MEMORY, "no room to plan transpositions of %lld x %lld numbers",
                          (long long)(ranks * rows), (long long)(ranks * wide));
        }
        V2V_TRY(v2v_par_agree(comm, rc));
    }
done:
    if (rc != V2V_OK) {
        v2v_transposition_destroy(transposition);
    }
    return rc;
}

void v2v_transposition_destroy(struct v2v_transposition **transposition)
{
    struct v2v_transposition *old = *transposition;
    for (int i = 0; old != NULL && i < PLANS; i++) {
        if (old->forward[i] != NULL) {
            fftwf_destroy_plan(old->forward[i]);
        }
        if (old->back[i] != NULL) {
            fftwf_destroy_plan(old->back[i]);
        }
    }
    v2v_mem_free(old);
    *transposition = NULL;
}

void v2v_transposition_run(const struct v2v_transposition *transposition, int64_t frames,
                           int forward)
{
    const int i = power_of(frames);
    fftwf_execute(forward ? transposition->forward[i] : transposition->back[i]);
}
