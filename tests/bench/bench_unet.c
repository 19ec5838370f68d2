/* Milliseconds and GFLOP/s of the networks that are a U-Net (REFERENCE.md 16): a pass forward,
 * and one forward and back, the fastest of three; those of the direct sums, whatever is saved. */
#include "v2v3d/base/clock.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/method/networks.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/op/gemm.h"

#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { VIEWS = 13, SLICES = 39, SIDE = 128, TRIES = 3 };

/* Multiply-adds of a pass: every weight with every pixel and image of its level. */
static double macs_of(const struct v2v_network *network)
{
    double macs = 0.0;
    for (int64_t i = 0; i < network->schema.fields.count; i++) {
        const struct v2v_fields_item *field = &network->schema.fields.item[i];
        const char *digit = strpbrk(field->name, "0123456789");
        const int level = digit != NULL ? *digit - '0' : 0; /* the last layer's is the first */
        const int is_stack = (network->ops->traits & V2V_TRAIT_VIEWS) != 0;
        const double images = is_stack ? (double)network->slices / (1 << level) : 1.0;
        const double pixels = (double)(SIDE >> level) * (SIDE >> level);
        macs += field->rank > 1 ? (double)field->count * images * pixels : 0.0;
    }
    return macs;
}

static enum v2v_status measure(double *seconds, struct v2v_network *network, int training,
                               float *volume, const float *views)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_network_plan plan = {.height = SIDE, .width = SIDE, .training = training};
    V2V_TRY(network->ops->plan(network, &plan));
    *seconds = INFINITY;
    for (int try = 0; try <= TRIES; try++) { /* the first touches the memory */
        const double began = v2v_clock_now();
        network->ops->forward(network, &volume, views);
        if (training) {
            network->ops->backward(network, (const float *const[]){volume, NULL});
        }
        *seconds = try > 0 ? fmin(*seconds, v2v_clock_now() - began) : *seconds;
    }
done:
    return rc;
}

static enum v2v_status run(const char *name)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_config config;
    struct v2v_network *network = NULL;
    float *volume = NULL, *views = NULL;
    double seconds[2] = {0.0, 0.0}, bytes[2];
    int64_t parameters = 0;
    v2v_config_defaults(&config);
    const struct v2v_network_spec spec = {
        .config = &config, .views = VIEWS, .slices = SLICES, .outputs = V2V_NETWORK_ALL};
    V2V_TRY(v2v_network_create(&network, name, &spec));
    V2V_TRY(v2v_rule_weights(&network->schema.fields, network->weights, V2V_RULE_HE, 7));
    const int64_t ins = network->inputs * SIDE * SIDE;
    V2V_TRY(V2V_ALLOC(views, "bench", ins));
    V2V_TRY(V2V_ALLOC(volume, "bench", network->slices * SIDE * SIDE));
    for (int64_t i = 0; i < ins; i++) {
        views[i] = (float)v2v_random_uniform(3, 1, (uint64_t)i);
    }
    for (int64_t i = 0; i < network->schema.fields.count; i++) {
        parameters += network->schema.fields.item[i].count;
    }
    for (int training = 0; training < 2; training++) {
        V2V_TRY(measure(&seconds[training], network, training, volume, views));
        bytes[training] = (double)v2v_mem_held();
    }
    const double gflop = 2e-9 * macs_of(network);
    printf("%-8s %9lld parameters, %6.1f GFLOP  forward %8.1f ms %6.1f GFLOP/s %6.0f MB  step "
           "%8.1f ms %6.1f GFLOP/s %6.0f MB\n",
           name, (long long)parameters, gflop, 1e3 * seconds[0], gflop / seconds[0],
           1e-6 * bytes[0], 1e3 * seconds[1], 3.0 * gflop / seconds[1], 1e-6 * bytes[1]);
done:
    v2v_network_destroy(&network);
    v2v_mem_free(volume);
    v2v_mem_free(views);
    return rc;
}

int main(int argc, char **argv)
{
    static const char *const names[] = {"vcdnet", "deepcad"};
    const long threads = argc > 1 ? strtol(argv[1], NULL, 10) : omp_get_num_procs();
    v2v_op_set_threads(threads >= 1 && threads <= 4096 ? (int)threads : 1);
    printf("%d threads; %d views, %d slices or 32 frames, %d x %d\n", omp_get_max_threads(), VIEWS,
           SLICES, SIDE, SIDE);
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        if (run(names[i]) != V2V_OK) {
            fprintf(stderr, "%s\n", v2v_status_message());
            return 1;
        }
    }
    return 0;
}
