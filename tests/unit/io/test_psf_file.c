#include "support.h"

#include "capture.h"
#include "counted_stack.h"
#include "h5_files.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/io/tiff.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static char path[512];

static void use(const char *name)
{
    snprintf(path, sizeof path, "%s/%s", test_folder(NULL), name);
}

static void assert_refused(const char *reason)
{
    struct v2v_psf_file file;
    assert_int_equal(v2v_psf_file_read(&file, path, "", NULL), V2V_E_INPUT);
    assert_null(file.data);
    if (strstr(v2v_status_message(), path) == NULL ||
        strstr(v2v_status_message(), reason) == NULL ||
        strchr(v2v_status_message(), '\n') != NULL) {
        fail_msg("\"%s\" is not one line with %s and \"%s\"", v2v_status_message(), path, reason);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

/* psf_N.tif [slices,2,3] whose elements are N + 0.125 * index, in the folder `path`. */
static void put_stack_of(const char *name, int number, int64_t channels, int64_t slices,
                         int64_t frames, double pixel_size_um)
{
    const struct v2v_tiff_info info = {.pages = channels * slices * frames,
                                       .height = 2,
                                       .width = 3,
                                       .channels = channels,
                                       .slices = slices,
                                       .frames = frames,
                                       .bits = 32,
                                       .is_float = 1,
                                       .type_max = 1.0,
                                       .pixel_size_um = pixel_size_um,
                                       .slice_spacing_um = 2.0};
    char file[600];
    snprintf(file, sizeof file, "%s/%s", path, name);
    counting_stack(file, &info, (float)number, 0.125f);
}

static void put_stack(const char *name, int number, int64_t channels, int64_t slices,
                      int64_t frames)
{
    put_stack_of(name, number, channels, slices, frames, 0.5);
}

static void put_view(const char *name, int number, int64_t slices)
{
    put_stack(name, number, 1, slices, 1);
}

static void use_folder(int views)
{
    char name[32];
    snprintf(path, sizeof path, "%s", test_folder(NULL));
    for (int v = 1; v <= views; v++) {
        snprintf(name, sizeof name, "psf_%d.tif", v);
        put_view(name, v, 4);
    }
}

static void a_folder_is_read_in_the_order_of_its_numbers(void **state)
{
    (void)state;
    struct v2v_psf_file file;
    use_folder(11); /* by name psf_10 would come before psf_2 */
    put_view("psf_0.tif.bak", 1, 1);
    assert_ok(v2v_psf_file_read(&file, path, "", NULL));
    assert_true(file.views == 11 && file.slices == 4 && file.height == 2 && file.width == 3);
    for (int v = 0; v < 11; v++) {
        for (int i = 0; i < 24; i++) {
            assert_true(file.data[v * 24 + i] == (float)(v + 1) + 0.125f * (float)i);
        }
    }
    assert_true(fabs(file.pixel_size_um - 0.5) < 1e-6); /* TIFF states a fraction of ints */
    assert_true(file.slice_spacing_um == 2.0);
    v2v_psf_file_fini(&file);
    assert_int_equal(v2v_mem_held(), 0);
}

static void gaps_and_unequal_shapes_are_refused(void **state)
{
    (void)state;
    char third[600];
    use_folder(0);
    assert_refused("holds no psf_1.tif");
    put_view("other_1.tif", 1, 4);
    assert_refused("holds no psf_1.tif");
    use_folder(4);
    snprintf(third, sizeof third, "%s/psf_3.tif", path);
    assert_int_equal(unlink(third), 0);
    assert_refused("psf_3.tif: is missing, psf_4.tif is there");
    put_view("psf_3.tif", 3, 5);
    assert_refused("psf_3.tif: is 5 x 2 x 3, but psf_1.tif 4 x 2 x 3");
    put_view("psf_3.tif", 3, 4);
    put_view("psf_0.tif", 0, 4);
    assert_refused("holds psf_0.tif; the first view is psf_1.tif");
}

static void remove_view(const char *name)
{
    char file[600];
    snprintf(file, sizeof file, "%s/%s", path, name);
    assert_int_equal(unlink(file), 0);
}

static void views_are_found_however_number_and_ending_are_spelt(void **state)
{
    (void)state;
    static const char *const spelt[] = {"psf_5.tiff", "psf_5.TIF", "psf_5.Tiff", "psf_05.tif",
                                        "psf_005.TIFF"};
    for (size_t i = 0; i < sizeof spelt / sizeof spelt[0]; i++) {
        struct v2v_psf_file file;
        char text[128];
        use_folder(4);
        put_view(spelt[i], 5, 4);
        assert_ok(v2v_psf_file_read(&file, path, "", NULL));
        assert_int_equal(file.views, 5);
        assert_true(file.data[4 * 24] == 5.0f);
        v2v_psf_file_fini(&file);
        put_view("psf_5.tif", 5, 4);
        snprintf(text, sizeof text, "%s", spelt[i]);
        assert_refused(text);
        assert_refused("two of view 5");
        remove_view("psf_5.tif");
        remove_view("psf_4.tif");
        snprintf(text, sizeof text, "/psf_4.tif: is missing, %s is there", spelt[i]);
        assert_refused(text);
        remove_view(spelt[i]);
    }
    use_folder(1);
    put_view("psf_00.tif", 0, 4);
    assert_refused("holds psf_00.tif; the first view is psf_1.tif");
    remove_view("psf_00.tif");
}

static void what_is_nearly_called_a_view_is_warned_of(void **state)
{
    (void)state;
    static const char *const names[] = {
        "psf_5.tif.bak", "PSF_5.tif", "psf_5.ome.tif", "psf_-5.tif", "psf_99999999999999999999.tif",
        "psf_ 5.tif",    "psf_5.h5",  "psf_sum.tif"};
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        struct v2v_psf_file file;
        char text[1024];
        use_folder(4);
        put_view(names[i], 5, 4);
        test_capture_begin();
        const enum v2v_status rc = v2v_psf_file_read(&file, path, "", NULL);
        test_capture_end(text, sizeof text);
        assert_ok(rc);
        assert_int_equal(file.views, 4);
        assert_non_null(strstr(text, names[i]));
        v2v_psf_file_fini(&file);
        remove_view(names[i]);
    }
}

static void a_view_of_other_pixels_is_warned_of_by_its_name(void **state)
{
    (void)state;
    struct v2v_psf_file file;
    char text[1024];
    use_folder(4);
    put_stack_of("psf_3.tif", 3, 1, 4, 1, 0.65);
    test_capture_begin();
    const enum v2v_status rc = v2v_psf_file_read(&file, path, "", NULL);
    test_capture_end(text, sizeof text);
    assert_ok(rc);
    assert_non_null(strstr(text, "psf_3.tif: says pixels of 0.65 um, but psf_1.tif of 0.5"));
    assert_true(file.pixel_size_um == 0.5);
    v2v_psf_file_fini(&file);
}

static void a_psf_with_channels_or_frames_is_refused(void **state)
{
    (void)state;
    use_folder(1);
    put_stack("psf_1.tif", 1, 2, 2, 1);
    assert_refused("psf_1.tif: has 2 channels, 2 slices and 1 frames; a PSF has slices");
    put_stack("psf_1.tif", 1, 1, 2, 2);
    assert_refused("psf_1.tif: has 1 channels, 2 slices and 2 frames; a PSF has slices");
    put_stack("psf_1.tif", 1, 1, 1, 4);
    struct v2v_psf_file file;
    assert_ok(v2v_psf_file_read(&file, path, "", NULL));
    assert_int_equal(file.slices, 4);
    v2v_psf_file_fini(&file);
}

static void unsuitable_psfs_are_refused_with_their_place(void **state)
{
    (void)state;
    static const double negative[12] = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, -0.5, 1};
    static const double empty_view[12] = {1, 1, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0};
    static const double not_a_number[12] = {1, 1, 1, 1, 1, 1, 1, NAN, 1, 1, 1, 1};
    static const struct {
        struct test_h5_spec spec;
        const char *reason;
    } cases[] = {
        {{.dataset = "/psf", .rank = 4, .shape = {2, 1, 2, 3}, .values = negative},
         "view 1, slice 0, y 1, x 1: -0.5 is negative"},
        {{.dataset = "/psf", .rank = 4, .shape = {2, 1, 2, 3}, .values = empty_view},
         "view 1 is zero everywhere"},
        {{.dataset = "/psf", .rank = 4, .shape = {2, 1, 2, 3}, .values = not_a_number},
         "/psf: NaN or Inf at view 1, slice 0, y 0, x 1"},
        {{.dataset = "/psf", .rank = 3, .shape = {2, 2, 3}}, "/psf: has 3 axes, not [vzyx]"},
        {{.dataset = "/volume", .rank = 4, .shape = {1, 2, 2, 3}},
         "/psf: there is no such dataset"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        use("psf.h5");
        test_h5_make(path, &cases[i].spec);
        assert_refused(cases[i].reason);
    }
    use("psf.txt");
    assert_ok(v2v_file_write_text(path, "text"));
    assert_refused("is neither a folder of psf_1.tif .. psf_V.tif nor an HDF5 file");
    use("missing");
    assert_refused("");
}

/* Nothing of them matters: neither a shape, nor a NaN, nor that there is no light. */
static void views_that_are_not_used_are_not_read(void **state)
{
    (void)state;
    struct v2v_psf_file file;
    use_folder(4);
    put_view("psf_1.tif", 1, 5);
    put_view("psf_3.tif", -3, 3);
    assert_ok(v2v_psf_file_read(&file, path, "2, 0", NULL));
    assert_true(file.views == 2 && file.slices == 4);
    assert_true(file.data[0] == 2.0f && file.data[24] == 4.0f);
    v2v_psf_file_fini(&file);
    assert_int_equal(v2v_psf_file_read(&file, path, "4", NULL), V2V_E_CONFIG);
    assert_int_equal(v2v_psf_file_read(&file, path, "0", NULL), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "psf_3.tif: is 3 x 2 x 3, but psf_2.tif 4 x 2"));
    static const double values[4 * 6] = {NAN, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2,
                                         0,   0, 0, 0, 0, 0, 1, 1, 1, 1, 1, -3};
    use("psf.h5");
    test_h5_make(path, &(struct test_h5_spec){
                           .dataset = "/psf", .rank = 4, .shape = {4, 1, 2, 3}, .values = values});
    assert_ok(v2v_psf_file_read(&file, path, "3,2,0", NULL));
    assert_true(file.views == 1 && file.data[5] == 2.0f);
    v2v_psf_file_fini(&file);
    assert_int_equal(v2v_psf_file_read(&file, path, "0,3", NULL), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "view 2 is zero everywhere"));
    assert_int_equal(v2v_psf_file_read(&file, path, "0,2", NULL), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "view 3, slice 0, y 1, x 2: -3 is negative"));
    assert_int_equal(v2v_mem_held(), 0);
}

static void packed_psfs_become_values(void **state)
{
    (void)state;
    static const double scale = 0.5, zero = 3.0;
    struct v2v_psf_file file;
    use("psf.h5");
    test_h5_make(path,
                 &(struct test_h5_spec){
                     .dataset = "/psf", .type = TEST_H5_U16, .rank = 4, .shape = {2, 1, 2, 3}});
    test_h5_numbers(path, "/psf", "scale_factor", &scale, 1);
    test_h5_numbers(path, "/psf", "add_offset", &zero, 1);
    assert_ok(v2v_psf_file_read(&file, path, "", NULL));
    for (int i = 0; i < 12; i++) {
        assert_true(file.data[i] == 3.0f + 0.5f * (float)i);
    }
    v2v_psf_file_fini(&file);
}

static void empty_slices_and_any_kernel_size_are_fine(void **state)
{
    (void)state;
    static const int64_t sizes[][2] = {{1, 1}, {2, 3}, {4, 4}, {5, 2}};
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        const int64_t image = sizes[i][0] * sizes[i][1];
        double values[2 * 2 * 20] = {0};
        struct v2v_psf_file file;
        values[image] = 0.25;        /* view 0, slice 1 */
        values[2 * image] = 1.0e-30; /* view 1, slice 0 */
        use("psf.h5");
        test_h5_make(path, &(struct test_h5_spec){.dataset = "/psf",
                                                  .rank = 4,
                                                  .shape = {2, 2, sizes[i][0], sizes[i][1]},
                                                  .values = values});
        assert_ok(v2v_psf_file_read(&file, path, "", NULL));
        assert_true(file.data[image] == 0.25f && file.data[0] == 0.0f);
        v2v_psf_file_fini(&file);
    }
}

static void a_written_set_is_read_back_to_the_bit(void **state)
{
    (void)state;
    struct v2v_psf_file file, again;
    use_folder(3);
    assert_ok(v2v_psf_file_read(&file, path, "", NULL));
    file.pixel_size_um = 0.65;
    use("psf.h5");
    assert_ok(v2v_psf_file_write(&file, path));
    assert_ok(v2v_psf_file_read(&again, path, "", NULL));
    assert_memory_equal(again.data, file.data, 3 * 24 * sizeof *file.data);
    assert_true(again.pixel_size_um == 0.65 && again.slice_spacing_um == file.slice_spacing_um);
    v2v_psf_file_fini(&again);
    v2v_psf_file_fini(&file);
    assert_int_equal(v2v_mem_held(), 0);
}

static void real_psfs_have_their_known_shape_and_peak(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        int64_t shape[4];
        float peak; /* of the first view, by numpy */
    } cases[] = {{"psf/2psam", {13, 39, 128, 128}, 0.0009999999f},
                 {"psf/vessels9", {9, 57, 99, 99}, 0.01655491f}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const char *real = test_shared(cases[i].name);
        struct v2v_psf_file file;
        float peak = 0.0f;
        if (real == NULL) {
            skip();
        }
        assert_ok(v2v_psf_file_read(&file, real, "", NULL));
        assert_int_equal(file.views, cases[i].shape[0]);
        assert_int_equal(file.slices, cases[i].shape[1]);
        assert_int_equal(file.height, cases[i].shape[2]);
        assert_int_equal(file.width, cases[i].shape[3]);
        for (int64_t e = 0; e < file.slices * file.height * file.width; e++) {
            peak = file.data[e] > peak ? file.data[e] : peak;
        }
        assert_true(peak == cases[i].peak);
        v2v_psf_file_fini(&file);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_folder_is_read_in_the_order_of_its_numbers),
        cmocka_unit_test(gaps_and_unequal_shapes_are_refused),
        cmocka_unit_test(views_are_found_however_number_and_ending_are_spelt),
        cmocka_unit_test(what_is_nearly_called_a_view_is_warned_of),
        cmocka_unit_test(a_view_of_other_pixels_is_warned_of_by_its_name),
        cmocka_unit_test(a_psf_with_channels_or_frames_is_refused),
        cmocka_unit_test(unsuitable_psfs_are_refused_with_their_place),
        cmocka_unit_test(views_that_are_not_used_are_not_read),
        cmocka_unit_test(packed_psfs_become_values),
        cmocka_unit_test(empty_slices_and_any_kernel_size_are_fine),
        cmocka_unit_test(a_written_set_is_read_back_to_the_bit),
        cmocka_unit_test(real_psfs_have_their_known_shape_and_peak),
    };
    return cmocka_run_group_tests_name("psf_file", tests, NULL, NULL);
}
