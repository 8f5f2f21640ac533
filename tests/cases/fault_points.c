/*
 * Fault points on the file layer of a process, for LD_PRELOAD:  every operation that changes something in one folder
 * (file or folder created, bytes written, flushed to the disk, cut, renamed, deleted) is counted and listed, by
 * whatever library it is asked for, SQLite included.  At the k-th one the process is killed or stopped, or the
 * operation fails.  Only tests load this; nothing happens before `fault_points_arm`.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

enum how { COUNT, KILL_BEFORE, KILL_AMID, STOP, FULL_DISK, READ_ONLY, FAIL_ONCE };
enum what { CREATE, WRITE, SYNC, CUT, RENAME, DELETE, FOLDER };
static const char *const NAMES[] = {"create", "write", "sync", "cut", "rename", "delete", "folder"};

/* what the parent of a killed process reads: in memory that both share */
struct record {
    long count;
    size_t length;
    char listed[1 << 20];
};
static struct record *record;
static char folder[4096];
static size_t folder_length;
static long fault_at;
static int fault_how, fault_errno;

__attribute__((constructor)) static void begin(void)
{
    void *shared = mmap(NULL, sizeof *record, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED)
        abort();
    record = shared;
}

/* The k-th operation in the folder (an absolute path without links) fails in this way; error is of FAIL_ONCE. */
void fault_points_arm(const char *path, long k, int how, int error)
{
    record->count = 0;
    record->length = 0;
    record->listed[0] = 0;
    snprintf(folder, sizeof folder, "%s", path);
    folder_length = strlen(folder);
    fault_at = k;
    fault_how = how;
    fault_errno = error;
}

/* The operations so far, a line each: what, and the path. */
const char *fault_points_listed(void)
{
    return record->listed;
}

static int inside(const char *path)
{
    return folder_length && path && !strncmp(path, folder, folder_length) &&
           (path[folder_length] == '/' || path[folder_length] == 0);
}

static int inside_fd(int fd, char *path, size_t size)
{
    char link[64];
    int saved = errno;
    ssize_t length = -1;
    if (folder_length) {
        snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
        length = readlink(link, path, size - 1);
    }
    errno = saved;
    if (length < 0)
        return 0;
    path[length] = 0;
    return inside(path);
}

static void end_by(int by)
{
    kill(getpid(), by);
    while (by == SIGKILL)
        pause();
}

/* 0: go on; 1: do it (a write: half of it) and call `end_by(SIGKILL)`; 2: a write is cut short; -1: fails, errno set */
static int counted(enum what what, const char *path)
{
    long number = ++record->count;
    size_t left = sizeof record->listed - record->length;
    int length = snprintf(record->listed + record->length, left, "%s %s\n", NAMES[what], path);
    if (length > 0 && (size_t)length < left)
        record->length += length;
    if (fault_how == READ_ONLY) {
        errno = EROFS;
        return -1;
    }
    if (fault_how == FULL_DISK && number >= fault_at) {
        if (number == fault_at && what == WRITE)
            return 2;
        if (number == fault_at || what == CREATE || what == WRITE || what == FOLDER || what == SYNC) {
            errno = ENOSPC;
            return -1;
        }
    }
    if (number != fault_at)
        return 0;
    if (fault_how == KILL_BEFORE)
        end_by(SIGKILL);
    if (fault_how == STOP)
        end_by(SIGSTOP);
    if (fault_how == FAIL_ONCE) {
        errno = fault_errno;
        return -1;
    }
    return fault_how == KILL_AMID;
}

#define REAL(name, type) \
    static type real_##name; \
    if (!real_##name) \
        real_##name = (type)dlsym(RTLD_NEXT, #name)

#define AROUND(what, path, call) \
    do { \
        int fault = counted(what, path); \
        if (fault < 0) \
            return -1; \
        int done = call; \
        if (fault == 1) \
            end_by(SIGKILL); \
        return done; \
    } while (0)

typedef int (*open_type)(const char *, int, ...);
typedef ssize_t (*write_type)(int, const void *, size_t);
typedef ssize_t (*pwrite_type)(int, const void *, size_t, off_t);
typedef int (*fd_type)(int);
typedef int (*cut_type)(int, off_t);
typedef int (*path_type)(const char *);
typedef int (*two_paths_type)(const char *, const char *);
typedef int (*folder_type)(const char *, mode_t);
typedef int (*access_type)(const char *, int);

#define OPEN(name) \
    int name(const char *path, int flags, ...) \
    { \
        va_list rest; \
        va_start(rest, flags); \
        int mode = flags & O_CREAT ? va_arg(rest, int) : 0; \
        va_end(rest); \
        REAL(name, open_type); \
        int saved = errno; \
        if (!inside(path) || (flags & O_ACCMODE) == O_RDONLY) \
            return real_##name(path, flags, mode); \
        struct stat there; \
        int new = (flags & O_CREAT && stat(path, &there)) || flags & O_TRUNC; \
        errno = saved; \
        if (!new && fault_how == READ_ONLY) { \
            errno = EROFS; \
            return -1; \
        } \
        if (!new) \
            return real_##name(path, flags, mode); \
        AROUND(CREATE, path, real_##name(path, flags, mode)); \
    }
OPEN(open)
OPEN(open64)

#define WRITE_BODY(real, ...) \
    char path[4096]; \
    if (!inside_fd(fd, path, sizeof path)) \
        return real(fd, data, size __VA_ARGS__); \
    int fault = counted(WRITE, path); \
    if (fault < 0) \
        return -1; \
    size_t part = fault ? size / 2 : size; \
    if (fault == 2 && !part) { \
        errno = ENOSPC; \
        return -1; \
    } \
    size = part; \
    ssize_t done = real(fd, data, size __VA_ARGS__); \
    if (fault == 1) \
        end_by(SIGKILL); \
    return done

ssize_t write(int fd, const void *data, size_t size)
{
    REAL(write, write_type);
    WRITE_BODY(real_write);
}

#define PWRITE(name) \
    ssize_t name(int fd, const void *data, size_t size, off_t at) \
    { \
        REAL(name, pwrite_type); \
        WRITE_BODY(real_##name, , at); \
    }
PWRITE(pwrite)
PWRITE(pwrite64)

/* a kill leaves what was written, flushed or not: nothing is flushed here, which takes the tests' time */
#define SYNC_LIKE(name) \
    int name(int fd) \
    { \
        REAL(name, fd_type); \
        char path[4096]; \
        if (!inside_fd(fd, path, sizeof path)) \
            return real_##name(fd); \
        AROUND(SYNC, path, 0); \
    }
SYNC_LIKE(fsync)
SYNC_LIKE(fdatasync)

#define CUT_LIKE(name) \
    int name(int fd, off_t length) \
    { \
        REAL(name, cut_type); \
        char path[4096]; \
        if (!inside_fd(fd, path, sizeof path)) \
            return real_##name(fd, length); \
        AROUND(CUT, path, real_##name(fd, length)); \
    }
CUT_LIKE(ftruncate)
CUT_LIKE(ftruncate64)

int rename(const char *from, const char *to)
{
    REAL(rename, two_paths_type);
    if (!inside(from) && !inside(to))
        return real_rename(from, to);
    AROUND(RENAME, to, real_rename(from, to));
}

int unlink(const char *path)
{
    REAL(unlink, path_type);
    if (!inside(path))
        return real_unlink(path);
    AROUND(DELETE, path, real_unlink(path));
}

int mkdir(const char *path, mode_t mode)
{
    REAL(mkdir, folder_type);
    struct stat there;
    int saved = errno;
    if (!inside(path) || !stat(path, &there))
        return real_mkdir(path, mode);
    errno = saved;
    AROUND(FOLDER, path, real_mkdir(path, mode));
}

int access(const char *path, int mode)
{
    REAL(access, access_type);
    if (fault_how == READ_ONLY && mode & W_OK && inside(path)) {
        errno = EROFS;
        return -1;
    }
    return real_access(path, mode);
}
