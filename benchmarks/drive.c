/* Times steps of an FMU's library: set all inputs, step, get all outputs. Prints, in seconds, the median time of a step
 * over blocks of steps, and the mean over the force's cycle of the least of each part; then the rounds of the last step,
 * and the floating-point operations of a step where the library counts them.
 *
 * drive LIBRARY GUID LOCATION METHOD INPUTS OUTPUTS STEP FORCE ROUNDS_REFERENCE
 * Inputs are value references 0 …, outputs follow; every second component of a force (y) grows and falls up to FORCE. */
#include "timed_fmu.h"

static void log_line(void *environment, const char *name, int status, const char *category, const char *text, ...) {
    (void)environment;
    fprintf(stderr, "%s: %d %s %s\n", name, status, category, text);
}

static int ascending(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Blocks are short, so that some of each part of the force's cycle meet an idle processor. */
enum { PARTS = 80, CYCLES = 8, BLOCKS = PARTS * CYCLES, STEPS = 10, CYCLE = PARTS * STEPS, MOST = 512 };

int main(int count, char **words) {
    if (count != 10) return 2;
    void *library = load(words[1]);
    if (!library) return 1;
    int (*set_string)(void *, const unsigned *, size_t, const char **), (*get_integer)(void *, const unsigned *, size_t, int *);
    *(void **)&set_string = dlsym(library, "fmi2SetString");
    *(void **)&get_integer = dlsym(library, "fmi2GetInteger");
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
