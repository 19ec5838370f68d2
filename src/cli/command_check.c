#include "cli/paths.h"
#include "cli/processor.h"
#include "cli/steps.h"
#include "cli/threads.h"
#include "cli/versions.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/fft/fft2.h"
#include "v2v3d/op/bf16.h"
#include "v2v3d/optics/cost.h"
#include <float.h>
#include <math.h>
#include <stdio.h>

static const struct v2v_option options[] = {{0}};

/* Every rank contributes rank + 1: small integers, exact in float. */
static enum v2v_status all_reduce(double *error, const struct v2v_session *session)
{
    enum { COUNT = 100000 };
    enum v2v_status rc = V2V_OK;
    float *x = NULL;
    float ranks = (float)v2v_comm_size(session->world);
    rc = V2V_ALLOC(x, "check.sum", COUNT);
    V2V_TRY(v2v_par_agree(session->world, rc));
    for (int i = 0; i < COUNT; i++) {
        x[i] = (float)(v2v_comm_rank(session->world) + 1);
    }
    v2v_par_sum_f32(session->world, x, COUNT);
    for (int i = 0; i < COUNT; i++) {
        *error = fmax(*error, fabs((double)(x[i] - ranks * (ranks + 1.0f) / 2.0f)));
    }
done:
    v2v_mem_free(x);
    return rc;
}

/* A transform there and back. */
static enum v2v_status transform(double *error, const struct v2v_session *session)
{
    enum { NY = 60, NX = 126 };
    enum v2v_status rc = V2V_OK;
    struct v2v_fft2 *fft = NULL;
    float *image = NULL;
    struct v2v_complex *spectrum = NULL;
    (void)session;
    V2V_TRY(V2V_ALLOC(image, "check.image", NY * NX));
    V2V_TRY(V2V_ALLOC(spectrum, "check.spectrum", NY * (NX / 2 + 1)));
    V2V_TRY(v2v_fft2_create(&fft, NY, NX));
    for (int i = 0; i < NY * NX; i++) {
        image[i] = (float)v2v_random_rule("check", 1, (uint64_t)i);
    }
    v2v_fft2_forward(fft, spectrum, image);
    v2v_fft2_inverse(fft, image, spectrum);
    for (int i = 0; i < NY * NX; i++) {
        double back = (double)image[i] / (NY * NX);
        *error = fmax(*error, fabs(back - v2v_random_rule("check", 1, (uint64_t)i)));
    }
done:
    v2v_fft2_destroy(&fft);
    v2v_mem_free(spectrum);
    v2v_mem_free(image);
    return rc;
}

/* Bounds: the sums are exact integers; a transform of N = 7560 loses about log2(N) roundings of
 * values up to sqrt(N) and is divided by N. */
static const struct {
    const char *name;
    enum v2v_status (*run)(double *error, const struct v2v_session *session);
    double bound;
} checks[] = {{"sum over ranks", all_reduce, 0.0},
              {"Fourier transform", transform, 16 * FLT_EPSILON}};
enum { CHECKS = sizeof checks / sizeof checks[0] };

/* What the choice between slices and slabs rests on, and how it falls for the paper's recordings.
 */
static enum v2v_status predict(const struct v2v_session *session)
{
    enum { SIDE_OF_FRAME = 512, TRANSFORM = 576 };
    static const struct v2v_psf_file paper = {
        .views = 13, .slices = 39, .height = 128, .width = 128};
    enum v2v_status rc = V2V_OK;
    struct v2v_projector_cost cost;
    const struct v2v_comm_cost *network = &cost.network;
    double seconds[V2V_SPLITS];
    int ranks = v2v_comm_size(session->world);
    V2V_TRY(v2v_projector_cost_measure(&cost, session->world));
    V2V_TRY(v2v_comm_cost_measure_sums(&cost.network, session->world));
    const double n = TRANSFORM * TRANSFORM;
    if (!v2v_step_on_root(session)) {
        goto done;
    }
    printf("costs: transform of %d x %d %.3g ms, OTFs %.3g GB/s", TRANSFORM, TRANSFORM,
           1e3 * cost.transform_s * n * log2(n), 8e-9 / cost.product_s);
    if (ranks > 1) {
        printf("; message %.3g us, waiting %.3g us, exchange %.3g GB/s a rank; all-reduce %.3g us "
               "a step, %.3g GB/s",
               1e6 * network->message_s, 1e6 * cost.wait_s, 1e-9 / network->byte_s,
               1e6 * network->sum_step_s, 1e-9 / network->sum_byte_s);
    }
    printf("\n");
    if (ranks > 1) {
        printf(
            "a frame that all ranks transform, there and back: %.3g ms by the own exchange, %.3g "
            "ms by FFTW3-MPI\n",
            1e3 * cost.own_s, 1e3 * cost.fftw3_mpi_s);
    }
    printf("projection of %d x %d, 39 slices, there and back, predicted over %d ranks:\n",
           SIDE_OF_FRAME, SIDE_OF_FRAME, ranks);
    for (int64_t count = paper.views; count >= 1; count -= paper.views - 1) {
        enum v2v_split split = v2v_projector_faster(seconds, &cost, &session->config, &paper,
                                                    SIDE_OF_FRAME, SIDE_OF_FRAME, count, ranks);
        printf("  %2lld views at a time: by slices %.3g ms, by slabs %.3g ms, by slabs through "
               "FFTW3-MPI %.3g ms; taken: %s\n",
               (long long)count, 1e3 * seconds[0], 1e3 * seconds[1], 1e3 * seconds[2],
               v2v_split_text(split));
    }
done:
    return rc;
}

static enum v2v_status run(const void *arguments, struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    int on_root = v2v_step_on_root(session), failed = 0;
    int64_t cores[2] = {v2v_cli_cores(), v2v_cli_neighbours(session->world)};
    struct v2v_processor processor;
    (void)arguments;
    v2v_par_max_i64(session->world, cores, 2);
    if (on_root) {
        v2v_cli_processor(&processor);
        printf("v2v3d %s\n%d ranks x %d threads; %lld cores for %lld ranks of a host\n%s\n"
               "instruction sets: %s\nconvolutions in bf16: %s\n",
               V2V_VERSION, v2v_comm_size(session->world), session->threads, (long long)cores[0],
               (long long)cores[1], V2V_LIBRARY_VERSIONS, processor.instructions,
               v2v_op_bf16_text(v2v_op_bf16()));
    }
    for (int i = 0; i < CHECKS; i++) {
        double error = 0.0;
        rc = checks[i].run(&error, session);
        V2V_TRY(v2v_par_agree(session->world, rc));
        v2v_par_max_f64(session->world, &error, 1);
        int is_bad = !(error <= checks[i].bound);
        failed += is_bad;
        if (on_root) {
            printf("%-30s  %s, error %.2g (at most %.2g)\n", checks[i].name,
                   is_bad ? "FAILED" : "ok", error, checks[i].bound);
        }
    }
    v2v_cli_try_paths(&failed, session);
    if (failed > 0) {
        V2V_TRY(V2V_FAIL(V2V_E_INTERNAL, "%d of the checks above failed", failed));
    }
    V2V_TRY(predict(session));
done:
    return rc;
}

const struct v2v_command v2v_command_check = {.name = "check",
                                              .summary = "self-test of a machine or cluster",
                                              .options = options,
                                              .bytes = sizeof(struct v2v_common),
                                              .run = run};
