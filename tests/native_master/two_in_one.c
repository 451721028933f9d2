/* Two FMUs linked into one program, their bodies compiled in: `two_in_one LEFT_GUID RIGHT_GUID REFERENCE LOAD OUTPUT`.
 * Both make 20 steps of 1 ms, in turn; prints their outputs. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    Logger log;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

#define DECLARE(side)                                                                                             \
    void *side##_fmi2Instantiate(const char *, int, const char *, const char *, const Callbacks *, int, int);     \
    int side##_fmi2SetupExperiment(void *, int, double, double, int, double);                                     \
    int side##_fmi2EnterInitializationMode(void *);                                                               \
    int side##_fmi2ExitInitializationMode(void *);                                                                \
    int side##_fmi2SetReal(void *, const unsigned *, size_t, const double *);                                     \
    int side##_fmi2GetReal(void *, const unsigned *, size_t, double *);                                           \
    int side##_fmi2DoStep(void *, double, double, int);                                                           \
    void side##_fmi2FreeInstance(void *);
DECLARE(left)
DECLARE(right)

#define START(side, guid)                                                                                         \
    void *side = side##_fmi2Instantiate(#side, 1, guid, "nowhere", &callbacks, 0, 1);                             \
    if (!side || side##_fmi2SetupExperiment(side, 0, 0.0, 0.0, 0, 0.0) || side##_fmi2EnterInitializationMode(side) || \
        side##_fmi2SetReal(side, &input, 1, &load) || side##_fmi2ExitInitializationMode(side))                    \
        return 1;
#define STEP(side) \
    if (side##_fmi2DoStep(side, 1e-3 * k, 1e-3, 1)) return 1;
#define END(side)                                                                                                 \
    if (side##_fmi2GetReal(side, &output, 1, &value)) return 1;                                                   \
    printf("%.17g\n", value);                                                                                     \
    side##_fmi2FreeInstance(side);

static void say(void *environment, const char *instance, int status, const char *category, const char *text, ...)
{
    (void)environment;
    fprintf(stderr, "%s [%d %s] %s\n", instance, status, category, text);
}

int main(int count, char **words)
{
    const Callbacks callbacks = {say, calloc, free, NULL, NULL};
    double value;
    if (count != 6) return 2;
    const unsigned input = (unsigned)atoi(words[3]), output = (unsigned)atoi(words[5]);
    const double load = atof(words[4]);
    START(left, words[1])
    START(right, words[2])
    for (int k = 0; k < 20; k++) {
        STEP(left)
        STEP(right)
    }
    END(left)
    END(right)
    return 0;
}
