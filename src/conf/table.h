/** The table that everything about the configuration is derived from. */
#ifndef V2V3D_CONF_TABLE_PRIVATE_H
#define V2V3D_CONF_TABLE_PRIVATE_H

#include "v2v3d/conf/config.h"

#include <stddef.h>

enum v2v_key_kind {
    V2V_KEY_WHOLE,  /**< int64_t */
    V2V_KEY_REAL,   /**< double */
    V2V_KEY_BOOL,   /**< int */
    V2V_KEY_WORD,   /**< int, an enumeration: the place in `words` */
    V2V_KEY_NUMBER, /**< struct v2v_number */
    V2V_KEY_NAME,   /**< char[V2V_CONFIG_NAME_BYTES] */
    V2V_KEY_TEXT,   /**< char[V2V_CONFIG_TEXT_BYTES], by default empty */
};

enum {
    V2V_KEY_MOST_WORDS = 4,
    V2V_KEY_MOST = 128,
    V2V_KEY_NAME_BYTES = 64,
    V2V_KEY_VALUE_BYTES = V2V_CONFIG_TEXT_BYTES
};

struct v2v_key {
    const char *section;
    const char *name;
    enum v2v_key_kind kind;
    size_t offset; /**< in struct v2v_config */
    struct {
        int64_t least, most, fallback;
        int64_t multiple; /**< 0 or 1: any number; else the value is a multiple of this */
        int is_open;      /**< bool: may be "auto", V2V_WHOLE_AUTO, too, and is by itself */
    } whole;              /**< of V2V_KEY_WHOLE, _BOOL and _WORD */
    struct {
        double least, most, fallback;
    } real;           /**< of V2V_KEY_REAL and _NUMBER */
    const char *none; /**< the word of a V2V_KEY_NUMBER for V2V_NUMBER_NONE; NULL: it has none */
    int mode;         /**< of a V2V_KEY_NUMBER's default */
    const char *words[V2V_KEY_MOST_WORDS]; /**< of V2V_KEY_NAME: the default alone */
    const char *meaning;
};

extern const struct v2v_key v2v_key_table[];
extern const int64_t v2v_key_count;

/** Find section.name (`bytes` of section count). Index, or a failure that starts with `where` and
 *  names the nearest known key. @kind Local. @return V2V_OK | V2V_E_CONFIG */
enum v2v_status v2v_key_find(int64_t *index, const char *section, const char *name,
                             const char *where) V2V_MUST_CHECK;

/** Is there such a section? The failure names the nearest one. @kind Local.
 *  @return V2V_OK | V2V_E_CONFIG */
enum v2v_status v2v_key_find_section(const char *section, const char *where) V2V_MUST_CHECK;

/** Its value as text that v2v_key_assign takes. @kind Local. @param text [V2V_KEY_VALUE_BYTES] */
void v2v_key_format(char *text, const struct v2v_config *config, const struct v2v_key *key);

/** Set one value from text; messages start with `where`. @kind Local. @return V2V_OK |
 * V2V_E_CONFIG */
enum v2v_status v2v_key_assign(struct v2v_config *config, int64_t index, const char *text,
                               const char *where) V2V_MUST_CHECK;

/** The rules between keys. The first key that breaks one and why, or -1. @kind Local. */
int64_t v2v_key_conflict(const struct v2v_config *config, char *why, size_t bytes);

#endif
