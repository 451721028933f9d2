/* Instances in many threads, and many of them one after another: each must give the same numbers.
 *
 *     cc threads.c -o threads -ldl -lpthread
 *     ./threads LIBRARY RESOURCES GUID THREADS ROUNDS STEPS
 *
 * Every thread makes ROUNDS instances. Each is started, loaded, stepped, saved, stepped on, set back by way of bytes,
 * stepped again, reset and freed. Prints "all alike" if all numbers were the same.
 */
#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef void *Component;
typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

enum { MOST = 64, INPUTS = 3, OUTPUTS = 12 };

static struct {
    Component (*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int);
    int (*setup)(Component, int, double, double, int, double);
    int (*enter)(Component), (*leave)(Component), (*terminate)(Component), (*reset)(Component);
    int (*set_real)(Component, const unsigned *, size_t, const double *);
    int (*get_real)(Component, const unsigned *, size_t, double *);
    int (*do_step)(Component, double, double, int);
    int (*get_state)(Component, void **), (*set_state)(Component, void *), (*free_state)(Component, void **);
    int (*size)(Component, void *, size_t *), (*serialize)(Component, void *, char *, size_t);
    int (*deserialize)(Component, const char *, size_t, void **);
    void (*free_instance)(Component);
} fmi;

static const char *address, *guid;
static int rounds, steps;

static void say(void *environment, const char *instance, int status, const char *category, const char *text, ...)
{
    (void)environment;
    fprintf(stderr, "%s [%d %s] %s\n", instance, status, category, text);
}

static const Callbacks callbacks = {say, calloc, free, NULL, NULL};

/* The motion after `steps` more steps; 0 where one is refused. */
static int go(Component body, double time, double *values)
{
    unsigned references[OUTPUTS];
    for (unsigned k = 0; k < OUTPUTS; k++) references[k] = k;
    for (int k = 0; k < steps; k++)
        if (fmi.do_step(body, time + 1e-3 * k, 1e-3, 1) > 1) return 0;
    return fmi.get_real(body, references, OUTPUTS, values) == 0;
}

static int once(double *result)
{
    const unsigned references[INPUTS] = {0, 1, 2};
    const double loads[INPUTS] = {0.7, -0.4, 0.2};
    double first[OUTPUTS], second[OUTPUTS];
    void *state = NULL, *copy = NULL;
    size_t size = 0;
    Component body = fmi.instantiate("body", 1, guid, address, &callbacks, 0, 1);
    if (!body) return 0;
    int fine = fmi.setup(body, 0, 0.0, 0.0, 0, 0.0) == 0 && fmi.enter(body) == 0 && fmi.leave(body) == 0;
    fine = fine && fmi.set_real(body, references, INPUTS, loads) == 0 && go(body, 0.0, result);
    fine = fine && fmi.get_state(body, &state) == 0 && fmi.size(body, state, &size) == 0;
    char *bytes = malloc(size + 1);
    fine = fine && fmi.serialize(body, state, bytes, size) == 0 && fmi.deserialize(body, bytes, size, &copy) == 0;
    fine = fine && go(body, 1e-3 * steps, first) && fmi.set_state(body, copy) == 0 && go(body, 1e-3 * steps, second);
    fine = fine && memcmp(first, second, sizeof first) == 0;
    /* Something refused, so that its words are made, too. */
    fine = fine && fmi.do_step(body, 0.0, -1.0, 1) == 2 && fmi.terminate(body) == 0 && fmi.reset(body) == 0;
    free(bytes);
    fmi.free_state(body, &state);
    fmi.free_state(body, &copy);
    fmi.free_instance(body);
    memcpy(result, first, sizeof first);
    return fine;
}

static void *work(void *result)
{
    double *values = result, again[OUTPUTS];
    int fine = once(values);
    for (int k = 1; k < rounds && fine; k++) fine = once(again) && memcmp(values, again, sizeof again) == 0;
    return fine ? result : NULL;
}

int main(int count, char **words)
{
    if (count != 7) return 1;
    void *library = dlopen(words[1], RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        fprintf(stderr, "%s\n", dlerror());
        return 2;
    }
    const struct {
        void *place;
        const char *name;
    } functions[] = {
        {&fmi.instantiate, "fmi2Instantiate"}, {&fmi.setup, "fmi2SetupExperiment"},
        {&fmi.enter, "fmi2EnterInitializationMode"}, {&fmi.leave, "fmi2ExitInitializationMode"},
        {&fmi.terminate, "fmi2Terminate"}, {&fmi.reset, "fmi2Reset"}, {&fmi.set_real, "fmi2SetReal"},
        {&fmi.get_real, "fmi2GetReal"}, {&fmi.do_step, "fmi2DoStep"}, {&fmi.get_state, "fmi2GetFMUstate"},
        {&fmi.set_state, "fmi2SetFMUstate"}, {&fmi.free_state, "fmi2FreeFMUstate"},
        {&fmi.size, "fmi2SerializedFMUstateSize"}, {&fmi.serialize, "fmi2SerializeFMUstate"},
        {&fmi.deserialize, "fmi2DeSerializeFMUstate"}, {&fmi.free_instance, "fmi2FreeInstance"},
    };
    for (size_t k = 0; k < sizeof functions / sizeof *functions; k++) {
        void *found = dlsym(library, functions[k].name);
        if (!found) return 2;
        memcpy(functions[k].place, &found, sizeof found);
    }
    address = words[2];
    guid = words[3];
    rounds = atoi(words[5]);
    steps = atoi(words[6]);
    const int threads = atoi(words[4]) < MOST ? atoi(words[4]) : MOST;
    static double results[MOST][OUTPUTS];
    pthread_t thread[MOST];
    int alike = 1;
    for (int k = 0; k < threads; k++) pthread_create(&thread[k], NULL, work, results[k]);
    for (int k = 0; k < threads; k++) {
        void *fine = NULL;
        pthread_join(thread[k], &fine);
        alike &= fine && memcmp(results[0], results[k], sizeof results[k]) == 0;
    }
    int moves = 0;
    for (int k = 0; k < OUTPUTS; k++) moves |= results[0][k] != 0.0;
    puts(alike && moves ? "all alike" : "not alike");
    fflush(stdout);
    return alike && moves ? dlclose(library) : 1;
}
