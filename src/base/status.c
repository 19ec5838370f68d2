#include "v2v3d/base/status.h"

#include "v2v3d/base/log.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static _Thread_local struct v2v_status_record last;
/* Set once by par when MPI starts, before there are threads. */
static void (*abort_job_hook)(void);

static const struct {
    const char *name;
    int exit_code;
} table[V2V_STATUS_COUNT] = {
    [V2V_OK] = {"ok", 0},
    [V2V_STOPPED] = {"stopped", 85},
    [V2V_E_USAGE] = {"usage", 2},
    [V2V_E_CONFIG] = {"configuration", 78},
    [V2V_E_INPUT] = {"bad input", 65},
    [V2V_E_BUSY] = {"busy", 75},
    [V2V_E_IO] = {"input/output", 74},
    [V2V_E_NUMERIC] = {"not finite", 70},
    [V2V_E_MEMORY] = {"out of memory", 70},
    [V2V_E_INTERNAL] = {"internal", 70},
};

static int known(enum v2v_status status)
{
    return (int)status >= 0 && status < V2V_STATUS_COUNT;
}

int v2v_status_exit_code(enum v2v_status status)
{
    return known(status) ? table[status].exit_code : 70;
}

const char *v2v_status_name(enum v2v_status status)
{
    return known(status) ? table[status].name : "unknown";
}

/** The part of __FILE__ from the room on: build folders say nothing to a reader. */
static const char *short_file(const char *file)
{
    const char *found = strstr(file, "/src/");
    return found != NULL ? found + 1 : file;
}

enum v2v_status v2v_status_fail(enum v2v_status status, const char *file, int line,
                                const char *format, ...)
{
    /* Written aside first: the arguments may point into the record that is replaced. */
    struct v2v_status_record fresh;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(fresh.message, sizeof fresh.message, format, arguments);
    va_end(arguments);
    snprintf(fresh.place, sizeof fresh.place, "%s:%d", short_file(file), line);
    last = fresh;
    return status;
}

const char *v2v_status_message(void)
{
    return last.message;
}

const char *v2v_status_place(void)
{
    return last.place;
}

void v2v_status_set_message(const char *message, const char *place)
{
    struct v2v_status_record fresh;
    snprintf(fresh.message, sizeof fresh.message, "%s", message);
    snprintf(fresh.place, sizeof fresh.place, "%s", place);
    last = fresh;
}

void v2v_status_keep(struct v2v_status_record *record)
{
    *record = last;
}

void v2v_status_restore(const struct v2v_status_record *record)
{
    last = *record;
}

void v2v_status_bug(const char *file, int line, const char *condition)
{
    v2v_log(V2V_LOG_ERROR, "bug in v2v3d at %s:%d: '%s' does not hold", short_file(file), line,
            condition);
    if (abort_job_hook != NULL) {
        abort_job_hook();
    }
    abort();
}

void v2v_status_on_bug(void (*abort_job)(void))
{
    abort_job_hook = abort_job;
}
