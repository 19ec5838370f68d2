#include "v2v3d/base/log.h"

#include "v2v3d/base/clock.h"

#include <math.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#define LINE_BYTES 2048
#define BAR_BYTES 512
/* Seconds between two drawings: fast enough to look alive, slow enough to cost nothing. */
#define TERMINAL_PERIOD 0.1
#define PLAIN_PERIOD 10.0

/* The log sink: what the one writer must know. Everything goes out through write(2), a whole line
 * at a time, so that lines of several ranks and threads don't mix. */
static struct {
    pthread_mutex_t lock;
    enum v2v_log_level level;
    int rank;
    int ranks;
    char bar[BAR_BYTES]; /* the bar that stands on the terminal's last line, "" when none does */
} sink = {.lock = PTHREAD_MUTEX_INITIALIZER, .level = V2V_LOG_INFO, .rank = 0, .ranks = 1};

void v2v_log_configure(enum v2v_log_level level, int rank)
{
    pthread_mutex_lock(&sink.lock);
    sink.level = level;
    sink.rank = rank;
    pthread_mutex_unlock(&sink.lock);
}

void v2v_log_set_rank(int rank, int ranks)
{
    pthread_mutex_lock(&sink.lock);
    sink.rank = rank;
    sink.ranks = ranks;
    pthread_mutex_unlock(&sink.lock);
}

/** A closed or full stderr must not cost results: what can't be written is dropped. */
static void put(const char *text, size_t bytes)
{
    while (bytes > 0) {
        ssize_t written = write(STDERR_FILENO, text, bytes);
        if (written <= 0) {
            return;
        }
        text += written;
        bytes -= (size_t)written;
    }
}

/** One line, above the bar when there is one. The caller holds the lock. */
static void put_line(const char *text)
{
    char block[LINE_BYTES + BAR_BYTES + 16];
    const char *clear = sink.bar[0] != '\0' ? "\r\033[K" : "";
    int length = snprintf(block, sizeof block, "%s%s\n%s", clear, text, sink.bar);
    put(block, (size_t)length < sizeof block ? (size_t)length : sizeof block - 1);
}

/** Names out of files may hold anything; a terminal must not obey them. */
static void make_printable(char *text)
{
    for (char *c = text; *c != '\0'; c++) {
        if ((unsigned char)*c < 0x20 || *c == 0x7f) {
            *c = *c == '\n' || *c == '\t' ? ' ' : '?';
        }
    }
}

void v2v_log(enum v2v_log_level level, const char *format, ...)
{
    static const char *const label[] = {"error", "warning", "", "debug"};
    char text[LINE_BYTES];
    int length = 0;
    va_list arguments;

    pthread_mutex_lock(&sink.lock);
    if (level <= sink.level && (level <= V2V_LOG_WARNING || sink.rank == 0)) {
        if (level <= V2V_LOG_WARNING && sink.ranks > 1) {
            length = snprintf(text, sizeof text, "%s (rank %d): ", label[level], sink.rank);
        } else if (level != V2V_LOG_INFO) {
            length = snprintf(text, sizeof text, "%s: ", label[level]);
        }
        va_start(arguments, format);
        vsnprintf(text + length, sizeof text - (size_t)length, format, arguments);
        va_end(arguments);
        make_printable(text);
        put_line(text);
    }
    pthread_mutex_unlock(&sink.lock);
}

/** "1:02:03", "2:03" or "-:--" when it isn't known. */
static void format_seconds(char *text, size_t bytes, double seconds)
{
    if (!(seconds >= 0.0 && seconds < 3.6e9)) {
        snprintf(text, bytes, "-:--");
        return;
    }
    int64_t s = (int64_t)(seconds + 0.5);
    if (s >= 3600) {
        snprintf(text, bytes, "%lld:%02d:%02d", (long long)(s / 3600), (int)(s / 60 % 60),
                 (int)(s % 60));
    } else {
        snprintf(text, bytes, "%d:%02d", (int)(s / 60), (int)(s % 60));
    }
}

static void format_progress(char *text, size_t bytes, const struct v2v_progress *progress)
{
    char gauge[32] = "";
    char elapsed[24], remaining[24];
    double seconds = v2v_clock_now() - progress->started;
    double rate = seconds > 0.0 ? (double)(progress->done - progress->first) / seconds : 0.0;
    double share = progress->total > 0 ? (double)progress->done / (double)progress->total : 1.0;
    double left = (double)(progress->total - progress->done);

    share = fmin(fmax(share, 0.0), 1.0);
    const double until = progress->most_s > 0.0 ? fmax(progress->most_s - seconds, 0.0) : INFINITY;
    const double by_rate = left <= 0.0 ? 0.0 : rate > 0.0 ? left / rate : INFINITY;
    format_seconds(elapsed, sizeof elapsed, seconds);
    format_seconds(remaining, sizeof remaining, fmin(by_rate, until));
    if (progress->on_terminal) {
        enum { WIDTH = 20 };
        int filled = (int)(share * WIDTH);
        gauge[0] = '[';
        memset(gauge + 1, '#', (size_t)filled);
        memset(gauge + 1 + filled, '.', (size_t)(WIDTH - filled));
        memcpy(gauge + 1 + WIDTH, "] ", 3);
    }
    snprintf(text, bytes, "%s %s%lld/%lld %3.0f%%, %.3g/s, %s elapsed, %s left%s%s",
             progress->title, gauge, (long long)progress->done, (long long)progress->total,
             100.0 * share, rate, elapsed, remaining, progress->note[0] != '\0' ? ", " : "",
             progress->note);
    make_printable(text);
}

static size_t terminal_columns(void)
{
    struct winsize window;
    if (ioctl(STDERR_FILENO, TIOCGWINSZ, &window) == 0 && window.ws_col > 1) {
        return window.ws_col;
    }
    return 80;
}

/** Draw the bar in place, or print a plain line. `last` leaves the bar behind as a line. */
static void draw(struct v2v_progress *progress, int last)
{
    char text[BAR_BYTES];
    pthread_mutex_lock(&sink.lock);
    if (sink.rank == 0 && sink.level >= V2V_LOG_INFO) {
        format_progress(text, sizeof text, progress);
        if (progress->on_terminal && !last) {
            char block[BAR_BYTES + 8];
            size_t columns = terminal_columns();
            if (strlen(text) >= columns) {
                text[columns - 1] = '\0';
            }
            memcpy(sink.bar, text, sizeof sink.bar);
            int length = snprintf(block, sizeof block, "\r\033[K%s", text);
            put(block, (size_t)length);
        } else {
            char clear = sink.bar[0];
            sink.bar[0] = '\0';
            put("\r\033[K", clear != '\0' ? 4 : 0);
            put_line(text);
        }
    }
    pthread_mutex_unlock(&sink.lock);
    progress->last_printed = v2v_clock_now();
}

void v2v_progress_begin(struct v2v_progress *progress, const char *title, int64_t first,
                        int64_t total)
{
    *progress = (struct v2v_progress){
        .title = title,
        .total = total,
        .first = first,
        .done = first,
        .started = v2v_clock_now(),
        .last_printed = v2v_clock_now(),
        .on_terminal = isatty(STDERR_FILENO) == 1,
    };
    if (progress->on_terminal) {
        draw(progress, 0);
    }
}

void v2v_progress_step(struct v2v_progress *progress, int64_t done, const char *note)
{
    double period = progress->on_terminal ? TERMINAL_PERIOD : PLAIN_PERIOD;
    progress->done = done;
    snprintf(progress->note, sizeof progress->note, "%s", note != NULL ? note : "");
    if (v2v_clock_now() - progress->last_printed >= period) {
        draw(progress, 0);
    }
}

void v2v_progress_end(struct v2v_progress *progress)
{
    if (progress->title != NULL) {
        draw(progress, 1);
    }
}
