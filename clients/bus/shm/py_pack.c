/* Many samples in one buffer, as bridges pass them on. Three calls: take them out of rings, scan them, publish them.
 *
 * A record of the buffer is: number u64, source time i64 (ns of the wall clock; 0: none), size u32, payload. The
 * records lie back to back, little-endian. bus_bridge.packed reads them, too.
 */
#include "py.h"

#include <string.h>

#define PACKED_HEAD ((size_t)20) /* 64 bits, so its sum with a size does not wrap */

struct packed_head {
    uint64_t number;
    int64_t time_ns;
    uint32_t size;
};

static inline struct packed_head read_head(const unsigned char *at)
{
    struct packed_head head;
    memcpy(&head.number, at, 8);
    memcpy(&head.time_ns, at + 8, 8);
    memcpy(&head.size, at + 16, 4);
    return head;
}

static inline void write_head(unsigned char *at, struct packed_head head)
{
    memcpy(at, &head.number, 8);
    memcpy(at + 8, &head.time_ns, 8);
    memcpy(at + 16, &head.size, 4);
}

/* Samples packed so far; `source` is an owned reference to the source of the first one. */
struct pack {
    PyObject *source;
    unsigned char *bytes;
    size_t size, last_at;
    uint64_t count, payload_bytes, first, last;
    bool has_several_sources;
};

/* The bounds of a pack, and what turns a stamp into a time of the wall clock. */
struct pack_bounds {
    size_t most, longest;
    int64_t offset_ns;
    uint64_t now_ns;
};

/* Packs the head of a feed, or leaves it out because it has expired or was overrun. False: it does not fit. */
static bool pack_head(Reader *self, struct feed *feed, struct pack *pack, const struct pack_bounds *bounds)
{
    struct ring_record record = feed->head;
    const uint32_t whole = record.size; /* with its source's time */
    const uint64_t stamp_ns = feed_stamp(feed, &record);
    int64_t source_ns = 0;
    if (feed_is_expired(feed, stamp_ns, bounds->now_ns)) {
        feed_step(feed);
        self->expired++;
        return true;
    }
    if (whole >= bounds->longest || pack->size + PACKED_HEAD + whole > bounds->most)
        return false;
    unsigned char *at = pack->bytes + pack->size;
    PyObject *source = source_of(feed)->object;
    pass_source_time(&record, &source_ns);
    if (feed_copy(feed, self->bound, &record, at + PACKED_HEAD) != RING_OK)
        return true;
    const int64_t time_ns = source_ns != 0 ? source_ns : (int64_t)(stamp_ns + (uint64_t)bounds->offset_ns);
    write_head(at, (struct packed_head){record.seq, time_ns, record.size});
    if (pack->count++ == 0) {
        pack->source = Py_NewRef(source);
        pack->first = record.seq;
    }
    pack->has_several_sources = pack->has_several_sources || source != pack->source;
    pack->last = record.seq;
    pack->last_at = pack->size;
    pack->size += PACKED_HEAD + record.size;
    pack->payload_bytes += record.size;
    self->samples++;
    self->bytes += whole;
    ages_note(&self->ages, stamp_ns, bounds->now_ns);
    return true;
}

/* Packs the waiting samples of one feed, until a sample is too long or the pack is full. -1: an error is set. */
static int pack_feed(Reader *self, struct feed *feed, struct pack *pack, const struct pack_bounds *bounds)
{
    enum ring_status status;
    while ((status = feed_head(feed, self->bound)) == RING_OK)
        if (!pack_head(self, feed, pack, bounds))
            break;
    return status == RING_CORRUPT ? reader_leave(self, feed, RING_IS_BROKEN) : 0;
}

/* As pack_feed(), for the samples of all feeds, in the order of their stamps. */
static int pack_all(Reader *self, struct pack *pack, const struct pack_bounds *bounds)
{
    struct feed *feed;
    while ((feed = reader_oldest(self)) != NULL)
        if (!pack_head(self, feed, pack, bounds))
            break;
    return PyErr_Occurred() ? -1 : 0;
}

/* The most bytes of the feed that go into one pack. There are fewer if samples have expired, or if a payload begins
 * with a source time, which moves into the head. */
static size_t packed_bytes(const struct feed *feed, size_t most, size_t longest)
{
    struct ring_reader look = feed->ring; /* a scratch reader: its counters are discarded */
    struct ring_record record;
    size_t size = 0;
    for (uint64_t left = feed->waiting; left != 0 && ring_look(&look, &record) == RING_OK; left--) {
        if (record.size >= longest || size + PACKED_HEAD + record.size > most)
            break;
        size += PACKED_HEAD + record.size;
        ring_step(&look);
    }
    return size;
}

/* What a call returns about a pack; `room` is the size of `data`, whose first bytes are the pack. */
static PyObject *describe_pack(Reader *self, const struct pack *pack, PyObject *data, size_t room)
{
    if (pack->count == 0)
        return Py_NewRef(Py_None);
    PyObject *whole = pack->size == room ? Py_NewRef(data)
                                         : PyBytes_FromStringAndSize((char *)pack->bytes, (Py_ssize_t)pack->size);
    const bool is_consecutive = !pack->has_several_sources && pack->last - pack->first == pack->count - 1;
    return Py_BuildValue("(ONKKKOO)", pack->has_several_sources ? Py_None : pack->source, whole,
                         (unsigned long long)pack->count, (unsigned long long)pack->payload_bytes,
                         (unsigned long long)pack->last_at, is_consecutive ? Py_True : Py_False,
                         reader_has_more(self) ? Py_True : Py_False);
}

/* Takes a pack: of the feed with the oldest sample, or of all feeds. */
static PyObject *take_pack(Reader *self, PyObject *const *args, Py_ssize_t count, bool is_of_all)
{
    if (count != 3) {
        PyErr_SetString(PyExc_TypeError, "most_bytes, longest and offset_ns are needed");
        return NULL;
    }
    struct pack_bounds bounds = {.most = PyLong_AsSize_t(args[0]), .longest = PyLong_AsSize_t(args[1])};
    bounds.offset_ns = PyLong_AsLongLong(args[2]);
    if (PyErr_Occurred())
        return NULL;
    int status = reader_poll(self);
    struct feed *feed = status < 0 ? NULL : reader_oldest(self);
    if (feed == NULL) {
        if (!PyErr_Occurred())
            reader_show(self);
        return PyErr_Occurred() ? NULL : Py_NewRef(Py_None);
    }
    is_of_all = is_of_all && self->count > 1;
    size_t room = 0;
    for (size_t i = 0; i < (is_of_all ? self->count : 1) && room < bounds.most; i++)
        room += packed_bytes(is_of_all ? self->feeds[i] : feed, bounds.most, bounds.longest);
    bounds.most = room < bounds.most ? room : bounds.most;
    PyObject *data = PyBytes_FromStringAndSize(NULL, (Py_ssize_t)bounds.most);
    if (data == NULL)
        return NULL;
    struct pack pack = {.bytes = (unsigned char *)PyBytes_AsString(data)};
    bounds.now_ns = core_now_ns();
    status = is_of_all ? pack_all(self, &pack, &bounds) : pack_feed(self, feed, &pack, &bounds);
    reader_show(self);
    PyObject *found = status < 0 ? NULL : describe_pack(self, &pack, data, bounds.most);
    Py_DECREF(data);
    Py_XDECREF(pack.source);
    return found;
}

PyObject *reader_take_packed(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    return take_pack((Reader *)self, args, count, false);
}

PyObject *reader_take_merged(PyObject *self, PyObject *const *args, Py_ssize_t count)
{
    return take_pack((Reader *)self, args, count, true);
}

/* Reads a call's first arguments, the buffer and the offset. False: an error is set, and no buffer is held. */
static bool get_packed(PyObject *const *args, Py_ssize_t count, Py_ssize_t wanted, Py_buffer *buffer, size_t *start)
{
    if (count != wanted) {
        PyErr_Format(PyExc_TypeError, "%zd arguments are needed", wanted);
        return false;
    }
    *start = PyLong_AsSize_t(args[1]);
    if (PyErr_Occurred() || PyObject_GetBuffer(args[0], buffer, PyBUF_SIMPLE) < 0)
        return false;
    if (*start <= (size_t)buffer->len)
        return true;
    PyBuffer_Release(buffer);
    PyErr_SetString(PyExc_ValueError, "start is behind the end");
    return false;
}

PyObject *core_scan_packed(PyObject *Py_UNUSED(module), PyObject *const *args, Py_ssize_t count)
{
    Py_buffer buffer;
    size_t at, last_at = 0;
    if (!get_packed(args, count, 3, &buffer, &at))
        return NULL;
    const uint64_t most = PyLong_AsUnsignedLongLong(args[2]);
    const size_t end = (size_t)buffer.len;
    uint64_t found = 0, payload_bytes = 0, highest = 0, next = 0;
    bool is_consecutive = true;
    while (found < most && end - at >= PACKED_HEAD) {
        const struct packed_head head = read_head((const unsigned char *)buffer.buf + at);
        if (head.size > end - at - PACKED_HEAD)
            break;
        is_consecutive = is_consecutive && (found == 0 || head.number == next);
        next = head.number + 1;
        highest = head.number > highest ? head.number : highest;
        last_at = at;
        at += PACKED_HEAD + head.size;
        payload_bytes += head.size;
        found++;
    }
    PyBuffer_Release(&buffer);
    if (PyErr_Occurred())
        return NULL;
    return Py_BuildValue("(KKKKKO)", (unsigned long long)found, (unsigned long long)at,
                         (unsigned long long)payload_bytes, (unsigned long long)highest, (unsigned long long)last_at,
                         is_consecutive ? Py_True : Py_False);
}

/* Writes one packed sample. False: it must go the slow way. */
static bool write_one(Writer *self, struct packed_head head, const unsigned char *payload, uint64_t now_ns)
{
    unsigned char time[SOURCE_BYTES];
    const uint64_t before = head.time_ns > 0 ? SOURCE_BYTES : 0, size = before + head.size;
    unsigned char *place;
    if (size > self->most || size > self->ring.max_payload)
        return false;
    const enum ring_status status = ring_reserve(&self->ring, size, false, (void **)&place);
    if (status != RING_OK) {
        writer_is_refused(self, status);
        return false;
    }
    if (before != 0) {
        core_write_source_time(time, head.time_ns);
        copy_to_shared(place, time, SOURCE_BYTES);
    }
    copy_to_shared(place + before, payload, head.size);
    ring_publish(&self->ring, (uint32_t)size, writer_next_stamp(self, now_ns), 0);
    self->samples++;
    self->bytes += size;
    return true;
}

/* Publishes records from the front. Returns how many, and whether a report is due; the caller publishes the remaining
 * ones one by one. Wakes readers once for all records. */
PyObject *writer_publish_packed(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    Writer *self = (Writer *)object;
    Py_buffer buffer;
    size_t at;
    PyObject *outcome;
    if (!writer_is_open(self, &outcome)) {
        Py_XDECREF(outcome);
        return outcome == NULL ? NULL : Py_BuildValue("(iO)", 0, Py_False);
    }
    if (!get_packed(args, count, 2, &buffer, &at))
        return NULL;
    const uint64_t now_ns = core_now_ns();
    const size_t end = (size_t)buffer.len;
    uint64_t done = 0;
    while (!self->is_lent && end - at >= PACKED_HEAD) {
        const unsigned char *record = (const unsigned char *)buffer.buf + at;
        const struct packed_head head = read_head(record);
        if (head.size > end - at - PACKED_HEAD || !write_one(self, head, record + PACKED_HEAD, now_ns))
            break;
        at += PACKED_HEAD + head.size;
        done++;
    }
    PyBuffer_Release(&buffer);
    const bool is_report_due = done != 0 && !self->is_report_due;
    if (done != 0) {
        self->is_report_due = 1;
        writer_ring_bells(self, false);
    }
    return Py_BuildValue("(KO)", (unsigned long long)done, is_report_due ? Py_True : Py_False);
}
