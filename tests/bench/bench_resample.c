/* GB/s (read and written once) of pooling and upsampling on the encoder's and the U-Net's shapes.
 */
#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/op/activation.h"
#include "v2v3d/op/gemm.h"
#include "v2v3d/op/resample.h"
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>

struct work {
    float *small, *large; /**< [planes,y,x] and factor times that in y and x */
    uint8_t *which;
    int64_t planes, height, width; /**< of the small image */
    int factor;
};

static void run(const struct work *w, int kind)
{
    int64_t h = w->height * w->factor, x = w->width * w->factor;
    switch (kind) {
    case 0:
        v2v_avgpool_forward(w->small, w->large, w->planes, h, x, w->factor);
        break;
    case 1:
        v2v_avgpool_backward(w->large, w->small, w->planes, h, x, w->factor);
        break;
    case 2:
        v2v_bilinear_forward(w->large, w->small, w->planes, w->height, w->width, w->factor);
        break;
    case 3:
        v2v_bilinear_backward(w->small, w->large, w->planes, w->height, w->width, w->factor);
        break;
    case 4:
        v2v_maxpool2_forward(w->small, w->which, w->large, w->planes, h, x);
        break;
    case 5:
        v2v_maxpool2_backward(w->large, w->small, w->which, w->planes, h, x);
        break;
    case 6:
        v2v_nearest2_forward(w->large, w->small, w->planes, w->height, w->width);
        break;
    case 7:
        v2v_nearest2_backward(w->small, w->large, w->planes, w->height, w->width);
        break;
    default:
        v2v_leaky_forward(w->large, w->large, w->planes * h * x, 0.01f);
    }
}

static const char *const names[] = {"average",  "average'", "bilinear", "bilinear'", "maximum",
                                    "maximum'", "nearest",  "nearest'", "leaky"};

static enum v2v_status measure(int64_t planes, int64_t side, int factor)
{
    enum v2v_status rc = V2V_OK;
    struct work w = {.planes = planes, .height = side, .width = side, .factor = factor};
    int64_t small = planes * side * side, large = small * factor * factor;
    V2V_TRY(V2V_ALLOC(w.small, "bench", small));
    V2V_TRY(V2V_ALLOC(w.large, "bench", large));
    V2V_TRY(V2V_ALLOC(w.which, "bench", small));
    for (int kind = 0; kind < 9; kind++) {
        double best = 1e30;
        if (factor != 2 && kind > 3) {
            continue;
        }
        for (int i = 0; i < 10; i++) {
            double start = v2v_clock_now();
            run(&w, kind);
            double seconds = v2v_clock_now() - start;
            best = seconds < best ? seconds : best;
        }
        printf("%5lld planes %4lld x %-4lld by %d %-10s %8.3f ms %6.1f GB/s\n", (long long)planes,
               (long long)side, (long long)side, factor, names[kind], 1e3 * best,
               1e-9 * 4.0 * (double)(small + large) / best);
    }
done:
    v2v_mem_free(w.small);
    v2v_mem_free(w.large);
    v2v_mem_free(w.which);
    return rc;
}

int main(int argc, char **argv)
{
    long threads = argc > 1 ? strtol(argv[1], NULL, 10) : omp_get_num_procs();
    v2v_op_set_threads(threads >= 1 && threads <= 4096 ? (int)threads : 1);
    static const struct {
        int64_t planes, side;
        int factor;
    } cases[] = {{52, 64, 2}, {52, 32, 4}, {52, 16, 8}, {52, 256, 2}, {128, 32, 2}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        if (measure(cases[i].planes, cases[i].side, cases[i].factor) != V2V_OK) {
            fprintf(stderr, "%s\n", v2v_status_message());
            return 1;
        }
    }
    return 0;
}
