/* A recording in the tests' folder, and its refusal. */
#ifndef V2V_TEST_A_RECORDING_H
#define V2V_TEST_A_RECORDING_H

#include "support.h"

#include "v2v3d/io/recording.h"

#include <stdio.h>
#include <string.h>

static char path[512];

static inline void use(const char *name)
{
    snprintf(path, sizeof path, "%s/%s", test_folder(NULL), name);
}

static inline void assert_says(const char *part)
{
    if (strstr(v2v_status_message(), part) == NULL) {
        fail_msg("\"%s\" does not say \"%s\"", v2v_status_message(), part);
    }
}

/* Refused as bad input, in one line that names the file. */
static inline void assert_refused(const struct v2v_input_settings *settings, const char *reason)
{
    struct v2v_recording *recording = NULL;
    assert_int_equal(v2v_recording_open(&recording, path, settings, NULL), V2V_E_INPUT);
    assert_null(recording);
    assert_says(path);
    assert_says(reason);
    assert_null(strchr(v2v_status_message(), '\n'));
}

#endif
