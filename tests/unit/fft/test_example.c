#include "support.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/fft/fft2.h"

/* The example of fft2.h. */
static enum v2v_status there_and_back(float *image, struct v2v_complex *spectrum)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_fft2 *fft = NULL;
    V2V_TRY(v2v_fft2_create(&fft, v2v_fft_good_size(500), v2v_fft_good_size(500)));
    v2v_fft2_forward(fft, spectrum, image);
    v2v_fft2_inverse(fft, image, spectrum);
done:
    v2v_fft2_destroy(&fft);
    return rc;
}

static void header_example_gives_the_image_times_its_size(void **state)
{
    enum { SIDE = 500 };
    float *image = NULL;
    struct v2v_complex *spectrum = NULL;
    (void)state;
    assert_int_equal(v2v_fft_good_size(500), 500);
    assert_ok(V2V_ALLOC(image, "test", SIDE * SIDE));
    assert_ok(V2V_ALLOC(spectrum, "test", SIDE * (SIDE / 2 + 1)));
    image[SIDE + 3] = 1;
    assert_ok(there_and_back(image, spectrum));
    /* Two transforms of 2^18 samples: 36 roundings of 6e-8 of the energy, all in one pixel. */
    const float size = SIDE * SIDE;
    for (int64_t i = 0; i < SIDE * SIDE; i++) {
        const float expected = i == SIDE + 3 ? size : 0;
        assert_true(image[i] - expected <= 2.2e-6f * size);
        assert_true(expected - image[i] <= 2.2e-6f * size);
    }
    v2v_mem_free(spectrum);
    v2v_mem_free(image);
}

static void plan_short_of_memory_holds_nothing(void **state)
{
    struct v2v_fft2 *fft = NULL;
    const size_t held = v2v_mem_held();
    (void)state;
    v2v_mem_set_limit(held + 1000); /* room for the plan object, not for 64 x 64 pixels */
    assert_int_equal(v2v_fft2_create(&fft, 64, 64), V2V_E_MEMORY);
    v2v_mem_set_limit(0);
    assert_null(fft);
    assert_int_equal(v2v_mem_held(), held);
    v2v_fft2_destroy(&fft);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(header_example_gives_the_image_times_its_size),
        cmocka_unit_test(plan_short_of_memory_holds_nothing),
    };
    return cmocka_run_group_tests_name("fft.example", tests, NULL, NULL);
}
