#include "files.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int hexadecimal(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
}

char *path_of_location(const char *location) {
    const size_t length = strlen(location);
    char *path = malloc(length + 1);
    if (!path) return 0;
    if (strncmp(location, "file:", 5) != 0) {
        memcpy(path, location, length + 1);
        return path;
    }
    const char *at = location + 5;
    /* file:/path, file:///path and file://host/path, of which the host is this one. */
    if (at[0] == '/' && at[1] == '/') {
        at += 2;
        const char *slash = strchr(at, '/');
        at = slash ? slash : at;
    }
#if defined(_WIN32)
    if (at[0] == '/' && at[1] && at[2] == ':') at++;
#endif
    size_t n = 0;
    for (; *at; at++) {
        const int high = *at == '%' ? hexadecimal(at[1]) : -1, low = high >= 0 ? hexadecimal(at[2]) : -1;
        if (low >= 0) {
            path[n++] = (char)(16 * high + low);
            at += 2;
        } else {
            path[n++] = *at;
        }
    }
    path[n] = 0;
    return path;
}

#if defined(FLEX_BODY)
#elif defined(_WIN32)
/* Windows takes paths in UTF-16. */
static FILE *open_file(const char *path) {
    const size_t length = strlen(path);
    wchar_t *wide = malloc((length + 1) * sizeof *wide);
    if (!wide) return 0;
    size_t n = 0;
    for (size_t i = 0; i < length;) {
        const unsigned char first = (unsigned char)path[i++];
        const int more = first >= 0xF0 ? 3 : first >= 0xE0 ? 2 : first >= 0xC0 ? 1 : 0;
        unsigned long code = more ? first & (0x3F >> more) : first;
        for (int k = 0; k < more && i < length; k++) code = code << 6 | ((unsigned char)path[i++] & 0x3F);
        if (code > 0xFFFF) {
            code -= 0x10000;
            wide[n++] = (wchar_t)(0xD800 | (code >> 10 & 0x3FF));
            code = 0xDC00 | (code & 0x3FF);
        }
        wide[n++] = (wchar_t)code;
    }
    wide[n] = 0;
    FILE *file = _wfopen(wide, L"rb");
    free(wide);
    return file;
}
#else
static FILE *open_file(const char *path) { return fopen(path, "rb"); }
#endif

#if defined(FLEX_BODY)
/* The bytes of body.prog as C, by `xxd -i body.prog`: for targets without files. */
#include FLEX_BODY

void *read_whole(const char *folder, const char *name, int64_t *size) {
    (void)folder;
    void *data = strcmp(name, "body.prog") == 0 ? malloc(sizeof body_prog) : 0;
    if (data) memcpy(data, body_prog, sizeof body_prog);
    *size = (int64_t)sizeof body_prog;
    return data;
}
#else
void *read_whole(const char *folder, const char *name, int64_t *size) {
    const size_t length = strlen(folder), extra = strlen(name);
    char *path = malloc(length + extra + 2);
    if (!path) return 0;
    memcpy(path, folder, length);
    path[length] = '/';
    memcpy(path + length + 1, name, extra + 1);
    FILE *file = open_file(path);
    free(path);
    if (!file) return 0;
    char *data = 0;
    long end = -1;
    if (fseek(file, 0, SEEK_END) == 0) end = ftell(file);
    if (end > 0 && fseek(file, 0, SEEK_SET) == 0) data = malloc((size_t)end);
    if (data && fread(data, 1, (size_t)end, file) != (size_t)end) {
        free(data);
        data = 0;
    }
    fclose(file);
    *size = end;
    return data;
}
#endif
