/* Common helpers of the tests: checks that stop at once, payloads that can be verified, memory, time. */
#ifndef TESTS_NATIVE_CHECK_H
#define TESTS_NATIVE_CHECK_H

#include <inttypes.h>
#include <malloc.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#ifndef RING_LARGE
#define RING_LARGE 256u /* rings are small here, so large records begin at a small size */
#endif

#include "../../clients/bus/shm/reader.h"
#include "../../clients/bus/shm/writer.h"

/* Exit status of a test that saw a forbidden outcome; a broken build must end with it. */
#define FORBIDDEN 3
#define SKIPPED 77

#define FAIL(...)                                              \
    do {                                                       \
        fprintf(stderr, "%s:%d: ", __FILE__, __LINE__);        \
        fprintf(stderr, __VA_ARGS__);                          \
        fputc('\n', stderr);                                   \
        exit(FORBIDDEN);                                       \
    } while (0)
#define CHECK(condition)                                \
    do {                                                \
        if (!(condition))                               \
            FAIL("%s: not so: %s", __func__, #condition); \
    } while (0)
#define CHECK_EQ(left, right)                                                                                  \
    do {                                                                                                       \
        const uint64_t l_ = (uint64_t)(left), r_ = (uint64_t)(right);                                          \
        if (l_ != r_)                                                                                          \
            FAIL("%s: %s is %" PRIu64 ", not %s = %" PRIu64, __func__, #left, l_, #right, r_);                  \
    } while (0)

static inline uint64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

static inline uint64_t mix(uint64_t x)
{
    x += UINT64_C(0x9e3779b97f4a7c15);
    x = (x ^ (x >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    x = (x ^ (x >> 27)) * UINT64_C(0x94d049bb133111eb);
    return x ^ (x >> 31);
}

static inline uint64_t random_next(uint64_t *state) { return mix(*state += 0x632be59bd9b4e019u); }

/* Size of sample `seq` in a stream: mostly small, some up to `most`. */
static inline uint32_t sample_size(uint64_t seq, uint32_t most)
{
    const uint64_t r = mix(seq * 3 + 1);
    const uint32_t limit = (r & 7) == 0 ? most : (most < 200 ? most : 200);
    return (uint32_t)((r >> 8) % (limit + 1));
}

/* Every byte of a payload follows from its sequence number. */
static inline void fill(unsigned char *bytes, uint64_t seq, uint32_t size)
{
    uint64_t word = mix(seq);
    for (uint32_t i = 0; i < size; i += 8, word = word * UINT64_C(6364136223846793005) + 1442695040888963407u)
        memcpy(bytes + i, &word, size - i < 8 ? size - i : 8);
}

static inline bool is_filled(const unsigned char *bytes, uint64_t seq, uint32_t size)
{
    uint64_t word = mix(seq);
    for (uint32_t i = 0; i < size; i += 8, word = word * UINT64_C(6364136223846793005) + 1442695040888963407u)
        if (memcmp(bytes + i, &word, size - i < 8 ? size - i : 8) != 0)
            return false;
    return true;
}

/* Zeroed memory of exactly the segment's size, so that a sanitizer sees every access outside it. */
static inline void *zeroed(uint64_t bytes)
{
    void *memory = memalign(128, bytes);
    if (memory == NULL)
        FAIL("no memory");
    return memset(memory, 0, bytes);
}

static inline void *new_ring(uint64_t capacity, uint64_t index_length, uint64_t first_seq)
{
    void *memory = zeroed(ring_segment_bytes(capacity, index_length));
    ring_format(memory, capacity, index_length, first_seq);
    return memory;
}

static inline void open_reader(struct ring_reader *r, const void *memory, struct reader_slot *slot)
{
    struct ring_geometry geometry;
    const char *wrong = ring_check(memory, UINT64_MAX, &geometry);
    if (wrong != NULL)
        FAIL("%s", wrong);
    ring_reader_attach(r, memory, &geometry, slot);
}

#endif
