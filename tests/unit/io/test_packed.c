/* Volumes of integers, and compressed ones: what is read back, what is counted, and that a run
 * which ends in the middle of making one loses nothing. */
#include "support.h"

#include "h5_files.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/tiff.h"
#include "v2v3d/io/volume.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum { FRAMES = 3, SLICES = 4, HEIGHT = 9, WIDTH = 11 };
enum { VOXELS = SLICES * HEIGHT * WIDTH };

static const struct v2v_attribute task = {.name = V2V_VOLUME_TASK, .text = "0123456789abcdef"};
static const struct v2v_volume_storage integers = {.sample = V2V_SAMPLE_UINT16};
static const struct v2v_volume_storage small_integers = {.sample = V2V_SAMPLE_UINT16, .deflate = 2};
static const struct v2v_volume_storage small_floats = {.deflate = 6};
static const struct v2v_volume_storage plain = {.deflate = 0};
static char path[512];

static void use(const char *name)
{
    snprintf(path, sizeof path, "%s/%s", test_folder(NULL), name);
}

static struct v2v_volume_info stored(const struct v2v_volume_storage *storage)
{
    return (struct v2v_volume_info){.frames = FRAMES,
                                    .slices = SLICES,
                                    .height = HEIGHT,
                                    .width = WIDTH,
                                    .pixel_size_um = 0.5,
                                    .slice_spacing_um = 2.0,
                                    .frame_interval_s = 0.25,
                                    .storage = *storage};
}

/* From 0 to 40, the brightest voxel in the last frame. */
static float voxel(int set, int64_t t, int64_t i)
{
    return 40.0f * (float)pow((double)(t * VOXELS + i + set) / (FRAMES * VOXELS - 1 + set), 2.0);
}

static void write_frames(struct v2v_volume_writer *writer, unsigned datasets)
{
    float frame[VOXELS];
    for (int64_t t = 0; t < FRAMES; t++) {
        for (int set = 0; set < 4; set++) {
            for (int64_t i = 0; i < VOXELS; i++) {
                frame[i] = voxel(set, t, i);
            }
            if (datasets & 1u << set) {
                assert_ok(v2v_volume_put(writer, set, frame, t, 0, SLICES));
            }
        }
        assert_ok(v2v_volume_mark_done(writer, t, NULL));
    }
}

static enum v2v_status write_volume(const struct v2v_volume_storage *storage, unsigned datasets)
{
    struct v2v_volume_writer *writer = NULL;
    const struct v2v_volume_info info = stored(storage);
    assert_ok(v2v_volume_create(&writer, path, &info, datasets, &task, 1, NULL));
    write_frames(writer, datasets);
    const enum v2v_status rc = v2v_volume_finish(&writer);
    assert_null(writer);
    return rc;
}

static void assert_voxels(double bound)
{
    struct v2v_volume *volume = NULL;
    float frame[VOXELS];
    assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
    const struct v2v_volume_info *info = v2v_volume_info(volume);
    assert_true(info->frames == FRAMES && info->slices == SLICES);
    assert_true(info->pixel_size_um == 0.5 && info->slice_spacing_um == 2.0 &&
                info->frame_interval_s == 0.25);
    for (int64_t t = 0; t < FRAMES; t++) {
        assert_ok(v2v_volume_read(volume, frame, t, 0, SLICES));
        for (int64_t i = 0; i < VOXELS; i++) {
            assert_true(fabs((double)frame[i] - (double)voxel(0, t, i)) <= bound);
        }
    }
    v2v_volume_close(&volume);
}

/* The name of something beside the output. */
static const char *beside(const char *ending)
{
    static char name[sizeof path + 32];
    snprintf(name, sizeof name, "%s%s", path, ending);
    return name;
}

static void assert_nothing_beside(void)
{
    static const char *const endings[] = {".v2v3d-part", ".v2v3d-packed", ".v2v3d-lock",
                                          ".v2v3d-packed.v2v3d-part", ".v2v3d-packed.v2v3d-lock"};
    for (size_t i = 0; i < sizeof endings / sizeof endings[0]; i++) {
        assert_false(v2v_file_exists(beside(endings[i])));
    }
    assert_int_equal(v2v_mem_held(), 0);
}

/* Half a step, and the rounding of a float of 40 when the step is multiplied out again. */
static const double half_a_step = 40.0 / 65535.0 * 0.5 + 40.0 * 1.2e-7;

static void integers_are_within_half_a_step_of_the_brightest_voxel(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        const struct v2v_volume_storage *storage;
    } cases[] = {{"plain.h5", &integers},
                 {"small.h5", &small_integers},
                 {"stack.tif", &integers},
                 {"stack.ome.tif", &integers}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        use(cases[i].name);
        assert_ok(write_volume(cases[i].storage, 1u << V2V_VOLUME_MEAN));
        assert_voxels(half_a_step);
        assert_nothing_beside();
    }
}

/* The file of `path`; its bytes are followed by a 0. */
static const char *content(size_t *bytes)
{
    static char text[16384];
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    *bytes = fread(text, 1, sizeof text - 1, file);
    assert_int_equal(fclose(file), 0);
    text[*bytes] = '\0';
    return text;
}

/* To other programs in a description, of nine digits; to this one to the bit. */
static void tiff_says_the_step_of_its_integers(void **state)
{
    (void)state;
    static const struct {
        const char *name, *before, *after;
    } cases[] = {
        {"step.tif", "\ncf=0\nc0=0\nc1=", "\nvunit=counts\n"},
        {"step.ome.tif", "<Description>value = ", " * stored number</Description>"},
    };
    const double step = 40.0 / 65535.0;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct v2v_tiff *tiff = NULL;
        size_t bytes = 0;
        char *end = NULL;
        use(cases[i].name);
        assert_ok(write_volume(&integers, 1u << V2V_VOLUME_MEAN));
        const char *text = content(&bytes);
        const char *said = memmem(text, bytes, cases[i].before, strlen(cases[i].before));
        assert_non_null(said);
        const double found = strtod(said + strlen(cases[i].before), &end);
        assert_true(fabs(found / step - 1.0) <= 0.5e-8);
        assert_memory_equal(end, cases[i].after, strlen(cases[i].after));
        assert_ok(v2v_tiff_open(&tiff, path));
        assert_true(v2v_tiff_info(tiff)->step == step);
        v2v_tiff_close(&tiff);
    }
}

/* Fiji keeps the description, of nine digits, and neither `Software` nor the pages' names. */
static void integers_that_imagej_saved_again_keep_their_step(void **state)
{
    (void)state;
    struct v2v_tiff *tiff = NULL;
    static char text[16384];
    size_t bytes = 0;
    use("saved_again.tif");
    assert_ok(write_volume(&integers, 1u << V2V_VOLUME_MEAN));
    memcpy(text, content(&bytes), sizeof text);
    for (char *at = text; (at = memmem(at, bytes - (size_t)(at - text), "v2v3d;", 6)) != NULL;) {
        memcpy(at, "ImageJ", 6);
    }
    for (char *at = text; (at = memmem(at, bytes - (size_t)(at - text), "crc32c ", 7)) != NULL;) {
        memcpy(at, "a slice", 7);
    }
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(text, 1, bytes, file), bytes);
    assert_int_equal(fclose(file), 0);
    assert_ok(v2v_tiff_open(&tiff, path));
    assert_true(v2v_tiff_info(tiff)->step == 0.0 && v2v_tiff_info(tiff)->scale > 0.0);
    v2v_tiff_close(&tiff);
    assert_voxels(half_a_step + 40.0 * 0.5e-8);
}

/* The first frame, the recording and the offset, whatever is asked of the voxels. */
static void tiff_says_where_its_frames_come_from(void **state)
{
    (void)state;
    static const struct v2v_attribute from[] = {
        {.name = "program", .text = "v2v3d 1"},
        {.name = V2V_VOLUME_OFFSET, .number = 99.75},
        {.name = V2V_VOLUME_FIRST_FRAME, .number = 12345678},
        {.name = V2V_VOLUME_RECORDING, .text = "00112233445566ff"},
    };
    static const char *const names[] = {"from.tif", "from.ome.tif"};
    for (int i = 0; i < 4; i++) {
        struct v2v_volume_writer *writer = NULL;
        struct v2v_tiff *tiff = NULL;
        const struct v2v_volume_info info = stored(i / 2 ? &integers : &plain);
        use(names[i % 2]);
        assert_ok(v2v_volume_create(&writer, path, &info, 1u << V2V_VOLUME_MEAN, from,
                                    (int64_t)(sizeof from / sizeof from[0]), NULL));
        write_frames(writer, 1u << V2V_VOLUME_MEAN);
        assert_ok(v2v_volume_finish(&writer));
        assert_ok(v2v_tiff_open(&tiff, path));
        const struct v2v_tiff_info *found = v2v_tiff_info(tiff);
        assert_string_equal(found->told.task, "");
        assert_string_equal(found->told.first_frame, "12345678");
        assert_string_equal(found->told.recording_sum, "00112233445566ff");
        assert_string_equal(found->told.offset, "99.75");
        assert_true(found->step == (i / 2 ? 40.0 / 65535.0 : 0.0));
        v2v_tiff_close(&tiff);
    }
}

static void ome_tiff_says_what_it_holds(void **state)
{
    (void)state;
    struct v2v_tiff *tiff = NULL;
    size_t bytes = 0;
    use("floats.ome.tiff");
    assert_ok(write_volume(&plain, 1u << V2V_VOLUME_MEAN));
    assert_voxels(0.0);
    assert_nothing_beside();
    const char *text = content(&bytes);
    assert_true(memmem(text, bytes, "ImageJ", 6) == NULL &&
                memmem(text, bytes, "OME/2016-06", 11) != NULL);
    /* views are channels, and the planes go by channel first */
    const struct v2v_tiff_info views = {.pages = 6,
                                        .height = 1,
                                        .width = 1,
                                        .channels = 3,
                                        .frames = 2,
                                        .bits = 32,
                                        .is_float = 1,
                                        .is_ome = 1};
    struct v2v_tiff_writer *writer = NULL;
    use("views.ome.tif");
    assert_ok(v2v_tiff_create(&writer, path, &views));
    for (int i = 0; i < 6; i++) {
        assert_ok(v2v_tiff_write_page(writer, (float[]){(float)i}));
    }
    assert_ok(v2v_tiff_finish(&writer));
    assert_ok(v2v_tiff_open(&tiff, path));
    const struct v2v_tiff_info *info = v2v_tiff_info(tiff);
    assert_true(info->channels == 3 && info->slices == 1 && info->frames == 2);
    float page = -1.0f;
    assert_ok(v2v_tiff_read(tiff, &page, 4, 1));
    assert_true(page == 4.0f);
    v2v_tiff_close(&tiff);
    assert_true(v2v_tiff_is_ome_name("a.OME.TIF") && v2v_tiff_is_ome_name("a.ome.tiff"));
    assert_false(v2v_tiff_is_ome_name("a.tif") || v2v_tiff_is_ome_name("ome.tif") ||
                 v2v_tiff_is_ome_name("a.ome.h5") || v2v_tiff_is_ome_name(".tif"));
}

static void compressed_floats_are_read_back_to_the_bit(void **state)
{
    (void)state;
    use("floats.h5");
    assert_ok(write_volume(&small_floats, 1u << V2V_VOLUME_MEAN | 1u << V2V_VOLUME_BRANCH1));
    assert_voxels(0.0);
    assert_nothing_beside();
}

static void every_dataset_has_its_own_step_and_attributes_stay(void **state)
{
    (void)state;
    int64_t count = 0;
    use("sets.h5");
    assert_ok(write_volume(&small_integers, 1u << V2V_VOLUME_MEAN | 1u << V2V_VOLUME_BRANCH2));
    double *numbers = test_h5_read(path, "/branch2", &count);
    assert_int_equal(count, FRAMES * VOXELS);
    assert_true(numbers[count - 1] == 65535.0 &&
                numbers[1] ==
                    rint((double)voxel(2, 0, 1) / (double)voxel(2, 2, VOXELS - 1) * 65535.0));
    test_release(numbers);
    numbers = test_h5_read(path, "/done", &count);
    assert_true(count == FRAMES && numbers[0] == 1.0 && numbers[2] == 1.0);
    test_release(numbers);
    assert_voxels(half_a_step);
    const struct v2v_volume_info info = stored(&small_integers);
    assert_ok(v2v_volume_check(path, &info, 1u << V2V_VOLUME_MEAN | 1u << V2V_VOLUME_BRANCH2, &task,
                               1, NULL));
}

/* Voxel i of the last frame is above 20 from some i on, and none of the other frames' are. */
static void clipped_voxels_are_counted_by_frame(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    const struct v2v_volume_storage storage = {.sample = V2V_SAMPLE_UINT16, .peak = 20.0};
    const struct v2v_volume_info info = stored(&storage);
    float frame[VOXELS] = {0};
    int64_t count = 0;
    use("clipped.h5");
    assert_ok(v2v_volume_create(&writer, path, &info, 1u << V2V_VOLUME_MEAN, NULL, 0, NULL));
    for (int64_t t = 0; t < FRAMES; t++) {
        for (int64_t i = 0; i < t; i++) {
            frame[i] = i == 0 ? -1.0f : 21.0f;
        }
        frame[VOXELS - 1] = 20.0f; /* the peak itself is not beyond it */
        assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, frame, t, 0, SLICES));
    }
    assert_ok(v2v_volume_finish(&writer));
    double *clipped = test_h5_read(path, "/clipped", &count);
    assert_true(count == FRAMES && clipped[0] == 0.0 && clipped[1] == 1.0 && clipped[2] == 2.0);
    test_release(clipped);
    struct v2v_volume *volume = NULL;
    assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
    assert_ok(v2v_volume_read(volume, frame, 2, 0, SLICES));
    assert_true(frame[0] == 0.0f && fabsf(frame[1] - 20.0f) < 1e-5f && frame[2] == 0.0f);
    v2v_volume_close(&volume);
}

static void noise_that_does_not_shrink_is_stored_as_it_is(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    struct v2v_volume *volume = NULL;
    const struct v2v_volume_info info = stored(&small_floats);
    float frame[VOXELS], found[VOXELS];
    uint32_t bits = 1;
    for (int i = 0; i < VOXELS; i++) {
        bits = bits * 1664525u + 1013904223u;
        const uint32_t finite = bits & 0xbfffffffu; /* no exponent of infinity */
        memcpy(&frame[i], &finite, sizeof finite);
    }
    use("noise.h5");
    assert_ok(v2v_volume_create(&writer, path, &info, 1u << V2V_VOLUME_MEAN, &task, 1, NULL));
    for (int64_t t = 0; t < FRAMES; t++) {
        assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, frame, t, 0, SLICES));
        assert_ok(v2v_volume_mark_done(writer, t, NULL));
    }
    assert_ok(v2v_volume_finish(&writer));
    assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
    assert_ok(v2v_volume_read(volume, found, FRAMES - 1, 0, SLICES));
    assert_memory_equal(found, frame, sizeof frame);
    v2v_volume_close(&volume);
}

/* All frames are there when the run ends, and half a file of the pass. */
static void a_run_that_ends_in_the_pass_is_gone_on_with(void **state)
{
    (void)state;
    static const char *const names[] = {"resumed.h5", "resumed.tif"};
    for (size_t n = 0; n < sizeof names / sizeof names[0]; n++) {
        struct v2v_volume_writer *writer = NULL;
        struct v2v_volume_left left;
        const struct v2v_volume_info info = stored(&integers);
        use(names[n]);
        assert_ok(v2v_volume_resume(&writer, path, &info, 1, &task, 1, NULL));
        write_frames(writer, 1);
        v2v_volume_suspend(&writer);
        assert_ok(v2v_file_write_text(beside(".v2v3d-packed"), "half a file"));
        assert_ok(v2v_volume_left(&left, path, task.text));
        assert_true(left.done == FRAMES && left.is_same);
        assert_ok(v2v_volume_resume(&writer, path, &info, 1, &task, 1, NULL));
        for (int64_t t = 0; t < FRAMES; t++) {
            assert_true(v2v_volume_is_done(writer, t));
        }
        assert_ok(v2v_volume_finish(&writer));
        assert_voxels(half_a_step);
        assert_nothing_beside();
    }
}

/* A byte of the plain file, after its frame was marked and before the pass. */
static void what_was_damaged_before_the_pass_is_never_called_finished(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    const struct v2v_volume_info info = stored(&small_integers);
    const float wanted = voxel(0, 1, 5);
    float found = 0.0f;
    use("damaged.h5");
    assert_ok(v2v_volume_resume(&writer, path, &info, 1, &task, 1, NULL));
    write_frames(writer, 1);
    FILE *file = fopen(beside(".v2v3d-part"), "r+b");
    assert_non_null(file);
    for (long at = 0; found != wanted; at += 4) {
        assert_int_equal(fseek(file, at, SEEK_SET), 0);
        assert_int_equal(fread(&found, 1, sizeof found, file), sizeof found);
    }
    found *= 1.5f;
    assert_int_equal(fseek(file, -(long)sizeof found, SEEK_CUR), 0);
    assert_int_equal(fwrite(&found, 1, sizeof found, file), sizeof found);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(v2v_volume_finish(&writer), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "frame 1 is damaged"));
    assert_false(v2v_file_exists(path));
    assert_false(v2v_file_exists(beside(".v2v3d-packed")));
    assert_int_equal(unlink(beside(".v2v3d-part")), 0);
}

static void a_complete_file_of_another_storage_is_not_the_one_asked_for(void **state)
{
    (void)state;
    static const struct v2v_volume_storage of_other_peak = {.sample = V2V_SAMPLE_UINT16,
                                                            .peak = 41.0};
    static const struct v2v_volume_storage *const others[] = {&plain, &small_integers,
                                                              &small_floats, &of_other_peak};
    for (int tiff = 0; tiff <= 1; tiff++) {
        use(tiff ? "check.tif" : "check.h5");
        assert_ok(write_volume(&integers, 1));
        struct v2v_volume_info info = stored(&integers);
        assert_ok(v2v_volume_check(path, &info, 1, &task, 1, NULL));
        for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
            info = stored(others[i]);
            if (!tiff || info.storage.deflate == 0) {
                assert_int_equal(v2v_volume_check(path, &info, 1, &task, 1, NULL), V2V_E_INPUT);
                assert_non_null(strstr(v2v_status_message(), "is stored with another type"));
            }
        }
    }
}

static void a_compressed_tiff_is_a_usage_error(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    const struct v2v_volume_info info = stored(&small_floats);
    use("small.tif");
    assert_int_equal(v2v_volume_create(&writer, path, &info, 1, NULL, 0, NULL), V2V_E_USAGE);
    assert_non_null(strstr(v2v_status_message(), "compression needs an HDF5 file"));
    assert_nothing_beside();
}

static void a_volume_without_light_is_dark(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    struct v2v_volume *volume = NULL;
    const struct v2v_volume_info info = stored(&integers);
    float frame[VOXELS] = {0};
    use("dark.h5");
    assert_ok(v2v_volume_create(&writer, path, &info, 1, NULL, 0, NULL));
    for (int64_t t = 0; t < FRAMES; t++) {
        assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, frame, t, 0, SLICES));
    }
    assert_ok(v2v_volume_finish(&writer));
    assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
    assert_ok(v2v_volume_read(volume, frame, 1, 0, SLICES));
    assert_true(frame[0] == 0.0f && frame[VOXELS - 1] == 0.0f);
    v2v_volume_close(&volume);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(integers_are_within_half_a_step_of_the_brightest_voxel),
        cmocka_unit_test(tiff_says_the_step_of_its_integers),
        cmocka_unit_test(integers_that_imagej_saved_again_keep_their_step),
        cmocka_unit_test(tiff_says_where_its_frames_come_from),
        cmocka_unit_test(ome_tiff_says_what_it_holds),
        cmocka_unit_test(compressed_floats_are_read_back_to_the_bit),
        cmocka_unit_test(every_dataset_has_its_own_step_and_attributes_stay),
        cmocka_unit_test(clipped_voxels_are_counted_by_frame),
        cmocka_unit_test(noise_that_does_not_shrink_is_stored_as_it_is),
        cmocka_unit_test(a_run_that_ends_in_the_pass_is_gone_on_with),
        cmocka_unit_test(what_was_damaged_before_the_pass_is_never_called_finished),
        cmocka_unit_test(a_complete_file_of_another_storage_is_not_the_one_asked_for),
        cmocka_unit_test(a_compressed_tiff_is_a_usage_error),
        cmocka_unit_test(a_volume_without_light_is_dark),
    };
    return cmocka_run_group_tests_name("packed", tests, NULL, NULL);
}
