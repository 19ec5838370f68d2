/* What a thread writes while the caller goes on, and where it lies in the file. */
#include "io/h5_common.h"
#include "io/h5_writer_internal.h"

/* Are the numbers in the file as in memory? */
static int is_of(hid_t set, hid_t type)
{
    hid_t own = set > 0 ? H5Dget_type(set) : H5I_INVALID_HID;
    const int is_same = own > 0 && H5Tequal(own, type) > 0;
    v2v_h5_close(&own);
    return is_same;
}

/* Where the numbers of frames lie in the file, in one piece; -1: they do not. */
static int64_t place_of_numbers(hid_t set, hid_t type)
{
    const haddr_t at = is_of(set, type) ? H5Dget_offset(set) : HADDR_UNDEF;
    return at != HADDR_UNDEF ? (int64_t)at : -1;
}

/* Where image (t,z) lies in the file; -1: it is not found. */
static int64_t place_of_image(hid_t set, int64_t t, int64_t z)
{
    const hsize_t first[4] = {(hsize_t)t, (hsize_t)z, 0, 0};
    haddr_t at = HADDR_UNDEF;
    hsize_t bytes = 0;
    unsigned filters = 0;
    return H5Dget_chunk_info_by_coord(set, first, &filters, &at, &bytes) >= 0 && at != HADDR_UNDEF
               ? (int64_t)at
               : -1;
}

/* Where the images lie, if one behind the other; -1: they do not. Early on their chunks were
 * allocated in this order, and nothing can have come between them but nodes of the index, which
 * move all that follow. */
static int64_t place_of_images(hid_t set, const int64_t shape[4])
{
    const int64_t images = shape[0] * shape[1];
    const int64_t bytes = shape[2] * shape[3] * (int64_t)sizeof(float);
    const int64_t at = is_of(set, H5T_NATIVE_FLOAT) ? place_of_image(set, 0, 0) : -1;
    const int64_t last = at >= 0 ? place_of_image(set, shape[0] - 1, shape[1] - 1) : -1;
    return at >= 0 && last == at + (images - 1) * bytes ? at : -1;
}

void v2v_h5_writer_find_places(struct v2v_h5_writer *writer)
{
    writer->done_place = place_of_numbers(writer->done, H5T_STD_U8LE);
    writer->checksum_place = place_of_numbers(writer->checksum, H5T_STD_U64LE);
    const int has_marks = writer->done_place >= 0 && writer->checksum_place >= 0;
    for (int i = 0; i < V2V_H5_WRITER_SETS; i++) {
        writer->place[i] = has_marks ? place_of_images(writer->set[i], writer->shape) : -1;
    }
}

/* Local: the thread, from the first time on that there is something for it to do. */
static enum v2v_status begin_behind(struct v2v_h5_writer *writer)
{
    return writer->behind != NULL
               ? V2V_OK
               : v2v_write_behind_create(&writer->behind, writer->temporary, writer->path);
}

enum v2v_status v2v_h5_writer_put_later(struct v2v_h5_writer *writer, int set, const float *images,
                                        int64_t t, int64_t first, int64_t count)
{
    enum v2v_status rc = V2V_OK;
    const int64_t *shape = writer->shape;
    const int64_t image = shape[2] * shape[3] * (int64_t)sizeof *images;
    const int64_t place = writer->place[set];
    if (count == 0 || place < 0) {
        return v2v_h5_writer_put(writer, set, images, t, first, count);
    }
    V2V_ASSERT(t >= 0 && t < shape[0] && first >= 0 && count > 0 && first + count <= shape[1]);
    V2V_TRY(begin_behind(writer));
    V2V_TRY(v2v_write_behind_put(writer->behind,
                                 &(struct v2v_piece){.data = images,
                                                     .bytes = count * image,
                                                     .at = place + (t * shape[1] + first) * image,
                                                     .fault = "h5.write"}));
    v2v_h5_writer_add_checksum(writer, set, images, t, first, count);
done:
    return rc;
}

/* Local: a number of so many bytes. */
static enum v2v_status put_number(struct v2v_h5_writer *writer, uint64_t number, int64_t bytes,
                                  int64_t at)
{
    return v2v_write_behind_put(
        writer->behind,
        &(struct v2v_piece){.number = number, .bytes = bytes, .at = at, .fault = "h5.mark"});
}

enum v2v_status v2v_h5_writer_mark_later(struct v2v_h5_writer *writer, int64_t t,
                                         const struct v2v_comm *writers)
{
    enum v2v_status rc = V2V_OK;
    if (v2v_comm_size(writers) > 1 || writer->behind == NULL) {
        V2V_TRY(v2v_par_agree(writers, v2v_h5_writer_wait(writer)));
        return v2v_h5_writer_mark_done(writer, t, writers);
    }
    V2V_ASSERT(t >= 0 && t < writer->shape[0]);
    const int64_t bytes = (int64_t)sizeof *writer->sums;
    V2V_TRY(
        put_number(writer, (uint64_t)writer->sums[t], bytes, writer->checksum_place + t * bytes));
    V2V_TRY(put_number(writer, 1, 1, writer->done_place + t));
    writer->marked = 1;
done:
    return rc;
}

enum v2v_status v2v_h5_writer_wait(struct v2v_h5_writer *writer)
{
    return writer->behind != NULL ? v2v_write_behind_wait(writer->behind) : V2V_OK;
}
