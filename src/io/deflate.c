#include "io/deflate.h"

#include <zlib.h>

int64_t v2v_deflate_bound(int64_t bytes)
{
    return (int64_t)compressBound((uLong)bytes);
}

void v2v_shuffle(uint8_t *out, const uint8_t *in, int64_t elements, int64_t element_bytes)
{
    for (int64_t byte = 0; byte < element_bytes; byte++) {
        for (int64_t i = 0; i < elements; i++) {
            out[byte * elements + i] = in[i * element_bytes + byte];
        }
    }
}

enum v2v_status v2v_deflate(uint8_t *out, int64_t *count, const uint8_t *in, int64_t bytes,
                            int level)
{
    uLongf stored = (uLongf)*count;
    const int outcome = compress2(out, &stored, in, (uLong)bytes, level);
    V2V_ASSERT(outcome == Z_OK || outcome == Z_MEM_ERROR);
    *count = (int64_t)stored;
    return outcome == Z_OK ? V2V_OK : V2V_FAIL(V2V_E_MEMORY, "zlib: no memory to compress with");
}
