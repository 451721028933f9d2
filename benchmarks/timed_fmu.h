/* An FMU's library whose calls are timed. */
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

static void *(*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int);
static int (*setup)(void *, int, double, double, int, double), (*enter)(void *), (*leave)(void *);
static int (*set_real)(void *, const unsigned *, size_t, const double *);
static int (*get_real)(void *, const unsigned *, size_t, double *), (*do_step)(void *, double, double, int);
static void (*release)(void *);

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* The library with its calls; null, told, where it does not load. */
static void *load(const char *path) {
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        fprintf(stderr, "%s\n", dlerror());
        return 0;
    }
    *(void **)&instantiate = dlsym(library, "fmi2Instantiate");
    *(void **)&setup = dlsym(library, "fmi2SetupExperiment");
    *(void **)&enter = dlsym(library, "fmi2EnterInitializationMode");
    *(void **)&leave = dlsym(library, "fmi2ExitInitializationMode");
    *(void **)&set_real = dlsym(library, "fmi2SetReal");
    *(void **)&get_real = dlsym(library, "fmi2GetReal");
    *(void **)&do_step = dlsym(library, "fmi2DoStep");
    *(void **)&release = dlsym(library, "fmi2FreeInstance");
    return library;
}
