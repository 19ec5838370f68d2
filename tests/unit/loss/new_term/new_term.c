/* What a new term takes: its row, which CMakeLists.txt adds to conf/loss_terms.h, and its function,
 * which is here. */
#include "support.h"

#include "loss/terms.h"
#include "train/run_folder.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/loss/loss.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { VIEWS = 2, SLICES = 3, SIDE = 8, VOXELS = SLICES * SIDE * SIDE };

/* Mean of projection - view. */
double v2v_term_bias(const struct v2v_term_view *view, float *gradient, const float *difference,
                     double weight)
{
    double sum = 0.0;
    for (int64_t i = 0; i < view->ny * view->nx; i++) {
        sum += (double)difference[i];
        gradient[i] += (float)(weight / view->compared);
    }
    return sum / view->compared;
}

/* Sum of all voxels of the mean volume. */
double v2v_term_light(const struct v2v_term_volume *volume, float *gradient, const float *own,
                      const float *other, double weight)
{
    double sum = 0.0;
    for (int64_t i = 0; i < volume->width; i++) {
        sum += 0.5 * ((double)own[i] + (double)other[i]);
        gradient[i] += (float)(weight * volume->share);
    }
    return volume->share * sum;
}

/* Set or found under its key, printed, and taken back. */
static void a_row_is_a_key_of_the_configuration(void **state)
{
    (void)state;
    struct v2v_config config;
    char *text = NULL;
    size_t bytes = 0;
    v2v_config_defaults(&config);
    assert_int_equal(config.loss.weight[V2V_LOSS_LIGHT].mode, V2V_NUMBER_AUTO);
    assert_ok(v2v_config_set(&config, "loss.light=3"));
    assert_ok(v2v_config_set(&config, "loss.bias=none"));
    FILE *stream = open_memstream(&text, &bytes);
    assert_non_null(stream);
    v2v_config_print(&config, stream, NULL, 1);
    assert_int_equal(fclose(stream), 0);
    assert_non_null(strstr(text, "  light: 3"));
    assert_non_null(strstr(text, "weight of all light (auto, none or 0 to "));
    assert_non_null(strstr(text, "  bias: none"));
    free(text);
}

static void a_row_has_weights_by_profile(void **state)
{
    (void)state;
    struct v2v_config config;
    double weights[V2V_LOSS_TERMS];
    v2v_config_defaults(&config);
    v2v_loss_weights(weights, &config.loss);
    assert_true(weights[V2V_LOSS_LIGHT] == 0.5 && weights[V2V_LOSS_BIAS] == 0.0);
    config.loss.profile = V2V_LOSS_PAPER;
    v2v_loss_weights(weights, &config.loss);
    assert_true(weights[V2V_LOSS_LIGHT] == 0.0 && weights[V2V_LOSS_BIAS] == 0.25);
    assert_true(weights[V2V_LOSS_FFT] == 0.1); /* the rows around it keep theirs */
}

/* A PSF of one tap: a view of a constant volume is SLICES times it. */
static void a_row_is_evaluated(void **state)
{
    (void)state;
    static const int32_t view[] = {1};
    static float views[VIEWS * SIDE * SIDE], volume[VOXELS], dvolume[VOXELS];
    float tap[VIEWS * SLICES] = {1.0f, 1.0f, 1.0f, 1.0f, 1.0f, 1.0f};
    float *const dvolumes[] = {dvolume};
    const float *const volumes[] = {volume};
    const struct v2v_psf_file psf = {
        .views = VIEWS, .slices = SLICES, .height = 1, .width = 1, .data = tap};
    struct v2v_config config;
    struct v2v_loss *loss = NULL;
    double terms[V2V_LOSS_TERMS];
    v2v_config_defaults(&config);
    for (int t = 0; t < V2V_LOSS_TOTAL; t++) {
        int is_new = t == V2V_LOSS_LIGHT || t == V2V_LOSS_BIAS;
        config.loss.weight[t] = (struct v2v_number){V2V_NUMBER_GIVEN, is_new ? 2.0 : 0.0};
    }
    for (int i = 0; i < VOXELS; i++) {
        volume[i] = 0.5f;
    }
    struct v2v_loss_setup setup = {.settings = &config.loss,
                                   .psf = &psf,
                                   .height = SIDE,
                                   .width = SIDE,
                                   .window = {0, SIDE, 0, SIDE},
                                   .outputs = 1,
                                   .held_out = {{view, 1}}};
    assert_ok(v2v_projector_create(&setup.projector, &psf, SIDE, SIDE, V2V_SPLIT_SLABS, NULL));
    assert_ok(v2v_loss_create(&loss, &setup));
    v2v_loss_evaluate(loss, terms, 1, dvolumes, volumes, views);
    /* a transform of 64 pixels errs by some 2^-24 */
    assert_true(terms[V2V_LOSS_BIAS] > 1.5 - 1e-6 && terms[V2V_LOSS_BIAS] < 1.5 + 1e-6);
    assert_true(terms[V2V_LOSS_LIGHT] == 0.5 * VOXELS);
    assert_true(terms[V2V_LOSS_TOTAL] == 2.0 * terms[V2V_LOSS_BIAS] + 2.0 * terms[V2V_LOSS_LIGHT]);
    for (int i = 0; i < VOXELS; i++) {
        float slope = 2.0f + 2.0f / (SIDE * SIDE);
        assert_true(dvolume[i] > slope - 1e-6f && dvolume[i] < slope + 1e-6f);
    }
    v2v_loss_destroy(&loss);
    v2v_projector_destroy(&setup.projector);
    assert_int_equal(v2v_mem_held(), 0);
}

static void a_row_is_in_the_log(void **state)
{
    (void)state;
    char *text = NULL;
    size_t bytes = 0;
    struct v2v_step_result result = {.terms = {[V2V_LOSS_BIAS] = 0.25, [V2V_LOSS_LIGHT] = 7.0}};
    struct v2v_par_time began = v2v_par_time_now();
    struct v2v_run_folder folder = {.log = open_memstream(&text, &bytes)};
    assert_non_null(folder.log);
    assert_ok(v2v_run_folder_log(&folder, 1, &result, &began));
    assert_int_equal(fclose(folder.log), 0);
    assert_non_null(strstr(text, "\"bias\": 0.25, \"mse\": 0"));
    assert_non_null(strstr(text, "\"light\": 7, \"pos\": 0"));
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_row_is_a_key_of_the_configuration),
        cmocka_unit_test(a_row_has_weights_by_profile),
        cmocka_unit_test(a_row_is_evaluated),
        cmocka_unit_test(a_row_is_in_the_log),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
