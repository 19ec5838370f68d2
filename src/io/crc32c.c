#include "io/file_internal.h"

#include <string.h>

/* Remainders of the sixteen half bytes by the Castagnoli polynomial 0x1EDC6F41, bits reversed
 * (0x82F63B78): entry n is n followed by four zero bits. Source: RFC 3720 section 12.1. */
static const uint32_t half_byte_remainders[16] = {
    0x00000000, 0x105ec76f, 0x20bd8ede, 0x30e349b1, 0x417b1dbc, 0x5125dad3, 0x61c69362, 0x7198540d,
    0x82f63b78, 0x92a8fc17, 0xa24bb5a6, 0xb21572c9, 0xc38d26c4, 0xd3d3e1ab, 0xe330a81a, 0xf36e6f75,
};

uint32_t v2v_file_crc32c_portable(uint32_t crc, const void *data, int64_t bytes)
{
    const uint8_t *at = data;

    crc = ~crc;
    for (int64_t i = 0; i < bytes; i++) {
        crc ^= at[i];
        crc = half_byte_remainders[crc & 15] ^ (crc >> 4);
        crc = half_byte_remainders[crc & 15] ^ (crc >> 4);
    }
    return ~crc;
}

#ifdef V2V_X86

__attribute__((target("sse4.2"))) static uint32_t crc32c_instruction(uint32_t crc, const void *data,
                                                                     int64_t bytes)
{
    const uint8_t *at = data;
    uint64_t state = (uint32_t)~crc;
    int64_t i = 0;

    for (; i + 8 <= bytes; i += 8) {
        uint64_t word;
        memcpy(&word, at + i, sizeof word);
        state = __builtin_ia32_crc32di(state, word);
    }
    for (; i < bytes; i++) {
        state = __builtin_ia32_crc32qi((uint32_t)state, at[i]);
    }
    return ~(uint32_t)state;
}

#endif

uint32_t v2v_file_crc32c(uint32_t crc, const void *data, int64_t bytes)
{
#ifdef V2V_X86
    if (__builtin_cpu_supports("sse4.2")) {
        return crc32c_instruction(crc, data, bytes);
    }
#endif
    return v2v_file_crc32c_portable(crc, data, bytes);
}
