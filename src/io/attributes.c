#include "v2v3d/io/attributes.h"

#include "io/h5_common.h"
#include "io/h5_guard.h"
#include "v2v3d/base/memory.h"
#include <string.h>

/* HDF5 keeps attributes of 64 KiB at most, but for dense storage. */
enum { NAME_BYTES = 256, TEXT_BYTES = 65536 };

struct reading {
    const struct v2v_attribute_reader *reader;
    const char *path;
    char *text; /* [TEXT_BYTES] */
};

/* One that is neither is passed over. */
static herr_t read_one(hid_t file, const char *name, const H5A_info_t *info, void *data)
{
    const struct reading *reading = data;
    const struct v2v_attribute_reader *reader = reading->reader;
    double number = 0.0;
    int found = 0;
    (void)info;
    if (strlen(name) >= NAME_BYTES) {
        return 0;
    }
    if (v2v_h5_get_text(reading->text, TEXT_BYTES, &found, file, reading->path, name) == V2V_OK &&
        found) {
        reader->text(reader->context, name, reading->text);
    } else if (v2v_h5_get_numbers(&number, &found, file, reading->path, name, 1) == V2V_OK &&
               found) {
        reader->number(reader->context, name, number);
    }
    return 0;
}

enum v2v_status v2v_attributes_read(const char *path, const struct v2v_attribute_reader *reader)
{
    enum v2v_status rc = V2V_OK;
    struct reading reading = {.reader = reader, .path = path};
    struct v2v_file_state state;
    hid_t file = H5I_INVALID_HID;
    V2V_TRY(v2v_h5_guard_input(&state, path));
    V2V_TRY(v2v_h5_open(&file, path));
    V2V_TRY(V2V_ALLOC(reading.text, "io.attributes", TEXT_BYTES));
    if (H5Aiterate(file, H5_INDEX_NAME, H5_ITER_INC, NULL, read_one, &reading) < 0) {
        rc = V2V_H5_FAIL(V2V_E_INPUT, path, "/", "its attributes can't be read");
    }
    V2V_TRY(v2v_file_unchanged(rc, &state, path));
done:
    v2v_mem_free(reading.text);
    v2v_h5_close(&file);
    return rc;
}
