/* Files of the FMU's resources. */
#ifndef FLEX_FILES_H
#define FLEX_FILES_H

#include <stdint.h>

/* Path of a resource location, which is a URI or a plain path; null without memory. To be freed. */
char *path_of_location(const char *location);
/* All bytes of the file `name` in a folder, eight-byte aligned, to be freed; null where it cannot be read. */
void *read_whole(const char *folder, const char *name, int64_t *size);

#endif
