/* Sixteen transforms side by side beside FFTW's of one signal after the other, planned by estimate
 * and by measurement (which picks other steps from run to run, so that no two runs have the same
 * bits): microseconds of one, one thread, in turn, the least of TURNS rounds.
 * What turns rows and columns into lanes and back is not in it (bench_slabs has it).
 *   bench_lanes [SIZE ...] */
#include "fft/lanes.h"
#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include <fftw3.h>
#include <stdio.h>
#include <stdlib.h>

enum { TURNS = 41, REPEATS = 8, WAYS = 3, KINDS = 3 };
static const char *const ways[WAYS] = {"FFTW, estimate", "FFTW, measured", "side by side"};

struct bench {
    int64_t n;
    struct v2v_fft_lanes *whole, *half; /* of n and of n/2 numbers */
    fftwf_plan plan[WAYS - 1][KINDS];   /* complex; of real signals; to real signals */
    float *planes;                      /* [4, n+1, V2V_LANES] */
    float *from, *to;                   /* [2 (n+1)] */
};

static enum v2v_status prepare(struct bench *b, int64_t n)
{
    static const unsigned planning[WAYS - 1] = {FFTW_ESTIMATE, FFTW_MEASURE};
    enum v2v_status rc = V2V_OK;
    *b = (struct bench){.n = n};
    V2V_TRY(v2v_fft_lanes_create(&b->whole, n));
    V2V_TRY(v2v_fft_lanes_create(&b->half, n / 2));
    V2V_TRY(V2V_ALLOC(b->planes, "bench", v2v_mem_product(4, n + 1, V2V_LANES)));
    V2V_TRY(V2V_ALLOC(b->from, "bench", 2 * (n + 1)));
    V2V_TRY(V2V_ALLOC(b->to, "bench", 2 * (n + 1)));
    fftwf_complex *from = (fftwf_complex *)(void *)b->from, *to = (fftwf_complex *)(void *)b->to;
    for (int i = 0; i < WAYS - 1; i++) {
        const unsigned kept = planning[i] | FFTW_PRESERVE_INPUT;
        b->plan[i][0] = fftwf_plan_dft_1d((int)n, from, to, FFTW_FORWARD, kept);
        b->plan[i][1] = fftwf_plan_dft_r2c_1d((int)n, b->from, to, kept);
        b->plan[i][2] = fftwf_plan_dft_c2r_1d((int)n, from, b->to, planning[i]);
    }
done:
    return rc;
}

static void teardown(struct bench *b)
{
    for (int i = 0; i < WAYS - 1; i++) {
        for (int kind = 0; kind < KINDS; kind++) {
            fftwf_destroy_plan(b->plan[i][kind]);
        }
    }
    v2v_fft_lanes_destroy(&b->whole);
    v2v_fft_lanes_destroy(&b->half);
    v2v_mem_free(b->planes);
    v2v_mem_free(b->from);
    v2v_mem_free(b->to);
}

static void side_by_side(const struct bench *b, int kind)
{
    const int64_t plane = (b->n + 1) * V2V_LANES;
    struct v2v_lanes lanes = {b->planes, b->planes + plane, b->planes + 2 * plane,
                              b->planes + 3 * plane};
    if (kind == 0) {
        v2v_fft_lanes_forward(b->whole, &lanes);
    } else if (kind == 1) {
        v2v_fft_lanes_real_forward(b->half, &lanes);
    } else {
        v2v_fft_lanes_real_inverse(b->half, &lanes);
    }
}

/* Seconds of one transform. */
static double turn(const struct bench *b, int way, int kind)
{
    const double began = v2v_clock_now();
    for (int i = 0; i < REPEATS; i++) {
        if (way == WAYS - 1) {
            side_by_side(b, kind);
        }
        for (int k = 0; way < WAYS - 1 && k < V2V_LANES; k++) {
            fftwf_execute(b->plan[way][kind]);
        }
    }
    return (v2v_clock_now() - began) / (REPEATS * V2V_LANES);
}

static void report(const struct bench *b)
{
    double least[WAYS][KINDS];
    for (int t = 0; t < TURNS; t++) {
        for (int way = 0; way < WAYS; way++) {
            for (int kind = 0; kind < KINDS; kind++) {
                const double seconds = turn(b, way, kind);
                if (t == 0 || seconds < least[way][kind]) {
                    least[way][kind] = seconds;
                }
            }
        }
    }
    for (int way = 0; way < WAYS; way++) {
        printf("%5lld  %-15s complex %7.3f   real forward %7.3f   real inverse %7.3f us\n",
               (long long)b->n, ways[way], 1e6 * least[way][0], 1e6 * least[way][1],
               1e6 * least[way][2]);
    }
}

static enum v2v_status run(int64_t n)
{
    enum v2v_status rc = V2V_OK;
    struct bench b;
    V2V_TRY(prepare(&b, v2v_fft_good_size(n)));
    report(&b);
done:
    teardown(&b);
    return rc;
}

int main(int argc, char **argv)
{
    static const int64_t usual[] = {256, 400, 512, 560, 576, 640, 1050};
    const int count = argc > 1 ? argc - 1 : (int)(sizeof usual / sizeof *usual);
    for (int i = 0; i < count; i++) {
        const long n = argc > 1 ? strtol(argv[i + 1], NULL, 10) : (long)usual[i];
        if (n < 2 || n > 1 << 20 || run(n) != V2V_OK) {
            fprintf(stderr, "%s\n",
                    n < 2 || n > 1 << 20 ? "sizes from 2 to 1048576" : v2v_status_message());
            return 1;
        }
    }
    return 0;
}
