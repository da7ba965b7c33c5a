/* Segments: making and sealing them, and mapping those of other processes. docs/ring.md has the rules. */
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include "internal.h"

#ifndef F_SEAL_FUTURE_WRITE
#define F_SEAL_FUTURE_WRITE 0x0010
#endif
#define SEALS (F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_FUTURE_WRITE | F_SEAL_SEAL)
#define FIRST_FD 1024 /* select() accepts no higher number, so segments leave the lower ones to the program */

static struct map *map_new(int fd, size_t size, int protection)
{
    struct map *map = calloc(1, sizeof *map);
    if (map == NULL)
        return NULL;
    const int flags = fd < 0 ? MAP_PRIVATE | MAP_ANONYMOUS : MAP_SHARED;
    struct stat status = {0};
    map->memory = mmap(NULL, size, protection, flags, fd, 0);
    if (map->memory == MAP_FAILED || (fd >= 0 && fstat(fd, &status) != 0)) {
        if (map->memory != MAP_FAILED)
            munmap(map->memory, size);
        free(map);
        return NULL;
    }
    map->size = size;
    map->device = status.st_dev;
    map->inode = status.st_ino;
    map->users = 1;
    return map;
}

struct map *map_use(struct map *map)
{
    map->users++;
    return map;
}

void map_drop(struct map *map)
{
    if (map == NULL || --map->users != 0)
        return;
    munmap(map->memory, map->size);
    free(map);
}

/* Reserves the memory in steps, because other processes may take memory at the same time. */
static bool reserve(busd_bus *bus, int fd, uint64_t size)
{
    for (uint64_t start = 0; start < size; start += MEMORY_STEP) {
        const uint64_t step = sizes_min(size - start, MEMORY_STEP);
        if ((start != 0 && !headroom_claim(bus, size - start, size))
            || posix_fallocate(fd, (off_t)start, (off_t)step) != 0)
            return false;
    }
    return true;
}

static int make_memfd(busd_bus *bus, const char *name, uint64_t size)
{
    int fd = memfd_create(name, MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (fd < 0)
        return -1;
    const int aside = fcntl(fd, F_DUPFD_CLOEXEC, FIRST_FD);
    if (aside >= 0) {
        close(fd);
        fd = aside;
    }
    if (fchmod(fd, 0600) == 0 && ftruncate(fd, (off_t)size) == 0 && reserve(bus, fd, size))
        return fd;
    close(fd);
    return -1;
}

/* Makes a segment of zeroes that only this process can write. Its descriptor goes to *fd; `fd` NULL: private memory.
 * NULL: no memory, or no descriptors. */
struct map *segment_make(busd_bus *bus, const char *name, uint64_t size, int *fd)
{
    if (fd != NULL)
        *fd = -1;
    if (size == 0 || !headroom_claim(bus, size, size))
        return NULL;
    if (fd == NULL)
        return map_new(-1, size, PROT_READ | PROT_WRITE);
    *fd = make_memfd(bus, name, size);
    struct map *map = *fd < 0 ? NULL : map_new(*fd, size, PROT_READ | PROT_WRITE);
    if (map == NULL && *fd >= 0) {
        close(*fd);
        *fd = -1;
    }
    return map;
}

/* Seals a segment after it was mapped and formatted, before another process gets it. */
void segment_seal(int fd)
{
    if (fd >= 0)
        fcntl(fd, F_ADD_SEALS, SEALS);
}

/* Maps a segment of another process, read-only. Returns its fault in words; NULL: *map is mapped. */
const char *segment_map(int fd, struct map **map)
{
    struct stat status;
    struct statfs system;
    const int seals = fcntl(fd, F_GET_SEALS); /* before fstat, which a hostile owner of the file can delay */
    *map = NULL;
    if (seals < 0)
        return "descriptor is no memfd";
    if ((seals & SEALS) != SEALS)
        return "segment lacks seals";
    if (fstat(fd, &status) != 0 || fstatfs(fd, &system) != 0)
        return "descriptor can't be looked at";
    if (system.f_bsize != sysconf(_SC_PAGESIZE))
        return "segment is made of huge pages";
    if (status.st_size <= 0 || status.st_blocks * 512 < status.st_size)
        return "segment's memory is not reserved";
    *map = map_new(fd, (size_t)status.st_size, PROT_READ);
    return *map == NULL ? "no memory to map the segment" : NULL;
}

/* Whether the descriptor is of this mapped segment. */
bool segment_is(int fd, const struct map *map)
{
    struct stat status;
    return fstat(fd, &status) == 0 && status.st_ino == map->inode && status.st_dev == map->device;
}
