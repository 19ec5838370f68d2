#include "v2v3d/par/watchdog.h"

#include "v2v3d/base/status.h"

#include <mpi.h>
#include <signal.h>
#include <stdio.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

/* Longer than any job: setitimer refuses what its type can't hold. */
#define MOST_SECONDS 3.0e7

/* Who waits for a rank hears of its beats later, and of some only: that rank's own watchdog is to
 * be the first one. */
#define WAIT_PERIODS 1.5

/* The first rank to leave takes the others with it: they get this long to say what they know. */
#define GRACE_SECONDS 1

/* What the signal handler reads; written while the timer is off. */
static struct {
    char text[256]; /* made ready beforehand: a handler must not format */
    size_t bytes;
    int exit_code;
} last_words;

static double period; /* of beats, as the program has set it */

static struct {
    void (*listen)(void *context); /* NULL: nobody does */
    void *context;
} listener;

static void on_alarm(int number)
{
    (void)number;
    if (write(STDERR_FILENO, last_words.text, last_words.bytes) < 0) {
        /* Nobody listens; the exit code still tells. */
    }
    const struct timespec grace = {.tv_sec = GRACE_SECONDS};
    nanosleep(&grace, NULL);
    /* Not MPI_Abort, which can wait as well: mpirun ends the other ranks when one leaves like this
     * (Open MPI 4.1.4: after 1.4 s). */
    _exit(last_words.exit_code);
}

static void set_timer(double seconds)
{
    struct itimerval timer = {{0, 0}, {0, 0}};
    if (seconds > 0.0) {
        timer.it_value.tv_sec = (time_t)seconds;
        timer.it_value.tv_usec = (suseconds_t)((seconds - (double)(time_t)seconds) * 1e6) + 1;
        if (timer.it_value.tv_usec > 999999) {
            timer.it_value.tv_usec = 999999;
        }
    }
    setitimer(ITIMER_REAL, &timer, NULL);
}

static int world_rank(void)
{
    int started = 0, ended = 0, rank = 0;
    MPI_Initialized(&started);
    MPI_Finalized(&ended);
    if (started && !ended) {
        MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    }
    return rank;
}

void v2v_watchdog_arm(double seconds, const char *what)
{
    struct sigaction action = {.sa_handler = on_alarm};
    v2v_watchdog_disarm();
    if (!(seconds > 0.0)) {
        return;
    }
    seconds = seconds < MOST_SECONDS ? seconds : MOST_SECONDS;
    int length = snprintf(last_words.text, sizeof last_words.text,
                          "error (rank %d): no progress for %.3g s in %.128s; the watchdog ends "
                          "the job\n",
                          world_rank(), seconds, what);
    last_words.bytes = length > 0 ? (size_t)length : 0;
    last_words.exit_code = v2v_status_exit_code(V2V_E_IO);
    sigemptyset(&action.sa_mask);
    sigaction(SIGALRM, &action, NULL);
    set_timer(seconds);
}

void v2v_watchdog_set_period(double seconds)
{
    period = seconds;
}

double v2v_watchdog_period(void)
{
    return period;
}

void v2v_watchdog_listen(void (*listen)(void *context), void *context)
{
    listener.listen = listen;
    listener.context = context;
}

void v2v_watchdog_wait(const char *what)
{
    if (period > 0.0) {
        v2v_watchdog_arm(WAIT_PERIODS * period, what);
    }
}

void v2v_watchdog_beat(const char *what)
{
    if (period > 0.0) {
        v2v_watchdog_arm(period, what);
    }
    if (listener.listen != NULL) {
        listener.listen(listener.context);
    }
}

void v2v_watchdog_disarm(void)
{
    set_timer(0.0);
}
