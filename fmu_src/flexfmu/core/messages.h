/* What the log says, from interface.def: SAY_symbol is a format of printf. */
#ifndef FLEX_MESSAGES_H
#define FLEX_MESSAGES_H

#define MESSAGE(symbol, kind, text) static const char SAY_##symbol[] = text;
#include "interface.def"

#endif
