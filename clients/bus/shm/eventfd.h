/* A doorbell as a descriptor: the only system calls of the native core's pure part. doorbell.h decides when they are
 * due.
 *
 * A doorbell is an eventfd, and all processes that have it share one open file. Each of them can clear O_NONBLOCK, and
 * fill or empty the counter. They all belong to one user, and such processes could do more harm by other means.
 */
#ifndef BUS_SHM_EVENTFD_H
#define BUS_SHM_EVENTFD_H

#include <stdint.h>
#include <unistd.h>

/* Adds `knock` (see doorbell.h) to a doorbell. A failure needs no handling: a full counter means that the doorbell was
 * rung already, and a broken descriptor harms only its owner. */
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
