/* The ring: a lossy log of records, one writer, any number of readers in other processes. See docs/ring.md.
 * The two sides are writer.h and reader.h; this file has their common part. Above them, feed.h follows a publisher from
 * ring to ring, and gates.h is a writer's view of its readers.
 *
 * Records are found by sequence number: index[seq] is the position of a record. Two words bound the records that exist.
 * `latest` is the newest record, stored after the record is whole. `oldest` is stored before anything older is
 * overwritten. A reader copies a record and then checks that `oldest` is not above it. It never writes to the ring. It
 * reports in its own slot: by a cursor, at which a lossless reader stops the writer, and by pins, which hold single
 * records in place while the writer steps over them.
 *
 * Must not know: descriptors, events, Python, policy (when to grow, wait or drop). Nothing here waits. One
 * thread at a time may use a writer or a reader.
 *
 * Each atomic access names its order; PAIR(x) marks both ends of an edge:
 *   latest   release store / acquire load           a published record is whole, and so is its index entry
 *   oldest   store, release fence / acquire fence, load    a reader that read overwritten bytes notices it
 *   cursor   release store / acquire load           a taken record is not overwritten while it is being read
 *   unpin    release store / acquire load           the same for a pinned record
 *   pin      seq_cst fences                         the writer sees a pin that was granted
 *   closed   release store / acquire load           after closed, latest is final
 *   admit    release store / acquire load           a reader whose ticket is shown has a gate: the writer sees its pins
 */
#ifndef BUS_SHM_RING_H
#define BUS_SHM_RING_H

#include "layout.h"

/* Largest sequence number, as on the wire. If a number is larger, the other side is broken. */
#define MAX_SEQ ((UINT64_C(1) << 62) - 1)

enum ring_status {
    RING_OK,
    RING_EMPTY,     /* this reader has taken all records */
    RING_OVERRUN,   /* the reader was lapped: counted and moved to the oldest record, poll again */
    RING_CORRUPT,   /* a record contradicts its index: its writer is hostile or broken */
    RING_TOO_LARGE, /* the payload is above this ring's max_payload */
    RING_SHORT,     /* fewer than the newest `keep` records would be left: grow, or force */
    RING_FULL,      /* a lossless reader has not taken records that would be overwritten: wait */
    RING_PINNED,    /* pinned records leave no room: grow, or drop */
    RING_HELD,      /* `hold` may be out of date: move it if it is, and try again */
};

static inline uint64_t ring_record_bytes(uint64_t size)
{
    return (RING_HEAD_BYTES + size + RING_ALIGN - 1) & ~(uint64_t)(RING_ALIGN - 1);
}

/* Largest payload: a quarter of the ring. So if the writer skips the ring's end, room for two more always remains. */
static inline uint64_t ring_max_payload(uint64_t capacity) { return capacity / 4 - RING_HEAD_BYTES; }

#endif
