/* A feed: one publisher, as a Reader follows it from ring to ring. Looks and counts; calls no Python. */
#include "py.h"

#include <string.h>
#include <sys/random.h>

enum { TRIES = 64 }; /* looks at a record that is overrun each time, before the feed is left for another turn */

/* A ticket that the ring does not show now. */
static uint32_t new_ticket(const struct ring_reader *ring)
{
    uint64_t ticket;
    if (getrandom(&ticket, sizeof ticket, GRND_NONBLOCK) != sizeof ticket)
        ticket = core_now_ns();
    while ((uint32_t)ticket == 0 || ring_is_admitted(ring, (uint32_t)ticket))
        ticket++;
    return (uint32_t)ticket;
}

/* The ring was checked and the slot is free. NULL: no memory. Begins with the next record to come. */
struct feed *feed_new(PyObject *source, Mapping *memory, const struct ring_geometry *geometry, struct reader_slot *slot,
                      int doorbell)
{
    struct feed *self = PyMem_Calloc(1, sizeof *self);
    if (self == NULL)
        return NULL;
    ring_reader_attach(&self->ring, memory->memory, geometry, slot);
    Py_INCREF(source);
    HOLD(memory);
    self->source = source;
    self->memory = memory;
    self->last = self->ring.header;
    self->end = MAX_SEQ + 1;
    self->forks = core_forks;
    self->doorbell = doorbell;
    self->ticket = new_ticket(&self->ring);
    ring_ask(slot, self->ticket);
    return self;
}

void feed_free(struct feed *self)
{
    struct reader_slot *slot = self->ring.slot;
    if (self->ticket != 0 && self->forks == core_forks)
        ring_unpin(slot, READER_PINS - 1);
    while (self->following != NULL) {
        struct next_ring *next = self->following;
        self->following = next->after;
        DROP(next->memory);
        PyMem_Free(next);
    }
    DROP(self->memory);
    Py_DECREF(self->source);
    PyMem_Free(self);
}

void feed_extend(struct feed *self, struct next_ring *next)
{
    struct next_ring **end = &self->following;
    while (*end != NULL)
        end = &(*end)->after;
    *end = next;
    self->last = (const struct ring_header *)next->memory->memory;
    self->ring.room_rung = 0; /* another bell */
}

static void go_on(struct feed *self)
{
    struct next_ring *next = self->following;
    struct ring_reader ring;
    feed_may_pin(self); /* the next ring does not show tickets of this one */
    ring_reader_attach(&ring, next->memory->memory, &next->geometry, self->ring.slot);
    ring_seek(&ring, self->ring.next);
    ring.overrun = self->ring.overrun;
    ring.replaced = self->ring.replaced;
    ring.room_rung = self->ring.room_rung;
    self->ring = ring;
    self->has_head = false;
    self->following = next->after;
    DROP(self->memory);
    self->memory = next->memory;
    PyMem_Free(next);
}

/* The newest number published, in the newest ring. */
uint64_t feed_newest(const struct feed *self)
{
    /* PAIR(latest): acquire, as in ring_poll() */
    const uint64_t latest = atomic_load_explicit(&self->last->latest, memory_order_acquire);
    return latest < self->end ? latest : self->end;
}

/* False where the numbers are beyond what can be: the publisher is broken. */
bool feed_is_sound(const struct feed *self) { return feed_newest(self) <= MAX_SEQ && self->ring.next <= MAX_SEQ + 1; }

/* When a record was written, by our clock. Of another time namespace, the writer's may be ahead or behind. */
uint64_t feed_stamp(const struct feed *self, const struct ring_record *record)
{
    return record->stamp_ns - self->clock_ns;
}

/* Begins `history` records before the first that is stamped at or after `since_ns`, or with the oldest. Returns how
 * many records before it are there to be read. */
uint64_t feed_start(struct feed *self, uint64_t since_ns, uint64_t history)
{
    struct ring_reader look = self->ring; /* a scratch reader: its counters are thrown away */
    struct ring_record record;
    ring_join(&look, UINT64_MAX);
    const uint64_t oldest = look.next;
    ring_poll(&look, 0);
    const uint64_t end = look.latest + 1 > oldest ? look.latest + 1 : oldest;
    uint64_t seq = end;
    while (seq > oldest && end - seq < look.index_length) {
        ring_seek(&look, seq - 1);
        if (ring_look(&look, &record) != RING_OK || feed_stamp(self, &record) < since_ns)
            break;
        seq--;
    }
    const uint64_t old = history < seq - oldest ? history : seq - oldest;
    ring_seek(&self->ring, seq - old);
    return old;
}

/* Passes over samples. */
void feed_skip(struct feed *self, uint64_t count)
{
    self->ring.replaced += count;
    self->ring.next += count;
    self->waiting -= count < self->waiting ? count : self->waiting;
    self->has_head = false;
}

/* Looks for new samples, and passes over those beyond `depth` (0: no depth). */
void feed_poll(struct feed *self, uint64_t depth)
{
    const uint64_t newest = feed_newest(self);
    /* relaxed: an older value is found out by ring_look() */
    const uint64_t oldest = atomic_load_explicit(&self->ring.header->oldest, memory_order_relaxed);
    if (oldest > self->ring.next && oldest <= newest + 1) {
        self->ring.overrun += oldest - self->ring.next; /* counted even if nothing is ever taken */
        self->ring.next = oldest;
        self->has_head = false;
    }
    self->waiting = newest < self->ring.next ? 0 : newest - self->ring.next + 1;
    if (depth != 0 && self->waiting > depth)
        feed_skip(self, self->waiting - depth);
    while (self->following != NULL && ring_is_finished(&self->ring))
        go_on(self);
    ring_poll(&self->ring, 0);
}

/* Makes sure of the head of the next record. RING_OK; RING_EMPTY: nothing for now; RING_CORRUPT: leave it. */
enum ring_status feed_look(struct feed *self, uint64_t depth)
{
    for (int i = 0; i < TRIES && self->waiting != 0; i++) {
        const enum ring_status status = self->has_head ? RING_OK : ring_look(&self->ring, &self->head);
        if (status == RING_OK || status == RING_CORRUPT) {
            self->has_head = status == RING_OK;
            return status;
        }
        if (status == RING_EMPTY && self->following != NULL && !ring_is_finished(&self->ring))
            return RING_CORRUPT; /* it goes on elsewhere and has not closed this one */
        feed_poll(self, depth);
        if (!feed_is_sound(self))
            return RING_CORRUPT;
    }
    if (self->waiting != 0)
        self->seen = self->ring.next - 1; /* to be news once more */
    self->waiting = 0;
    return RING_EMPTY;
}

/* Whether the publisher sees pins. */
bool feed_may_pin(struct feed *self)
{
    if (self->ticket != 0 && ring_is_admitted(&self->ring, self->ticket)) {
        self->ticket = 0;
        ring_unpin(self->ring.slot, READER_PINS - 1);
    }
    return self->ticket == 0;
}

/* Whether something waits that the owner does not know of. */
bool feed_has_news(struct feed *self)
{
    const uint64_t newest = feed_newest(self);
    if (self->ticket != 0)
        feed_may_pin(self);
    return newest > self->seen && newest >= self->ring.next;
}

/* The owner looks now. */
void feed_see(struct feed *self) { self->seen = feed_newest(self); }

/* Rings the publisher where it waits for room. */
void feed_room(struct feed *self)
{
    bell_fence(); /* PAIR(sleep): after the cursor. Counterpart: ring_wait_for_room(). */
    if (bell_is_due(&self->last->room, &self->ring.room_rung, self->ring.next))
        doorbell_ring(self->doorbell, KNOCK_ANY);
}

/* Shows the cursor, where it has moved. */
void feed_tell(struct feed *self)
{
    if (self->shown == self->ring.next)
        return;
    self->shown = self->ring.next;
    ring_tell_cursor(&self->ring);
    feed_room(self);
}
