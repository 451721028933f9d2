/* The smallest FMI 2.0 master: loads an FMU's library, sets values, steps, prints outputs with 17 digits.
 *
 *     cc master.c -o master -ldl                    (Windows, MinGW: without -ldl)
 *     ./master LIBRARY RESOURCES GUID STEP COUNT [r:REFERENCE=VALUE | s:REFERENCE=TEXT | o:REFERENCE]...
 *
 * LIBRARY is binaries/linux64/NAME.so of the unpacked FMU, RESOURCES the address (file:///...) of its folder resources,
 * GUID that of its modelDescription.xml. r: and s: set a real or a text before initialisation ends, o: names a real
 * that is printed after initialisation and after every step.
 */
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#include <windows.h>
static void *open_library(const char *path) { return (void *)LoadLibraryA(path); }
static void *find_function(void *from, const char *name) { return (void *)GetProcAddress((HMODULE)from, name); }
static int close_library(void *which) { return !FreeLibrary((HMODULE)which); }
static const char *why(void) { return "no library, or no function in it"; }
#else
#include <dlfcn.h>
static void *open_library(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void *find_function(void *from, const char *name) { return dlsym(from, name); }
static int close_library(void *which) { return dlclose(which); }
static const char *why(void) { return dlerror(); }
#endif

typedef void *Component;
typedef unsigned int Reference;

typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

enum { MOST = 256, OK = 0, WARNING = 1, CO_SIMULATION = 1 };

static void *library;

static void *function(const char *name)
{
    void *found = find_function(library, name);
    if (!found) {
        fprintf(stderr, "%s\n", why());
        exit(2);
    }
    return found;
}

static void check(const char *name, int status)
{
    if (status > WARNING) {
        fprintf(stderr, "%s: status %d\n", name, status);
        exit(3);
    }
}

static void print_line(void *environment, const char *instance, int status, const char *category, const char *text, ...)
{
    va_list values;
    (void)environment;
    fprintf(stderr, "%s [%d %s] ", instance, status, category ? category : "");
    va_start(values, text);
    vfprintf(stderr, text, values);
    va_end(values);
    fputc('\n', stderr);
}

int main(int count, char **words)
{
    if (count < 6) {
        fprintf(stderr, "usage: master LIBRARY RESOURCES GUID STEP COUNT [r:REF=VALUE | s:REF=TEXT | o:REF]...\n");
        return 1;
    }
    library = open_library(words[1]);
    if (!library) {
        fprintf(stderr, "%s\n", why());
        return 2;
    }

    Component (*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int) =
        function("fmi2Instantiate");
    int (*setup)(Component, int, double, double, int, double) = function("fmi2SetupExperiment");
    int (*enter)(Component) = function("fmi2EnterInitializationMode");
    int (*leave)(Component) = function("fmi2ExitInitializationMode");
    int (*set_real)(Component, const Reference *, size_t, const double *) = function("fmi2SetReal");
    int (*set_string)(Component, const Reference *, size_t, const char *const *) = function("fmi2SetString");
    int (*get_real)(Component, const Reference *, size_t, double *) = function("fmi2GetReal");
    int (*do_step)(Component, double, double, int) = function("fmi2DoStep");
    int (*terminate)(Component) = function("fmi2Terminate");
    void (*free_instance)(Component) = function("fmi2FreeInstance");

    const Callbacks callbacks = {print_line, calloc, free, NULL, NULL};
    Component body = instantiate("body", CO_SIMULATION, words[3], words[2], &callbacks, 0, 1);
    if (!body) {
        fprintf(stderr, "no instance\n");
        return 3;
    }

    Reference outputs[MOST];
    double values[MOST];
    size_t wanted = 0;
    for (int k = 6; k < count; k++) {
        const char *equals = strchr(words[k], '=');
        const Reference reference = (Reference)strtoul(words[k] + 2, NULL, 10);
        if (words[k][0] == 'o' && wanted < MOST) {
            outputs[wanted++] = reference;
        } else if (words[k][0] == 'r' && equals) {
            const double value = strtod(equals + 1, NULL);
            check("fmi2SetReal", set_real(body, &reference, 1, &value));
        } else if (words[k][0] == 's' && equals) {
            const char *text = equals + 1;
            check("fmi2SetString", set_string(body, &reference, 1, &text));
        }
    }

    const double step = strtod(words[4], NULL);
    const long steps = strtol(words[5], NULL, 10);
    check("fmi2SetupExperiment", setup(body, 0, 0.0, 0.0, 0, 0.0));
    check("fmi2EnterInitializationMode", enter(body));
    check("fmi2ExitInitializationMode", leave(body));
    for (long k = 0; k <= steps; k++) {
        if (k > 0) {
            check("fmi2DoStep", do_step(body, (double)(k - 1) * step, step, 1));
        }
        check("fmi2GetReal", get_real(body, outputs, wanted, values));
        for (size_t n = 0; n < wanted; n++) {
            printf("%.17g%c", values[n], n + 1 < wanted ? ' ' : '\n');
        }
    }
    check("fmi2Terminate", terminate(body));
    free_instance(body);
    puts("done");
    return close_library(library);
}
