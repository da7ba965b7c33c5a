/* Large records turn back to the start of the ring: the conditions, the obstacles, and the use of all room. */
#include "check.h"

enum { CAPACITY = 16384, INDEX = 128, LARGE = 1024 - RING_HEAD_BYTES, SMALL = 64 - RING_HEAD_BYTES, MOST = 1 << 16 };

static unsigned char bytes[CAPACITY];
static uint32_t sizes[MOST];
static uint64_t turns, leaps;

struct ring {
    void *memory;
    struct ring_writer w;
    struct ring_gate gate;
    struct reader_slot slot;
};

/* Makes a ring with one reader's gate. */
static void open_ring(struct ring *ring, uint64_t keep, bool is_lossless)
{
    *ring = (struct ring){.memory = new_ring(CAPACITY, INDEX, 1)};
    ring_writer_attach(&ring->w, ring->memory);
    ring->gate = (struct ring_gate){.slot = &ring->slot, .is_lossless = is_lossless};
    ring->w.gates.list = &ring->gate;
    ring->w.gates.count = 1;
    ring->w.keep = keep;
    atomic_store(&ring->slot.cursor, 1);
    ring_gates_changed(&ring->w);
}

static void close_ring(struct ring *ring) { free(ring->memory); }

static enum ring_status put(struct ring *ring, uint32_t size)
{
    const uint64_t seq = ring->w.latest + 1;
    fill(bytes, seq, size);
    sizes[seq % MOST] = size;
    return ring_write(&ring->w, bytes, size, 0, 0, false);
}

static uint64_t place_of(const struct ring *ring, uint64_t seq)
{
    return ring_position(&ring->w, seq) & (CAPACITY - 1);
}

static void take_all(struct ring *ring) { atomic_store(&ring->slot.cursor, ring->w.latest + 1); }

/* Checks that all remaining records read as written. */
static void check_all(const struct ring *ring)
{
    struct ring_reader r;
    open_reader(&r, ring->memory, NULL);
    ring_join(&r, UINT64_MAX);
    CHECK_EQ(r.next, ring->w.oldest);
    while (ring_poll(&r, 0) != 0) {
        struct ring_record record;
        CHECK_EQ(ring_look(&r, &record), RING_OK);
        CHECK_EQ(record.size, sizes[record.seq % MOST]);
        CHECK(is_filled(record.payload, record.seq, record.size));
        ring_step(&r);
    }
}

/* The part of the ring that `count` records of size LARGE use, after it has been in use for a while. */
static uint64_t used_by(struct ring *ring, unsigned count)
{
    uint64_t most = 0;
    for (unsigned i = 0; i < count; i++) {
        CHECK_EQ(put(ring, LARGE), RING_OK);
        check_all(ring);
        const uint64_t end = place_of(ring, ring->w.latest) + 1024;
        most = end > most ? end : most;
    }
    return most;
}

static void test_large_records_use_the_start_only(void)
{
    for (uint64_t keep = 1; keep <= 4; keep++) {
        struct ring ring;
        open_ring(&ring, keep, false);
        CHECK_EQ(used_by(&ring, 1000), (keep + 1 > RING_ROUND ? keep + 1 : RING_ROUND) * 1024);
        CHECK(ring.w.latest - ring.w.oldest + 1 >= keep);
        close_ring(&ring);
    }
}

static void test_small_records_use_all(void)
{
    struct ring ring;
    open_ring(&ring, 1, false);
    for (int i = 0; i < CAPACITY / 64; i++)
        CHECK_EQ(put(&ring, SMALL), RING_OK);
    CHECK_EQ(place_of(&ring, ring.w.latest), CAPACITY - 64);
    close_ring(&ring);
}

/* If the depth needs more than a quarter of the ring, the ring does not turn back. */
static void test_a_great_depth_uses_all(void)
{
    for (uint64_t keep = 5; keep <= 15; keep++) {
        struct ring ring;
        open_ring(&ring, keep, false);
        CHECK_EQ(used_by(&ring, 1000), CAPACITY);
        CHECK(ring.w.latest - ring.w.oldest + 1 >= keep);
        close_ring(&ring);
    }
}

/* With a history, all records stay. */
static void test_a_history_stays(void)
{
    struct ring ring;
    open_ring(&ring, UINT64_C(1) << 60, false);
    for (int i = 0; i < CAPACITY / 1024; i++)
        CHECK_EQ(put(&ring, LARGE), RING_OK);
    CHECK_EQ(put(&ring, LARGE), RING_SHORT);
    CHECK_EQ(ring.w.oldest, 1);
    check_all(&ring);
    close_ring(&ring);
}

static void test_a_lossless_reader_that_keeps_up(void)
{
    struct ring ring;
    open_ring(&ring, 1, true);
    uint64_t most = 0;
    for (int i = 0; i < 1000; i++) {
        CHECK_EQ(put(&ring, LARGE), RING_OK);
        check_all(&ring);
        take_all(&ring);
        most = place_of(&ring, ring.w.latest) > most ? place_of(&ring, ring.w.latest) : most;
    }
    CHECK_EQ(most, 2 * 1024);
    close_ring(&ring);
}

/* Whenever the reader stops, at least as many records fit as without turning back, except for an island. */
static void test_the_window_of_a_lossless_reader(void)
{
    for (uint64_t before = 0; before < 64; before++) {
        for (uint64_t behind = 0; behind < 6; behind++) {
            struct ring ring;
            open_ring(&ring, 1, true);
            for (uint64_t i = 0; i < before; i++) {
                CHECK_EQ(put(&ring, LARGE), RING_OK);
                if (ring.w.latest > behind)
                    atomic_store(&ring.slot.cursor, ring.w.latest + 1 - behind);
            }
            const uint64_t first = atomic_load(&ring.slot.cursor);
            while (put(&ring, LARGE) == RING_OK)
                check_all(&ring);
            CHECK_EQ(put(&ring, LARGE), RING_FULL);
            CHECK_EQ(put(&ring, SMALL), RING_FULL);
            CHECK(ring.w.oldest <= first);
            CHECK(ring.w.latest + 1 - first == CAPACITY / 1024);
            check_all(&ring);
            take_all(&ring);
            for (int i = 0; i < 3; i++)
                CHECK_EQ(put(&ring, LARGE), RING_OK);
            check_all(&ring);
            close_ring(&ring);
        }
    }
}

static void test_hold_stands_in_the_way(void)
{
    struct ring ring;
    open_ring(&ring, 1, false);
    ring.w.hold = 2;
    ring.w.floor = 0;
    for (int i = 0; i < CAPACITY / 1024; i++)
        CHECK_EQ(put(&ring, LARGE), RING_OK);
    CHECK_EQ(put(&ring, LARGE), RING_OK); /* for the first */
    CHECK_EQ(put(&ring, LARGE), RING_FULL);
    check_all(&ring);
    ring.w.hold = UINT64_MAX;
    ring.w.floor = 0;
    CHECK_EQ(used_by(&ring, 100), 3 * 1024);
    close_ring(&ring);
}

/* The depth was small and becomes larger: it can use the whole ring. */
static void test_a_depth_that_grows(void)
{
    for (unsigned before = 0; before < 40; before++) {
        struct ring ring;
        open_ring(&ring, 1, false);
        for (unsigned i = 0; i < before; i++)
            CHECK_EQ(put(&ring, LARGE), RING_OK);
        const uint64_t kept = ring.w.latest;
        ring.w.keep = 12;
        for (unsigned i = 0; i < 100; i++) {
            CHECK_EQ(put(&ring, LARGE), RING_OK);
            check_all(&ring);
            const uint64_t there = ring.w.latest + 1 - ring.w.oldest, new = ring.w.latest - kept;
            CHECK(there >= (new < 12 ? new : 12));
        }
        close_ring(&ring);
    }
}

/* The writer steps over pinned records, which stay in their places for several laps. */
static void test_pins_stand_in_the_way(void)
{
    for (unsigned first = 1; first < 6; first++) {
        struct ring ring;
        struct ring_reader r;
        struct ring_record record[READER_PINS];
        unsigned pin;
        open_ring(&ring, 1, false);
        open_reader(&r, ring.memory, &ring.slot);
        ring_join(&r, 0);
        for (unsigned i = 0; i < first + READER_PINS; i++) {
            CHECK_EQ(put(&ring, LARGE), RING_OK);
            ring_poll(&r, 1);
            if (i < first)
                continue;
            CHECK_EQ(ring_look(&r, &record[i - first]), RING_OK);
            CHECK_EQ(ring_pin(&r, &record[i - first], &pin), RING_OK);
        }
        for (unsigned i = 0; i < 200; i++) {
            CHECK_EQ(put(&ring, LARGE), RING_OK);
            check_all(&ring);
            for (unsigned j = 0; j < READER_PINS; j++)
                CHECK(is_filled(record[j].payload, record[j].seq, LARGE));
        }
        for (unsigned j = 0; j < READER_PINS; j++)
            ring_unpin(&ring.slot, j);
        used_by(&ring, 20);
        CHECK_EQ(used_by(&ring, 100), 3 * 1024);
        close_ring(&ring);
    }
}

/* All records carried to a larger ring exist there. */
static void test_carried_records_do_not_turn_back(void)
{
    struct ring ring;
    open_ring(&ring, 12, false);
    for (int i = 0; i < 40; i++)
        CHECK_EQ(put(&ring, LARGE), RING_OK);
    const uint64_t from = ring_carry_from(&ring.w, 12);
    void *memory = new_ring(2 * CAPACITY, INDEX, from);
    struct ring_writer wide;
    ring_writer_attach(&wide, memory);
    CHECK_EQ(ring_carry(&wide, &ring.w), RING_OK);
    CHECK_EQ(wide.oldest, from);
    CHECK_EQ(wide.latest, 40);
    CHECK_EQ(wide.keep, 1);
    free(memory);
    close_ring(&ring);
}

/* A loan is taken back, and a writer dies at any point after it has turned back. */
static void test_takeover(void)
{
    struct ring ring;
    void *payload;
    open_ring(&ring, 1, false);
    for (int i = 0; i < 1000; i++) {
        CHECK_EQ(ring_reserve(&ring.w, LARGE, false, &payload), RING_OK);
        memset(payload, 0xee, LARGE);
        check_all(&ring);
        if (i % 5 == 0) {
            ring_writer_attach(&ring.w, ring.memory);
            check_all(&ring);
        }
        CHECK_EQ(put(&ring, LARGE), RING_OK);
        check_all(&ring);
    }
    close_ring(&ring);
}

/* Any sizes, depths, holds, cursors and pins: remaining records are whole, needed records remain, and there is room
 * while the needed records take less than half of the ring. */
static void test_random_histories(uint64_t seed)
{
    struct ring ring;
    struct ring_reader r;
    struct ring_record held[READER_PINS];
    uint64_t state = seed;
    const uint32_t most = seed % 2 == 0 ? 800 : CAPACITY / 4 - RING_HEAD_BYTES;
    const bool is_lossless = seed % 3 == 0;
    bool is_held[READER_PINS] = {false};
    open_ring(&ring, 1 + seed % 5, is_lossless);
    open_reader(&r, ring.memory, &ring.slot);
    ring_join(&r, 0);
    for (int step = 0; step < 3000; step++) {
        const uint64_t dice = random_next(&state);
        const unsigned which = (unsigned)(dice >> 8) % READER_PINS;
        if (dice % 4 != 0) {
            const uint32_t size = (uint32_t)((dice >> 16) % (most + 1));
            uint64_t needed = ring.w.latest + 2 > ring.w.keep ? ring.w.latest + 2 - ring.w.keep : 1, there = 0;
            const uint64_t taken = ring_taken(&ring.w), before = ring.w.oldest, turn = ring.w.turn, island = ring.w.island;
            needed = taken < needed ? taken : needed;
            for (uint64_t seq = needed > before ? needed : before; seq <= ring.w.latest; seq++)
                there += ring_record_bytes(sizes[seq % MOST]);
            const enum ring_status status = put(&ring, size);
            turns += ring.w.turn != turn;
            leaps += ring.w.island != island;
            CHECK(ring.w.oldest <= (needed > before ? needed : before));
            if (status == RING_SHORT || status == RING_FULL)
                CHECK(seed % 2 == 1 || seed % 4 == 2 || there > CAPACITY / 2);
            check_all(&ring);
        } else if (is_held[which]) {
            CHECK(is_filled(held[which].payload, held[which].seq, held[which].size));
            ring_unpin(&ring.slot, which);
            is_held[which] = false;
        } else if (dice % 32 == 0) {
            ring.w.hold = dice % 64 == 0 ? ring.w.latest + 1 - (dice >> 32) % 3 : UINT64_MAX;
            ring.w.hold = ring.w.hold == 0 ? 1 : ring.w.hold;
            ring.w.floor = 0;
        } else if (dice % 32 == 4 && seed % 4 == 1) {
            ring.w.keep = 1 + (dice >> 32) % 8;
        } else if (ring_poll(&r, is_lossless ? 0 : 4) != 0 && ring_look(&r, &held[which]) == RING_OK) {
            unsigned pin;
            if (seed % 4 >= 2 && ring_pin(&r, &held[which], &pin) == RING_OK) {
                held[pin] = held[which];
                is_held[pin] = true;
            }
            ring_step(&r);
            ring_tell_cursor(&r);
        }
        for (unsigned i = 0; i < READER_PINS; i++)
            if (is_held[i])
                CHECK(is_filled(held[i].payload, held[i].seq, held[i].size));
    }
    CHECK(!is_lossless || r.overrun == 0);
    close_ring(&ring);
}

int main(void)
{
    test_large_records_use_the_start_only();
    test_small_records_use_all();
    test_a_great_depth_uses_all();
    test_a_history_stays();
    test_a_lossless_reader_that_keeps_up();
    test_the_window_of_a_lossless_reader();
    test_hold_stands_in_the_way();
    test_a_depth_that_grows();
    test_pins_stand_in_the_way();
    test_carried_records_do_not_turn_back();
    test_takeover();
    for (uint64_t seed = 1; seed <= 100; seed++)
        test_random_histories(seed);
    CHECK(turns > 1000 && leaps > 100);
    puts("turn: ok");
    return 0;
}
