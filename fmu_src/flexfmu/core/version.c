#include "body.h"

#ifndef FLEX_SOURCES
#define FLEX_SOURCES ""
#endif

const char *core_sources(void) { return FLEX_SOURCES; }
