/** What a projector holds, and how its spectra are cut. Private to the projector's files. */
#ifndef V2V3D_SRC_OPTICS_PROJECTOR_PLAN_H
#define V2V3D_SRC_OPTICS_PROJECTOR_PLAN_H

#include "v2v3d/fft/slabs.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/par/slicing.h"

/** A double-precision number of a spectrum, as ranks exchange them. */
struct v2v_partial {
    double re, im;
};

/** Sizes of everything; one place, so that v2v_projector_bytes can't drift from the creation. */
struct v2v_projector_layout {
    struct v2v_fft_shape shape;
    int64_t views, slices; /* slices: of this rank */
    int64_t half;          /* columns of a whole spectrum */
    int64_t slice_numbers; /* of a slice's spectrum here: frequencies that products are taken of */
    int64_t view_numbers;  /* of a view's spectrum here */
    int64_t slice_stride, view_stride; /* from spectrum to spectrum */
    int64_t step;                      /* columns of a rank in one round of exchanges */
    int64_t rounds;                    /* 1 when nothing is exchanged */
    int64_t owners;                    /* of the columns of the spectra here: 1, or all ranks */
    int64_t blocks;  /* of at most V2V_BLOCK frequencies, over all rounds and owners */
    int64_t slot;    /* partial numbers to one rank in one exchange, at most; 0: no exchange */
    int64_t scratch; /* of one thread: a block of all slices and of one view, floats */
    int64_t otf;     /* floats */
};

/** Frequencies that one rank owns and that one round takes; range [round * owners + owner]. */
struct v2v_range {
    int64_t first, count; /* frequencies of the spectra here */
    int64_t block;        /* its first one; those of the next range follow */
};

struct v2v_frequency_block {
    int64_t range, first, width; /* frequencies first .. first+width-1 */
};

struct v2v_projector {
    struct v2v_projector_layout layout;
    struct v2v_projector_share share;
    enum v2v_split split;
    struct v2v_part columns; /* of the views' spectra, of this rank */
    int64_t height, width;
    int threads;
    const struct v2v_comm *comm;         /* borrowed */
    struct v2v_fft_slabs *alone;         /* slices over several ranks: this rank's frames */
    struct v2v_fft_slabs *together;      /* frames that all ranks share */
    struct v2v_slicing *slicing;         /* volumes between rows and slices */
    struct v2v_range *range;             /* [rounds * owners + 1]; the last one closes the table */
    struct v2v_frequency_block *block;   /* [blocks] */
    float *otf;                          /* [block,v,z,2,V2V_BLOCK]: read once, front to back */
    struct v2v_complex *slice_spectra;   /* [z,slice_stride]: [kx,ky] */
    struct v2v_complex *view_spectra;    /* [v,view_stride] */
    float *scratch;                      /* [thread,scratch] */
    struct v2v_partial *sent, *received; /* [rank,slot] */
    struct v2v_part *to, *from;          /* [rank]: parts of `sent` and `received` */
    int64_t *counts;                     /* [2 * ranks]: counts, then offsets */
};

/** How far a kernel of K pixels reaches before and after its centre. Two pixels of a frame of
 *  `size` pixels lie at most size-1 apart, so taps beyond that are never used. */
int64_t v2v_kernel_before(int64_t kernel, int64_t size);
int64_t v2v_kernel_after(int64_t kernel, int64_t size);

/** What lies beyond a frame: nothing, or the opposite edge. */
enum v2v_beyond { V2V_BEYOND_ZERO, V2V_BEYOND_PERIODIC };

/** @param beyond periodic: sides that v2v_fft_good_size keeps, none shorter than the kernel's
 *  @return 0 when a size leaves int64_t or the int that MPI counts in */
int v2v_projector_plan(struct v2v_projector_layout *layout, const struct v2v_psf_file *psf,
                       int64_t height, int64_t width, enum v2v_beyond beyond, enum v2v_split split,
                       int ranks, int rank);

/** v2v_projector_create for frames of either kind; v2v_projector_bytes likewise. */
enum v2v_status v2v_projector_create_beyond(struct v2v_projector **projector,
                                            const struct v2v_psf_file *psf, int64_t height,
                                            int64_t width, enum v2v_beyond beyond,
                                            enum v2v_split split,
                                            const struct v2v_comm *comm) V2V_MUST_CHECK;
int64_t v2v_projector_bytes_beyond(const struct v2v_psf_file *psf, int64_t height, int64_t width,
                                   enum v2v_beyond beyond, enum v2v_split split, int ranks);

/** The ranges and blocks of a plan. */
void v2v_projector_cut(struct v2v_projector *projector);

/** The transforms of slices. */
static inline struct v2v_fft_slabs *v2v_projector_slice_fft(const struct v2v_projector *projector)
{
    return projector->alone != NULL ? projector->alone : projector->together;
}

/** Products of block `block` with the OTFs of view v. */
float *v2v_projector_otf(const struct v2v_projector *projector, int64_t block, int64_t v);

/** The calling thread's. */
float *v2v_projector_scratch(const struct v2v_projector *projector);

#endif
