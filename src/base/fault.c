#include "v2v3d/base/fault.h"

#include "v2v3d/base/log.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef V2V_FAULTS

#define SITE_BYTES 64

/* What V2V_FAULT asks for, and how often its site was passed so far. */
static struct {
    pthread_mutex_t lock;
    int read;
    char site[SITE_BYTES];
    int rank;
    long nth; /* counted from 1; 0: nothing is injected */
    int sticky;
    long passed;
} plan = {.lock = PTHREAD_MUTEX_INITIALIZER};
static int own_rank;

/** V2V_FAULT=site:rank:nth, or site:rank:nth+ for every passage from the n-th on. */
static void read_plan(void)
{
    const char *text = getenv("V2V_FAULT");
    char plus = '\0', rest = '\0';
    plan.read = 1;
    if (text == NULL || *text == '\0') {
        return;
    }
    int found = sscanf(text, "%63[^:]:%d:%ld%c%c", plan.site, &plan.rank, &plan.nth, &plus, &rest);
    plan.sticky = plus == '+';
    if (found < 3 || found > 4 || (found == 4 && !plan.sticky) || plan.nth < 1) {
        plan.nth = 0;
        v2v_log(V2V_LOG_ERROR, "V2V_FAULT='%s' is not site:rank:nth", text);
    }
}

enum v2v_status v2v_fault_at(const char *site)
{
    int fails = 0;
    pthread_mutex_lock(&plan.lock);
    if (!plan.read) {
        read_plan();
    }
    if (plan.nth > 0 && plan.rank == own_rank && strcmp(plan.site, site) == 0) {
        plan.passed++;
        fails = plan.passed == plan.nth || (plan.sticky && plan.passed > plan.nth);
    }
    pthread_mutex_unlock(&plan.lock);
    return fails ? V2V_FAIL(V2V_E_IO, "%s: injected fault (V2V_FAULT)", site) : V2V_OK;
}

void v2v_fault_set_rank(int rank)
{
    own_rank = rank;
}

#else

enum v2v_status v2v_fault_at(const char *site)
{
    (void)site;
    return V2V_OK;
}

void v2v_fault_set_rank(int rank)
{
    (void)rank;
}

#endif
