#include "support.h"

#include "v2v3d/base/clock.h"
#include "v2v3d/base/text.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

static void whole_numbers_are_strict(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        int good;
        int64_t value;
    } cases[] = {
        {"0", 1, 0},
        {"-7", 1, -7},
        {"+7", 1, 7},
        {"007", 1, 7},
        {"100", 1, 100},
        {"-100", 1, -100},
        {"101", 0, 0},
        {"-101", 0, 0},
        {"", 0, 0},
        {"-", 0, 0},
        {" 7", 0, 0},
        {"7 ", 0, 0},
        {"7.0", 0, 0},
        {"1e1", 0, 0},
        {"0x10", 0, 0},
        {"+-7", 0, 0},
        {"- 7", 0, 0},
        {"seven", 0, 0},
        {"99999999999999999999", 0, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        int64_t value = 12345;
        enum v2v_status rc =
            v2v_text_to_i64(&value, cases[i].text, -100, 100, "--frames", V2V_E_USAGE);
        assert_int_equal(rc, cases[i].good ? V2V_OK : V2V_E_USAGE);
        assert_int_equal(value, cases[i].good ? cases[i].value : 12345);
        if (!cases[i].good) {
            assert_int_equal(strncmp(v2v_status_message(), "--frames: ", 10), 0);
        }
    }
    int64_t extreme = 0;
    assert_ok(
        v2v_text_to_i64(&extreme, "-9223372036854775808", INT64_MIN, INT64_MAX, "x", V2V_E_USAGE));
    assert_true(extreme == INT64_MIN);
}

static void numbers_are_strict(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        int good;
        double value;
    } cases[] = {
        {"0", 1, 0.0},  {"-.5", 1, -0.5},   {"5.", 1, 5.0},  {"1e2", 1, 100.0}, {"1E-2", 1, 0.01},
        {"+3", 1, 3.0}, {"1e-400", 1, 0.0}, {"1e309", 0, 0}, {"-1e309", 0, 0},  {"inf", 0, 0},
        {"nan", 0, 0},  {"0x1", 0, 0},      {"1,5", 0, 0},   {"", 0, 0},        {".", 0, 0},
        {"e5", 0, 0},   {" 1", 0, 0},       {"1 ", 0, 0},    {"1e", 0, 0},      {"--1", 0, 0},
        {"1001", 0, 0}, {"-1001", 0, 0},    {"1.2.3", 0, 0},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        double value = 12345.0;
        enum v2v_status rc =
            v2v_text_to_f64(&value, cases[i].text, -1000.0, 1000.0, "--noise", V2V_E_CONFIG);
        assert_int_equal(rc, cases[i].good ? V2V_OK : V2V_E_CONFIG);
        assert_true(value == (cases[i].good ? cases[i].value : 12345.0));
        if (!cases[i].good) {
            assert_int_equal(strncmp(v2v_status_message(), "--noise: ", 9), 0);
        }
    }
    double most = 0.0;
    assert_ok(
        v2v_text_to_f64(&most, "1.7976931348623157e308", -DBL_MAX, DBL_MAX, "x", V2V_E_INPUT));
    assert_true(most == DBL_MAX);
}

static void nearest_word_is_the_one_with_the_fewest_edits(void **state)
{
    (void)state;
    static const char *const word[] = {"steps", "batch", "crop", "learning_rate"};
    assert_string_equal(v2v_text_nearest("step", word, 4), "steps");
    assert_string_equal(v2v_text_nearest("setps", word, 4), "steps");
    assert_string_equal(v2v_text_nearest("learningrate", word, 4), "learning_rate");
    assert_string_equal(v2v_text_nearest("crop", word, 4), "crop");
    assert_null(v2v_text_nearest("zzzzz", word, 4));
    assert_null(v2v_text_nearest("", word, 4));
    assert_null(v2v_text_nearest("steps", word, 0));
    char lengthy[300];
    memset(lengthy, 's', sizeof lengthy - 1);
    lengthy[sizeof lengthy - 1] = '\0';
    assert_null(v2v_text_nearest(lengthy, word, 4));
}

static void swapped_letters_count_as_one_edit(void **state)
{
    (void)state;
    /* "ab" for "ba" is one edit, of which a word of two letters allows one; two substitutions
     * would be too far. */
    static const char *const word[] = {"ab"};
    assert_string_equal(v2v_text_nearest("ba", word, 1), "ab");
    assert_null(v2v_text_nearest("xy", word, 1));
}

static void format_refuses_what_does_not_fit(void **state)
{
    (void)state;
    char text[8];
    assert_ok(v2v_text_format(text, sizeof text, "%s/%d", "abc", 123));
    assert_string_equal(text, "abc/123");
    assert_int_equal(v2v_text_format(text, sizeof text, "%s/%d", "abc", 1234), V2V_E_INPUT);
}

static void a_text_is_what_was_printed_and_an_earlier_failure_stays(void **state)
{
    (void)state;
    FILE *stream = NULL;
    char *text = NULL;
    size_t bytes = 1;
    assert_ok(v2v_text_open(&stream, &text, &bytes, "nothing"));
    assert_ok(v2v_text_close(V2V_OK, stream, &text, "nothing"));
    assert_string_equal(text, "");
    assert_int_equal(bytes, 0);
    free(text);
    assert_ok(v2v_text_open(&stream, &text, &bytes, "a line"));
    for (int i = 0; i < 10000; i++) {
        assert_true(fprintf(stream, "%04d ", i) == 5);
    }
    assert_int_equal(v2v_text_close(V2V_E_IO, stream, &text, "a line"), V2V_E_IO);
    assert_int_equal(bytes, 50000);
    assert_int_equal(strlen(text), bytes);
    assert_string_equal(text + bytes - 5, "9999 ");
    free(text);
}

static void durations_are_strict(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        double seconds;
    } cases[] = {
        {"90", 90},     {"90s", 90},  {"20m", 1200},     {"3h", 10800},      {"1h30m", 5400},
        {"1h1s", 3601}, {"0", 0},     {"1h30m5s", 5405}, {"", -1},           {"h", -1},
        {"30m1h", -1},  {"1h1h", -1}, {"1h30", -1},      {"-5", -1},         {"5x", -1},
        {"1.5h", -1},   {" 5", -1},   {"5 m", -1},       {"9999999999", -1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        double seconds = v2v_clock_parse_duration(cases[i].text);
        if (seconds != cases[i].seconds) {
            fail_msg("'%s' gave %g", cases[i].text, seconds);
        }
    }
}

static void clock_does_not_go_back_and_time_is_iso8601(void **state)
{
    (void)state;
    char text[32], little[4] = "abc";
    double before = v2v_clock_now();
    for (int i = 0; i < 1000; i++) {
        double now = v2v_clock_now();
        assert_true(now >= before);
        before = now;
    }
    v2v_clock_iso8601(text, sizeof text);
    assert_int_equal(strlen(text), 20);
    assert_true(text[4] == '-' && text[10] == 'T' && text[13] == ':' && text[19] == 'Z');
    v2v_clock_iso8601(little, sizeof little);
    assert_string_equal(little, "");
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(whole_numbers_are_strict),
        cmocka_unit_test(numbers_are_strict),
        cmocka_unit_test(nearest_word_is_the_one_with_the_fewest_edits),
        cmocka_unit_test(swapped_letters_count_as_one_edit),
        cmocka_unit_test(format_refuses_what_does_not_fit),
        cmocka_unit_test(a_text_is_what_was_printed_and_an_earlier_failure_stays),
        cmocka_unit_test(durations_are_strict),
        cmocka_unit_test(clock_does_not_go_back_and_time_is_iso8601),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
