/* Python's part of feeds: their objects and mappings, their place in a Reader and in the watches of Readers.
 *
 * feed.h reads the rings. The release of an object may run any Python code, so objects are released last.
 */
#include "py.h"

#include <sys/random.h>

static void leave_mapping(struct feed_ring *ring)
{
    struct mapped_ring *self = (struct mapped_ring *)ring;
    DROP(self->memory);
    PyMem_Free(self);
}

static struct feed_ring *ring_new(Mapping *memory, const struct ring_geometry *geometry)
{
    struct mapped_ring *self = PyMem_Malloc(sizeof *self);
    if (self == NULL)
        return NULL;
    HOLD(memory);
    *self = (struct mapped_ring){{NULL, memory->memory, *geometry, leave_mapping}, memory};
    return &self->ring;
}

/* Makes a feed for a ring that was checked, and for a free slot. The caller begins and watches it. NULL: no memory. */
struct feed *source_new(PyObject *object, Mapping *memory, const struct ring_geometry *geometry, struct reader_slot *slot,
                        int doorbell)
{
    struct feed_source *self = PyMem_Calloc(1, sizeof *self);
    struct feed_ring *ring = self == NULL ? NULL : ring_new(memory, geometry);
    if (ring == NULL) {
        PyMem_Free(self);
        return NULL;
    }
    uint64_t random;
    if (getrandom(&random, sizeof random, GRND_NONBLOCK) != sizeof random)
        random = core_now_ns();
    feed_attach(&self->feed, ring, slot, random);
    self->object = Py_NewRef(object);
    self->doorbell = doorbell;
    self->forks = core_forks;
    return &self->feed;
}

void source_free(struct feed *feed)
{
    struct feed_source *self = source_of(feed);
    feed_close(feed, self->forks == core_forks);
    Py_DECREF(self->object);
    PyMem_Free(self);
}

/* Appends another ring, which was checked, and in which the publisher continues. NULL, or the reason of a failure; if
 * memory is lacking, an error is set, too. */
const char *source_extend(struct feed *feed, Mapping *memory, const struct ring_geometry *geometry)
{
    struct feed_ring *ring = ring_new(memory, geometry);
    if (ring == NULL) {
        PyErr_NoMemory();
        return "no memory";
    }
    if (feed_extend(feed, ring))
        return NULL;
    ring->leave(ring);
    return "too many rings wait behind this one";
}

/* --- watches of Readers */

/* Watches a feed of `reader` from now on. False: no memory. */
bool readers_watch(Readers *self, Reader *reader, struct feed *feed)
{
    if (self->count == self->room) {
        const size_t room = self->room == 0 ? 16 : 2 * self->room;
        struct watch *watches = PyMem_Realloc(self->watches, room * sizeof *watches);
        if (watches == NULL)
            return false;
        self->watches = watches;
        self->room = room;
    }
    const size_t at = source_of(feed)->watch = self->count++;
    self->watches[at] = (struct watch){.feed = {.feed = feed}, .reader = reader};
    self->feeds[feed->ring.slot - self->slots] = feed;
    readers_watch_anew(self, feed);
    return true;
}

/* Discards the known state of a feed that was used, or that continues in another ring. */
void readers_watch_anew(Readers *self, const struct feed *feed)
{
    struct watch *watch = &self->watches[source_of(feed)->watch];
    feed_watch_anew(&watch->feed);
    self->is_anew = self->is_anew || watch->reader != self->turn;
}

static void forget(Readers *self, const struct feed *feed)
{
    const size_t at = source_of(feed)->watch;
    struct feed **place = &self->feeds[feed->ring.slot - self->slots];
    if (*place == feed)
        *place = NULL;
    self->watches[at] = self->watches[--self->count];
    source_of(self->watches[at].feed.feed)->watch = at;
}

bool readers_have_news_besides(Readers *self, const Reader *reader)
{
    for (size_t i = 0; i < self->count; i++)
        if (self->watches[i].reader != reader && feed_watch_has_news(&self->watches[i].feed))
            return true;
    return false;
}

/* --- leaving */

/* Takes the feed out of the list and adds up its losses; frees nothing. */
static void take_out(Reader *self, const struct feed *feed)
{
    size_t at = 0;
    while (self->feeds[at] != feed)
        at++;
    self->feeds[at] = self->feeds[--self->count];
    forget(self->readers, feed);
    self->replaced += feed->ring.replaced;
    self->overrun += feed->ring.overrun;
    self->passed += feed->ring.next - feed->first;
    if (feed_most_missed(feed) > self->most_missed)
        self->most_missed = feed_most_missed(feed);
}

/* Removes a feed at the owner's request. */
void reader_remove(Reader *self, struct feed *feed)
{
    take_out(self, feed);
    source_free(feed);
}

/* Ends a feed on the core's decision, and keeps the reason for the owner. -1: an error is set. */
int reader_leave(Reader *self, struct feed *feed, const char *reason)
{
    take_out(self, feed);
    PyObject *item = Py_BuildValue("(OsK)", source_of(feed)->object, reason, (unsigned long long)feed->ring.next);
    source_free(feed);
    const int status = item == NULL ? -1 : PyList_Append(self->left, item);
    Py_XDECREF(item);
    return status;
}
