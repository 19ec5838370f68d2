#include "capture.h"
#include "counted_stack.h"

#include "io/folder.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/file_sum.h"
#include "v2v3d/io/recording.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

static char path[512];

/* FILE of the folder: `slices` pages of 1 x 1 pixels with 0, 1, .. */
static void put(const char *file, int64_t channels, int64_t slices)
{
    char name[600];
    snprintf(name, sizeof name, "%s/%s", path, file);
    counted_stack(name, channels, slices, 1);
}

static void use_folder(int64_t files, int64_t pages)
{
    snprintf(path, sizeof path, "%s", test_folder(NULL));
    for (int64_t i = 1; i <= files; i++) {
        char name[32];
        snprintf(name, sizeof name, "f%lld.TIF", (long long)i);
        put(name, 1, pages);
    }
}

static void names_are_in_the_order_of_their_numbers(void **state)
{
    (void)state;
    static const char *const sorted[] = {
        "View_1_t_3", "a",      "a01",      "a1",      "a2",   "a2b",
        "a10",        "a10_v2", "a010_v11", "a10_v11", "a10b", "a99999999999999999999999",
        "b"};
    enum { COUNT = sizeof sorted / sizeof sorted[0] };
    for (int i = 0; i < COUNT; i++) {
        for (int k = 0; k < COUNT; k++) {
            const int order = v2v_folder_compare(sorted[i], sorted[k]);
            if ((order > 0) - (order < 0) != (i > k) - (i < k)) {
                fail_msg("%s and %s: %d", sorted[i], sorted[k], order);
            }
        }
    }
}

static void a_folder_is_views_or_frames_by_their_number(void **state)
{
    (void)state;
    static const struct {
        int64_t files, pages, views;
        int layout;
        int64_t found_views, frames;
        float last[2];      /* first two views of the last frame: pages of their files */
        const char *reason; /* refused */
    } cases[] = {
        {11, 3, 11, 0, 11, 3, {2, 2}, NULL},
        {3, 11, 11, 0, 11, 3, {0, 1}, NULL},
        {3, 4, 2, 0, 2, 6, {2, 3}, NULL}, /* two frames a file */
        {5, 1, 5, 0, 5, 1, {0, 0}, NULL},
        {6, 1, 3, V2V_LAYOUT_FRAMES, 3, 2, {0, 0}, NULL},
        {3, 3, 3, V2V_LAYOUT_VIEWS, 3, 3, {2, 2}, NULL},
        {3, 3, 3, V2V_LAYOUT_FRAMES, 3, 3, {0, 1}, NULL},
        {4, 2, 0, V2V_LAYOUT_VIEWS, 4, 2, {1, 1}, NULL},
        {4, 2, 0, V2V_LAYOUT_FRAMES, 2, 4, {0, 1}, NULL},
        {3, 3, 3, 0, 0, 0, {0}, "can be 3 views or frames of 3 views: --layout views or"},
        {3, 6, 3, 0, 0, 0, {0}, "can be 3 views or frames of 3 views"},
        {3, 4, 0, 0, 0, 0, {0}, "has 3 files of 4 pages: --views V, or --layout views"},
        {3, 4, 5, 0, 0, 0, {0}, "3 files of 4 pages are neither 5 views nor frames of 5 views"},
        {6, 1, 3, 0, 0, 0, {0}, "; --layout frames takes one page after the other"},
        {3, 4, 5, V2V_LAYOUT_VIEWS, 0, 0, {0}, "has 3 files, but 5 views are asked for"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const struct v2v_input_settings settings = {.views = cases[i].views,
                                                    .layout = cases[i].layout};
        struct v2v_recording *recording = NULL;
        float views[11] = {0};
        use_folder(cases[i].files, cases[i].pages);
        if (cases[i].reason != NULL) {
            assert_int_equal(v2v_recording_open(&recording, path, &settings, NULL), V2V_E_INPUT);
            if (strstr(v2v_status_message(), cases[i].reason) == NULL) {
                fail_msg("\"%s\" does not say \"%s\"", v2v_status_message(), cases[i].reason);
            }
            continue;
        }
        assert_ok(v2v_recording_open(&recording, path, &settings, NULL));
        const struct v2v_recording_info *info = v2v_recording_info(recording);
        assert_int_equal(info->views, cases[i].found_views);
        assert_int_equal(info->frames, cases[i].frames);
        assert_ok(v2v_recording_read(recording, views, info->frames - 1));
        assert_true(views[0] == cases[i].last[0] && views[1] == cases[i].last[1]);
        v2v_recording_close(&recording);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void files_that_differ_are_refused_by_name(void **state)
{
    (void)state;
    const struct v2v_input_settings settings = {.views = 3};
    struct v2v_recording *recording = NULL;
    use_folder(3, 4);
    put("f2.TIF", 1, 5);
    assert_int_equal(v2v_recording_open(&recording, path, &settings, NULL), V2V_E_INPUT);
    assert_non_null(
        strstr(v2v_status_message(), "f2.TIF: has 5 pages of 1 x 1 pixels, but f1.TIF"));
    put("f2.TIF", 2, 2);
    assert_int_equal(v2v_recording_open(&recording, path, &settings, NULL), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "f2.TIF: has another type or other channels"));
    assert_int_equal(v2v_mem_held(), 0);
}

/* More files than stay open, of which one changes. */
static void every_file_of_many_is_read_and_watched(void **state)
{
    (void)state;
    enum { FILES = 150 };
    const struct v2v_input_settings settings = {.views = FILES};
    struct v2v_recording *recording = NULL;
    float views[FILES];
    use_folder(FILES, 2);
    assert_ok(v2v_recording_open(&recording, path, &settings, NULL));
    for (int64_t t = 1; t >= 0; t--) {
        assert_ok(v2v_recording_read(recording, views, t));
        for (int v = 0; v < FILES; v++) {
            assert_true(views[v] == (float)t);
        }
    }
    put("f77.TIF", 1, 2);
    assert_int_equal(v2v_recording_read(recording, views, 0), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "f77.TIF: changed while it was read"));
    v2v_recording_close(&recording);
    assert_int_equal(v2v_mem_held(), 0);
}

static void the_sum_of_a_folder_knows_order_and_bytes(void **state)
{
    (void)state;
    uint64_t first = 0, other = 0;
    char from[600], to[600];
    use_folder(3, 4);
    put("f3.TIF", 1, 5);
    assert_ok(v2v_file_sum(&first, path, NULL));
    assert_ok(v2v_file_sum(&other, path, NULL));
    assert_true(first == other);
    snprintf(from, sizeof from, "%s/f3.TIF", path);
    snprintf(to, sizeof to, "%s/f0.TIF", path);
    assert_int_equal(rename(from, to), 0);
    assert_ok(v2v_file_sum(&other, path, NULL));
    assert_true(first != other);
}

/* 32 MiB of zeros but for one byte, which is in the first piece of 16 MiB or in the second. */
static uint64_t sum_with_byte_at(const char *name, long at)
{
    enum { BYTES = 2 << 24 };
    uint64_t sum = 0;
    char file[600];
    snprintf(file, sizeof file, "%s/%s", path, name);
    FILE *out = fopen(file, "wbe");
    assert_non_null(out);
    assert_int_equal(fseek(out, at, SEEK_SET), 0);
    assert_int_equal(fputc('x', out), 'x');
    assert_int_equal(fflush(out), 0);
    assert_int_equal(ftruncate(fileno(out), BYTES), 0);
    assert_int_equal(fclose(out), 0);
    assert_ok(v2v_file_sum(&sum, file, NULL));
    return sum;
}

static void the_sum_of_a_file_knows_where_its_pieces_are(void **state)
{
    (void)state;
    use_folder(0, 0);
    assert_true(sum_with_byte_at("a.raw", 0) != sum_with_byte_at("b.raw", 1 << 24));
}

/* Files of one frame state the time from frame to frame, whether or not the caller counts views. */
static void a_file_is_an_interval(void **state)
{
    (void)state;
    enum { FILES = 3, PAGES = 4 };
    const struct v2v_tiff_info info = {.pages = PAGES,
                                       .height = 1,
                                       .width = 1,
                                       .channels = 1,
                                       .slices = PAGES,
                                       .frames = 1,
                                       .bits = 32,
                                       .is_float = 1,
                                       .type_max = 1.0,
                                       .frame_interval_s = 0.25};
    snprintf(path, sizeof path, "%s", test_folder(NULL));
    for (int i = 0; i < FILES; i++) {
        char name[600];
        snprintf(name, sizeof name, "%s/f%d.tif", path, i);
        counting_stack(name, &info, 0.0f, 1.0f);
    }
    for (int64_t views = 0; views <= PAGES; views += PAGES) {
        const struct v2v_input_settings settings = {.views = views, .layout = V2V_LAYOUT_FRAMES};
        struct v2v_recording *recording = NULL;
        assert_ok(v2v_recording_open(&recording, path, &settings, NULL));
        const struct v2v_recording_info *found = v2v_recording_info(recording);
        assert_int_equal(found->frames, FILES);
        assert_int_equal(found->views, PAGES);
        assert_true(found->frame_interval_s == 0.25);
        v2v_recording_close(&recording);
    }
}

/* One page of 1 x 1 pixels, of this size. */
static void put_page(const char *file, double pixel_size_um)
{
    const struct v2v_tiff_info info = {.pages = 1,
                                       .height = 1,
                                       .width = 1,
                                       .bits = 32,
                                       .is_float = 1,
                                       .type_max = 1.0,
                                       .pixel_size_um = pixel_size_um};
    char name[600];
    snprintf(name, sizeof name, "%s/%s", path, file);
    counting_stack(name, &info, 0.0f, 1.0f);
}

/* Opened as a view a file: what is warned of goes to text. */
static void open_by_view(char *text, size_t bytes)
{
    const struct v2v_input_settings settings = {.layout = V2V_LAYOUT_VIEWS};
    struct v2v_recording *recording = NULL;
    test_capture_begin();
    const enum v2v_status rc = v2v_recording_open(&recording, path, &settings, NULL);
    test_capture_end(text, bytes);
    assert_ok(rc);
    v2v_recording_close(&recording);
}

static void a_number_that_is_missing_is_warned_of(void **state)
{
    (void)state;
    static const struct {
        const char *files[6];
        const char *missing; /* NULL: none is */
    } cases[] = {
        {{"frame_1.tif", "frame_2.tif", "frame_4.tif"}, "frame_3.tif is missing"},
        {{"v08.tif", "v09.tif", "v11.tif", "v12.tif", "v14.tif"}, "v10.tif is missing"},
        {{"t0.tif", "t10.tif", "t20.tif", "t40.tif"}, "t30.tif is missing"},
        {{"t1_v1.tif", "t1_v2.tif", "t1_v3.tif", "t2_v1.tif", "t2_v3.tif"}, "t2_v2.tif is"},
        {{"3.tif", "4.tif", "5.tif"}, NULL},
        {{"t0.tif", "t10.tif", "t20.tif"}, NULL},
        {{"left.tif", "middle.tif", "right.tif"}, NULL},
        {{"a1.tif", "a2.tif", "b7.tif", "b8.tif"}, NULL},
        {{"170011.tif", "170029.tif", "170030.tif", "170052.tif", "170075.tif"}, NULL},
        {{"1.tif", "99999999999999999999999.tif", "99999999999999999999999999.tif"}, NULL},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char text[1024];
        use_folder(0, 0);
        for (int f = 0; f < 6 && cases[i].files[f] != NULL; f++) {
            put_page(cases[i].files[f], 0.5);
        }
        open_by_view(text, sizeof text);
        const char *said = cases[i].missing != NULL ? strstr(text, cases[i].missing) : text;
        if (said == NULL || (cases[i].missing == NULL && text[0] != '\0')) {
            fail_msg("%s: \"%s\"", cases[i].files[0], text);
        }
    }
}

static void pixels_of_another_size_are_warned_of_by_the_files_name(void **state)
{
    (void)state;
    char text[1024];
    use_folder(0, 0);
    put_page("1.tif", 0.5);
    put_page("2.tif", 0.504); /* 0.8 %: stated with fewer digits */
    put_page("3.tif", 0.0);   /* says none */
    open_by_view(text, sizeof text);
    assert_string_equal(text, "");
    put_page("4.tif", 0.65);
    put_page("5.tif", 0.65);
    open_by_view(text, sizeof text);
    assert_non_null(strstr(text, "4.tif says pixels of 0.65 um, but 1.tif of 0.5"));
    assert_null(strstr(text, "5.tif"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(names_are_in_the_order_of_their_numbers),
        cmocka_unit_test(a_folder_is_views_or_frames_by_their_number),
        cmocka_unit_test(files_that_differ_are_refused_by_name),
        cmocka_unit_test(every_file_of_many_is_read_and_watched),
        cmocka_unit_test(a_file_is_an_interval),
        cmocka_unit_test(the_sum_of_a_folder_knows_order_and_bytes),
        cmocka_unit_test(the_sum_of_a_file_knows_where_its_pieces_are),
        cmocka_unit_test(a_number_that_is_missing_is_warned_of),
        cmocka_unit_test(pixels_of_another_size_are_warned_of_by_the_files_name),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
