/* Sleeping without losing a wake-up, and ringing at most once for each sleep. No I/O: decides when a doorbell is due.
 *
 * The sleeper owns a `struct bell` in its own segment, and the waker maps that read-only. So the waker can't clear a
 * flag. Instead the sleeper counts its sleeps (odd generation: asleep), and the waker keeps in private memory for which
 * sleep it has rung. The handshake is Dekker's, with a full fence on each side:
 *
 *     sleeper                                waker
 *     generation = odd                       make the thing visible (publish; move a cursor)
 *     full fence         PAIR(sleep)         full fence
 *     check for the thing                    check generation: odd and new? ring
 *
 * All full fences have one order. After the later of the two fences, its side sees the other side's store before its
 * fence. So either the sleeper finds the thing or the waker rings. If the waker is killed between the two, its reader
 * stays asleep until the broker reports that the waker is gone; then the reader checks a last time.
 *
 * Two uses. arrival, in a readers' segment: the process sleeps, all its publishers' processes ring it. room, in a
 * ring: the writer sleeps until its lossless readers have taken everything before `wanted`.
 */
#ifndef BUS_SHM_DOORBELL_H
#define BUS_SHM_DOORBELL_H

#include "layout.h"

/* Numbers to add to a doorbell's count. KNOCK_ANY: there is news for any slot. Else the number names a slot of the
 * readers' segment. A process that finds a single knock, for one slot, need not check the other slots. */
#define KNOCK_ANY UINT64_C(1)
#define KNOCK_SLOT (UINT64_C(1) << 24)
#define KNOCK_ONE (UINT64_C(1) << 44)

_Static_assert(READERS_MAX_SLOTS <= 1u << 20, "a slot's number has 20 bits in a knock");

/* Up to this number of rings, a check of all of them costs less than the information which one has news. */
#define FEW_RINGS 16u

/* The full fence of both sides: between making a thing visible and checking for sleepers, and between announcing a
 * sleep and checking again. One fence serves any number of bells. A build with BROKEN_NO_FENCE exists to see the
 * litmus tests fail. */
static inline void bell_fence(void)
{
#ifdef BROKEN_NO_FENCE
    atomic_signal_fence(memory_order_seq_cst);
#else
    atomic_thread_fence(memory_order_seq_cst); /* PAIR(sleep): seq_cst, both sides are here */
#endif
}

/* Sleeper: announces the sleep, which ends by a ring when `wanted` is reached (0: by anything). The caller checks again
 * after it, and only then really sleeps. A call while asleep starts a new generation, which may be rung again. */
static inline void bell_arm(struct bell *bell, uint64_t wanted)
{
    const uint64_t generation = atomic_load_explicit(&bell->generation, memory_order_relaxed); /* own word */
    /* relaxed: PAIR(wanted) orders it before the new generation; with an older one it can ring once too much */
    atomic_store_explicit(&bell->wanted, wanted, memory_order_relaxed);
    /* PAIR(wanted): release. A waker that sees this generation sees its `wanted`, too. Counterpart: bell_is_due(). */
    atomic_store_explicit(&bell->generation, (generation | 1) + (generation & 1) * 2, memory_order_release);
    bell_fence(); /* PAIR(sleep): before the next check. Counterpart: the bell_fence() ahead of bell_is_due(). */
}

/* Sleeper: announces that it is awake. Relaxed: a waker that still sees the old generation only rings once too much. */
static inline void bell_disarm(struct bell *bell)
{
    const uint64_t generation = atomic_load_explicit(&bell->generation, memory_order_relaxed); /* own word */
    if (generation & 1)
        atomic_store_explicit(&bell->generation, generation + 1, memory_order_relaxed);
}

/* Waker, after bell_fence(): true if the sleeper must be rung now; then *rung notes it as done. Start *rung at 0.
 * `reached` is the present position (arrival: anything). */
static inline bool bell_is_due(const struct bell *bell, uint64_t *rung, uint64_t reached)
{
    /* PAIR(wanted): acquire. PAIR(sleep): the fence before it orders it after the store that made the thing visible. */
    const uint64_t generation = atomic_load_explicit(&bell->generation, memory_order_acquire);
    if ((generation & 1) == 0 || generation == *rung)
        return false;
    /* relaxed: a newer value belongs to a newer sleep, whose sleeper checks for itself */
    if (reached < atomic_load_explicit(&bell->wanted, memory_order_relaxed))
        return false;
    *rung = generation;
    return true;
}

/* Rings of one process at another one's doorbell. Initialise with zeroes. */
struct knocks {
    uint64_t rung;  /* generation of the sleep for which it has rung */
    const void *by; /* the only ring that has rung in this sleep; NULL: several have, or for anything */
};

static inline uint64_t knock_for(uint64_t slot) { return KNOCK_ONE | slot * KNOCK_SLOT; }

/* The only slot that a doorbell's count names; UINT64_MAX: there were no knocks, several knocks, or one for any
 * slot. */
static inline uint64_t knock_slot(uint64_t count)
{
    if (count / KNOCK_ONE != 1 || count % KNOCK_SLOT != 0)
        return UINT64_MAX;
    return count / KNOCK_SLOT % (KNOCK_ONE / KNOCK_SLOT);
}

/* Waker of an arrival bell, after bell_fence(): the number to add to the doorbell now; 0: none. It is `knock` at the
 * first time in this sleep. If two rings of this process have news, the sleeper must check all. */
static inline uint64_t bell_knock(const struct bell *bell, struct knocks *knocks, const void *by, uint64_t knock)
{
    /* PAIR(sleep): the fence before it orders it after the store that made the record visible. There is only one
     * load: a second one could see a newer sleep, and this could then count news as rung that the sleeper does not
     * check. */
    const uint64_t generation = atomic_load_explicit(&bell->generation, memory_order_acquire);
    if ((generation & 1) == 0)
        return 0;
    if (generation != knocks->rung) {
        knocks->rung = generation;
        knocks->by = knock == KNOCK_ANY ? NULL : by;
        return knock;
    }
#ifdef BROKEN_ONE_KNOCK
    return 0;
#endif
    if (knocks->by == NULL || knocks->by == by)
        return 0;
    knocks->by = NULL;
    return KNOCK_ANY;
}

#endif
