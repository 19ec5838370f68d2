/** TIFF files laid out by hand, so that a test can change any field: header, directories of equal
 *  size, description, then the pages' data one after the other (as ImageJ stores large stacks). */
#ifndef V2V_TEST_TIFF_BYTES_H
#define V2V_TEST_TIFF_BYTES_H

#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <tiff.h>

enum { TIFF_BYTES_ENTRIES = 11, TIFF_BYTES_MOST = 8192 };

struct tiff_bytes {
    unsigned char data[TIFF_BYTES_MOST];
    size_t size;
    int big_endian;
};

static inline void tiff_bytes_put(struct tiff_bytes *file, size_t at, uint32_t value, int bytes)
{
    for (int i = 0; i < bytes; i++) {
        int shift = 8 * (file->big_endian ? bytes - 1 - i : i);
        file->data[at + (size_t)i] = (unsigned char)(value >> shift);
    }
}

static inline size_t tiff_bytes_directory(int page)
{
    return 8 + (size_t)page * (2 + 12 * TIFF_BYTES_ENTRIES + 4);
}

/** Where the pointer to the next directory lies. */
static inline size_t tiff_bytes_next(int page)
{
    return tiff_bytes_directory(page + 1) - 4;
}

/** Set entry number `index` of a page; a SHORT lies in the first bytes of the value. */
static inline void tiff_bytes_entry(struct tiff_bytes *file, int page, int index, int tag, int type,
                                    uint32_t count, uint32_t value)
{
    size_t at = tiff_bytes_directory(page) + 2 + 12 * (size_t)index;
    tiff_bytes_put(file, at, (uint32_t)tag, 2);
    tiff_bytes_put(file, at + 2, (uint32_t)type, 2);
    tiff_bytes_put(file, at + 4, count, 4);
    tiff_bytes_put(file, at + 8, 0, 4);
    tiff_bytes_put(file, at + 8, value, type == TIFF_SHORT && count == 1 ? 2 : 4);
}

/** `directories` pages of 16-bit samples with a description; data for `pages`, sample i of the
 *  whole stack being i + 1. */
static inline void tiff_bytes_make(struct tiff_bytes *file, int big_endian, int directories,
                                   int pages, uint32_t height, uint32_t width,
                                   const char *description)
{
    const size_t text_at = tiff_bytes_directory(directories);
    const size_t text_bytes = strlen(description) + 1;
    const size_t data_at = (text_at + text_bytes + 7) / 8 * 8;
    const uint32_t samples = height * width;

    memset(file, 0, sizeof *file);
    file->big_endian = big_endian;
    memcpy(file->data, big_endian ? "MM" : "II", 2);
    tiff_bytes_put(file, 2, 42, 2);
    tiff_bytes_put(file, 4, 8, 4);
    for (int page = 0; page < directories; page++) {
        const uint32_t from = (uint32_t)data_at + (uint32_t)page * samples * 2;
        const struct {
            int tag, type;
            uint32_t count, value;
        } entries[TIFF_BYTES_ENTRIES] = {
            {256, TIFF_LONG, 1, width},  {257, TIFF_LONG, 1, height},
            {258, TIFF_SHORT, 1, 16},    {259, TIFF_SHORT, 1, 1},
            {262, TIFF_SHORT, 1, 1},     {270, TIFF_ASCII, (uint32_t)text_bytes, (uint32_t)text_at},
            {273, TIFF_LONG, 1, from},   {277, TIFF_SHORT, 1, 1},
            {278, TIFF_LONG, 1, height}, {279, TIFF_LONG, 1, samples * 2},
            {339, TIFF_SHORT, 1, 1},
        };
        tiff_bytes_put(file, tiff_bytes_directory(page), TIFF_BYTES_ENTRIES, 2);
        for (int i = 0; i < TIFF_BYTES_ENTRIES; i++) {
            tiff_bytes_entry(file, page, i, entries[i].tag, entries[i].type, entries[i].count,
                             entries[i].value);
        }
        size_t next = page + 1 < directories ? tiff_bytes_directory(page + 1) : 0;
        tiff_bytes_put(file, tiff_bytes_next(page), (uint32_t)next, 4);
    }
    memcpy(file->data + text_at, description, text_bytes);
    for (uint32_t i = 0; i < samples * (uint32_t)pages; i++) {
        tiff_bytes_put(file, data_at + 2 * (size_t)i, i + 1, 2);
    }
    file->size = data_at + 2 * (size_t)samples * (size_t)pages;
}

/** @return 1 when all `bytes` were written */
static inline int tiff_bytes_save(const char *path, const unsigned char *data, size_t bytes)
{
    FILE *stream = fopen(path, "wb");
    if (stream == NULL) {
        return 0;
    }
    size_t written = fwrite(data, 1, bytes, stream);
    return fclose(stream) == 0 && written == bytes;
}

#endif
