/* Pins: pinned records stay, for any work of the writer; other records never block it for long. */
#include "check.h"

enum { CAPACITY = 8192, INDEX = 64, GATES = 3 };

static unsigned char bytes[CAPACITY], got[CAPACITY];
static struct reader_slot slots[GATES];
static struct ring_gate gates[GATES];

static enum ring_status put(struct ring_writer *w, uint32_t size)
{
    fill(bytes, w->latest + 1, size);
    return ring_write(w, bytes, size, 0, 0, true);
}

static struct ring_writer open_writer(void *memory, size_t gate_count)
{
    struct ring_writer w;
    memset(slots, 0, sizeof slots);
    memset(gates, 0, sizeof gates);
    ring_writer_attach(&w, memory);
    for (size_t i = 0; i < gate_count; i++)
        gates[i].slot = &slots[i];
    w.gates.list = gates;
    w.gates.count = gate_count;
    ring_gates_changed(&w);
    return w;
}

static void test_a_pinned_record_outlives_laps(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w = open_writer(memory, 1);
    struct ring_reader r;
    struct ring_record held, record;
    unsigned pin;
    open_reader(&r, memory, &slots[0]);
    ring_join(&r, 0);
    put(&w, 500);
    ring_poll(&r, 0);
    CHECK_EQ(ring_look(&r, &held), RING_OK);
    CHECK_EQ(ring_pin(&r, &held, &pin), RING_OK);
    ring_step(&r);
    for (int i = 0; i < 1000; i++) {
        CHECK_EQ(put(&w, (uint32_t)(mix((uint64_t)i) % 1000)), RING_OK);
        CHECK(is_filled(held.payload, 1, 500));
        ring_poll(&r, 1);
        CHECK_EQ(ring_look(&r, &record), RING_OK);
        CHECK_EQ(ring_copy_out(&r, &record, got), RING_OK);
        CHECK(is_filled(got, w.latest, record.size));
        ring_step(&r);
    }
    CHECK_EQ(w.gates.hole_count, 1);
    ring_unpin(&slots[0], pin);
    for (int i = 0; i < 20; i++)
        put(&w, 1000);
    CHECK_EQ(w.gates.hole_count, 0);
    CHECK(!is_filled(held.payload, 1, 500));
    free(memory);
}

static void test_a_pin_that_comes_too_late_is_refused(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w = open_writer(memory, 1);
    struct ring_reader r;
    struct ring_record record;
    unsigned pin;
    open_reader(&r, memory, &slots[0]);
    ring_join(&r, 0);
    put(&w, 500);
    ring_poll(&r, 0);
    CHECK_EQ(ring_look(&r, &record), RING_OK);
    for (int i = 0; i < 100; i++)
        put(&w, 500);
    CHECK_EQ(ring_pin(&r, &record, &pin), RING_OVERRUN);
    CHECK_EQ(r.overrun, w.oldest - 1);
    for (unsigned i = 0; i < READER_PINS; i++)
        CHECK_EQ(slots[0].pins[i], 0);
    free(memory);
}

/* Two readers that never come back pin as many records as fit. The writer gets RING_PINNED, does not wait, and
 * continues when their gates are removed. */
static void test_pins_may_fill_the_ring(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w = open_writer(memory, 2);
    struct ring_reader readers[2];
    struct ring_record record;
    unsigned pin;
    for (int i = 0; i < 2; i++) {
        open_reader(&readers[i], memory, &slots[i]);
        ring_join(&readers[i], 0);
    }
    int held = 0;
    for (int round = 0; round < 8; round++) {
        CHECK_EQ(put(&w, 900), RING_OK);
        struct ring_reader *r = &readers[round % 2];
        ring_poll(r, 1);
        CHECK_EQ(ring_look(r, &record), RING_OK);
        held += ring_pin(r, &record, &pin) == RING_OK;
        ring_step(r);
    }
    CHECK_EQ(held, 8);
    void *payload;
    CHECK_EQ(ring_reserve(&w, 900, true, &payload), RING_PINNED);
    CHECK_EQ(ring_reserve(&w, 10, true, &payload), RING_OK); /* 8 * 960 bytes leave a little room */
    CHECK_EQ(ring_reserve(&w, 900, true, &payload), RING_PINNED);
    w.gates.count = 1;
    ring_gates_changed(&w);
    CHECK_EQ(put(&w, 900), RING_OK);
    free(memory);
}

static void test_all_pins_in_use(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w = open_writer(memory, 1);
    struct ring_reader r;
    struct ring_record record;
    unsigned pin;
    open_reader(&r, memory, &slots[0]);
    ring_join(&r, 0);
    for (unsigned i = 0; i <= READER_PINS; i++) {
        put(&w, 8);
        ring_poll(&r, 0);
        CHECK_EQ(ring_look(&r, &record), RING_OK);
        CHECK_EQ(ring_pin(&r, &record, &pin), i < READER_PINS ? RING_OK : RING_PINNED);
        if (i < READER_PINS)
            ring_step(&r);
    }
    ring_unpin(&slots[0], 3);
    CHECK_EQ(ring_pin(&r, &record, &pin), RING_OK);
    CHECK_EQ(pin, 3);
    free(memory);
}

/* Random writers and readers, compared with a simple model: every record in [oldest, latest] reads as written, pinned
 * records stay, a lossless reader loses nothing, and every record is counted. */
static void test_random_histories(uint64_t seed)
{
    static const unsigned char *held[GATES][READER_PINS];
    static uint32_t held_size[GATES][READER_PINS];
    static uint32_t sizes[1 << 16];
    memset(held, 0, sizeof held);
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w = open_writer(memory, GATES);
    gates[2].is_lossless = true;
    w.keep = 1 + mix(seed) % 4;
    struct ring_reader r[GATES];
    uint64_t taken[GATES] = {0}, refused = 0, state = seed;
    for (int i = 0; i < GATES; i++) {
        open_reader(&r[i], memory, &slots[i]);
        ring_join(&r[i], 0);
        ring_tell_cursor(&r[i]);
    }
    ring_gates_changed(&w);
    for (int step = 0; step < 20000; step++) {
        const uint64_t dice = random_next(&state);
        if (dice % 4 == 0) {
            const uint32_t size = (uint32_t)((dice >> 8) % ((dice & 16) ? 200 : 1500));
            const enum ring_status status = put(&w, size);
            CHECK(status == RING_OK || status == RING_FULL || status == RING_PINNED);
            if (status == RING_OK)
                sizes[w.latest] = size;
            refused += status != RING_OK;
            CHECK(w.latest + 1 - w.oldest <= INDEX && w.oldest <= w.latest + 1);
            continue;
        }
        const size_t who = (dice >> 4) % GATES;
        const unsigned j = (unsigned)((dice >> 8) % READER_PINS);
        if (held[who][j] != NULL) {
            CHECK(is_filled(held[who][j], slots[who].pins[j], held_size[who][j]));
            if (dice % 4 == 1) {
                ring_unpin(&slots[who], j);
                held[who][j] = NULL;
            }
            continue;
        }
        struct ring_record record;
        unsigned pin;
        if (dice % 3 != 0)
            ring_poll(&r[who], who == 1 ? 5 : 0);
        enum ring_status status = ring_look(&r[who], &record);
        CHECK(status != RING_CORRUPT && (who != 2 || status != RING_OVERRUN));
        if (status != RING_OK)
            continue;
        CHECK_EQ(record.size, sizes[record.seq]);
        if ((dice >> 20) % 2 == 0 && (status = ring_pin(&r[who], &record, &pin)) == RING_OK) {
            CHECK(held[who][pin] == NULL);
            held[who][pin] = record.payload;
            held_size[who][pin] = record.size;
        } else {
            CHECK_EQ(ring_copy_out(&r[who], &record, got), RING_OK);
            CHECK(is_filled(got, record.seq, record.size));
        }
        ring_step(&r[who]);
        taken[who]++;
        ring_tell_cursor(&r[who]);
    }
    for (int i = 0; i < GATES; i++) {
        CHECK_EQ(taken[i] + r[i].overrun + r[i].replaced, r[i].next - 1);
        CHECK(taken[i] > 10);
        for (unsigned j = 0; j < READER_PINS; j++)
            if (held[i][j] != NULL)
                CHECK(is_filled(held[i][j], slots[i].pins[j], held_size[i][j]));
    }
    CHECK_EQ(r[2].overrun + r[2].replaced, 0);
    CHECK(refused > 0);
    struct ring_reader check;
    open_reader(&check, memory, NULL);
    ring_join(&check, UINT64_MAX);
    CHECK_EQ(check.next, w.oldest);
    while (ring_poll(&check, 0) != 0) {
        struct ring_record record;
        CHECK_EQ(ring_look(&check, &record), RING_OK);
        CHECK(is_filled(record.payload, record.seq, sizes[record.seq]));
        ring_step(&check);
    }
    free(memory);
}

int main(void)
{
    test_a_pinned_record_outlives_laps();
    test_a_pin_that_comes_too_late_is_refused();
    test_pins_may_fill_the_ring();
    test_all_pins_in_use();
    for (uint64_t seed = 1; seed <= 100; seed++)
        test_random_histories(seed);
    puts("pins: ok");
    return 0;
}
