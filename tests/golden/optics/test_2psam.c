/* The settings that ship for 2pSAM against the set that they were fitted to. */
#include "support.h"
#include "v2v3d/optics/psf.h"
#include "v2v3d/optics/psf_fit.h"

static void settings_of_2psam_give_the_public_set(void **state)
{
    struct v2v_config config;
    struct v2v_psf_file given, model;
    struct v2v_psf_likeness likeness;
    (void)state;
    if (test_shared("psf/2psam") == NULL) {
        skip();
    }
    v2v_config_defaults(&config);
    assert_ok(v2v_config_load(&config, V2V_CONFIGS "/2psam.yaml"));
    assert_ok(v2v_psf_read(&given, test_shared("psf/2psam"), "", V2V_NORMALIZE_NONE, NULL));
    assert_ok(v2v_psf_simulate(&model, &config.optics));
    assert_int_equal(model.views, 13);
    assert_int_equal(model.slices, 39);
    assert_int_equal(model.height, 128);
    assert_ok(v2v_psf_compare(&likeness, &model, &given));
    for (int64_t v = 0; v < likeness.views; v++) {
        assert_true(likeness.correlation[v] > 0.9999);
        assert_true(likeness.centroid[v] < 0.05);
    }
    v2v_psf_likeness_fini(&likeness);
    v2v_psf_file_fini(&model);
    v2v_psf_file_fini(&given);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(settings_of_2psam_give_the_public_set)};
    return cmocka_run_group_tests_name("golden.2psam", tests, NULL, NULL);
}
