/* Sleeping without losing a wake-up, and ringing at most once for each sleep. No I/O: says when a doorbell is due.
 *
 * The sleeper owns a `struct bell` in its own segment, and the one who wakes it maps that read-only. So nobody
 * can take a flag back: the sleeper counts its sleeps (odd generation: asleep), and the waker remembers
 * privately for which sleep it has rung. The handshake is Dekker's, with a full fence on each side:
 *
 *     sleeper                                waker
 *     generation = odd                       make the thing visible (publish; move a cursor)
 *     full fence         PAIR(sleep)         full fence
 *     look for the thing                     look at generation: odd and new? ring
 *
 * Whichever fence comes second in the one order of full fences sees what stands before the other, so either
 * the sleeper finds the thing or the waker rings. A waker killed between the two leaves its reader asleep:
 * the broker's word that the waker is gone makes the reader look a last time.
 *
 * Two uses. arrival, in a readers' segment: the process sleeps, all its publishers' processes ring it. room, in a
 * ring: the writer sleeps until its lossless readers have taken everything before `wanted`.
 */
#ifndef BUS_SHM_DOORBELL_H
#define BUS_SHM_DOORBELL_H

#include "layout.h"

/* What is added to a doorbell's count: 1 to say that something has come, somewhere; or for which slot of the readers'
 * segment. So who finds that there was one knock, and for which slot, need not look at the others. */
#define KNOCK_ANY UINT64_C(1)
#define KNOCK_SLOT (UINT64_C(1) << 24)
#define KNOCK_ONE (UINT64_C(1) << 44)

_Static_assert(READERS_MAX_SLOTS <= 1u << 20, "a slot's number has 20 bits in a knock");

/* Up to so many rings, looking at all of them costs less than passing on which one has news. */
#define FEW_RINGS 16u

/* Between making a thing visible and looking for sleepers, and between falling asleep and looking again. One
 * fence serves any number of bells. A build with BROKEN_NO_FENCE exists to see the litmus tests fail. */
static inline void bell_fence(void)
{
#ifdef BROKEN_NO_FENCE
    atomic_signal_fence(memory_order_seq_cst);
#else
    atomic_thread_fence(memory_order_seq_cst); /* PAIR(sleep): seq_cst, both sides are here */
#endif
}

/* Sleeper: announces the sleep, to be rung once `wanted` is reached (0: by anything). After it, look again:
 * only then really sleep. Also fine while asleep: a new generation, which may be rung again. */
static inline void bell_arm(struct bell *bell, uint64_t wanted)
{
    const uint64_t generation = atomic_load_explicit(&bell->generation, memory_order_relaxed); /* own word */
    /* relaxed: PAIR(wanted) orders it before the new generation; with an older one it can ring once too much */
    atomic_store_explicit(&bell->wanted, wanted, memory_order_relaxed);
    /* PAIR(wanted): release. Who sees this generation sees what it waits for. Counterpart: bell_is_due(). */
    atomic_store_explicit(&bell->generation, (generation | 1) + (generation & 1) * 2, memory_order_release);
    bell_fence(); /* PAIR(sleep): before looking again. Counterpart: the bell_fence() ahead of bell_is_due(). */
}

/* Sleeper: awake. Relaxed: who still sees the old generation rings a bell that nobody needs. */
static inline void bell_disarm(struct bell *bell)
{
    const uint64_t generation = atomic_load_explicit(&bell->generation, memory_order_relaxed); /* own word */
    if (generation & 1)
        atomic_store_explicit(&bell->generation, generation + 1, memory_order_relaxed);
}

/* Waker, after bell_fence(): true where the sleeper must be rung now; then it is noted in *rung as done. Start
 * *rung at 0. `reached` is how far the thing has come (arrival: anything). */
static inline bool bell_is_due(const struct bell *bell, uint64_t *rung, uint64_t reached)
{
    /* PAIR(wanted): acquire. PAIR(sleep): the fence before it orders it after what was made visible. */
    const uint64_t generation = atomic_load_explicit(&bell->generation, memory_order_acquire);
    if ((generation & 1) == 0 || generation == *rung)
        return false;
    /* relaxed: a newer value belongs to a newer sleep, which looks for itself */
    if (reached < atomic_load_explicit(&bell->wanted, memory_order_relaxed))
        return false;
    *rung = generation;
    return true;
}

/* How a process has rung another one. Start with zeroes. */
struct knocks {
    uint64_t rung;  /* for this sleep */
    const void *by; /* so far by this ring alone; NULL: by several, or for anything */
};

static inline uint64_t knock_for(uint64_t slot) { return KNOCK_ONE | slot * KNOCK_SLOT; }

/* The slot for which alone was knocked, by the count of the doorbell; UINT64_MAX: by none, by several or for anything. */
static inline uint64_t knock_slot(uint64_t count)
{
    if (count / KNOCK_ONE != 1 || count % KNOCK_SLOT != 0)
        return UINT64_MAX;
    return count / KNOCK_SLOT % (KNOCK_ONE / KNOCK_SLOT);
}

/* Waker of an arrival bell, after bell_fence(): what to add to the doorbell now, `knock` at the first time in this
 * sleep; 0: nothing. Where two rings of this process have something, the sleeper must look at all. */
static inline uint64_t bell_knock(const struct bell *bell, struct knocks *knocks, const void *by, uint64_t knock)
{
    /* PAIR(sleep): the fence before it orders it after what was made visible. One load: with a second one, that would
     * see a newer sleep, this could take for rung what the sleeper does not look at. */
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
