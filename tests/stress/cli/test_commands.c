/* The commands on recordings of any size of number: finite volumes in the recording's units, or a
 * clear refusal. */
#include "hard_input.h"
#include "program.h"

#include "v2v3d/io/tiff.h"
#include "v2v3d/io/volume.h"
#include "v2v3d/tensor/statistics.h"

#include <string.h>

enum { PIXELS = SIDE * SIDE, VOXELS = SLICES * PIXELS, ITERATIONS = 5 };
enum { BAD_FRAME = 1, BAD_VIEW = 2, BAD_Y = 17, BAD_X = 5 };
enum { HOT = BAD_VIEW * PIXELS + BAD_Y * SIDE + BAD_X };

static enum test_hard which;

static float hard(int t, int64_t i)
{
    return test_hard_sample(which, i + t, SIDE, HOT);
}

/* Both frames of a volume, in double precision: a float32 of 1e-40 has no reciprocal. */
static void read_volume(const struct scene *scene, const char *name, double *voxels)
{
    static float slices[VOXELS];
    struct v2v_volume *volume = NULL;
    assert_ok(v2v_volume_open(&volume, program_file(scene, name), NULL, NULL));
    for (int t = 0; t < FRAMES; t++) {
        assert_ok(v2v_volume_read(volume, slices, t, 0, SLICES)); /* refuses NaN and Inf */
        for (int i = 0; i < VOXELS; i++) {
            voxels[t * VOXELS + i] = (double)slices[i];
        }
    }
    v2v_volume_close(&volume);
}

struct command {
    const char *name, *words, *output;
    double squares; /* of the roundings, in u; see below */
    double plain[FRAMES * VOXELS];
};

/* Against the volume of the recording x 1, scaled; u = 2^-24. Recorded values, gain and their
 * product round once each, 3 u. The network rounds sums of n <= 9 * 8 * 4 + 9 * 140 products in
 * 18 + 14 layers, each u sqrt(n / 2), for either recording; an update of RLD, one a view and
 * iteration, rounds in 2 transforms of 10 stages and 8 stages more, 2 u each, for either; an
 * iteration of total variation in as much and some 20 steps on each of 3 differences, whose sum is
 * divided by penalties that are 25 times apart. All roundings independent. */
static struct command commands[] = {
    {.name = "reconstruct",
     .words = "reconstruct -c config.yaml --psf psf.h5 --weights w.h5 --input hard.h5 --force -o ",
     .output = "network.h5",
     .squares = 2.0 * 32.0 * 1548.0 / 2.0},
    {.name = "deconvolve",
     .words = "deconvolve --method rld --psf psf.h5 --input hard.h5 --iterations 5 --force -o ",
     .output = "rld.h5",
     .squares = 2.0 * ITERATIONS * VIEWS * 28.0 * 4.0},
    {.name = "total variation",
     .words = "deconvolve --psf psf.h5 --input hard.h5 --iterations 5 --force -o ",
     .output = "tv.h5",
     .squares = 2.0 * ITERATIONS * (28.0 * 4.0 + 25.0 * 25.0 * 3.0 * 20.0 * 4.0)},
};
enum { COMMANDS = sizeof commands / sizeof *commands };

static double bound_of(const struct command *command)
{
    return (3.0 + sqrt(command->squares)) * 0x1p-24;
}

static int run_command(const struct scene *scene, const struct command *command, char *text)
{
    char words[PATH];
    snprintf(words, sizeof words, "%s%s", command->words, command->output);
    return program_run(scene, 1, words, text);
}

static double scale_of(enum test_hard input)
{
    static const double scales[TEST_HARD_INPUTS] = {[TEST_HARD_1E_6] = 1e-6,
                                                    [TEST_HARD_1E_3] = 1e-3,
                                                    [TEST_HARD_1] = 1.0,
                                                    [TEST_HARD_1E3] = 1e3,
                                                    [TEST_HARD_1E6] = 1e6};
    return scales[input];
}

/* Prints and judges one command's share of the row. */
static void judge(const struct scene *scene, struct command *command)
{
    static char text[TEXT];
    static double voxels[FRAMES * VOXELS];
    double most = 0.0, error = 0.0, size = 0.0, scale = scale_of(which);
    int code = run_command(scene, command, text);
    if (code != 0) {
        print_message(" | %4d %9s %9s", code, "-", "-");
        /* No gain brings nothing, or next to nothing, to 0.2. */
        assert_true(which == TEST_HARD_ZERO || which == TEST_HARD_SUBNORMAL);
        assert_int_equal(code, v2v_status_exit_code(V2V_E_INPUT));
        assert_non_null(strstr(text, "input.gain"));
        return;
    }
    read_volume(scene, command->output, voxels);
    for (int i = 0; i < FRAMES * VOXELS; i++) {
        most = fmax(most, fabs(voxels[i]));
        if (which == TEST_HARD_1) {
            command->plain[i] = voxels[i];
        }
        double d = voxels[i] - scale * command->plain[i];
        error += d * d;
        size += scale * command->plain[i] * scale * command->plain[i];
    }
    assert_true(which == TEST_HARD_ZERO ? most == 0.0 : most > 0.0);
    if (scale == 0.0) {
        print_message(" | %4d %9.2e %9s", code, most, "-");
        return;
    }
    print_message(" | %4d %9.2e %9.1e", code, most, sqrt(error / size));
    assert_true(sqrt(error / size) <= bound_of(command));
}

static void volumes_are_finite_and_carry_the_recordings_units(void **state)
{
    (void)state;
    static char text[TEXT];
    struct scene scene;
    program_init(&scene);
    if (program_run(&scene, 1, "weights init --psf psf.h5 --width 4 --rule kaiming -o w.h5",
                    text) != 0) {
        fail_msg("%s", text);
    }
    print_message("%-10s | %4s %9s %9s | %4s %9s %9s\n%-10s | %24.1e | %24.1e\n", "recording",
                  "exit", "largest", "off", "exit", "largest", "off", "bound",
                  bound_of(&commands[0]), bound_of(&commands[1]));
    for (int i = 0; i < TEST_HARD_INPUTS; i++) {
        static const enum test_hard first[] = {TEST_HARD_1, TEST_HARD_1E_6, TEST_HARD_1E_3};
        which = i < 3 ? first[i] : (enum test_hard)i;
        scene_record(&scene, "hard.h5", hard);
        print_message("%-10s", test_hard_name(which));
        for (int c = 0; c < COMMANDS; c++) {
            judge(&scene, &commands[c]);
        }
        print_message("\n");
    }
    scene_fini(&scene);
}

/* ---- one NaN ---- */

static float not_a_number(int t, int64_t i)
{
    return t == BAD_FRAME && i == HOT ? NAN : scene_wave(t, i);
}

/* The same recording as pages of a TIFF file. */
static void write_pages(const struct scene *scene, const char *name)
{
    static float page[PIXELS];
    struct v2v_tiff_writer *writer = NULL;
    const struct v2v_tiff_info info = {
        .pages = FRAMES * VIEWS, .slices = FRAMES * VIEWS, .height = SIDE, .width = SIDE};
    assert_ok(v2v_tiff_create(&writer, program_file(scene, name), &info));
    for (int p = 0; p < FRAMES * VIEWS; p++) {
        for (int64_t i = 0; i < PIXELS; i++) {
            page[i] = not_a_number(p / VIEWS, p % VIEWS * PIXELS + i);
        }
        assert_ok(v2v_tiff_write_page(writer, page));
    }
    assert_ok(v2v_tiff_finish(&writer));
}

static void a_nan_ends_every_command_with_its_place(void **state)
{
    static const char *const words[] = {
        "reconstruct -c config.yaml --psf psf.h5 --weights w.h5 -o out.h5 --input ",
        "deconvolve --psf psf.h5 -o out.h5 --input ",
        "train -c config.yaml --psf psf.h5 -o out --input ",
    };
    static const char *const files[] = {"nan.h5", "nan.tif"};
    static char text[TEXT];
    struct scene scene;
    (void)state;
    program_init(&scene);
    assert_int_equal(program_run(&scene, 1, "weights init --psf psf.h5 --width 4 -o w.h5", text),
                     0);
    scene_record(&scene, "nan.h5", not_a_number);
    write_pages(&scene, "nan.tif");
    for (size_t i = 0; i < 6; i++) {
        char command[PATH], frame[32], view[32];
        const char *file = files[i / 3];
        snprintf(command, sizeof command, "%s%s", words[i % 3], file);
        int code = program_run(&scene, 1, command, text);
        snprintf(frame, sizeof frame, "frame %d", BAD_FRAME);
        snprintf(view, sizeof view, "view %d", BAD_VIEW);
        if (code != v2v_status_exit_code(V2V_E_INPUT) || strstr(text, file) == NULL ||
            strstr(text, frame) == NULL || strstr(text, view) == NULL ||
            strstr(text, "17") == NULL || strstr(text, "NaN") == NULL) {
            fail_msg("%s: exit code %d\n%s", command, code, text);
        }
        assert_false(v2v_file_exists(program_file(&scene, "out.h5")));
    }
    scene_fini(&scene);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(volumes_are_finite_and_carry_the_recordings_units),
        cmocka_unit_test(a_nan_ends_every_command_with_its_place),
    };
    return PROGRAM_OR_TESTS(tests, argc, argv);
}
