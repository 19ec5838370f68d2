/* A frame in slabs of rows, one a rank, against the whole frame on one rank, and against the same
 * slabs all on one rank. */
#include "small_shifts.h"

#include "v2v3d/nn/rule.h"

#include <math.h>
#include <string.h>

enum { VIEWS = 5, SLICES = 4, WIDE = 64, WIDTH = 8, BRANCHES = 2 };
/* Five pieces of 32 rows, which no rank count tried cuts evenly; two, of which some ranks get none.
 */
enum { HIGH = 160, LOW = 64, MOST = SLICES * HIGH * WIDE };

static float views[VIEWS * HIGH * WIDE];

/* The rest of the sum over slabs, which the model leaves to its caller. */
static void sum_unets(const struct v2v_model *model, float *gradients)
{
    const struct v2v_comm *shard = v2v_model_spec(model)->shard;
    const struct v2v_fields *fields = v2v_model_fields(model);
    float *scratch = v2v_mem_alloc("test", V2V_PAR_SCRATCH, sizeof *scratch);
    int64_t encoder = v2v_fields_find(fields, "unet1.init_conv.0.weight")->offset;
    assert_non_null(scratch);
    v2v_par_sum_ordered_f32(shard, gradients + encoder, fields->total - encoder, scratch);
    v2v_mem_free(scratch);
}

/* What a model makes of the views; gradients for dvolume = 1 + z/10 + noise. */
struct outcome {
    float *volume[BRANCHES];
    float *gradients;
    int64_t fields;
    struct v2v_part rows;
};

static struct v2v_model_spec spec_of(int winograd, int every_slice)
{
    return (struct v2v_model_spec){.views = VIEWS,
                                   .slices = SLICES,
                                   .width = WIDTH,
                                   .features = 4,
                                   .branches = V2V_BRANCH_BOTH,
                                   .backend = V2V_BACKEND_ONEDNN,
                                   .winograd = winograd,
                                   .every_slice = every_slice,
                                   .volume_scale = 1.5};
}

static int64_t slab_count(void)
{
    int size = v2v_comm_size(test_world());
    return size > 1 ? size : 3;
}

static void draw_views(int64_t height)
{
    for (int64_t i = 0; i < VIEWS * height * WIDE; i++) {
        views[i] = (float)(0.2 + 0.1 * v2v_random_normal(31, 0, (uint64_t)i));
    }
}

static float *draw_gradient(int64_t height, struct v2v_part rows, int branch)
{
    float *gradient = v2v_mem_alloc("test", SLICES * rows.count * WIDE, sizeof *gradient);
    assert_non_null(gradient);
    for (int64_t z = 0; z < SLICES; z++) {
        for (int64_t i = 0; i < rows.count * WIDE; i++) {
            uint64_t place = (uint64_t)((z * height + rows.first) * WIDE + i);
            gradient[z * rows.count * WIDE + i] =
                (float)v2v_random_normal(32, (uint64_t)branch, place);
        }
    }
    return gradient;
}

static struct outcome run(const struct v2v_model_spec *spec, int64_t height, int training)
{
    struct outcome outcome = {0};
    struct v2v_model *model = NULL;
    struct v2v_shifts shifts = small_shifts(VIEWS, SLICES);
    assert_ok(v2v_model_create(&model, spec, &shifts));
    assert_ok(v2v_rule_weights(v2v_model_fields(model), v2v_model_weights(model), V2V_RULE_HE, 7));
    assert_ok(v2v_model_plan(model, height, WIDE, training));
    outcome.rows = v2v_model_rows(model);
    for (int b = 0; b < BRANCHES; b++) {
        assert_ok(V2V_ALLOC(outcome.volume[b], "test", SLICES * outcome.rows.count * WIDE));
    }
    v2v_model_forward(model, outcome.volume[0], outcome.volume[1], views);
    if (training) {
        float *dvolume[BRANCHES] = {draw_gradient(height, outcome.rows, 0),
                                    draw_gradient(height, outcome.rows, 1)};
        outcome.fields = v2v_model_fields(model)->total;
        assert_ok(V2V_ALLOC(outcome.gradients, "test", outcome.fields));
        v2v_model_backward(model, dvolume[0], dvolume[1]);
        memcpy(outcome.gradients, v2v_model_gradients(model),
               (size_t)outcome.fields * sizeof(float));
        sum_unets(model, outcome.gradients);
        v2v_mem_free(dvolume[0]);
        v2v_mem_free(dvolume[1]);
    }
    v2v_model_destroy(&model);
    v2v_shifts_fini(&shifts);
    return outcome;
}

static void release(struct outcome *outcome)
{
    v2v_mem_free(outcome->volume[0]);
    v2v_mem_free(outcome->volume[1]);
    v2v_mem_free(outcome->gradients);
}

/* Relative L2 distance of this rank's rows from the same rows of a whole volume. */
static double distance(const float *rows, const struct v2v_part *part, const float *whole,
                       int64_t height)
{
    double sum = 0.0, squares = 0.0;
    for (int64_t z = 0; z < SLICES; z++) {
        const float *a = rows + z * part->count * WIDE;
        const float *b = whole + (z * height + part->first) * WIDE;
        for (int64_t i = 0; i < part->count * WIDE; i++) {
            sum += ((double)a[i] - b[i]) * ((double)a[i] - b[i]);
            squares += (double)b[i] * b[i];
        }
    }
    return part->count > 0 ? sqrt(sum / squares) : 0.0;
}

static double distance_of_gradients(const struct outcome *a, const struct outcome *b)
{
    double sum = 0.0, squares = 0.0;
    for (int64_t i = 0; i < b->fields; i++) {
        sum += ((double)a->gradients[i] - b->gradients[i]) *
               ((double)a->gradients[i] - b->gradients[i]);
        squares += (double)b->gradients[i] * b->gradients[i];
    }
    return sqrt(sum / squares);
}

/* Round-off of two ways through 18 layers, and back through as many for a gradient: 6e-8 each,
 * times the root of the products that a sum has, of the network's largest layer (8 * width
 * channels) and of the alignment's (140); Winograd loses up to ten times more in a layer.
 * A leaky unit near its kink may fall to the other side: one of 1e5, whose share of the gradient is
 * its size. */
static double bound(int winograd, int training)
{
    double layers = training ? 36.0 : 18.0;
    return layers * 6e-8 * sqrt(9.0 * 8.0 * WIDTH + 9.0 * 140.0) * (winograd ? 10.0 : 1.0);
}

static void check(int64_t height, int winograd, int every_slice, int training)
{
    struct v2v_model_spec spec = spec_of(winograd, every_slice), cut = spec;
    draw_views(height);
    struct outcome whole = run(&spec, height, training);
    cut.slabs = slab_count();
    struct outcome alone = run(&cut, height, training);
    cut.shard = v2v_comm_size(test_world()) > 1 ? test_world() : NULL;
    struct outcome own = run(&cut, height, training);
    for (int b = 0; b < BRANCHES; b++) {
        double error = distance(own.volume[b], &own.rows, whole.volume[b], height);
        v2v_par_max_f64(test_world(), &error, 1);
        if (v2v_comm_rank(test_world()) == 0) {
            print_message("branch %d: %.2g of %.2g\n", b + 1, error, bound(winograd, 0));
        }
        assert_true(error <= bound(winograd, 0));
        assert_true(distance(own.volume[b], &own.rows, alone.volume[b], height) == 0.0);
    }
    if (training) {
        double error = distance_of_gradients(&own, &whole);
        print_message("gradients: %.2g of %.2g\n", error, bound(winograd, 1));
        assert_true(error <= bound(winograd, 1));
        assert_memory_equal(own.gradients, alone.gradients,
                            (size_t)own.fields * sizeof *own.gradients);
    }
    release(&own);
    release(&alone);
    release(&whole);
}

static void slabs_make_the_volumes_of_the_whole_frame(void **state)
{
    (void)state;
    check(HIGH, 0, 0, 0);
}

static void slabs_in_strips_make_the_volumes_of_the_whole_frame(void **state)
{
    (void)state;
    check(HIGH, 1, 0, 0);
}

static void slabs_without_merging_make_the_volumes_of_the_whole_frame(void **state)
{
    (void)state;
    check(HIGH, 1, 1, 0);
}

static void ranks_without_rows_take_part(void **state)
{
    (void)state;
    check(LOW, 1, 0, 0);
    check(LOW, 1, 0, 1);
}

static void slabs_make_the_gradients_of_the_whole_frame(void **state)
{
    (void)state;
    check(HIGH, 0, 0, 1);
}

static void slabs_by_minimal_filtering_make_the_gradients_of_the_whole_frame(void **state)
{
    (void)state;
    check(HIGH, 1, 0, 1);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slabs_make_the_volumes_of_the_whole_frame),
        cmocka_unit_test(slabs_in_strips_make_the_volumes_of_the_whole_frame),
        cmocka_unit_test(slabs_without_merging_make_the_volumes_of_the_whole_frame),
        cmocka_unit_test(ranks_without_rows_take_part),
        cmocka_unit_test(slabs_make_the_gradients_of_the_whole_frame),
        cmocka_unit_test(slabs_by_minimal_filtering_make_the_gradients_of_the_whole_frame),
    };
    return test_mpi_main(tests, argc, argv);
}
