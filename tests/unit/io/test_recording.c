#include "a_recording.h"

#include "h5_files.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/recording.h"
#include "v2v3d/io/tiff.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void example_of_the_header(void **state)
{
    (void)state;
    enum v2v_status rc = V2V_OK;
    float *views = NULL;
    use("rec.h5");
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/views", .rank = 3, .shape = {2, 3, 4}});
    struct v2v_recording *recording = NULL;
    struct v2v_input_settings settings = {.views = 2};
    V2V_TRY(v2v_recording_open(&recording, path, &settings, NULL));
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    V2V_TRY(V2V_ALLOC(views, "views", info->views * info->height * info->width));
    V2V_TRY(v2v_recording_read(recording, views, 0));
    assert_int_equal(info->frames, 1);
    assert_true(views[23] == 23.0f);
done:
    v2v_mem_free(views);
    v2v_recording_close(&recording);
    assert_ok(rc);
    assert_int_equal(v2v_mem_held(), 0);
}

static void every_number_type_is_read_as_its_counts(void **state)
{
    (void)state;
    /* Exact in all of them. */
    static const double values[] = {0, 1, 2, 3, 100, 127, 126, 125};
    static const enum test_h5_type types[] = {TEST_H5_F32, TEST_H5_F64, TEST_H5_F32_BE,
                                              TEST_H5_U8,  TEST_H5_U16, TEST_H5_U16_BE,
                                              TEST_H5_U32, TEST_H5_I16};
    static const enum test_h5_storage storages[] = {TEST_H5_CONTIGUOUS, TEST_H5_CHUNKED,
                                                    TEST_H5_CHECKED, TEST_H5_DEFLATED};
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++) {
        const struct test_h5_spec spec = {.dataset = "/views",
                                          .type = types[i],
                                          .storage = storages[i % 4],
                                          .rank = 4,
                                          .shape = {2, 1, 2, 2},
                                          .values = values};
        struct v2v_recording *recording = NULL;
        float views[8];
        use("rec.h5");
        test_h5_make(path, &spec);
        assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, NULL));
        assert_int_equal(v2v_recording_info(recording)->frames, 2);
        assert_ok(v2v_recording_read(recording, views + 4, 1));
        assert_ok(v2v_recording_read(recording, views, 0));
        for (int e = 0; e < 8; e++) {
            assert_true(views[e] == (float)values[e]);
        }
        v2v_recording_close(&recording);
    }
}

static void unsuitable_datasets_are_refused_by_name_and_reason(void **state)
{
    (void)state;
    static const struct {
        struct test_h5_spec spec;
        const char *reason;
    } cases[] = {
        {{.dataset = "/other", .rank = 3, .shape = {2, 3, 4}}, "/views: there is no such dataset"},
        {{.dataset = "/views", .rank = 2, .shape = {3, 4}}, "/views: has 2 axes"},
        {{.dataset = "/views", .rank = 5, .shape = {1, 1, 1, 3, 4}}, "/views: has 5 axes"},
        {{.dataset = "/views", .rank = 3, .shape = {2, 0, 4}}, "/views: axis 1 has 0 elements"},
        {{.dataset = "/views", .type = TEST_H5_STRING, .rank = 3, .shape = {2, 3, 4}},
         "/views: holds no integers or floats"},
        {{.dataset = "/views", .type = TEST_H5_COMPOUND, .rank = 3, .shape = {2, 3, 4}},
         "/views: holds no integers or floats"},
        {{.dataset = "/views", .type = TEST_H5_BITS, .rank = 3, .shape = {2, 3, 4}},
         "/views: holds no integers or floats"},
        {{.dataset = "/views", .storage = TEST_H5_FOREIGN, .rank = 3, .shape = {2, 3, 4}},
         "/views: needs HDF5 filter 300"},
        {{.dataset = "/views", .storage = TEST_H5_EXTERNAL, .rank = 3, .shape = {2, 3, 4}},
         "/views: keeps its data in other files"},
        {{.dataset = "/views", .storage = TEST_H5_VIRTUAL, .rank = 3, .shape = {2, 3, 4}},
         "/views: keeps its data in other files"},
        {{.dataset = "/views", .storage = TEST_H5_UNWRITTEN, .rank = 3, .shape = {2, 3, 4}},
         "/views: only 0 of its 96 bytes were ever written"},
        {{.dataset = "/views", .storage = TEST_H5_CUT, .rank = 4, .shape = {2, 3, 4, 5}},
         "/views: only 1 of its 6 chunks were ever written"},
        {{.dataset = "/views",
          .storage = TEST_H5_UNWRITTEN,
          .rank = 4,
          .shape = {INT64_MAX / 2, 1 << 20, 16, 16}},
         "/views: its size passes 2^63 bytes"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        use("rec.h5");
        test_h5_make(path, &cases[i].spec);
        assert_refused(&(struct v2v_input_settings){0}, cases[i].reason);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void links_and_groups_in_the_datasets_place_are_refused(void **state)
{
    (void)state;
    const struct v2v_input_settings settings = {0};
    use("rec.h5");
    test_h5_link(path, "/views", "/etc/passwd", "/views");
    assert_refused(&settings, "/views: is a link to another file");
    use("rec.h5"); /* a soft link to an external one */
    test_h5_link(path, "/there", "other.h5", "/views");
    test_h5_link(path, "/views", NULL, "/there");
    assert_refused(&settings, "/views: is a link to another file");
    use("rec.h5");
    test_h5_link(path, "/views", NULL, "/views");
    assert_refused(&settings, "/views: can't be opened as a dataset");
    use("rec.h5");
    test_h5_group(path, "/views");
    assert_refused(&settings, "/views: can't be opened as a dataset");
}

static void attributes_that_contradict_are_refused(void **state)
{
    (void)state;
    const struct v2v_input_settings settings = {.views = 2};
    const struct test_h5_spec spec = {.dataset = "/views", .rank = 4, .shape = {3, 2, 3, 4}};
    use("rec.h5");
    test_h5_make(path, &spec);
    test_h5_text(path, "/views", "axes", "vtyx");
    assert_refused(&settings, "attribute axes says \"vtyx\"");
    use("rec.h5");
    test_h5_make(path, &spec);
    test_h5_text(path, "/views", "pixel_size_um", "0.5");
    assert_refused(&settings, "attribute pixel_size_um: is not 1 number");
    use("rec.h5");
    test_h5_make(path, &spec);
    test_h5_numbers(path, "/views", "frame_interval_s", (double[]){NAN}, 1);
    assert_refused(&settings, "attribute frame_interval_s: is not finite");
    use("rec.h5");
    test_h5_make(path, &spec);
    test_h5_numbers(path, "/views", "pixel_size_um", (double[]){-0.5}, 1);
    assert_refused(&settings, "attribute pixel_size_um: -0.5 is negative");
    use("rec.h5");
    test_h5_make(path, &spec);
    assert_refused(&(struct v2v_input_settings){.views = 13},
                   "/views has 2 views, but 13 are asked for");
}

static void a_nan_is_refused_with_frame_view_and_pixel(void **state)
{
    (void)state;
    double values[2 * 3 * 4 * 5] = {0};
    struct v2v_recording *recording = NULL;
    float views[3 * 4 * 5];
    values[((1 * 3 + 2) * 4 + 3) * 5 + 1] = NAN;
    use("rec.h5");
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/views",
                                              .storage = TEST_H5_CHUNKED,
                                              .rank = 4,
                                              .shape = {2, 3, 4, 5},
                                              .values = values});
    assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, NULL));
    assert_ok(v2v_recording_read(recording, views, 0));
    assert_int_equal(v2v_recording_read(recording, views, 1), V2V_E_INPUT);
    assert_says(path);
    assert_says("/views: NaN or Inf at frame 1, view 2, y 3, x 1");
    v2v_recording_close(&recording);
}

/* The bytes of `what` in the file, overwritten once. */
static void damage(const void *what, size_t bytes)
{
    static char content[65536];
    FILE *file = fopen(path, "r+b");
    assert_non_null(file);
    const size_t size = fread(content, 1, sizeof content, file);
    char *at = memmem(content, size, what, bytes);
    assert_non_null(at);
    assert_int_equal(fseek(file, (long)(at - content), SEEK_SET), 0);
    assert_int_equal(fputc(*at ^ 0x55, file), (*at ^ 0x55) & 0xff);
    assert_int_equal(fclose(file), 0);
}

static void a_checksum_mismatch_is_refused_with_its_reason(void **state)
{
    (void)state;
    double values[3 * 2 * 4];
    for (int i = 0; i < 24; i++) {
        values[i] = 1234.5 + i;
    }
    const float middle[4] = {1242.5f, 1243.5f, 1244.5f, 1245.5f}; /* frame 1 */
    const struct test_h5_spec spec = {.dataset = "/views",
                                      .storage = TEST_H5_CHECKED,
                                      .rank = 4,
                                      .shape = {3, 1, 2, 4},
                                      .values = values};
    struct v2v_recording *recording = NULL;
    float views[8];
    use("rec.h5");
    test_h5_make(path, &spec);
    damage(middle, sizeof middle);
    assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, NULL));
    assert_ok(v2v_recording_read(recording, views, 0));
    assert_int_equal(v2v_recording_read(recording, views, 1), V2V_E_INPUT);
    assert_says("/views: frame 1, view 0 can't be read: ");
    assert_says("Fletcher32");
    v2v_recording_close(&recording);
}

static void a_truncated_file_is_refused_at_every_length(void **state)
{
    (void)state;
    struct stat whole;
    use("rec.h5");
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/views",
                                              .storage = TEST_H5_CHUNKED,
                                              .rank = 4,
                                              .shape = {4, 3, 8, 8}});
    assert_int_equal(stat(path, &whole), 0);
    for (int part = 15; part >= 0; part--) {
        assert_int_equal(truncate(path, whole.st_size * part / 16), 0);
        assert_refused(&(struct v2v_input_settings){0}, part > 0 ? "is cut off: it has" : "");
    }
}

static void what_is_no_regular_file_is_refused(void **state)
{
    (void)state;
    const struct v2v_input_settings settings = {.views = 2};
    use("missing.h5");
    assert_refused(&settings, "");
    use("text.h5");
    assert_ok(v2v_file_write_text(path, "not HDF5 at all"));
    assert_refused(&settings, "is not an HDF5 file");
    use("pipe.h5");
    assert_int_equal(mkfifo(path, 0600), 0);
    assert_refused(&settings, "");
    snprintf(path, sizeof path, "%s", test_folder(NULL));
    assert_refused(&settings, "");
}

/* As netCDF's conventions have it: value = add_offset + scale_factor * stored. */
static void packed_numbers_of_hdf5_become_values(void **state)
{
    (void)state;
    static const struct {
        enum test_h5_type type;
        int has_scale, has_zero;
        double scale, zero;
        const char *reason; /* refused */
    } cases[] = {
        {TEST_H5_U16, 1, 1, 0.5, 100.0, NULL},
        {TEST_H5_U16, 1, 0, 0.25, 0.0, NULL},
        {TEST_H5_I16, 0, 1, 1.0, 32768.0, NULL},
        {TEST_H5_F32, 1, 1, -2.0, -3.0, NULL},
        {TEST_H5_U16, 1, 1, 1.0, 0.0, NULL},
        {TEST_H5_U16, 1, 0, 0.0, 0.0, "attribute scale_factor: 0 makes no values"},
        {TEST_H5_U16, 1, 0, 1e-60, 0.0, "attribute scale_factor: 1e-60 makes no values"},
        {TEST_H5_U16, 1, 0, NAN, 0.0, "attribute scale_factor: is not finite"},
        {TEST_H5_U16, 0, 1, 1.0, INFINITY, "attribute add_offset: is not finite"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct v2v_recording *recording = NULL;
        float views[3 * 2 * 4];
        use("packed.h5");
        test_h5_make(path, &(struct test_h5_spec){.dataset = "/views",
                                                  .type = cases[i].type,
                                                  .rank = 4,
                                                  .shape = {2, 3, 2, 4}});
        if (cases[i].has_scale) {
            test_h5_numbers(path, "/views", "scale_factor", &cases[i].scale, 1);
        }
        if (cases[i].has_zero) {
            test_h5_numbers(path, "/views", "add_offset", &cases[i].zero, 1);
        }
        if (cases[i].reason != NULL) {
            assert_refused(&(struct v2v_input_settings){0}, cases[i].reason);
            continue;
        }
        assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, NULL));
        assert_ok(v2v_recording_read(recording, views, 1));
        for (int e = 0; e < 24; e++) {
            assert_true(views[e] == (float)(cases[i].zero + cases[i].scale * (double)(24 + e)));
        }
        v2v_recording_close(&recording);
    }
}

static void values_beyond_float32_are_refused(void **state)
{
    (void)state;
    static const double large[8] = {1, 1, 1, 1, 1, -1e39, 1, 1};
    static const double step = 3e38;
    struct v2v_recording *recording = NULL;
    float views[8];
    for (int packed = 0; packed <= 1; packed++) {
        use(packed ? "packed.h5" : "large.h5");
        test_h5_make(path, &(struct test_h5_spec){.dataset = "/views",
                                                  .type = packed ? TEST_H5_U16 : TEST_H5_F64,
                                                  .rank = 3,
                                                  .shape = {1, 2, 4},
                                                  .values = packed ? NULL : large});
        if (packed) {
            test_h5_numbers(path, "/views", "scale_factor", &step, 1);
        }
        assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, NULL));
        assert_int_equal(v2v_recording_read(recording, views, 0), V2V_E_INPUT);
        assert_says(packed
                        ? "/views: scale_factor 3e+38 and add_offset 0 make values beyond float32"
                        : "/views: a number beyond float32 at frame 0, view 0, y 1, x 1");
        v2v_recording_close(&recording);
    }
}

static void a_sliding_window_crosses_the_frames_of_an_hdf5_file(void **state)
{
    (void)state;
    struct v2v_recording *recording = NULL;
    float views[3];
    double values[6] = {0, 1, 2, 3, 4, 5}; /* [t=2,v=3,1,1] */
    use("rec.h5");
    test_h5_make(path,
                 &(struct test_h5_spec){
                     .dataset = "/views", .rank = 4, .shape = {2, 3, 1, 1}, .values = values});
    assert_ok(v2v_recording_open(&recording, path,
                                 &(struct v2v_input_settings){.views = 3, .stride = 1}, NULL));
    assert_int_equal(v2v_recording_info(recording)->frames, 4);
    assert_ok(v2v_recording_read(recording, views, 2)); /* pages 2 3 4 */
    assert_true(views[0] == 3.0f && views[1] == 4.0f && views[2] == 2.0f);
    v2v_recording_close(&recording);
}

static void a_written_recording_is_read_back_to_the_bit(void **state)
{
    (void)state;
    const struct v2v_recording_info info = {.frames = 3,
                                            .views = 2,
                                            .height = 4,
                                            .width = 5,
                                            .pixel_size_um = 0.65,
                                            .apart = 1,
                                            .frame_interval_s = 0.1,
                                            .offset = 100.0};
    struct v2v_recording_writer *writer = NULL;
    struct v2v_recording *recording = NULL;
    float written[3][2 * 4 * 5], read[2 * 4 * 5];
    use("rec.h5");
    assert_ok(v2v_recording_create(&writer, path, &info, NULL));
    for (int t = 0; t < 3; t++) {
        for (int i = 0; i < 40; i++) {
            written[t][i] = (float)sin(0.1 * (40 * t + i)) * 1e3f;
        }
        assert_ok(v2v_recording_write(writer, written[t], t, 0, 1));
        assert_ok(v2v_recording_write(writer, written[t] + 20, t, 1, 1));
    }
    assert_false(v2v_file_exists(path));
    assert_ok(v2v_recording_finish(&writer));
    assert_null(writer);
    assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){.views = 2}, NULL));
    const struct v2v_recording_info *found = v2v_recording_info(recording);
    assert_memory_equal(found, &info, sizeof info);
    for (int t = 2; t >= 0; t--) {
        assert_ok(v2v_recording_read(recording, read, t));
        assert_memory_equal(read, written[t], sizeof read);
    }
    v2v_recording_close(&recording);
    assert_int_equal(v2v_mem_held(), 0);
}

static void nothing_is_invented_in_the_attributes(void **state)
{
    (void)state;
    static const double zeros[] = {0.0, (double)NAN}; /* a zero of 0 is a statement */
    for (size_t i = 0; i < sizeof zeros / sizeof *zeros; i++) {
        const struct v2v_recording_info info = {
            .frames = 1, .views = 1, .height = 2, .width = 2, .offset = zeros[i]};
        struct v2v_recording_writer *writer = NULL;
        struct v2v_recording *recording = NULL;
        float views[4] = {0};
        use("rec.h5");
        assert_ok(v2v_recording_create(&writer, path, &info, NULL));
        assert_ok(v2v_recording_write(writer, views, 0, 0, 1));
        assert_ok(v2v_recording_finish(&writer));
        assert_true(test_h5_has_attribute(path, "/views", "axes"));
        assert_false(test_h5_has_attribute(path, "/views", "pixel_size_um"));
        assert_false(test_h5_has_attribute(path, "/views", "frame_interval_s"));
        assert_int_equal(test_h5_has_attribute(path, "/views", "offset"), !isnan(zeros[i]));
        assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, NULL));
        assert_int_equal(isnan(v2v_recording_info(recording)->offset), isnan(zeros[i]));
        v2v_recording_close(&recording);
    }
}

static void an_abandoned_recording_leaves_the_old_file_alone(void **state)
{
    (void)state;
    const struct v2v_recording_info info = {.frames = 1, .views = 1, .height = 2, .width = 2};
    struct v2v_recording_writer *writer = NULL;
    char temporary[V2V_PATH_BYTES];
    use("rec.h5");
    assert_ok(v2v_file_write_text(path, "old"));
    assert_ok(v2v_recording_create(&writer, path, &info, NULL));
    v2v_recording_abandon(&writer);
    assert_null(writer);
    v2v_recording_abandon(&writer);
    assert_ok(v2v_file_temporary(temporary, path));
    assert_false(v2v_file_exists(temporary));
    struct stat old;
    assert_int_equal(stat(path, &old), 0);
    assert_int_equal(old.st_size, 3);
    use("no/such/folder.h5");
    assert_int_equal(v2v_recording_create(&writer, path, &info, NULL), V2V_E_IO);
    assert_null(writer);
    assert_int_equal(v2v_mem_held(), 0);
}

static void a_recording_larger_than_the_disk_is_refused_at_once(void **state)
{
    (void)state;
    const struct v2v_recording_info info = {
        .frames = INT64_C(1) << 30, .views = 13, .height = 512, .width = 512};
    struct v2v_recording_writer *writer = NULL;
    use("rec.h5");
    assert_int_equal(v2v_recording_create(&writer, path, &info, NULL), V2V_E_IO);
    assert_says("the disk has");
}

static void the_real_recording_has_its_known_counts(void **state)
{
    (void)state;
    const char *real = test_shared("recordings/vessels9.tif");
    struct v2v_recording *recording = NULL;
    float *views = NULL;
    double sum = 0.0, maximum = 0.0;
    if (real == NULL) {
        skip();
    }
    assert_ok(v2v_recording_open(&recording, real, &(struct v2v_input_settings){.views = 9}, NULL));
    const struct v2v_recording_info *info = v2v_recording_info(recording);
    assert_true(info->frames == 1 && info->views == 9 && info->height == 303 && info->width == 303);
    assert_ok(V2V_ALLOC(views, "test", INT64_C(9) * 303 * 303));
    assert_ok(v2v_recording_read(recording, views, 0));
    for (int64_t i = 0; i < INT64_C(9) * 303 * 303; i++) {
        sum += views[i];
        maximum = views[i] > maximum ? views[i] : maximum;
    }
    /* numpy on the same file; integers below 2^53 add exactly */
    assert_true(maximum == 62835.0);
    assert_true(fabs(sum / (9 * 303 * 303) - 5901.483684121988) < 1e-9);
    v2v_mem_free(views);
    v2v_recording_close(&recording);
}

/* Ways in which another program changes a file that is being read. */
static void cut_off(void)
{
    struct stat status;
    assert_int_equal(stat(path, &status), 0);
    assert_int_equal(truncate(path, status.st_size - 8), 0);
}

/* A byte of the pixels, which lie at the end. */
static void overwrite(void)
{
    FILE *file = fopen(path, "r+b");
    assert_non_null(file);
    assert_int_equal(fseek(file, -1, SEEK_END), 0);
    assert_int_equal(fputc(42, file), 42);
    assert_int_equal(fclose(file), 0);
}

static void replace(void)
{
    char other[600];
    snprintf(other, sizeof other, "%s.new", path);
    FILE *file = fopen(other, "wb");
    assert_non_null(file);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(rename(other, path), 0);
}

static void take_away(void)
{
    assert_int_equal(unlink(path), 0);
}

static void make_pages(void)
{
    const struct v2v_tiff_info info = {.pages = 6, .height = 2, .width = 2, .slices = 6};
    const float page[4] = {1, 2, 3, 4};
    struct v2v_tiff_writer *writer = NULL;
    assert_ok(v2v_tiff_create(&writer, path, &info));
    for (int64_t i = 0; i < info.pages; i++) {
        assert_ok(v2v_tiff_write_page(writer, page));
    }
    assert_ok(v2v_tiff_finish(&writer));
}

/* An old file: clocks of file systems tick some hundred times a second. */
static void make_old(void)
{
    const struct timespec times[2] = {{.tv_sec = 1000000000}, {.tv_sec = 1000000000}};
    assert_int_equal(utimensat(AT_FDCWD, path, times, 0), 0);
}

static void a_file_that_changes_while_it_is_read_is_refused(void **state)
{
    (void)state;
    static const struct {
        void (*change)(void);
        const char *words;
    } cases[] = {
        {cut_off, "changed while it was read: it was written to, had "},
        {overwrite, "changed while it was read: it was written to"},
        {replace, "changed while it was read: another file took its place"},
        {take_away, "changed while it was read: it is gone: No such file"},
    };
    static const char *const names[] = {"rec.h5", "rec.tif"};
    for (size_t i = 0; i < 2 * sizeof cases / sizeof cases[0]; i++) {
        struct v2v_recording *recording = NULL;
        float views[12];
        use(names[i % 2]);
        if (i % 2 == 0) {
            test_h5_make(path, &(struct test_h5_spec){
                                   .dataset = "/views", .rank = 4, .shape = {2, 3, 2, 2}});
        } else {
            make_pages();
        }
        make_old();
        assert_ok(
            v2v_recording_open(&recording, path, &(struct v2v_input_settings){.views = 3}, NULL));
        assert_ok(v2v_recording_read(recording, views, 1));
        cases[i / 2].change();
        assert_int_equal(v2v_recording_read(recording, views, 0), V2V_E_INPUT);
        assert_says(path);
        assert_says(cases[i / 2].words);
        v2v_recording_close(&recording);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(example_of_the_header),
        cmocka_unit_test(every_number_type_is_read_as_its_counts),
        cmocka_unit_test(unsuitable_datasets_are_refused_by_name_and_reason),
        cmocka_unit_test(links_and_groups_in_the_datasets_place_are_refused),
        cmocka_unit_test(attributes_that_contradict_are_refused),
        cmocka_unit_test(a_nan_is_refused_with_frame_view_and_pixel),
        cmocka_unit_test(a_checksum_mismatch_is_refused_with_its_reason),
        cmocka_unit_test(a_truncated_file_is_refused_at_every_length),
        cmocka_unit_test(what_is_no_regular_file_is_refused),
        cmocka_unit_test(packed_numbers_of_hdf5_become_values),
        cmocka_unit_test(values_beyond_float32_are_refused),
        cmocka_unit_test(a_sliding_window_crosses_the_frames_of_an_hdf5_file),
        cmocka_unit_test(a_written_recording_is_read_back_to_the_bit),
        cmocka_unit_test(nothing_is_invented_in_the_attributes),
        cmocka_unit_test(an_abandoned_recording_leaves_the_old_file_alone),
        cmocka_unit_test(a_recording_larger_than_the_disk_is_refused_at_once),
        cmocka_unit_test(a_file_that_changes_while_it_is_read_is_refused),
        cmocka_unit_test(the_real_recording_has_its_known_counts),
    };
    return cmocka_run_group_tests_name("recording", tests, NULL, NULL);
}
