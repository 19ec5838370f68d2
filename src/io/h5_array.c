#include "io/h5_array.h"
#include "io/h5_common.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/tensor/statistics.h"
#include <math.h>
#include <stdio.h>
#include <strings.h>

static enum v2v_status check_type(struct v2v_h5_array *array)
{
    enum v2v_status rc = V2V_OK;
    hid_t type = H5Dget_type(array->set);
    const H5T_class_t class = H5Tget_class(type);
    if ((class != H5T_INTEGER && class != H5T_FLOAT) || H5Tget_size(type) > sizeof(double)) {
        rc = V2V_FAIL(V2V_E_INPUT, "%s: %s: holds no integers or floats of up to 64 bits",
                      array->path, array->kind->dataset);
    }
    array->type_max = 1.0;
    if (rc == V2V_OK && class == H5T_INTEGER) {
        const size_t sign_bits = H5Tget_sign(type) == H5T_SGN_NONE ? 0 : 1;
        for (size_t bit = sign_bits; bit < H5Tget_precision(type); bit++) {
            array->type_max *= 2.0;
        }
        array->type_max -= 1.0;
    }
    v2v_h5_close(&type);
    return rc;
}

static enum v2v_status check_shape(struct v2v_h5_array *array)
{
    enum v2v_status rc = V2V_OK;
    const char *path = array->path, *name = array->kind->dataset, *axes = array->kind->axes;
    hsize_t extent[H5S_MAX_RANK] = {0};
    hid_t space = H5Dget_space(array->set);
    array->rank = H5Sget_simple_extent_ndims(space);
    if (array->rank < array->kind->least_rank || array->rank > 4) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: has %d axes, not [%s]%s%s%s", path, name,
                         array->rank, axes, array->kind->least_rank == 3 ? " or [" : "",
                         array->kind->least_rank == 3 ? axes + 1 : "",
                         array->kind->least_rank == 3 ? "]" : ""));
    }
    if (H5Sget_simple_extent_dims(space, extent, NULL) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, path, name, "has no shape"));
    }
    array->shape[0] = 1;
    for (int i = 0; i < array->rank; i++) {
        if (extent[i] == 0 || extent[i] > INT64_MAX) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: axis %d has %llu elements", path, name, i,
                             (unsigned long long)extent[i]));
        }
        array->shape[4 - array->rank + i] = (int64_t)extent[i];
    }
    const int64_t image = v2v_mem_product(array->shape[2], array->shape[3], 8);
    if (image < 0 || v2v_mem_product(array->shape[0], array->shape[1], image) < 0) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: its size passes 2^63 bytes", path, name));
    }
done:
    v2v_h5_close(&space);
    return rc;
}

/* What was never written reads as zeros without any error. Of what is compressed the number of
 * chunks tells (v2v_h5_chunks_create), here only nothing at all is seen. */
static enum v2v_status check_written(const struct v2v_h5_array *array, int64_t element, int filters)
{
    const int64_t image = v2v_mem_product(array->shape[2], array->shape[3], element);
    const int64_t bytes = v2v_mem_product(array->shape[0], array->shape[1], image);
    const hsize_t stored = H5Dget_storage_size(array->set);
    const hsize_t least = filters > 0 ? 1 : (hsize_t)bytes;
    return stored >= least
               ? V2V_OK
               : V2V_FAIL(V2V_E_INPUT, "%s: %s: only %llu of its %lld bytes were ever written",
                          array->path, array->kind->dataset, (unsigned long long)stored,
                          (long long)bytes);
}

static enum v2v_status check_storage(struct v2v_h5_array *array)
{
    enum v2v_status rc = V2V_OK;
    hid_t type = H5Dget_type(array->set);
    hid_t creation = H5Dget_create_plist(array->set);
    V2V_TRY(check_written(array, (int64_t)H5Tget_size(type), H5Pget_nfilters(creation)));
    V2V_TRY(v2v_h5_chunks_create(&array->chunks, array->set, array->path, array->kind->dataset));
done:
    v2v_h5_close(&creation);
    v2v_h5_close(&type);
    return rc;
}

static enum v2v_status check_axes(const struct v2v_h5_array *array)
{
    char axes[16] = "";
    int found = 0;
    const char *expected = array->kind->axes + (4 - array->rank);
    const enum v2v_status rc =
        v2v_h5_get_text(axes, sizeof axes, &found, array->set, array->path, "axes");
    if (rc == V2V_OK && found && strcasecmp(axes, expected) != 0) {
        return V2V_FAIL(V2V_E_INPUT, "%s: %s: attribute axes says \"%s\", not \"%s\"", array->path,
                        array->kind->dataset, axes, expected);
    }
    return rc;
}

static enum v2v_status read_packing(struct v2v_h5_array *array)
{
    enum v2v_status rc = V2V_OK;
    int has_scale = 0, has_zero = 0;
    array->scale = 1.0;
    V2V_TRY(
        v2v_h5_get_numbers(&array->scale, &has_scale, array->set, array->path, "scale_factor", 1));
    V2V_TRY(v2v_h5_get_numbers(&array->zero, &has_zero, array->set, array->path, "add_offset", 1));
    if ((float)array->scale == 0.0f || !isfinite((float)array->scale)) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: attribute scale_factor: %g makes no values",
                         array->path, array->kind->dataset, array->scale));
    }
    if (has_scale || has_zero) {
        array->type_max = 1.0;
    }
done:
    return rc;
}

enum v2v_status v2v_h5_array_open(struct v2v_h5_array *array, const char *path,
                                  const struct v2v_h5_kind *kind)
{
    enum v2v_status rc = V2V_OK;
    *array = (struct v2v_h5_array){
        .path = path, .kind = kind, .file = H5I_INVALID_HID, .set = H5I_INVALID_HID};
    V2V_TRY(v2v_h5_open(&array->file, path));
    if (kind->may_be_other && !v2v_h5_has(array->file, kind->dataset)) {
        V2V_TRY(v2v_h5_there_is_none(array->file, path, kind->dataset,
                                     "; --dataset NAME (of evaluate also --volume-dataset, "
                                     "--truth-dataset) reads another one"));
    }
    V2V_TRY(v2v_h5_open_dataset(&array->set, array->file, path, kind->dataset));
    V2V_TRY(check_type(array));
    V2V_TRY(check_shape(array));
    V2V_TRY(check_storage(array));
    V2V_TRY(check_axes(array));
    V2V_TRY(read_packing(array));
done:
    if (rc != V2V_OK) {
        v2v_h5_array_close(array);
    }
    return rc;
}

static enum v2v_status read_block(const struct v2v_h5_array *array, void *out, hid_t type,
                                  const int64_t start[4], const int64_t count[4])
{
    enum v2v_status rc = V2V_OK;
    hsize_t from[4], size[4];
    char what[128];
    const int skipped = 4 - array->rank;
    for (int i = 0; i < 4; i++) {
        from[i] = (hsize_t)start[i];
        size[i] = (hsize_t)count[i];
    }
    snprintf(what, sizeof what, "%s %lld, %s %lld can't be read", array->kind->axis[0],
             (long long)start[0], array->kind->axis[1], (long long)start[1]);
    /* In the file's shape: HDF5 walks through selections of unequal ranks element by element. */
    hid_t memory = H5Screate_simple(array->rank, size + skipped, NULL);
    hid_t space = H5Dget_space(array->set);
    V2V_TRY(v2v_h5_chunks_check(array->chunks, what, from + skipped, size + skipped));
    if (memory < 0 ||
        H5Sselect_hyperslab(space, H5S_SELECT_SET, from + skipped, NULL, size + skipped, NULL) <
            0 ||
        H5Dread(array->set, type, memory, space, H5P_DEFAULT, out) < 0) {
        V2V_TRY(V2V_H5_FAIL(V2V_E_INPUT, array->path, array->kind->dataset, what));
    }
done:
    v2v_h5_close(&space);
    v2v_h5_close(&memory);
    return rc;
}

enum v2v_status v2v_h5_array_read(const struct v2v_h5_array *array, float *out, int64_t t,
                                  int64_t first, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const int64_t *shape = array->shape;
    V2V_ASSERT(t >= 0 && t < shape[0] && first >= 0 && count >= 0 && first + count <= shape[1]);
    if (count == 0) {
        goto done;
    }
    V2V_TRY(read_block(array, out, H5T_NATIVE_FLOAT, (int64_t[4]){t, first, 0, 0},
                       (int64_t[4]){1, count, shape[2], shape[3]}));
    const int64_t bad = v2v_first_not_finite(out, count * shape[2] * shape[3]);
    if (bad >= 0) {
        const char *const *axis = array->kind->axis;
        const int64_t row = bad / shape[3];
        const int64_t at[4] = {t, first + row / shape[2], row % shape[2], bad % shape[3]};
        double stored = NAN;
        V2V_TRY(read_block(array, &stored, H5T_NATIVE_DOUBLE, at, (int64_t[4]){1, 1, 1, 1}));
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: %s at %s %lld, %s %lld, %s %lld, %s %lld",
                         array->path, array->kind->dataset,
                         isfinite(stored) ? "a number beyond float32" : "NaN or Inf", axis[0],
                         (long long)at[0], axis[1], (long long)at[1], axis[2], (long long)at[2],
                         axis[3], (long long)at[3]));
    }
done:
    return rc;
}

/* In float32 where there is no offset, as of a TIFF. */
enum v2v_status v2v_h5_array_unpack(const struct v2v_h5_array *array, float *x, int64_t count)
{
    const double zero = array->zero, scale = array->scale;
    const float step = (float)scale;
    if (zero == 0.0 && scale == 1.0) {
        return V2V_OK;
    }
    for (int64_t i = 0; i < count; i++) {
        x[i] = zero == 0.0 ? x[i] * step : (float)(zero + scale * (double)x[i]);
    }
    return v2v_first_not_finite(x, count) < 0
               ? V2V_OK
               : V2V_FAIL(V2V_E_INPUT,
                          "%s: %s: scale_factor %g and add_offset %g make values beyond float32",
                          array->path, array->kind->dataset, scale, zero);
}

void v2v_h5_array_close(struct v2v_h5_array *array)
{
    v2v_h5_chunks_destroy(&array->chunks);
    v2v_h5_close(&array->set);
    v2v_h5_close(&array->file);
}
