#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/fields.h"

#include <stdio.h>
#include <string.h>

/** The example of tensor/fields.h. */
static enum v2v_status header_example(void)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_fields fields = {0};
    int64_t weight = 0, bias = 0;
    float *arena = NULL;
    V2V_TRY(v2v_fields_add(&fields, &weight, "conv.weight", 4, (int64_t[]){8, 4, 3, 3}));
    V2V_TRY(v2v_fields_add(&fields, &bias, "conv.bias", 1, (int64_t[]){8}));
    V2V_TRY(V2V_ALLOC(arena, "weights", fields.total));
    float *w = arena + fields.item[weight].offset;
    w[0] = 1.0f;
done:
    v2v_mem_free(arena);
    v2v_fields_fini(&fields);
    return rc;
}

static void header_example_works(void **state)
{
    (void)state;
    assert_ok(header_example());
}

static void fields_lie_in_order_apart_and_aligned(void **state)
{
    (void)state;
    enum { FIELDS = 200 }; /* the table grows twice */
    struct v2v_fields fields = {0};
    int64_t end = 0;
    for (int64_t i = 0; i < FIELDS; i++) {
        char name[V2V_FIELDS_NAME_BYTES];
        int64_t index = -1;
        snprintf(name, sizeof name, "layer%lld.weight", (long long)i);
        assert_ok(v2v_fields_add(&fields, &index, name, 2, (int64_t[]){i + 1, 3}));
        assert_int_equal(index, i);
    }
    assert_int_equal(fields.count, FIELDS);
    for (int64_t i = 0; i < FIELDS; i++) {
        const struct v2v_fields_item *field = &fields.item[i];
        assert_int_equal(field->offset % 16, 0);
        assert_true(field->offset >= end && field->offset < end + 16);
        assert_int_equal(field->count, 3 * (i + 1));
        assert_int_equal(field->rank, 2);
        assert_int_equal(field->shape[0], i + 1);
        assert_int_equal(field->shape[1], 3);
        end = field->offset + field->count;
    }
    assert_true(fields.total >= end && fields.total < end + 16 && fields.total % 16 == 0);
    v2v_fields_fini(&fields);
    assert_int_equal(v2v_mem_held(), 0);
}

static void find_knows_the_whole_name_only(void **state)
{
    (void)state;
    struct v2v_fields fields = {0};
    assert_null(v2v_fields_find(&fields, "a"));
    assert_ok(v2v_fields_add(&fields, NULL, "ab", 1, (int64_t[]){3}));
    assert_ok(v2v_fields_add(&fields, NULL, "a", 1, (int64_t[]){5}));
    assert_int_equal(v2v_fields_find(&fields, "a")->count, 5);
    assert_int_equal(v2v_fields_find(&fields, "ab")->count, 3);
    assert_null(v2v_fields_find(&fields, "abc"));
    assert_null(v2v_fields_find(&fields, ""));
    v2v_fields_fini(&fields);
    v2v_fields_fini(&fields);
}

static void impossible_fields_are_refused_and_change_nothing(void **state)
{
    (void)state;
    static const char longest[] = "123456789.123456789.123456789.123456789.123456789.123456789.123";
    _Static_assert(sizeof longest == V2V_FIELDS_NAME_BYTES, "the longest name that fits");
    static const int64_t huge = (int64_t)1 << 32;
    struct v2v_fields fields = {0};
    assert_ok(v2v_fields_add(&fields, NULL, longest, 1, (int64_t[]){16}));
    assert_int_equal(
        v2v_fields_add(&fields, NULL,
                       "123456789.123456789.123456789.123456789.123456789.123456789.1234", 1,
                       (int64_t[]){16}),
        V2V_E_INTERNAL);
    assert_int_equal(v2v_fields_add(&fields, NULL, longest, 1, (int64_t[]){16}), V2V_E_INTERNAL);
    assert_non_null(strstr(v2v_status_message(), longest));
    assert_int_equal(v2v_fields_add(&fields, NULL, "", 1, (int64_t[]){16}), V2V_E_INTERNAL);
    assert_int_equal(v2v_fields_add(&fields, NULL, "x", 0, (int64_t[]){16}), V2V_E_INTERNAL);
    assert_int_equal(v2v_fields_add(&fields, NULL, "x", 5, (int64_t[]){1, 1, 1, 1, 1}),
                     V2V_E_INTERNAL);
    assert_int_equal(v2v_fields_add(&fields, NULL, "x", 2, (int64_t[]){3, 0}), V2V_E_INTERNAL);
    assert_int_equal(v2v_fields_add(&fields, NULL, "x", 2, (int64_t[]){-3, -1}), V2V_E_INTERNAL);
    assert_int_equal(v2v_fields_add(&fields, NULL, "x", 2, (int64_t[]){huge, huge}),
                     V2V_E_INTERNAL);
    assert_int_equal(v2v_fields_add(&fields, NULL, "x", 1, (int64_t[]){INT64_MAX}), V2V_E_INTERNAL);
    assert_int_equal(fields.count, 1);
    assert_int_equal(fields.total, 16);
    v2v_fields_fini(&fields);
}

static void short_memory_fails_and_leaves_a_usable_table(void **state)
{
    (void)state;
    struct v2v_fields fields = {0};
    v2v_mem_set_limit(16);
    assert_int_equal(v2v_fields_add(&fields, NULL, "x", 1, (int64_t[]){16}), V2V_E_MEMORY);
    v2v_mem_set_limit(0);
    assert_int_equal(fields.count, 0);
    assert_ok(v2v_fields_add(&fields, NULL, "x", 1, (int64_t[]){16}));
    v2v_fields_fini(&fields);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(header_example_works),
        cmocka_unit_test(fields_lie_in_order_apart_and_aligned),
        cmocka_unit_test(find_knows_the_whole_name_only),
        cmocka_unit_test(impossible_fields_are_refused_and_change_nothing),
        cmocka_unit_test(short_memory_fails_and_leaves_a_usable_table),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
