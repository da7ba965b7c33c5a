/* Foreign segments: the checks name the fault of a segment, and a ring with later changes does no harm. */
#include "check.h"

enum { CAPACITY = 4096, INDEX = 64, HEADER_WORDS = sizeof(struct ring_header) / 8 };

static unsigned char got[CAPACITY];

static void test_geometry_is_checked(void)
{
    struct ring_geometry geometry;
    const uint64_t size = ring_segment_bytes(CAPACITY, INDEX);
    CHECK_EQ(size, 640 + 64 * 8 + 4096);
    unsigned char *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_header *header = (struct ring_header *)memory;
    CHECK(ring_check(memory, size, &geometry) == NULL);
    CHECK(ring_check(memory, size - 1, &geometry) != NULL);
    CHECK(ring_check(memory, 639, &geometry) != NULL);
    const struct ring_geometry good = header->geometry;
#define REFUSED(field, value)                              \
    header->geometry = good;                               \
    header->geometry.field = (value);                      \
    CHECK(ring_check(memory, size, &geometry) != NULL)
    REFUSED(magic, 0);
    REFUSED(version, SHM_VERSION + 1);
    REFUSED(header_bytes, 64);
    REFUSED(segment_bytes, size + 1);
    REFUSED(capacity, 2 * CAPACITY);
    REFUSED(capacity, CAPACITY + 64);
    REFUSED(capacity, 0);
    REFUSED(capacity, UINT64_C(1) << 63);
    REFUSED(index_length, 2 * INDEX);
    REFUSED(index_length, 0);
    REFUSED(index_length, UINT64_C(1) << 63);
    REFUSED(index_offset, 0);
    REFUSED(data_offset, 640);
    REFUSED(first_seq, 0);
    header->geometry = good;
    CHECK(ring_check(memory, size, &geometry) == NULL);
    free(memory);

    struct readers_geometry readers;
    const uint64_t readers_size = readers_segment_bytes(3);
    memory = zeroed(readers_size);
    readers_format(memory, 3);
    CHECK(readers_check(memory, readers_size, &readers) == NULL);
    CHECK(readers_check(memory, readers_size - 1, &readers) != NULL);
    ((struct readers_header *)memory)->geometry.slot_count = 4;
    CHECK(readers_check(memory, readers_size, &readers) != NULL);
    ((struct readers_header *)memory)->geometry.slot_count = UINT64_MAX / 64 + 2;
    CHECK(readers_check(memory, readers_size, &readers) != NULL);
    free(memory);
}

static void test_a_lying_ring_is_survived(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w;
    uint64_t state = 5, corrupt = 0;
    for (int round = 0; round < 20000; round++) {
        ring_format(memory, CAPACITY, INDEX, 1);
        struct ring_reader r;
        open_reader(&r, memory, NULL);
        ring_join(&r, 0);
        ring_writer_attach(&w, memory);
        for (int i = 0; i < 3; i++)
            CHECK_EQ(ring_write(&w, got, 100, 0, 0, true), RING_OK);
        uint64_t *words = memory; /* any word may be false: header, index, the first records */
        for (int i = 0; i < 40; i++) {
            const uint64_t at = random_next(&state) % (i < 20 ? HEADER_WORDS + INDEX + 60 : HEADER_WORDS + 8);
            words[at] = i % 3 == 0 ? random_next(&state) : i % 3 == 1 ? random_next(&state) % 9000 : words[at] + 64;
        }
        for (int i = 0; i < 10; i++) {
            struct ring_record record;
            ring_poll(&r, round % 2 ? 10 : 0);
            const enum ring_status status = ring_look(&r, &record);
            corrupt += status == RING_CORRUPT;
            if (status == RING_OK)
                ring_copy_out(&r, &record, got);
            ring_step(&r);
        }
    }
    CHECK(corrupt > 100);
    free(memory);
}

int main(void)
{
    test_geometry_is_checked();
    test_a_lying_ring_is_survived();
    puts("layout: ok");
    return 0;
}
