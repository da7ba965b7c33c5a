/* The writer's side of the ring: makes room, steps over pins, publishes. Begin with ring.h.
 *
 * Only the process that made a segment can map it writable, so all words of the ring are the writer's own. It reads
 * only cursors and pins of other processes, through its gates (gates.h). A false cursor or pin harms only its owner.
 */
#ifndef BUS_SHM_WRITER_H
#define BUS_SHM_WRITER_H

#include "copy.h"
#include "doorbell.h"
#include "gates.h"
#include "ring.h"

#ifndef RING_LEAD
#define RING_LEAD 16u /* records dropped in advance: `oldest` changes seldom, and stays in readers' caches */
#endif

#ifndef RING_LARGE
#define RING_LARGE 32768u /* bytes from which on records turn back, see ring_turn_back() */
#endif
#define RING_ROUND 3u /* such records before the ring turns back */

#ifndef RING_ASK
#define RING_ASK (4u << 20) /* bytes since the start of the ring from which on a request to move `hold` pays off */
#endif

struct ring_writer {
    struct ring_header *header;
    _Atomic uint64_t *index;
    unsigned char *data;
    uint64_t capacity, index_length, max_payload;
    uint64_t keep; /* newest records that must stay, 1 or more: largest depth of publisher and matches */
    uint64_t latest, oldest, head; /* head: position of the next record */
    uint64_t turn, behind;         /* of the last turn back: the next seq then, and the end of the records there */
    uint64_t island, island_end;   /* after a leap: records before this seq lie ahead, up to that position */
    uint64_t loan;                 /* bytes of the record reserved at head; 0: none */
    uint64_t hold;                 /* no record from this seq on may be dropped; UINT64_MAX: no limit */
    uint64_t asked;                /* the seq for which RING_HELD was returned */
    uint64_t floor;                /* ring_taken() at the last check; 0 after hold is set */
    uint64_t admissions;           /* tickets shown so far */
    struct ring_gates gates;       /* after a change from outside: ring_gates_changed() */
};

/* Takes over a formatted ring at the point where its last writer left it, even if that was killed in mid-write. Gates
 * are added later. A ring with old pins must not be taken over: the positions of their records are no longer known. */
static inline void ring_writer_attach(struct ring_writer *w, void *memory)
{
    struct ring_header *header = memory;
    const struct ring_geometry *geometry = &header->geometry;
    *w = (struct ring_writer){
        .header = header,
        .index = (_Atomic uint64_t *)((char *)memory + geometry->index_offset),
        .data = (unsigned char *)memory + geometry->data_offset,
        .capacity = geometry->capacity,
        .index_length = geometry->index_length,
        .max_payload = ring_max_payload(geometry->capacity),
        .keep = 1,
        .hold = UINT64_MAX,
        /* relaxed, all three: only writers write them, and the last one is gone */
        .latest = atomic_load_explicit(&header->latest, memory_order_relaxed),
        .oldest = atomic_load_explicit(&header->oldest, memory_order_relaxed),
        .head = atomic_load_explicit(&header->end, memory_order_relaxed),
    };
}

/* The seq before which all lossless readers have taken everything; `hold` counts like a reader. */
static inline uint64_t ring_taken(const struct ring_writer *w) { return gates_taken(&w->gates, w->hold); }

/* Discards all conclusions from the gates, which have changed. */
static inline void ring_gates_changed(struct ring_writer *w)
{
    w->floor = 0;
    gates_count_holes(&w->gates);
}

/* Shows the ticket of a new gate's reader, which may pin from now on. Comes after ring_gates_changed(). */
static inline void ring_admit(struct ring_writer *w, const struct ring_gate *gate)
{
    const uint32_t ticket = gate_ticket(gate);
    if (ticket == 0)
        return;
    /* PAIR(admit): release. Each store of `oldest` that did not respect the gate comes before it. Counterpart:
     * ring_is_admitted(). */
    _Atomic uint32_t *place = &w->header->admitted[w->admissions++ % RING_ADMITTED];
    atomic_store_explicit(place, ticket, memory_order_release);
}

/* Adds the gate of match `key`, or replaces its earlier gate, and admits its reader; see gates_add(). Call gates_ring()
 * for any after it: records published since the reader's last check did not wake it. False: no memory. */
static inline bool ring_add_gate(struct ring_writer *w, uint64_t key, struct reading_process *process, uint64_t slot,
                                 bool is_lossless)
{
    if (!gates_add(&w->gates, key, process, slot, is_lossless))
        return false;
    ring_gates_changed(w);
    ring_admit(w, &w->gates.list[w->gates.count - 1]);
    return true;
}

/* Removes a gate: from now on the writer overwrites records that its reader has pinned. Returns its process. */
static inline struct reading_process *ring_remove_gate(struct ring_writer *w, struct ring_gate *gate)
{
    struct reading_process *process = gates_remove(&w->gates, gate);
    ring_gates_changed(w);
    return process;
}

/* Makes the gate lossy: its reader no longer holds the writer back, except by pins. */
static inline void ring_make_lossy(struct ring_writer *w, struct ring_gate *gate)
{
    gate->is_lossless = false;
    ring_gates_changed(w);
}

static inline uint64_t ring_position(const struct ring_writer *w, uint64_t seq)
{
    /* relaxed: own word */
    return atomic_load_explicit(&w->index[seq & (w->index_length - 1)], memory_order_relaxed);
}

/* The first record that remains after seq `next` is written up to position `end`: by bytes, and by index entries. */
static inline uint64_t ring_survivor(const struct ring_writer *w, uint64_t next, uint64_t end)
{
    uint64_t seq = w->oldest;
    if (next - seq >= w->index_length)
        seq = next - w->index_length + 1;
    while (seq <= w->latest) {
        const bool is_leapt = seq < w->island && end <= w->island_end; /* the writer reaches its place a lap later */
        if (ring_position(w, seq) + w->capacity + (is_leapt ? w->capacity : 0) >= end)
            break;
        seq++;
    }
    return seq;
}

/* First position from `position` on at which `total` bytes lie in one piece and clear of holes; or a position more than
 * a lap ahead. */
static inline uint64_t ring_place(struct ring_writer *w, uint64_t position, uint64_t total)
{
    const uint64_t last = w->head + w->capacity - total;
    while (position <= last) {
        const uint64_t begin = position & (w->capacity - 1);
        uint64_t end = w->capacity;
        if (begin + total <= w->capacity && (end = gates_hole_in(&w->gates, begin, begin + total)) == 0)
            break;
        position += end - begin;
    }
    return position;
}

/* Drops all records before `survivor`: announces it by `oldest`, and makes holes of the pinned ones. */
static inline void ring_give_up(struct ring_writer *w, uint64_t survivor)
{
    const uint64_t before = w->oldest;
    w->oldest = survivor;
    atomic_store_explicit(&w->header->oldest, survivor, memory_order_relaxed); /* the next line orders it */
    /* PAIR(oldest): release fence. A reader that sees a byte written from here on, and then fences, sees the store
     * above. Counterpart: ring_is_intact(). It is a full fence for two reasons: only that makes x86 order the streaming
     * stores of a long memcpy after earlier stores, and pins need it. */
    /* PAIR(pin): either this side sees the pin below or its reader sees that it came too late: ring_pin(). */
    bell_fence();
    for (size_t i = 0; i < w->gates.count; i++) {
        for (unsigned j = 0; j < READER_PINS; j++) {
            const uint64_t seq = gate_pin(&w->gates.list[i], j); /* may have changed since an older hole */
            if (seq < before || seq >= survivor)
                continue;
            const uint64_t begin = ring_position(w, seq) & (w->capacity - 1);
            const uint64_t size = load_word(w->data + begin + 16) & UINT32_MAX;
            gates_add_hole(&w->gates, i, j, (struct ring_hole){seq, begin, begin + ring_record_bytes(size)});
        }
    }
}

/* Whether a record that ends at position `end` may be next, if records from `needed` on are needed. */
static inline bool ring_may_turn(const struct ring_writer *w, uint64_t needed, uint64_t end)
{
    if (needed < w->oldest || needed > w->latest)
        return needed > w->latest;
    const uint64_t at = ring_position(w, needed);
    return at + w->capacity >= end && w->head - at <= w->capacity / 4;
}

/* Before a large record of `total` bytes: turns back to the start of the ring, which is still in the cache. It does not
 * turn back if records there are needed: by lossless readers, `hold` or the depth. One more record counts as needed,
 * because a reader may be reading it. It does not turn back either if the needed records take more than a quarter of
 * the ring. False: only `hold` prevents it, and the owner should try to move it; returned once for a record. (If readers
 * prevent it, too, moving `hold` would change nothing, and cost the owner a look at all new matches.) */
static inline bool ring_turn_back(struct ring_writer *w, uint64_t next, uint64_t total)
{
    const uint64_t offset = w->head & (w->capacity - 1), lap = w->head - offset + w->capacity, end = lap + total;
    if (offset < RING_ROUND * total || next <= w->keep)
        return true;
    const uint64_t newest = next - w->keep;
    uint64_t needed = newest;
    if (needed > w->floor && needed > (w->floor = ring_taken(w)))
        needed = w->floor;
    if (!ring_may_turn(w, needed, end)) {
        if (offset < RING_ASK || w->asked == next || !ring_may_turn(w, gates_taken(&w->gates, newest), end))
            return true;
        w->asked = next;
        return false;
    }
    w->turn = next;
    w->behind = lap + offset;
    w->head = lap;
    return true;
}

/* If the ring has turned back and finds no more room, continues behind the records that lay there at the turn. These
 * become an island, and turning back costs no more room than that. False: there is nothing to leap over. */
static inline bool ring_leap(struct ring_writer *w)
{
    if (w->head >= w->behind)
        return false;
    w->head = w->behind;
    w->island = w->turn;
    w->island_end = (w->behind | (w->capacity - 1)) + 1;
    return true;
}

/* Makes room for a record of up to `size` bytes and lends the place in *payload; ring_publish() ends the loan,
 * another ring_reserve() takes it back. `force` gives up depth, but no records of lossless readers, and no pins.
 * Returns RING_OK, RING_TOO_LARGE, RING_SHORT, RING_FULL, RING_HELD or RING_PINNED. RING_PINNED may have dropped
 * records that are still whole; the other refusals change nothing. */
static inline enum ring_status ring_reserve(struct ring_writer *w, uint64_t size, bool force, void **payload)
{
    w->loan = 0;
    if (size > w->max_payload)
        return RING_TOO_LARGE;
    const uint64_t total = ring_record_bytes(size), next = w->latest + 1;
    if (total >= RING_LARGE && !ring_turn_back(w, next, total))
        return RING_HELD;
    uint64_t position = ring_place(w, w->head, total), survivor;
    while (position <= w->head + w->capacity - total
           && (survivor = ring_survivor(w, next, position + total)) != w->oldest) {
        const bool is_short = next - survivor + 1 < w->keep;
        const bool is_full = survivor > w->floor && survivor > (w->floor = ring_taken(w));
        if ((is_short || is_full) && ring_leap(w)) {
            position = ring_place(w, w->head, total);
            continue;
        }
        if (is_short && !force)
            return RING_SHORT;
        if (is_full)
            return RING_FULL;
        if (RING_LEAD * total <= w->capacity / 8 && next > w->keep) {
            uint64_t ahead = ring_survivor(w, next + RING_LEAD, position + (1 + RING_LEAD) * total);
            const uint64_t kept = next - w->keep + 1, most = kept < w->floor ? kept : w->floor;
            ahead = ahead < most ? ahead : most;
            survivor = ahead > survivor ? ahead : survivor;
        }
        ring_give_up(w, survivor);
        position = ring_place(w, position, total); /* dropped records may be pinned */
    }
    if (position > w->head + w->capacity - total)
        return RING_PINNED;
    w->head = position;
    w->loan = total;
    *payload = w->data + (position & (w->capacity - 1)) + RING_HEAD_BYTES;
    return RING_OK;
}

/* Publishes the record lent by ring_reserve(). `size` is at most the reserved size. Returns its sequence number. */
static inline uint64_t ring_publish(struct ring_writer *w, uint32_t size, uint64_t stamp_ns, uint32_t flags)
{
    const uint64_t seq = w->latest + 1;
    unsigned char *record = w->data + (w->head & (w->capacity - 1));
    store_word(record, seq);
    store_word(record + 8, stamp_ns);
    store_word(record + 16, (uint64_t)flags << 32 | size);
    /* relaxed: PAIR(latest) orders it for readers of seq, PAIR(oldest) for readers of the entry's last owner */
    atomic_store_explicit(&w->index[seq & (w->index_length - 1)], w->head, memory_order_relaxed);
    w->head += ring_record_bytes(size);
    w->loan = 0;
    w->latest = seq;
    /* relaxed: only a new attach reads it, when this writer is gone; if killed here, it wastes one record's room */
    atomic_store_explicit(&w->header->end, w->head, memory_order_relaxed);
    /* PAIR(latest): release. Publishes record and index entry. Counterpart: ring_poll(), ring_join(). */
    atomic_store_explicit(&w->header->latest, seq, memory_order_release);
    return seq;
}

/* Writes one record: ring_reserve(), copy, ring_publish(). */
static inline enum ring_status ring_write(
    struct ring_writer *w, const void *bytes, uint32_t size, uint64_t stamp_ns, uint32_t flags, bool force)
{
    void *payload;
    const enum ring_status status = ring_reserve(w, size, force, &payload);
    if (status != RING_OK)
        return status;
    copy_to_shared(payload, bytes, size);
    ring_publish(w, size, stamp_ns, flags);
    return RING_OK;
}

/* Closes the ring, to which nothing more is written. Readers that have taken everything continue in the next ring. */
static inline void ring_close(const struct ring_writer *w)
{
    /* PAIR(closed): release, after the last latest. Counterpart: ring_is_finished(). */
    atomic_store_explicit(&w->header->closed, 1, memory_order_release);
}

/* After RING_FULL: announces the writer's sleep until the slowest lossless reader has taken half of its waiting
 * records. False: no need to sleep, try again. After waking: bell_disarm(&w->header->room). */
static inline bool ring_wait_for_room(struct ring_writer *w)
{
    const uint64_t taken = ring_taken(w);
    if (taken > w->latest)
        return false;
    const uint64_t wanted = taken + (w->latest + 2 - taken) / 2;
    bell_arm(&w->header->room, wanted); /* PAIR(sleep): before looking again. Counterpart: ring_room_is_due(). */
    if (ring_taken(w) < wanted)
        return true;
    bell_disarm(&w->header->room);
    return false;
}

/* Growth: the number of the first record if the newest `count` records are carried to a new ring. The new ring must be
 * formatted with this number as first_seq. */
static inline uint64_t ring_carry_from(const struct ring_writer *w, uint64_t count)
{
    const uint64_t there = w->latest + 1 - w->oldest;
    return w->latest + 1 - (count < there ? count : there);
}

/* Copies the records of `old` from ring_carry_from() on into `w`, newly attached and without gates. Seqs, stamps
 * and flags stay, so a reader continues in the new ring by ring_seek() to its own next number. */
static inline enum ring_status ring_carry(struct ring_writer *w, const struct ring_writer *old)
{
    const uint64_t keep = w->keep;
    enum ring_status status = RING_OK;
    w->keep = UINT64_MAX; /* all carried records */
    for (uint64_t seq = w->latest + 1; seq <= old->latest && status == RING_OK; seq++) {
        const unsigned char *record = old->data + (ring_position(old, seq) & (old->capacity - 1));
        const uint64_t stamp_ns = load_word(record + 8), size_and_flags = load_word(record + 16);
        const uint32_t size = (uint32_t)size_and_flags, flags = (uint32_t)(size_and_flags >> 32);
        status = ring_write(w, record + RING_HEAD_BYTES, size, stamp_ns, flags, true);
    }
    w->keep = keep;
    return status;
}

/* Continues in the ring of `fresh`, to which ring_carry() has copied the kept records. Gates, depth and `hold` move to
 * it. Closes the old ring; readers follow when they have finished it. Call gates_ring() for any after it. */
static inline void ring_go_on(struct ring_writer *w, const struct ring_writer *fresh)
{
    const struct ring_writer before = *w;
    gates_forget_holes(&w->gates);
    const struct ring_gates gates = w->gates;
    *w = *fresh;
    w->keep = before.keep;
    w->hold = before.hold;
    w->gates = gates;
    bell_disarm(&before.header->room);
    ring_close(&before);
}

#endif
