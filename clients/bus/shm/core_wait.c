/* Reader.wait: a thread that has nothing else to do sleeps here until a message comes, and leaves with it.
 *
 * It stands in for a loop that is not run meanwhile: whatever is that loop's to do ends the wait. The doorbell that has
 * woken it is read when it is about to sleep again, or by the loop. So where nobody is asleep by the bell, the doorbell
 * is rung, and the loop's next look at its descriptors goes on from there.
 */
#include "core.h"

#include <errno.h>
#include <limits.h>
#include <poll.h>
#include <sys/epoll.h>
#include <time.h>

enum {
    NS = 1000000000,
    MS_NS = 1000000,
    FINE_NS = 20 * MS_NS, /* shorter waits are exact; epoll_wait() knows milliseconds only */
    REST_NS = 5 * MS_NS,  /* who finds all messages without a sleep still lets the loop have its turn this often */
    MOST_EVENTS = 8,
    TRIES = 4
};

/* Whether this reader's messages are all that the process waits for in here. */
static bool may_wait(const Reader *self)
{
    const Readers *readers = self->readers;
    return readers->doorbell >= 0 && !readers->has_writers && self->is_noted && self->count != 0 &&
           PyList_Size(self->rejected) == 0;
}

/* Until there are events, or the time is over; without the GIL. */
static int sleep_until(int epoll, uint64_t until_ns, struct epoll_event *events)
{
    while (true) {
        const uint64_t now_ns = until_ns == UINT64_MAX ? 0 : core_now_ns();
        const uint64_t left_ns = now_ns < until_ns ? until_ns - now_ns : 0;
        if (left_ns >= FINE_NS) {
            const int left_ms = left_ns / MS_NS < INT_MAX ? (int)(left_ns / MS_NS) : INT_MAX;
            const int got = epoll_wait(epoll, events, MOST_EVENTS, until_ns == UINT64_MAX ? -1 : left_ms);
            if (got != 0)
                return got;
            continue;
        }
        struct pollfd descriptor = {.fd = epoll, .events = POLLIN};
        const struct timespec left = {.tv_nsec = (long)left_ns};
        if (left_ns != 0 && ppoll(&descriptor, 1, &left, NULL) < 0)
            return -1;
        return epoll_wait(epoll, events, MOST_EVENTS, 0);
    }
}

/* Sleeps. True: there is only the doorbell, if anything, to look after in here. False: the wait is over, perhaps with an
 * error; `*is_rung` tells of the doorbell. */
static bool sleep_by(Readers *self, int epoll, uint64_t until_ns, bool *is_rung)
{
    struct epoll_event events[MOST_EVENTS];
    int got;
    Py_BEGIN_ALLOW_THREADS
    got = sleep_until(epoll, until_ns, events);
    Py_END_ALLOW_THREADS
    *is_rung = false;
    if (got < 0 && errno == EINTR)
        PyErr_CheckSignals(); /* a handler may have run the loop: whoever called looks at all of it again */
    for (int i = 0; i < got; i++)
        *is_rung = *is_rung || events[i].data.fd == self->doorbell;
    if (*is_rung) {
        self->is_rung = true;
        bell_disarm(&self->header->arrival);
    }
    if (got != 1 || !*is_rung)
        return false;
    self->turned_ns = core_now_ns();
    return true;
}

/* The bell is armed, and the eventfd read. False: the loop has to look after another reader. */
static bool fall_asleep(Reader *reader)
{
    Readers *self = reader->readers;
    if (self->is_rung) {
        if (readers_have_news_besides(self, reader))
            return false; /* the doorbell stays rung for it */
        self->is_rung = false;
        doorbell_clear(self->doorbell); /* whoever rang before, published before: the look finds it */
    }
    bell_arm(&self->header->arrival, 0); /* PAIR(sleep): before the look. Counterpart: writer_ring(). */
    if (!readers_have_news_besides(self, reader))
        return true;
    doorbell_ring(self->doorbell, KNOCK_ANY); /* its ring may be the one that was just read */
    return false;
}

/* 0: *until_ns is the earlier of both. */
static int earlier(PyObject *deadline_ns, PyObject *due_s, uint64_t *until_ns)
{
    const double due = PyFloat_AsDouble(due_s);
    if ((due == -1 && PyErr_Occurred()) || !core_as_u64(deadline_ns, until_ns))
        return -1;
    if (*until_ns == 0)
        *until_ns = UINT64_MAX;
    if (due > 0 && due < 9e9 && (uint64_t)(due * NS) < *until_ns)
        *until_ns = (uint64_t)(due * NS);
    return 0;
}

PyObject *reader_wait(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    Reader *self = (Reader *)object;
    Readers *readers = self->readers;
    uint64_t until_ns;
    if (count != 5) {
        PyErr_SetString(PyExc_TypeError, "decode, has_origin, epoll, deadline_ns and due_s are needed");
        return NULL;
    }
    const long epoll = PyLong_AsLong(args[2]);
    if ((epoll == -1 && PyErr_Occurred()) || earlier(args[3], args[4], &until_ns) < 0)
        return NULL;
    const uint64_t now_ns = core_now_ns();
    if (now_ns >= until_ns || readers->is_turn_due) {
        readers->is_turn_due = false;
        readers->turned_ns = now_ns;
        Py_RETURN_NONE;
    }
    bool may_sleep = true, is_rung;
    for (int tries = 0; tries < TRIES && may_wait(self); tries++) {
        PyObject *item;
        if (reader_take_oldest(self, args[0], args[1] == Py_True, &item) < 0)
            return NULL;
        if (item != NULL) {
            readers->is_turn_due = !may_sleep || now_ns > readers->turned_ns + REST_NS;
            return item;
        }
        if (!may_sleep || !may_wait(self))
            break;
        if (reader_has_more(self))
            continue;
        if (!fall_asleep(self))
            break;
        if (reader_has_more(self))
            continue; /* the bell may ring for it: a turn of the loop for nothing */
        may_sleep = sleep_by(readers, (int)epoll, until_ns, &is_rung);
        if (PyErr_Occurred())
            return NULL;
        if (!is_rung)
            break;
        if (may_sleep)
            tries = 0;
    }
    Py_RETURN_NONE;
}
