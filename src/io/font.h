#ifndef V2V_IO_FONT_H
#define V2V_IO_FONT_H

#include <stdint.h>

#define V2V_FONT_ROWS 7
#define V2V_FONT_COLUMNS 5

/** The rows of a character from top to bottom; the left column is the highest of 5 bits. What is
 *  not printable ASCII looks like '?'. @kind Local. */
const uint8_t *v2v_font_glyph(char character);

#endif
