/* A program: all numbers that one method on one body needs, as a flat, checked, little-endian image. */
#ifndef FLEX_PROGRAM_H
#define FLEX_PROGRAM_H

#include <stdint.h>

#define PROGRAM_VERSION 3

typedef struct {
#define SIZE(name) int64_t name;
#define REAL(name, count) const double *name;
#define INTEGER(name, count) const int64_t *name;
#define SHORT(name, count) const int16_t *name;
#define TEXT(name, count) const char *name;
#include "fields.def"
#undef SIZE
#undef REAL
#undef INTEGER
#undef SHORT
#undef TEXT
} Program;

enum { PLACE_REFERENCE = 0, PLACE_CORRECTIVE_MOMENT = 1, PLACE_DEFORMED = 2 };

/* 64-bit checksum of whole words. */
uint64_t checksum(const void *words, int64_t count);

/* An image, aligned to IMAGE_ALIGNMENT bytes as its arrays then are. */
enum { IMAGE_ALIGNMENT = 32 };
typedef struct {
    const void *bytes;
    int64_t size;
} Image;

/* Point a program into an image, and into `base` where it takes arrays from that, one that was opened; both must stay where they
 * are. Returns null where every byte is as it must be, else what is wrong with it. */
const char *open_program(Image image, Image base, Program *program);

/* Of an image that was opened: the checksum in its head, and that of the one that it takes arrays from, 0 for none. */
uint64_t program_mark(const void *image);
uint64_t program_base(const void *image);

/* The text number `index` of several that end in zero bytes; "" where there are fewer. */
enum { ADVICE_ROTATION, ADVICE_MISSED, SOURCE_MISSED, ADVICE_SPIN, ADVICE_ERROR, ADVICE_LIMIT, ADVICES };
const char *text_at(const char *texts, int64_t bytes, int64_t index);

#endif
