/** Run time against error, in one run.
 *
 *  Purpose: the same network computed in every way that there is, timed side by side, each judged
 * by a double-precision twin that shares no code with them; and what the machine allows:
 * multiply-adds over its measured GEMM rate, bytes over its measured copy rate. Invariants:
 * variants take turns round by round, so that other work on the machine slows all alike; a timed
 * pass follows an untimed one of its kind; times are medians; one rank.
 *
 *  Example (compiled by tests/unit/bench):
 *
 *      struct v2v_bench_job job = {.config = &config, .psf = &psf, .views = views, .size = 32,
 *                                  .step_size = 32, .width = 4, .widest = 16, .features = 4,
 *                                  .volume_scale = 1.0, .gain = 1.0, .repeat = 3};
 *      V2V_TRY(v2v_bench_run(&result, &job));
 *      v2v_bench_print(stdout, &result, &machine);
 *  done:
 *      return rc;
 */
#ifndef V2V3D_BENCH_BENCH_H
#define V2V3D_BENCH_BENCH_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/io/png.h"
#include "v2v3d/io/psf_file.h"
#include <stdint.h>
#include <stdio.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { V2V_BENCH_LEAST_REPEAT = 3, V2V_BENCH_MOST_REPEAT = 99, V2V_BENCH_MOST_ROWS = 16 };

struct v2v_bench_job {
    const struct v2v_config *config; /**< losses, Adam, psf.reduce */
    const struct v2v_psf_file *psf;
    const float *views;  /**< [v,size,size], as the network takes them */
    const float *truth;  /**< [z,size,size], or NULL: no PSNR */
    double gain;         /**< volumes / gain are in the truth's units */
    const char *weights; /**< file of the network of `width`; NULL: weights by rule */
    int64_t size;        /**< of a frame's side, a multiple of V2V_MODEL_GRID */
    int64_t step_size;   /**< of a training step's, the same; at most `size` */
    int64_t width;       /**< of the variants */
    int64_t widest;      /**< of the widths 16, 32, 64, 128 that are run as well */
    int64_t features;    /**< a view */
    double volume_scale;
    int64_t repeat; /**< rounds, V2V_BENCH_LEAST_REPEAT .. V2V_BENCH_MOST_REPEAT */
};

/** The fastest of several tries. */
struct v2v_bench_rates {
    double gemm_onednn, gemm_openblas; /**< float32 multiply-adds a second, large square matrices */
    double copy; /**< bytes read and written a second, far beyond the caches */
};

/** One way to compute the network. Seconds are medians over the rounds. */
struct v2v_bench_row {
    const char *name; /**< for people: "winograd off" */
    const char *id;   /**< for programs: "winograd_off" */
    int64_t width;
    double forward_s, step_s;
    double step_forward_s;                /**< of the step's own forward pass */
    double forward_floor_s, step_floor_s; /**< a step computes and moves three times a forward pass:
                                               itself, gradients of data, gradients of weights; NaN
                                               in bf16: no rate was measured for it */
    double macs, bytes;                   /**< of the forward pass, after the shortcuts but
                                               skipping */
    double error[2];                      /**< of the branches' volumes: |x - twin| / |twin| */
    double psnr_change;                   /**< PSNR less the twin's, dB; NaN: not measured */
    double computed_part;                 /**< v2v_model_computed_part */
    double model_bytes;                   /**< held by the model planned for the forward pass */
};

struct v2v_bench_result {
    int64_t views, slices, size, step_size, repeat;
    int bf16; /**< enum v2v_bf16: a row in bf16 is there where it is native */
    struct v2v_bench_rates rates;
    double twin_psnr;  /**< NaN: not measured */
    double peak_bytes; /**< most resident memory of the process so far, the twin's included */
    struct v2v_bench_row row[V2V_BENCH_MOST_ROWS];
    int64_t rows;
};

/** Measure. @kind Local. @return V2V_OK | V2V_STOPPED (on request, between two measurements) |
 *  V2V_E_INPUT (weights that do not fit) | V2V_E_MEMORY | V2V_E_INTERNAL */
enum v2v_status v2v_bench_run(struct v2v_bench_result *result,
                              const struct v2v_bench_job *job) V2V_MUST_CHECK;

/** What the result was measured on, for the report. */
struct v2v_bench_machine {
    const char *processor, *instructions, *libraries;
    int threads;
    double load; /**< runnable processes when it began: other work slows threads that wait */
};

/** The table. @kind Local. */
void v2v_bench_print(FILE *stream, const struct v2v_bench_result *result,
                     const struct v2v_bench_machine *machine);

/** One flat JSON object, the rows' figures as "ID.figure"; crash-safe. @kind Local.
 *  @return V2V_OK | V2V_E_IO | V2V_E_MEMORY */
enum v2v_status v2v_bench_write_json(const char *path, const struct v2v_bench_result *result,
                                     const struct v2v_bench_machine *machine) V2V_MUST_CHECK;

/** Forward seconds against the larger of the two errors, both logarithmic, a labelled dot a row.
 *  @kind Local. @return V2V_OK | V2V_E_MEMORY */
enum v2v_status v2v_bench_plot(struct v2v_canvas *canvas,
                               const struct v2v_bench_result *result) V2V_MUST_CHECK;

#ifdef __cplusplus
}
#endif

#endif
