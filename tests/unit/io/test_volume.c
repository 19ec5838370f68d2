#include "counted_stack.h"
#include "support.h"
#include "tiff_bytes.h"

#include "h5_files.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/tiff.h"
#include "v2v3d/io/volume.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#define MEAN_ONLY (1u << V2V_VOLUME_MEAN)

static char path[512];

static void use(const char *name)
{
    snprintf(path, sizeof path, "%s/%s", test_folder(NULL), name);
}

static void assert_says(const char *part)
{
    if (strstr(v2v_status_message(), part) == NULL) {
        fail_msg("\"%s\" does not say \"%s\"", v2v_status_message(), part);
    }
}

static void assert_refused(int64_t slices, const char *reason)
{
    struct v2v_volume *volume = NULL;
    const struct v2v_input_settings settings = {.slices = slices};
    assert_int_equal(v2v_volume_open(&volume, path, &settings, NULL), V2V_E_INPUT);
    assert_null(volume);
    assert_says(path);
    assert_says(reason);
    assert_null(strchr(v2v_status_message(), '\n'));
}

static void integers_are_fractions_of_their_types_maximum(void **state)
{
    (void)state;
    static const struct {
        enum test_h5_type type;
        double maximum;
    } cases[] = {{TEST_H5_U8, 255},       {TEST_H5_U16, 65535},
                 {TEST_H5_U16_BE, 65535}, {TEST_H5_U32, 4294967295.0},
                 {TEST_H5_I16, 32767},    {TEST_H5_F32, 1},
                 {TEST_H5_F64, 1}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const double values[4] = {0, 1, 51, cases[i].maximum};
        struct v2v_volume *volume = NULL;
        float out[4];
        use("vol.h5");
        test_h5_make(path, &(struct test_h5_spec){.dataset = "/volume",
                                                  .type = cases[i].type,
                                                  .rank = 3,
                                                  .shape = {2, 1, 2},
                                                  .values = values});
        assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
        assert_int_equal(v2v_volume_info(volume)->slices, 2);
        assert_int_equal(v2v_volume_info(volume)->frames, 1);
        assert_ok(v2v_volume_read(volume, out, 0, 0, 2));
        for (int e = 0; e < 4; e++) {
            /* u32 to float, 1/maximum to float, their product: three roundings of 2^-24 */
            const double expected = values[e] / cases[i].maximum;
            assert_true(fabs(out[e] - expected) <= 3 * 0x1p-24 * expected);
        }
        v2v_volume_close(&volume);
    }
}

static void unsuitable_files_are_refused_by_name_and_reason(void **state)
{
    (void)state;
    static const struct {
        struct test_h5_spec spec;
        const char *reason;
    } cases[] = {
        {{.dataset = "/views", .rank = 3, .shape = {2, 3, 4}}, "/volume: there is no such dataset"},
        {{.dataset = "/volume", .rank = 2, .shape = {3, 4}}, "/volume: has 2 axes, not [tzyx]"},
        {{.dataset = "/volume", .rank = 4, .shape = {0, 2, 3, 4}}, "/volume: axis 0 has 0"},
        {{.dataset = "/volume", .type = TEST_H5_STRING, .rank = 3, .shape = {2, 3, 4}},
         "/volume: holds no integers or floats"},
        {{.dataset = "/volume", .storage = TEST_H5_VIRTUAL, .rank = 3, .shape = {2, 3, 4}},
         "/volume: keeps its data in other files"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        use("vol.h5");
        test_h5_make(path, &cases[i].spec);
        assert_refused(0, cases[i].reason);
    }
    use("vol.h5");
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/volume", .rank = 3, .shape = {2, 3, 4}});
    test_h5_numbers(path, "/volume", "element_size_um", (double[]){1, 2}, 2);
    assert_refused(0, "attribute element_size_um: is not 3 numbers");
    use("vol.h5");
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/volume", .rank = 3, .shape = {2, 3, 4}});
    test_h5_make(path, &(struct test_h5_spec){
                           .dataset = "/done", .type = TEST_H5_U8, .rank = 1, .shape = {7}});
    assert_refused(0, "/done: is not one number for each of 1 frames");
    assert_int_equal(v2v_mem_held(), 0);
}

static void an_unfinished_frame_is_refused(void **state)
{
    (void)state;
    struct v2v_volume *volume = NULL;
    float out[2];
    use("vol.h5");
    test_h5_make(path,
                 &(struct test_h5_spec){.dataset = "/volume", .rank = 4, .shape = {2, 1, 1, 2}});
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/done",
                                              .type = TEST_H5_U8,
                                              .rank = 1,
                                              .shape = {2},
                                              .values = (double[]){1, 0}});
    assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
    assert_ok(v2v_volume_read(volume, out, 0, 0, 1));
    assert_int_equal(v2v_volume_read(volume, out, 1, 0, 1), V2V_E_INPUT);
    assert_says("frame 1 was never finished");
    v2v_volume_close(&volume);
}

static const struct v2v_volume_info small = {.frames = 3,
                                             .slices = 4,
                                             .height = 2,
                                             .width = 5,
                                             .pixel_size_um = 0.5,
                                             .slice_spacing_um = 2.0,
                                             .frame_interval_s = 0.25};

static float element(int dataset, int64_t t, int64_t i)
{
    return (float)sin((double)(1 + dataset) * 0.37 * (double)(t * 40 + i));
}

/* Two slices, then the other two, the frames in the given order. */
static void write_some(struct v2v_volume_writer *writer, int dataset, const int64_t *order,
                       int count)
{
    float frame[40];
    for (int n = 0; n < count; n++) {
        for (int64_t i = 0; i < 40; i++) {
            frame[i] = element(dataset, order[n], i);
        }
        assert_ok(v2v_volume_write(writer, dataset, frame + 20, order[n], 2, 2));
        assert_ok(v2v_volume_write(writer, dataset, frame, order[n], 0, 2));
        assert_ok(v2v_volume_write(writer, dataset, frame, 0, 0, 0));
    }
}

static void write_frames(struct v2v_volume_writer *writer, int dataset, const int64_t *order)
{
    write_some(writer, dataset, order, 3);
}

static void assert_frames(int64_t slices)
{
    struct v2v_volume *volume = NULL;
    float frame[40];
    const struct v2v_input_settings settings = {.slices = slices};
    assert_ok(v2v_volume_open(&volume, path, &settings, NULL));
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    assert_true(info->frames == 3 && info->slices == 4 && info->height == 2 && info->width == 5);
    for (int64_t t = 0; t < 3; t++) {
        assert_ok(v2v_volume_read(volume, frame + 10, t, 1, 3));
        assert_ok(v2v_volume_read(volume, frame, t, 0, 1));
        for (int64_t i = 0; i < 40; i++) {
            assert_true(frame[i] == element(0, t, i));
        }
    }
    assert_true(fabs(info->pixel_size_um - 0.5) < 1e-6); /* TIFF states it as a fraction of ints */
    assert_true(info->slice_spacing_um == 2.0 && info->frame_interval_s == 0.25);
    v2v_volume_close(&volume);
}

static void written_hdf5_is_read_back_to_the_bit_with_its_provenance(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    /* Longer than an attribute can be. */
    char *log = malloc(100001);
    assert_non_null(log);
    memset(log, 'x', 100000);
    log[100000] = '\0';
    const struct v2v_attribute attributes[] = {
        {.name = "config", .text = "train:\n  steps: 3\n"},
        {.name = "gain", .number = 0.125},
        {.name = "empty", .text = ""},
        {.name = "log", .text = log},
    };
    use("vol.h5");
    assert_ok(v2v_volume_create(&writer, path, &small, MEAN_ONLY | 1u << V2V_VOLUME_UNCERTAINTY,
                                attributes, 4, NULL));
    write_frames(writer, V2V_VOLUME_MEAN, (int64_t[]){0, 1, 2});
    write_frames(writer, V2V_VOLUME_UNCERTAINTY, (int64_t[]){2, 1, 0});
    assert_false(v2v_file_exists(path));
    assert_ok(v2v_volume_finish(&writer));
    assert_frames(0);
    int64_t count = 0;
    double *values = test_h5_read(path, "/uncertainty", &count);
    assert_int_equal(count, 120);
    assert_true((float)values[119] == element(V2V_VOLUME_UNCERTAINTY, 2, 39));
    test_release(values);
    assert_true(test_h5_attribute(path, "/", "gain") == 0.125);
    assert_true(test_h5_has_attribute(path, "/", "config"));
    assert_true(test_h5_has_attribute(path, "/", "empty"));
    assert_false(test_h5_has_attribute(path, "/", "log"));
    assert_true(test_h5_has_attribute(path, "/uncertainty", "axes"));
    assert_true(test_h5_has_attribute(path, "/volume", "element_size_um"));
    values = test_h5_read(path, "/done", &count);
    assert_true(count == 3 && values[0] == 1.0 && values[1] == 1.0 && values[2] == 1.0);
    test_release(values);
    free(log);
    assert_int_equal(v2v_mem_held(), 0);
}

static void only_marked_frames_are_done_once_one_is_marked(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    int64_t count = 0;
    use("vol.h5");
    assert_ok(v2v_volume_create(&writer, path, &small, MEAN_ONLY, NULL, 0, NULL));
    write_frames(writer, V2V_VOLUME_MEAN, (int64_t[]){0, 1, 2});
    assert_ok(v2v_volume_mark_done(writer, 1, NULL));
    assert_ok(v2v_volume_finish(&writer));
    double *done = test_h5_read(path, "/done", &count);
    assert_true(count == 3 && done[0] == 0.0 && done[1] == 1.0 && done[2] == 0.0);
    test_release(done);
}

/* The frames of an attempt that is killed at its end: one is marked, one is written only. */
static void killed_attempt(void)
{
    struct v2v_volume_writer *writer = NULL;
    const struct v2v_attribute task = {.name = V2V_VOLUME_TASK, .text = "task"};
    if (v2v_volume_create(&writer, path, &small, MEAN_ONLY, &task, 1, NULL) == V2V_OK) {
        write_frames(writer, V2V_VOLUME_MEAN, (int64_t[]){0, 1, 2});
        if (v2v_volume_mark_done(writer, 1, NULL) == V2V_OK) {
            raise(SIGKILL);
        }
    }
    _exit(1);
}

/* What is written to the disk as it is has to begin at a page: every slice of 32 x 32 does. */
static void slices_of_whole_pages_begin_at_one(void **state)
{
    (void)state;
    enum { FRAMES = 2, SLICES = 3, PIXELS = 32 * 32, MOST = 64 * 1024 };
    static float frame[SLICES * PIXELS];
    static char bytes[MOST];
    const struct v2v_volume_info info = {
        .frames = FRAMES, .slices = SLICES, .height = 32, .width = 32};
    struct v2v_volume_writer *writer = NULL;
    use("pages.h5");
    assert_ok(v2v_volume_create(&writer, path, &info, MEAN_ONLY, NULL, 0, NULL));
    for (int64_t t = 0; t < FRAMES; t++) {
        for (int64_t i = 0; i < SLICES * PIXELS; i++) {
            frame[i] = (float)(1 + i + t * SLICES * PIXELS);
        }
        assert_ok(v2v_volume_put_later(writer, V2V_VOLUME_MEAN, frame, t, 0, SLICES));
        assert_ok(v2v_volume_mark_later(writer, t, NULL));
        assert_ok(v2v_volume_wait(writer));
    }
    assert_ok(v2v_volume_finish(&writer));
    FILE *file = fopen(path, "re");
    assert_non_null(file);
    const size_t size = fread(bytes, 1, MOST, file);
    assert_int_equal(fclose(file), 0);
    assert_true(size > sizeof frame * FRAMES && size < MOST);
    for (int64_t z = 0; z < FRAMES * SLICES; z++) {
        const float first[] = {(float)(1 + z * PIXELS), (float)(2 + z * PIXELS)};
        const char *at = memmem(bytes, size, first, sizeof first);
        assert_non_null(at);
        assert_int_equal((at - bytes) % V2V_PAGE_BYTES, 0);
    }
}

static void a_killed_writer_leaves_the_marked_frames_to_go_on_with(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    const struct v2v_attribute task = {.name = V2V_VOLUME_TASK, .text = "task"};
    int status = 0;
    use("killed.h5");
    const pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        killed_attempt();
    }
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFSIGNALED(status));
    assert_ok(v2v_volume_resume(&writer, path, &small, MEAN_ONLY, &task, 1, NULL));
    assert_true(!v2v_volume_is_done(writer, 0) && v2v_volume_is_done(writer, 1) &&
                !v2v_volume_is_done(writer, 2));
    write_some(writer, V2V_VOLUME_MEAN, (int64_t[]){0, 2}, 2);
    assert_ok(v2v_volume_mark_done(writer, 0, NULL));
    assert_ok(v2v_volume_mark_done(writer, 2, NULL));
    assert_ok(v2v_volume_finish(&writer));
    assert_frames(0);
}

static void tiff_pages_are_in_order_whatever_the_order_of_writing(void **state)
{
    (void)state;
    static const int64_t orders[][3] = {{0, 1, 2}, {2, 1, 0}, {1, 2, 0}};
    for (size_t i = 0; i < sizeof orders / sizeof orders[0]; i++) {
        struct v2v_volume_writer *writer = NULL;
        use("vol.tif");
        assert_ok(v2v_volume_create(&writer, path, &small, MEAN_ONLY, NULL, 0, NULL));
        write_frames(writer, V2V_VOLUME_MEAN, orders[i]);
        assert_ok(v2v_volume_mark_done(writer, 0, NULL));
        assert_ok(v2v_volume_finish(&writer));
        assert_frames(0);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void a_tiff_with_a_missing_frame_does_not_appear(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    const float slices[40] = {0};
    use("vol.tif");
    assert_ok(v2v_volume_create(&writer, path, &small, MEAN_ONLY, NULL, 0, NULL));
    assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, slices, 0, 0, 4));
    assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, slices, 2, 0, 4));
    assert_int_equal(v2v_volume_finish(&writer), V2V_E_IO);
    assert_null(writer);
    assert_says("frame 1 was not written");
    assert_false(v2v_file_exists(path));
    assert_int_equal(v2v_mem_held(), 0);
}

static void other_file_types_and_datasets_are_a_usage_error(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    static const char *const names[] = {"vol.png", "vol", "vol.h5.bak"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        use(names[i]);
        assert_int_equal(v2v_volume_create(&writer, path, &small, MEAN_ONLY, NULL, 0, NULL),
                         V2V_E_USAGE);
        assert_says(path);
    }
    use("vol.tiff");
    assert_int_equal(v2v_volume_create(&writer, path, &small, MEAN_ONLY | 1u << V2V_VOLUME_BRANCH1,
                                       NULL, 0, NULL),
                     V2V_E_USAGE);
    assert_int_equal(v2v_mem_held(), 0);
}

static void make_stack(int64_t slices, int64_t frames, int64_t channels)
{
    use("vol.tif");
    counted_stack(path, channels, slices, frames);
}

static void slices_come_from_the_file_then_the_caller_then_the_pages(void **state)
{
    (void)state;
    static const struct {
        int64_t slices, frames, asked, found_frames, found_slices;
    } cases[] = {{3, 4, 0, 4, 3},   {3, 4, 3, 4, 3},  {1, 12, 6, 2, 6},
                 {1, 12, 0, 12, 1}, {12, 1, 6, 2, 6}, {12, 1, 0, 1, 12}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct v2v_volume *volume = NULL;
        float last = 0.0f;
        make_stack(cases[i].slices, cases[i].frames, 1);
        const struct v2v_input_settings settings = {.slices = cases[i].asked};
        assert_ok(v2v_volume_open(&volume, path, &settings, NULL));
        const struct v2v_volume_info *info = v2v_volume_info(volume);
        assert_int_equal(info->frames, cases[i].found_frames);
        assert_int_equal(info->slices, cases[i].found_slices);
        assert_ok(v2v_volume_read(volume, &last, info->frames - 1, info->slices - 1, 1));
        assert_true(last == 11.0f);
        v2v_volume_close(&volume);
    }
    make_stack(1, 12, 1);
    assert_refused(5, "12 pages are 2 frames of 5 slices and 2 more");
    make_stack(3, 4, 1);
    assert_refused(6, "a frame has 3 slices, but 6 are asked for");
}

/* Without its offset the values of a packed volume would all be shifted. */
static void an_offset_beside_the_step_is_added(void **state)
{
    (void)state;
    static const double scale = 0.5, zero = -3.0;
    struct v2v_volume *volume = NULL;
    float slice[6];
    for (int has_scale = 0; has_scale <= 1; has_scale++) {
        use(has_scale ? "both.h5" : "offset.h5");
        test_h5_make(path,
                     &(struct test_h5_spec){
                         .dataset = "/volume", .type = TEST_H5_U16, .rank = 3, .shape = {2, 2, 3}});
        test_h5_numbers(path, "/volume", "add_offset", &zero, 1);
        if (has_scale) {
            test_h5_numbers(path, "/volume", "scale_factor", &scale, 1);
        }
        assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
        assert_ok(v2v_volume_read(volume, slice, 0, 1, 1));
        for (int i = 0; i < 6; i++) {
            assert_true(slice[i] == (has_scale ? 0.5f : 1.0f) * (float)(6 + i) - 3.0f);
        }
        v2v_volume_close(&volume);
    }
}

/* Programs call any row of pages frames; this one means it. */
static void frames_alone_are_frames_where_this_program_wrote_them(void **state)
{
    (void)state;
    static const struct v2v_volume_info flat = {
        .frames = 3, .slices = 1, .height = 2, .width = 5, .frame_interval_s = 0.25};
    static const char *const names[] = {"flat.tif", "flat.ome.tif"};
    const float slice[10] = {0};
    struct v2v_volume *volume = NULL;
    struct tiff_bytes other;
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        struct v2v_volume_writer *writer = NULL;
        use(names[i]);
        assert_ok(v2v_volume_create(&writer, path, &flat, MEAN_ONLY, NULL, 0, NULL));
        for (int64_t t = 0; t < 3; t++) {
            assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, slice, t, 0, 1));
        }
        assert_ok(v2v_volume_finish(&writer));
        assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
        assert_int_equal(v2v_volume_info(volume)->frames, 3);
        assert_int_equal(v2v_volume_info(volume)->slices, 1);
        assert_true(v2v_volume_info(volume)->frame_interval_s == 0.25);
        v2v_volume_close(&volume);
    }
    tiff_bytes_make(&other, 0, 3, 3, 2, 5, "ImageJ=1.53t\nimages=3\nframes=3\nfinterval=0.25\n");
    assert_true(tiff_bytes_save(path, other.data, other.size));
    assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
    assert_int_equal(v2v_volume_info(volume)->frames, 1);
    assert_int_equal(v2v_volume_info(volume)->slices, 3);
    v2v_volume_close(&volume);
}

/* Pages that are called frames state the time from page to page. */
static void an_interval_of_pages_is_that_of_their_slices(void **state)
{
    (void)state;
    struct v2v_tiff_info pages = {.pages = 12,
                                  .height = 1,
                                  .width = 1,
                                  .channels = 1,
                                  .slices = 1,
                                  .frames = 12,
                                  .bits = 32,
                                  .is_float = 1,
                                  .type_max = 1.0,
                                  .frame_interval_s = 0.25};
    struct v2v_volume *volume = NULL;
    use("pages.tif");
    counting_stack(path, &pages, 0.0f, 1.0f);
    assert_ok(v2v_volume_open(&volume, path, &(struct v2v_input_settings){.slices = 4}, NULL));
    assert_int_equal(v2v_volume_info(volume)->frames, 3);
    assert_true(v2v_volume_info(volume)->frame_interval_s == 1.0);
    v2v_volume_close(&volume);
    /* slices alone: of frames of them all, not of four */
    pages.slices = 12;
    pages.frames = 1;
    counting_stack(path, &pages, 0.0f, 1.0f);
    assert_ok(v2v_volume_open(&volume, path, &(struct v2v_input_settings){.slices = 4}, NULL));
    assert_true(v2v_volume_info(volume)->frame_interval_s == 0.0);
    v2v_volume_close(&volume);
    assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
    assert_true(v2v_volume_info(volume)->frame_interval_s == 0.25);
    v2v_volume_close(&volume);
}

static void one_channel_of_a_hyperstack_is_read(void **state)
{
    (void)state;
    struct v2v_volume *volume = NULL;
    float slices[3];
    make_stack(3, 2, 2);
    assert_refused(0, "has 2 channels: --channel K (from 1) takes one");
    assert_int_equal(
        v2v_volume_open(&volume, path, &(struct v2v_input_settings){.channel = 3}, NULL),
        V2V_E_INPUT);
    assert_says("has 2 channels: there is no channel 3 (from 1)");
    assert_ok(v2v_volume_open(&volume, path, &(struct v2v_input_settings){.channel = 2}, NULL));
    assert_int_equal(v2v_volume_info(volume)->slices, 3);
    assert_int_equal(v2v_volume_info(volume)->frames, 2);
    assert_ok(v2v_volume_read(volume, slices, 1, 0, 3));
    assert_true(slices[0] == 7.0f && slices[1] == 9.0f && slices[2] == 11.0f);
    v2v_volume_close(&volume);
}

static void the_real_volume_is_a_fraction_of_65535(void **state)
{
    (void)state;
    const char *real = test_shared("volumes/fibres.tif");
    struct v2v_volume *volume = NULL;
    float *slices = NULL;
    double sum = 0.0, maximum = 0.0;
    const int64_t count = INT64_C(39) * 384 * 384;
    if (real == NULL) {
        skip();
    }
    assert_ok(v2v_volume_open(&volume, real, NULL, NULL));
    assert_int_equal(v2v_volume_info(volume)->slices, 39);
    assert_int_equal(v2v_volume_info(volume)->height, 384);
    assert_ok(V2V_ALLOC(slices, "test", count));
    assert_ok(v2v_volume_read(volume, slices, 0, 0, 39));
    for (int64_t i = 0; i < count; i++) {
        sum += slices[i];
        maximum = slices[i] > maximum ? slices[i] : maximum;
    }
    /* numpy's mean of the counts; each fraction carries at most two roundings of 2^-24 */
    assert_true(fabs(sum / (double)count * 65535.0 - 683.2179469790553) < 683.3 * 2 * 0x1p-24);
    assert_true(fabs(maximum - 1.0) <= 2 * 0x1p-24);
    v2v_mem_free(slices);
    v2v_volume_close(&volume);
}

static void a_file_in_a_read_only_folder_is_read(void **state)
{
    (void)state;
    const char *real = test_shared("golden/projection.h5");
    struct v2v_volume *volume = NULL;
    int64_t count = 0;
    if (real == NULL) {
        skip();
    }
    double *expected = test_h5_read(real, "/volume", &count);
    assert_ok(v2v_volume_open(&volume, real, NULL, NULL));
    float *slices = malloc((size_t)count * sizeof *slices);
    assert_non_null(slices);
    assert_int_equal(count, 39 * 64 * 64);
    assert_ok(v2v_volume_read(volume, slices, 0, 0, 39));
    for (int64_t i = 0; i < count; i++) {
        assert_true(slices[i] == (float)expected[i]);
    }
    free(slices);
    test_release(expected);
    v2v_volume_close(&volume);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(integers_are_fractions_of_their_types_maximum),
        cmocka_unit_test(unsuitable_files_are_refused_by_name_and_reason),
        cmocka_unit_test(an_unfinished_frame_is_refused),
        cmocka_unit_test(written_hdf5_is_read_back_to_the_bit_with_its_provenance),
        cmocka_unit_test(only_marked_frames_are_done_once_one_is_marked),
        cmocka_unit_test(slices_of_whole_pages_begin_at_one),
        cmocka_unit_test(a_killed_writer_leaves_the_marked_frames_to_go_on_with),
        cmocka_unit_test(tiff_pages_are_in_order_whatever_the_order_of_writing),
        cmocka_unit_test(a_tiff_with_a_missing_frame_does_not_appear),
        cmocka_unit_test(other_file_types_and_datasets_are_a_usage_error),
        cmocka_unit_test(slices_come_from_the_file_then_the_caller_then_the_pages),
        cmocka_unit_test(an_offset_beside_the_step_is_added),
        cmocka_unit_test(frames_alone_are_frames_where_this_program_wrote_them),
        cmocka_unit_test(an_interval_of_pages_is_that_of_their_slices),
        cmocka_unit_test(one_channel_of_a_hyperstack_is_read),
        cmocka_unit_test(the_real_volume_is_a_fraction_of_65535),
        cmocka_unit_test(a_file_in_a_read_only_folder_is_read),
    };
    return cmocka_run_group_tests_name("volume", tests, NULL, NULL);
}
