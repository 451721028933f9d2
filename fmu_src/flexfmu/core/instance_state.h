/* The state of an instance as one block of bytes. */
#ifndef FLEX_INSTANCE_STATE_H
#define FLEX_INSTANCE_STATE_H

#include "instance.h"

int64_t instance_state_size(const Instance *instance);
void instance_save(const Instance *instance, void *block);
/* Null, or what is wrong with the block; the instance is then as it was. */
const char *instance_restore(Instance *instance, const void *block, int64_t size);

#endif
