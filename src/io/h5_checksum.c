#include "io/h5_checksum.h"
#include "io/h5_chunks.h"
#include "io/h5_common.h"
#include "io/stack.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/random.h"
#include "v2v3d/io/file.h"
#include "v2v3d/io/volume.h"
#include <string.h>

const char *const v2v_h5_volume_sets[V2V_H5_WRITER_SETS] = {
    [V2V_VOLUME_MEAN] = "/volume",
    [V2V_VOLUME_BRANCH1] = "/branch1",
    [V2V_VOLUME_BRANCH2] = "/branch2",
    [V2V_VOLUME_UNCERTAINTY] = "/uncertainty",
};

uint64_t v2v_h5_rows_checksum(const float *rows, int64_t first, int64_t count, int64_t width)
{
    uint64_t sum = 0;
    for (int64_t i = 0; i < count; i++) {
        const uint32_t crc = v2v_file_crc32c(0, rows + i * width, width * (int64_t)sizeof *rows);
        sum += v2v_random_splitmix64(v2v_random_splitmix64((uint64_t)(first + i)) + crc);
    }
    return sum;
}

enum v2v_status v2v_h5_read_of_frames(void *out, hid_t file, const char *path, const char *name,
                                      hid_t type, int64_t frames)
{
    enum v2v_status rc = V2V_OK;
    hid_t set = H5I_INVALID_HID, space = H5I_INVALID_HID, stored = H5I_INVALID_HID;
    V2V_TRY(v2v_h5_open_dataset(&set, file, path, name));
    space = H5Dget_space(set);
    stored = H5Dget_type(set);
    if (H5Tget_class(stored) != H5T_INTEGER || H5Sget_simple_extent_ndims(space) != 1 ||
        H5Sget_simple_extent_npoints(space) != frames) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: is not one number for each of %lld frames", path,
                         name, (long long)frames));
    }
    V2V_TRY(v2v_h5_read_all(out, set, type, path, name));
done:
    v2v_h5_close(&stored);
    v2v_h5_close(&space);
    v2v_h5_close(&set);
    return rc;
}

enum v2v_status v2v_h5_summed_open(struct v2v_h5_summed *summed, const char *path,
                                   const char *const *dataset)
{
    enum v2v_status rc = V2V_OK;
    const struct v2v_h5_array *first = &summed->array[0];
    *summed = (struct v2v_h5_summed){0};
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        struct v2v_h5_array *array = &summed->array[i];
        if (dataset[i] == NULL) {
            continue;
        }
        summed->kind[i] = v2v_h5_volume;
        summed->kind[i].dataset = dataset[i];
        V2V_TRY(v2v_h5_array_open(array, path, &summed->kind[i]));
        if (memcmp(array->shape, first->shape, sizeof array->shape) != 0) {
            V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: %s: has not the shape of %s", path, dataset[i],
                             dataset[0]));
        }
    }
    V2V_TRY(V2V_ALLOC(summed->image, "io.checksum",
                      v2v_mem_product(first->shape[2], first->shape[3], 1)));
done:
    return rc;
}

enum v2v_status v2v_h5_summed_frame(struct v2v_h5_summed *summed, uint64_t *sum, int64_t t)
{
    enum v2v_status rc = V2V_OK;
    const int64_t *shape = summed->array[0].shape;
    *sum = 0;
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        for (int64_t m = 0; m < shape[1] && summed->array[i].kind != NULL; m++) {
            V2V_TRY(v2v_h5_array_read(&summed->array[i], summed->image, t, m, 1));
            *sum += v2v_h5_rows_checksum(
                summed->image, ((i * shape[0] + t) * shape[1] + m) * shape[2], shape[2], shape[3]);
        }
    }
done:
    return rc;
}

void v2v_h5_summed_close(struct v2v_h5_summed *summed)
{
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        v2v_h5_array_close(&summed->array[i]);
    }
    v2v_mem_free(summed->image);
    *summed = (struct v2v_h5_summed){0};
}
