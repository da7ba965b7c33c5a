/* A doorbell as a descriptor: the only system calls of the native core's pure part. doorbell.h says when they are due.
 *
 * A doorbell is an eventfd, and all processes that have it share one open file: each can clear O_NONBLOCK, and fill or
 * empty the counter. Only processes of one user have it, which could do worse.
 */
#ifndef BUS_SHM_EVENTFD_H
#define BUS_SHM_EVENTFD_H

#include <stdint.h>
#include <unistd.h>

/* `knock`: see doorbell.h. A failure needs no handling: a full counter is rung already, and a broken descriptor harms
 * its owner only. */
static inline void doorbell_ring(int number, uint64_t knock)
{
    const ssize_t written = write(number, &knock, sizeof knock);
    (void)written;
}

/* Empties this process's own doorbell. Returns its count, 0 if it was not rung. */
static inline uint64_t doorbell_clear(int number)
{
    uint64_t count = 0;
    return read(number, &count, sizeof count) == sizeof count ? count : 0;
}

#endif
