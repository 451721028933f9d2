#include "component.h"

#include <stdio.h>
#include <string.h>

const char *const CATEGORY[CATEGORIES] = {"logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"};

void tell(void *to, int status, const char *text) {
    Component *c = to;
    const int category = status == fmi2Warning ? 0 : status == fmi2Discard ? 1 : status == fmi2Fatal ? 3 : 2;
    if (!c->logging || !c->logged[category] || !c->callbacks.logger) return;
    /* The master may take the text for a printf format. */
    size_t n = 0;
    for (const char *at = text; *at && n < sizeof c->line - 2; at++) {
        if (*at == '%') c->line[n++] = '%';
        c->line[n++] = *at;
    }
    c->line[n] = 0;
    c->callbacks.logger(c->callbacks.componentEnvironment, c->name, (fmi2Status)status, CATEGORY[category], c->line);
}

fmi2Status fail(Component *c, const char *text) {
    tell(c, fmi2Error, text);
    return fmi2Error;
}

Component *allowed(fmi2Component handle, int phases, const char *call) {
    static const char *const names[] = {"instantiated", "in initialization mode", "in step mode", "after a refused step", "terminated",
                                        "after an error"};
    Component *c = handle;
    if (!c || c->sign != SIGN) return 0;
    if (c->phase & phases) return c;
    int number = 0;
    while (!(c->phase >> number & 1)) number++;
    snprintf(c->text, TEXT_SIZE, "%s is not allowed %s; expected: %s", call, names[number], phases == INSTANTIATED ? "right after fmi2Instantiate or fmi2Reset"
             : phases == INITIALIZING              ? "after fmi2EnterInitializationMode"
             : phases & INSTANTIATED               ? "before fmi2Terminate, and fmi2Reset after an error"
             : phases & INITIALIZING               ? "after fmi2EnterInitializationMode"
                                                   : "after fmi2ExitInitializationMode and before fmi2Terminate; fmi2Reset after an error");
    tell(c, fmi2Error, c->text);
    return 0;
}

Component *given(Component *c, int whole, const char *call) {
    if (!c || whole) return c;
    snprintf(c->text, TEXT_SIZE, "%s: a null pointer was given, expected an array or a place for the result", call);
    tell(c, fmi2Error, c->text);
    return 0;
}

int64_t variable_of(Component *c, fmi2ValueReference reference, int type, const char *call) {
    static const char *const types[] = {"Real", "Integer", "Boolean", "String"};
    const Program *p = instance_description(c->body);
    if ((int64_t)reference < p->variables && p->variable_type[reference] == type) return (int64_t)reference;
    snprintf(c->text, TEXT_SIZE, "%s: value reference %u is no %s variable of this FMU; see its modelDescription.xml", call, reference, types[type]);
    tell(c, fmi2Error, c->text);
    return -1;
}
