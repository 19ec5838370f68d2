/* Volumes judged by one that is known: by hand, by plain loops, and on several threads. */
#include "small_draw.h"

#include "v2v3d/loss/loss.h"

#include <math.h>
#include <omp.h>
#include <string.h>

enum { SLICES = 7, HEIGHT = 5, WIDTH = 6, PIXELS = HEIGHT * WIDTH, VOXELS = SLICES * PIXELS };
enum { COMPARED = SLICES * 3 * 4 };

static const struct v2v_window window = {.y0 = 1, .y1 = 4, .x0 = 2, .x1 = 6};

static int64_t place(int64_t z, int64_t y, int64_t x)
{
    return z * PIXELS + y * WIDTH + x;
}

static int is_compared(int64_t voxel)
{
    const int64_t y = voxel / WIDTH % HEIGHT, x = voxel % WIDTH;
    return y >= window.y0 && y < window.y1 && x >= window.x0 && x < window.x1;
}

/* What is there already is written over. */
static void evaluate(double *terms, float *dvolume, const float *volume, const float *known,
                     struct v2v_number weight)
{
    struct v2v_loss_settings settings = {.profile = V2V_LOSS_PAPER};
    for (int t = 0; t < V2V_LOSS_TOTAL; t++) {
        settings.weight[t] = (struct v2v_number){V2V_NUMBER_GIVEN, 3.0}; /* of no effect */
    }
    settings.weight[V2V_LOSS_MSE] = weight;
    const struct v2v_volume_loss loss = {.settings = &settings,
                                         .slices = SLICES,
                                         .height = HEIGHT,
                                         .width = WIDTH,
                                         .window = window};
    for (int i = 0; i < VOXELS; i++) {
        dvolume[i] = NAN;
    }
    for (int t = 0; t < V2V_LOSS_TERMS; t++) {
        terms[t] = NAN;
    }
    v2v_volume_loss_evaluate(&loss, terms, dvolume, volume, known);
}

/* Differences of 1, -2 and 1.5 in the window, squares of 7.25, and others around it. */
static void check_by_hand(struct v2v_number weight, double value)
{
    static float volume[VOXELS], known[VOXELS], dvolume[VOXELS];
    double terms[V2V_LOSS_TERMS];
    const int64_t in[] = {place(0, 1, 2), place(3, 3, 5), place(6, 2, 3)};
    const int64_t out[] = {place(0, 0, 2), place(3, 4, 5), place(6, 2, 1)};
    for (int i = 0; i < VOXELS; i++) {
        volume[i] = known[i] = 0.5f * (float)(i % 7);
    }
    for (int i = 0; i < 3; i++) {
        volume[in[i]] += (float[]){1.0f, -2.0f, 1.5f}[i];
        volume[out[i]] += 4.0f;
    }
    evaluate(terms, dvolume, volume, known, weight);
    for (int t = 0; t < V2V_LOSS_TERMS; t++) {
        const double expected = t == V2V_LOSS_MSE     ? 7.25 / COMPARED
                                : t == V2V_LOSS_TOTAL ? value * 7.25 / COMPARED
                                                      : 0.0;
        assert_true(fabs(terms[t] - expected) <= 1e-15 * expected);
    }
    for (int i = 0; i < VOXELS; i++) {
        const double difference = is_compared(i) ? (double)volume[i] - (double)known[i] : 0.0;
        const double expected = value * 2.0 * difference / COMPARED;
        assert_true(fabs(dvolume[i] - expected) <= 0x1p-23 * fabs(expected)); /* two roundings */
    }
}

static void the_value_is_the_mean_square_in_the_window_and_weighted(void **state)
{
    (void)state;
    check_by_hand((struct v2v_number){.mode = V2V_NUMBER_AUTO}, 1.0);
    check_by_hand((struct v2v_number){V2V_NUMBER_GIVEN, 0.3}, 0.3);
    check_by_hand((struct v2v_number){.mode = V2V_NUMBER_NONE}, 0.0);
}

/* The gradient of a quadratic is its central difference, to the rounding of both. */
static void the_gradient_is_the_slope_of_the_total(void **state)
{
    (void)state;
    const struct v2v_number weight = {V2V_NUMBER_GIVEN, 0.3};
    const float step = 0.25f; /* exact beside numbers of 1/64 */
    static float dvolume[VOXELS], other[VOXELS];
    double before[V2V_LOSS_TERMS], after[V2V_LOSS_TERMS];
    float *volume = small_draw(VOXELS, 1, 1.0), *known = small_draw(VOXELS, 2, 1.0);
    for (int i = 0; i < VOXELS; i++) {
        volume[i] = rintf(volume[i] * 64.0f) / 64.0f;
        known[i] = rintf(known[i] * 64.0f) / 64.0f;
    }
    evaluate(before, dvolume, volume, known, weight);
    for (int i = 0; i < VOXELS; i++) {
        const float value = volume[i];
        volume[i] = value - step;
        evaluate(before, other, volume, known, weight);
        volume[i] = value + step;
        evaluate(after, other, volume, known, weight);
        volume[i] = value;
        const double slope =
            (after[V2V_LOSS_TOTAL] - before[V2V_LOSS_TOTAL]) / (2.0 * (double)step);
        const double rounding = 0x1p-52 * 2.0 * after[V2V_LOSS_TOTAL] / (double)step;
        assert_true(fabs(dvolume[i] - slope) <= 0x1p-23 * fabs(slope) + rounding);
        assert_true(is_compared(i) || dvolume[i] == 0.0f);
    }
    v2v_mem_free(volume);
    v2v_mem_free(known);
}

/* Squares of 2^53 in the first slice and of 1 in the others: sums in another order are others. */
static void any_number_of_threads_gives_the_same_bits(void **state)
{
    (void)state;
    enum { MOST_THREADS = 4 };
    static float volume[VOXELS], known[VOXELS], dvolume[MOST_THREADS][VOXELS];
    double terms[MOST_THREADS][V2V_LOSS_TERMS];
    memset(volume, 0, sizeof volume);
    volume[place(0, 1, 2)] = volume[place(0, 3, 5)] = 0x1p26f;
    for (int z = 1; z < SLICES; z++) {
        volume[place(z, 2, 3)] = 1.0f;
    }
    for (int t = 0; t < MOST_THREADS; t++) {
        omp_set_num_threads(t + 1);
        evaluate(terms[t], dvolume[t], volume, known, (struct v2v_number){V2V_NUMBER_GIVEN, 0.3});
        assert_memory_equal(terms[t], terms[0], sizeof terms[0]);
        assert_memory_equal(dvolume[t], dvolume[0], sizeof dvolume[0]);
    }
    omp_set_num_threads(1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_value_is_the_mean_square_in_the_window_and_weighted),
        cmocka_unit_test(the_gradient_is_the_slope_of_the_total),
        cmocka_unit_test(any_number_of_threads_gives_the_same_bits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
