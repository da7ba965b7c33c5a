/* A feed: one match from its reader's view. It follows one publisher from ring to ring. Begin with reader.h.
 *
 * When a ring grows, another ring continues it. A feed reads the first to its end and continues in the next with the
 * same sequence numbers. It counts lost samples on the way, and shows the publisher its position. A round of a process
 * is
 *
 *     feed_poll(depth), then for each record: feed_head(), and feed_copy(), feed_pin() or feed_step();
 *     then, if the match is lossless, feed_show_cursor(), and ring the publisher if it returns true.
 *
 * From `first` to the newest: all published samples = taken + ring.overrun + ring.replaced + feed_waiting().
 *
 * A feed begins with feed_attach(), then feed_begin(). This is so for a repeated match, too (after a restart of the
 * broker): feed_begin() then gets the number that is next, and no sample arrives twice. feed_finish() is called when
 * the broker reports that the publisher is gone. Samples published by then are still taken, but nothing of a later
 * owner of that memory. A publisher that is killed at any instruction leaves whole records up to `latest`, or an old
 * `latest`; a feed notices nothing else.
 *
 * Must not know: Python, system calls, how a subscription merges its feeds, sleeping. Nothing here waits. One thread at
 * a time may use a feed. The rings belong to the publisher, which may be hostile. RING_CORRUPT covers numbers above
 * MAX_SEQ, a record that contradicts its index, and a ring that continues elsewhere without being closed. Every loop
 * ends.
 *
 * Each atomic access names its order; ring.h lists the PAIRs.
 */
#ifndef BUS_SHM_FEED_H
#define BUS_SHM_FEED_H

#include "reader.h"

enum {
    FEED_TRIES = 64,         /* attempts at records that are overrun, before the feed waits for its next turn */
    FEED_MOST_FOLLOWING = 64 /* rings that may wait behind the current ring */
};

/* A ring of a feed, accepted by ring_check(). */
struct feed_ring {
    struct feed_ring *after;
    const void *memory;
    struct ring_geometry geometry;
    void (*leave)(struct feed_ring *); /* called when the feed has finished the ring: unmaps it, frees this struct */
};

struct feed {
    struct ring_reader ring;
    struct ring_record head;        /* if has_head: the record ring.next, its bytes not yet validated */
    bool has_head;
    uint32_t ticket;                /* not 0: not yet admitted, so the feed copies and does not pin */
    struct feed_ring *rings;        /* the current ring, then the following ones */
    const struct ring_header *last; /* of the newest ring, to which the publisher writes */
    uint64_t first;                 /* number of its first sample */
    uint64_t waiting;               /* samples found by the last poll and not yet taken */
    uint64_t seen;                  /* newest number that the owner has been told */
    uint64_t shown;                 /* the cursor in the slot */
    uint64_t missed;                /* samples replaced since the last sample was taken */
    uint64_t most_missed;           /* the most samples replaced between two taken ones; `missed` comes on top */
    uint64_t end;                   /* newest number that may be taken; MAX_SEQ + 1 while the publisher exists */
    uint64_t lifespan_ns;           /* older samples are not taken; 0: no limit. Set by the owner */
    uint64_t clock_ns;              /* lead of the publisher's clock over ours, modulo 2^64. Set by the owner */
};

/* --- beginning and end */

/* Attaches a feed to a ring and asks to be admitted. The slot and its pins are free. `random`: any number that the
 * publisher can't predict. Then feed_begin(). */
static inline void feed_attach(struct feed *feed, struct feed_ring *ring, struct reader_slot *slot, uint64_t random)
{
    *feed = (struct feed){.rings = ring, .last = ring->memory, .end = MAX_SEQ + 1};
    ring_reader_attach(&feed->ring, ring->memory, &ring->geometry, slot);
    while ((uint32_t)random == 0 || ring_is_admitted(&feed->ring, (uint32_t)random))
        random++; /* ends: the ring shows at most RING_ADMITTED numbers, unless it changes them meanwhile */
    feed->ticket = (uint32_t)random;
    ring_ask(slot, feed->ticket);
}

/* Leaves all rings. `is_owner` is false in the child of a fork: the slot belongs to the parent and stays as it is. */
static inline void feed_close(struct feed *feed, bool is_owner)
{
    if (feed->ticket != 0 && is_owner)
        ring_unpin(feed->ring.slot, READER_PINS - 1);
    while (feed->rings != NULL) {
        struct feed_ring *ring = feed->rings;
        feed->rings = ring->after;
        ring->leave(ring);
    }
}

/* The newest published number, in the newest ring. */
static inline uint64_t feed_newest(const struct feed *feed)
{
    /* PAIR(latest): acquire, as in ring_poll(). Counterpart: ring_publish(). */
    const uint64_t latest = atomic_load_explicit(&feed->last->latest, memory_order_acquire);
    return latest < feed->end ? latest : feed->end;
}

/* How many samples wait now, in all rings. */
static inline uint64_t feed_waiting(const struct feed *feed)
{
    const uint64_t newest = feed_newest(feed);
    return newest < feed->ring.next ? 0 : newest - feed->ring.next + 1;
}

/* False if the numbers are impossible: the publisher is broken. */
static inline bool feed_is_sound(const struct feed *feed)
{
    return feed_newest(feed) <= MAX_SEQ && feed->ring.next <= MAX_SEQ + 1;
}

/* The time of a record by our clock. In another time namespace, the publisher's clock may be ahead or behind. */
static inline uint64_t feed_stamp(const struct feed *feed, const struct ring_record *record)
{
    return record->stamp_ns - feed->clock_ns;
}

/* Finds the number to begin with: `history` records before the first one stamped at or after `since_ns`, or as many as
 * there are. *old: their count. */
static inline uint64_t feed_find(const struct feed *feed, uint64_t since_ns, uint64_t history, uint64_t *old)
{
    struct ring_reader look = feed->ring; /* a scratch reader: its counters are discarded */
    struct ring_record record;
    ring_join(&look, UINT64_MAX);
    const uint64_t oldest = look.next;
    ring_poll(&look, 0);
    const uint64_t end = look.latest + 1 > oldest ? look.latest + 1 : oldest;
    uint64_t seq = end;
    while (seq > oldest && end - seq < look.index_length) {
        ring_seek(&look, seq - 1);
        if (ring_look(&look, &record) != RING_OK || feed_stamp(feed, &record) < since_ns)
            break;
        seq--;
    }
    *old = history < seq - oldest ? history : seq - oldest;
    return seq - *old;
}

/* Begins with `seq`: the result of feed_find(), or ring.next of the feed of an earlier match. False: the publisher's
 * numbers are out of bounds, and the slot does not show a cursor. */
static inline bool feed_begin(struct feed *feed, uint64_t seq)
{
    ring_seek(&feed->ring, seq);
    if (seq == 0 || !feed_is_sound(feed))
        return false;
    feed->first = feed->shown = seq;
    feed->seen = seq - 1;
    ring_tell_cursor(&feed->ring);
    return true;
}

/* Appends `ring`, in which the publisher continues after it has closed the ring before. False: too many rings wait. */
static inline bool feed_extend(struct feed *feed, struct feed_ring *ring)
{
    struct feed_ring *before = feed->rings;
    unsigned following = 0;
    for (; before->after != NULL; before = before->after)
        following++;
    if (following == FEED_MOST_FOLLOWING)
        return false;
    ring->after = NULL;
    before->after = ring;
    feed->last = ring->memory;
    feed->ring.room_rung = 0; /* another bell */
    return true;
}

/* Notes that the publisher is gone: only samples published until now are taken. True: none of them waits. */
static inline bool feed_finish(struct feed *feed)
{
    feed->end = feed_newest(feed);
    return feed->end < feed->ring.next;
}

/* --- new samples */

/* Whether the feed may pin: it was admitted, so the publisher sees its pins. */
static inline bool feed_may_pin(struct feed *feed)
{
    if (feed->ticket != 0 && ring_is_admitted(&feed->ring, feed->ticket)) {
        feed->ticket = 0;
        ring_unpin(feed->ring.slot, READER_PINS - 1);
    }
    return feed->ticket == 0;
}

static inline void feed_go_on(struct feed *feed)
{
    struct feed_ring *before = feed->rings, *next = before->after;
    struct ring_reader ring;
    feed_may_pin(feed); /* last check: the next ring does not show tickets of this one */
    ring_reader_attach(&ring, next->memory, &next->geometry, feed->ring.slot);
    ring_seek(&ring, feed->ring.next);
    ring.overrun = feed->ring.overrun;
    ring.replaced = feed->ring.replaced;
    ring.room_rung = feed->ring.room_rung;
    feed->ring = ring;
    feed->has_head = false;
    feed->rings = next;
    before->leave(before);
}

/* Passes over `count` samples, which count as replaced. */
static inline void feed_skip(struct feed *feed, uint64_t count)
{
    feed->ring.replaced += count;
    feed->missed += count;
    feed->ring.next += count;
    feed->waiting -= count < feed->waiting ? count : feed->waiting;
    feed->has_head = false;
}

/* Checks for new samples, and passes over the oldest ones above `depth` (0: no depth). */
static inline void feed_poll(struct feed *feed, uint64_t depth)
{
    const uint64_t newest = feed_newest(feed);
    /* relaxed: the partner of PAIR(oldest) is ring_is_intact(), which detects an older value at the next record */
    const uint64_t oldest = atomic_load_explicit(&feed->ring.header->oldest, memory_order_relaxed);
    if (oldest > feed->ring.next && oldest <= newest + 1) {
        feed->ring.overrun += oldest - feed->ring.next; /* counted here in case nothing is ever taken */
        if (depth != 0)
            feed->missed += oldest - feed->ring.next;
        feed->ring.next = oldest;
        feed->has_head = false;
    }
    feed->waiting = newest < feed->ring.next ? 0 : newest - feed->ring.next + 1;
    if (depth != 0 && feed->waiting > depth)
        feed_skip(feed, feed->waiting - depth);
    while (feed->rings->after != NULL && ring_is_finished(&feed->ring))
        feed_go_on(feed);
    ring_poll(&feed->ring, 0);
}

/* Reads the head of the next record, unless it has it. RING_OK; RING_EMPTY: nothing for now; RING_CORRUPT: leave the
 * feed. */
static inline enum ring_status feed_head(struct feed *feed, uint64_t depth)
{
    for (int i = 0; i < FEED_TRIES && feed->waiting != 0; i++) {
        const enum ring_status status = feed->has_head ? RING_OK : ring_look(&feed->ring, &feed->head);
        if (status == RING_OK || status == RING_CORRUPT) {
            feed->has_head = status == RING_OK;
            return status;
        }
        if (status == RING_EMPTY && feed->rings->after != NULL && !ring_is_finished(&feed->ring))
            return RING_CORRUPT; /* the publisher continues elsewhere and has not closed this ring */
        feed_poll(feed, depth);
        if (!feed_is_sound(feed))
            return RING_CORRUPT;
    }
    if (feed->waiting != 0)
        feed->seen = feed->ring.next - 1; /* so that the samples are news once more */
    feed->waiting = 0;
    return RING_EMPTY;
}

/* Whether a record is older than the lifespan. */
static inline bool feed_is_expired(const struct feed *feed, uint64_t stamp_ns, uint64_t now_ns)
{
    return feed->lifespan_ns != 0 && now_ns > stamp_ns && now_ns - stamp_ns > feed->lifespan_ns;
}

/* --- taking the head. If it is overrun meanwhile, it is lost and counted, and feed_head() finds the next record. */

/* The most samples replaced between two taken ones. */
static inline uint64_t feed_most_missed(const struct feed *feed)
{
    return feed->missed > feed->most_missed ? feed->missed : feed->most_missed;
}

/* Steps past the head, which was taken or left out. */
static inline void feed_step(struct feed *feed)
{
    if (feed->missed != 0) {
        feed->most_missed = feed_most_missed(feed);
        feed->missed = 0;
    }
    ring_step(&feed->ring);
    feed->waiting--;
    feed->has_head = false;
}

/* Takes the head by a copy of its payload; `record` may leave out the payload's beginning. RING_OK or RING_OVERRUN. */
static inline enum ring_status feed_copy(struct feed *feed, uint64_t depth, const struct ring_record *record, void *bytes)
{
    const enum ring_status status = ring_copy_out(&feed->ring, record, bytes);
    feed->has_head = false;
    if (status == RING_OK)
        feed_step(feed);
    else
        feed_poll(feed, depth);
    return status;
}

/* Takes the head and holds it in place until ring_unpin(*pin), even if the feed is closed before that. RING_OK,
 * RING_OVERRUN, or RING_PINNED: copy it instead. */
static inline enum ring_status feed_pin(struct feed *feed, uint64_t depth, const struct ring_record *record, unsigned *pin)
{
    const enum ring_status status = feed_may_pin(feed) ? ring_pin(&feed->ring, record, pin) : RING_PINNED;
    if (status == RING_OK) {
        feed_step(feed);
    } else if (status == RING_OVERRUN) {
        feed->has_head = false;
        feed_poll(feed, depth);
    }
    return status;
}

/* --- news for the owner */

/* Whether a sample waits that the owner has not been told. */
static inline bool feed_has_news(struct feed *feed)
{
    const uint64_t newest = feed_newest(feed);
    if (feed->ticket != 0)
        feed_may_pin(feed);
    return newest > feed->seen && newest >= feed->ring.next;
}

/* Notes that the owner has been told all samples published until now. */
static inline void feed_mark_seen(struct feed *feed) { feed->seen = feed_newest(feed); }

/* Everything that a check of one feed needs if it has no new samples. These structs are in one array and not in the
 * feeds, because a process with a thousand feeds checks all of them for each message. */
struct feed_watch {
    const _Atomic uint64_t *latest; /* of the newest ring */
    uint64_t known;                 /* no new samples while `latest` has this value; FEED_UNKNOWN: check the feed */
    struct feed *feed;
};

/* No sequence number. */
#define FEED_UNKNOWN UINT64_MAX

/* Discards the known state of a feed that was used, or that continues in another ring. */
static inline void feed_watch_anew(struct feed_watch *watch)
{
    watch->latest = &watch->feed->last->latest;
    watch->known = FEED_UNKNOWN;
}

/* Like feed_has_news(), and cheap if there are no new samples. */
static inline bool feed_watch_has_news(struct feed_watch *watch)
{
    /* PAIR(latest): acquire, as in ring_poll(). PAIR(sleep): bell_arm() orders it after the announced sleep. */
    const uint64_t latest = atomic_load_explicit(watch->latest, memory_order_acquire);
    if (latest == watch->known && latest != FEED_UNKNOWN)
        return false;
    if (feed_has_news(watch->feed))
        return true;
    watch->known = watch->feed->ticket == 0 ? latest : FEED_UNKNOWN; /* a ticket is shown only for a while */
    return false;
}

/* --- credit of a lossless match */

/* True if the publisher must be rung, because there is now the room that it waits for. */
static inline bool feed_room_is_due(struct feed *feed)
{
    bell_fence(); /* PAIR(sleep): after the cursor. Counterpart: ring_wait_for_room(). */
    return bell_is_due(&feed->last->room, &feed->ring.room_rung, feed->ring.next);
}

/* Shows the publisher this feed's position, if it has changed. True: the publisher must be rung. */
static inline bool feed_show_cursor(struct feed *feed)
{
    if (feed->shown == feed->ring.next)
        return false;
    feed->shown = feed->ring.next;
    ring_tell_cursor(&feed->ring);
    return feed_room_is_due(feed);
}

#endif
