/* Files of the FMU's resources. */
#ifndef FLEX_FILES_H
#define FLEX_FILES_H

#include <stdint.h>

/* Path of a resource location, which is a URI or a plain path; null without memory. To be freed. */
char *path_of_location(const char *location);
/* The bytes of the file `name` in a folder, eight-byte aligned; null where it cannot be read. Instances of one file share
 * its memory: it is mapped, and never written to. */
const void *map_file(const char *folder, const char *name, int64_t *size);
void unmap_file(const void *bytes, int64_t size);

#endif
