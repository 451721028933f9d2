/* Times steps of an FMU's library: set all inputs, step, get all outputs. Prints, in seconds, the median time of a step
 * over blocks of steps, and the mean over the force's cycle of the least of each part; then the rounds of the last step,
 * and the floating-point operations of a step where the library counts them.
 *
 * drive LIBRARY GUID LOCATION METHOD INPUTS OUTPUTS STEP FORCE ROUNDS_REFERENCE
 * Inputs are value references 0 …, outputs follow; every second component of a force (y) grows and falls up to FORCE. */
#define _POSIX_C_SOURCE 200809L
#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    Logger logger;
    void *allocate, *release, *finished, *environment;
} Callbacks;

static void log_line(void *environment, const char *name, int status, const char *category, const char *text, ...) {
    (void)environment;
    fprintf(stderr, "%s: %d %s %s\n", name, status, category, text);
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int ascending(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Blocks are short, so that some of each part of the force's cycle meet an idle processor. */
enum { PARTS = 80, CYCLES = 8, BLOCKS = PARTS * CYCLES, STEPS = 10, CYCLE = PARTS * STEPS, MOST = 512 };

int main(int count, char **words) {
    if (count != 10) return 2;
    void *library = dlopen(words[1], RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        fprintf(stderr, "%s\n", dlerror());
        return 1;
    }
    void *(*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int);
    int (*set_string)(void *, const unsigned *, size_t, const char **), (*setup)(void *, int, double, double, int, double);
    int (*enter)(void *), (*leave)(void *), (*set_real)(void *, const unsigned *, size_t, const double *);
    int (*get_real)(void *, const unsigned *, size_t, double *), (*do_step)(void *, double, double, int);
    int (*get_integer)(void *, const unsigned *, size_t, int *);
    void (*release)(void *);
    *(void **)&instantiate = dlsym(library, "fmi2Instantiate");
    *(void **)&set_string = dlsym(library, "fmi2SetString");
    *(void **)&setup = dlsym(library, "fmi2SetupExperiment");
    *(void **)&enter = dlsym(library, "fmi2EnterInitializationMode");
    *(void **)&leave = dlsym(library, "fmi2ExitInitializationMode");
    *(void **)&set_real = dlsym(library, "fmi2SetReal");
    *(void **)&get_real = dlsym(library, "fmi2GetReal");
    *(void **)&get_integer = dlsym(library, "fmi2GetInteger");
    *(void **)&do_step = dlsym(library, "fmi2DoStep");
    *(void **)&release = dlsym(library, "fmi2FreeInstance");
    const Callbacks callbacks = {log_line, 0, 0, 0, 0};
    const size_t inputs = (size_t)atoi(words[5]), outputs = (size_t)atoi(words[6]);
    const double step = atof(words[7]), force = atof(words[8]);
    unsigned references[MOST];
    double values[MOST] = {0}, results[MOST], times[BLOCKS];
    if (inputs + outputs > MOST) return 2;
    for (size_t i = 0; i < inputs + outputs; i++) references[i] = (unsigned)i;
    void *fmu = instantiate("timed", 1, words[2], words[3], &callbacks, 0, 1);
    if (!fmu) return 1;
    if (*words[4]) {
        char *place = strchr(words[4], '=');
        const char *method = place + 1;
        const unsigned reference = (unsigned)atoi(words[4]);
        if (set_string(fmu, &reference, 1, &method)) return 1;
    }
    if (setup(fmu, 0, 0.0, 0.0, 0, 0.0) || enter(fmu) || leave(fmu)) return 1;
    long number = 0;
    double rounds = 0.0;
    for (int block = 0; block < BLOCKS; block++) {
        const double start = now();
        for (int k = 0; k < STEPS; k++, number++) {
            double share = (double)(number % CYCLE) / (0.5 * CYCLE) - 1.0;
            share = 1.0 - (share < 0.0 ? -share : share);
            for (size_t i = 0; i < inputs; i++) values[i] = i % 6 == 1 ? force * share : 0.0;
            if (set_real(fmu, references, inputs, values) || do_step(fmu, (double)number * step, step, 1) ||
                get_real(fmu, references + inputs, outputs, results))
                return 1;
        }
        times[block] = (now() - start) / STEPS;
        int found = 0;
        const unsigned reference = (unsigned)atoi(words[9]);
        if (reference && !get_integer(fmu, &reference, 1, &found)) rounds += found;
    }
    double least = 0.0;
    for (int part = 0; part < PARTS; part++) {
        double fastest = times[part];
        for (int cycle = 1; cycle < CYCLES; cycle++)
            if (times[cycle * PARTS + part] < fastest) fastest = times[cycle * PARTS + part];
        least += fastest / PARTS;
    }
    qsort(times, BLOCKS, sizeof *times, ascending);
    const long long *operations = dlsym(library, "flex_operations");
    printf("%.9g %.9g %.3g %.6g\n", times[BLOCKS / 2], least, rounds / BLOCKS, operations ? (double)*operations / (double)number : 0.0);
    release(fmu);
    return 0;
}
