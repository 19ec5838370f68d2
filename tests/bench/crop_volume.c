/* The middle of a volume, all slices and frames, for methods that take too long on the whole.
 *   crop_volume VOLUME.h5 SIDE OUT.h5
 * Sides that are no longer than SIDE stay.
 */
#include "v2v3d/base/bounds.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include "v2v3d/io/volume.h"
#include <stdio.h>
#include <string.h>

/* [z,y,x] of `to`'s size from [z,y,x] of `from`'s. */
static void cut(float *out, const struct v2v_volume_info *to, const float *in,
                const struct v2v_volume_info *from)
{
    const int64_t top = (from->height - to->height) / 2, left = (from->width - to->width) / 2;
    for (int64_t row = 0; row < to->slices * to->height; row++) {
        const int64_t z = row / to->height, y = row % to->height;
        memcpy(out + row * to->width, in + (z * from->height + top + y) * from->width + left,
               (size_t)to->width * sizeof *in);
    }
}

static enum v2v_status crop(const char *input, int64_t side, const char *output,
                            const struct v2v_comm *world)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volume *volume = NULL;
    struct v2v_volume_writer *writer = NULL;
    float *whole = NULL, *part = NULL;
    V2V_TRY(v2v_volume_open(&volume, input, NULL, world));
    const struct v2v_volume_info *from = v2v_volume_info(volume);
    struct v2v_volume_info to = *from;
    to.height = v2v_smaller(from->height, side);
    to.width = v2v_smaller(from->width, side);
    V2V_TRY(
        V2V_ALLOC(whole, "crop.whole", v2v_mem_product(from->slices, from->height, from->width)));
    V2V_TRY(V2V_ALLOC(part, "crop.part", v2v_mem_product(to.slices, to.height, to.width)));
    V2V_TRY(v2v_volume_create(&writer, output, &to, 1U << V2V_VOLUME_MEAN, NULL, 0, world));
    for (int64_t t = 0; t < from->frames; t++) {
        V2V_TRY(v2v_volume_read(volume, whole, t, 0, from->slices));
        cut(part, &to, whole, from);
        V2V_TRY(v2v_volume_write(writer, V2V_VOLUME_MEAN, part, t, 0, to.slices));
    }
    V2V_TRY(v2v_volume_finish(&writer));
done:
    v2v_volume_abandon(&writer);
    v2v_mem_free(part);
    v2v_mem_free(whole);
    v2v_volume_close(&volume);
    return rc;
}

int main(int argc, char **argv)
{
    struct v2v_comm *world = NULL;
    int64_t side = 0;
    if (v2v_par_init(&world, &argc, &argv) != V2V_OK) {
        fprintf(stderr, "crop_volume: %s\n", v2v_status_message());
        return 1;
    }
    if (argc != 4) {
        fprintf(stderr, "usage: crop_volume VOLUME.h5 SIDE OUT.h5\n");
        v2v_par_finalize(&world);
        return 2;
    }
    enum v2v_status rc = v2v_text_to_i64(&side, argv[2], 1, 65536, "SIDE", V2V_E_USAGE);
    if (rc == V2V_OK) {
        rc = crop(argv[1], side, argv[3], world);
    }
    if (rc != V2V_OK) {
        fprintf(stderr, "crop_volume: %s\n", v2v_status_message());
    }
    v2v_par_finalize(&world);
    return rc != V2V_OK;
}
