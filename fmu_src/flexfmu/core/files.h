/* Files of the FMU's resources. */
#ifndef FLEX_FILES_H
#define FLEX_FILES_H

#include <stdint.h>

/* Path of a resource location, which is a URI or a plain path; null without memory. To be freed. */
char *path_of_location(const char *location);
/* What tells a file as it stands from others, and from itself before it was altered; zeros where nothing does. */
typedef struct {
    uint64_t device, number, size, seconds, fraction;
} FileMark;
/* The bytes of the file `name` in a folder, eight-byte aligned; null where it cannot be read. It is mapped, and never written
 * to. */
const void *map_file(const char *folder, const char *name, int64_t *size, FileMark *mark);
void unmap_file(const void *bytes, int64_t size);
/* Let other threads go on. */
void wait_a_moment(void);

#endif
