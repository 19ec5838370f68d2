#include "v2v3d/base/text.h"

#include <ctype.h>
#include <errno.h>
#include <locale.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

enum v2v_status v2v_text_to_i64(int64_t *value, const char *text, int64_t least, int64_t most,
                                const char *what, enum v2v_status code)
{
    const char *digits = text + (*text == '-' || *text == '+');
    char *end = NULL;
    if (!isdigit((unsigned char)*digits)) {
        return V2V_FAIL(code, "%s: '%s' is not a whole number", what, text);
    }
    errno = 0;
    long long number = strtoll(text, &end, 10);
    if (*end != '\0') {
        return V2V_FAIL(code, "%s: '%s' is not a whole number", what, text);
    }
    if (errno == ERANGE || number < least || number > most) {
        return V2V_FAIL(code, "%s: %s is outside [%lld, %lld]", what, text, (long long)least,
                        (long long)most);
    }
    *value = number;
    return V2V_OK;
}

/** strtod as in the "C" locale. */
static double to_double(const char *text, char **end)
{
    locale_t plain = newlocale(LC_NUMERIC_MASK, "C", (locale_t)0);
    if (plain == (locale_t)0) {
        return strtod(text, end);
    }
    double number = strtod_l(text, end, plain);
    freelocale(plain);
    return number;
}

enum v2v_status v2v_text_to_f64(double *value, const char *text, double least, double most,
                                const char *what, enum v2v_status code)
{
    char *end = NULL;
    /* No blanks, no hexadecimal, no "inf", no "nan". */
    if (*text == '\0' || text[strspn(text, "0123456789+-.eE")] != '\0') {
        return V2V_FAIL(code, "%s: '%s' is not a number", what, text);
    }
    double number = to_double(text, &end);
    if (end == text || *end != '\0') {
        return V2V_FAIL(code, "%s: '%s' is not a number", what, text);
    }
    if (!isfinite(number) || number < least || number > most) {
        return V2V_FAIL(code, "%s: %s is outside [%.9g, %.9g]", what, text, least, most);
    }
    *value = number;
    return V2V_OK;
}

int64_t v2v_text_count_listed(const char *text)
{
    int64_t count = *text != '\0';
    for (; *text != '\0'; text++) {
        count += *text == ',';
    }
    return count;
}

enum v2v_status v2v_text_to_pairs(double (*pair)[2], const char *text, double least, double most,
                                  const char *what, const char *one)
{
    enum v2v_status rc = V2V_OK;
    const int64_t count = v2v_text_count_listed(text);
    for (int64_t i = 0; i < count; i++) {
        char number[2][32] = {"", ""};
        int read = 0;
        (void)sscanf(text, " %31[0-9eE.+-] %31[0-9eE.+-] %n", number[0], number[1], &read);
        if (read == 0 || (text[read] != ',' && text[read] != '\0')) {
            V2V_TRY(V2V_FAIL(V2V_E_CONFIG, "%s: %s %lld is not a pair 'y x': '%s'", what, one,
                             (long long)i, text));
        }
        for (int axis = 0; axis < 2; axis++) {
            V2V_TRY(v2v_text_to_f64(&pair[i][axis], number[axis], least, most, what, V2V_E_CONFIG));
        }
        text += read + 1;
    }
done:
    return rc;
}

enum { MOST_WORD = 64 };

static int smallest(int a, int b, int c)
{
    int least = a < b ? a : b;
    return least < c ? least : c;
}

/** Edit distance with insertions, deletions, substitutions and swaps of neighbours. */
static int distance(const char *a, const char *b)
{
    size_t la = strlen(a), lb = strlen(b);
    int row[3][MOST_WORD + 1];
    if (la > MOST_WORD || lb > MOST_WORD) {
        return MOST_WORD;
    }
    int *before = row[0], *above = row[1], *here = row[2];
    for (size_t j = 0; j <= lb; j++) {
        above[j] = (int)j;
    }
    for (size_t i = 1; i <= la; i++) {
        here[0] = (int)i;
        for (size_t j = 1; j <= lb; j++) {
            here[j] =
                smallest(above[j] + 1, here[j - 1] + 1, above[j - 1] + (a[i - 1] != b[j - 1]));
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
                here[j] = smallest(here[j], before[j - 2] + 1, here[j]);
            }
        }
        int *oldest = before;
        before = above;
        above = here;
        here = oldest;
    }
    return above[lb];
}

const char *v2v_text_nearest(const char *word, const char *const *candidates, int64_t count)
{
    const char *nearest = NULL;
    int least = (int)(strnlen(word, MOST_WORD) / 2) + 1;
    for (int64_t i = 0; i < count; i++) {
        int d = distance(word, candidates[i]);
        if (d < least) {
            least = d;
            nearest = candidates[i];
        }
    }
    return nearest;
}

int v2v_text_ends_in(const char *text, const char *ending)
{
    const size_t length = strlen(text), tail = strlen(ending);
    return length >= tail && strcasecmp(text + length - tail, ending) == 0;
}

enum v2v_status v2v_text_format(char *text, size_t bytes, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(text, bytes, format, arguments);
    va_end(arguments);
    if (length < 0 || (size_t)length >= bytes) {
        return V2V_FAIL(V2V_E_INPUT, "'%.80s...' is longer than %zu bytes", bytes > 0 ? text : "",
                        bytes);
    }
    return V2V_OK;
}

enum v2v_status v2v_text_open(FILE **stream, char **text, size_t *bytes, const char *what)
{
    *text = NULL;
    *stream = open_memstream(text, bytes);
    return *stream != NULL ? V2V_OK : V2V_FAIL(V2V_E_MEMORY, "no memory for %s", what);
}

enum v2v_status v2v_text_close(enum v2v_status rc, FILE *stream, char *const *text,
                               const char *what)
{
    const int is_short = ferror(stream) != 0;
    const int is_whole = fclose(stream) == 0 && !is_short && *text != NULL;
    return rc == V2V_OK && !is_whole ? V2V_FAIL(V2V_E_MEMORY, "no memory for %s", what) : rc;
}
