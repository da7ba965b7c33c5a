/* Layout of the two kinds of segment: a publisher's ring, and a process's readers' segment.
 *
 * Owns offsets, sizes and the checks of a foreign segment; docs/ring.md draws them. Must not know the algorithm.
 * Only a segment's owner can write it. The other side maps it read-only, copies its geometry and checks the copy once,
 * and trusts nothing else. All words are native-endian: both ends are on one machine.
 */
#ifndef BUS_SHM_LAYOUT_H
#define BUS_SHM_LAYOUT_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

_Static_assert(ATOMIC_LLONG_LOCK_FREE == 2 && sizeof(_Atomic uint64_t) == 8, "64-bit atomics must be lock-free");

#define RING_MAGIC UINT64_C(0x676e697264737562)    /* "busdring" */
#define READERS_MAGIC UINT64_C(0x6461657264737562) /* "busdread" */
#define SHM_VERSION 1u

#define RING_ALIGN 64u       /* records begin here, so a record's head never straddles the ring's end */
#define RING_HEAD_BYTES 32u  /* of a record, before its payload: seq, stamp, size and flags, 8 bytes unused */
#define RING_MIN_CAPACITY 4096u
#define RING_MAX_CAPACITY (UINT64_C(1) << 34) /* so that a record's size fits into 32 bits */
#define RING_MIN_INDEX 16u
#define RING_MAX_INDEX (UINT64_C(1) << 32)
#define READER_PINS 7u       /* records that one match can pin at a time; with the cursor they fill one cache line */
#define READER_TICKET (UINT64_C(1) << 63) /* flag in the last pin word: it holds a ticket to be admitted, and no pin */
#define RING_ADMITTED 30u    /* tickets shown at a time; with `closed` they fill two cache lines */
#define READERS_MAX_SLOTS 65536u

/* Alignment to two cache lines, because the processor fetches neighbouring lines in pairs. */
#define OWN_LINES _Alignas(128)

/* One side's sleep, see doorbell.h. An odd generation means asleep. */
struct bell {
    _Atomic uint64_t generation;
    _Atomic uint64_t wanted;
};

/* Sizes and offsets of a ring, written once before the segment is shared. */
struct ring_geometry {
    uint64_t magic;
    uint32_t version;
    uint32_t header_bytes;
    uint64_t segment_bytes;
    uint64_t capacity;     /* bytes of data, a power of two */
    uint64_t index_length; /* entries, a power of two */
    uint64_t index_offset;
    uint64_t data_offset;
    uint64_t first_seq;    /* of the first record ever written here */
};

/* Start of a ring's segment: the geometry, then a pair of cache lines for each word that changes. Sequence numbers
 * begin at 1. */
struct ring_header {
    struct ring_geometry geometry;
    OWN_LINES _Atomic uint64_t oldest; /* records before this are dropped; stored before they are overwritten */
    OWN_LINES _Atomic uint64_t latest; /* newest published record */
    _Atomic uint64_t end;              /* position after it; only a writer that attaches anew reads this */
    OWN_LINES struct bell room;        /* the writer's sleep while it waits for lossless readers */
    OWN_LINES _Atomic uint64_t closed; /* 1: nothing more will be written here */
    _Atomic uint32_t admitted[RING_ADMITTED]; /* tickets of the matches with the latest gates */
};

/* One match: a subscription on one publisher's ring. Sequence numbers outlive a ring, and so does a slot. */
struct reader_slot {
    _Alignas(64) _Atomic uint64_t cursor;  /* the reader has taken all records before this */
    _Atomic uint64_t pins[READER_PINS];    /* sequence numbers of pinned records; 0: free; see READER_TICKET */
};

struct readers_geometry {
    uint64_t magic;
    uint32_t version;
    uint32_t header_bytes;
    uint64_t segment_bytes;
    uint64_t slot_count;
};

struct readers_header {
    struct readers_geometry geometry;
    OWN_LINES struct bell arrival; /* the process's sleep while it waits for samples of any ring */
};

_Static_assert(sizeof(struct ring_header) == 640 && sizeof(struct readers_header) == 256, "layout of version 1");
_Static_assert(sizeof(struct reader_slot) == 64, "layout of version 1");

static inline bool is_power_of_two(uint64_t n) { return n != 0 && (n & (n - 1)) == 0; }

static inline uint64_t ring_data_offset(uint64_t index_length)
{
    const uint64_t index_bytes = index_length * sizeof(uint64_t);
    return sizeof(struct ring_header) + ((index_bytes + RING_ALIGN - 1) & ~(uint64_t)(RING_ALIGN - 1));
}

/* Bytes of a ring's segment; 0 if capacity or index_length is out of bounds. */
static inline uint64_t ring_segment_bytes(uint64_t capacity, uint64_t index_length)
{
    if (!is_power_of_two(capacity) || capacity < RING_MIN_CAPACITY || capacity > RING_MAX_CAPACITY)
        return 0;
    if (!is_power_of_two(index_length) || index_length < RING_MIN_INDEX || index_length > RING_MAX_INDEX)
        return 0;
    return ring_data_offset(index_length) + capacity;
}

static inline uint64_t readers_segment_bytes(uint64_t slot_count)
{
    if (slot_count == 0 || slot_count > READERS_MAX_SLOTS)
        return 0;
    return sizeof(struct readers_header) + slot_count * sizeof(struct reader_slot);
}

/* Formats zeroed memory of ring_segment_bytes() as an empty ring, before another process can map it. */
static inline void ring_format(void *memory, uint64_t capacity, uint64_t index_length, uint64_t first_seq)
{
    struct ring_header *header = memory;
    header->geometry = (struct ring_geometry){
        .magic = RING_MAGIC,
        .version = SHM_VERSION,
        .header_bytes = sizeof *header,
        .segment_bytes = ring_segment_bytes(capacity, index_length),
        .capacity = capacity,
        .index_length = index_length,
        .index_offset = sizeof *header,
        .data_offset = ring_data_offset(index_length),
        .first_seq = first_seq,
    };
    atomic_init(&header->oldest, first_seq);
    atomic_init(&header->latest, first_seq - 1);
}

/* Like ring_format(), for a readers' segment. */
static inline void readers_format(void *memory, uint64_t slot_count)
{
    struct readers_header *header = memory;
    header->geometry = (struct readers_geometry){
        .magic = READERS_MAGIC,
        .version = SHM_VERSION,
        .header_bytes = sizeof *header,
        .segment_bytes = readers_segment_bytes(slot_count),
        .slot_count = slot_count,
    };
}

/* Copies a foreign ring's geometry and checks the copy. Its owner may still change the words in the ring, so nothing
 * reads them again. Returns NULL if a ring of that geometry lies within the mapping, else the fault in words. The
 * caller has made sure that the file can't shrink (seals). */
static inline const char *ring_check(const void *memory, uint64_t mapped_bytes, struct ring_geometry *copy)
{
    if (mapped_bytes < sizeof(struct ring_header))
        return "segment is shorter than a ring's header";
    memcpy(copy, memory, sizeof *copy);
    atomic_signal_fence(memory_order_seq_cst); /* keeps the compiler from reading the words a second time */
    if (copy->magic != RING_MAGIC)
        return "segment is no ring";
    if (copy->version != SHM_VERSION)
        return "ring has another layout version";
    if (copy->header_bytes != sizeof(struct ring_header) || copy->index_offset != sizeof(struct ring_header))
        return "ring's header has a wrong size";
    const uint64_t bytes = ring_segment_bytes(copy->capacity, copy->index_length);
    if (bytes == 0)
        return "ring's capacity or index length is out of bounds";
    if (copy->data_offset != ring_data_offset(copy->index_length))
        return "ring's data offset is not that of its index length";
    if (copy->segment_bytes != bytes)
        return "ring's segment bytes are not its data offset and its capacity";
    if (mapped_bytes < bytes)
        return "segment is shorter than its ring";
    if (copy->first_seq == 0)
        return "ring's first sequence number is 0";
    return NULL;
}

/* Like ring_check(), for a readers' segment. */
static inline const char *readers_check(const void *memory, uint64_t mapped_bytes, struct readers_geometry *copy)
{
    if (mapped_bytes < sizeof(struct readers_header))
        return "segment is shorter than a readers' header";
    memcpy(copy, memory, sizeof *copy);
    atomic_signal_fence(memory_order_seq_cst); /* as in ring_check() */
    if (copy->magic != READERS_MAGIC)
        return "segment is no readers' segment";
    if (copy->version != SHM_VERSION)
        return "readers' segment has another layout version";
    if (copy->header_bytes != sizeof(struct readers_header))
        return "readers' header has a wrong size";
    const uint64_t bytes = readers_segment_bytes(copy->slot_count);
    if (bytes == 0)
        return "readers' slot count is out of bounds";
    if (copy->segment_bytes != bytes)
        return "readers' segment bytes are not its header and its slots";
    if (mapped_bytes < bytes)
        return "segment is shorter than its slots";
    return NULL;
}

static inline struct reader_slot *readers_slots(void *memory)
{
    return (struct reader_slot *)((char *)memory + sizeof(struct readers_header));
}

#endif
