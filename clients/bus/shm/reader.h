/* A reader's side of the ring: takes records, counts lost ones, pins records in place. Begin with ring.h.
 *
 * It maps the ring read-only and trusts nothing in it: sizes come from the geometry that ring_check() copied, and every
 * offset is brought within them. A round of a process is
 *
 *     ring_poll(depth), then for each record: ring_look(), ring_copy_out() or ring_pin(), ring_step();
 *     then ring_tell_cursor() once, and if the match is lossless, ring_room_is_due().
 *
 * Records published since its start = taken by ring_step() + overrun + replaced + waiting.
 */
#ifndef BUS_SHM_READER_H
#define BUS_SHM_READER_H

#include "copy.h"
#include "doorbell.h"
#include "ring.h"

struct ring_reader {
    const struct ring_header *header;
    const _Atomic uint64_t *index;
    const unsigned char *data;
    uint64_t capacity, index_length;
    struct reader_slot *slot; /* its own, shown to the writer; NULL: neither lossless nor pins */
    uint64_t next;            /* sequence number of the record to take next */
    uint64_t latest;          /* at the last poll */
    uint64_t overrun;         /* samples lost because the writer lapped this reader */
    uint64_t replaced;        /* samples passed over because more than `depth` were waiting */
    uint64_t room_rung;       /* generation of the writer's sleep for which it has rung */
};

struct ring_record {
    uint64_t seq, stamp_ns;
    uint32_t size, flags;
    const void *payload; /* in the ring: its bytes may change unless pinned */
};

/* Begins to read a ring with a geometry that ring_check() copied and accepted. Then ring_join() or ring_seek(). */
static inline void ring_reader_attach(
    struct ring_reader *r, const void *memory, const struct ring_geometry *geometry, struct reader_slot *slot)
{
    *r = (struct ring_reader){
        .header = memory,
        .index = (const _Atomic uint64_t *)((const char *)memory + geometry->index_offset),
        .data = (const unsigned char *)memory + geometry->data_offset,
        .capacity = geometry->capacity,
        .index_length = geometry->index_length,
        .slot = slot,
    };
}

/* Continues with `seq`: the start of a match as reported by the broker, or the reader's own next in a grown ring. */
static inline void ring_seek(struct ring_reader *r, uint64_t seq) { r->next = seq; }

/* Starts with the newest `history` records, or as many as there are; 0: with the next one to come. */
static inline void ring_join(struct ring_reader *r, uint64_t history)
{
    /* PAIR(latest): acquire, as in ring_poll() */
    const uint64_t end = atomic_load_explicit(&r->header->latest, memory_order_acquire) + 1;
    /* relaxed: with an old value, ring_look() finds the start lapped */
    const uint64_t oldest = atomic_load_explicit(&r->header->oldest, memory_order_relaxed);
    const uint64_t there = oldest < end ? end - oldest : 0;
    r->next = end - (history < there ? history : there);
}

/* Checks for new samples and passes over the oldest ones above `depth` (0: no depth). Returns how many wait. */
static inline uint64_t ring_poll(struct ring_reader *r, uint64_t depth)
{
    /* PAIR(latest): acquire. Records and index entries up to it are whole. Counterpart: ring_publish(). */
    r->latest = atomic_load_explicit(&r->header->latest, memory_order_acquire);
    if (r->latest < r->next)
        return 0;
    const uint64_t waiting = r->latest - r->next + 1;
    if (depth == 0 || waiting <= depth)
        return waiting;
    r->replaced += waiting - depth;
    r->next += waiting - depth;
    return depth;
}

/* True if everything is taken and the writer has left this ring. */
static inline bool ring_is_finished(const struct ring_reader *r)
{
    /* PAIR(closed): acquire, so the latest read after it is final. Counterpart: ring_close(). */
    if (atomic_load_explicit(&r->header->closed, memory_order_acquire) == 0)
        return false;
    /* relaxed: PAIR(closed) orders it, and no record is read through it */
    return atomic_load_explicit(&r->header->latest, memory_order_relaxed) < r->next;
}

/* After reading bytes of record r->next: true if all of them belonged to the record. Else counts the lost records and
 * moves to the oldest one. */
static inline bool ring_is_intact(struct ring_reader *r)
{
    /* PAIR(oldest): acquire fence, then load. If a byte read above was written after the record was dropped, this load
     * sees the drop. Counterpart: ring_give_up(). */
    atomic_thread_fence(memory_order_acquire);
    const uint64_t oldest = atomic_load_explicit(&r->header->oldest, memory_order_relaxed);
    if (oldest <= r->next)
        return true;
    r->overrun += oldest - r->next;
    r->next = oldest;
    return false;
}

/* The head of the next record, its payload still in the ring. RING_OK, RING_EMPTY (poll again), RING_OVERRUN
 * (poll again) or RING_CORRUPT (leave this ring). */
static inline enum ring_status ring_look(struct ring_reader *r, struct ring_record *record)
{
    if (r->next > r->latest)
        return RING_EMPTY;
    /* relaxed: PAIR(latest) ordered it; if the entry has a new owner since, PAIR(oldest) shows that */
    const uint64_t at = atomic_load_explicit(&r->index[r->next & (r->index_length - 1)], memory_order_relaxed);
    const uint64_t begin = at & (r->capacity - 1) & ~(uint64_t)(RING_ALIGN - 1);
    const unsigned char *head = r->data + begin;
    const uint64_t seq = load_word(head), stamp_ns = load_word(head + 8), size_and_flags = load_word(head + 16);
    if (!ring_is_intact(r))
        return RING_OVERRUN;
    const uint32_t size = (uint32_t)size_and_flags;
    if (seq != r->next || size > r->capacity - begin - RING_HEAD_BYTES)
        return RING_CORRUPT;
    *record = (struct ring_record){seq, stamp_ns, size, (uint32_t)(size_and_flags >> 32), head + RING_HEAD_BYTES};
    return RING_OK;
}

/* Copies the payload that ring_look() found. RING_OK, or RING_OVERRUN: the copied bytes are worthless. A build with
 * BROKEN_NO_VALIDATE exists to see the litmus tests fail. */
static inline enum ring_status ring_copy_out(struct ring_reader *r, const struct ring_record *record, void *bytes)
{
    copy_from_shared(bytes, record->payload, record->size);
#ifdef BROKEN_NO_VALIDATE
    return RING_OK;
#endif
    return ring_is_intact(r) ? RING_OK : RING_OVERRUN;
}

/* Notes that the next record is taken. */
static inline void ring_step(struct ring_reader *r) { r->next++; }

/* Shows the writer how far this reader is: earlier records may be overwritten, except pinned ones. */
static inline void ring_tell_cursor(struct ring_reader *r)
{
    /* PAIR(cursor): release. Copies of taken records are complete, and pins on them are set. Counterpart:
     * gates_taken(). */
    atomic_store_explicit(&r->slot->cursor, r->next, memory_order_release);
}

/* After ring_tell_cursor(): true if the writer sleeps for room and must be rung now. */
static inline bool ring_room_is_due(struct ring_reader *r)
{
    bell_fence(); /* PAIR(sleep): after the cursor. Counterpart: ring_wait_for_room(). */
    return bell_is_due(&r->header->room, &r->room_rung, r->next);
}

/* Asks to be admitted: the writer shows the ticket when it adds the gate of this slot. The ticket is not 0 and differs
 * from all tickets shown now; the slot's pins are free. Until it is admitted the reader must copy and not pin. */
static inline void ring_ask(struct reader_slot *slot, uint32_t ticket)
{
    /* PAIR(unpin): release, as for any pin. The message that names the slot to the writer orders it before the gate. */
    atomic_store_explicit(&slot->pins[READER_PINS - 1], READER_TICKET | ticket, memory_order_release);
}

/* True if the ticket is shown. If later tickets have already replaced it, the reader is never admitted and copies. */
static inline bool ring_is_admitted(const struct ring_reader *r, uint32_t ticket)
{
    for (unsigned i = 0; i < RING_ADMITTED; i++)
        /* PAIR(admit): acquire. The writer respects the gate for all records dropped from here on. Counterpart:
         * ring_admit(). */
        if (atomic_load_explicit(&r->header->admitted[i], memory_order_acquire) == ticket)
            return true;
    return false;
}

/* Holds the record that ring_look() found in place until ring_unpin(*pin). Its payload may be read until then, also
 * after ring_step(). Allowed only after the writer has added this reader's gate: see ring_ask(). RING_OK,
 * RING_OVERRUN, or RING_PINNED: all pins of this match are in use, copy instead. */
static inline enum ring_status ring_pin(struct ring_reader *r, const struct ring_record *record, unsigned *pin)
{
    for (unsigned i = 0; i < READER_PINS; i++) {
        _Atomic uint64_t *word = &r->slot->pins[i];
        if (atomic_load_explicit(word, memory_order_relaxed) != 0) /* own word */
            continue;
        /* PAIR(unpin): release, for the record that this word held before. */
        atomic_store_explicit(word, record->seq, memory_order_release);
        /* PAIR(pin): either this side sees that it is too late or the writer sees the pin: ring_give_up(). */
        bell_fence();
        if (ring_is_intact(r)) {
            *pin = i;
            return RING_OK;
        }
        atomic_store_explicit(word, 0, memory_order_release); /* PAIR(unpin) */
        return RING_OVERRUN;
    }
    return RING_PINNED;
}

static inline void ring_unpin(struct reader_slot *slot, unsigned pin)
{
    /* PAIR(unpin): release. Reads of the record are complete. Counterpart: gate_pin(). */
    atomic_store_explicit(&slot->pins[pin], 0, memory_order_release);
}

#endif
