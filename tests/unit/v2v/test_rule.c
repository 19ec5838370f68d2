/* Initial weights. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/nn/rule.h"
#include "v2v3d/v2v/schema.h"

#include <math.h>
#include <string.h>

static const struct v2v_model_spec spec = {.views = 5,
                                           .slices = 4,
                                           .width = 16,
                                           .features = 4,
                                           .branches = V2V_BRANCH_BOTH,
                                           .volume_scale = 1.0};

struct filled {
    struct v2v_fields fields;
    float *weights;
};

static struct filled fill(int rule, int64_t seed)
{
    struct filled filled = {0};
    assert_ok(v2v_model_schema(&filled.fields, &spec));
    assert_ok(V2V_ALLOC(filled.weights, "test", filled.fields.total));
    assert_ok(v2v_rule_weights(&filled.fields, filled.weights, rule, seed));
    return filled;
}

static void release(struct filled *filled)
{
    v2v_mem_free(filled->weights);
    v2v_fields_fini(&filled->fields);
    assert_int_equal(v2v_mem_held(), 0);
}

static const float *values(const struct filled *filled, const char *name)
{
    const struct v2v_fields_item *field = v2v_fields_find(&filled->fields, name);
    assert_non_null(field);
    return filled->weights + field->offset;
}

/* First three values for seed 7, by a program of a few lines over the formulas of REFERENCE.md 9,
 * written in another language. */
static void hash_rule_gives_the_published_numbers(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        float value[3];
    } expected[] = {
        {"feat_extract.conv1.0.weight", {-0.646250725f, 0.357978404f, -0.636681855f}},
        {"feat_extract.conv1.0.bias", {-0.00524670025f, 0.00810177717f, -0.00293577788f}},
        {"unet2.conv_final.4.bias", {0.00129930372f, -0.00867704768f, 0.00987409428f}},
    };
    struct filled filled = fill(V2V_RULE_HASH, 7);
    for (size_t i = 0; i < sizeof expected / sizeof *expected; i++) {
        assert_memory_equal(values(&filled, expected[i].name), expected[i].value,
                            sizeof expected[i].value);
    }
    release(&filled);
}

static void hash_rule_gives_the_golden_views(void **state)
{
    (void)state;
    const char *path = test_shared("golden/network.h5");
    if (path == NULL) {
        skip();
    }
    int64_t count = 0;
    double *lfi = test_h5_read(path, "lfi", &count);
    uint64_t seed = (uint64_t)test_h5_attribute(path, "/", "seed");
    assert_int_equal(count, 13 * 64 * 64);
    for (int64_t i = 0; i < count; i++) {
        float sample = (float)(0.2 + 0.2 * v2v_random_rule("lfi", seed, (uint64_t)i));
        assert_true((double)sample == lfi[i]);
    }
    test_release(lfi);
}

/* Every value within the bound; in large fields the mean square is bound^2 / 3 within four standard
 * deviations, bound^2 * sqrt(4 / 45 / count). */
static void check_uniform(const struct filled *filled, const struct v2v_fields_item *field,
                          double bound)
{
    const float *x = filled->weights + field->offset;
    double square = 0.0;
    for (int64_t i = 0; i < field->count; i++) {
        assert_true(fabs((double)x[i]) <= bound * (1.0 + 6e-8));
        square += (double)x[i] * x[i] / (double)field->count;
    }
    if (field->count > 100) {
        double spread = bound * bound * sqrt(4.0 / 45.0 / (double)field->count);
        assert_true(fabs(square - bound * bound / 3.0) <= 4.0 * spread);
    }
}

static double fan_in(const struct v2v_fields_item *weight)
{
    return (double)(weight->shape[1] * weight->shape[2] * weight->shape[3]);
}

static void kaiming_rule_is_pytorchs_default(void **state)
{
    (void)state;
    struct filled filled = fill(V2V_RULE_KAIMING, 3);
    for (int64_t i = 0; i < filled.fields.count; i += 2) {
        double bound = 1.0 / sqrt(fan_in(&filled.fields.item[i]));
        check_uniform(&filled, &filled.fields.item[i], bound);
        check_uniform(&filled, &filled.fields.item[i + 1], bound);
    }
    release(&filled);
}

static void he_rule_keeps_the_signals_size_and_starts_almost_empty(void **state)
{
    (void)state;
    struct filled filled = fill(V2V_RULE_HE, 3);
    for (int64_t i = 0; i < filled.fields.count; i += 2) {
        const struct v2v_fields_item *weight = &filled.fields.item[i];
        double bound = sqrt(6.0 / (1.0001 * fan_in(weight)));
        bound *= strstr(weight->name, "conv_final.4") != NULL ? 0.1 : 1.0;
        check_uniform(&filled, weight, bound);
        check_uniform(&filled, &filled.fields.item[i + 1], 0.0);
    }
    release(&filled);
}

static void weights_depend_on_name_and_seed_alone(void **state)
{
    (void)state;
    static const int rule[] = {V2V_RULE_HASH, V2V_RULE_KAIMING, V2V_RULE_HE};
    struct v2v_fields one = {0};
    int64_t shape[4] = {16, 32, 3, 3};
    static float alone[16 * 32 * 9];
    const char *name = "unet2.conv_final.2.weight";
    assert_ok(v2v_fields_add(&one, NULL, name, 4, shape));
    for (int i = 0; i < 3; i++) {
        struct filled filled = fill(rule[i], 11), other = fill(rule[i], 12);
        assert_ok(v2v_rule_weights(&one, alone, rule[i], 11));
        assert_memory_equal(alone, values(&filled, name), sizeof alone);
        assert_true(alone[0] != values(&other, name)[0]);
        v2v_mem_free(other.weights);
        v2v_fields_fini(&other.fields);
        v2v_mem_free(filled.weights);
        v2v_fields_fini(&filled.fields);
    }
    v2v_fields_fini(&one);
}

static void a_bias_without_its_weight_is_refused(void **state)
{
    (void)state;
    struct v2v_fields fields = {0};
    float values_of_bias[16];
    assert_ok(v2v_fields_add(&fields, NULL, "conv.bias", 1, (int64_t[]){4}));
    assert_int_equal(v2v_rule_weights(&fields, values_of_bias, V2V_RULE_HASH, 1), V2V_E_INTERNAL);
    assert_non_null(strstr(v2v_status_message(), "conv.bias"));
    v2v_fields_fini(&fields);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hash_rule_gives_the_published_numbers),
        cmocka_unit_test(hash_rule_gives_the_golden_views),
        cmocka_unit_test(kaiming_rule_is_pytorchs_default),
        cmocka_unit_test(he_rule_keeps_the_signals_size_and_starts_almost_empty),
        cmocka_unit_test(weights_depend_on_name_and_seed_alone),
        cmocka_unit_test(a_bias_without_its_weight_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
