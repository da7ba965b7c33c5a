/* The ring: a lossy log of records, one writer, any number of readers in other processes. See docs/ring.md.
 * The two sides are writer.h and reader.h; this is what they share. Above them, feed.h follows a publisher from ring to
 * ring; gates.h is what a writer knows of its readers.
 *
 * Everything goes by sequence number. index[seq] says where a record lies; two words bound what exists:
 * `latest`, the newest record, published after it is whole; `oldest`, announced before anything older is
 * overwritten. A reader takes a record out and then asks whether it is still not older than `oldest`. It never
 * writes to the ring. What it has to tell stands in its own slot: a cursor, which holds a lossless reader's
 * writer back, and pins, which hold single records in place while the writer steps over them.
 *
 * Must not know: descriptors, events, Python, policy (when to grow, wait or drop). Nothing here waits. One
 * thread at a time may use a writer or a reader.
 *
 * Each atomic access names its order; PAIR(x) stands at both ends of an edge:
 *   latest   release store / acquire load           a published record is whole, and so is its index entry
 *   oldest   store, release fence / acquire fence, load    who read overwritten bytes learns it
 *   cursor   release store / acquire load           what was taken is not overwritten while it is being read
 *   unpin    release store / acquire load           the same for a pinned record
 *   pin      seq_cst fences                         a pin that was granted is seen by the writer
 *   closed   release store / acquire load           after closed, latest is final
 *   admit    release store / acquire load           whose ticket is there has a gate, so its pins are seen
 */
#ifndef BUS_SHM_RING_H
#define BUS_SHM_RING_H

#include "layout.h"

/* Sequence numbers end here, as on the wire; beyond, the other side is broken. */
#define MAX_SEQ ((UINT64_C(1) << 62) - 1)

enum ring_status {
    RING_OK,
    RING_EMPTY,     /* nothing that this reader has not taken */
    RING_OVERRUN,   /* reader was lapped: counted and moved to the oldest record, poll again */
    RING_CORRUPT,   /* a record contradicts its index: its writer is hostile or broken */
    RING_TOO_LARGE, /* more than max_payload of this ring */
    RING_SHORT,     /* fewer than the newest `keep` records would be left: grow, or force */
    RING_FULL,      /* a lossless reader has not taken what would be overwritten: wait */
    RING_PINNED,    /* pinned records leave no room: grow, or drop */
    RING_HELD,      /* `hold` may be out of date: move it where that is so, and try again */
};

static inline uint64_t ring_record_bytes(uint64_t size)
{
    return (RING_HEAD_BYTES + size + RING_ALIGN - 1) & ~(uint64_t)(RING_ALIGN - 1);
}

/* Largest payload: a quarter of the ring, so that skipping its end always leaves room for two more. */
static inline uint64_t ring_max_payload(uint64_t capacity) { return capacity / 4 - RING_HEAD_BYTES; }

#endif
