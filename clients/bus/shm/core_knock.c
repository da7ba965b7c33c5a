/* Ringing doorbells, and clearing one's own.
 *
 * A doorbell is an eventfd, and all who have it share one open file: each of them can take O_NONBLOCK away, and fill
 * the counter, or empty it. Only processes of one user have it, which could do worse.
 */
#include "core.h"

#include <unistd.h>

/* `knock`: see doorbell.h. Nothing to do where it fails: full means that it is rung, and a descriptor that is none is
 * its owner's loss. */
void doorbell_ring(int number, uint64_t knock)
{
    const ssize_t written = write(number, &knock, sizeof knock);
    (void)written;
}

/* One's own was rung, or not. Returns its count, 0 where it was not rung. */
uint64_t doorbell_clear(int number)
{
    uint64_t count = 0;
    return read(number, &count, sizeof count) == sizeof count ? count : 0;
}
