#include "support.h"

#include "h5_files.h"
#include "v2v3d/io/attributes.h"

#include <stdio.h>
#include <string.h>

static char told[512];

static void text(void *context, const char *name, const char *value)
{
    assert_ptr_equal(context, told);
    snprintf(told + strlen(told), sizeof told - strlen(told), "%s='%s' ", name, value);
}

static void number(void *context, const char *name, double value)
{
    assert_ptr_equal(context, told);
    snprintf(told + strlen(told), sizeof told - strlen(told), "%s=%g ", name, value);
}

static void texts_and_numbers_are_told_by_name_and_others_left_out(void **state)
{
    (void)state;
    const struct v2v_attribute_reader reader = {told, text, number};
    char path[512];
    snprintf(path, sizeof path, "%s/a.h5", test_folder(NULL));
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/volume", .rank = 1, .shape = {3}});
    test_h5_text(path, "/", "written", "today");
    test_h5_numbers(path, "/", "gain", (double[]){0.5}, 1);
    test_h5_numbers(path, "/", "several", (double[]){1, 2}, 2);
    test_h5_text(path, "/volume", "axes", "x");
    assert_ok(v2v_attributes_read(path, &reader));
    assert_string_equal(told, "gain=0.5 written='today' ");
    snprintf(path, sizeof path, "%s/none.h5", test_folder(NULL));
    assert_int_equal(v2v_attributes_read(path, &reader), V2V_E_INPUT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(texts_and_numbers_are_told_by_name_and_others_left_out),
    };
    return cmocka_run_group_tests_name("attributes", tests, NULL, NULL);
}
