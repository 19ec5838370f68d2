#include "support.h"

#include "h5_files.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/weights_file.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MOST_BYTES 65536

static char path[512];
static struct v2v_fields fields;
static size_t held_by_fields;
#define SETTINGS "model.width=32\nmodel.volume_scale=0.7\nmodel.kind=plain\n"
static const struct v2v_weights_info info = {.method = "some-net",
                                             .settings = SETTINGS,
                                             .split = "even-odd",
                                             .views = 13,
                                             .slices = 39,
                                             .step = 12345};

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

static int make_fields(void **state)
{
    (void)state;
    assert_ok(v2v_fields_add(&fields, NULL, "unet1.conv.0.weight", 4, (int64_t[]){3, 2, 3, 3}));
    assert_ok(v2v_fields_add(&fields, NULL, "unet1.conv.0.bias", 1, (int64_t[]){3}));
    held_by_fields = v2v_mem_held();
    return 0;
}

static int drop_fields(void **state)
{
    (void)state;
    v2v_fields_fini(&fields);
    return 0;
}

/* An arena whose padding stays zero. */
static float *arena_of(double factor)
{
    float *arena = NULL;
    assert_ok(V2V_ALLOC(arena, "test", fields.total));
    for (int64_t f = 0; f < fields.count && factor != 0.0; f++) {
        for (int64_t i = 0; i < fields.item[f].count; i++) {
            arena[fields.item[f].offset + i] = (float)(factor * cos((double)(100 * f + i)));
        }
    }
    return arena;
}

/* A checkpoint under `path`. */
static void write_checkpoint(const char *history, const char *config)
{
    float *arenas[3] = {arena_of(1.0), arena_of(0.1), arena_of(0.01)};
    assert_ok(v2v_weights_file_write(
        path, &info, &fields,
        (const float *const[V2V_WEIGHTS_GROUPS]){arenas[0], arenas[1], arenas[2]}, history,
        config));
    for (int i = 0; i < 3; i++) {
        v2v_mem_free(arenas[i]);
    }
}

static void assert_refused(const char *reason)
{
    float *arena = arena_of(0.0);
    assert_int_equal(v2v_weights_file_read(arena, path, "weights", &fields), V2V_E_INPUT);
    v2v_mem_free(arena);
    assert_says(path);
    assert_says(reason);
    assert_null(strchr(v2v_status_message(), '\n'));
}

static void a_checkpoint_is_read_back_to_the_bit(void **state)
{
    (void)state;
    static const struct {
        const char *group;
        double factor;
    } groups[] = {{"weights", 1.0}, {"adam_m", 0.1}, {"adam_v", 0.01}};
    struct v2v_weights_info found;
    char *text = NULL;
    use("w.h5");
    write_checkpoint("1 0.5\n2 0.25\n", "train:\n  steps: 3 # \xc2\xb5m\n");
    for (int i = 0; i < 3; i++) {
        float *expected = arena_of(groups[i].factor), *arena = arena_of(0.0);
        assert_ok(v2v_weights_file_read(arena, path, groups[i].group, &fields));
        assert_memory_equal(arena, expected, (size_t)fields.total * sizeof *arena);
        v2v_mem_free(arena);
        v2v_mem_free(expected);
    }
    memset(&found, 0, sizeof found);
    assert_ok(v2v_weights_file_info(&found, path));
    assert_true(found.views == 13 && found.slices == 39 && found.step == 12345);
    assert_string_equal(found.method, "some-net");
    assert_string_equal(found.settings, SETTINGS);
    assert_true(test_h5_attribute(path, "/", "width") == 32.0 &&
                test_h5_attribute(path, "/", "volume_scale") == 0.7);
    assert_string_equal(found.split, "even-odd");
    text = test_h5_string(path, "history");
    assert_string_equal(text, "1 0.5\n2 0.25\n");
    free(text);
    text = test_h5_string(path, "config");
    assert_string_equal(text, "train:\n  steps: 3 # \xc2\xb5m\n");
    free(text);
    assert_int_equal(v2v_mem_held(), held_by_fields);
}

static void levels_are_read_back_and_may_be_absent(void **state)
{
    (void)state;
    struct v2v_weights_info trained = info, found;
    float *arena = arena_of(1.0);
    const float *const group[V2V_WEIGHTS_GROUPS] = {arena};
    trained.levels.frames = 7;
    for (int f = 0; f < V2V_LEVEL_FIGURES; f++) {
        trained.levels.least[f] = 0.1 * (f + 1);
        trained.levels.most[f] = 0.3 * (f + 1);
    }
    use("levels.h5");
    assert_ok(v2v_weights_file_write(path, &trained, &fields, group, NULL, NULL));
    assert_ok(v2v_weights_file_info(&found, path));
    assert_memory_equal(&found.levels, &trained.levels, sizeof found.levels);
    use("without.h5");
    assert_ok(v2v_weights_file_write(path, &info, &fields, group, NULL, NULL));
    assert_ok(v2v_weights_file_info(&found, path));
    assert_int_equal(found.levels.frames, 0);
    v2v_mem_free(arena);
}

static void texts_may_be_absent_empty_or_long(void **state)
{
    (void)state;
    char *text = NULL, *history = malloc(1000001);
    assert_non_null(history);
    memset(history, 'h', 1000000);
    history[1000000] = '\0';
    use("w.h5");
    write_checkpoint(history, "");
    text = test_h5_string(path, "history");
    assert_string_equal(text, history);
    free(text);
    text = test_h5_string(path, "config");
    assert_string_equal(text, "");
    free(text);
    use("w.h5");
    write_checkpoint(NULL, NULL);
    text = test_h5_string(path, "config");
    assert_null(text);
    free(history);
    assert_int_equal(v2v_mem_held(), held_by_fields);
}

static void weights_without_moments_have_no_moments_to_read(void **state)
{
    (void)state;
    float *arena = arena_of(1.0);
    use("w.h5");
    assert_ok(v2v_weights_file_write(path, &info, &fields,
                                     (const float *const[V2V_WEIGHTS_GROUPS]){arena}, NULL, NULL));
    assert_int_equal(v2v_weights_file_read(arena, path, "adam_m", &fields), V2V_E_INPUT);
    assert_says("has no group /adam_m");
    v2v_mem_free(arena);
}

static void fields_that_do_not_fit_the_network_are_refused_by_name(void **state)
{
    (void)state;
    struct v2v_fields other = {0};
    float *arena = arena_of(1.0);
    assert_ok(v2v_fields_add(&other, NULL, "unet1.conv.0.weight", 4, (int64_t[]){3, 2, 3, 3}));
    use("w.h5");
    assert_ok(v2v_weights_file_write(path, &info, &other,
                                     (const float *const[V2V_WEIGHTS_GROUPS]){arena}, NULL, NULL));
    assert_refused("/weights/unet1.conv.0.bias: there is no such dataset");
    assert_ok(v2v_fields_add(&other, NULL, "unet1.conv.0.bias", 2, (int64_t[]){3, 1}));
    assert_ok(v2v_weights_file_write(path, &info, &other,
                                     (const float *const[V2V_WEIGHTS_GROUPS]){arena}, NULL, NULL));
    assert_refused("/weights/unet1.conv.0.bias: is not float [3], which this network needs");
    v2v_fields_fini(&other);
    arena[fields.item[1].offset + 2] = INFINITY;
    assert_ok(v2v_weights_file_write(path, &info, &fields,
                                     (const float *const[V2V_WEIGHTS_GROUPS]){arena}, NULL, NULL));
    assert_refused("/weights/unet1.conv.0.bias: element 2 is NaN or Inf");
    v2v_mem_free(arena);
}

/* Files of before there were methods: three attributes and no text. */
static void files_that_name_no_method_are_of_the_first_one(void **state)
{
    (void)state;
    struct v2v_weights_info found;
    use("w.h5");
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/x", .rank = 1, .shape = {3}});
    test_h5_numbers(path, "/", "views", (double[]){13}, 1);
    test_h5_numbers(path, "/", "slices", (double[]){39}, 1);
    test_h5_numbers(path, "/", "width", (double[]){64}, 1);
    assert_int_equal(v2v_weights_file_info(&found, path), V2V_E_INPUT);
    assert_says("attribute features: is missing: not a weight file");
    test_h5_numbers(path, "/", "features", (double[]){4}, 1);
    test_h5_numbers(path, "/", "volume_scale", (double[]){0.25}, 1);
    assert_ok(v2v_weights_file_info(&found, path));
    assert_string_equal(found.method, "v2v");
    assert_string_equal(found.settings,
                        "model.width=64\nmodel.features=4\nmodel.volume_scale=0.25\n");
    assert_string_equal(found.split, "even-odd");
}

static void files_that_are_no_weights_are_refused(void **state)
{
    (void)state;
    struct v2v_weights_info found;
    use("w.h5");
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/views", .rank = 3, .shape = {2, 3, 4}});
    assert_refused("has no group /weights");
    assert_int_equal(v2v_weights_file_info(&found, path), V2V_E_INPUT);
    assert_says("attribute views: is missing: not a weight file; it has /views; v2v3d train");
    use("arrays.h5");
    test_h5_group(path, "/weights");
    assert_int_equal(v2v_weights_file_info(&found, path), V2V_E_INPUT);
    assert_says("not a weight file; it has no dataset; v2v3d convert makes one");
    use("w.h5");
    test_h5_make(path, &(struct test_h5_spec){.dataset = "/views", .rank = 3, .shape = {2, 3, 4}});
    test_h5_numbers(path, "/", "format_version", (double[]){2}, 1);
    assert_refused("format 2 was written by a newer program");
    assert_int_equal(v2v_weights_file_info(&found, path), V2V_E_INPUT);
    assert_says("format 2 was written by a newer program");
    use("text.h5");
    assert_ok(v2v_file_write_text(path, "text"));
    assert_refused("is not an HDF5 file");
    use("missing.h5");
    assert_refused("");
}

static size_t load(char *content)
{
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    const size_t size = fread(content, 1, MOST_BYTES, file);
    assert_int_equal(fclose(file), 0);
    assert_true(size < MOST_BYTES);
    return size;
}

static void store(const char *content, size_t size)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(content, 1, size, file), size);
    assert_int_equal(fclose(file), 0);
}

/* Every 37th byte of the file flipped in turn: what is read is either refused or the same, bit by
 * bit. */
static void no_flipped_bit_changes_what_is_read(void **state)
{
    (void)state;
    static char content[MOST_BYTES];
    float *expected = arena_of(1.0), *arena = arena_of(0.0);
    struct v2v_weights_info found;
    int refused = 0;
    use("w.h5");
    write_checkpoint("history", "config");
    const size_t size = load(content);
    for (size_t at = 5; at < size; at += 37) {
        content[at] ^= 0x10;
        store(content, size);
        content[at] ^= 0x10;
        memset(&found, 0, sizeof found);
        const enum v2v_status rc = v2v_weights_file_info(&found, path);
        if (rc == V2V_OK) {
            assert_true(found.views == 13 && found.slices == 39 && found.step == 12345);
            assert_string_equal(found.method, info.method);
            assert_string_equal(found.settings, info.settings);
        }
        if (rc == V2V_OK && v2v_weights_file_read(arena, path, "weights", &fields) == V2V_OK) {
            assert_memory_equal(arena, expected, (size_t)fields.total * sizeof *arena);
        } else {
            assert_says(path);
            refused++;
        }
    }
    assert_true(refused > 10);
    v2v_mem_free(arena);
    v2v_mem_free(expected);
}

static void a_truncated_file_is_refused_at_every_length(void **state)
{
    (void)state;
    struct stat whole;
    use("w.h5");
    write_checkpoint("history", "config");
    assert_int_equal(stat(path, &whole), 0);
    for (int part = 15; part >= 0; part--) {
        assert_int_equal(truncate(path, whole.st_size * part / 16), 0);
        assert_refused("");
    }
}

static void a_failed_write_leaves_the_older_generation(void **state)
{
    (void)state;
    struct v2v_weights_info found;
    float *arena = arena_of(1.0);
    char temporary[V2V_PATH_BYTES];
    use("w.h5");
    write_checkpoint("history", "config");
    assert_ok(v2v_file_temporary(temporary, path));
    assert_int_equal(mkdir(temporary, 0700), 0); /* the temporary name is taken: create must fail */
    assert_int_equal(v2v_weights_file_write(path, &info, &fields,
                                            (const float *const[V2V_WEIGHTS_GROUPS]){arena}, NULL,
                                            NULL),
                     V2V_E_IO);
    assert_says(path);
    assert_int_equal(rmdir(temporary), 0);
    assert_ok(v2v_weights_file_info(&found, path));
    v2v_mem_free(arena);
    use("no/such/w.h5");
    arena = arena_of(1.0);
    assert_int_equal(v2v_weights_file_write(path, &info, &fields,
                                            (const float *const[V2V_WEIGHTS_GROUPS]){arena}, NULL,
                                            NULL),
                     V2V_E_IO);
    v2v_mem_free(arena);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_checkpoint_is_read_back_to_the_bit),
        cmocka_unit_test(levels_are_read_back_and_may_be_absent),
        cmocka_unit_test(texts_may_be_absent_empty_or_long),
        cmocka_unit_test(weights_without_moments_have_no_moments_to_read),
        cmocka_unit_test(fields_that_do_not_fit_the_network_are_refused_by_name),
        cmocka_unit_test(files_that_name_no_method_are_of_the_first_one),
        cmocka_unit_test(files_that_are_no_weights_are_refused),
        cmocka_unit_test(no_flipped_bit_changes_what_is_read),
        cmocka_unit_test(a_truncated_file_is_refused_at_every_length),
        cmocka_unit_test(a_failed_write_leaves_the_older_generation),
    };
    return cmocka_run_group_tests_name("weights_file", tests, make_fields, drop_fields);
}
