#include "support.h"

#include "io/file_internal.h"
#include "v2v3d/base/memory.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static char folder[256];

/* A path in the test's folder; the last four stay valid. */
static const char *in_folder(const char *name)
{
    static char paths[4][512];
    static int next;
    char *path = paths[next++ % 4];

    (void)snprintf(path, sizeof paths[0], "%s/%s", folder, name);
    return path;
}

static void put(const char *path, const char *text)
{
    FILE *stream = fopen(path, "we");
    assert_non_null(stream);
    assert_true(fputs(text, stream) >= 0);
    assert_int_equal(fclose(stream), 0);
}

static void assert_holds(const char *path, const char *text)
{
    char found[256] = "";
    FILE *stream = fopen(path, "re");
    assert_non_null(stream);
    size_t bytes = fread(found, 1, sizeof found - 1, stream);
    found[bytes] = '\0';
    assert_int_equal(fclose(stream), 0);
    assert_string_equal(found, text);
}

static void only_a_readable_regular_file_is_an_input(void **state)
{
    (void)state;
    const char *file = in_folder("input");
    const char *pipe_path = in_folder("pipe");

    put(file, "x");
    assert_int_equal(mkfifo(pipe_path, 0600), 0);
    assert_ok(v2v_file_check_input(file));
    const char *bad[] = {in_folder("absent"), folder, pipe_path, "/dev/zero", ""};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(v2v_file_check_input(bad[i]), V2V_E_INPUT);
        assert_non_null(strstr(v2v_status_message(), bad[i]));
    }
    assert_true(v2v_file_exists(file));
    assert_false(v2v_file_exists(bad[0]));
    assert_true(v2v_file_is_folder(folder));
    assert_false(v2v_file_is_folder(file));
}

static void an_existing_output_needs_force(void **state)
{
    (void)state;
    const char *file = in_folder("output");

    assert_ok(v2v_file_check_output(file, 0, NULL, 0));
    put(file, "x");
    assert_int_equal(v2v_file_check_output(file, 0, NULL, 0), V2V_E_USAGE);
    assert_non_null(strstr(v2v_status_message(), "--force"));
    assert_ok(v2v_file_check_output(file, 1, NULL, 0));
}

static void an_output_never_replaces_an_input(void **state)
{
    (void)state;
    const char *file = in_folder("both");
    const char *link_path = in_folder("link");
    const char *temporary = in_folder("next.v2v3d-part");

    put(file, "x");
    put(temporary, "x");
    assert_int_equal(symlink(file, link_path), 0);
    const char *inputs[] = {"/dev/null", file, temporary};
    assert_int_equal(v2v_file_check_output(file, 1, inputs, 3), V2V_E_USAGE);
    assert_int_equal(v2v_file_check_output(link_path, 1, inputs, 3), V2V_E_USAGE);
    assert_int_equal(v2v_file_check_output(in_folder("next"), 1, inputs, 3), V2V_E_USAGE);
}

static void an_output_needs_a_folder_and_is_none(void **state)
{
    (void)state;
    assert_int_equal(v2v_file_check_output(in_folder("no/such"), 0, NULL, 0), V2V_E_IO);
    assert_int_equal(v2v_file_check_output(folder, 1, NULL, 0), V2V_E_USAGE);
    assert_int_equal(v2v_file_check_output("/dev/null", 1, NULL, 0), V2V_E_USAGE);
    assert_int_equal(v2v_file_check_output("", 1, NULL, 0), V2V_E_USAGE);
}

static void a_name_that_is_too_long_is_refused(void **state)
{
    (void)state;
    char temporary[V2V_PATH_BYTES];
    static char name[V2V_PATH_BYTES];

    memset(name, 'a', sizeof name - 1);
    assert_int_equal(v2v_file_temporary(temporary, name), V2V_E_INPUT);
    name[V2V_PATH_BYTES - sizeof ".v2v3d-part"] = '\0';
    assert_ok(v2v_file_temporary(temporary, name));
}

static void commit_renames_and_cleans_up_after_failure(void **state)
{
    (void)state;
    const char *temporary = in_folder("done.tmp");
    const char *path = in_folder("done");

    put(temporary, "new");
    put(path, "old");
    assert_ok(v2v_file_commit(temporary, path));
    assert_holds(path, "new");
    assert_false(v2v_file_exists(temporary));

    put(temporary, "newer");
    assert_int_equal(v2v_file_commit(temporary, in_folder("no/such")), V2V_E_IO);
    assert_false(v2v_file_exists(temporary));
    assert_int_equal(v2v_file_commit(in_folder("absent.tmp"), path), V2V_E_IO);
    assert_holds(path, "new");
}

static void folders_are_made_with_their_parents(void **state)
{
    (void)state;
    const char *deep = in_folder("a/b//c/");

    assert_ok(v2v_file_make_folder(deep));
    assert_ok(v2v_file_make_folder(deep));
    assert_true(v2v_file_is_folder(deep));
    put(in_folder("a/file"), "x");
    assert_int_equal(v2v_file_make_folder(in_folder("a/file/d")), V2V_E_IO);
    assert_int_equal(v2v_file_make_folder(in_folder("a/file")), V2V_E_IO);
}

static void text_is_replaced_as_a_whole(void **state)
{
    (void)state;
    const char *path = in_folder("text");

    assert_ok(v2v_file_write_text(path, "one\n"));
    assert_ok(v2v_file_write_text(path, "two\n"));
    assert_holds(path, "two\n");
    assert_false(v2v_file_exists(in_folder("text.v2v3d-part")));
    assert_int_equal(v2v_file_write_text(in_folder("no/such"), ""), V2V_E_IO);
}

/* RFC 3720 appendix B.4; "123456789" is the check value of the CRC catalogue. */
static void crc32c_matches_published_values(void **state)
{
    (void)state;
    uint8_t zeros[32] = {0};
    uint8_t ones[32], rising[32], falling[32];
    memset(ones, 0xff, sizeof ones);
    for (int i = 0; i < 32; i++) {
        rising[i] = (uint8_t)i;
        falling[i] = (uint8_t)(31 - i);
    }
    const struct {
        const void *data;
        int64_t bytes;
        uint32_t crc;
    } cases[] = {{"", 0, 0},
                 {"123456789", 9, 0xe3069283},
                 {zeros, 32, 0x8a9136aa},
                 {ones, 32, 0x62a8ab43},
                 {rising, 32, 0x46dd794e},
                 {falling, 32, 0x113fdb5c}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_int_equal(v2v_file_crc32c(0, cases[i].data, cases[i].bytes), cases[i].crc);
        assert_int_equal(v2v_file_crc32c_portable(0, cases[i].data, cases[i].bytes), cases[i].crc);
    }
}

static void crc32c_continues_at_any_cut(void **state)
{
    (void)state;
    uint8_t data[100];
    for (int i = 0; i < 100; i++) {
        data[i] = (uint8_t)(i * 37 + 11);
    }
    uint32_t whole = v2v_file_crc32c_portable(0, data, 100);
    for (int64_t cut = 0; cut <= 100; cut++) {
        uint32_t first = v2v_file_crc32c(0, data, cut);
        assert_int_equal(v2v_file_crc32c(first, data + cut, 100 - cut), whole);
    }
}

static void a_kind_is_told_by_the_ending_in_upper_or_lower_case(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        enum v2v_file_kind kind;
    } cases[] = {{"a.tif", V2V_FILE_TIFF},    {"a/b.ome.TIFF", V2V_FILE_TIFF},
                 {"a.h5", V2V_FILE_HDF5},     {"a.HDF5", V2V_FILE_HDF5},
                 {"a.hdf", V2V_FILE_HDF5},    {"a.safetensors", V2V_FILE_SAFETENSORS},
                 {"a.yaml", V2V_FILE_YAML},   {"a.yml", V2V_FILE_YAML},
                 {"a.h5.gz", V2V_FILE_OTHER}, {"h5", V2V_FILE_OTHER},
                 {"", V2V_FILE_OTHER}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        assert_int_equal(v2v_file_kind_of_name(cases[i].name), cases[i].kind);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_kind_is_told_by_the_ending_in_upper_or_lower_case),
        cmocka_unit_test(only_a_readable_regular_file_is_an_input),
        cmocka_unit_test(an_existing_output_needs_force),
        cmocka_unit_test(an_output_never_replaces_an_input),
        cmocka_unit_test(an_output_needs_a_folder_and_is_none),
        cmocka_unit_test(a_name_that_is_too_long_is_refused),
        cmocka_unit_test(commit_renames_and_cleans_up_after_failure),
        cmocka_unit_test(folders_are_made_with_their_parents),
        cmocka_unit_test(text_is_replaced_as_a_whole),
        cmocka_unit_test(crc32c_matches_published_values),
        cmocka_unit_test(crc32c_continues_at_any_cut),
    };
    (void)snprintf(folder, sizeof folder, "%s", test_folder(NULL));
    return cmocka_run_group_tests_name("io.file", tests, NULL, NULL);
}
