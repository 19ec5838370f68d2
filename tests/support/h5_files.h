/** HDF5 files of every kind, also such as no sound program writes: food for the readers. */
#ifndef V2V_TEST_H5_FILES_H
#define V2V_TEST_H5_FILES_H

#include <stdint.h>

enum test_h5_type {
    TEST_H5_F32,
    TEST_H5_F64,
    TEST_H5_F32_BE,
    TEST_H5_U8,
    TEST_H5_U16,
    TEST_H5_U16_BE,
    TEST_H5_U32,
    TEST_H5_I16,
    TEST_H5_STRING,   /**< 8 characters an element */
    TEST_H5_COMPOUND, /**< one float an element */
    TEST_H5_BITS      /**< a bit field */
};

enum test_h5_storage {
    TEST_H5_CONTIGUOUS,
    TEST_H5_CHUNKED,  /**< one [y,x] image a chunk */
    TEST_H5_CHECKED,  /**< so, with fletcher32 */
    TEST_H5_DEFLATED, /**< so, with deflate and shuffle */
    TEST_H5_FOREIGN,  /**< so, through a filter that no reader has */
    TEST_H5_EXTERNAL, /**< bytes in a file beside it */
    TEST_H5_VIRTUAL,  /**< a view of another file's dataset, which is missing */
    TEST_H5_CUT,      /**< deflated, an image a chunk, only the first one written */
    TEST_H5_UNWRITTEN /**< chunked, no chunk written */
};

struct test_h5_spec {
    const char *dataset;
    enum test_h5_type type;
    enum test_h5_storage storage;
    int rank;
    int64_t shape[6];
    const double *values; /**< row-major; NULL: element i is i mod 100 */
};

/** Create (or extend) a file; the parent group of the dataset must be the root. */
void test_h5_make(const char *path, const struct test_h5_spec *spec);

/** A link: to `target` in another file, or in this one when `file` is NULL. */
void test_h5_link(const char *path, const char *name, const char *file, const char *target);

/** A group with nothing in it. */
void test_h5_group(const char *path, const char *name);

/** Attributes: numbers, or text of variable length as Python writes it. */
void test_h5_numbers(const char *path, const char *object, const char *name, const double *values,
                     int64_t count);
void test_h5_text(const char *path, const char *object, const char *name, const char *text);

/** 1 when the object has that attribute. */
int test_h5_has_attribute(const char *path, const char *object, const char *name);

/** A text of fixed length, to be freed with free(); NULL when there is no such dataset. */
char *test_h5_string(const char *path, const char *dataset);

#endif
