#include "h5_files.h"

#include "support.h"

#include <hdf5.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Of the range that HDF5 leaves for tests. */
#define FOREIGN_FILTER ((H5Z_filter_t)300)

static size_t pass_through(unsigned flags, size_t values_count, const unsigned values[],
                           size_t bytes, size_t *buffer_bytes, void **buffer)
{
    (void)flags, (void)values_count, (void)values, (void)buffer_bytes, (void)buffer;
    return bytes;
}

static const H5Z_class2_t foreign = {.version = H5Z_CLASS_T_VERS,
                                     .id = FOREIGN_FILTER,
                                     .encoder_present = 1,
                                     .decoder_present = 1,
                                     .name = "foreign",
                                     .filter = pass_through};

static hid_t open_or_create(const char *path)
{
    hid_t file = access(path, F_OK) == 0 ? H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT)
                                         : H5Fcreate(path, H5F_ACC_EXCL, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(file >= 0);
    return file;
}

/* A type handle to close. */
static hid_t file_type(enum test_h5_type type)
{
    const hid_t plain[] = {
        [TEST_H5_F32] = H5T_IEEE_F32LE,    [TEST_H5_F64] = H5T_IEEE_F64LE,
        [TEST_H5_F32_BE] = H5T_IEEE_F32BE, [TEST_H5_U8] = H5T_STD_U8LE,
        [TEST_H5_U16] = H5T_STD_U16LE,     [TEST_H5_U16_BE] = H5T_STD_U16BE,
        [TEST_H5_U32] = H5T_STD_U32LE,     [TEST_H5_I16] = H5T_STD_I16LE,
        [TEST_H5_STRING] = H5T_C_S1,       [TEST_H5_COMPOUND] = 0,
        [TEST_H5_BITS] = H5T_STD_B16LE,
    };
    if (type == TEST_H5_COMPOUND) {
        hid_t compound = H5Tcreate(H5T_COMPOUND, sizeof(float));
        assert_true(H5Tinsert(compound, "value", 0, H5T_NATIVE_FLOAT) >= 0);
        return compound;
    }
    hid_t copy = H5Tcopy(plain[type]);
    assert_true(type != TEST_H5_STRING || H5Tset_size(copy, 8) >= 0);
    return copy;
}

static hid_t creation_of(const char *path, const struct test_h5_spec *spec, const hsize_t *extent)
{
    hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
    char beside[512];
    hsize_t chunk[6];
    for (int i = 0; i < spec->rank; i++) {
        chunk[i] = i < spec->rank - 2 ? 1 : extent[i];
    }
    switch (spec->storage) {
    case TEST_H5_CONTIGUOUS:
        break;
    case TEST_H5_EXTERNAL:
        snprintf(beside, sizeof beside, "%s.raw", path);
        assert_true(H5Pset_external(creation, beside, 0, H5F_UNLIMITED) >= 0);
        break;
    case TEST_H5_VIRTUAL: {
        hid_t space = H5Screate_simple(spec->rank, extent, NULL);
        assert_true(H5Pset_virtual(creation, space, "nowhere.h5", "/views", space) >= 0);
        H5Sclose(space);
        break;
    }
    default:
        assert_true(H5Pset_chunk(creation, spec->rank, chunk) >= 0);
        break;
    }
    if (spec->storage == TEST_H5_CHECKED) {
        assert_true(H5Pset_fletcher32(creation) >= 0);
    } else if (spec->storage == TEST_H5_DEFLATED || spec->storage == TEST_H5_CUT) {
        assert_true(H5Pset_shuffle(creation) >= 0 && H5Pset_deflate(creation, 1) >= 0);
    } else if (spec->storage == TEST_H5_FOREIGN) {
        assert_true(H5Zregister(&foreign) >= 0);
        assert_true(H5Pset_filter(creation, FOREIGN_FILTER, 0, 0, NULL) >= 0);
    }
    return creation;
}

static void write_values(hid_t set, const struct test_h5_spec *spec)
{
    int64_t count = 1;
    for (int i = 0; i < spec->rank; i++) {
        count *= spec->shape[i];
    }
    double *values = malloc((size_t)count * sizeof *values + 1);
    assert_non_null(values);
    for (int64_t i = 0; i < count; i++) {
        values[i] = spec->values != NULL ? spec->values[i] : (double)(i % 100);
    }
    hid_t space = H5Dget_space(set);
    if (spec->storage == TEST_H5_CUT) {
        const hsize_t start[6] = {0}, last = (hsize_t)spec->rank - 2;
        hsize_t image[6] = {1, 1, 1, 1, 1, 1};
        for (hsize_t i = last; i < last + 2; i++) {
            image[i] = (hsize_t)spec->shape[i];
        }
        assert_true(H5Sselect_hyperslab(space, H5S_SELECT_SET, start, NULL, image, NULL) >= 0);
    }
    assert_true(H5Dwrite(set, H5T_NATIVE_DOUBLE, space, space, H5P_DEFAULT, values) >= 0);
    H5Sclose(space);
    free(values);
}

void test_h5_make(const char *path, const struct test_h5_spec *spec)
{
    hsize_t extent[6];
    for (int i = 0; i < spec->rank; i++) {
        extent[i] = (hsize_t)spec->shape[i];
    }
    hid_t file = open_or_create(path);
    hid_t type = file_type(spec->type);
    hid_t space = H5Screate_simple(spec->rank, extent, NULL);
    hid_t creation = creation_of(path, spec, extent);
    hid_t set = H5Dcreate2(file, spec->dataset, type, space, H5P_DEFAULT, creation, H5P_DEFAULT);
    assert_true(set >= 0);
    if (spec->type < TEST_H5_STRING && spec->storage != TEST_H5_VIRTUAL &&
        spec->storage != TEST_H5_UNWRITTEN) {
        write_values(set, spec);
    }
    assert_true(H5Dclose(set) >= 0 && H5Pclose(creation) >= 0 && H5Sclose(space) >= 0 &&
                H5Tclose(type) >= 0 && H5Fclose(file) >= 0);
    if (spec->storage == TEST_H5_FOREIGN) {
        assert_true(H5Zunregister(FOREIGN_FILTER) >= 0);
    }
}

void test_h5_link(const char *path, const char *name, const char *file, const char *target)
{
    hid_t own = open_or_create(path);
    assert_true((file != NULL
                     ? H5Lcreate_external(file, target, own, name, H5P_DEFAULT, H5P_DEFAULT)
                     : H5Lcreate_soft(target, own, name, H5P_DEFAULT, H5P_DEFAULT)) >= 0);
    assert_true(H5Fclose(own) >= 0);
}

void test_h5_group(const char *path, const char *name)
{
    hid_t file = open_or_create(path);
    hid_t group = H5Gcreate2(file, name, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(H5Gclose(group) >= 0 && H5Fclose(file) >= 0);
}

static void put_attribute(const char *path, const char *object, const char *name, hid_t type,
                          hid_t space, const void *values)
{
    hid_t file = open_or_create(path);
    hid_t attribute =
        H5Acreate_by_name(file, object, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(attribute >= 0 && H5Awrite(attribute, type, values) >= 0);
    assert_true(H5Aclose(attribute) >= 0 && H5Sclose(space) >= 0 && H5Fclose(file) >= 0);
}

void test_h5_numbers(const char *path, const char *object, const char *name, const double *values,
                     int64_t count)
{
    const hsize_t extent = (hsize_t)count;
    put_attribute(path, object, name, H5T_NATIVE_DOUBLE, H5Screate_simple(1, &extent, NULL),
                  values);
}

void test_h5_text(const char *path, const char *object, const char *name, const char *text)
{
    hid_t type = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(type, H5T_VARIABLE) >= 0 && H5Tset_cset(type, H5T_CSET_UTF8) >= 0);
    put_attribute(path, object, name, type, H5Screate(H5S_SCALAR), &text);
    H5Tclose(type);
}

int test_h5_has_attribute(const char *path, const char *object, const char *name)
{
    hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    const htri_t there = H5Aexists_by_name(file, object, name, H5P_DEFAULT);
    H5Fclose(file);
    return there > 0;
}

char *test_h5_string(const char *path, const char *dataset)
{
    char *text = NULL;
    hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    if (H5Lexists(file, dataset, H5P_DEFAULT) > 0) {
        hid_t set = H5Dopen2(file, dataset, H5P_DEFAULT), type = H5Dget_type(set);
        text = calloc(H5Tget_size(type) + 1, 1);
        assert_non_null(text);
        assert_true(H5Dread(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, text) >= 0);
        H5Tclose(type);
        H5Dclose(set);
    }
    H5Fclose(file);
    return text;
}
