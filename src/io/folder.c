#include "io/folder.h"
#include "v2v3d/base/memory.h"
#include "v2v3d/base/text.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char digits[] = "0123456789";

int v2v_folder_compare(const char *a, const char *b)
{
    const char *const first = a, *const second = b;
    while (*a != '\0' && *b != '\0') {
        const size_t na = strspn(a, digits), nb = strspn(b, digits);
        if (na == 0 || nb == 0) {
            if (*a != *b) {
                return (unsigned char)*a < (unsigned char)*b ? -1 : 1;
            }
            a++;
            b++;
            continue;
        }
        const char *const end_a = a + na, *const end_b = b + nb;
        a += strspn(a, "0") < na ? strspn(a, "0") : na;
        b += strspn(b, "0") < nb ? strspn(b, "0") : nb;
        const size_t la = (size_t)(end_a - a), lb = (size_t)(end_b - b);
        const int order = la != lb ? (la < lb ? -1 : 1) : memcmp(a, b, la);
        if (order != 0) {
            return order;
        }
        a = end_a;
        b = end_b;
    }
    /* one is the other's beginning, or they differ by zeros in front of numbers */
    return *a != *b ? (*a == '\0' ? -1 : 1) : strcmp(first, second);
}

static int compare_names(const void *a, const void *b)
{
    return v2v_folder_compare(*(char *const *)a, *(char *const *)b);
}

static int is_tiff(const char *name)
{
    return name[0] != '.' && v2v_file_kind_of_name(name) == V2V_FILE_TIFF;
}

static enum v2v_status add_name(struct v2v_folder *folder, int64_t *room, const char *name)
{
    enum v2v_status rc = V2V_OK;
    char **larger = NULL;
    const int64_t bytes = (int64_t)strlen(name) + 1;
    if (folder->count == *room) {
        *room = *room == 0 ? 64 : 2 * *room;
        V2V_TRY(V2V_ALLOC(larger, "io.folder", *room));
        if (folder->count > 0) {
            memcpy(larger, folder->name, (size_t)folder->count * sizeof *larger);
        }
        v2v_mem_free(folder->name);
        folder->name = larger;
    }
    V2V_TRY(V2V_ALLOC(folder->name[folder->count], "io.folder", bytes));
    memcpy(folder->name[folder->count++], name, (size_t)bytes);
done:
    return rc;
}

enum v2v_status v2v_folder_list(struct v2v_folder *folder, const char *path)
{
    enum v2v_status rc = V2V_OK;
    int64_t room = 0;
    DIR *directory = NULL;
    *folder = (struct v2v_folder){0};
    V2V_TRY(v2v_text_format(folder->path, sizeof folder->path, "%s", path));
    directory = opendir(path);
    if (directory == NULL) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: can't be listed: %s", path, strerror(errno)));
    }
    for (struct dirent *entry = readdir(directory); entry != NULL; entry = readdir(directory)) {
        if (is_tiff(entry->d_name)) {
            V2V_TRY(add_name(folder, &room, entry->d_name));
        }
    }
    if (folder->count == 0) {
        V2V_TRY(V2V_FAIL(V2V_E_INPUT, "%s: is a folder without TIFF files", path));
    }
    qsort(folder->name, (size_t)folder->count, sizeof *folder->name, compare_names);
done:
    if (directory != NULL) {
        closedir(directory);
    }
    return rc;
}

enum v2v_status v2v_folder_path(char path[V2V_PATH_BYTES], const struct v2v_folder *folder,
                                int64_t i)
{
    const size_t length = strlen(folder->path);
    const char *slash = length > 0 && folder->path[length - 1] == '/' ? "" : "/";
    return v2v_text_format(path, V2V_PATH_BYTES, "%s%s%s", folder->path, slash, folder->name[i]);
}

/* The number that two names differ by alone, that of the first. */
struct number {
    size_t first, digits; /* characters of the name */
    int64_t value;
    int64_t step; /* to that of the second; 0: they differ otherwise */
};

static struct number number_between(const char *a, const char *b)
{
    enum { MOST_DIGITS = 18 };
    struct number number = {0};
    size_t first = 0;
    while (a[first] != '\0' && a[first] == b[first]) {
        first++;
    }
    while (first > 0 && strchr(digits, a[first - 1]) != NULL) {
        first--;
    }
    const size_t na = strspn(a + first, digits), nb = strspn(b + first, digits);
    if (na > 0 && na <= MOST_DIGITS && nb > 0 && nb <= MOST_DIGITS &&
        strcmp(a + first + na, b + first + nb) == 0) {
        number =
            (struct number){.first = first, .digits = na, .value = strtoll(a + first, NULL, 10)};
        number.step = strtoll(b + first, NULL, 10) - number.value;
    }
    return number;
}

int v2v_folder_gap(char missing[V2V_PATH_BYTES], const struct v2v_folder *folder)
{
    int64_t least = INT64_MAX, pairs = 0, regular = 0;
    for (int64_t i = 0; i + 1 < folder->count; i++) {
        const int64_t step = number_between(folder->name[i], folder->name[i + 1]).step;
        if (step > 0) {
            pairs++;
            regular = step < least ? 1 : regular + (step == least);
            least = step < least ? step : least;
        }
    }
    for (int64_t i = 0; i + 1 < folder->count && 2 * regular >= pairs; i++) {
        const char *name = folder->name[i];
        const struct number number = number_between(name, folder->name[i + 1]);
        if (number.step > least) {
            (void)snprintf(missing, V2V_PATH_BYTES, "%.*s%0*lld%s", (int)number.first, name,
                           (int)number.digits, (long long)(number.value + least),
                           name + number.first + number.digits);
            return 1;
        }
    }
    return 0;
}

void v2v_folder_fini(struct v2v_folder *folder)
{
    for (int64_t i = 0; i < folder->count; i++) {
        v2v_mem_free(folder->name[i]);
    }
    v2v_mem_free(folder->name);
    *folder = (struct v2v_folder){0};
}
