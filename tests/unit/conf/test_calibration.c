#include "support.h"

#include "v2v3d/conf/calibration.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *write_text(const char *text)
{
    static char path[600];
    snprintf(path, sizeof path, "%s/cal.yaml", test_folder(NULL));
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_true(fputs(text, file) >= 0);
    assert_int_equal(fclose(file), 0);
    return path;
}

/* To be freed. */
static char *print_text(const struct v2v_calibration *calibration)
{
    char *text = NULL;
    size_t bytes = 0;
    FILE *stream = open_memstream(&text, &bytes);
    assert_non_null(stream);
    v2v_calibration_print(calibration, stream);
    assert_int_equal(fclose(stream), 0);
    return text;
}

/* Numbers that six digits hold. */
static void what_is_printed_is_read_again(void **state)
{
    (void)state;
    struct v2v_calibration out, in;
    assert_ok(v2v_calibration_init(&out, 3, 303, 305));
    for (int v = 0; v < 3; v++) {
        struct v2v_view_calibration *view = &out.view[v];
        out.number[v] = 2 * v;
        view->gain = 0.75 + v;
        for (int axis = 0; axis < 2; axis++) {
            view->shift[axis] = -1.25 + v + 0.5 * axis;
            view->slope[axis] = 0.375 * v - axis;
        }
        for (int k = 0; k < V2V_FIELD_TERMS; k++) {
            view->distortion_y[k] = 0.5 * k - v;
            view->distortion_x[k] = 0.125 * k + v;
            view->shading[k] = 0.0625 * k - 0.25 * v;
        }
    }
    char *text = print_text(&out);
    assert_ok(v2v_calibration_read(&in, write_text(text)));
    assert_int_equal(in.views, 3);
    assert_int_equal(in.height, 303);
    assert_int_equal(in.width, 305);
    assert_memory_equal(in.view, out.view, 3 * sizeof *in.view);
    assert_memory_equal(in.number, out.number, 3 * sizeof *in.number);
    assert_true(v2v_calibration_is_within_bounds(&in));
    in.view[2].shading[V2V_FIELD_TERMS - 1] = 8.5;
    assert_false(v2v_calibration_is_within_bounds(&in));
    in.view[2].shading[V2V_FIELD_TERMS - 1] = NAN;
    assert_false(v2v_calibration_is_within_bounds(&in));
    free(text);
    v2v_calibration_fini(&in);
    v2v_calibration_fini(&out);
}

static void what_is_left_out_is_as_the_psfs_say(void **state)
{
    (void)state;
    static const struct v2v_view_calibration nothing = {.gain = 1.0};
    struct v2v_calibration in;
    assert_ok(v2v_calibration_read(
        &in, write_text("height: 8\nwidth: 9\nviews:\n  - shift: [1, -2]\n  - gain: 1\n")));
    assert_int_equal(in.views, 2);
    assert_true(in.view[0].gain == 1.0 && in.view[0].shift[0] == 1.0 &&
                in.view[0].shift[1] == -2.0);
    assert_memory_equal(&in.view[1], &nothing, sizeof nothing);
    assert_true(in.number[0] == 0 && in.number[1] == 1);
    v2v_calibration_fini(&in);
}

/* Of views 0, 1, 4 and 5, as gains of 1, 2, 5 and 6 say. */
static void read_four(struct v2v_calibration *c)
{
    assert_ok(
        v2v_calibration_read(c, write_text("height: 8\nwidth: 9\nviews:\n  - gain: 1\n  - gain: 2\n"
                                           "  - gain: 5\n    view: 4\n  - gain: 6\n")));
}

static void views_are_those_that_are_used(void **state)
{
    (void)state;
    struct v2v_calibration c;
    read_four(&c);
    assert_ok(v2v_calibration_leave(&c, "2, 3", "cal.yaml"));
    assert_int_equal(c.views, 4);
    assert_int_equal(c.number[3], 5);
    v2v_calibration_fini(&c);
    read_four(&c);
    assert_ok(v2v_calibration_leave(&c, "4,3,2,0", "cal.yaml"));
    assert_int_equal(c.views, 2);
    assert_true(c.number[0] == 1 && c.view[0].gain == 2.0);
    assert_true(c.number[1] == 5 && c.view[1].gain == 6.0);
    v2v_calibration_fini(&c);
    static const struct {
        const char *without, *says;
    } wrong[] = {{"", "cal.yaml: has a view 4, but no view 2"},
                 {"2", "no view 3"},
                 {"3, 0", "no view 2"},
                 {"5,4,1,0", "has no view but those of --without-views 5,4,1,0"},
                 {"2,", "is to be numbers, as 3, 7, not '2,'"}};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        read_four(&c);
        assert_int_equal(v2v_calibration_leave(&c, wrong[i].without, "cal.yaml"), V2V_E_CONFIG);
        assert_non_null(strstr(v2v_status_message(), wrong[i].says));
        v2v_calibration_fini(&c);
    }
}

static void fields_that_are_nothing_are_not_printed(void **state)
{
    (void)state;
    struct v2v_calibration c;
    assert_ok(v2v_calibration_init(&c, 1, 8, 9));
    c.view[0].distortion_x[V2V_FIELD_TERMS - 1] = 0.5;
    char *text = print_text(&c);
    assert_null(strstr(text, "    shading: "));
    assert_null(strstr(text, "    distortion_y: "));
    assert_non_null(strstr(text, "    distortion_x: [0, 0, "));
    free(text);
    v2v_calibration_fini(&c);
}

static void what_is_cut_off_at_a_line_is_refused(void **state)
{
    (void)state;
    struct v2v_calibration c, in;
    assert_ok(v2v_calibration_init(&c, 2, 8, 9));
    c.view[1].shading[0] = 0.5;
    char *text = print_text(&c);
    assert_ok(v2v_calibration_read(&in, write_text(text)));
    v2v_calibration_fini(&in);
    for (size_t n = strlen(text); n-- > 1;) { /* before and behind every end of a line */
        const int is_end = text[n] == '\n' || text[n - 1] == '\n';
        text[n] = '\0';
        if (is_end && strstr(text, "width") == NULL) {
            assert_int_equal(v2v_calibration_read(&in, write_text(text)), V2V_E_CONFIG);
        }
    }
    free(text);
    v2v_calibration_fini(&c);
}

#define EIGHT "0, 0, 0, 0, 0, 0, 0, 0, "

static void a_wrong_file_is_refused_by_line_and_key(void **state)
{
    (void)state;
    static const struct {
        const char *text, *says;
    } wrong[] = {
        {"", "no calibration"},
        {"just words\n", "no calibration"},
        {"height: 8\nwidth: 9\n", "no calibration"},
        {"height: 8\nwidth: 9\nviews: []\n", ":3: views wants a list of 1 to 4096"},
        {"height: 8\nwidth: 9\nviews: 3\n", ":3: views wants a list"},
        {"height: 8\nwidth: 9\nviews:\n  - 1\n", ":4: a view wants"},
        {"height: 8\nwidth: 9\nviews:\n  - gain: 1\n    gian: 1\n", ":5: 'gian' is not one"},
        {"height: 8\nwidth: 9\nviews:\n  - gain: 1\n    gain: 1\n", ":5: 'gain' is not one"},
        {"height: 8\nheight: 8\nwidth: 9\nviews:\n  - gain: 1\n", ":2: 'height'"},
        {"depth: 8\n", ":1: 'depth'"},
        {"height: 8\nwidth: 9\nviews:\n  - shift: 1\n", ":4: shift wants a list of 2 numbers"},
        {"height: 8\nwidth: 9\nviews:\n  - shift: [1]\n", ":4: shift wants 2 numbers"},
        {"height: 8\nwidth: 9\nviews:\n  - shading: [1, 2]\n",
         ":4: shading wants 65 numbers; files of earlier versions"},
        {"height: 8\nwidth: 9\nviews:\n  - view: 2\n  - view: 2\n", ":5: view: 2 is outside [3, "},
        {"height: 8\nwidth: 9\nviews:\n  - view: -1\n", ":4: view: -1 is outside [0, "},
        {"height: 8\nwidth: 9\nviews:\n  - view: [1]\n", ":4: view: '' is no"},
        {"height: 8\nwidth: 9\nviews:\n  - gain: [1]\n", ":4: gain wants 1 number"},
        {"height: 8\nwidth: 9\nviews:\n  - shift: [1, 65]\n", ":4: shift"},
        {"height: 8\nwidth: 9\nviews:\n  - shift: [1, .nan]\n", ":4: shift"},
        {"height: 8\nwidth: 9\nviews:\n  - shift: [1, [2]]\n", ":4: shift"},
        {"height: 8\nwidth: 9\nviews:\n  - gain: 0\n", ":4: gain"},
        {"height: 8\nwidth: 9\nviews:\n  - shading: [" EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT EIGHT
             EIGHT "8.5]\n",
         ":4: shading: 8.5 is outside"},
        {"height: 0\nwidth: 9\nviews:\n  - gain: 1\n", ":1: a side of the frame"},
        {"height: 8\nwidth: [9\n", "cal.yaml:"},
        {"height: 8.5\nwidth: 9\nviews:\n  - gain: 1\n", ":1: a side of the frame: '8.5' is no"},
        {"height: [8]\nwidth: 9\nviews:\n  - gain: 1\n", ":1: a side of the frame"},
        {"height: 8\nwidth: 9\nviews:\n  - gain: 1\n---\nheight: 8\n",
         ":5: only one YAML document"},
        {"height: 8\nwidth: 9\nviews:\n  - gain: 1\n---\n[\n", "cal.yaml:"},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        struct v2v_calibration in;
        const enum v2v_status rc = v2v_calibration_read(&in, write_text(wrong[i].text));
        if (rc != V2V_E_CONFIG || strstr(v2v_status_message(), wrong[i].says) == NULL ||
            strstr(v2v_status_message(), "cal.yaml") == NULL) {
            fail_msg("case %d: %d, %s", (int)i, (int)rc, v2v_status_message());
        }
        assert_null(in.view);
    }
}

static void frames_of_another_size_have_other_fields(void **state)
{
    (void)state;
    struct v2v_calibration c;
    assert_ok(v2v_calibration_init(&c, 2, 64, 48));
    assert_false(v2v_calibration_has_distortion(&c));
    assert_ok(v2v_calibration_check(&c, 2, 64, 48, "r.h5"));
    assert_ok(v2v_calibration_check(&c, 2, 32, 32, "r.h5"));
    assert_int_equal(v2v_calibration_check(&c, 3, 64, 48, "r.h5"), V2V_E_INPUT);
    c.view[1].shading[4] = 0.1;
    assert_false(v2v_calibration_has_distortion(&c));
    assert_ok(v2v_calibration_check(&c, 2, 64, 48, "r.h5"));
    assert_int_equal(v2v_calibration_check(&c, 2, 64, 32, "r.h5"), V2V_E_INPUT);
    assert_int_equal(v2v_calibration_check(&c, 2, 32, 48, "r.h5"), V2V_E_INPUT);
    assert_int_equal(v2v_calibration_check(&c, 2, 32, 32, "r.h5"), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "r.h5: 2 views of 32 x 32"));
    c.view[0].distortion_x[0] = -0.1;
    assert_true(v2v_calibration_has_distortion(&c));
    v2v_calibration_fini(&c);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_printed_is_read_again),
        cmocka_unit_test(what_is_left_out_is_as_the_psfs_say),
        cmocka_unit_test(views_are_those_that_are_used),
        cmocka_unit_test(fields_that_are_nothing_are_not_printed),
        cmocka_unit_test(what_is_cut_off_at_a_line_is_refused),
        cmocka_unit_test(a_wrong_file_is_refused_by_line_and_key),
        cmocka_unit_test(frames_of_another_size_have_other_fields),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
