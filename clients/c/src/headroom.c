/* Free memory of this process's memory cgroups, as in a container, and of the machine.
 *
 * At such a limit the kernel kills a process without an error. So a segment is made only if a reserve stays free after
 * it (sizes.h). The kernel can free cached files; recently used ones count half.
 */
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "internal.h"

#define UNLIMITED (UINT64_C(1) << 60)
#define SMALL (1u << 20) /* smaller segments need no check for a second after one that found enough */
#define GRANT_PART 16u
#define MOST_BYTES 16384u

/* Reads a short file of the kernel. False: there is none. */
static bool read_file(const char *folder, const char *name, char *text)
{
    char path[PATH_MAX];
    if (snprintf(path, sizeof path, "%s%s", folder, name) >= (int)sizeof path)
        return false;
    const int fd = open(path, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return false;
    const ssize_t size = read(fd, text, MOST_BYTES - 1);
    close(fd);
    text[size < 0 ? 0 : size] = '\0';
    return size > 0;
}

static uint64_t number_in(const char *folder, const char *name)
{
    char text[MOST_BYTES], *end;
    if (!read_file(folder, name, text))
        return UNLIMITED;
    const unsigned long long number = strtoull(text, &end, 10);
    return end == text ? UNLIMITED : sizes_min(number, UNLIMITED);
}

/* The number after `name` at the beginning of a line; 0: none. */
static uint64_t field_of(const char *text, const char *name)
{
    const size_t length = strlen(name);
    for (const char *line = text; line != NULL; line = strchr(line, '\n')) {
        line += *line == '\n';
        if (strncmp(line, name, length) == 0)
            return strtoull(line + length, NULL, 10);
    }
    return 0;
}

/* Bytes below a limit, without the reserve for a segment of `size` bytes. */
static uint64_t spare(uint64_t limit, uint64_t left, uint64_t size)
{
    const uint64_t kept = memory_kept(limit, size);
    return left > kept ? left - kept : 0;
}

/* Spare bytes of one memory cgroup, version 2 or 1. */
static uint64_t spare_of(const char *folder, bool is_v2, uint64_t size)
{
    char text[MOST_BYTES];
    uint64_t limit = number_in(folder, is_v2 ? "/memory.max" : "/memory.limit_in_bytes");
    if (is_v2)
        limit = sizes_min(limit, number_in(folder, "/memory.high"));
    if (limit >= UNLIMITED)
        return UNLIMITED;
    uint64_t used = number_in(folder, is_v2 ? "/memory.current" : "/memory.usage_in_bytes");
    if (used >= UNLIMITED)
        return UNLIMITED;
    if (read_file(folder, "/memory.stat", text)) {
        const uint64_t cached = field_of(text, is_v2 ? "inactive_file " : "total_inactive_file ")
                                + field_of(text, is_v2 ? "active_file " : "total_active_file ") / 2;
        used -= sizes_min(used, cached);
    }
    return spare(limit, used < limit ? limit - used : 0, size);
}

/* The same of the cgroup `path` and its parents. In a container the path may not exist below the mount; the mount's
 * root then is the container's own cgroup. */
static uint64_t spare_above(const char *mount, char *path, bool is_v2, uint64_t size)
{
    uint64_t least = UNLIMITED;
    for (;;) {
        char folder[PATH_MAX];
        if (snprintf(folder, sizeof folder, "%s%s", mount, path) < (int)sizeof folder)
            least = sizes_min(least, spare_of(folder, is_v2, size));
        char *slash = strrchr(path, '/');
        if (slash == NULL)
            return least;
        *slash = '\0';
    }
}

static uint64_t spare_now(uint64_t size)
{
    char text[MOST_BYTES], *rest = text, *line;
    uint64_t least = UNLIMITED;
    if (read_file("", "/proc/meminfo", text)) {
        const uint64_t total = field_of(text, "MemTotal:") << 10, left = field_of(text, "MemAvailable:") << 10;
        if (total != 0 && left != 0)
            least = spare(total, left, size);
    }
    if (!read_file("", "/proc/self/cgroup", text))
        return least;
    while ((line = strsep(&rest, "\n")) != NULL) {
        strsep(&line, ":");
        char *controllers = strsep(&line, ":");
        if (line == NULL || controllers == NULL)
            continue;
        if (strcmp(line, "/") == 0)
            *line = '\0';
        if (*controllers == '\0')
            least = sizes_min(least, spare_above("/sys/fs/cgroup", line, true, size));
        else if (strstr(controllers, "memory") != NULL)
            least = sizes_min(least, spare_above("/sys/fs/cgroup/memory", line, false, size));
    }
    return least;
}

/* Whether `size` bytes more leave the reserve free. `whole`: the size of the segment that they are a part of. */
bool headroom_claim(busd_bus *bus, uint64_t size, uint64_t whole)
{
    const int64_t now = now_ns();
    if (size >= SMALL || size > bus->memory_left || now >= bus->memory_until_ns) {
        const uint64_t free = spare_now(whole);
        if (free < size)
            return false;
        bus->memory_left = (free - size) / GRANT_PART + size;
        bus->memory_until_ns = now + SECOND_NS;
    }
    bus->memory_left -= sizes_min(size, bus->memory_left);
    return true;
}
