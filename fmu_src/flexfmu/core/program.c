#include "program.h"

#include <math.h>
#include <string.h>

#include "vectors.h"

#define WORD 8
/* Far beyond any reduced body, and low enough that no product below overflows. */
enum { MOST_SIZE = 100000000 };
static const double MOST_NUMBERS = 4e9;

/* The table in words: an image written from another table is refused. */
static const char TABLE[] =
#define SIZE(name) "SIZE " #name "\n"
#define REAL(name, count) "REAL " #name " " #count "\n"
#define INTEGER(name, count) "INTEGER " #name " " #count "\n"
#define SHORT(name, count) "SHORT " #name " " #count "\n"
#define TEXT(name, count) "TEXT " #name " " #count "\n"
#include "fields.def"
#undef SIZE
#undef REAL
#undef INTEGER
#undef SHORT
#undef TEXT
    ;

typedef struct {
    char mark[WORD];
    int64_t version;
    uint64_t table;    /* checksum of the table's words */
    int64_t bytes;     /* of the whole image */
    uint64_t base;     /* checksum of the one that it takes arrays from; 0 for none */
    uint64_t checksum; /* of all words after this one */
} Head;

uint64_t checksum(const void *words, int64_t count) {
    const char *at = words;
    uint64_t sum = 0;
    for (int64_t i = 0; i < count; i++) {
        uint64_t z;
        memcpy(&z, at + WORD * i, sizeof z);
        /* A word's place counts: each is mixed with it (G. L. Steele et al., Fast splittable pseudorandom number
         * generators, 2014, the finaliser). */
        z += (uint64_t)(i + 1) * UINT64_C(0x9E3779B97F4A7C15);
        z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
        z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
        sum += z ^ (z >> 31);
    }
    return sum;
}

const char *text_at(const char *texts, int64_t bytes, int64_t index) {
    const char *at = texts, *end = texts + bytes;
    for (; at && at < end; at += strlen(at) + 1)
        if (index-- == 0) return at;
    return "";
}

static int64_t texts_in(const char *texts, int64_t bytes) {
    int64_t count = 0;
    for (int64_t i = 0; i < bytes; i++) count += texts[i] == 0;
    return count;
}

static int all_finite(const double *x, int64_t count) {
    for (int64_t i = 0; i < count; i++)
        if (!isfinite(x[i])) return 0;
    return 1;
}

static int within(const int64_t *x, int64_t count, int64_t least, int64_t most) {
    for (int64_t i = 0; i < count; i++)
        if (x[i] < least || x[i] > most) return 0;
    return 1;
}

static int positive(const double *x, int64_t count, int zero_too) {
    for (int64_t i = 0; i < count; i++)
        if (x[i] < 0.0 || (x[i] == 0.0 && !zero_too)) return 0;
    return 1;
}

static int is_flag(int64_t value) { return value == 0 || value == 1; }

/* What the sizes of arrays cannot tell. */
static const char *inconsistent(const Program *p) {
    const int64_t m = p->modes, k = p->nodes, s = p->frames;
    if (m < 1 || m > 4096 || k > 65536) return "the numbers of modes or nodes are out of range";
    if (p->interfaces < 1 || k != s + p->interfaces + p->masses + p->lumps + 2 * p->ties) return "the nodes are not those of its parts";
    if (p->loads != 6 * p->interfaces + (p->masses ? 3 : 0)) return "the number of loads is not that of its interfaces";
    if (p->placement > PLACE_DEFORMED || !is_flag(p->tied) || p->tied != (p->ties > 0) || !is_flag(p->curved) || (p->parts && !p->curved) || p->bending > p->parts ||
        !is_flag(p->by_load_given) || !is_flag(p->by_mode_given) || !is_flag(p->judged) || !is_flag(p->inertial) ||
        !is_flag(p->spins) || p->spins > p->rigid || !is_flag(p->spin_inertia_given) || p->spin_inertia_given > p->spins)
        return "an option is out of range";
    if (!is_flag(p->turns) || !is_flag(p->turn_slides) || p->turn_axes != (p->turns ? (p->turn_axes == 1 ? 1 : 3) : 0) ||
        (p->turns && (!s || p->tied || p->by_load_given || p->by_mode_given || p->parent[0] != -1 || p->placement != PLACE_DEFORMED ||
                      p->rigid != p->turn_axes + 3 * p->turn_slides)))
        return "a body that turns freely is none";
    if (p->rigid >= m || p->elastic_first + p->elastic_count > m || p->turning_limit > 100 || p->strain_limit > 300) return "modes are out of range";
    if (!positive(p->omega, p->rigid, 1) || !positive(p->omega + p->rigid, m - p->rigid, 0)) return "frequencies are not positive";
    for (int64_t j = 0; j < p->rigid; j++)
        if (p->omega[j] != 0.0) return "rigid motions have frequencies";
    if (!positive(p->zeta, m, 1) || !positive(p->weight, m, 0)) return "damping or weights are negative";
    if (p->tied && p->rigid) return "ties join a body that is free";
    for (int64_t i = 0; i < k; i++)
        if (p->parent[i] < -1 || p->parent[i] >= (i < s ? i : s)) return "a node hangs on what is not before it";
    if (p->curved) {
        if (p->parts > 6 * k + p->stretches) return "the coordinates that bend are too many";
        int64_t numbers = 0, bends = 0;
        for (int64_t i = 0; i < p->parts; i++) {
            if (p->extent[i] < 1 || p->extent[i] > m) return "coordinates that bend are out of range";
            numbers += p->extent[i] < m ? p->extent[i] * m : 0;
        }
        if (numbers != p->basis_numbers) return "the coordinates that bend are incomplete";
        for (int64_t i = 0; i < 6 * k; i++) {
            if (p->part[i] < -1 || p->part[i] >= p->bending) return "a curvature is of no part";
        }
        for (int64_t part = 0; part < p->bending; part++) {
            int64_t rows = 0;
            for (int64_t i = 0; i < 6 * k; i++) rows += p->part[i] == part;
            bends += packed_total(rows, p->extent[part]);
        }
        if (bends != p->bends) return "curvatures are incomplete";
    }
    if (2 * p->judged_pairs != (p->judged ? p->elastic_count * (p->elastic_count + 1) : 0) || !positive(p->judge_size, p->judged * p->loads, 0)) return "the second opinion is incomplete";
    int64_t stretches = 0, stretch_numbers = 0;
    for (int64_t part = 0; part < p->parts; part++) {
        if (p->stretch_rows[part] < 0 || p->stretch_rows[part] > (p->extent[part] < m ? p->stretches - stretches : 0)) return "a stretch is of no part";
        stretches += p->stretch_rows[part];
        stretch_numbers += packed_total(p->stretch_rows[part], p->extent[part]);
    }
    if (p->stretch_numbers != stretch_numbers + packed_total(p->stretches - stretches, m)) return "stretches are incomplete";
    if (!positive(p->mass, p->masses, 1) || !positive(p->tie_stiffness, 3 * p->ties, 1)) return "a mass or stiffness is negative";
    if (!within(p->pull, p->pulls, 0, 6 * p->ties - 1) || p->pulls > 6 * p->ties) return "a tie's coordinate is out of range";
    if (!within(p->turning_frame, p->turnings, 0, s ? s - 1 : 0)) return "a rotation is of no frame";
    if (p->stress_start[0] != 0 || p->stress_start[p->stress_sets] != p->stress_points) return "stress points are out of range";
    for (int64_t i = 0; i < p->stress_sets; i++)
        if (p->stress_start[i + 1] < p->stress_start[i]) return "stress points are out of order";
    if (p->inertial_modes > m || (p->inertial_modes > 0) != (p->lumps > 0 || p->mass_forms > 0) || p->lumped != (p->lumps > 0) || (p->lumped && p->mass_forms) ||
        2 * p->mass_pairs != (p->mass_forms ? p->inertial_modes * (p->inertial_modes + 1) : 0) ||
        2 * p->mass_squares != (p->mass_forms ? p->slow_modes * (p->slow_modes + 1) : 0) || p->slow_modes > p->inertial_modes || (p->slow_modes > 0) != (p->inertial_modes > 0) ||
        (p->inertial ? !p->inertial_modes || !s || p->tied : p->lumps) || (p->inertial && p->mass_forms && p->rigid && !p->turns) ||
        p->centres != (p->inertial && p->mass_forms && p->turn_slides ? 3 : 0))
        return "the deformed body's mass is neither that of lumps nor a polynomial";
    if (p->mass_products && (!p->mass_forms || p->rigid)) return "products are of no polynomial";
    for (int64_t i = 0; i < 2 * p->mass_products; i++)
        if (!within(p->mass_factor + i, 1, 0, i % 2 ? m + p->mass_squares - 1 : m - 1)) return "a product is of no coordinates";
    if (!positive(p->lump_mass, p->lumps, 1)) return "a lump's mass is negative";
    if (p->body_size[0] < 0.0) return "the body's size is negative";
    if (!(p->suggested_step[0] > 0.0)) return "the suggested step is not positive";
    if (!within(p->mixed_mode, p->mixed, p->rigid, m - 1)) return "a mode that is none of the mesh is out of range";
    if (!within(p->follower, p->followers, 0, p->interfaces - 1) || (p->followers && p->placement != PLACE_DEFORMED))
        return "a load follows no interface";
    if (p->compliances > p->interfaces || !within(p->compliance_interface, p->compliances, 0, p->interfaces - 1))
        return "a compliance is of no interface";
    if (texts_in(p->names, p->name_bytes) != p->interfaces + (s ? s : 0) + p->loads || texts_in(p->advice, p->advice_bytes) < ADVICES)
        return "names are missing";
    if (texts_in(p->variable_texts, p->variable_bytes) != p->variables || texts_in(p->guid, p->guid_bytes) != 1)
        return "variables have no names";
    if (p->names[p->name_bytes - 1] || p->advice[p->advice_bytes - 1] || p->guid[p->guid_bytes - 1] ||
        (p->variables && p->variable_texts[p->variable_bytes - 1]))
        return "names do not end";
    if (!within(p->variable_type, p->variables, 0, 3)) return "a variable is of no type";
    return 0;
}

uint64_t program_mark(const void *image) {
    Head head;
    memcpy(&head, image, sizeof head);
    return head.checksum;
}

uint64_t program_base(const void *image) {
    Head head;
    memcpy(&head, image, sizeof head);
    return head.base;
}

/* Where an array lies: at word `place` of the image, or, negative, of its base; null where it does not lie within. */
static const void *array_at(const Image *image, const Image *base, int64_t place, int64_t room, const char **used) {
    const Image *in = place < 0 ? base : image;
    if (!place || place < -in->size || place > in->size) return 0;
    const int64_t at = (place < 0 ? -place : place) * WORD;
    if (room > in->size - at) return 0;
    const char *start = (const char *)in->bytes + at;
    if (in == image && start + room > *used) *used = start + room;
    return start;
}

const char *open_program(Image image, Image base, Program *p) {
    static const char short_of[] = "it is shorter than it says";
    const int64_t size = image.size;
    const char *at = image.bytes;
    Head head;
    const union {
        uint16_t number;
        char first;
    } order = {1};
    if (order.first != 1) return "this machine is not little-endian";
    if (size < (int64_t)sizeof head || memcmp(at, "flexprog", WORD) != 0) return "it is no program of flexfmu";
    memcpy(&head, at, sizeof head);
    if (head.version != PROGRAM_VERSION) return "it is of another version";
    char padded[sizeof TABLE + WORD] = {0};
    memcpy(padded, TABLE, sizeof TABLE - 1);
    if (head.table != checksum(padded, (int64_t)((sizeof TABLE - 1 + WORD - 1) / WORD))) return "its table of fields is another";
    if (head.bytes != size || size % WORD) return short_of;
    if (head.checksum != checksum(at + sizeof head, (size - (int64_t)sizeof head) / WORD)) return "it was altered";
    if (head.base && (!base.bytes || head.base != program_mark(base.bytes))) return "it takes arrays of another body";
    if (!head.base) base = (Image){0, 0};
    const char *end = at + size, *used;
    at += sizeof head;
/* Counts are formed of local floating-point copies of the sizes, which cannot overflow. */
#define SIZE(name) double name = 0.0;
#define REAL(name, count)
#define INTEGER(name, count)
#define SHORT(name, count)
#define TEXT(name, count)
#include "fields.def"
#undef SIZE
#undef REAL
#undef INTEGER
#undef SHORT
#undef TEXT
#define SIZE(name)                                                             \
    if (end - at < WORD) return short_of;                                      \
    memcpy(&p->name, at, WORD);                                                \
    at += WORD;                                                                \
    if (p->name < 0 || p->name > MOST_SIZE) return "a size is out of range: " #name; \
    name = (double)p->name;                                                    \
    (void)name;
#define ARRAY(name, count, type, size_of)                                      \
    if (!((count) <= MOST_NUMBERS)) return "an array is too large: " #name;    \
    numbers = (int64_t)(count);                                                \
    room = (numbers * (size_of) + WORD - 1) / WORD * WORD;                     \
    if (end - at < WORD) return short_of;                                      \
    memcpy(&place, at, WORD);                                                  \
    at += WORD;                                                                \
    used = used > at ? used : at;                                              \
    p->name = numbers ? array_at(&image, &base, place, room, &used) : 0;       \
    if (numbers && !p->name) return short_of;
#define REAL(name, count)                                                      \
    ARRAY(name, count, double, WORD)                                           \
    if (!all_finite(p->name, numbers)) return "numbers are not finite: " #name;
#define INTEGER(name, count) ARRAY(name, count, int64_t, WORD)
#define SHORT(name, count) ARRAY(name, count, int16_t, 2)
#define TEXT(name, count) ARRAY(name, count, char, 1)
    int64_t numbers, room, place;
    used = at;
#include "fields.def"
#undef SIZE
#undef REAL
#undef INTEGER
#undef SHORT
#undef TEXT
    const int64_t whole = (used - (const char *)image.bytes + IMAGE_ALIGNMENT - 1) / IMAGE_ALIGNMENT * IMAGE_ALIGNMENT;
    if (whole != size) return whole > size ? short_of : "it is longer than it says";
    return inconsistent(p);
}
