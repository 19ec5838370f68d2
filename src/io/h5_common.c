#include "io/h5_common.h"

#include "io/file_internal.h"
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/fault.h"
#include "v2v3d/base/memory.h"
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

void v2v_h5_quiet(void)
{
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
}

/* Called from the innermost record outwards: the first one says what went wrong. */
static herr_t keep_description(unsigned n, const H5E_error2_t *record, void *reason)
{
    if (n == 0 && record->desc != NULL) {
        snprintf(reason, V2V_H5_REASON_BYTES, "%s", record->desc);
    }
    return 0;
}

const char *v2v_h5_reason(char reason[V2V_H5_REASON_BYTES])
{
    reason[0] = '\0';
    H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, keep_description, reason);
    if (reason[0] == '\0') {
        snprintf(reason, V2V_H5_REASON_BYTES, "HDF5 gives no reason");
    }
    /* The POSIX driver tells time, file, descriptor and buffer as well: keep what the system said.
     */
    char *details = strstr(reason, ": time = ");
    const char *message = strstr(reason, "error message = '");
    if (details != NULL) {
        *details = '\0';
    }
    if (details != NULL && message != NULL) {
        message += strlen("error message = '");
        const int length = (int)strcspn(message, "'");
        memmove(details + 2, message, (size_t)length);
        memcpy(details, ": ", 2);
        details[2 + length] = '\0';
    }
    /* Names in a broken file can carry anything, and a message is one line. */
    for (char *c = reason; *c != '\0'; c++) {
        *c = isprint((unsigned char)*c) ? *c : '?';
    }
    return reason;
}

void v2v_h5_close(hid_t *id)
{
    if (*id > 0) {
        H5Idec_ref(*id);
    }
    *id = H5I_INVALID_HID;
}

int v2v_file_left_open(void)
{
    return H5Fget_obj_count((hid_t)H5F_OBJ_ALL, H5F_OBJ_ALL) > 0;
}

enum v2v_status v2v_h5_close_written(enum v2v_status rc, hid_t *set, const char *path,
                                     const char *name)
{
    const hid_t own = *set;
    *set = H5I_INVALID_HID;
    if (own > 0 && H5Dclose(own) < 0 && rc == V2V_OK) {
        return V2V_H5_FAIL(V2V_E_IO, path, name, "its last data can't be written");
    }
    return rc;
}

/* Half of the entries of a node of a chunk index: as HDF5 has it, and what it takes at most. */
enum { USUAL_HALF = 32, MOST_HALF = 32767 };

enum v2v_status v2v_h5_create(hid_t *file, const char *path, int checksums, int64_t chunks,
                              int64_t bytes)
{
    enum v2v_status rc = V2V_OK;
    const int is_paged = bytes > 0 && bytes % V2V_PAGE_BYTES == 0;
    v2v_h5_quiet();
    hid_t access = H5Pcreate(H5P_FILE_ACCESS), creation = H5Pcreate(H5P_FILE_CREATE);
    *file = H5I_INVALID_HID;
    V2V_TRY(v2v_file_clear(path));
    /* without the time of day: the same content is the same file */
    if (access < 0 || H5Pset_file_locking(access, 0, 1) < 0 ||
        H5Pset_obj_track_times(creation, 0) < 0 ||
        H5Pset_istore_k(creation, (unsigned)v2v_within(chunks / 2 + 1, USUAL_HALF, MOST_HALF)) <
            0 ||
        (is_paged && H5Pset_alignment(access, (hsize_t)bytes, V2V_PAGE_BYTES) < 0) ||
        (checksums && H5Pset_libver_bounds(access, H5F_LIBVER_V18, H5F_LIBVER_LATEST) < 0)) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_MEMORY, path, "/", "no access properties"));
    }
    *file = H5Fcreate(path, H5F_ACC_EXCL, creation, access);
    if (*file < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_IO, path, "/", "HDF5 can't create it"));
    }
done:
    v2v_h5_close(&creation);
    v2v_h5_close(&access);
    return rc;
}

enum v2v_status v2v_h5_check_name(const char *path)
{
    const enum v2v_file_kind kind = v2v_file_kind_of_name(path);
    if (kind != V2V_FILE_HDF5 && kind != V2V_FILE_OTHER) {
        return V2V_FAIL(V2V_E_USAGE,
                        "%s: this output is written as HDF5: name it .h5 (v2v3d convert makes "
                        "TIFFs of it)",
                        path);
    }
    return V2V_OK;
}

enum v2v_status v2v_h5_begin(hid_t *file, char temporary[V2V_PATH_BYTES], const char *path)
{
    enum v2v_status rc = V2V_OK;
    *file = H5I_INVALID_HID;
    V2V_TRY(v2v_file_temporary(temporary, path));
    V2V_TRY(V2V_FAULT_POINT("h5.create"));
    V2V_TRY(v2v_h5_create(file, temporary, 1, 0, 0));
done:
    return rc;
}

enum v2v_status v2v_h5_end(enum v2v_status rc, hid_t *file, const char *temporary, const char *path)
{
    if (*file <= 0) { /* never begun: nothing lies under the temporary name */
        return rc;
    }
    if (rc == V2V_OK) {
        rc = V2V_FAULT_POINT("h5.flush");
    }
    const herr_t closed = H5Fclose(*file);
    *file = H5I_INVALID_HID;
    if (rc == V2V_OK && closed < 0) {
        rc = V2V_H5_FAIL(V2V_E_IO, path, "/", "can't be closed");
    }
    if (rc != V2V_OK) {
        unlink(temporary);
        return rc;
    }
    return v2v_file_commit(temporary, path);
}

/* Open an attribute if it is there: *attribute stays invalid when it isn't. */
static enum v2v_status find_attribute(hid_t *attribute, hid_t object, const char *path,
                                      const char *name)
{
    *attribute = H5I_INVALID_HID;
    const htri_t there = H5Aexists(object, name);
    if (there == 0) {
        return V2V_OK;
    }
    *attribute = there > 0 ? H5Aopen(object, name, H5P_DEFAULT) : H5I_INVALID_HID;
    return *attribute > 0 ? V2V_OK
                          : V2V_H5_FAIL(V2V_E_INPUT, path, name, "the attribute can't be opened");
}

enum v2v_status v2v_h5_get_numbers(double *values, int *found, hid_t object, const char *path,
                                   const char *name, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    hid_t attribute = H5I_INVALID_HID, type = H5I_INVALID_HID, space = H5I_INVALID_HID;
    *found = 0;
    V2V_TRY(find_attribute(&attribute, object, path, name));
    if (attribute < 0) {
        goto done;
    }
    type = H5Aget_type(attribute);
    space = H5Aget_space(attribute);
    const H5T_class_t class = H5Tget_class(type);
    if ((class != H5T_INTEGER && class != H5T_FLOAT) || H5Tget_size(type) > sizeof(double) ||
        H5Sget_simple_extent_npoints(space) != count) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: attribute %s: is not %lld number%s", path, name,
                         (long long)count, count == 1 ? "" : "s"));
    }
    if (H5Aread(attribute, H5T_NATIVE_DOUBLE, values) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, path, name, "the attribute can't be read"));
    }
    for (int64_t i = 0; i < count; i++) {
        if (!isfinite(values[i])) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: attribute %s: is not finite", path, name));
        }
    }
    *found = 1;
done:
    v2v_h5_close(&space);
    v2v_h5_close(&type);
    v2v_h5_close(&attribute);
    return rc;
}

enum v2v_status v2v_h5_get_length(double *value, hid_t object, const char *path, const char *name)
{
    double length = 0.0;
    int found = 0;
    *value = 0.0;
    const enum v2v_status rc = v2v_h5_get_numbers(&length, &found, object, path, name, 1);
    if (rc != V2V_OK || !found) {
        return rc;
    }
    if (length < 0.0) {
        return V2V_FAIL(V2V_E_INPUT, "%s: attribute %s: %g is negative", path, name, length);
    }
    *value = length;
    return V2V_OK;
}

enum v2v_status v2v_h5_get_integer(int64_t *value, int *found, hid_t object, const char *path,
                                   const char *name)
{
    const double exact = 9007199254740992.0; /* 2^53: whole numbers of a double end here */
    double number = 0.0;
    const enum v2v_status rc = v2v_h5_get_numbers(&number, found, object, path, name, 1);
    if (rc != V2V_OK || !*found) {
        return rc;
    }
    if (floor(number) != number || fabs(number) > exact) {
        return V2V_FAIL(V2V_E_INPUT, "%s: attribute %s: %g is not a whole number", path, name,
                        number);
    }
    *value = (int64_t)number;
    return V2V_OK;
}

/* Both kinds of string: HDF5 allocates those of variable length itself. */
static enum v2v_status read_text(char *text, size_t bytes, hid_t attribute, hid_t type,
                                 const char *path, const char *name)
{
    enum v2v_status rc = V2V_OK;
    const int variable = H5Tis_variable_str(type) > 0;
    char *held = NULL;
    hid_t memory = H5Tcopy(H5T_C_S1);
    memset(text, 0, bytes);
    if (H5Tset_cset(memory, H5Tget_cset(type)) < 0 ||
        H5Tset_size(memory, variable ? H5T_VARIABLE : bytes) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, path, name, "the attribute has no readable text"));
    }
    if (!variable && H5Tget_size(type) >= bytes) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: attribute %s: is longer than %zu characters", path, name,
                         bytes - 1));
    }
    if (H5Aread(attribute, memory, variable ? (void *)&held : (void *)text) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, path, name, "the attribute can't be read"));
    }
    if (variable && held != NULL) {
        const int length = snprintf(text, bytes, "%s", held);
        if (length < 0 || (size_t)length >= bytes) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: attribute %s: is longer than %zu characters", path,
                             name, bytes - 1));
        }
    }
done:
    H5free_memory(held);
    v2v_h5_close(&memory);
    return rc;
}

enum v2v_status v2v_h5_get_text(char *text, size_t bytes, int *found, hid_t object,
                                const char *path, const char *name)
{
    enum v2v_status rc = V2V_OK;
    hid_t attribute = H5I_INVALID_HID, type = H5I_INVALID_HID, space = H5I_INVALID_HID;
    *found = 0;
    text[0] = '\0';
    V2V_TRY(find_attribute(&attribute, object, path, name));
    if (attribute < 0) {
        goto done;
    }
    type = H5Aget_type(attribute);
    space = H5Aget_space(attribute);
    if (H5Tget_class(type) != H5T_STRING || H5Sget_simple_extent_npoints(space) != 1) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: attribute %s: is not one text", path, name));
    }
    V2V_TRY(read_text(text, bytes, attribute, type, path, name));
    *found = 1;
done:
    v2v_h5_close(&space);
    v2v_h5_close(&type);
    v2v_h5_close(&attribute);
    return rc;
}

/* The one place that creates an attribute; `count` 0 means a scalar. */
static enum v2v_status set_attribute(hid_t object, const char *path, const char *name,
                                     hid_t file_type, hid_t memory_type, const void *values,
                                     int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const hsize_t extent = (hsize_t)count;
    hid_t space = count == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &extent, NULL);
    hid_t attribute = H5Acreate2(object, name, file_type, space, H5P_DEFAULT, H5P_DEFAULT);
    if (attribute < 0 || H5Awrite(attribute, memory_type, values) < 0) {
        rc = V2V_H5_FAIL(V2V_E_IO, path, name, "the attribute can't be written");
    }
    v2v_h5_close(&attribute);
    v2v_h5_close(&space);
    return rc;
}

enum v2v_status v2v_h5_set_numbers(hid_t object, const char *path, const char *name,
                                   const double *values, int64_t count)
{
    return set_attribute(object, path, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, values,
                         count == 1 ? 0 : count);
}

enum v2v_status v2v_h5_set_integer(hid_t object, const char *path, const char *name, int64_t value)
{
    return set_attribute(object, path, name, H5T_STD_I64LE, H5T_NATIVE_INT64, &value, 0);
}

/* A fixed-length UTF-8 type for this text; HDF5 has no strings of length 0. */
static hid_t text_type(const char *text)
{
    const size_t length = strlen(text);
    hid_t type = H5Tcopy(H5T_C_S1);
    if (type >= 0 &&
        (H5Tset_size(type, length > 0 ? length : 1) < 0 ||
         H5Tset_strpad(type, H5T_STR_NULLPAD) < 0 || H5Tset_cset(type, H5T_CSET_UTF8) < 0)) {
        v2v_h5_close(&type);
    }
    return type;
}

enum v2v_status v2v_h5_set_text(hid_t object, const char *path, const char *name, const char *text)
{
    hid_t type = text_type(text);
    const enum v2v_status rc = set_attribute(object, path, name, type, type, text, 0);
    v2v_h5_close(&type);
    return rc;
}

enum v2v_status v2v_h5_put_text(hid_t file, const char *path, const char *name, const char *text)
{
    enum v2v_status rc = V2V_OK;
    hid_t type = text_type(text);
    hid_t space = H5Screate(H5S_SCALAR);
    hid_t set = H5Dcreate2(file, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    if (set < 0 || H5Dwrite(set, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, text) < 0) {
        rc = V2V_H5_FAIL(V2V_E_IO, path, name, "the text can't be written");
    }
    rc = v2v_h5_close_written(rc, &set, path, name);
    v2v_h5_close(&space);
    v2v_h5_close(&type);
    return rc;
}
