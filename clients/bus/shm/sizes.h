/* Sizes of a publisher's rings, and the memory that segments leave free. docs/ring.md has the reasons.
 *
 * A publisher begins with a small ring, and continues in a larger one when a message does not fit, when the depth would
 * suffer, or when pins leave no room. This file decides how large that is. Its caller decides when.
 *
 * Must not know: Python, system calls, how a segment is made.
 */
#ifndef BUS_SHM_SIZES_H
#define BUS_SHM_SIZES_H

#include "ring.h"

#define RING_FIRST_CAPACITY 4096u /* of every first ring: a program may have hundreds of publishers with few messages */
#define RING_FIRST_INDEX 64u
#define RING_EARLY 16u            /* publishers of a process that get a ring of the usual size at their first match */
#define RING_LAP_MS 1000u         /* a first ring that is filled in less time is replaced */
#define RING_USUAL_CAPACITY (64u << 10)
#define RING_USUAL_KEEP_ALL (1u << 20)
#define RING_FEW_RECORDS 64u      /* so few records make it worth while to grow for a slow lossless reader ... */
#define RING_FEW_MOST (8u << 20)  /* ... up to this capacity */
#define RING_FOR_EVER (UINT64_C(1) << 60) /* a depth without bound */

/* Of the memory below a limit, a part stays free for everything else that programs do. */
#define MEMORY_RESERVE_PART 16u
#define MEMORY_RESERVE_LEAST (8u << 20)
#define MEMORY_RESERVE_MOST (64u << 20)
#define MEMORY_STEP (4u << 20) /* a larger segment is reserved in such steps, with a check before each */

struct ring_sizes {
    uint64_t capacity; /* 0: the ring must not grow */
    uint64_t index_length;
};

static inline uint64_t sizes_max(uint64_t a, uint64_t b) { return a > b ? a : b; }
static inline uint64_t sizes_min(uint64_t a, uint64_t b) { return a < b ? a : b; }

/* The smallest power of two that is not less than `number`, which is at most 2^63. */
static inline uint64_t sizes_power_of_two(uint64_t number)
{
    uint64_t power = 1;
    while (power < number)
        power *= 2;
    return power;
}

/* Bytes for `keep` records, if records keep their present size: `held` of them fill `capacity`. A power of two, at most
 * `most`. 0: not known. With it a ring grows once, and not several times by doubling; each growth delays messages. */
static inline uint64_t sizes_for_depth(uint64_t capacity, uint64_t held, uint64_t keep, uint64_t most)
{
    if (keep >= RING_FOR_EVER || held == 0)
        return 0;
    /* The product may be out of range. The result is bounded by `most` then, too. */
    const uint64_t needed = keep > UINT64_MAX / capacity ? most : capacity * keep / held;
    uint64_t power = sizes_power_of_two(sizes_min(needed, UINT64_C(1) << 62));
    while (power > most)
        power /= 2;
    return power;
}

/* The sizes of the ring after one with `capacity` that holds `held` records.
 *
 * `size`: bytes of a message that must fit; 0: any. `keep`: records that must stay. `most`: limit for growth for the
 * depth (`ring_bytes` of Created); less than the usual capacity counts as that. `must`: the limit does not count. */
static inline struct ring_sizes ring_next_sizes(
    uint64_t capacity, uint64_t held, uint64_t size, uint64_t keep, uint64_t most, bool keeps_all, bool must)
{
    const uint64_t usual = keeps_all ? RING_USUAL_KEEP_ALL : RING_USUAL_CAPACITY;
    const uint64_t fit = sizes_power_of_two(4 * (sizes_min(size, RING_MAX_CAPACITY) + RING_HEAD_BYTES));
    uint64_t next = sizes_max(sizes_max(2 * capacity, fit), usual);
    if (!must) {
        const uint64_t limit = sizes_max(most, usual);
        if (next > limit)
            return (struct ring_sizes){0};
        next = sizes_max(next, sizes_for_depth(capacity, held, keep, limit));
    }
    const uint64_t most_index = next / RING_ALIGN;
    const uint64_t index = keep >= most_index ? most_index : sizes_power_of_two(keep + 1);
    return (struct ring_sizes){next, sizes_max(next / 128, index)};
}

/* Whether a few long records fill the ring, so that a larger one lets both sides work at the same time. */
static inline bool ring_is_filled_by_few(uint64_t capacity, uint64_t held)
{
    return held <= RING_FEW_RECORDS && 2 * capacity <= RING_FEW_MOST;
}

/* Bytes that must stay free below a memory limit when a segment of `size` bytes is made: half of it for programs that
 * work on its long messages, and no less than a part of the limit. */
static inline uint64_t memory_kept(uint64_t limit, uint64_t size)
{
    const uint64_t part = sizes_max(limit / MEMORY_RESERVE_PART, MEMORY_RESERVE_LEAST);
    return sizes_max(sizes_min(part, MEMORY_RESERVE_MOST), size / 2);
}

#endif
