/* Copies between private memory and shared memory that the other side may change during the copy.
 *
 * A caller uses copied bytes only after it has validated them, so such a race is harmless by design. C11 still calls it
 * undefined between threads; it says nothing about processes. So the copies have two forms:
 * - under ThreadSanitizer: relaxed atomic words. The proof of the algorithm uses this form, too.
 * - else memcpy between compiler barriers. For the compiler, a barrier may have changed any memory, so it can neither
 *   read a second time nor move the copy. For the processor, a copy consists of plain loads and stores. The fences
 *   around it order these just as they order relaxed words. A very long copy uses streaming stores: memcpy fences them
 *   at its end, ring_give_up() before its beginning. Relaxed words are a third as fast at 4 KiB and half as fast at
 *   64 KiB (27 instead of 80 GB/s in the cache, 29 instead of 52).
 */
#ifndef BUS_SHM_COPY_H
#define BUS_SHM_COPY_H

#include <stdatomic.h>
#include <stdint.h>
#include <string.h>

#if defined(__SANITIZE_THREAD__)
#define COPY_BY_WORDS
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define COPY_BY_WORDS
#endif
#endif

typedef uint64_t __attribute__((may_alias)) shared_word;

/* Reads one shared word, which is 8-aligned. */
static inline uint64_t load_word(const void *shared)
{
    return __atomic_load_n((const shared_word *)shared, __ATOMIC_RELAXED); /* ordered by the caller's fences */
}

static inline void store_word(void *shared, uint64_t word)
{
    __atomic_store_n((shared_word *)shared, word, __ATOMIC_RELAXED); /* ordered by the caller's fences */
}

/* Copies out of shared memory. `shared` is 8-aligned; this may read up to the end of its last word. */
static inline void copy_from_shared(void *private_bytes, const void *shared, uint64_t size)
{
#ifdef COPY_BY_WORDS
    char *to = private_bytes;
    const char *from = shared;
    for (; size >= 8; size -= 8, to += 8, from += 8) {
        const uint64_t word = load_word(from);
        memcpy(to, &word, 8);
    }
    if (size != 0) {
        const uint64_t word = load_word(from);
        memcpy(to, &word, size);
    }
#else
    atomic_signal_fence(memory_order_seq_cst);
    memcpy(private_bytes, shared, size);
    atomic_signal_fence(memory_order_seq_cst);
#endif
}

/* Copies into shared memory. `shared` is 8-aligned; this may write up to the end of its last word. */
static inline void copy_to_shared(void *shared, const void *private_bytes, uint64_t size)
{
#ifdef COPY_BY_WORDS
    char *to = shared;
    const char *from = private_bytes;
    for (; size >= 8; size -= 8, to += 8, from += 8) {
        uint64_t word;
        memcpy(&word, from, 8);
        store_word(to, word);
    }
    if (size != 0) {
        uint64_t word = 0;
        memcpy(&word, from, size);
        store_word(to, word);
    }
#else
    atomic_signal_fence(memory_order_seq_cst);
    memcpy(shared, private_bytes, size);
    atomic_signal_fence(memory_order_seq_cst);
#endif
}

#endif
