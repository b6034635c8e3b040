/* A bare loop with the settings of backend.realtime.timing: what this machine can do at best while the service runs.
 *
 * Writes the lateness of each deadline [ns], one number a line. Arguments: how many periods, FIFO priority (0: none), the
 * period [ns].
 */

#define _GNU_SOURCE
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <time.h>

enum { SECOND_NS = 1000000000 };

static long long now_ns(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (long long)now.tv_sec * SECOND_NS + now.tv_nsec;
}

int main(int count, char **words) {
    if (count != 4) return 2;
    int periods = atoi(words[1]);
    long long period = atoll(words[3]);
    struct sched_param wanted = {.sched_priority = atoi(words[2])};
    long long *lateness = malloc(sizeof(long long) * (size_t)periods);
    if (lateness == NULL) return 3;
    prctl(PR_SET_TIMERSLACK, 1UL, 0, 0, 0);
    if (wanted.sched_priority > 0 && sched_setscheduler(0, SCHED_FIFO, &wanted) != 0) return 4;
    mlockall(MCL_CURRENT | MCL_FUTURE);
    long long deadline = now_ns();
    for (int k = 0; k < periods; k++) {
        deadline += period;
        long long behind = now_ns() - deadline;
        if (behind >= period) deadline += behind / period * period;
        struct timespec at = {.tv_sec = deadline / SECOND_NS, .tv_nsec = deadline % SECOND_NS};
        while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL) != 0) {}
        lateness[k] = now_ns() - deadline;
    }
    for (int k = 0; k < periods; k++) printf("%lld\n", lateness[k]);
    free(lateness);
    return 0;
}
