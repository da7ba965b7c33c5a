/* Taking from a Reader: merges its feeds by stamp, applies the depth to all of them, decodes records to messages.
 *
 * decode(), a comparison or a garbage collection may run any Python code, which may use this very Reader. So a feed is
 * in a consistent state before any of these, and is looked up again after it.
 */
#include "py.h"

#include <errno.h>
#include <limits.h>
#include <poll.h>
#include <sys/epoll.h>
#include <time.h>

enum { SHORT_BYTES = 4096, BATCH_BYTES = 256 << 10, MAX_REJECTED = 64 };
enum { AGES_AT_ONCE = 64, AGES_EACH = 32 }; /* as in bus.delivery.ages */

struct feed *reader_oldest(Reader *self)
{
    struct feed *oldest = NULL;
    for (size_t i = 0; i < self->count && reader_is_ours(self); i++) {
        struct feed *feed = self->feeds[i];
        if (feed->waiting == 0 || reader_holds(self, feed))
            continue;
        const enum ring_status status = feed_head(feed, self->bound);
        if (status == RING_CORRUPT) {
            if (reader_leave(self, feed, RING_IS_BROKEN) < 0)
                return NULL;
            oldest = NULL;
            i = (size_t)-1; /* begin again */
        } else if (status == RING_OK && (oldest == NULL || feed->head.stamp_ns < oldest->head.stamp_ns)) {
            oldest = feed;
        }
    }
    return oldest;
}

int reader_poll(Reader *self)
{
    uint64_t waiting = 0;
    for (size_t i = 0; i < self->count && reader_is_ours(self); i++) {
        struct feed *feed = self->feeds[i];
        feed_poll(feed, self->bound);
        const bool is_sound = feed_is_sound(feed);
        if (!is_sound || (source_of(feed)->finishing != 0 && feed->waiting == 0)) {
            if (reader_leave(self, feed, is_sound ? "" : RING_IS_BROKEN) < 0)
                return -1;
            waiting = 0;
            i = (size_t)-1; /* begin again */
        } else {
            waiting += feed->waiting <= MAX_SEQ ? feed->waiting : MAX_SEQ;
        }
    }
    if (waiting == 0)
        self->bound = self->depth;
    while (self->bound != 0 && waiting > self->bound) {
        struct feed *feed = reader_oldest(self);
        if (feed == NULL)
            return PyErr_Occurred() ? -1 : 0;
        feed_skip(feed, 1);
        waiting = 0;
        for (size_t i = 0; i < self->count; i++)
            waiting += self->feeds[i]->waiting;
    }
    return 0;
}

void pass_source_time(struct ring_record *record, int64_t *source_ns)
{
    unsigned char head[SOURCE_BYTES];
    if (record->size <= SOURCE_BYTES)
        return;
    copy_from_shared(head, record->payload, SOURCE_BYTES);
    if (core_source_time(head, source_ns)) {
        record->payload = (const unsigned char *)record->payload + SOURCE_BYTES;
        record->size -= SOURCE_BYTES;
    } else {
        *source_ns = 0;
    }
}

/* Takes the feed's next payload, for decode(): bytes, or a memoryview of the pinned record. NULL: the record was
 * overrun, or an error is set. *source_ns: see core_source_time(); 0 if there is none. */
static PyObject *fetch(Reader *self, struct feed *feed, int64_t *source_ns)
{
    struct ring_record record = feed->head;
    unsigned pin;
    *source_ns = 0;
    if (record.size > SHORT_BYTES) {
        const enum ring_status status = feed_pin(feed, self->bound, &record, &pin);
        if (status == RING_OVERRUN)
            return NULL;
        if (status == RING_OK) {
            pass_source_time(&record, source_ns);
            Readers *readers = self->readers;
            return view_new(core_state((PyObject *)readers), mapping_of(feed), readers->memory, feed->ring.slot, pin,
                            &record);
        }
    }
    pass_source_time(&record, source_ns);
    PyObject *bytes = PyBytes_FromStringAndSize(NULL, record.size);
    if (bytes == NULL || feed_copy(feed, self->bound, &record, PyBytes_AsString(bytes)) == RING_OK)
        return bytes;
    Py_DECREF(bytes);
    return NULL;
}

/* Handles an error of decode(): counts the sample; keeps its error, but passes on any other (KeyboardInterrupt). */
static int reject(Reader *self, uint64_t size)
{
    PyObject *type, *error, *traceback;
    self->undecodable++;
    if (!PyErr_ExceptionMatches(PyExc_Exception))
        return -1;
    PyErr_Fetch(&type, &error, &traceback);
    PyErr_NormalizeException(&type, &error, &traceback);
    PyException_SetTraceback(error, Py_None); /* its frames would keep the sample */
    int status = 0;
    if (PyList_Size(self->rejected) < MAX_REJECTED) {
        PyObject *item = Py_BuildValue("(KO)", (unsigned long long)size, error);
        status = item == NULL ? -1 : PyList_Append(self->rejected, item);
        Py_XDECREF(item);
    }
    Py_XDECREF(type);
    Py_XDECREF(error);
    Py_XDECREF(traceback);
    return status;
}

/* The part of a histogram that an age belongs to: two for each doubling. */
static unsigned age_part(uint64_t age_ns)
{
    const unsigned bits = age_ns == 0 ? 0 : 64 - (unsigned)__builtin_clzll(age_ns);
    if (bits <= AGE_FIRST_BITS)
        return 0;
    const unsigned part = 2 * (bits - AGE_FIRST_BITS) - 1 + (unsigned)(age_ns >> (bits - 2) & 1);
    return part < AGE_PARTS ? part : AGE_PARTS - 1;
}

/* Notes the age of a sample. Reading the clock costs a tenth of a take, so most of many samples go without it. */
void ages_note(struct ages *ages, uint64_t stamp_ns, uint64_t now_ns)
{
    if (ages->count >= AGES_AT_ONCE && ++ages->passed < AGES_EACH)
        return;
    ages->passed = 0;
    if (now_ns == 0)
        now_ns = core_now_ns();
    const uint64_t age_ns = now_ns > stamp_ns ? now_ns - stamp_ns : 0;
    if (age_ns > MAX_SEQ / 2 || ages->sum_ns > MAX_SEQ / 2)
        return; /* the stamp is false */
    ages->count++;
    ages->sum_ns += age_ns;
    ages->parts[age_part(age_ns)]++;
    if (age_ns > ages->most_ns)
        ages->most_ns = age_ns;
}

/* Finds the plan of messages that may begin with a text, once. False: an error is set. */
static bool find_texts(Reader *self)
{
    PyObject *find = self->find_texts;
    if (find == NULL)
        return true;
    self->find_texts = NULL; /* first, because the call may run any code */
    PyObject *plan = PyObject_CallNoArgs(find);
    Py_DECREF(find);
    if (plan != NULL && self->texts == NULL && Py_TYPE(plan) == core_state((PyObject *)self->readers)->plan
        && plan_begins_with_text((Plan *)plan))
        self->texts = (Plan *)Py_NewRef(plan);
    Py_XDECREF(plan);
    return plan != NULL;
}

/* Decodes a long payload, which may begin with a text. */
static PyObject *decode_long(Reader *self, PyObject *decode, PyObject *payload)
{
    PyObject *message = NULL;
    if (!find_texts(self))
        return NULL;
    Plan *texts = self->texts;
    if (texts != NULL) {
        HOLD(texts); /* `decode` may run any code */
        message = plan_decode_text(texts, decode, payload);
        DROP(texts);
    }
    return message != NULL || PyErr_Occurred() ? message : PyObject_CallFunctionObjArgs(decode, payload, NULL);
}

/* Takes the head of the feed, and decodes it. 1: *item is a new reference; 0: it is lost, and counted; -1: an error. */
static int take_one(Reader *self, struct feed *feed, PyObject *decode, uint64_t now_ns, bool has_origin, PyObject **item)
{
    const struct ring_record record = feed->head;
    const uint64_t stamp_ns = feed_stamp(feed, &record);
    *item = NULL;
    if (feed_is_expired(feed, stamp_ns, now_ns)) {
        feed_step(feed);
        self->expired++;
        return 0;
    }
    PyObject *source = source_of(feed)->object;
    Py_INCREF(source);
    int64_t source_ns;
    PyObject *payload = fetch(self, feed, &source_ns);
    int taken = payload == NULL && PyErr_Occurred() ? -1 : 0;
    if (payload != NULL) {
        *item = record.size >= LONG_TEXT ? decode_long(self, decode, payload)
                                         : PyObject_CallFunctionObjArgs(decode, payload, NULL);
        Py_DECREF(payload);
        if (*item == NULL) {
            taken = reject(self, record.size);
        } else {
            self->samples++;
            self->bytes += record.size;
            ages_note(&self->ages, stamp_ns, now_ns);
            if (has_origin)
                *item = core_with_origin(*item,
                                         source_ns != 0 ? PyLong_FromLongLong(-source_ns)
                                                        : PyLong_FromUnsignedLongLong(record.stamp_ns),
                                         record.seq, source, PyLong_FromUnsignedLongLong(now_ns));
            taken = *item == NULL ? -1 : 1;
        }
    }
    Py_DECREF(source);
    return taken;
}

void reader_show(Reader *self)
{
    for (size_t i = 0; i < self->count && reader_is_ours(self); i++) {
        readers_watch_anew(self->readers, self->feeds[i]);
        if (self->tells_cursor && feed_show_cursor(self->feeds[i]))
            source_ring(self->feeds[i]);
    }
}

static PyObject *take(Reader *self, PyObject *const *args, Py_ssize_t count, PyObject *kwnames, bool has_origin)
{
    static const char *const names[] = {"limit", "decode", NULL};
    PyObject *values[2];
    if (core_arguments(names, args, count, kwnames, 2, values) < 0)
        return NULL;
    if (values[0] == NULL || values[1] == NULL) {
        PyErr_SetString(PyExc_TypeError, "limit and decode are needed");
        return NULL;
    }
    Py_ssize_t left = PyLong_AsSsize_t(values[0]);
    if (left == -1 && PyErr_Occurred())
        return NULL;
    PyObject *list = PyList_New(0);
    if (list == NULL)
        return NULL;
    const uint64_t now_ns = core_now_ns(), end_bytes = self->bytes + BATCH_BYTES;
    int status = reader_poll(self);
    while (status >= 0 && left > 0 && self->bytes < end_bytes) {
        struct feed *feed = reader_oldest(self);
        if (feed == NULL) {
            status = PyErr_Occurred() ? -1 : 0;
            break;
        }
        PyObject *item;
        status = take_one(self, feed, values[1], now_ns, has_origin, &item);
        left -= status;
        if (status == 1 && PyList_Append(list, item) < 0)
            status = -1;
        Py_XDECREF(item);
    }
    reader_show(self);
    if (status >= 0)
        return list;
    PyObject *before = self->interrupted; /* the messages in the list are taken: the owner pops them */
    self->interrupted = list;
    Py_XDECREF(before);
    return NULL;
}

PyObject *reader_take(PyObject *self, PyObject *const *args, Py_ssize_t count, PyObject *kwnames)
{
    return take((Reader *)self, args, count, kwnames, true);
}

PyObject *reader_messages(PyObject *self, PyObject *const *args, Py_ssize_t count, PyObject *kwnames)
{
    return take((Reader *)self, args, count, kwnames, false);
}

/* Whether the reader may call back by itself now. */
bool reader_is_ready(const Reader *self)
{
    if (self->prepared.callback == NULL || self->is_busy)
        return false;
    for (Py_ssize_t i = 0; i < PyTuple_Size(self->prepared.queues); i++)
        if (PyObject_Size(PyTuple_GetItem(self->prepared.queues, i)) != 0)
            return false;
    return true;
}

/* Like take_one(), for the oldest sample of all feeds. */
static int take_oldest(Reader *self, PyObject *decode, bool has_origin, PyObject **item)
{
    *item = NULL;
    int status = reader_poll(self);
    struct feed *feed = status < 0 ? NULL : reader_oldest(self);
    if (feed != NULL) {
        const bool is_timed = has_origin || feed->lifespan_ns != 0;
        status = take_one(self, feed, decode, is_timed ? core_now_ns() : 0, has_origin, item);
    } else if (status == 0 && PyErr_Occurred()) {
        status = -1;
    }
    reader_show(self);
    return status;
}

/* Whether the counters have more losses than the owner has been told. */
static bool has_lost(Reader *self)
{
    uint64_t lost = self->overrun + self->replaced + self->expired + self->undecodable;
    for (size_t i = 0; i < self->count; i++)
        lost += self->feeds[i]->ring.overrun + self->feeds[i]->ring.replaced;
    const bool is_due = lost != self->lost_reported;
    self->lost_reported = lost;
    return is_due;
}

bool reader_has_more(const Reader *self)
{
    for (size_t i = 0; i < self->count; i++)
        if (feed_newest(self->feeds[i]) >= self->feeds[i]->ring.next && !reader_holds(self, self->feeds[i]))
            return true;
    return false;
}

/* Does the same as `except Exception as error: on_error(error)`. */
static int handle(PyObject *on_error)
{
    PyObject *type, *error, *traceback;
    if (!PyErr_ExceptionMatches(PyExc_Exception))
        return -1;
    PyErr_Fetch(&type, &error, &traceback);
    PyErr_NormalizeException(&type, &error, &traceback);
    if (traceback != NULL)
        PyException_SetTraceback(error, traceback);
    PyObject *before = PyErr_GetHandledException();
    PyErr_SetHandledException(error);
    PyObject *answer = PyObject_CallFunctionObjArgs(on_error, error, NULL);
    PyErr_SetHandledException(before);
    Py_XDECREF(before);
    Py_XDECREF(type);
    Py_XDECREF(error);
    Py_XDECREF(traceback);
    Py_XDECREF(answer);
    return answer == NULL ? -1 : 0;
}

/* Notes that the counters have changed, and calls on_report_due() at the first change since their report. */
static int note(Reader *self, PyObject *on_report_due, PyObject *on_error)
{
    if (self->is_report_due)
        return 0;
    PyObject *answer = PyObject_CallFunctionObjArgs(on_report_due, NULL);
    if (answer == NULL)
        return handle(on_error);
    Py_DECREF(answer);
    self->is_report_due = 1;
    return 0;
}

enum {
    NS = 1000000000,
    SLOW_NS = 200000000 /* a call that takes longer is reported; bus.diagnostics.slow_callback has the same number */
};

/* The time by the coarse clock, which is exact to a few milliseconds and costs a fifth of the other clock. */
static uint64_t coarse_now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC_COARSE, &now);
    return (uint64_t)now.tv_sec * NS + (uint64_t)now.tv_nsec;
}

/* Reports a slow callback. An error that the callback has raised stays set. */
static void tell_slow(PyObject *on_slow, uint64_t took_ns)
{
    PyObject *type, *error, *traceback;
    PyErr_Fetch(&type, &error, &traceback);
    PyObject *answer = PyObject_CallFunction(on_slow, "K", (unsigned long long)took_ns);
    if (answer == NULL)
        PyErr_WriteUnraisable(on_slow);
    Py_XDECREF(answer);
    PyErr_Restore(type, error, traceback);
}

/* Raises TypeError if a callback has returned a coroutine: nothing would run it. */
static int refuse_coroutine(PyObject *callback, PyObject *answer)
{
    if (answer == Py_None || PyType_GetSlot(Py_TYPE(answer), Py_am_await) == NULL)
        return 0;
    PyObject *module = PyImport_ImportModule("bus.base.callbacks");
    if (module == NULL)
        return -1;
    PyObject *done = PyObject_CallMethod(module, "refuse_coroutine", "OO", callback, answer);
    Py_DECREF(module);
    Py_XDECREF(done);
    return done == NULL ? -1 : 0;
}

/* Calls back for the oldest message; only if the reader is ready. 1: no more messages; 0: the owner must check; -1: an
 * error. */
int reader_deliver(Reader *self)
{
    PyObject *callback = Py_NewRef(self->prepared.callback), *decode = Py_NewRef(self->prepared.decode);
    PyObject *on_error = Py_NewRef(self->prepared.on_error);
    PyObject *on_report_due = Py_NewRef(self->prepared.on_report_due), *message;
    PyObject *on_slow = Py_NewRef(self->prepared.on_slow);
    self->is_busy = 1;
    int status = take_oldest(self, decode, self->prepared.gives_taken, &message);
    if (status == 1) {
        const bool is_due = has_lost(self);
        /* Before the callback, which may close the subscription; then its counters must be reported. */
        status = note(self, on_report_due, on_error);
        const uint64_t began_ns = coarse_now_ns();
        PyObject *answer = status < 0 ? NULL : PyObject_CallFunctionObjArgs(callback, message, NULL);
        const uint64_t took_ns = coarse_now_ns() - began_ns;
        if (took_ns >= SLOW_NS && on_slow != Py_None)
            tell_slow(on_slow, took_ns);
        if (answer != NULL && refuse_coroutine(callback, answer) < 0)
            Py_CLEAR(answer);
        if (status == 0 && answer == NULL)
            status = handle(on_error);
        if (status == 0)
            status = !is_due && !reader_has_more(self);
        Py_XDECREF(answer);
    }
    self->is_busy = 0;
    Py_XDECREF(message);
    Py_DECREF(callback);
    Py_DECREF(decode);
    Py_DECREF(on_error);
    Py_DECREF(on_report_due);
    Py_DECREF(on_slow);
    return status;
}

/* --- Reader.wait: a thread that has nothing else to do sleeps here until a message comes, and returns it.
 *
 * The event loop does not run meanwhile. Any event that the loop would have to handle ends the wait. The doorbell that
 * woke the thread is read before the next sleep, or by the loop. So while the bell is not armed, the doorbell stays
 * rung, and the loop finds it at its next poll.
 */

enum {
    MS_NS = 1000000,
    FINE_NS = 20 * MS_NS, /* shorter waits are exact; epoll_wait() only has milliseconds */
    REST_NS = 5 * MS_NS,  /* period of the loop's turns if waits find all their messages without a sleep */
    MOST_EVENTS = 8,
    TRIES = 4
};

/* Whether the process needs to wait only for this reader's messages. */
static bool may_wait(const Reader *self)
{
    const Readers *readers = self->readers;
    return readers->doorbell >= 0 && !readers->has_writers && self->is_report_due && self->count != 0 &&
           PyList_Size(self->rejected) == 0;
}

/* Sleeps until there are events, or until the given time; called without the GIL. */
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

/* Sleeps. True: the only event was the doorbell. False: the wait is over, perhaps with an error. *is_rung: the doorbell
 * was rung. */
static bool sleep_by(Readers *self, int epoll, uint64_t until_ns, bool *is_rung)
{
    struct epoll_event events[MOST_EVENTS];
    int got;
    Py_BEGIN_ALLOW_THREADS
    got = sleep_until(epoll, until_ns, events);
    Py_END_ALLOW_THREADS
    *is_rung = false;
    if (got < 0 && errno == EINTR)
        PyErr_CheckSignals(); /* a handler may have run the loop: the caller checks everything again */
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

/* Reads the eventfd and arms the bell. False: another reader has news, so the loop needs a turn. */
static bool fall_asleep(Reader *reader)
{
    Readers *self = reader->readers;
    if (self->is_rung) {
        if (readers_have_news_besides(self, reader))
            return false; /* the doorbell stays rung for it */
        self->is_rung = false;
        doorbell_clear(self->doorbell); /* a writer that rang before had published before: the check finds it */
    }
    bell_arm(&self->header->arrival, 0); /* PAIR(sleep): before the check. Counterpart: gates_ring(). */
    if (!readers_have_news_besides(self, reader))
        return true;
    doorbell_ring(self->doorbell, KNOCK_ANY); /* the eventfd just read may have been rung for this reader */
    return false;
}

/* Sets *until_ns to the earlier of both times. -1: an error is set. */
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
        if (take_oldest(self, args[0], args[1] == Py_True, &item) < 0)
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
            continue; /* the bell may ring for that message, which costs the loop an idle turn */
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
