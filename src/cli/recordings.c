#include "cli/recordings.h"

#include "cli/steps.h"
#include "v2v3d/base/log.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"
#include <errno.h>
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Names of recordings and of what they become, by turns, each closed by a zero: one array, so that
 * all ranks have the same. */
struct names {
    char *text;
    int64_t count;
};
static const char what_names[] = "the recordings' names";

static const char *next_name(const char *name)
{
    return name + strlen(name) + 1;
}

/* ---- which recordings ---- */

/* A folder that can't be read may hold what is meant; one that isn't there holds nothing. */
static int is_serious(const char *folder, int reason)
{
    (void)folder;
    return reason != ENOENT;
}

static enum v2v_status add_globbed(FILE *to, int64_t *count, const char *pattern)
{
    glob_t found = {0};
    const int failed = glob(pattern, 0, is_serious, &found), reason = errno;
    for (size_t i = 0; failed == 0 && i < found.gl_pathc; i++) {
        (void)fwrite(found.gl_pathv[i], 1, strlen(found.gl_pathv[i]) + 1, to);
        ++*count;
    }
    globfree(&found);
    return failed == 0              ? V2V_OK
           : failed == GLOB_NOSPACE ? V2V_FAIL(V2V_E_MEMORY, "no memory for what %s means", pattern)
           : failed == GLOB_ABORTED
               ? V2V_FAIL(V2V_E_INPUT, "%s: a folder on the way: %s", pattern, strerror(reason))
               : V2V_FAIL(V2V_E_INPUT, "%s: there is no such file", pattern);
}

/* The mark that editors put in front of UTF-8. */
static const char byte_order_mark[] = "\xef\xbb\xbf";
enum { MARK = sizeof byte_order_mark - 1 };

/* Lines as they stand there, of Windows' ends or others; empty ones are none. */
static enum v2v_status add_listed(FILE *to, int64_t *count, const char *path)
{
    const int64_t before = *count;
    char *line = NULL;
    size_t room = 0;
    int is_first = 1;
    FILE *list = fopen(path, "r");
    if (list == NULL) {
        return V2V_FAIL(V2V_E_INPUT, "%s: %s", path, strerror(errno));
    }
    while (getline(&line, &room, list) >= 0) {
        const size_t mark = is_first && strncmp(line, byte_order_mark, MARK) == 0 ? MARK : 0;
        const char *name = line + mark;
        line[strcspn(line, "\r\n")] = '\0';
        if (name[0] != '\0') {
            (void)fwrite(name, 1, strlen(name) + 1, to);
            ++*count;
        }
        is_first = 0;
    }
    const int failed = ferror(list);
    free(line);
    (void)fclose(list);
    return failed             ? V2V_FAIL(V2V_E_INPUT, "%s: can't be read", path)
           : *count == before ? V2V_FAIL(V2V_E_INPUT, "%s: names no recording", path)
                              : V2V_OK;
}

/* A word that is a file's name means that file, whatever characters it has. */
static enum v2v_status add_word(FILE *to, int64_t *count, const char *word)
{
    if (!v2v_file_exists(word) && word[0] == '@') {
        return add_listed(to, count, word + 1);
    }
    if (!v2v_file_exists(word) && strpbrk(word, "*?[") != NULL) {
        return add_globbed(to, count, word);
    }
    (void)fwrite(word, 1, strlen(word) + 1, to);
    ++*count;
    return V2V_OK;
}

/* Rank 0: the command line's words become names. To be freed with free(). */
static enum v2v_status list_names(char **text, size_t *bytes, int64_t *count,
                                  const struct v2v_words *words)
{
    enum v2v_status rc = V2V_OK;
    FILE *to = NULL;
    V2V_TRY(v2v_text_open(&to, text, bytes, what_names));
    for (int64_t i = 0; i < words->count && rc == V2V_OK; i++) {
        rc = add_word(to, count, words->item[i]);
    }
    rc = v2v_text_close(rc, to, text, what_names);
done:
    return rc;
}

/* ---- where to ---- */

static int is_folder_name(const char *pattern)
{
    const size_t length = strlen(pattern);
    return strstr(pattern, "%n") == NULL &&
           ((length > 0 && pattern[length - 1] == '/') || v2v_file_is_folder(pattern));
}

/* The recording's name without its folder and ending. */
static void stem_of(char stem[V2V_PATH_BYTES], const char *path)
{
    size_t end = strlen(path);
    while (end > 1 && path[end - 1] == '/') { /* a recording that is a folder */
        end--;
    }
    size_t first = end;
    while (first > 0 && path[first - 1] != '/') {
        first--;
    }
    snprintf(stem, V2V_PATH_BYTES, "%.*s", (int)(end - first), path + first);
    char *dot = v2v_file_is_folder(path) ? NULL : strrchr(stem, '.');
    if (dot != NULL && dot != stem) {
        *dot = '\0';
    }
}

/* FOLDER/NAME.h5, or the pattern with the name for every %n in it. */
static enum v2v_status name_output(char output[V2V_PATH_BYTES], const char *pattern,
                                   const char *recording)
{
    char stem[V2V_PATH_BYTES];
    enum v2v_status rc = V2V_OK;
    size_t used = 0;
    stem_of(stem, recording);
    if (is_folder_name(pattern)) {
        return v2v_text_format(output, V2V_PATH_BYTES, "%s%s%s.h5", pattern,
                               pattern[strlen(pattern) - 1] == '/' ? "" : "/", stem);
    }
    output[0] = '\0';
    for (const char *at = pattern; *at != '\0'; used = strlen(output)) {
        const char *name = strstr(at, "%n");
        const size_t plain = name != NULL ? (size_t)(name - at) : strlen(at);
        V2V_TRY(v2v_text_format(output + used, V2V_PATH_BYTES - used, "%.*s%s", (int)plain, at,
                                name != NULL ? stem : ""));
        at += plain + (name != NULL ? 2 : 0);
    }
done:
    return rc;
}

/* Two recordings of one name would write one file. Rank 0. */
static enum v2v_status check_twins(const struct names *names)
{
    const char *one = names->text;
    for (int64_t i = 0; i < names->count; i++, one = next_name(next_name(one))) {
        const char *other = next_name(next_name(one));
        for (int64_t k = i + 1; k < names->count; k++, other = next_name(next_name(other))) {
            if (strcmp(next_name(one), next_name(other)) == 0) {
                return V2V_FAIL(V2V_E_USAGE, "%s and %s would both become %s", one, other,
                                next_name(one));
            }
        }
    }
    return V2V_OK;
}

/* Rank 0: each recording and its output. To be freed with free(). */
static enum v2v_status pair_up(struct names *pairs, size_t *bytes, const struct names *recordings,
                               const char *pattern)
{
    enum v2v_status rc = V2V_OK;
    const char *recording = recordings->text;
    char output[V2V_PATH_BYTES];
    FILE *to = NULL;
    V2V_TRY(v2v_text_open(&to, &pairs->text, bytes, what_names));
    for (int64_t i = 0; i < recordings->count && rc == V2V_OK; i++) {
        rc = name_output(output, pattern, recording);
        (void)fwrite(recording, 1, strlen(recording) + 1, to);
        (void)fwrite(output, 1, strlen(output) + 1, to);
        recording = next_name(recording);
    }
    pairs->count = recordings->count;
    rc = v2v_text_close(rc, to, &pairs->text, what_names);
done:
    return rc;
}

/* Rank 0: everything that can be said of the names. */
static enum v2v_status find_names(struct names *pairs, size_t *bytes,
                                  const struct v2v_volumes *given)
{
    enum v2v_status rc = V2V_OK;
    struct names recordings = {0};
    size_t listed = 0;
    V2V_TRY(list_names(&recordings.text, &listed, &recordings.count, &given->inputs));
    if (recordings.count > 1 && strstr(given->output, "%n") == NULL &&
        !is_folder_name(given->output)) {
        V2V_TRY(V2V_FAIL(V2V_E_USAGE,
                         "%s: volumes of %lld recordings need a folder, or %%n in the name for the "
                         "recording's",
                         given->output, (long long)recordings.count));
    }
    V2V_TRY(pair_up(pairs, bytes, &recordings, given->output));
    V2V_TRY(check_twins(pairs));
done:
    free(recordings.text);
    return rc;
}

/* Collective. */
static enum v2v_status share_names(struct names *names, const struct v2v_volumes *given,
                                   const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct names found = {0};
    size_t bytes = 0;
    int64_t sizes[2] = {0};
    if (v2v_step_on_root(session)) {
        rc = find_names(&found, &bytes, given);
        sizes[0] = (int64_t)bytes;
        sizes[1] = found.count;
    }
    V2V_TRY(v2v_par_agree(session->world, rc));
    v2v_par_broadcast(session->world, sizes, (int64_t)sizeof sizes, 0);
    rc = V2V_ALLOC(names->text, "cli.recordings", sizes[0]);
    V2V_TRY(v2v_par_agree(session->world, rc));
    if (found.text != NULL) {
        memcpy(names->text, found.text, (size_t)sizes[0]);
    }
    v2v_par_broadcast(session->world, names->text, sizes[0], 0);
    names->count = sizes[1];
done:
    free(found.text);
    return rc;
}

/* Collective: do the words of the command line fit together, for every recording? */
static enum v2v_status check_words(const struct names *names, const struct v2v_volumes *given)
{
    enum v2v_status rc = V2V_OK;
    struct v2v_volumes one = *given;
    struct v2v_part frames;
    one.input = names->text;
    for (int64_t i = 0; i < names->count; i++, one.input = next_name(one.output)) {
        one.output = next_name(one.input);
        V2V_TRY(v2v_volumes_check(&frames, &one));
    }
done:
    return rc;
}

/* PSFs, weights, calibration: some may be NULL. */
enum { OTHERS = 3 };

/* All recordings, and their inodes, by which rank 0 sees at once which outputs are to be looked at
 * more closely: comparing every output with every recording in the file system takes long. */
struct all {
    const char **recording; /* and behind them the inputs that all have in common */
    int64_t *inode;         /* 0: there is no such file */
    int64_t count;
};

static enum v2v_status list_all(struct all *all, const struct names *names,
                                const struct v2v_volumes *given)
{
    enum v2v_status rc = V2V_OK;
    const char *recording = names->text;
    V2V_TRY(V2V_ALLOC(all->recording, "cli.recordings", names->count + OTHERS));
    V2V_TRY(V2V_ALLOC(all->inode, "cli.recordings", names->count));
    all->count = names->count;
    for (int64_t i = 0; i < names->count; i++, recording = next_name(next_name(recording))) {
        struct v2v_file_state state;
        all->recording[i] = recording;
        all->inode[i] = v2v_file_remember(&state, recording) == V2V_OK ? state.inode : 0;
    }
    all->recording[names->count] = given->psf;
    all->recording[names->count + 1] = given->weights;
    all->recording[names->count + 2] = given->calibration;
done:
    return rc;
}

static int may_be_one(const struct all *all, const char *output)
{
    struct v2v_file_state state;
    if (v2v_file_remember(&state, output) == V2V_OK) {
        for (int64_t i = 0; i < all->count; i++) {
            if (all->inode[i] == state.inode) {
                return 1;
            }
        }
    }
    return 0;
}

/* Collective: outputs that are there are refused before anything is made, and so are those that
 * would overwrite an input, be it another one's recording. */
static enum v2v_status check_outputs(const struct names *names, const struct v2v_volumes *given,
                                     const struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct all all = {0};
    V2V_TRY(v2v_par_agree(session->world, list_all(&all, names, given)));
    for (int64_t i = 0; i < names->count; i++) {
        const char *const own[] = {given->psf, given->weights, given->calibration,
                                   all.recording[i]};
        const char *output = next_name(all.recording[i]);
        const int is_near = v2v_step_on_root(session) && may_be_one(&all, output);
        V2V_TRY(v2v_step_output_or_resume(
            session, output, is_near ? all.recording : own,
            is_near ? all.count + OTHERS : (int64_t)(sizeof own / sizeof *own), given->resume));
    }
done:
    v2v_mem_free(all.recording);
    v2v_mem_free(all.inode);
    return rc;
}

/* Collective: is the output a folder that is still to be made? */
static int is_new_folder(const char *output, const struct v2v_session *session)
{
    int is_new = is_folder_name(output) && !v2v_file_is_folder(output);
    v2v_par_broadcast(session->world, &is_new, (int64_t)sizeof is_new, 0);
    return is_new;
}

/* Collective. */
static enum v2v_status make_folder(const char *output, const struct v2v_session *session)
{
    return v2v_par_agree(session->world,
                         v2v_step_on_root(session) ? v2v_file_make_folder(output) : V2V_OK);
}

/* ---- one after the other ---- */

/* What became of all of them. */
struct tally {
    int64_t recordings, done, frames, frames_done;
    enum v2v_status first; /* failure */
    char message[V2V_MESSAGE_BYTES];
};

/* Does it leave the other recordings untouched? */
static int is_its_own(enum v2v_status rc)
{
    return rc == V2V_E_INPUT || rc == V2V_E_BUSY;
}

static void count(struct tally *tally, enum v2v_status rc, const struct v2v_volumes_result *result)
{
    tally->done += rc == V2V_OK;
    tally->frames += result->frames;
    tally->frames_done += result->before + result->now;
    if (rc != V2V_OK && tally->first == V2V_OK) {
        tally->first = rc;
        snprintf(tally->message, sizeof tally->message, "%.800s", v2v_step_message());
    }
}

/* Collective: settings are those of the command line again for every recording. */
static enum v2v_status make_one(struct tally *tally, const struct v2v_volumes *given,
                                const char *recording, const struct v2v_volumes_tools *tools,
                                const struct v2v_session *session)
{
    struct v2v_volumes_result result = {0};
    struct v2v_volumes one = *given;
    struct v2v_session own = *session;
    one.input = recording;
    one.output = next_name(recording);
    one.result = &result;
    const enum v2v_status rc =
        v2v_par_agree(session->world, v2v_volumes_of(&one, tools, NULL, &own));
    count(tally, rc, &result);
    return rc;
}

/* Collective: one line for all of them, and the first failure's code. */
static enum v2v_status close_tally(const struct tally *tally, enum v2v_status rc,
                                   const struct v2v_session *session)
{
    if (v2v_step_on_root(session)) {
        v2v_log(V2V_LOG_INFO, "%lld of %lld recordings, %lld of %lld frames%s",
                (long long)tally->done, (long long)tally->recordings, (long long)tally->frames_done,
                (long long)tally->frames,
                tally->done < tally->recordings ? " of those that could be opened" : "");
    }
    if (rc == V2V_OK && tally->first != V2V_OK) {
        rc = V2V_FAIL(tally->first, "%lld of %lld recordings failed, the first one: %s",
                      (long long)(tally->recordings - tally->done), (long long)tally->recordings,
                      tally->message);
    }
    return rc;
}

enum v2v_status v2v_recordings_make(const struct v2v_volumes *given,
                                    const struct v2v_estimator_ops *ops,
                                    struct v2v_session *session)
{
    enum v2v_status rc = V2V_OK;
    struct names names = {0};
    struct tally tally = {0};
    struct v2v_volumes_tools tools = {0};
    V2V_TRY(share_names(&names, given, session));
    V2V_TRY(check_words(&names, given));
    const int is_new = is_new_folder(given->output, session); /* in which nothing is */
    if (!is_new) {
        V2V_TRY(check_outputs(&names, given, session));
    }
    V2V_TRY(v2v_par_agree(session->world, v2v_volumes_begin(&tools, given, ops, session)));
    if (is_new) {
        V2V_TRY(make_folder(given->output, session));
    }
    tally.recordings = names.count;
    const char *recording = names.text;
    for (int64_t i = 0; i < names.count; i++, recording = next_name(next_name(recording))) {
        rc = make_one(&tally, given, recording, &tools, session);
        if (names.count > 1 && is_its_own(rc)) {
            if (v2v_step_on_root(session)) {
                v2v_log(V2V_LOG_WARNING, "%s", v2v_step_message());
            }
            rc = V2V_OK;
        }
        if (rc != V2V_OK) {
            break;
        }
    }
    if (names.count > 1) {
        rc = close_tally(&tally, rc, session);
    }
done:
    v2v_volumes_end(&tools);
    v2v_mem_free(names.text);
    return rc;
}
