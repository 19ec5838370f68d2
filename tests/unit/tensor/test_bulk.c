/* Long arrays cleared and copied: as far as they go and no further, from sizes of one thread to
 * sizes of many. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/bulk.h"

enum { SHORT = 1000, LONG = (1 << 20) + 7, GUARD = 3 };

static void check(int64_t count)
{
    float *from = v2v_mem_alloc("test", count + GUARD, sizeof *from);
    float *to = v2v_mem_alloc("test", count + GUARD, sizeof *to);
    assert_non_null(from);
    assert_non_null(to);
    for (int64_t i = 0; i < count + GUARD; i++) {
        from[i] = (float)(i % 1000 + 1);
        to[i] = -1.0f;
    }
    v2v_bulk_copy(to, from, count);
    v2v_bulk_clear(from, count);
    for (int64_t i = 0; i < count + GUARD; i++) {
        float drawn = (float)(i % 1000 + 1);
        assert_true(to[i] == (i < count ? drawn : -1.0f));
        assert_true(from[i] == (i < count ? 0.0f : drawn));
    }
    v2v_mem_free(to);
    v2v_mem_free(from);
}

static void arrays_are_copied_and_cleared_to_their_end(void **state)
{
    (void)state;
    check(0);
    check(SHORT);
    check(LONG);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(arrays_are_copied_and_cleared_to_their_end)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
