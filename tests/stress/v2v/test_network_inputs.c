/* The network on inputs of any size, in every way that this machine has, against the whole network
 * in double precision.
 *
 * The bound comes from what float32 does to one layer. A sum of n products rounded n times errs
 * as if each weight were off by u sqrt((n + 1) / 2), u = 2^-24, independently (see
 * tests/stress/op/test_winograd_depth.c, also for what Winograd does: 10.8 times the same
 * for n = channels, and 24 roundings of the transforms); bias, activation, pooling, interpolation
 * and sums of branches round each value a few times more. So the float32 network is the exact
 * network of such weights, and what they do to its volumes is measured on the twin: with noise of
 * that size on the weights, times MAGNIFIED to be well above the rounding of the weights
 * themselves, and divided by it. */
#include "hard_input.h"
#include "support.h"

#include "network/network_twin.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/tensor/statistics.h"
#include "v2v3d/v2v/schema.h"

#include <math.h>
#include <string.h>

enum { VIEWS = 5, SLICES = 4, HEIGHT = 32, WIDTH = 64, CHANNELS = 16, BRANCHES = 2, DRAWS = 2 };
enum { PIXELS = HEIGHT * WIDTH, VOXELS = SLICES * PIXELS, HOT = 2 * PIXELS + 17 * WIDTH + 5 };

static const double unit = 0x1p-24, amplification = 10.8, transform_roundings = 24.0,
                    few_roundings = 4.0;

#define MAGNIFIED 256.0

struct way {
    const char *name;
    int backend, every_slice, training;
};
static const struct way ways[] = {{"oneDNN", V2V_BACKEND_ONEDNN, 0, 0},
                                  {"by slice", V2V_BACKEND_ONEDNN, 1, 0},
                                  {"training", V2V_BACKEND_ONEDNN, 0, 1},
                                  {"OpenBLAS", V2V_BACKEND_OPENBLAS, 0, 0},
                                  {"by slice", V2V_BACKEND_OPENBLAS, 1, 0}};
enum { WAYS = sizeof ways / sizeof *ways };

struct network {
    struct v2v_model_spec spec;
    struct v2v_shifts shifts;
    struct v2v_fields fields;
    float *weights, *noisy;
};

static float views[VIEWS * PIXELS], volume[BRANCHES][VOXELS];
static double twin[BRANCHES][VOXELS], moved[BRANCHES][VOXELS];

static void network_init(struct network *n)
{
    *n = (struct network){.spec = {.views = VIEWS,
                                   .slices = SLICES,
                                   .width = CHANNELS,
                                   .features = 4,
                                   .branches = V2V_BRANCH_BOTH,
                                   .volume_scale = 1.0},
                          .shifts = {.views = VIEWS, .slices = SLICES}};
    assert_ok(V2V_ALLOC(n->shifts.dy, "test", VIEWS * SLICES));
    assert_ok(V2V_ALLOC(n->shifts.dx, "test", VIEWS * SLICES));
    for (int i = 0; i < VIEWS * SLICES; i++) {
        n->shifts.dy[i] = (int32_t)v2v_random_below(9, 0, (uint64_t)i, 7) - 3;
        n->shifts.dx[i] = (int32_t)v2v_random_below(9, 1, (uint64_t)i, 5) - 2;
    }
    assert_ok(v2v_model_schema(&n->fields, &n->spec));
    assert_ok(V2V_ALLOC(n->weights, "test", n->fields.total));
    assert_ok(V2V_ALLOC(n->noisy, "test", n->fields.total));
    assert_ok(v2v_rule_weights(&n->fields, n->weights, V2V_RULE_HASH, 7));
}

static void network_fini(struct network *n)
{
    v2v_mem_free(n->noisy);
    v2v_mem_free(n->weights);
    v2v_fields_fini(&n->fields);
    v2v_shifts_fini(&n->shifts);
    assert_int_equal(v2v_mem_held(), 0);
}

static void run_twin(double result[BRANCHES][VOXELS], const struct network *n, const float *weights)
{
    double *const into[BRANCHES] = {result[0], result[1]};
    assert_ok(
        v2v_network_twin(into, &n->spec, &n->shifts, &n->fields, weights, views, HEIGHT, WIDTH));
}

/* By how much the sums of a layer are off, as a fraction of its weights. */
static double roundings_of(const struct v2v_fields_item *field, int winograd)
{
    double products = field->rank == 4 ? (double)(field->count / field->shape[0]) : 0.0;
    double plain = sqrt((products + 1.0) / 2.0) + few_roundings;
    if (!winograd || field->rank != 4 || field->shape[3] != 3) {
        return unit * plain;
    }
    double channels = (double)field->shape[1];
    double filtered =
        amplification * (sqrt((channels + 1.0) / 2.0) + sqrt(transform_roundings)) + few_roundings;
    return unit * (filtered > plain ? filtered : plain);
}

static void add_noise(struct network *n, int winograd, uint64_t draw)
{
    for (int64_t f = 0; f < n->fields.count; f++) {
        const struct v2v_fields_item *field = &n->fields.item[f];
        double size = MAGNIFIED * roundings_of(field, winograd);
        for (int64_t i = field->offset; i < field->offset + field->count; i++) {
            n->noisy[i] =
                n->weights[i] * (float)(1.0 + size * v2v_random_normal(67, draw, (uint64_t)i));
        }
    }
}

static double norm_of(double result[BRANCHES][VOXELS])
{
    double sum = 0.0;
    for (int i = 0; i < BRANCHES * VOXELS; i++) {
        sum += result[i / VOXELS][i % VOXELS] * result[i / VOXELS][i % VOXELS];
    }
    return sqrt(sum);
}

/* The error to expect of the float32 network, relative to the twin's volumes. */
static double bound_of(struct network *n, int winograd)
{
    double sum = 0.0;
    for (int draw = 0; draw < DRAWS; draw++) {
        add_noise(n, winograd, (uint64_t)draw);
        run_twin(moved, n, n->noisy);
        for (int i = 0; i < BRANCHES * VOXELS; i++) {
            double d = moved[i / VOXELS][i % VOXELS] - twin[i / VOXELS][i % VOXELS];
            sum += d * d;
        }
    }
    return sqrt(sum / DRAWS) / MAGNIFIED / norm_of(twin);
}

/* Error of the network computed this way; its volumes are left in `volume`. */
static double error_of(const struct network *n, const struct way *way, int winograd)
{
    struct v2v_model *model = NULL;
    struct v2v_model_spec spec = n->spec;
    spec.backend = way->backend;
    spec.winograd = winograd;
    spec.every_slice = way->every_slice;
    assert_ok(v2v_model_create(&model, &spec, &n->shifts));
    memcpy(v2v_model_weights(model), n->weights, (size_t)n->fields.total * sizeof *n->weights);
    assert_ok(v2v_model_plan(model, HEIGHT, WIDTH, way->training));
    v2v_model_forward(model, volume[0], volume[1], views);
    v2v_model_destroy(&model);
    return test_relative_l2_to_double(&volume[0][0], &twin[0][0], BRANCHES * VOXELS);
}

static double largest(void)
{
    double most = 0.0;
    for (int i = 0; i < BRANCHES * VOXELS; i++) {
        most = fmax(most, fabs((double)volume[i / VOXELS][i % VOXELS]));
    }
    return most;
}

static void check(int winograd)
{
    struct network n;
    network_init(&n);
    print_message("%s Winograd\n%-10s %9s %6s", winograd ? "with" : "without", "input", "largest",
                  "finite");
    for (int w = 0; w < WAYS; w++) {
        print_message(" %9s", ways[w].name);
    }
    print_message(" | %9s\n", "bound");
    for (int which = 0; which < TEST_HARD_INPUTS; which++) {
        double error[WAYS];
        int64_t bad = -1;
        for (int64_t i = 0; i < VIEWS * PIXELS; i++) {
            views[i] = test_hard_sample(which, i, WIDTH, HOT);
        }
        run_twin(twin, &n, n.weights);
        double bound = bound_of(&n, winograd);
        for (int w = 0; w < WAYS; w++) {
            error[w] = error_of(&n, &ways[w], winograd);
            int64_t here = v2v_first_not_finite(&volume[0][0], BRANCHES * VOXELS);
            bad = here >= 0 ? here : bad;
        }
        print_message("%-10s %9.2e %6s", test_hard_name(which), largest(), bad < 0 ? "yes" : "NO");
        for (int w = 0; w < WAYS; w++) {
            print_message(" %9.1e", error[w]);
        }
        print_message(" | %9.1e\n", bound);
        assert_int_equal(bad, -1);
        for (int w = 0; w < WAYS; w++) {
            assert_true(error[w] <= bound);
        }
    }
    network_fini(&n);
}

static void volumes_are_the_twins_to_float32_rounding(void **state)
{
    (void)state;
    check(0);
}

static void minimal_filtering_adds_no_more_than_its_transforms_amplify(void **state)
{
    (void)state;
    check(1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(volumes_are_the_twins_to_float32_rounding),
        cmocka_unit_test(minimal_filtering_adds_no_more_than_its_transforms_amplify),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
