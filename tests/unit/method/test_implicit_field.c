/* The implicit field against its formula in double precision. Its gradient is
 * tests/property/method/test_implicit_field_gradient.c, its ranks tests/mpi/method/. */
#include "small_draw.h"

#include "method/implicit_field.h"
#include "v2v3d/op/gemm.h"

#include <math.h>
#include <string.h>

enum { SLICES = 5, HEIGHT = 6, COLUMNS = 37, ROW = SLICES * COLUMNS, VOXELS = ROW * HEIGHT };
enum { MOST_WIDTH = 64, SEED = 9 };

static void init(struct v2v_implicit_field *field, int64_t width)
{
    assert_ok(v2v_implicit_field_init(field, width, SLICES, HEIGHT, COLUMNS, NULL));
    v2v_implicit_field_draw(field, SEED);
}

/* Coordinates of any size. */
static void spread(struct v2v_implicit_field *field)
{
    for (int64_t i = 0; i < HEIGHT * V2V_IMPLICIT_COORDINATES * field->run; i++) {
        field->table[i] *= 1e4f;
    }
}

static double above_zero(double x)
{
    return x > 0.0 ? x : 0.0;
}

static double plain_voxel(const struct v2v_implicit_field *field, const double t[2])
{
    const struct v2v_implicit_layout *at = &field->at;
    const float *w = field->weights;
    double first[MOST_WIDTH], out = (double)w[at->b3];
    for (int64_t k = 0; k < field->width; k++) {
        first[k] = above_zero((double)w[at->w1 + 2 * k] * t[0] +
                              (double)w[at->w1 + 2 * k + 1] * t[1] + (double)w[at->b1 + k]);
    }
    for (int64_t j = 0; j < field->width; j++) {
        double sum = (double)w[at->b2 + j];
        for (int64_t k = 0; k < field->width; k++) {
            sum += (double)w[at->w2 + j * field->width + k] * first[k];
        }
        out += (double)w[at->w3 + j] * above_zero(sum);
    }
    return fabs(1.0 + out);
}

static void the_volume_is_that_of_the_formula(void **state)
{
    (void)state;
    static float volume[VOXELS];
    static double plain[VOXELS];
    for (int64_t width = 32; width <= MOST_WIDTH; width += 32) {
        struct v2v_implicit_field field;
        init(&field, width);
        spread(&field);
        v2v_implicit_field_forward(&field, volume);
        for (int64_t i = 0; i < VOXELS; i++) {
            const int64_t z = i / (HEIGHT * COLUMNS), y = i / COLUMNS % HEIGHT, x = i % COLUMNS;
            const float *t = field.table + y * 2 * field.run + z * COLUMNS + x;
            plain[i] = plain_voxel(&field, (double[2]){(double)t[0], (double)t[field.run]});
        }
        /* sums of 3, width + 1 and width + 2 terms; none much smaller than its terms but few */
        assert_true(test_relative_l2_to_double(volume, plain, VOXELS) <
                    test_rounding(6.0 + 2.0 * (double)width));
        v2v_implicit_field_fini(&field);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

/* Coordinates within 1e-4, behind layers whose rows of weights add up to no more than 2 / sqrt(2),
 * 8 and 8: at most 90 times as far apart. */
static void a_fresh_field_is_constant_nearly(void **state)
{
    (void)state;
    static float volume[VOXELS];
    struct v2v_implicit_field field;
    int different = 0;
    init(&field, MOST_WIDTH);
    v2v_implicit_field_forward(&field, volume);
    for (int64_t i = 1; i < VOXELS; i++) {
        assert_true(fabs((double)volume[i] - (double)volume[0]) < 2e-4 * 91.0);
        different += volume[i] != volume[0];
    }
    assert_true(different > VOXELS / 2);
    v2v_implicit_field_fini(&field);
}

static void gradients_of(float *dtable, float *dweights, int threads)
{
    static float volume[VOXELS];
    struct v2v_implicit_field field;
    float *dvolume = small_draw(VOXELS, 8, 1.0);
    v2v_op_set_threads(threads);
    init(&field, 32);
    spread(&field);
    v2v_implicit_field_forward(&field, volume);
    v2v_implicit_field_backward(&field, dvolume);
    memcpy(dtable, field.dtable, (size_t)(HEIGHT * 2 * field.run) * sizeof *dtable);
    memcpy(dweights, field.dweights, (size_t)field.at.count * sizeof *dweights);
    v2v_implicit_field_fini(&field);
    v2v_mem_free(dvolume);
    v2v_op_set_threads(1);
}

static void any_number_of_threads_gives_the_same_bits(void **state)
{
    (void)state;
    enum { NUMBERS = HEIGHT * 2 * (ROW + 32), WEIGHTS = 32 * 32 + 5 * 32 + 1 };
    static float dtable[2][NUMBERS], dweights[2][WEIGHTS];
    gradients_of(dtable[0], dweights[0], 1);
    for (int threads = 2; threads <= 5; threads++) {
        gradients_of(dtable[1], dweights[1], threads);
        assert_memory_equal(dtable[0], dtable[1], sizeof dtable[0]);
        assert_memory_equal(dweights[0], dweights[1], sizeof dweights[0]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_volume_is_that_of_the_formula),
        cmocka_unit_test(a_fresh_field_is_constant_nearly),
        cmocka_unit_test(any_number_of_threads_gives_the_same_bits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
