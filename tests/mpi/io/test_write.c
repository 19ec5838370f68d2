#include "support.h"

#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/file_sum.h"
#include "v2v3d/io/psf_file.h"
#include "v2v3d/io/scaling.h"
#include "v2v3d/io/volume.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define MEAN_ONLY (1u << V2V_VOLUME_MEAN)

static char path[512];

static void use(const char *name)
{
    snprintf(path, sizeof path, "%s/%s", test_folder(test_world()), name);
}

static int rank(void)
{
    return v2v_comm_rank(test_world());
}

static int size(void)
{
    return v2v_comm_size(test_world());
}

static size_t held_before;

static int remember_memory(void **state)
{
    (void)state;
    held_before = v2v_mem_held();
    return 0;
}

static int compare_memory(void **state)
{
    (void)state;
    return v2v_mem_held() == held_before ? 0 : -1;
}

/* A test that also fails when it keeps memory. */
#define balanced(test) cmocka_unit_test_setup_teardown(test, remember_memory, compare_memory)

/* More slices than ranks, fewer frames than the largest rank count. */
enum { FRAMES = 3, SLICES = 5, HEIGHT = 7, WIDTH = 9, IMAGE = HEIGHT * WIDTH };

static const struct v2v_volume_info shape = {
    .frames = FRAMES, .slices = SLICES, .height = HEIGHT, .width = WIDTH};

/* Image number n = t * SLICES + z of dataset d. */
static void fill(float *images, int d, int64_t n, int64_t count)
{
    for (int64_t i = 0; i < count * IMAGE; i++) {
        images[i] = (float)sin(0.01 * (double)(n * IMAGE + i) + d);
    }
}

static void assert_volume(void)
{
    struct v2v_volume *volume = NULL;
    float found[SLICES * IMAGE], expected[SLICES * IMAGE];
    assert_ok(v2v_volume_open(&volume, path, NULL, test_world()));
    assert_int_equal(v2v_volume_info(volume)->frames, FRAMES);
    assert_int_equal(v2v_volume_info(volume)->slices, SLICES);
    /* every rank reads another frame first: reading is no collective */
    for (int n = 0; n < FRAMES; n++) {
        const int64_t t = (n + rank()) % FRAMES;
        assert_ok(v2v_volume_read(volume, found, t, 0, SLICES));
        fill(expected, V2V_VOLUME_MEAN, t * SLICES, SLICES);
        assert_memory_equal(found, expected, sizeof found);
    }
    v2v_volume_close(&volume);
}

/* All ranks share each frame's slices: uneven parts, and empty ones for ranks 2 and up of a frame
 * of which only two slices are left to write. */
static void write_shared_frames(struct v2v_volume_writer *writer, int dataset)
{
    float images[SLICES * IMAGE];
    for (int64_t t = 0; t < FRAMES; t++) {
        const struct v2v_part most = v2v_par_part(3, size(), rank());
        const struct v2v_part rest = v2v_par_part(2, size(), size() - 1 - rank());
        fill(images, dataset, t * SLICES + most.first, most.count);
        assert_ok(v2v_volume_write(writer, dataset, images, t, most.first, most.count));
        fill(images, dataset, t * SLICES + 3 + rest.first, rest.count);
        assert_ok(v2v_volume_write(writer, dataset, images, t, 3 + rest.first, rest.count));
    }
}

/* Rank r writes frames r, r + size, ..; in the last round some ranks have none. */
static void write_own_frames(struct v2v_volume_writer *writer, int mark)
{
    float images[SLICES * IMAGE];
    for (int64_t first = 0; first < FRAMES; first += size()) {
        const int64_t t = first + size() - 1 - rank(); /* the lower rank holds the later frame */
        const int mine = t < FRAMES;
        fill(images, V2V_VOLUME_MEAN, t * SLICES, SLICES);
        assert_ok(v2v_volume_write(writer, V2V_VOLUME_MEAN, mine ? images : NULL, mine ? t : 0, 0,
                                   mine ? SLICES : 0));
        if (mark && mine) {
            assert_ok(v2v_volume_mark_done(writer, t, NULL));
        }
    }
}

static void slices_of_all_ranks_make_the_frames(void **state)
{
    (void)state;
    static const char *const names[] = {"vol.h5", "vol.tif"};
    for (int i = 0; i < 2; i++) {
        struct v2v_volume_writer *writer = NULL;
        use(names[i]);
        assert_ok(v2v_volume_create(&writer, path, &shape, MEAN_ONLY, NULL, 0, test_world()));
        write_shared_frames(writer, V2V_VOLUME_MEAN);
        /* Rank 0 alone can tell: once it goes on, the file may appear before the others look. */
        assert_false(rank() == 0 && v2v_file_exists(path));
        assert_ok(v2v_volume_finish(&writer));
        assert_volume();
    }
}

static void frames_of_different_ranks_make_the_volume(void **state)
{
    (void)state;
    static const char *const names[] = {"vol.h5", "vol.tif"};
    for (int i = 0; i < 2; i++) {
        struct v2v_volume_writer *writer = NULL;
        use(names[i]);
        assert_ok(v2v_volume_create(&writer, path, &shape, MEAN_ONLY, NULL, 0, test_world()));
        write_own_frames(writer, 1);
        assert_ok(v2v_volume_finish(&writer));
        assert_volume();
    }
}

static void attributes_come_from_rank_0_whatever_the_others_pass(void **state)
{
    (void)state;
    char text[64];
    snprintf(text, sizeof text, "%.*s", 1 + 20 * rank(), "rank rank rank rank rank rank rank rank");
    const struct v2v_attribute attributes[] = {{.name = "host", .text = text},
                                               {.name = "rank", .number = 7.0 + rank()}};
    const unsigned all = MEAN_ONLY | 1u << V2V_VOLUME_BRANCH1 | 1u << V2V_VOLUME_BRANCH2 |
                         1u << V2V_VOLUME_UNCERTAINTY;
    struct v2v_volume_writer *writer = NULL;
    use("vol.h5");
    assert_ok(v2v_volume_create(&writer, path, &shape, all, attributes, 2, test_world()));
    for (int d = 0; d < 4; d++) {
        write_shared_frames(writer, d);
    }
    assert_ok(v2v_volume_finish(&writer));
    assert_volume();
    assert_true(test_h5_attribute(path, "/", "rank") == 7.0);
    int64_t count = 0;
    double *values = test_h5_read(path, "/branch2", &count);
    float expected[IMAGE];
    fill(expected, V2V_VOLUME_BRANCH2, 0, 1);
    assert_int_equal(count, FRAMES * SLICES * IMAGE);
    assert_true((float)values[1] == expected[1]);
    test_release(values);
}

static void views_of_all_ranks_make_the_recording(void **state)
{
    (void)state;
    const struct v2v_recording_info info = {
        .frames = FRAMES, .views = SLICES, .height = HEIGHT, .width = WIDTH, .pixel_size_um = 0.5};
    struct v2v_recording_writer *writer = NULL;
    struct v2v_recording *recording = NULL;
    float views[SLICES * IMAGE], expected[SLICES * IMAGE];
    use("rec.h5");
    assert_ok(v2v_recording_create(&writer, path, &info, test_world()));
    for (int64_t t = 0; t < FRAMES; t++) {
        const struct v2v_part part = v2v_par_part(SLICES, size(), rank());
        fill(views, 0, t * SLICES + part.first, part.count);
        assert_ok(v2v_recording_write(writer, views, t, part.first, part.count));
    }
    assert_ok(v2v_recording_finish(&writer));
    assert_ok(v2v_recording_open(&recording, path, &(struct v2v_input_settings){.views = SLICES},
                                 test_world()));
    for (int64_t t = 0; t < FRAMES; t++) {
        fill(expected, 0, t * SLICES, SLICES);
        assert_ok(v2v_recording_read(recording, views, t));
        assert_memory_equal(views, expected, sizeof views);
    }
    v2v_recording_close(&recording);
}

static void the_scaling_has_the_same_bits_at_any_rank_count(void **state)
{
    (void)state;
    const struct v2v_recording_info info = {
        .frames = FRAMES, .views = SLICES, .height = HEIGHT, .width = WIDTH};
    struct v2v_recording_writer *writer = NULL;
    struct v2v_recording *recording = NULL;
    struct v2v_scaling together, alone;
    const struct v2v_input_settings settings = {.views = SLICES};
    float views[SLICES * IMAGE];
    use("rec.h5");
    assert_ok(v2v_recording_create(&writer, path, &info, test_world()));
    for (int64_t t = 0; t < FRAMES; t++) {
        fill(views, 2, t * SLICES, SLICES); /* its mean is positive */
        for (int i = 0; i < SLICES * IMAGE; i++) {
            views[i] += 1.0f;
        }
        assert_ok(v2v_recording_write(writer, views, t, 0, rank() == 0 ? SLICES : 0));
    }
    assert_ok(v2v_recording_finish(&writer));
    assert_ok(v2v_recording_open(&recording, path, &settings, test_world()));
    assert_ok(v2v_scaling_decide(&together, recording, &settings, test_world()));
    assert_ok(v2v_scaling_decide(&alone, recording, &settings, NULL));
    assert_memory_equal(&together, &alone, sizeof alone);
    v2v_recording_close(&recording);
}

static void a_bad_input_is_the_same_failure_on_every_rank(void **state)
{
    (void)state;
    struct v2v_recording *recording = NULL;
    struct v2v_volume *volume = NULL;
    struct v2v_psf_file psf;
    use("bad.h5");
    if (rank() == 0) {
        assert_ok(v2v_file_write_text(path, "text"));
    }
    v2v_par_barrier(test_world());
    assert_int_equal(
        v2v_recording_open(&recording, path, &(struct v2v_input_settings){0}, test_world()),
        V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "is not an HDF5 file"));
    assert_int_equal(v2v_volume_open(&volume, path, NULL, test_world()), V2V_E_INPUT);
    assert_int_equal(v2v_psf_file_read(&psf, path, "", test_world()), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), path));
}

static void an_output_without_a_folder_fails_on_every_rank(void **state)
{
    (void)state;
    static const char *const names[] = {"no/vol.h5", "no/vol.tif"};
    for (int i = 0; i < 2; i++) {
        struct v2v_volume_writer *writer = NULL;
        use(names[i]);
        assert_int_equal(v2v_volume_create(&writer, path, &shape, MEAN_ONLY, NULL, 0, test_world()),
                         V2V_E_IO);
        assert_null(writer);
    }
}

/* As where a node has a folder of that name for itself: an error, and no wait in MPI-IO. */
static void an_output_that_one_rank_does_not_see_fails_on_every_rank(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    char temporary[V2V_PATH_BYTES];
    if (size() == 1) {
        return;
    }
    use(rank() == size() - 1 ? "elsewhere.h5" : "vol.h5");
    assert_int_equal(v2v_volume_create(&writer, path, &shape, MEAN_ONLY, NULL, 0, test_world()),
                     V2V_E_IO);
    assert_null(writer);
    assert_non_null(strstr(v2v_status_message(), "is not seen here"));
    assert_ok(v2v_file_temporary(temporary, path));
    v2v_par_barrier(test_world()); /* rank 0 has taken it away */
    assert_false(v2v_file_exists(temporary));
}

static void an_abandoned_volume_leaves_nothing(void **state)
{
    (void)state;
    static const char *const names[] = {"vol.h5", "vol.tif"};
    for (int i = 0; i < 2; i++) {
        struct v2v_volume_writer *writer = NULL;
        char temporary[V2V_PATH_BYTES];
        use(names[i]);
        assert_ok(v2v_volume_create(&writer, path, &shape, MEAN_ONLY, NULL, 0, test_world()));
        write_own_frames(writer, 0);
        v2v_volume_abandon(&writer);
        v2v_par_barrier(test_world());
        assert_ok(v2v_file_temporary(temporary, path));
        assert_false(v2v_file_exists(path) || v2v_file_exists(temporary));
    }
}

/* One attempt of a task: frames from..to-1 that are not done yet, slices shared by the ranks. */
static enum v2v_status attempt(const char *task, int64_t from, int64_t to, int expected_done)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_attribute attribute = {.name = V2V_VOLUME_TASK, .text = task};
    const struct v2v_part part = v2v_par_part(SLICES, size(), rank());
    struct v2v_volume_writer *writer = NULL;
    float images[SLICES * IMAGE];
    int done = 0;
    V2V_TRY(v2v_volume_resume(&writer, path, &shape, MEAN_ONLY, &attribute, 1, test_world()));
    for (int64_t t = 0; t < FRAMES; t++) {
        done += v2v_volume_is_done(writer, t);
        if (v2v_volume_is_done(writer, t) || t < from || t >= to) {
            continue;
        }
        fill(images, V2V_VOLUME_MEAN, t * SLICES + part.first, part.count);
        V2V_TRY(v2v_volume_write(writer, V2V_VOLUME_MEAN, images, t, part.first, part.count));
        V2V_TRY(v2v_volume_mark_done(writer, t, test_world()));
    }
    assert_int_equal(done, expected_done);
    if (to == FRAMES) {
        V2V_TRY(v2v_volume_finish(&writer));
    }
done:
    v2v_volume_suspend(&writer);
    return rc;
}

/* The last rank alone puts and marks two frames; the others suspend at once. */
static void a_rank_marks_frames_that_the_others_know_nothing_of(void **state)
{
    (void)state;
    const struct v2v_attribute attribute = {.name = V2V_VOLUME_TASK, .text = "own frames"};
    struct v2v_volume_writer *writer = NULL;
    float images[SLICES * IMAGE];
    use("own.h5");
    assert_ok(v2v_volume_resume(&writer, path, &shape, MEAN_ONLY, &attribute, 1, test_world()));
    for (int64_t t = 0; t < 2 && rank() == size() - 1; t++) {
        fill(images, V2V_VOLUME_MEAN, t * SLICES, SLICES);
        assert_ok(v2v_volume_put(writer, V2V_VOLUME_MEAN, images, t, 0, 1));
        assert_ok(v2v_volume_put(writer, V2V_VOLUME_MEAN, images + IMAGE, t, 1, SLICES - 1));
        assert_ok(v2v_volume_mark_done(writer, t, NULL));
    }
    v2v_volume_suspend(&writer);
    assert_ok(attempt("own frames", 2, FRAMES, 2));
    assert_volume();
}

/* One byte of the last image of frame 1, which is the last that was written. */
static void damage_the_file(void)
{
    char temporary[V2V_PATH_BYTES];
    float last[IMAGE], image[IMAGE];
    fill(last, V2V_VOLUME_MEAN, 2 * SLICES - 1, 1);
    assert_ok(v2v_file_temporary(temporary, path));
    FILE *file = fopen(temporary, "r+be");
    assert_non_null(file);
    long at = 0;
    do { /* images lie at multiples of four bytes */
        assert_int_equal(fseek(file, at, SEEK_SET), 0);
        assert_int_equal(fread(image, 1, sizeof image, file), sizeof image);
        at += 4;
    } while (memcmp(image, last, sizeof image) != 0);
    assert_int_equal(fseek(file, at, SEEK_SET), 0);
    assert_int_equal(fputc('?', file), '?');
    assert_int_equal(fclose(file), 0);
}

static void an_interrupted_volume_is_gone_on_with_frame_by_frame(void **state)
{
    (void)state;
    use("vol.h5");
    assert_ok(attempt("one", 0, 2, 0));
    assert_false(v2v_file_exists(path));
    assert_ok(attempt("one", 2, FRAMES, 2));
    assert_volume();
    /* another task than the file's begins anew */
    assert_ok(attempt("one", 0, 2, 0));
    assert_ok(attempt("two", 0, FRAMES, 0));
    assert_volume();
}

static void a_frame_whose_data_were_damaged_is_not_done(void **state)
{
    (void)state;
    use("vol.h5");
    assert_ok(attempt("one", 0, 2, 0));
    v2v_par_barrier(test_world());
    if (rank() == 0) {
        damage_the_file();
    }
    v2v_par_barrier(test_world());
    assert_ok(attempt("one", 0, FRAMES, 1));
    assert_volume();
}

/* Where its structure is damaged what is written to one frame lies in another one's place. */
static void a_volume_that_was_gone_on_with_is_read_before_it_has_its_name(void **state)
{
    (void)state;
    const struct v2v_attribute attribute = {.name = V2V_VOLUME_TASK, .text = "one"};
    struct v2v_volume_writer *writer = NULL;
    use("vol.h5");
    assert_ok(attempt("one", 0, 2, 0));
    assert_ok(attempt("one", 2, FRAMES - 1, 2));
    assert_ok(v2v_volume_resume(&writer, path, &shape, MEAN_ONLY, &attribute, 1, test_world()));
    v2v_par_barrier(test_world());
    if (rank() == 0) {
        damage_the_file();
    }
    v2v_par_barrier(test_world());
    assert_int_equal(v2v_volume_finish(&writer), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "frame 1 is not what was written to it"));
    assert_false(v2v_file_exists(path));
    assert_ok(attempt("one", 0, FRAMES, FRAMES - 2));
    assert_volume();
}

static void two_writers_of_one_file_are_refused(void **state)
{
    (void)state;
    struct v2v_volume_writer *first = NULL, *second = NULL;
    use("vol.h5");
    assert_ok(v2v_volume_create(&first, path, &shape, MEAN_ONLY, NULL, 0, test_world()));
    assert_int_equal(v2v_volume_create(&second, path, &shape, MEAN_ONLY, NULL, 0, test_world()),
                     V2V_E_BUSY);
    assert_null(second);
    write_own_frames(first, 1);
    assert_ok(v2v_volume_finish(&first));
    assert_volume();
}

/* A task is gone on with on any number of ranks: so is the sum of its recording the same. */
static void a_file_has_one_sum_on_any_ranks(void **state)
{
    (void)state;
    enum { BYTES = (5 << 24) + 7 }; /* five pieces and a bit */
    const off_t places[] = {0, (off_t)1 << 24, BYTES - 1};
    uint64_t alone = 0, together = 0, seen[4] = {0};
    use("bytes");
    for (int i = 0; i < 4; i++) { /* zeros; then one byte after the other is not */
        if (rank() == 0) {
            int file = open(path, O_RDWR | O_CREAT, 0600);
            assert_true(file >= 0 && ftruncate(file, BYTES) == 0);
            assert_true(i == 0 || pwrite(file, "x", 1, places[i - 1]) == 1);
            assert_int_equal(close(file), 0);
        }
        v2v_par_barrier(test_world());
        assert_ok(v2v_file_sum(&alone, path, NULL));
        assert_ok(v2v_file_sum(&together, path, test_world()));
        assert_true(alone == together);
        for (int k = 0; k < i; k++) {
            assert_true(seen[k] != together);
        }
        seen[i] = together;
        v2v_par_barrier(test_world());
    }
}

/* The last rank's host has other bytes under the name, in the middle of a piece or at an end, or no
 * file at all: as where nodes keep copies of their own. */
static void a_file_that_is_another_on_one_rank_is_refused(void **state)
{
    (void)state;
    enum { BYTES = 40000 };
    static const struct {
        int64_t bytes, changed; /* of the last rank's; -1: none is */
        enum v2v_status expected;
    } cases[] = {{BYTES, -1, V2V_OK},
                 {BYTES, BYTES / 2, V2V_E_INPUT},
                 {BYTES - 1, -1, V2V_E_INPUT},
                 {0, -1, V2V_E_INPUT}};
    char content[BYTES], name[32];
    const int is_other = rank() == size() - 1 && size() > 1;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const int64_t bytes = is_other ? cases[i].bytes : BYTES;
        memset(content, 'v', sizeof content);
        if (is_other && cases[i].changed >= 0) {
            content[cases[i].changed] = 'w';
        }
        snprintf(name, sizeof name, "own%d", rank());
        use(name);
        unlink(path);
        if (bytes > 0) {
            FILE *file = fopen(path, "wbe");
            assert_non_null(file);
            assert_int_equal(fwrite(content, 1, (size_t)bytes, file), bytes);
            assert_int_equal(fclose(file), 0);
        }
        assert_int_equal(v2v_file_agree(path, test_world()),
                         size() > 1 ? cases[i].expected : V2V_OK);
    }
}

/* .. by whatever opens it. */
static void a_volume_that_is_another_on_one_rank_is_refused(void **state)
{
    (void)state;
    struct v2v_volume_writer *writer = NULL;
    struct v2v_volume *volume = NULL;
    float images[FRAMES * SLICES * IMAGE];
    char name[32];
    snprintf(name, sizeof name, "own%d.tif", rank());
    use(name);
    fill(images, rank() == size() - 1, 0, FRAMES * SLICES);
    assert_ok(v2v_volume_create(&writer, path, &shape, MEAN_ONLY, NULL, 0, NULL));
    for (int t = 0; t < FRAMES; t++) {
        assert_ok(
            v2v_volume_write(writer, V2V_VOLUME_MEAN, images + t * SLICES * IMAGE, t, 0, SLICES));
    }
    assert_ok(v2v_volume_finish(&writer));
    assert_int_equal(v2v_volume_open(&volume, path, NULL, test_world()),
                     size() > 1 ? V2V_E_INPUT : V2V_OK);
    v2v_volume_close(&volume);
}

static void every_rank_gets_the_psfs(void **state)
{
    (void)state;
    float data[2 * 3 * 4 * 5];
    const struct v2v_psf_file written = {
        .views = 2, .slices = 3, .height = 4, .width = 5, .pixel_size_um = 0.5, .data = data};
    struct v2v_psf_file read;
    for (int i = 0; i < 120; i++) {
        data[i] = (float)i;
    }
    use("psf.h5");
    if (rank() == 0) {
        assert_ok(v2v_psf_file_write(&written, path));
    }
    v2v_par_barrier(test_world());
    assert_ok(v2v_psf_file_read(&read, path, "", test_world()));
    assert_true(read.views == 2 && read.slices == 3 && read.height == 4 && read.width == 5);
    assert_true(read.pixel_size_um == 0.5 && read.slice_spacing_um == 0.0);
    assert_memory_equal(read.data, data, sizeof data);
    v2v_psf_file_fini(&read);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        balanced(slices_of_all_ranks_make_the_frames),
        balanced(frames_of_different_ranks_make_the_volume),
        balanced(a_rank_marks_frames_that_the_others_know_nothing_of),
        balanced(attributes_come_from_rank_0_whatever_the_others_pass),
        balanced(views_of_all_ranks_make_the_recording),
        balanced(the_scaling_has_the_same_bits_at_any_rank_count),
        balanced(a_bad_input_is_the_same_failure_on_every_rank),
        balanced(an_output_without_a_folder_fails_on_every_rank),
        balanced(an_output_that_one_rank_does_not_see_fails_on_every_rank),
        balanced(an_abandoned_volume_leaves_nothing),
        balanced(an_interrupted_volume_is_gone_on_with_frame_by_frame),
        balanced(a_volume_that_was_gone_on_with_is_read_before_it_has_its_name),
        balanced(a_frame_whose_data_were_damaged_is_not_done),
        balanced(two_writers_of_one_file_are_refused),
        balanced(a_file_has_one_sum_on_any_ranks),
        balanced(a_file_that_is_another_on_one_rank_is_refused),
        balanced(a_volume_that_is_another_on_one_rank_is_refused),
        balanced(every_rank_gets_the_psfs),
    };
    return test_mpi_main(tests, argc, argv);
}
