/* An FMU's library that does nothing: what a master and its calls cost by themselves. */
#include <stddef.h>

static int there;

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *location, const void *callbacks, int visible,
                      int logging) {
    (void)name, (void)type, (void)guid, (void)location, (void)callbacks, (void)visible, (void)logging;
    return &there;
}
void fmi2FreeInstance(void *c) { (void)c; }
int fmi2SetupExperiment(void *c, int t, double tolerance, double start, int s, double stop) {
    (void)c, (void)t, (void)tolerance, (void)start, (void)s, (void)stop;
    return 0;
}
int fmi2EnterInitializationMode(void *c) { return c == NULL; }
int fmi2ExitInitializationMode(void *c) { return c == NULL; }
int fmi2SetString(void *c, const unsigned *vr, size_t n, const char **value) { return (void)vr, (void)n, (void)value, c == NULL; }
int fmi2SetReal(void *c, const unsigned *vr, size_t n, const double *value) { return (void)vr, (void)n, (void)value, c == NULL; }
int fmi2GetInteger(void *c, const unsigned *vr, size_t n, int *value) { return (void)vr, (void)n, (void)value, c == NULL; }
int fmi2DoStep(void *c, double time, double step, int done) { return (void)time, (void)step, (void)done, c == NULL; }
int fmi2GetReal(void *c, const unsigned *vr, size_t n, double *value) {
    (void)vr;
    for (size_t i = 0; i < n; i++) value[i] = 0.0;
    return c == NULL;
}
