/* Files of named arrays: safetensors as its specification has them, and HDF5 with nothing else. */
#include "support.h"

#include "h5_files.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/io/arrays.h"
#include "v2v3d/io/file.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static char path[512];

static void use(const char *name)
{
    snprintf(path, sizeof path, "%s/%s", test_folder(NULL), name);
}

/* `length` and the header, then `bytes` zeros or `data`. */
static void write_file(uint64_t length, const char *header, const void *data, size_t bytes)
{
    static const char zeros[256];
    unsigned char start[8];
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    for (int i = 0; i < 8; i++) {
        start[i] = (unsigned char)(length >> 8 * i);
    }
    assert_int_equal(fwrite(start, 1, 8, file), 8);
    assert_int_equal(fwrite(header, 1, strlen(header), file), strlen(header));
    assert_true(data != NULL || bytes <= sizeof zeros);
    assert_int_equal(fwrite(data != NULL ? data : zeros, 1, bytes, file), bytes);
    assert_int_equal(fclose(file), 0);
}

/* float32's neighbours of 1, in every type that is read; BF16 and F16 by their definitions. */
static void every_type_of_float_is_read(void **state)
{
    (void)state;
    static const struct {
        const char *type;
        unsigned char bytes[24];
        size_t size;
        float value[3];
    } rows[] = {
        {"F32", {0, 0, 0x80, 0x3f, 0, 0, 0, 0xc0, 0xcd, 0xcc, 0xcc, 0x3d}, 12, {1, -2, 0.1f}},
        {"BF16", {0x80, 0x3f, 0, 0xc0, 0xcd, 0x3d}, 6, {1, -2, 0.10009765625f}},
        /* the third is the smallest number of all, subnormal */
        {"F16", {0, 0x3c, 0, 0xc0, 1, 0}, 6, {1, -2, 0x1p-24f}},
        {"F64",
         {0, 0, 0, 0,    0,    0,    0xf0, 0x3f, 0,    0,    0,    0,
          0, 0, 0, 0xc0, 0x9a, 0x99, 0x99, 0x99, 0x99, 0x99, 0xb9, 0x3f},
         24,
         {1, -2, 0.1f}}};
    use("types.safetensors");
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        struct v2v_arrays *arrays = NULL;
        char header[128];
        float out[3] = {0};
        snprintf(header, sizeof header,
                 "{\"a.b\":{\"dtype\":\"%s\",\"shape\":[3,1],\"data_offsets\":[0,%zu]}}",
                 rows[i].type, rows[i].size);
        write_file(strlen(header), header, rows[i].bytes, rows[i].size);
        assert_ok(v2v_arrays_open(&arrays, path));
        assert_int_equal(v2v_arrays_count(arrays), 1);
        const struct v2v_array *array = v2v_arrays_at(arrays, 0);
        assert_string_equal(array->name, "a.b");
        assert_true(array->rank == 2 && array->shape[0] == 3 && array->shape[1] == 1);
        assert_ok(v2v_arrays_read(arrays, out, array));
        assert_memory_equal(out, rows[i].value, sizeof out);
        v2v_arrays_close(&arrays);
    }
    assert_int_equal(v2v_mem_held(), 0);
}

/* What is wrong with a header (length 0: its own), and the words that say so. Arrays are of `bytes`
 * zeros. */
static const struct damaged {
    const char *header, *says;
    uint64_t length;
    size_t bytes;
} damaged[] = {
    {"{}", "more than the 4 MiB", UINT64_MAX, 8},
    {"{}", "more than the 4 MiB", (4 << 20) + 1, 8},
    {"{}", "more than the file", 11, 8},
    {"{", "no object of JSON", 0, 8},
    {"{]", "no object of JSON", 0, 0},
    {"{} {}", "no object of JSON", 0, 0},
    {"{\"a\":1,\"a\":2}", "a name that was there before", 0, 0},
    {"{}", "8 bytes at its end are of no array", 0, 8},
    {"{\"a\":5}", "a: its dtype is not valid", 0, 0},
    {"{\"a\":{\"dtype\":\"F31\",\"shape\":[2],\"data_offsets\":[0,8]}}", "a: its dtype", 0, 8},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[-2],\"data_offsets\":[0,8]}}", "a: its shape", 0, 8},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2.0],\"data_offsets\":[0,8]}}", "a: its shape", 0, 8},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":\"2\",\"data_offsets\":[0,8]}}", "a: its shape", 0, 8},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[1,1,1,1,1,1,1,1,2],\"data_offsets\":[0,8]}}",
     "a: its shape", 0, 8},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[4294967296,4294967296],\"data_offsets\":[0,8]}}",
     "a: its shape has no valid size", 0, 8},
    {"{\"a\":{\"dtype\":\"F64\",\"shape\":[2305843009213693952],\"data_offsets\":[0,0]}}",
     "a: its shape has no valid size", 0, 0},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2]}}", "a: its data_offsets", 0, 8},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8,8]}}", "a: its data_offsets", 0,
     8},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,16]}}",
     "lies at bytes 0 to 16 of 8", 0, 8},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[8,0]}}", "lies at bytes 8 to 0", 0,
     8},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,9223372036854775807]}}",
     "lies at bytes 0 to", 0, 8},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[3],\"data_offsets\":[0,8]}}",
     "has 8 bytes, its shape 12", 0, 8},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[1],\"data_offsets\":[0,4]},"
     "\"b\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8]}}",
     "b: lies over another array", 0, 8},
    {"{\"a\":{\"dtype\":\"F32\",\"shape\":[1],\"data_offsets\":[0,4]},"
     "\"b\":{\"dtype\":\"F32\",\"shape\":[1],\"data_offsets\":[8,12]}}",
     "b: a gap lies before it", 0, 12},
    {"{\"a b\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8]}}", "printable", 0, 8},
    {"{\"\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8]}}", "printable", 0, 8},
};

static void what_is_damaged_is_refused_in_one_line(void **state)
{
    (void)state;
    use("damaged.safetensors");
    for (size_t i = 0; i < sizeof damaged / sizeof *damaged; i++) {
        const struct damaged *row = &damaged[i];
        struct v2v_arrays *arrays = NULL;
        write_file(row->length > 0 ? row->length : strlen(row->header), row->header, NULL,
                   row->bytes);
        assert_int_equal(v2v_arrays_open(&arrays, path), V2V_E_INPUT);
        assert_null(arrays);
        if (strstr(v2v_status_message(), row->says) == NULL ||
            strstr(v2v_status_message(), path) == NULL ||
            strchr(v2v_status_message(), '\n') != NULL) {
            fail_msg("%s: \"%s\" does not say \"%s\"", row->header, v2v_status_message(),
                     row->says);
        }
    }
    assert_int_equal(v2v_mem_held(), 0);
}

static void a_wrong_checksum_is_told_with_file_and_array(void **state)
{
    (void)state;
    static const struct {
        const char *sum, *says;
    } rows[] = {{"5", ": a: is damaged: its CRC-32C is"},
                {"33)5", ": crc32c.a: '33)5' is not a whole number"}};
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        struct v2v_arrays *arrays = NULL;
        char header[256], says[700];
        float out[2];
        use("sum.safetensors");
        snprintf(header, sizeof header,
                 "{\"__metadata__\":{\"crc32c.a\":\"%s\"},"
                 "\"a\":{\"dtype\":\"F32\",\"shape\":[2],\"data_offsets\":[0,8]}}",
                 rows[i].sum);
        write_file(strlen(header), header, NULL, 8);
        snprintf(says, sizeof says, "%s%s", path, rows[i].says);
        assert_ok(v2v_arrays_open(&arrays, path));
        assert_int_equal(v2v_arrays_read(arrays, out, v2v_arrays_find(arrays, "a")), V2V_E_INPUT);
        assert_non_null(strstr(v2v_status_message(), says));
        v2v_arrays_close(&arrays);
    }
}

/* Of valid JSON, and all in the file. */
static void a_header_above_4_mib_is_refused_before_it_is_read(void **state)
{
    (void)state;
    enum { BYTES = (4 << 20) + 8 };
    struct v2v_arrays *arrays = NULL;
    char *header = NULL;
    assert_ok(V2V_ALLOC(header, "test", BYTES + 1));
    memset(header, ' ', BYTES);
    memcpy(header, "{}", 2);
    use("long.safetensors");
    write_file(BYTES - 8, header, "", 0); /* the rest is of no array */
    assert_int_equal(v2v_arrays_open(&arrays, path), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "8 bytes at its end are of no array"));
    write_file(BYTES, header, "", 0);
    assert_int_equal(v2v_arrays_open(&arrays, path), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "more than the 4 MiB that are read"));
    v2v_mem_free(header);
    assert_int_equal(v2v_mem_held(), 0);
}

/* Numbers that are none of a network, or not finite: the array can be told of, not read. */
static void what_is_no_finite_float_is_listed_but_not_read(void **state)
{
    (void)state;
    static const struct {
        const char *type, *says;
        unsigned char bytes[8];
        size_t size;
    } rows[] = {
        {"I64", "n: is of type I64: no floating", {1}, 8},
        {"BOOL", "n: is of type BOOL", {1}, 1},
        {"F8_E4M3", "n: is of type F8_E4M3, not F32", {1}, 1},
        {"F32", "n: element 0 is NaN or Inf", {0, 0, 0x80, 0x7f}, 4},
        {"F16", "n: element 0 is NaN or Inf", {0, 0x7c}, 2},
        {"BF16", "n: element 0 is NaN or Inf", {0xc0, 0x7f}, 2},
        /* 1e300, which float32 does not reach */
        {"F64", "n: element 0 is NaN or Inf", {0x9c, 0x75, 0, 0x88, 0x3c, 0xe4, 0x37, 0x7e}, 8}};
    use("numbers.safetensors");
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        struct v2v_arrays *arrays = NULL;
        char header[128];
        float out = 0.0f;
        snprintf(header, sizeof header,
                 "{\"n\":{\"dtype\":\"%s\",\"shape\":[],\"data_offsets\":[0,%zu]}}   ",
                 rows[i].type, rows[i].size);
        write_file(strlen(header), header, rows[i].bytes, rows[i].size);
        assert_ok(v2v_arrays_open(&arrays, path));
        assert_int_equal(v2v_arrays_read(arrays, &out, v2v_arrays_at(arrays, 0)), V2V_E_INPUT);
        if (strstr(v2v_status_message(), rows[i].says) == NULL) {
            fail_msg("\"%s\" does not say \"%s\"", v2v_status_message(), rows[i].says);
        }
        v2v_arrays_close(&arrays);
    }
}

static void hdf5_is_listed_from_the_group_or_the_root(void **state)
{
    (void)state;
    struct v2v_arrays *arrays = NULL;
    struct v2v_weights_info info;
    char *config = NULL;
    float out[6];
    use("root.h5");
    test_h5_make(path, &(struct test_h5_spec){
                           .dataset = "net.a", .type = TEST_H5_F64, .rank = 2, .shape = {2, 3}});
    test_h5_make(path, &(struct test_h5_spec){
                           .dataset = "net.n", .type = TEST_H5_U16, .rank = 1, .shape = {4}});
    assert_ok(v2v_arrays_open(&arrays, path));
    assert_int_equal(v2v_arrays_count(arrays), 2);
    v2v_arrays_strip(arrays, 4);
    assert_int_equal(v2v_arrays_extent(arrays, "a", 1), 3);
    assert_int_equal(v2v_arrays_extent(arrays, "a", 2), 0);
    assert_int_equal(v2v_arrays_extent(arrays, "b", 0), 0);
    assert_ok(v2v_arrays_read(arrays, out, v2v_arrays_find(arrays, "a")));
    assert_true(out[0] == 0.0f && out[5] == 5.0f);
    assert_int_equal(v2v_arrays_read(arrays, out, v2v_arrays_find(arrays, "n")), V2V_E_INPUT);
    assert_non_null(strstr(v2v_status_message(), "net.n: is of type I16"));
    assert_ok(v2v_arrays_info(&info, &config, arrays));
    assert_true(info.method[0] == '\0' && config == NULL);
    v2v_arrays_close(&arrays);
    test_h5_group(path, "/weights");
    assert_ok(v2v_arrays_open(&arrays, path));
    assert_int_equal(v2v_arrays_count(arrays), 0);
    v2v_arrays_close(&arrays);
    use("unwritten.h5");
    test_h5_make(path, &(struct test_h5_spec){.dataset = "a",
                                              .storage = TEST_H5_UNWRITTEN,
                                              .rank = 3,
                                              .shape = {1 << 20, 1 << 10, 1 << 10}});
    assert_int_equal(v2v_arrays_open(&arrays, path), V2V_E_INPUT);
    assert_int_equal(v2v_mem_held(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_type_of_float_is_read),
        cmocka_unit_test(what_is_damaged_is_refused_in_one_line),
        cmocka_unit_test(a_wrong_checksum_is_told_with_file_and_array),
        cmocka_unit_test(a_header_above_4_mib_is_refused_before_it_is_read),
        cmocka_unit_test(what_is_no_finite_float_is_listed_but_not_read),
        cmocka_unit_test(hdf5_is_listed_from_the_group_or_the_root),
    };
    return cmocka_run_group_tests_name("arrays", tests, NULL, NULL);
}
