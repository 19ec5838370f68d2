/* Recordings whose views are pages of a TIFF file. */
#include "a_recording.h"

#include "v2v3d/io/tiff.h"

#include <math.h>

/* A TIFF stack whose page p is p everywhere; page `bad` has a NaN at y 1, x 2 (-1: none has). */
static void make_bad_stack(const struct v2v_tiff_info *info, int64_t bad)
{
    struct v2v_tiff_writer *writer = NULL;
    float page[6];
    use("rec.tif");
    assert_ok(v2v_tiff_create(&writer, path, info));
    for (int64_t p = 0; p < info->pages; p++) {
        for (int i = 0; i < 6; i++) {
            page[i] = i == 5 && p == bad ? NAN : (float)p;
        }
        assert_ok(v2v_tiff_write_page(writer, page));
    }
    assert_ok(v2v_tiff_finish(&writer));
}

static void make_stack(const struct v2v_tiff_info *info)
{
    make_bad_stack(info, -1);
}

static struct v2v_tiff_info stack_info(int64_t slices, int64_t frames)
{
    return (struct v2v_tiff_info){.pages = slices * frames,
                                  .height = 2,
                                  .width = 3,
                                  .channels = 1,
                                  .slices = slices,
                                  .frames = frames,
                                  .bits = 32,
                                  .is_float = 1,
                                  .type_max = 1.0,
                                  .pixel_size_um = 0.5,
                                  .frame_interval_s = 0.25};
}

static void pages_become_views_by_first_view_and_stride(void **state)
{
    (void)state;
    static const struct {
        int64_t pages, views, first, stride, frames;
        int64_t page[2][3]; /* of frame 0 and of the last frame, by view */
    } cases[] = {
        {12, 3, 0, 0, 4, {{0, 1, 2}, {9, 10, 11}}},  {12, 3, 0, 3, 4, {{0, 1, 2}, {9, 10, 11}}},
        {13, 3, 1, 0, 4, {{1, 2, 3}, {10, 11, 12}}}, {12, 3, 0, 1, 10, {{0, 1, 2}, {9, 10, 11}}},
        {11, 3, 0, 1, 9, {{0, 1, 2}, {9, 10, 8}}},   {12, 3, 2, 1, 8, {{2, 3, 4}, {11, 9, 10}}},
        {11, 3, 0, 2, 5, {{0, 1, 2}, {9, 10, 8}}},   {11, 3, 0, 6, 2, {{0, 1, 2}, {6, 7, 8}}},
        {11, 3, 0, 4, 3, {{0, 1, 2}, {8, 9, 10}}},   {3, 3, 0, 0, 1, {{0, 1, 2}, {0, 1, 2}}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const struct v2v_tiff_info stack = stack_info(cases[i].pages, 1);
        const struct v2v_input_settings settings = {
            .views = cases[i].views, .first_view = cases[i].first, .stride = cases[i].stride};
        struct v2v_recording *recording = NULL;
        float views[3][6];
        make_stack(&stack);
        assert_ok(v2v_recording_open(&recording, path, &settings, NULL));
        const struct v2v_recording_info *info = v2v_recording_info(recording);
        assert_int_equal(info->frames, cases[i].frames);
        assert_true(info->views == 3 && info->height == 2 && info->width == 3);
        for (int last = 0; last < 2; last++) {
            assert_ok(v2v_recording_read(recording, views[0], last ? info->frames - 1 : 0));
            for (int v = 0; v < 3; v++) {
                assert_true(views[v][0] == (float)cases[i].page[last][v]);
                assert_true(views[v][5] == (float)cases[i].page[last][v]);
            }
        }
        v2v_recording_close(&recording);
    }
}

/* Frame 4 of a row of frames, of one with a page before and between them, and of a sliding window,
 * which starts with view 1. */
static void views_that_are_not_used_are_passed_over(void **state)
{
    (void)state;
    static const struct {
        const char *without;
        int64_t stride, views;
        int64_t page[3];
    } cases[] = {{"", 0, 3, {12, 13, 14}}, {"1", 0, 2, {12, 14}},  {"0", 4, 2, {18, 19}},
                 {"2,0", 0, 1, {13}},      {"1", 1, 2, {6, 5}},    {"0", 1, 2, {4, 5}},
                 {"2", 1, 2, {6, 4}},      {" 1 , 2 ", 1, 1, {6}}, {"", 1, 3, {6, 4, 5}}};
    const struct v2v_tiff_info stack = stack_info(21, 1);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct v2v_input_settings settings = {.views = 3, .stride = cases[i].stride};
        struct v2v_recording *recording = NULL;
        float views[3][6];
        snprintf(settings.without_views, sizeof settings.without_views, "%s", cases[i].without);
        settings.first_view = cases[i].stride == 4;
        make_stack(&stack);
        assert_ok(v2v_recording_open(&recording, path, &settings, NULL));
        assert_int_equal(v2v_recording_info(recording)->views, cases[i].views);
        assert_ok(v2v_recording_read(recording, views[0], 4));
        for (int64_t v = 0; v < cases[i].views; v++) {
            assert_true(views[v][0] == (float)cases[i].page[v]);
        }
        v2v_recording_close(&recording);
    }
}

/* Page 7 of a sliding window over 3 views: view 1 of the frames that start at pages 5, 6 and 7. */
static void a_nan_in_a_page_is_refused_with_frame_and_view(void **state)
{
    (void)state;
    const struct v2v_tiff_info stack = stack_info(12, 1);
    const struct v2v_input_settings settings = {.views = 3, .stride = 1};
    struct v2v_recording *recording = NULL;
    float views[3 * 6];
    make_bad_stack(&stack, 7);
    assert_ok(v2v_recording_open(&recording, path, &settings, NULL));
    assert_ok(v2v_recording_read(recording, views, 4));
    for (int64_t t = 5; t <= 7; t++) {
        char frame[64];
        snprintf(frame, sizeof frame, "frame %lld, view 1 (from 0)", (long long)t);
        assert_int_equal(v2v_recording_read(recording, views, t), V2V_E_INPUT);
        assert_says(path);
        assert_says("y = 1, x = 2 (from 0) is NaN");
        assert_says(frame);
    }
    assert_ok(v2v_recording_read(recording, views, 8));
    v2v_recording_close(&recording);
    const struct v2v_input_settings fewer = {.views = 3, .stride = 1, .without_views = "0"};
    assert_ok(v2v_recording_open(&recording, path, &fewer, NULL));
    assert_int_equal(v2v_recording_read(recording, views, 6), V2V_E_INPUT);
    assert_says("frame 6, view 1 (from 0)");
    v2v_recording_close(&recording);
}

static void pages_that_make_no_whole_frames_are_refused_with_the_counts(void **state)
{
    (void)state;
    const struct v2v_tiff_info stack = stack_info(14, 1);
    make_stack(&stack);
    assert_refused(&(struct v2v_input_settings){.views = 13}, "14 pages, the first 0 left out, are "
                                                              "1 frames of 13 views and 1 pages "
                                                              "more");
    assert_refused(&(struct v2v_input_settings){.views = 15}, "hold no frame of 15 views");
    assert_refused(&(struct v2v_input_settings){.views = 2, .first_view = 14}, "hold no frame");
    assert_refused(&(struct v2v_input_settings){.views = 2, .first_view = 99}, "hold no frame");
}

static void a_time_series_states_its_views_and_its_interval(void **state)
{
    (void)state;
    const struct v2v_tiff_info stack = stack_info(3, 4);
    struct v2v_recording *recording = NULL;
    make_stack(&stack);
    assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, NULL));
    assert_int_equal(v2v_recording_info(recording)->views, 3);
    assert_int_equal(v2v_recording_info(recording)->frames, 4);
    assert_true(v2v_recording_info(recording)->frame_interval_s == 0.25);
    assert_false(v2v_recording_info(recording)->is_one_row);
    v2v_recording_close(&recording);
    assert_ok(v2v_recording_open(&recording, path,
                                 &(struct v2v_input_settings){.views = 3, .stride = 1}, NULL));
    /* 0.25 s / 3 to a rounding of the division and one of the product */
    assert_true(fabs(v2v_recording_info(recording)->frame_interval_s - 0.25 / 3) <= 2 * 0.25e-16);
    v2v_recording_close(&recording);
}

/* The time between frames of what is called one frame says nothing of frames made of its slices. */
static void an_interval_of_other_frames_is_not_known(void **state)
{
    (void)state;
    static const struct {
        int64_t slices, frames, views, stride;
        double interval;
    } cases[] = {{15, 1, 5, 0, 0.0},  {15, 1, 5, 1, 0.0},  {15, 1, 15, 0, 0.25},
                 {15, 1, 0, 0, 0.25}, {1, 15, 5, 0, 1.25}, {1, 15, 5, 1, 0.25},
                 {5, 3, 5, 10, 0.5}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const struct v2v_tiff_info stack = stack_info(cases[i].slices, cases[i].frames);
        const struct v2v_input_settings settings = {.views = cases[i].views,
                                                    .stride = cases[i].stride};
        struct v2v_recording *recording = NULL;
        make_stack(&stack);
        assert_ok(v2v_recording_open(&recording, path, &settings, NULL));
        assert_true(v2v_recording_info(recording)->frame_interval_s == cases[i].interval);
        v2v_recording_close(&recording);
    }
}

static void a_row_of_pages_is_one_frame_and_says_so_unless_views_are_told(void **state)
{
    (void)state;
    const struct v2v_tiff_info stack = stack_info(12, 1);
    make_stack(&stack);
    for (int64_t views = 0; views <= 3; views += 3) {
        struct v2v_recording *recording = NULL;
        assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){.views = views},
                                     NULL));
        assert_int_equal(v2v_recording_info(recording)->is_one_row, views == 0);
        assert_int_equal(v2v_recording_info(recording)->views, views == 0 ? 12 : views);
        v2v_recording_close(&recording);
    }
}

static void a_view_in_frames_of_this_program_is_read_back(void **state)
{
    (void)state;
    struct v2v_tiff_info stack = stack_info(1, 4);
    struct v2v_recording *recording = NULL;
    for (int ome = 0; ome <= 1; ome++) {
        stack.is_ome = ome;
        make_stack(&stack);
        assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, NULL));
        const struct v2v_recording_info *info = v2v_recording_info(recording);
        assert_true(info->frames == 4 && info->views == 1 && !info->is_one_row);
        assert_true(info->frame_interval_s == 0.25);
        v2v_recording_close(&recording);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pages_become_views_by_first_view_and_stride),
        cmocka_unit_test(views_that_are_not_used_are_passed_over),
        cmocka_unit_test(a_nan_in_a_page_is_refused_with_frame_and_view),
        cmocka_unit_test(pages_that_make_no_whole_frames_are_refused_with_the_counts),
        cmocka_unit_test(a_time_series_states_its_views_and_its_interval),
        cmocka_unit_test(an_interval_of_other_frames_is_not_known),
        cmocka_unit_test(a_row_of_pages_is_one_frame_and_says_so_unless_views_are_told),
        cmocka_unit_test(a_view_in_frames_of_this_program_is_read_back),
    };
    return cmocka_run_group_tests_name("recording in pages", tests, NULL, NULL);
}
