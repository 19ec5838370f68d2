/** The step towards the views of optics/data_step.h by plain transforms and eliminations in double
 *  precision, and the views as it takes them. */
#ifndef V2V_TEST_TWIN_DATA_STEP_H
#define V2V_TEST_TWIN_DATA_STEP_H

#include <stdint.h>

struct twin_data_step {
    int64_t views, slices;
    int64_t kernel_height, kernel_width;
    int64_t height, width;             /**< of a frame */
    int64_t torus_height, torus_width; /**< the frame at its origin */
    const float *psf;                  /**< [v,z,ky,kx], borrowed */
    double *otf;                       /**< [v,z,torus,2] */
    double *recorded, *spectra;        /**< [v,torus] y, and [v,torus,2] */
    double *slice_spectra;             /**< [z,torus,2] */
    double *gradient_spectra;          /**< likewise */
};

/** The sizes and psf are set by the caller. Out of memory aborts. */
void twin_data_step_init(struct twin_data_step *step);
void twin_data_step_fini(struct twin_data_step *step);

/** y = views * scale, beyond the frame from edge to opposite edge in a straight line. */
void twin_data_step_begin(struct twin_data_step *step, const float *views, double scale);

/** P of a step, constant + differences D^T D + depth Z^T Z + curvature L^T L
 *  (optics/data_step.h). */
struct twin_penalty {
    double constant, differences, depth, curvature;
};

/** volume [z,torus]: v on entry, argmin 1/2 |A x - y|^2 + g^T x + 1/2 |x - v|_P^2 on return.
 *  @param gradient g, [z,torus]; NULL: 0 */
void twin_data_step_run(const struct twin_data_step *step, double *volume, const double *gradient,
                        const struct twin_penalty *penalty);

/** Beyond the frame, y becomes A volume. */
void twin_data_step_extend(struct twin_data_step *step, const double *volume);

/** The condition of 1 + A P^-1 A^H, the worst of all frequencies. */
double twin_data_step_condition(const struct twin_data_step *step,
                                const struct twin_penalty *penalty);

#endif
