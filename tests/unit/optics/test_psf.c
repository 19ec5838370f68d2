#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/base/text.h"
#include "v2v3d/optics/projector.h"
#include "v2v3d/optics/psf.h"
#include <float.h>
#include <math.h>

enum { VIEWS = 3, SLICES = 4, SIDE = 7, ONE_VIEW = SLICES * SIDE * SIDE };

static void make_psf(struct v2v_psf_file *psf)
{
    *psf = (struct v2v_psf_file){.views = VIEWS, .slices = SLICES, .height = SIDE, .width = SIDE};
    assert_ok(V2V_ALLOC(psf->data, "test", VIEWS * ONE_VIEW));
    for (int64_t i = 0; i < VIEWS * ONE_VIEW; i++) {
        psf->data[i] = (float)(1 + i / ONE_VIEW) * (float)v2v_random_uniform(9, 0, (uint64_t)i);
    }
}

static double sum_of_view(const struct v2v_psf_file *psf, int64_t v)
{
    double sum = 0;
    for (int64_t i = 0; i < ONE_VIEW; i++) {
        sum += psf->data[v * ONE_VIEW + i];
    }
    return sum;
}

static void normalised_views_sum_to_one(void **state)
{
    struct v2v_psf_file psf;
    (void)state;
    make_psf(&psf);
    const double ratio = psf.data[1] / psf.data[2];
    v2v_psf_normalize_views(&psf);
    for (int64_t v = 0; v < VIEWS; v++) {
        /* Each value is rounded once. */
        assert_true(fabs(sum_of_view(&psf, v) - 1) <= FLT_EPSILON);
    }
    assert_true(fabs(psf.data[1] / psf.data[2] - ratio) <= 2 * FLT_EPSILON * ratio);
    v2v_mem_free(psf.data);
}

static void normalised_sets_project_ones_to_ones(void **state)
{
    enum { FRAME = 20 };
    struct v2v_psf_file psf;
    struct v2v_projector *projector = NULL;
    float *volume = NULL, *views = NULL;
    (void)state;
    make_psf(&psf);
    v2v_psf_normalize_views(&psf);
    assert_ok(v2v_projector_create(&projector, &psf, FRAME, FRAME, V2V_SPLIT_SLICES, NULL));
    assert_ok(V2V_ALLOC(volume, "test", SLICES * FRAME * FRAME));
    assert_ok(V2V_ALLOC(views, "test", VIEWS * FRAME * FRAME));
    for (int64_t i = 0; i < SLICES * FRAME * FRAME; i++) {
        volume[i] = 1;
    }
    v2v_projector_forward(projector, views, volume, NULL, VIEWS, 1.0f);
    for (int64_t v = 0; v < VIEWS; v++) {
        for (int64_t y = SIDE; y < FRAME - SIDE; y++) {
            for (int64_t x = SIDE; x < FRAME - SIDE; x++) {
                /* Three transforms of about 2^10 samples: 3 * 10 roundings. */
                assert_true(fabsf(views[(v * FRAME + y) * FRAME + x] - 1) <= 30 * FLT_EPSILON);
            }
        }
    }
    v2v_mem_free(views);
    v2v_mem_free(volume);
    v2v_projector_destroy(&projector);
    v2v_mem_free(psf.data);
}

static void energy_mean_is_the_first_views_sum_over_slices(void **state)
{
    struct v2v_psf_file psf;
    (void)state;
    make_psf(&psf);
    assert_true(fabs(v2v_psf_energy_mean(&psf) - sum_of_view(&psf, 0) / SLICES) <= 1e-12);
    v2v_mem_free(psf.data);
}

static void projector_holds_the_bytes_it_foretells(void **state)
{
    struct v2v_psf_file psf;
    struct v2v_projector *projector = NULL;
    (void)state;
    make_psf(&psf);
    const size_t before = v2v_mem_held();
    assert_ok(v2v_projector_create(&projector, &psf, 50, 41, V2V_SPLIT_SLICES, NULL));
    const double held = (double)(v2v_mem_held() - before);
    /* The allocator counts what it adds for alignment, the plan object its few numbers. */
    assert_true(fabs(held - (double)v2v_projector_bytes(&psf, 50, 41, V2V_SPLIT_SLICES, 1)) <=
                1024);
    assert_true(v2v_projector_bytes(&psf, 50, 41, V2V_SPLIT_SLABS, 3) <
                v2v_projector_bytes(&psf, 50, 41, V2V_SPLIT_SLICES, 1));
    v2v_projector_destroy(&projector);
    assert_int_equal(v2v_mem_held(), before);
    v2v_mem_free(psf.data);
}

static void frame_beyond_all_memory_is_refused(void **state)
{
    struct v2v_psf_file psf;
    struct v2v_projector *projector = NULL;
    (void)state;
    make_psf(&psf);
    const size_t before = v2v_mem_held();
    assert_int_equal(
        v2v_projector_create(&projector, &psf, INT32_MAX, INT32_MAX, V2V_SPLIT_SLICES, NULL),
        V2V_E_MEMORY);
    assert_null(projector);
    assert_int_equal(v2v_mem_held(), before);
    v2v_mem_free(psf.data);
}

static void missing_set_is_an_input_failure(void **state)
{
    struct v2v_psf_file psf = {0};
    (void)state;
    assert_int_equal(v2v_psf_read(&psf, "/nowhere/psf", "", V2V_NORMALIZE_VIEW, NULL), V2V_E_INPUT);
}

/* The example of psf.h, with the set's path and a smaller frame given. */
static enum v2v_status project(float *views, const float *volume, const char *path, int64_t side,
                               const struct v2v_comm *comm)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_psf_file psf = {0};
    struct v2v_projector *projector = NULL;
    V2V_TRY(v2v_psf_read(&psf, path, "", V2V_NORMALIZE_VIEW, comm));
    V2V_TRY(v2v_projector_create(&projector, &psf, side, side, V2V_SPLIT_SLICES, comm));
    v2v_projector_forward(projector, views, volume, NULL, psf.views, 1.0f);
done:
    v2v_projector_destroy(&projector);
    v2v_psf_file_fini(&psf);
    return rc;
}

static void header_example_projects_a_point_to_the_normalised_psf(void **state)
{
    enum { FRAME = 16, POINT = 8, CENTRE = 3 };
    struct v2v_psf_file psf;
    float *volume = NULL, *views = NULL;
    char path[512];
    (void)state;
    make_psf(&psf);
    assert_ok(v2v_text_format(path, sizeof path, "%s/psf.h5", test_folder(NULL)));
    assert_ok(v2v_psf_file_write(&psf, path));
    v2v_psf_normalize_views(&psf);
    assert_ok(V2V_ALLOC(volume, "test", SLICES * FRAME * FRAME));
    assert_ok(V2V_ALLOC(views, "test", VIEWS * FRAME * FRAME));
    volume[(2 * FRAME + POINT) * FRAME + POINT] = 1; /* in slice 2 */
    assert_ok(project(views, volume, path, FRAME, NULL));
    for (int64_t v = 0; v < VIEWS; v++) {
        for (int64_t y = 0; y < SIDE; y++) {
            for (int64_t x = 0; x < SIDE; x++) {
                const int64_t pixel = (POINT - CENTRE + y) * FRAME + POINT - CENTRE + x;
                const double tap = psf.data[v * ONE_VIEW + (2 * SIDE + y) * SIDE + x];
                /* Three transforms of about 2^9 samples, values below 0.02. */
                assert_true(fabs(views[v * FRAME * FRAME + pixel] - tap) <=
                            27 * FLT_EPSILON * 0.02);
            }
        }
    }
    v2v_mem_free(views);
    v2v_mem_free(volume);
    v2v_mem_free(psf.data);
}

/* Of even light an eighth; a pixel with dark neighbours has no bound, unless it is dim. */
static void sharpness_is_that_of_the_sharpest_pixel(void **state)
{
    (void)state;
    float data[2 * 25] = {0.0f};
    const struct v2v_psf_file psf = {
        .views = 1, .slices = 2, .height = 5, .width = 5, .data = data};
    assert_true(v2v_psf_sharpness(&psf) == 0.0);
    for (int i = 0; i < 25; i++) {
        data[i] = 2.0f;
    }
    assert_true(v2v_psf_sharpness(&psf) == 1.0 / 3.0); /* a corner's three neighbours */
    data[12] = 8.0f;
    assert_true(v2v_psf_sharpness(&psf) == 0.5);
    data[25 + 12] = 10.0f;
    data[25 + 13] = 5.0f;
    assert_true(v2v_psf_sharpness(&psf) == 2.0);
    data[25 + 24] = 0.9f;
    assert_true(v2v_psf_sharpness(&psf) == 2.0);
    data[25 + 24] = 1.1f;
    assert_true(isinf(v2v_psf_sharpness(&psf)));
}

/* Displacing by parts of pixels leaves light below zero beside the peak. */
static void positive_psfs_keep_the_sum_of_every_slice(void **state)
{
    (void)state;
    enum { PIXELS = 9 };
    float data[3 * PIXELS] = {
        [3] = -0.25f, [4] = 1.5f, [5] = -0.25f, [PIXELS + 2] = 0.5f, [2 * PIXELS] = -1.0f};
    const struct v2v_psf_file psf = {
        .views = 1, .slices = 3, .height = 3, .width = 3, .data = data};
    struct v2v_psf_file copy;
    assert_ok(v2v_psf_positive(&copy, &psf));
    for (int i = 0; i < 3 * PIXELS; i++) {
        assert_true(copy.data[i] == (i == 4 ? 1.0f : i == PIXELS + 2 ? 0.5f : 0.0f));
    }
    v2v_psf_file_fini(&copy);
}

/* Back-projected noise, far from the border, of every slice; 4 standard errors. */
static void noise_of_a_voxel_is_what_a_back_projection_has(void **state)
{
    (void)state;
    enum { EDGE = 96, PIXELS = EDGE * EDGE, BORDER = 12 };
    struct v2v_psf_file psf;
    struct v2v_projector *projector = NULL;
    make_psf(&psf);
    float *views = NULL, *volume = NULL;
    double squares = 0.0, count = 0.0;
    assert_ok(V2V_ALLOC(views, "test", psf.views * PIXELS));
    assert_ok(V2V_ALLOC(volume, "test", psf.slices * PIXELS));
    for (int64_t i = 0; i < psf.views * PIXELS; i++) {
        views[i] = (float)v2v_random_normal(12, 0, (uint64_t)i);
    }
    assert_ok(v2v_projector_create(&projector, &psf, EDGE, EDGE, V2V_SPLIT_SLICES, NULL));
    v2v_projector_adjoint(projector, volume, views, NULL, psf.views, 1.0f);
    for (int64_t i = 0; i < psf.slices * PIXELS; i++) {
        const int64_t y = i / EDGE % EDGE, x = i % EDGE;
        if (y >= BORDER && y < EDGE - BORDER && x >= BORDER && x < EDGE - BORDER) {
            squares += (double)volume[i] * (double)volume[i];
            count += 1.0;
        }
    }
    const double kernel = (double)(psf.height * psf.width); /* voxels so near are not independent */
    assert_float_equal(sqrt(squares / count), v2v_psf_voxel_noise(&psf),
                       v2v_psf_voxel_noise(&psf) * 4.0 * sqrt(kernel / (2.0 * count)));
    v2v_projector_destroy(&projector);
    v2v_mem_free(volume);
    v2v_mem_free(views);
    v2v_psf_file_fini(&psf);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(normalised_views_sum_to_one),
        cmocka_unit_test(normalised_sets_project_ones_to_ones),
        cmocka_unit_test(energy_mean_is_the_first_views_sum_over_slices),
        cmocka_unit_test(projector_holds_the_bytes_it_foretells),
        cmocka_unit_test(frame_beyond_all_memory_is_refused),
        cmocka_unit_test(header_example_projects_a_point_to_the_normalised_psf),
        cmocka_unit_test(positive_psfs_keep_the_sum_of_every_slice),
        cmocka_unit_test(noise_of_a_voxel_is_what_a_back_projection_has),
        cmocka_unit_test(sharpness_is_that_of_the_sharpest_pixel),
        cmocka_unit_test(missing_set_is_an_input_failure),
    };
    return cmocka_run_group_tests_name("optics.psf", tests, NULL, NULL);
}
