/* A bit that flips anywhere in a reconstructed volume's file: what is read of it is what was
 * written, or the frame is refused; nothing crashes. */
#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/volume.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

enum { FRAMES = 3, SLICES = 2, SIDE = 8, VOXELS = SLICES * SIDE * SIDE, MOST_BYTES = 1 << 16 };
enum { FLIPS = 150 };

/* The plain file, and the packed ones. */
static const struct v2v_volume_storage storages[] = {{.deflate = 0},
                                                     {.sample = V2V_SAMPLE_UINT16},
                                                     {.sample = V2V_SAMPLE_UINT16, .deflate = 2},
                                                     {.deflate = 2}};
static struct v2v_volume_info info = {
    .frames = FRAMES, .slices = SLICES, .height = SIDE, .width = SIDE, .pixel_size_um = 0.5};
static float expected[FRAMES][VOXELS]; /* as the whole file is read */
static char path[512];
static char content[MOST_BYTES];
static size_t size;

static float voxel(int set, int64_t t, int i)
{
    return (float)(1 + set) + 0.001f * (float)(t * VOXELS + i);
}

static void write_volume(void)
{
    const struct v2v_attribute task = {.name = V2V_VOLUME_TASK, .text = "0123456789abcdef"};
    const unsigned datasets = 1u << V2V_VOLUME_MEAN | 1u << V2V_VOLUME_BRANCH1;
    struct v2v_volume_writer *writer = NULL;
    float voxels[VOXELS];
    snprintf(path, sizeof path, "%s/volume.h5", test_folder(NULL));
    assert_ok(v2v_volume_create(&writer, path, &info, datasets, &task, 1, NULL));
    for (int64_t t = 0; t < FRAMES; t++) {
        for (int set = V2V_VOLUME_MEAN; set <= V2V_VOLUME_BRANCH1; set++) {
            for (int i = 0; i < VOXELS; i++) {
                voxels[i] = voxel(set, t, i);
            }
            assert_ok(v2v_volume_write(writer, set, voxels, t, 0, SLICES));
        }
        assert_ok(v2v_volume_mark_done(writer, t, NULL));
    }
    assert_ok(v2v_volume_finish(&writer));
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    size = fread(content, 1, sizeof content, file);
    assert_int_equal(fclose(file), 0);
    assert_true(size > FRAMES * VOXELS && size < sizeof content);
    struct v2v_volume *volume = NULL;
    assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
    for (int64_t t = 0; t < FRAMES; t++) {
        assert_ok(v2v_volume_read(volume, expected[t], t, 0, SLICES));
        for (int i = 0; i < VOXELS; i++) {
            assert_true(fabsf(expected[t][i] - voxel(V2V_VOLUME_MEAN, t, i)) < 1e-4f);
        }
    }
    v2v_volume_close(&volume);
}

static void write_content(void)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(content, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

/* Frames that were refused, all of them when the file was. @param wrong set when a frame was read
 * that was never written */
static int refused_frames(int *wrong)
{
    struct v2v_volume *volume = NULL;
    float voxels[VOXELS];
    int refused = 0;
    enum v2v_status rc = v2v_volume_open(&volume, path, NULL, NULL);
    if (rc != V2V_OK) {
        assert_non_null(strstr(v2v_status_message(), path));
        return rc == V2V_E_INPUT ? FRAMES : -1;
    }
    const struct v2v_volume_info *found = v2v_volume_info(volume);
    if (found->frames != FRAMES || found->slices != SLICES || found->height != SIDE ||
        found->width != SIDE) {
        const int64_t frame = v2v_mem_product(found->slices, found->height, found->width);
        float *other = frame < (1 << 20) ? v2v_mem_alloc("test", frame, sizeof *other) : NULL;
        *wrong |= other != NULL && v2v_volume_read(volume, other, 0, 0, found->slices) == V2V_OK;
        v2v_mem_free(other);
        v2v_volume_close(&volume);
        return FRAMES;
    }
    for (int64_t t = 0; t < FRAMES; t++) {
        rc = v2v_volume_read(volume, voxels, t, 1, 1); /* a part of it: the whole is looked at */
        if (rc == V2V_OK) {
            rc = v2v_volume_read(volume, voxels, t, 0, SLICES);
        }
        refused += rc != V2V_OK;
        for (int i = 0; rc == V2V_OK && i < VOXELS; i++) {
            *wrong |= voxels[i] != expected[t][i];
        }
    }
    v2v_volume_close(&volume);
    return refused;
}

static void flip_bits(void)
{
    int refusals = 0, wrong = 0;
    write_volume();
    assert_int_equal(refused_frames(&wrong), 0);
    assert_false(wrong);
    for (int n = 0; n < FLIPS; n++) {
        char *byte = &content[(size_t)n * size / FLIPS];
        *byte ^= (char)(1 << n % 8);
        write_content();
        const int refused = refused_frames(&wrong);
        assert_true(refused >= 0);
        if (wrong) {
            fail_msg("bit %d of byte %d: wrong voxels were read", n % 8, (int)(byte - content));
        }
        refusals += refused > 0;
        *byte ^= (char)(1 << n % 8);
    }
    print_message("%d of %d flips refused\n", refusals, FLIPS);
    assert_true(refusals > FLIPS / 4 && refusals < FLIPS);
}

static void a_flipped_bit_is_refused_or_changes_no_voxel(void **state)
{
    (void)state;
    for (size_t s = 0; s < sizeof storages / sizeof storages[0]; s++) {
        info.storage = storages[s];
        flip_bits();
    }
    info.storage = storages[0];
    assert_int_equal(v2v_mem_held(), 0);
}

/* One float of the third frame: the other frames are as good as before. */
static void the_damaged_frame_alone_is_refused_by_its_number(void **state)
{
    (void)state;
    struct v2v_volume *volume = NULL;
    float voxels[VOXELS];
    const float wanted = voxel(V2V_VOLUME_BRANCH1, 2, 0);
    size_t at = 0;
    write_volume();
    while (at < size && memcmp(content + at, &wanted, sizeof wanted) != 0) {
        at++;
    }
    assert_true(at < size);
    content[at] ^= 1;
    write_content();
    assert_ok(v2v_volume_open(&volume, path, NULL, NULL));
    assert_ok(v2v_volume_read(volume, voxels, 0, 0, SLICES));
    assert_ok(v2v_volume_read(volume, voxels, 1, 0, SLICES));
    assert_int_equal(v2v_volume_read(volume, voxels, 2, 0, SLICES), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), path));
    assert_non_null(strstr(v2v_status_message(), "frame 2 is damaged: its checksum doesn't hold"));
    v2v_volume_close(&volume);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_damaged_frame_alone_is_refused_by_its_number),
        cmocka_unit_test(a_flipped_bit_is_refused_or_changes_no_voxel),
    };
    return cmocka_run_group_tests_name("flipped_volume", tests, NULL, NULL);
}
