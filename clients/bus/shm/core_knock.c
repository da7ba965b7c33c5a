/* Ringing doorbells, and hushing one's own, so that nobody can hold up who does it.
 *
 * A doorbell is an eventfd, and all who have it share one open file: each of them can take O_NONBLOCK away, and fill
 * the counter, or empty it. Then write() blocks, or read() does, and looking first is no help, because it can be done
 * in between. Among processes of one user that does not matter: they could do worse. For a doorbell of another user's:
 *
 *   ring   as the end of an asynchronous operation (IOCB_FLAG_RESFD of io_submit(2)), for which the kernel adds to the
 *          counter itself: it never waits, whatever the flags are, and where it is full, leaves it so. The operation
 *          is a read of nothing from /dev/null, which ends at once.
 *   hush   one's own, which others may have: a read that does not wait by its own word (RWF_NOWAIT).
 */
#include "core.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#if defined(__has_include)
#if __has_include(<linux/aio_abi.h>)
#include <linux/aio_abi.h>
#define HAS_AIO
#endif
#endif

#ifdef HAS_AIO
enum { AT_ONCE = 16 };

static struct {
    aio_context_t context; /* 0: none yet */
    int nothing;           /* /dev/null */
    unsigned forks;        /* the context is that process's which made it */
} foreign;

static int prepare(void)
{
    if (foreign.context != 0 && foreign.forks == core_forks)
        return 0;
    if (foreign.context == 0 && (foreign.nothing = open("/dev/null", O_RDONLY | O_CLOEXEC)) < 0)
        return -1;
    aio_context_t context = 0;
    if (syscall(SYS_io_setup, AT_ONCE, &context) < 0) {
        if (foreign.context == 0)
            close(foreign.nothing);
        return -1;
    }
    foreign.context = context;
    foreign.forks = core_forks;
    return 0;
}

static void ring_foreign(int number)
{
    struct iocb read_nothing = {.aio_lio_opcode = IOCB_CMD_PREAD,
                                .aio_fildes = (__u32)foreign.nothing,
                                .aio_flags = IOCB_FLAG_RESFD,
                                .aio_resfd = (__u32)number};
    struct iocb *operations[] = {&read_nothing};
    struct io_event ended[AT_ONCE];
    struct timespec none = {0};
    syscall(SYS_io_submit, foreign.context, 1L, operations);
    syscall(SYS_io_getevents, foreign.context, 0L, (long)AT_ONCE, ended, &none); /* makes room for the next */
}
#else
static int prepare(void)
{
    errno = ENOSYS;
    return -1;
}

static void ring_foreign(int number) { (void)number; }
#endif

/* To be called before a doorbell is rung for the first time. -1 and OSError where it can't be rung safely. */
int doorbell_prepare(const struct doorbell *doorbell)
{
    if (!doorbell->is_foreign || prepare() == 0)
        return 0;
    PyErr_SetFromErrno(PyExc_OSError);
    return -1;
}

/* `knock`: see doorbell.h; another user's hears 1. Nothing to do where it fails: full means that it is rung, and a
 * descriptor that is none is its owner's loss. */
void doorbell_ring(const struct doorbell *doorbell, uint64_t knock)
{
    if (doorbell->is_foreign) {
        ring_foreign(doorbell->number);
        return;
    }
    const ssize_t written = write(doorbell->number, &knock, sizeof knock);
    (void)written;
}

/* One's own was rung, or not. `is_wary`: other users may have it. Returns its count, 0 where it was not rung. */
uint64_t doorbell_hush(int number, bool is_wary)
{
    uint64_t count = 0;
    struct iovec place = {&count, sizeof count};
    /* Linux before 5.8 does not know how. */
    if (is_wary && (preadv2(number, &place, 1, -1, RWF_NOWAIT) >= 0 || errno == EAGAIN))
        return count;
    return read(number, &count, sizeof count) == sizeof count ? count : 0; /* empty: rung for nothing */
}
