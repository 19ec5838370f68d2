/** Options as data: one table a command, from which parsing, `--help` and every error come. */
#ifndef V2V_CLI_OPTIONS_H
#define V2V_CLI_OPTIONS_H

#include "v2v3d/base/status.h"
#include "v2v3d/conf/config.h"
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

enum v2v_option_kind {
    V2V_OPTION_END = 0,  /**< closes a table */
    V2V_OPTION_FLAG,     /**< int: 1 when given */
    V2V_OPTION_TEXT,     /**< const char * */
    V2V_OPTION_INTEGER,  /**< int64_t in [least, most] */
    V2V_OPTION_NUMBER,   /**< double in [least, most] */
    V2V_OPTION_DURATION, /**< double, seconds: 90, 20m, 3h */
    V2V_OPTION_CHOICE,   /**< int: index into the words of `value`, "sum|mean" */
    V2V_OPTION_LIST,     /**< struct v2v_words: repeatable, and takes the words that follow it */
    V2V_OPTION_SETTING,  /**< a short name for `--set KEY=value`, KEY in `key` */
    V2V_OPTION_OPERAND,  /**< const char *: the word without an option */
    V2V_OPTION_REST      /**< struct v2v_rest: all words after "--", whatever they are */
};

/** Words in the order of the command line, borrowed from it. */
struct v2v_words {
    const char **item;
    int64_t count;
};

/** The same, as they stand there. */
struct v2v_rest {
    char *const *item;
    int count;
};

struct v2v_option {
    const char *name;          /**< without the dashes */
    char letter;               /**< 'o' for -o; 0: none */
    enum v2v_option_kind kind; /**< what it takes */
    size_t at;                 /**< offset of the destination in the command's arguments */
    const char *value;         /**< name of the value in the help; the words of a CHOICE; NULL: it
                                    takes none (a SETTING then becomes true) */
    const char *help;
    int required;        /**< bool; then `least` of an INTEGER is above 0 */
    const char *initial; /**< taken when it is not given; NULL: zero */
    const char *key;     /**< SETTING: the configuration's key */
    const char *needs;   /**< name of the option without which it means nothing; NULL: none */
    double least, most;  /**< of INTEGER and NUMBER */
};

/** One change of the configuration that the command line asks for. */
struct v2v_assignment {
    const char *option; /**< as typed on the command line, for messages */
    const char *key;    /**< NULL: `text` is "section.key=value" */
    const char *text;
};

/** What every command takes; the first member of every command's arguments. */
struct v2v_common {
    int help, force, quiet, verbose, mem_report;
    const char *config, *proof;
    struct v2v_assignment *assignments;
    int64_t assignment_count;
};

/** Fill `arguments` (a struct whose first member is struct v2v_common, zeroed by the caller) from
 *  words argv[0] .. argv[argc-1]. With --help the required options may be missing.
 *  @kind Local. @return V2V_OK | V2V_E_USAGE | V2V_E_MEMORY; v2v_options_fini after both */
enum v2v_status v2v_options_parse(void *arguments, const struct v2v_option *table, int argc,
                                  char *const *argv) V2V_MUST_CHECK;

/** Apply --set and the SETTING options, in the order of the command line, on top of `config`.
 *  @kind Local. @return V2V_OK | V2V_E_USAGE (a SETTING's value) | V2V_E_CONFIG (--set) */
enum v2v_status v2v_options_apply(const struct v2v_common *common,
                                  struct v2v_config *config) V2V_MUST_CHECK;

/** Does the command line set this key of the configuration, by --set or a SETTING option?
 *  @kind Local. */
int v2v_options_set(const struct v2v_common *common, const char *key);

/** The first option of the command line whose key begins with `prefix`, without dashes ("set" of
 *  --set); NULL: none. @kind Local. */
const char *v2v_options_of(const struct v2v_common *common, const char *prefix);

/** Print the table's options, then the common ones. @kind Local. */
void v2v_options_help(FILE *stream, const struct v2v_option *table);

/** Give back what parsing took. @kind Local. */
void v2v_options_fini(void *arguments, const struct v2v_option *table);

#endif
