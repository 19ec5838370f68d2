#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/json.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static char folder[256];

/* What v2v_json_print writes of these items. */
static void print_items(char *line, size_t bytes, const struct v2v_json_item *items, int64_t count)
{
    FILE *stream = tmpfile();
    assert_non_null(stream);
    assert_ok(v2v_json_print(stream, items, count));
    rewind(stream);
    size_t length = fread(line, 1, bytes - 1, stream);
    line[length] = '\0';
    assert_int_equal(fclose(stream), 0);
}

static void an_object_is_one_line_in_the_order_given(void **state)
{
    (void)state;
    const double values[] = {1, 2.5, NAN};
    const struct v2v_json_item items[] = {
        {.name = "step", .number = 12},      {.name = "name", .text = "a \"b\"\n"},
        {.name = "loss", .number = 0.25},    {.name = "list", .values = values, .count = 3},
        {.name = "none", .number = NAN},     {.name = "much", .number = INFINITY},
        {.name = "empty", .values = values},
    };
    char line[512];

    print_items(line, sizeof line, items, sizeof items / sizeof *items);
    assert_string_equal(line, "{\"step\": 12, \"name\": \"a \\\"b\\\"\\n\", \"loss\": 0.25, "
                              "\"list\": [1, 2.5, null], \"none\": null, \"much\": null, "
                              "\"empty\": []}\n");
}

static void every_number_comes_back_bit_for_bit(void **state)
{
    (void)state;
    const double numbers[] = {0,
                              -1,
                              0.1,
                              1.0 / 3,
                              1e-300,
                              1.7976931348623157e308,
                              5e-324,
                              9007199254740992.0,
                              -2.5,
                              1e22,
                              123456789012345.0};
    char line[512];

    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        const struct v2v_json_item item = {.name = "x", .number = numbers[i]};
        print_items(line, sizeof line, &item, 1);
        json_t *object = json_loads(line, 0, NULL);
        assert_non_null(object);
        double found = json_number_value(json_object_get(object, "x"));
        json_decref(object);
        assert_memory_equal(&found, &numbers[i], sizeof found);
    }
}

static void text_that_is_not_utf8_still_gives_json(void **state)
{
    (void)state;
    const struct v2v_json_item item = {.name = "path", .text = "caf\xe9.tif"};
    char line[64];

    print_items(line, sizeof line, &item, 1);
    assert_string_equal(line, "{\"path\": \"caf?.tif\"}\n");
    assert_int_equal(v2v_mem_held(), 0);
}

static void a_stream_that_is_full_fails(void **state)
{
    (void)state;
    const struct v2v_json_item item = {.name = "x", .number = 1};
    FILE *stream = fopen("/dev/full", "we");

    if (stream == NULL) {
        test_skip("no /dev/full here");
    }
    assert_int_equal(v2v_json_print(stream, &item, 1), V2V_E_IO);
    (void)fclose(stream);
}

static const struct cut_case {
    const char *name;
    int64_t step;
    const char *before, *after;
} cut_cases[] = {
    {"later steps go", 2, "{\"step\": 1}\n{\"step\": 2}\n{\"step\": 3}\n",
     "{\"step\": 1}\n{\"step\": 2}\n"},
    {"nothing to cut", 9, "{\"step\": 1}\n", "{\"step\": 1}\n"},
    {"a line without its end that is whole stays", 9, "{\"step\": 1}\n{\"step\": 2}",
     "{\"step\": 1}\n{\"step\": 2}\n"},
    {"a torn last line goes", 9, "{\"step\": 1}\n{\"step\": 2, \"lo", "{\"step\": 1}\n"},
    {"a torn line in between goes", 9, "{\"step\": 1}\n{\"ste\n{\"step\": 2}\n",
     "{\"step\": 1}\n{\"step\": 2}\n"},
    {"all steps are later", 0, "{\"step\": 1}\n{\"step\": 2}\n", ""},
    {"lines before the first step stay", 0, "{\"run\": 1}\n{\"step\": 1}\n", "{\"run\": 1}\n"},
    {"lines after the cut go with it", 1, "{\"step\": 1}\n{\"note\": 1}\n{\"step\": 2}\n",
     "{\"step\": 1}\n"},
    {"lines before the cut stay", 2, "{\"step\": 1}\n{\"note\": 1}\n{\"step\": 2}\n",
     "{\"step\": 1}\n{\"note\": 1}\n{\"step\": 2}\n"},
    {"an empty file stays empty", 3, "", ""},
    {"what is no object goes", 3, "[1]\n\n{\"step\": 3}\n", "{\"step\": 3}\n"},
};

static void lines_after_the_step_are_cut(void **state)
{
    (void)state;
    char path[512], found[256];

    (void)snprintf(path, sizeof path, "%s/metrics.jsonl", folder);
    for (size_t i = 0; i < sizeof cut_cases / sizeof *cut_cases; i++) {
        assert_ok(v2v_file_write_text(path, cut_cases[i].before));
        assert_ok(v2v_json_lines_cut(path, cut_cases[i].step));
        FILE *stream = fopen(path, "re");
        assert_non_null(stream);
        found[fread(found, 1, sizeof found - 1, stream)] = '\0';
        assert_int_equal(fclose(stream), 0);
        if (strcmp(found, cut_cases[i].after) != 0) {
            fail_msg("%s: found %s", cut_cases[i].name, found);
        }
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void a_missing_file_has_nothing_to_cut(void **state)
{
    (void)state;
    char path[512];

    (void)snprintf(path, sizeof path, "%s/absent.jsonl", folder);
    assert_ok(v2v_json_lines_cut(path, 3));
    assert_false(v2v_file_exists(path));
    assert_int_equal(v2v_json_lines_cut(folder, 3), V2V_E_IO);
}

static void lines_are_summed_up_by_member(void **state)
{
    (void)state;
    struct v2v_json_lines lines;
    char path[320];
    (void)snprintf(path, sizeof path, "%s/lines.jsonl", folder);
    assert_ok(v2v_file_write_text(path, "{\"step\": 2, \"loss\": 3.5, \"name\": \"a\"}\n"
                                        "{\"step\": 4, \"loss\": 1.25}\n"
                                        "not an object\n[1]\n"
                                        "{\"step\": 6, \"loss\": 2, \"more\": -1}\n"
                                        "{\"step\": 8, \"lo"));
    assert_ok(v2v_json_lines_read(&lines, path));
    assert_true(lines.lines == 3 && lines.members == 3);
    const struct v2v_json_member *loss = v2v_json_lines_find(&lines, "loss");
    assert_non_null(loss);
    assert_true(loss->last == 2.0 && loss->sum == 6.75 && loss->least == 1.25 &&
                loss->least_at == 4.0);
    assert_true(v2v_json_lines_find(&lines, "step")->last == 6.0);
    assert_true(v2v_json_lines_find(&lines, "more")->least == -1.0);
    assert_null(v2v_json_lines_find(&lines, "name"));
    assert_int_equal(v2v_json_lines_read(&lines, folder), V2V_E_INPUT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_object_is_one_line_in_the_order_given),
        cmocka_unit_test(every_number_comes_back_bit_for_bit),
        cmocka_unit_test(text_that_is_not_utf8_still_gives_json),
        cmocka_unit_test(a_stream_that_is_full_fails),
        cmocka_unit_test(lines_after_the_step_are_cut),
        cmocka_unit_test(a_missing_file_has_nothing_to_cut),
        cmocka_unit_test(lines_are_summed_up_by_member),
    };
    (void)snprintf(folder, sizeof folder, "%s", test_folder(NULL));
    return cmocka_run_group_tests_name("io.json", tests, NULL, NULL);
}
