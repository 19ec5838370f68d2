/* What a message says that an HDF5 file has: all of it where it is little, else what may be asked
 * for, and how much more there is. */
#include "h5_files.h"
#include "support.h"

#include "v2v3d/io/file.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

enum { PATH = 512, TEXT = 640 };

static char path[PATH], text[TEXT];

static void use(const char *name)
{
    snprintf(path, sizeof path, "%s/%s", test_folder(NULL), name);
    unlink(path);
}

static void make(const char *dataset, int rank)
{
    test_h5_make(path,
                 &(struct test_h5_spec){.dataset = dataset, .rank = rank, .shape = {2, 2, 2, 2}});
}

static void assert_has(const char *expected)
{
    assert_ok(v2v_file_hdf5_names(text, sizeof text, path));
    assert_string_equal(text, expected);
}

static void a_few_datasets_are_all_named_images_first(void **state)
{
    (void)state;
    use("few.h5");
    make("/checksum", 1);
    assert_has("has /checksum");
    make("/axis", 1);
    make("/done", 1);
    make("/stack", 4);
    make("/table", 2);
    test_h5_group(path, "/raw");
    make("/raw/a", 3);
    make("/raw/b", 3);
    test_h5_link(path, "/yonder", "other.h5", "/volume");
    assert_has("has /raw/a, /raw/b, /stack, /axis, /table, /yonder, /checksum, /done");
    use("none.h5");
    test_h5_group(path, "/raw");
    assert_has("has no dataset");
}

/* As a checkpoint has them: moments come first by name. */
static void of_many_a_few_of_each_group_are_named_and_the_others_counted(void **state)
{
    (void)state;
    static const char *const groups[] = {"/adam_m", "/adam_v", "/weights"};
    enum { GROUPS = 3, LAYERS = 20 };
    char name[64];
    use("many.h5");
    for (int g = 0; g < GROUPS; g++) {
        test_h5_group(path, groups[g]);
        for (int i = 0; i < 2 * LAYERS; i++) {
            snprintf(name, sizeof name, "%s/%02d.%s", groups[g], i / 2,
                     i % 2 == 0 ? "bias" : "weight");
            make(name, i % 2 == 0 ? 1 : 4);
        }
    }
    test_h5_make(path, &(struct test_h5_spec){
                           .dataset = "/config", .type = TEST_H5_STRING, .rank = 1, .shape = {1}});
    assert_has(
        "has /weights/00.weight, /weights/01.weight, /weights/02.weight, /config, "
        "/weights/00.bias, /weights/01.bias, /weights/02.bias, /adam_m/00.bias and 113 more");
    make("/volume", 3);
    assert_has("has /volume, /weights/00.weight, /weights/01.weight, /weights/02.weight, /config, "
               "/weights/00.bias, /weights/01.bias, /weights/02.bias and 114 more");
}

static void names_of_any_length_and_letters_are_one_short_line(void **state)
{
    (void)state;
    char name[200] = "/";
    use("long.h5");
    for (int i = 0; i < 12; i++) {
        memset(name + 1, 'a' + i, sizeof name - 2);
        name[2] = '\n';
        make(name, 3);
    }
    assert_ok(v2v_file_hdf5_names(text, sizeof text, path));
    assert_null(strchr(text, '\n'));
    assert_true(strlen(text) < TEXT - 1);
    assert_non_null(strstr(text, " and 4 more"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_few_datasets_are_all_named_images_first),
        cmocka_unit_test(of_many_a_few_of_each_group_are_named_and_the_others_counted),
        cmocka_unit_test(names_of_any_length_and_letters_are_one_short_line),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
