/* All ranks decide alike, though one of them stands on a processor without bf16. */
#include "support.h"

#include "capture.h"
#include "v2v3d/conf/config.h"
#include "v2v3d/nn/precision.h"
#include "v2v3d/op/bf16.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TEXT = 1024 };

/* Before oneDNN is asked for the first time: it remembers. */
static int limit_last_rank(void **state)
{
    (void)state;
    if (v2v_comm_rank(test_world()) == v2v_comm_size(test_world()) - 1) {
        assert_int_equal(setenv("DNNL_MAX_CPU_ISA", "AVX2", 1), 0);
        assert_int_equal(v2v_op_bf16(), V2V_BF16_NONE);
    }
    return 0;
}

static enum v2v_status agree_quietly(int *precision, int wanted, char *text)
{
    test_capture_begin();
    enum v2v_status rc = v2v_precision_agree(precision, wanted, test_world());
    test_capture_end(text, TEXT);
    return rc;
}

static void bf16_is_float32_on_all_ranks_where_one_has_no_instructions(void **state)
{
    char text[TEXT];
    int precision = -1;
    (void)state;
    assert_ok(agree_quietly(&precision, V2V_PRECISION_BF16, text));
    assert_int_equal(precision, V2V_PRECISION_F32);
    if (v2v_comm_rank(test_world()) == 0) {
        assert_non_null(strstr(text, "warning"));
        assert_non_null(strstr(text, "precision bf16: the processors of "));
    } else {
        assert_string_equal(text, "");
    }
}

static void bf16_always_is_refused_on_all_ranks_where_one_cannot_emulate_it(void **state)
{
    char text[TEXT], wanted[64];
    int precision = -1;
    int64_t cannot = v2v_op_bf16() == V2V_BF16_NONE; /* on some machines nobody can */
    (void)state;
    v2v_par_sum_i64(test_world(), &cannot, 1);
    assert_true(cannot > 0);
    assert_int_equal(agree_quietly(&precision, V2V_PRECISION_BF16_ALWAYS, text), V2V_E_CONFIG);
    snprintf(wanted, sizeof wanted, "bf16-always: the processors of %d of ", (int)cannot);
    assert_non_null(strstr(v2v_status_message(), wanted));
}

static void float32_asks_for_nothing(void **state)
{
    char text[TEXT];
    int precision = -1;
    (void)state;
    assert_ok(agree_quietly(&precision, V2V_PRECISION_F32, text));
    assert_int_equal(precision, V2V_PRECISION_F32);
    assert_string_equal(text, "");
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(bf16_is_float32_on_all_ranks_where_one_has_no_instructions,
                               limit_last_rank),
        cmocka_unit_test(bf16_always_is_refused_on_all_ranks_where_one_cannot_emulate_it),
        cmocka_unit_test(float32_asks_for_nothing),
    };
    return test_mpi_main(tests, argc, argv);
}
