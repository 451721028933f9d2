#if defined(__APPLE__)
#define _DARWIN_C_SOURCE
#elif !defined(_WIN32)
#define _DEFAULT_SOURCE
#endif
#include "files.h"

#include <stdlib.h>
#include <string.h>

#if defined(FLEX_BODY)
/* The bytes of body.prog as C, by `xxd -i body.prog`: for targets without files. */
extern unsigned char body_prog[] __attribute__((aligned(8)));
#include FLEX_BODY
#elif defined(__wasm__)
#define PAGE __attribute__((visibility("default")))
#elif defined(_WIN32)
#include <windows.h>
#else
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#if defined(__GLIBC__)
#include <sys/syscall.h>
#endif
#ifndef O_CLOEXEC
#define O_CLOEXEC 0
#endif
#endif

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
const void *map_file(const char *folder, const char *name, int64_t *size, FileMark *mark) {
    (void)folder;
    *size = (int64_t)sizeof body_prog;
    *mark = (FileMark){0, (uintptr_t)body_prog, sizeof body_prog, 0, 0};
    return strcmp(name, "body.prog") == 0 ? body_prog : 0;
}
#elif defined(__wasm__)
/* What a page gives before it makes an instance; a file given again replaces the former. */
enum { MOST_FILES = 32, MOST_NAME = 64 };
static struct {
    char name[MOST_NAME];
    void *bytes;
    int64_t size;
} files[MOST_FILES];

/* Room for the bytes of a file of the resources, to be written by the caller; null where there is none. */
PAGE void *fmi2FlexfmuFile(const char *name, size_t size) {
    int i = 0;
    while (i < MOST_FILES && files[i].bytes && strcmp(files[i].name, name) != 0) i++;
    if (i == MOST_FILES || strlen(name) >= MOST_NAME) return 0;
    free(files[i].bytes);
    strcpy(files[i].name, name);
    files[i].size = (int64_t)size;
    return files[i].bytes = malloc(size);
}

/* Room for arrays of calls. */
PAGE void *fmi2FlexfmuRoom(size_t size) { return malloc(size); }

const void *map_file(const char *folder, const char *name, int64_t *size, FileMark *mark) {
    (void)folder;
    *mark = (FileMark){0, 0, 0, 0, 0};
    for (int i = 0; i < MOST_FILES && files[i].bytes; i++) {
        *size = files[i].size;
        if (strcmp(files[i].name, name) == 0) return files[i].bytes;
    }
    return 0;
}
#endif
#if defined(FLEX_BODY) || defined(__wasm__)
void unmap_file(const void *bytes, int64_t size) {
    (void)bytes;
    (void)size;
}

void wait_a_moment(void) {}
#else
static char *path_in(const char *folder, const char *name) {
    const size_t length = strlen(folder), extra = strlen(name);
    char *path = malloc(length + extra + 2);
    if (!path) return 0;
    memcpy(path, folder, length);
    path[length] = '/';
    memcpy(path + length + 1, name, extra + 1);
    return path;
}
#if defined(_WIN32)
/* Windows takes paths in UTF-16. */
static wchar_t *wide_path(const char *path) {
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
    return wide;
}

const void *map_file(const char *folder, const char *name, int64_t *size, FileMark *mark) {
    char *path = path_in(folder, name);
    wchar_t *wide = path ? wide_path(path) : 0;
    free(path);
    if (!wide) return 0;
    const HANDLE file = CreateFileW(wide, GENERIC_READ, FILE_SHARE_READ | FILE_SHARE_DELETE, 0, OPEN_EXISTING, FILE_ATTRIBUTE_NORMAL, 0);
    free(wide);
    if (file == INVALID_HANDLE_VALUE) return 0;
    LARGE_INTEGER length = {0};
    BY_HANDLE_FILE_INFORMATION told;
    *mark = (FileMark){0, 0, 0, 0, 0};
    if (GetFileInformationByHandle(file, &told))
        *mark = (FileMark){told.dwVolumeSerialNumber, (uint64_t)told.nFileIndexHigh << 32 | told.nFileIndexLow,
                           (uint64_t)told.nFileSizeHigh << 32 | told.nFileSizeLow, told.ftLastWriteTime.dwHighDateTime,
                           told.ftLastWriteTime.dwLowDateTime};
    const HANDLE mapping = GetFileSizeEx(file, &length) && length.QuadPart > 0 ? CreateFileMappingW(file, 0, PAGE_READONLY, 0, 0, 0) : 0;
    /* The view keeps both open. */
    const void *bytes = mapping ? MapViewOfFile(mapping, FILE_MAP_READ, 0, 0, 0) : 0;
    if (mapping) CloseHandle(mapping);
    CloseHandle(file);
    *size = (int64_t)length.QuadPart;
    return bytes;
}

void unmap_file(const void *bytes, int64_t size) {
    (void)size;
    UnmapViewOfFile(bytes);
}

void wait_a_moment(void) { Sleep(1); }
#else
/* Newer C libraries have other names of this function: by the kernel's the library loads with glibc 2.17, too. */
#if defined(__GLIBC__) && (defined(__x86_64__) || defined(__aarch64__))
#define STATUS(file, status) syscall(SYS_fstat, file, status)
#else
#define STATUS(file, status) fstat(file, status)
#endif
#if defined(__APPLE__)
#define CHANGED st_mtimespec
#else
#define CHANGED st_mtim
#endif

const void *map_file(const char *folder, const char *name, int64_t *size, FileMark *mark) {
    char *path = path_in(folder, name);
    if (!path) return 0;
    const int file = open(path, O_RDONLY | O_CLOEXEC);
    free(path);
    if (file < 0) return 0;
    struct stat told;
    *mark = (FileMark){0, 0, 0, 0, 0};
    if (STATUS(file, &told) == 0)
        *mark = (FileMark){(uint64_t)told.st_dev, (uint64_t)told.st_ino, (uint64_t)told.st_size, (uint64_t)told.CHANGED.tv_sec,
                           (uint64_t)told.CHANGED.tv_nsec};
    const off_t length = lseek(file, 0, SEEK_END);
    void *bytes = length > 0 ? mmap(0, (size_t)length, PROT_READ, MAP_PRIVATE, file, 0) : MAP_FAILED;
    close(file);
    *size = (int64_t)length;
    return bytes == MAP_FAILED ? 0 : bytes;
}

void unmap_file(const void *bytes, int64_t size) { munmap((void *)(uintptr_t)bytes, (size_t)size); }

void wait_a_moment(void) {
    const struct timespec moment = {0, 20000};
    nanosleep(&moment, 0);
}
#endif
#endif
