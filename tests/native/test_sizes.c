/* Sizes of rings: a message fits, the depth fits within the limit, and no number is out of range. */
#include "check.h"
#include "../../clients/bus/shm/sizes.h"

#define MIB (UINT64_C(1) << 20)

static struct ring_sizes for_depth(uint64_t capacity, uint64_t held, uint64_t keep, uint64_t most)
{
    return ring_next_sizes(capacity, held, 0, keep, most, false, false);
}

static void test_a_first_ring_becomes_one_of_the_usual_size(void)
{
    struct ring_sizes next = for_depth(RING_FIRST_CAPACITY, 21, 10, 64 * MIB);
    CHECK_EQ(next.capacity, 65536);
    CHECK_EQ(next.index_length, 512);
    next = ring_next_sizes(RING_FIRST_CAPACITY, 21, 0, 1, 64 * MIB, true, false);
    CHECK_EQ(next.capacity, MIB);
    CHECK_EQ(next.index_length, 8192);
}

static void test_a_message_fits(void)
{
    for (uint64_t size = 1; size < 3 * MIB; size = size * 3 / 2 + 1) {
        const struct ring_sizes next = ring_next_sizes(65536, 10, size, 10, 64 * MIB, false, true);
        CHECK(size <= ring_max_payload(next.capacity));
        CHECK(ring_segment_bytes(next.capacity, next.index_length) != 0);
        CHECK(next.capacity >= 2 * 65536);
    }
    CHECK_EQ(ring_next_sizes(65536, 10, 100 * MIB, 10, 64 * MIB, false, true).capacity, 512 * MIB);
    CHECK_EQ(ring_next_sizes(65536, 10, 100 * MIB, 10, 64 * MIB, false, false).capacity, 0);
}

static void test_the_depth_fits_at_once_within_the_limit(void)
{
    CHECK_EQ(for_depth(4096, 21, 1000, 64 * MIB).capacity, 262144);
    CHECK_EQ(for_depth(4096, 21, 1000, 128 << 10).capacity, 128 << 10);
    CHECK_EQ(for_depth(4096, 64, 1000000, 64 * MIB).index_length, MIB);
    CHECK_EQ(for_depth(65536, 0, 1000, 64 * MIB).capacity, 131072);
    CHECK_EQ(for_depth(65536, 100, RING_FOR_EVER, 64 * MIB).capacity, 131072);
    CHECK_EQ(for_depth(64 * MIB, 100, 1000, 64 * MIB).capacity, 0);
    CHECK_EQ(for_depth(4096, 21, 1000, 0).capacity, 65536);
}

static void test_no_number_is_out_of_range(void)
{
    CHECK_EQ(for_depth(RING_MAX_CAPACITY / 4, 1, RING_FOR_EVER - 1, 64 * MIB).capacity, 0);
    CHECK_EQ(for_depth(65536, 1, RING_FOR_EVER - 1, 64 * MIB).capacity, 64 * MIB);
    CHECK(ring_next_sizes(65536, 1, UINT64_MAX, 1, 64 * MIB, false, true).capacity > RING_MAX_CAPACITY);
}

static void test_few_long_records(void)
{
    CHECK(ring_is_filled_by_few(4 * MIB, 64));
    CHECK(!ring_is_filled_by_few(4 * MIB, 65));
    CHECK(!ring_is_filled_by_few(8 * MIB, 1));
}

static void test_the_reserve_of_memory(void)
{
    CHECK_EQ(memory_kept(64 * MIB, 0), 8 * MIB);
    CHECK_EQ(memory_kept(512 * MIB, 0), 32 * MIB);
    CHECK_EQ(memory_kept(4096 * MIB, 0), 64 * MIB);
    CHECK_EQ(memory_kept(512 * MIB, 100 * MIB), 50 * MIB);
}

int main(void)
{
    test_a_first_ring_becomes_one_of_the_usual_size();
    test_a_message_fits();
    test_the_depth_fits_at_once_within_the_limit();
    test_no_number_is_out_of_range();
    test_few_long_records();
    test_the_reserve_of_memory();
    puts("sizes: ok");
    return 0;
}
