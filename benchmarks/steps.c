/* Times each step of an FMU's library: set all inputs, step, get all outputs. All variants run in turn, REPEATS times over
 * the same motion; of each block of steps the least time counts, which no other program has disturbed.
 * Prints, in seconds: a line with the time to instantiate and initialise of each variant; then a line for each block with
 * the mean time of a step of each variant.
 *
 * steps LIBRARY GUID LOCATION INPUTS OUTPUTS STEP BLOCK BLOCKS REPEATS LOADS VARIANT …
 * LOADS: REFERENCE=PEAK,…: inputs that grow and fall once over the run. VARIANT: INSTANCES[,REFERENCE=VALUE …], real parameters. */
#include "timed_fmu.h"

static void log_line(void *environment, const char *name, int status, const char *category, const char *text, ...) {
    (void)environment, (void)name, (void)status, (void)category, (void)text;
}

enum { MOST = 1024, VARIANTS = 8 };

/* The "reference=value" pairs of a text after its first comma or from its start; how many. */
static int pairs(const char *text, unsigned *reference, double *value) {
    int count = 0;
    for (; text && *text && count < MOST; count++) {
        char *end;
        reference[count] = (unsigned)strtoul(text, &end, 10);
        value[count] = strtod(end + 1, &end);
        text = *end ? end + 1 : end;
    }
    return count;
}

/* Seconds. Many instances' steps take so long that other programs get their turns in between, which only the processor's time
 * leaves out; a single step is too short for its clock. */
static double stamp(int instances) {
    struct timespec time;
    if (instances == 1) return now();
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static double least(double a, double b) { return a > 0.0 && a < b ? a : b; }

int main(int count, char **words) {
    if (count < 12 || count - 11 > VARIANTS) return 2;
    void *library = load(words[1]);
    if (!library) return 1;
    const Callbacks callbacks = {log_line, 0, 0, 0, 0};
    const int inputs = atoi(words[4]), outputs = atoi(words[5]), block = atoi(words[7]), blocks = atoi(words[8]);
    const int repeats = atoi(words[9]), variants = count - 11;
    const double step = atof(words[6]);
    unsigned references[MOST], loaded[MOST], chosen[MOST];
    double values[MOST] = {0}, results[MOST], peak[MOST], given[MOST], begin[VARIANTS] = {0};
    double *times = calloc((size_t)blocks * (size_t)variants, sizeof *times);
    const int loads = pairs(words[10], loaded, peak);
    if (!times || inputs + outputs > MOST) return 2;
    for (int i = 0; i < inputs + outputs; i++) references[i] = (unsigned)i;
    for (int turn = 0; turn < repeats * variants; turn++) {
        const int variant = turn % variants, instances = atoi(words[11 + variant]);
        const char *comma = strchr(words[11 + variant], ',');
        const int parameters = pairs(comma ? comma + 1 : 0, chosen, given);
        void **fmu = calloc((size_t)instances, sizeof *fmu);
        for (int i = 0; i < instances; i++) {
            const double start = now();
            fmu[i] = instantiate("timed", 1, words[2], words[3], &callbacks, 0, 0);
            if (!fmu[i] || (parameters && set_real(fmu[i], chosen, (size_t)parameters, given))) return 1;
            if (setup(fmu[i], 0, 0.0, 0.0, 0, 0.0) || enter(fmu[i]) || leave(fmu[i])) return 1;
            begin[variant] = least(begin[variant], now() - start);
        }
        for (int k = 0; k < blocks; k++) {
            const double start = stamp(instances);
            for (int n = k * block; n < (k + 1) * block; n++) {
                const double place = 2.0 * (n + 1) / ((double)blocks * block), share = place < 1.0 ? place : 2.0 - place;
                for (int i = 0; i < loads; i++) values[loaded[i]] = peak[i] * share;
                for (int i = 0; i < instances; i++)
                    if (set_real(fmu[i], references, (size_t)inputs, values) > 1 || do_step(fmu[i], n * step, step, 1) > 1 ||
                        get_real(fmu[i], references + inputs, (size_t)outputs, results) > 1)
                        return 1;
            }
            double *time = times + k * variants + variant;
            *time = least(*time, (stamp(instances) - start) / block / instances);
        }
        for (int i = 0; i < instances; i++) release(fmu[i]);
        free(fmu);
    }
    for (int i = 0; i < variants; i++) printf("%.4g%c", begin[i], i + 1 < variants ? ' ' : '\n');
    for (int i = 0; i < blocks * variants; i++) printf("%.4g%c", times[i], (i + 1) % variants ? ' ' : '\n');
    free(times);
    return 0;
}
