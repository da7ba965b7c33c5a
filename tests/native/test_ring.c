/* The ring alone, one step at a time: sizes, laps, depth, late joiners, back-pressure, growth, takeover. */
#define RING_LARGE (1u << 20) /* none: test_turn.c is about those */
#include "check.h"

enum { CAPACITY = 4096, INDEX = 64 };

static unsigned char bytes[1 << 16], got[1 << 16];

static void put(struct ring_writer *w, uint32_t size)
{
    fill(bytes, w->latest + 1, size);
    CHECK_EQ(ring_write(w, bytes, size, w->latest + 1001, 7, true), RING_OK);
}

static void take(struct ring_reader *r, uint64_t seq)
{
    struct ring_record record;
    CHECK_EQ(ring_look(r, &record), RING_OK);
    CHECK_EQ(record.seq, seq);
    CHECK_EQ(record.stamp_ns, seq + 1000);
    CHECK_EQ(record.flags, 7);
    CHECK_EQ(ring_copy_out(r, &record, got), RING_OK);
    CHECK(is_filled(got, seq, record.size));
    ring_step(r);
}

static void test_sizes(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w;
    struct ring_reader r;
    ring_writer_attach(&w, memory);
    open_reader(&r, memory, NULL);
    ring_join(&r, 0);
    CHECK_EQ(ring_poll(&r, 0), 0);
    struct ring_record record;
    CHECK_EQ(ring_look(&r, &record), RING_EMPTY);
    uint64_t seq = 0;
    for (uint32_t size = 0; size <= w.max_payload; size++) {
        put(&w, size);
        CHECK_EQ(ring_poll(&r, 0), 1);
        CHECK_EQ(ring_look(&r, &record), RING_OK);
        CHECK_EQ(record.size, size);
        take(&r, ++seq);
    }
    CHECK_EQ(w.max_payload, CAPACITY / 4 - 32);
    CHECK_EQ(ring_write(&w, bytes, (uint32_t)w.max_payload + 1, 0, 0, true), RING_TOO_LARGE);
    CHECK_EQ(ring_poll(&r, 0), 0);
    CHECK_EQ(r.overrun + r.replaced, 0);
    free(memory);
}

/* No record straddles the ring's end: the rest of a lap is skipped, and the next lap starts at the beginning. */
static void test_wrap_skips_the_tail(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w;
    struct ring_reader r;
    ring_writer_attach(&w, memory);
    open_reader(&r, memory, NULL);
    ring_join(&r, 0);
    uint64_t skipped = 0;
    for (uint64_t seq = 1; seq <= 1000; seq++) {
        const uint32_t size = (uint32_t)(mix(seq) % (w.max_payload + 1));
        const uint64_t before = w.head;
        put(&w, size);
        const uint64_t at = w.index[seq & (INDEX - 1)];
        CHECK_EQ(at % RING_ALIGN, 0);
        CHECK((at & (CAPACITY - 1)) + ring_record_bytes(size) <= CAPACITY);
        if (at != before) {
            CHECK_EQ(at & (CAPACITY - 1), 0);
            CHECK(at - before < ring_record_bytes(size));
            skipped++;
        }
        CHECK_EQ(ring_poll(&r, 0), 1);
        take(&r, seq);
    }
    CHECK(skipped > 50);
    free(memory);
}

static void test_overrun_is_counted_and_resynchronised(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w;
    struct ring_reader r;
    ring_writer_attach(&w, memory);
    open_reader(&r, memory, NULL);
    ring_join(&r, 0);
    for (int i = 0; i < 500; i++)
        put(&w, 64);
    CHECK_EQ(ring_poll(&r, 0), 500);
    struct ring_record record;
    CHECK_EQ(ring_look(&r, &record), RING_OVERRUN);
    CHECK_EQ(r.next, w.oldest);
    CHECK_EQ(r.overrun, w.oldest - 1);
    CHECK(500 - w.oldest + 1 >= CAPACITY / 128 - RING_LEAD);
    while (ring_poll(&r, 0) != 0)
        take(&r, r.next);
    CHECK_EQ(r.next, 501);

    /* lapped between head and payload: the copy is refused */
    put(&w, 64);
    CHECK_EQ(ring_poll(&r, 0), 1);
    CHECK_EQ(ring_look(&r, &record), RING_OK);
    for (int i = 0; i < 100; i++)
        put(&w, 64);
    const uint64_t before = r.overrun;
    CHECK_EQ(ring_copy_out(&r, &record, got), RING_OVERRUN);
    CHECK_EQ(r.overrun - before, w.oldest - 501);
    CHECK_EQ(ring_poll(&r, 0), 601 - w.oldest + 1);
    free(memory);
}

/* Few entries, small records: the index laps long before the bytes. */
static void test_index_laps_before_bytes(void)
{
    void *memory = new_ring(1 << 16, 16, 1);
    struct ring_writer w;
    struct ring_reader r;
    ring_writer_attach(&w, memory);
    open_reader(&r, memory, NULL);
    ring_join(&r, 0);
    for (int i = 0; i < 16; i++)
        put(&w, 8);
    CHECK_EQ(w.oldest, 1);
    put(&w, 8);
    CHECK(w.oldest >= 2);
    struct ring_record record;
    ring_poll(&r, 0);
    CHECK_EQ(ring_look(&r, &record), RING_OVERRUN);
    w.keep = 16;
    for (int i = 0; i < 1000; i++)
        put(&w, 8);
    CHECK_EQ(w.latest - w.oldest + 1, 16);
    free(memory);
}

static void test_depth_takes_the_newest(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w;
    struct ring_reader r;
    ring_writer_attach(&w, memory);
    open_reader(&r, memory, NULL);
    ring_join(&r, 0);
    for (int i = 0; i < 25; i++)
        put(&w, 8);
    CHECK_EQ(ring_poll(&r, 10), 10);
    CHECK_EQ(r.replaced, 15);
    for (uint64_t seq = 16; seq <= 25; seq++)
        take(&r, seq);
    CHECK_EQ(ring_poll(&r, 10), 0);
    CHECK_EQ(r.overrun, 0);
    free(memory);
}

static void test_late_joiner_gets_the_lesser_of_both_depths(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w;
    struct ring_reader r;
    ring_writer_attach(&w, memory);
    open_reader(&r, memory, NULL);
    ring_join(&r, 5);
    CHECK_EQ(r.next, 1);
    for (int i = 0; i < 3; i++)
        put(&w, 8);
    ring_join(&r, 5);
    CHECK_EQ(r.next, 1);
    ring_join(&r, 2);
    CHECK_EQ(r.next, 2);
    ring_join(&r, 0);
    CHECK_EQ(r.next, 4);
    w.keep = 20;
    for (int i = 0; i < 500; i++)
        put(&w, 64);
    ring_join(&r, 20);
    CHECK_EQ(r.next, 503 - 19);
    CHECK_EQ(ring_poll(&r, 0), 20);
    take(&r, 484);
    free(memory);
}

static void test_keep_is_given_up_only_by_force(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w;
    void *payload;
    ring_writer_attach(&w, memory);
    w.keep = 5;
    for (int i = 0; i < 3; i++)
        put(&w, (uint32_t)w.max_payload);
    CHECK_EQ(w.oldest, 1);
    put(&w, (uint32_t)w.max_payload);
    CHECK_EQ(ring_reserve(&w, w.max_payload, false, &payload), RING_SHORT);
    CHECK_EQ(w.oldest, 1);
    CHECK_EQ(ring_reserve(&w, w.max_payload, true, &payload), RING_OK);
    CHECK_EQ(w.oldest, 2);
    for (int i = 0; i < 400; i++) {
        put(&w, 8);
        CHECK(w.latest - w.oldest + 1 >= (w.latest < 9 ? 1 : 5));
    }
    CHECK_EQ(ring_reserve(&w, 8, false, &payload), RING_OK);
    free(memory);
}

static void test_lossless_reader_holds_its_writer_back(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct reader_slot slot = {0};
    struct ring_gate gate = {.slot = &slot, .is_lossless = true};
    struct ring_writer w;
    struct ring_reader r;
    ring_writer_attach(&w, memory);
    open_reader(&r, memory, &slot);
    ring_join(&r, 0);
    ring_tell_cursor(&r);
    w.gates.list = &gate;
    w.gates.count = 1;
    ring_gates_changed(&w);
    uint64_t rung = 0, taken = 0;
    CHECK(!ring_wait_for_room(&w)); /* no reason to wait */
    for (int round = 0; round < 50; round++) {
        enum ring_status status;
        fill(bytes, w.latest + 1, 64);
        while ((status = ring_write(&w, bytes, 64, w.latest + 1001, 7, true)) == RING_OK)
            fill(bytes, w.latest + 1, 64);
        CHECK_EQ(status, RING_FULL);
        CHECK_EQ(w.oldest, taken + 1);
        CHECK(ring_wait_for_room(&w));
        const uint64_t waiting = ring_poll(&r, 0);
        CHECK_EQ(waiting, CAPACITY / 128);
        for (uint64_t i = 0; i < waiting / 2; i++) {
            CHECK(!ring_room_is_due(&r));
            take(&r, ++taken);
            ring_tell_cursor(&r);
        }
        CHECK(ring_room_is_due(&r));
        CHECK(!ring_room_is_due(&r)); /* once for each sleep */
        CHECK(!bell_is_due(&w.header->room, &rung, 0));
        bell_disarm(&w.header->room);
        r.room_rung = 0;
        CHECK(!ring_room_is_due(&r)); /* awake */
    }
    w.gates.count = 0; /* the broker reports that the reader is gone */
    ring_gates_changed(&w);
    put(&w, 64);
    free(memory);
}

static void test_the_slowest_lossless_reader_counts(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct reader_slot slots[3] = {{.cursor = 9}, {.cursor = 3}, {.cursor = 1}};
    struct ring_gate gates[3] = {
        {.slot = &slots[0], .is_lossless = true},
        {.slot = &slots[1], .is_lossless = true},
        {.slot = &slots[2]}, /* lossy: does not hold the writer back */
    };
    struct ring_writer w;
    ring_writer_attach(&w, memory);
    w.gates.list = gates;
    w.gates.count = 3;
    CHECK_EQ(ring_taken(&w), 3);
    atomic_store(&slots[1].cursor, 12);
    CHECK_EQ(ring_taken(&w), 9);
    w.hold = 5;
    CHECK_EQ(ring_taken(&w), 5);
    free(memory);
}

static void test_growth_keeps_order(void)
{
    void *first = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w, wide;
    struct ring_reader r, late;
    ring_writer_attach(&w, first);
    open_reader(&r, first, NULL);
    ring_join(&r, 0);
    for (int i = 0; i < 200; i++)
        put(&w, 64);
    const uint64_t from = ring_carry_from(&w, 10);
    CHECK_EQ(from, 191);
    void *second = new_ring(4 * CAPACITY, INDEX, from);
    ring_writer_attach(&wide, second);
    CHECK_EQ(ring_carry(&wide, &w), RING_OK);
    CHECK(!ring_is_finished(&r));
    ring_close(&w);
    for (int i = 0; i < 5; i++)
        put(&wide, 2000);
    for (uint64_t left = ring_poll(&r, 3); left != 0; left = ring_poll(&r, 3)) {
        CHECK(!ring_is_finished(&r));
        take(&r, r.next);
    }
    CHECK(ring_is_finished(&r));
    CHECK_EQ(r.next, 201);
    open_reader(&late, second, NULL);
    ring_seek(&late, r.next);
    CHECK_EQ(ring_poll(&late, 0), 5);
    for (uint64_t seq = 201; seq <= 205; seq++)
        take(&late, seq);
    ring_join(&late, 12);
    CHECK_EQ(ring_poll(&late, 0), 12);
    for (uint64_t seq = 194; seq <= 205; seq++)
        take(&late, seq);
    CHECK_EQ(ring_carry_from(&wide, 1000), wide.oldest);
    free(first);
    free(second);
}

/* A writer that dies between reserve and publish, and between its last two stores. */
static void test_takeover(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1), *payload;
    struct ring_writer w;
    struct ring_reader r;
    ring_writer_attach(&w, memory);
    open_reader(&r, memory, NULL);
    ring_join(&r, 0);
    uint64_t taken = 0;
    for (int round = 0; round < 300; round++) {
        for (uint64_t i = 0; i < mix((uint64_t)round) % 3; i++)
            put(&w, (uint32_t)(mix(w.latest) % 900));
        CHECK_EQ(ring_reserve(&w, mix(w.latest) % (w.max_payload + 1), true, &payload), RING_OK);
        memset(payload, 0xee, 8);
        if (round % 2)
            w.header->end = w.head + w.loan;
        ring_writer_attach(&w, memory);
        while (ring_poll(&r, 0) != 0) {
            struct ring_record record;
            if (ring_look(&r, &record) == RING_OK)
                take(&r, r.next), taken++;
        }
    }
    CHECK_EQ(taken + r.overrun, w.latest);
    CHECK(taken > 100);
    free(memory);
}

static void test_bell_is_rung_once_for_each_sleep(void)
{
    struct bell bell = {0};
    uint64_t rung = 0;
    CHECK(!bell_is_due(&bell, &rung, 1));
    for (int i = 0; i < 3; i++) {
        bell_arm(&bell, 0);
        CHECK(bell_is_due(&bell, &rung, 0));
        CHECK(!bell_is_due(&bell, &rung, 0));
    }
    bell_disarm(&bell);
    bell_disarm(&bell);
    rung = 0;
    CHECK(!bell_is_due(&bell, &rung, 0));
    bell_arm(&bell, 100);
    CHECK(!bell_is_due(&bell, &rung, 99));
    CHECK(bell_is_due(&bell, &rung, 100));
}

int main(void)
{
    test_sizes();
    test_wrap_skips_the_tail();
    test_overrun_is_counted_and_resynchronised();
    test_index_laps_before_bytes();
    test_depth_takes_the_newest();
    test_late_joiner_gets_the_lesser_of_both_depths();
    test_keep_is_given_up_only_by_force();
    test_lossless_reader_holds_its_writer_back();
    test_the_slowest_lossless_reader_counts();
    test_growth_keeps_order();
    test_takeover();
    test_bell_is_rung_once_for_each_sleep();
    puts("ring: ok");
    return 0;
}
