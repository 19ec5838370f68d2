/* What is written for BigDataViewer: levels, numbers and the XML that tells of them. */
#include "support.h"

#include "h5_files.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/bdv.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { FRAMES = 2, SLICES = 5, HEIGHT = 131, WIDTH = 7, VOXELS = SLICES * HEIGHT * WIDTH };

static char path[512], data[V2V_PATH_BYTES];

/* Whole numbers of steps of 2; the brightest is 65535 of them. */
static float voxel(int64_t t, int64_t i)
{
    return i == VOXELS - 1 ? 65534.0f * 2.0f + 2.0f * (float)t
                           : 2.0f * (float)((i * 7919 + t * 13) % 65535);
}

static void write_and_export(const struct v2v_volume_storage *storage, double spacing)
{
    struct v2v_volume_writer *writer = NULL;
    struct v2v_volume *volume = NULL;
    const struct v2v_volume_info info = {.frames = FRAMES,
                                         .slices = SLICES,
                                         .height = HEIGHT,
                                         .width = WIDTH,
                                         .pixel_size_um = spacing > 0.0 ? 0.5 : 0.0,
                                         .slice_spacing_um = spacing};
    char source[600];
    float *frame = v2v_mem_alloc("test", VOXELS, sizeof *frame);
    assert_non_null(frame);
    snprintf(path, sizeof path, "%s/a & b<.xml", test_folder(NULL));
    snprintf(source, sizeof source, "%s.h5", path);
    assert_ok(v2v_volume_create(&writer, source, &info, 1u << V2V_VOLUME_MEAN, NULL, 0, NULL));
    for (int64_t t = 0; t < FRAMES; t++) {
        for (int64_t i = 0; i < VOXELS; i++) {
            frame[i] = voxel(t, i);
        }
        assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, frame, t, 0, SLICES));
    }
    assert_ok(v2v_volume_finish(&writer));
    v2v_mem_free(frame);
    assert_ok(v2v_volume_open(&volume, source, NULL, NULL));
    assert_ok(v2v_bdv_write(path, volume, storage));
    v2v_volume_close(&volume);
    assert_ok(v2v_bdv_data_name(data, path));
    assert_int_equal(v2v_mem_held(), 0);
}

static void assert_numbers(const char *name, const double *wanted, int64_t count)
{
    int64_t found = 0;
    double *numbers = test_h5_read(data, name, &found);
    assert_int_equal(found, count);
    for (int64_t i = 0; i < count; i++) {
        assert_true(numbers[i] == wanted[i]);
    }
    test_release(numbers);
}

/* Number i of cells, as uint16. */
static double number(const double *cells, int64_t i)
{
    return cells[i] < 0.0 ? cells[i] + 65536.0 : cells[i];
}

static void levels_hold_the_means_of_their_voxels(void **state)
{
    (void)state;
    static const struct v2v_volume_storage storages[] = {{.deflate = 0}, {.deflate = 2}};
    for (int s = 0; s < 2; s++) {
        int64_t count = 0;
        write_and_export(&storages[s], 0.5);
        assert_true(test_h5_attribute(data, "/s00", "scale_factor") == 2.0);
        assert_numbers("/s00/resolutions", (double[]){1, 1, 1, 2, 2, 2}, 6);
        assert_numbers("/s00/subdivisions", (double[]){7, 64, 5, 3, 64, 2}, 6);
        double *cells = test_h5_read(data, "/t00001/s00/0/cells", &count);
        assert_int_equal(count, VOXELS);
        for (int64_t i = 0; i < VOXELS; i++) {
            assert_true(number(cells, i) == 0.5 * (double)voxel(1, i));
        }
        double *coarse = test_h5_read(data, "/t00001/s00/1/cells", &count);
        assert_int_equal(count, 2 * 65 * 3);
        for (int64_t i = 0; i < count; i++) {
            const int64_t z = i / (65 * 3), y = i / 3 % 65, x = i % 3;
            double sum = 0.0;
            for (int part = 0; part < 8; part++) {
                sum += number(cells, ((2 * z + part / 4) * HEIGHT + 2 * y + part / 2 % 2) * WIDTH +
                                         2 * x + part % 2);
            }
            assert_true(fabs(number(coarse, i) - sum / 8.0) <= 0.5 + 1e-2);
        }
        test_release(coarse);
        test_release(cells);
    }
}

static void the_xml_names_the_data_and_its_voxels(void **state)
{
    (void)state;
    char text[8192] = "";
    write_and_export(&(struct v2v_volume_storage){.peak = 131070.0}, 2.0);
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    assert_true(fread(text, 1, sizeof text - 1, file) > 0);
    assert_int_equal(fclose(file), 0);
    static const char *const parts[] = {
        "<SpimData version=\"0.2\">",
        "<ImageLoader format=\"bdv.hdf5\">",
        "<hdf5 type=\"relative\">a &amp; b&lt;.bdv.h5</hdf5>",
        "<size>7 131 5</size>",
        "<unit>micrometer</unit>",
        "<size>0.5 0.5 2</size>",
        "<last>1</last>",
        "<ViewRegistration timepoint=\"1\" setup=\"0\">",
        "<affine>0.5 0 0 0 0 0.5 0 0 0 0 2 0</affine>",
    };
    for (size_t i = 0; i < sizeof parts / sizeof parts[0]; i++) {
        if (strstr(text, parts[i]) == NULL) {
            fail_msg("no \"%s\" in: %s", parts[i], text);
        }
    }
    write_and_export(&(struct v2v_volume_storage){.peak = 131070.0}, 0.0);
    file = fopen(path, "r");
    assert_non_null(file);
    memset(text, 0, sizeof text);
    assert_true(fread(text, 1, sizeof text - 1, file) > 0);
    assert_int_equal(fclose(file), 0);
    assert_non_null(strstr(text, "<unit>pixel</unit>"));
}

/* Slices that lie far apart are not joined before pixels are as wide. */
static void levels_end_where_a_plane_is_small_and_keep_voxels_alike(void **state)
{
    (void)state;
    struct v2v_bdv_level level[V2V_BDV_MOST_LEVELS];
    struct v2v_volume_info info = {.frames = 1,
                                   .slices = 39,
                                   .height = 1000,
                                   .width = 600,
                                   .pixel_size_um = 0.5,
                                   .slice_spacing_um = 2.0};
    assert_int_equal(v2v_bdv_levels(level, &info), 4);
    assert_true(level[2].factor[0] == 4 && level[2].factor[2] == 1 && level[3].factor[2] == 2);
    assert_true(level[3].size[0] == 75 && level[3].size[1] == 125 && level[3].size[2] == 19);
    info.height = info.width = 128;
    assert_int_equal(v2v_bdv_levels(level, &info), 1);
    info.width = INT64_C(1) << 40;
    assert_int_equal(v2v_bdv_levels(level, &info), V2V_BDV_MOST_LEVELS);
    assert_true(level[V2V_BDV_MOST_LEVELS - 1].size[1] == 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(levels_hold_the_means_of_their_voxels),
        cmocka_unit_test(the_xml_names_the_data_and_its_voxels),
        cmocka_unit_test(levels_end_where_a_plane_is_small_and_keep_voxels_alike),
    };
    return cmocka_run_group_tests_name("bdv", tests, NULL, NULL);
}
