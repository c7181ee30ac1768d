/* What `cost.c` and `cost.cpp` measure: a Panda, a task, a ball that moves, one state after the other. */

#ifndef COST_H
#define COST_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { COST_JOINTS = 7 };

static const char *const COST_SETTINGS = "task = 'pose'\nstiffness = 900\ndamping = 60\nnull_damping = 12\n"
                                         "field = { kind = 'bounded', gain = 80, influence = 0.25 }";
static const char *const COST_BALL = "shape = { kind = 'sphere', radius = 0.08 }\nposition = [-0.05, -0.3, 0.62]";

/* The state of cycle k: slowly about the ready posture. */
static inline void cost_state(long k, double q[COST_JOINTS], double dq[COST_JOINTS]) {
    static const double ready[COST_JOINTS] = {0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785};
    for (int i = 0; i < COST_JOINTS; i++) {
        const double rate = 0.5 + 0.1 * i, phase = rate * 0.001 * (double)k;
        q[i] = ready[i] + 0.2 * sin(phase);
        dq[i] = 0.2 * rate * cos(phase);
    }
}

/* Nanoseconds. */
static inline long cost_now(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * 1000000000L + now.tv_nsec;
}

static inline int cost_compare(const void *a, const void *b) {
    const long x = *(const long *)a, y = *(const long *)b;
    return (x > y) - (x < y);
}

/* One line of JSON with the quantiles [ns]; `empty` is what reading the clock twice takes. */
static inline void cost_report(const char *name, long *times, long count) {
    long empty = 1000000;
    for (int k = 0; k < 1000; k++) {
        const long begun = cost_now(), taken = cost_now() - begun;
        empty = taken < empty ? taken : empty;
    }
    qsort(times, (size_t)count, sizeof *times, cost_compare);
    printf("{\"name\": \"%s\", \"cycles\": %ld, \"clock\": %ld, \"p50\": %ld, \"p99\": %ld, \"p99.9\": %ld, \"max\": %ld}\n", name,
           count, empty, times[count / 2], times[count - 1 - count / 100], times[count - 1 - count / 1000], times[count - 1]);
}

static inline long cost_cycles(int count, char **arguments) {
    const long cycles = count > 1 ? strtol(arguments[1], NULL, 10) : 1000000;
    return cycles > 0 ? cycles : 1;
}

#endif
