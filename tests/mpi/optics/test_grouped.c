/* Views a group at a time give what all at once do, on any number of ranks. */
#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/optics/grouped.h"

#include <string.h>

enum { VIEWS = 5, SLICES = 7, KERNEL = 6, HEIGHT = 14, WIDTH = 11, PIXELS = HEIGHT * WIDTH };
enum { VOXELS = SLICES * PIXELS, SAMPLES = VIEWS * PIXELS };

static struct v2v_psf_file psf;
static size_t held;                              /* before a test */
static float volume[VOXELS], views[SAMPLES];     /* whole, drawn */
static float projected[SAMPLES], summed[VOXELS]; /* by all views at once, on this rank alone */
static float own[VOXELS], seen[SAMPLES], whole[VOXELS];

static void draw(float *x, int64_t count, uint64_t stream)
{
    for (int64_t i = 0; i < count; i++) {
        x[i] = (float)(v2v_random_uniform(5, stream, (uint64_t)i) - 0.5);
    }
}

static int setup(void **state)
{
    struct v2v_projector *projector = NULL;
    (void)state;
    held = v2v_mem_held();
    psf =
        (struct v2v_psf_file){.views = VIEWS, .slices = SLICES, .height = KERNEL, .width = KERNEL};
    assert_ok(V2V_ALLOC(psf.data, "test", VIEWS * SLICES * KERNEL * KERNEL));
    draw(psf.data, VIEWS * SLICES * KERNEL * KERNEL, 0);
    draw(volume, VOXELS, 1);
    draw(views, SAMPLES, 2);
    assert_ok(v2v_projector_create(&projector, &psf, HEIGHT, WIDTH, V2V_SPLIT_SLICES, NULL));
    v2v_projector_forward(projector, projected, volume, NULL, VIEWS, 0.5f);
    v2v_projector_adjoint(projector, summed, views, NULL, VIEWS, 0.5f);
    v2v_projector_destroy(&projector);
    return 0;
}

static int teardown(void **state)
{
    (void)state;
    v2v_psf_file_fini(&psf);
    return v2v_mem_held() != held;
}

/* The whole volume of which every rank holds slices. */
static void join(struct v2v_part mine)
{
    memset(whole, 0, sizeof whole);
    memcpy(whole + mine.first * PIXELS, own, (size_t)(mine.count * PIXELS) * sizeof *own);
    v2v_par_sum_f32(test_world(), whole, VOXELS);
}

/* A sum of as many products as a kernel has taps, times slices or views: test_rounding of each, and
 * the transforms' own, a few of 2^-24 for each of their log2(n) levels, of which 16 are more than
 * enough for frames of 20 x 16. */
#define TOLERANCE (test_rounding(KERNEL * KERNEL * SLICES) + 16 * 6e-8)

static void check(enum v2v_split split, int64_t most_bytes, int64_t together)
{
    struct v2v_grouped *grouped = NULL;
    assert_ok(v2v_grouped_create(&grouped, &psf, HEIGHT, WIDTH, split, most_bytes, test_world()));
    const struct v2v_part mine = v2v_grouped_slices(grouped);
    assert_int_equal(v2v_grouped_together(grouped), together);
    assert_ok(v2v_grouped_forward(grouped, seen, volume + mine.first * PIXELS, 0.5f));
    assert_true(test_relative_l2(seen, projected, SAMPLES) < TOLERANCE);
    assert_ok(v2v_grouped_adjoint(grouped, own, views, 0.5f));
    join(mine);
    assert_true(test_relative_l2(whole, summed, VOXELS) < TOLERANCE);
    v2v_grouped_destroy(&grouped);
    assert_null(grouped);
}

static const enum v2v_split splits[] = {V2V_SPLIT_SLICES, V2V_SPLIT_SLABS,
                                        V2V_SPLIT_SLABS_FFTW3_MPI};

static int64_t bytes_of(int64_t count, enum v2v_split split)
{
    struct v2v_psf_file some = psf;
    some.views = count;
    return v2v_projector_bytes(&some, HEIGHT, WIDTH, split, 1);
}

static void all_views_are_one_group_where_they_fit(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof splits / sizeof *splits; i++) {
        check(splits[i], INT64_MAX, VIEWS);
        check(splits[i], bytes_of(VIEWS, splits[i]), VIEWS);
    }
}

/* Four fit: two groups of three and two. Two fit: three groups. None fits: one at a time. */
static void groups_are_as_few_as_fit_and_even(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof splits / sizeof *splits; i++) {
        check(splits[i], bytes_of(4, splits[i]), 3);
        check(splits[i], bytes_of(2, splits[i]), 2);
        check(splits[i], 1, 1);
    }
}

static void a_memory_limit_makes_groups(void **state)
{
    (void)state;
    const size_t needed = (size_t)bytes_of(VIEWS, V2V_SPLIT_SLICES);
    struct v2v_grouped *grouped = NULL;
    v2v_mem_set_limit(v2v_mem_held() + needed); /* half of which is for OTFs */
    assert_ok(v2v_grouped_create(&grouped, &psf, HEIGHT, WIDTH, V2V_SPLIT_SLICES, INT64_MAX, NULL));
    assert_in_range(v2v_grouped_together(grouped), 1, VIEWS - 1);
    assert_ok(v2v_grouped_forward(grouped, seen, volume, 0.5f));
    assert_true(test_relative_l2(seen, projected, SAMPLES) < TOLERANCE);
    v2v_grouped_destroy(&grouped);
    v2v_mem_set_limit(0);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(all_views_are_one_group_where_they_fit, setup, teardown),
        cmocka_unit_test_setup_teardown(groups_are_as_few_as_fit_and_even, setup, teardown),
        cmocka_unit_test_setup_teardown(a_memory_limit_makes_groups, setup, teardown),
    };
    return test_mpi_main(tests, argc, argv);
}
