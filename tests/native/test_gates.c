/* Gates: matches that hold the writer back, admitted readers, and doorbells that are rung. */
#include "check.h"

#include "../../clients/bus/shm/gates.h"

enum { CAPACITY = 4096, INDEX = 64, SLOTS = 40, MOST_RUNG = 8 };

/* A process, with its readers' segment. */
struct neighbour {
    struct readers_header *segment;
    struct reading_process process;
};

static struct {
    int doorbell;
    uint64_t knock;
} rung[MOST_RUNG];
static size_t rung_count;

static void note(int doorbell, uint64_t knock)
{
    CHECK(rung_count < MOST_RUNG);
    rung[rung_count].doorbell = doorbell;
    rung[rung_count++].knock = knock;
}

static uint64_t ring_all(const struct ring_writer *w, bool is_for_any)
{
    rung_count = 0;
    const uint64_t count = gates_ring(&w->gates, is_for_any, note);
    CHECK_EQ(count, rung_count);
    return count;
}

static struct neighbour new_neighbour(int doorbell)
{
    struct neighbour one = {.segment = zeroed(readers_segment_bytes(SLOTS))};
    readers_format(one.segment, SLOTS);
    one.process = (struct reading_process){
        .arrival = &one.segment->arrival,
        .slots = readers_slots(one.segment),
        .slot_count = SLOTS,
        .doorbell = doorbell,
    };
    return one;
}

static struct reader_slot *slot_of(const struct neighbour *one, uint64_t number)
{
    return &readers_slots(one->segment)[number];
}

static enum ring_status put(struct ring_writer *w, uint32_t size)
{
    static unsigned char bytes[CAPACITY];
    fill(bytes, w->latest + 1, size);
    return ring_write(w, bytes, size, 0, 0, true);
}

static void end(struct ring_writer *w, void *memory)
{
    while (w->gates.count != 0)
        ring_remove_gate(w, &w->gates.list[0]);
    gates_free(&w->gates);
    free(memory);
}

static void test_come_and_go(void)
{
    struct neighbour a = new_neighbour(1), b = new_neighbour(2);
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w;
    ring_writer_attach(&w, memory);
    CHECK(gates_find(&w.gates, 0) == NULL);
    for (uint64_t key = 0; key < 30; key++)
        CHECK(ring_add_gate(&w, key, key % 2 ? &a.process : &b.process, key, false));
    CHECK_EQ(w.gates.count, 30);
    CHECK_EQ(w.gates.bell_count, 2);
    CHECK_EQ(a.process.gates, 15);
    for (uint64_t key = 0; key < 30; key++) {
        const struct ring_gate *gate = gates_find(&w.gates, key);
        CHECK(gate != NULL && gate->key == key);
        CHECK(gate->slot == slot_of(key % 2 ? &a : &b, key));
    }
    for (uint64_t key = 1; key < 30; key += 2)
        CHECK(ring_remove_gate(&w, gates_find(&w.gates, key)) == &a.process);
    CHECK_EQ(w.gates.count, 15);
    CHECK_EQ(w.gates.bell_count, 1);
    CHECK_EQ(a.process.gates, 0);
    CHECK(gates_find(&w.gates, 1) == NULL);
    CHECK(ring_add_gate(&w, 2, &a.process, 7, true)); /* another slot instead of the earlier one */
    CHECK_EQ(w.gates.count, 15);
    CHECK_EQ(a.process.gates, 1);
    CHECK_EQ(b.process.gates, 14);
    CHECK(gates_find(&w.gates, 2)->slot == slot_of(&a, 7));
    end(&w, memory);
    CHECK_EQ(b.process.gates, 0);
    free(a.segment);
    free(b.segment);
}

static void test_a_lossless_one_holds_back_until_it_is_lossy_or_gone(void)
{
    struct neighbour a = new_neighbour(1);
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w;
    ring_writer_attach(&w, memory);
    atomic_store(&slot_of(&a, 3)->cursor, 1);
    CHECK(ring_add_gate(&w, 5, &a.process, 3, true));
    enum ring_status status;
    while ((status = put(&w, 100)) == RING_OK)
        ;
    CHECK_EQ(status, RING_FULL);
    CHECK_EQ(w.oldest, 1);
    CHECK_EQ(gates_taken(&w.gates, UINT64_MAX), 1);
    ring_make_lossy(&w, gates_find(&w.gates, 5));
    CHECK_EQ(gates_taken(&w.gates, 77), 77);
    CHECK_EQ(put(&w, 100), RING_OK);
    CHECK(ring_add_gate(&w, 5, &a.process, 3, true));
    atomic_store(&slot_of(&a, 3)->cursor, w.oldest);
    while ((status = put(&w, 100)) == RING_OK)
        ;
    CHECK_EQ(status, RING_FULL);
    ring_remove_gate(&w, gates_find(&w.gates, 5));
    CHECK_EQ(put(&w, 100), RING_OK);
    end(&w, memory);
    free(a.segment);
}

static bool is_shown(const struct ring_writer *w, uint32_t ticket)
{
    for (unsigned i = 0; i < RING_ADMITTED; i++)
        if (atomic_load(&w->header->admitted[i]) == ticket)
            return true;
    return false;
}

/* A reader that asks is admitted with its gate. A ticket does not count as a pin. */
static void test_tickets(void)
{
    struct neighbour a = new_neighbour(1);
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w;
    ring_writer_attach(&w, memory);
    ring_ask(slot_of(&a, 0), 1234);
    CHECK(!is_shown(&w, 1234));
    CHECK(ring_add_gate(&w, 1, &a.process, 0, false));
    CHECK(is_shown(&w, 1234));
    CHECK(!gate_has_pins(gates_find(&w.gates, 1)));
    for (uint32_t other = 0; other < RING_ADMITTED - 1; other++) {
        ring_ask(slot_of(&a, 1), 2000 + other);
        CHECK(ring_add_gate(&w, 2, &a.process, 1, false));
        CHECK(is_shown(&w, 2000 + other) && is_shown(&w, 1234));
    }
    CHECK(ring_add_gate(&w, 3, &a.process, 2, false)); /* it does not ask, so no ticket is shown */
    CHECK(is_shown(&w, 1234));
    ring_ask(slot_of(&a, 1), 99);
    CHECK(ring_add_gate(&w, 2, &a.process, 1, false));
    CHECK(is_shown(&w, 99) && !is_shown(&w, 1234));
    atomic_store(&slot_of(&a, 0)->pins[0], 17);
    CHECK(gate_has_pins(gates_find(&w.gates, 1)));
    end(&w, memory);
    free(a.segment);
}

/* If a gate is replaced for the same slot, the writer still steps over its pinned records; for another slot it does
 * not. */
static void test_holes_stay_with_their_slot(void)
{
    struct neighbour a = new_neighbour(1);
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w;
    struct ring_reader r;
    struct ring_record held;
    unsigned pin;
    ring_writer_attach(&w, memory);
    CHECK(ring_add_gate(&w, 1, &a.process, 0, false));
    open_reader(&r, memory, slot_of(&a, 0));
    ring_join(&r, 0);
    CHECK_EQ(put(&w, 200), RING_OK);
    CHECK_EQ(ring_poll(&r, 0), 1);
    CHECK_EQ(ring_look(&r, &held), RING_OK);
    CHECK_EQ(ring_pin(&r, &held, &pin), RING_OK);
    for (int i = 0; i < 100; i++)
        CHECK_EQ(put(&w, 200), RING_OK);
    CHECK_EQ(w.gates.hole_count, 1);
    CHECK(ring_add_gate(&w, 1, &a.process, 0, true));
    ring_make_lossy(&w, gates_find(&w.gates, 1));
    CHECK_EQ(w.gates.hole_count, 1);
    for (int i = 0; i < 100; i++) {
        CHECK_EQ(put(&w, 200), RING_OK);
        CHECK(is_filled(held.payload, 1, 200));
    }
    CHECK(ring_add_gate(&w, 1, &a.process, 1, false));
    CHECK_EQ(w.gates.hole_count, 0);
    for (int i = 0; i < 100; i++)
        CHECK_EQ(put(&w, 200), RING_OK);
    CHECK(!is_filled(held.payload, 1, 200));
    end(&w, memory);
    free(a.segment);
}

/* The gates move to another ring, without the holes. Depth and hold move, too. */
static void test_they_go_on_in_another_ring(void)
{
    struct neighbour a = new_neighbour(1);
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w, fresh;
    struct ring_reader r;
    struct ring_record held;
    unsigned pin;
    ring_writer_attach(&w, memory);
    w.keep = 3;
    CHECK(ring_add_gate(&w, 1, &a.process, 0, true));
    open_reader(&r, memory, slot_of(&a, 0));
    ring_join(&r, 0);
    CHECK_EQ(put(&w, 200), RING_OK);
    ring_poll(&r, 0);
    CHECK_EQ(ring_look(&r, &held), RING_OK);
    CHECK_EQ(ring_pin(&r, &held, &pin), RING_OK);
    atomic_store(&slot_of(&a, 0)->cursor, 1000);
    for (int i = 0; i < 100; i++)
        CHECK_EQ(put(&w, 200), RING_OK);
    CHECK_EQ(w.gates.hole_count, 1);
    w.hold = 150;
    void *wider = new_ring(2 * CAPACITY, INDEX, ring_carry_from(&w, 3));
    ring_writer_attach(&fresh, wider);
    CHECK_EQ(ring_carry(&fresh, &w), RING_OK);
    struct ring_header *before = w.header;
    bell_arm(&before->room, 1);
    ring_go_on(&w, &fresh);
    CHECK_EQ(before->closed, 1);
    CHECK_EQ(before->room.generation % 2, 0);
    CHECK_EQ(w.latest, 101);
    CHECK_EQ(w.keep, 3);
    CHECK_EQ(w.hold, 150);
    CHECK_EQ(w.gates.hole_count, 0);
    CHECK_EQ(gates_find(&w.gates, 1)->is_lossless, 1);
    for (int i = 0; i < 150; i++)
        put(&w, 200);
    CHECK_EQ(put(&w, 200), RING_FULL); /* because of hold */
    CHECK_EQ(w.gates.hole_count, 0);
    CHECK(is_filled(held.payload, 1, 200));
    end(&w, memory);
    free(wider);
    free(a.segment);
}

/* One gate in a process: one ring for each sleep. The number names a slot only if the process has many rings. */
static void test_each_process_is_rung_once_for_a_sleep(void)
{
    struct neighbour a = new_neighbour(11), b = new_neighbour(12);
    void *memory = new_ring(CAPACITY, INDEX, 1), *second = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w, other;
    ring_writer_attach(&w, memory);
    ring_writer_attach(&other, second);
    CHECK(ring_add_gate(&w, 1, &a.process, 4, false));
    CHECK(ring_add_gate(&w, 2, &b.process, 5, false));
    CHECK_EQ(ring_all(&w, false), 0); /* both are awake */
    bell_arm(&b.segment->arrival, 0);
    CHECK_EQ(ring_all(&w, false), 1);
    CHECK(rung[0].doorbell == 12 && rung[0].knock == KNOCK_ANY);
    CHECK_EQ(ring_all(&w, false), 0);
    bell_arm(&a.segment->arrival, 0);
    bell_arm(&b.segment->arrival, 0);
    CHECK_EQ(ring_all(&w, true), 2);
    for (uint64_t slot = 10; slot < 10 + FEW_RINGS; slot++)
        CHECK(ring_add_gate(&other, slot, &a.process, slot, false));
    bell_arm(&a.segment->arrival, 0);
    CHECK_EQ(ring_all(&w, false), 1);
    CHECK_EQ(knock_slot(rung[0].knock), 4);
    CHECK_EQ(ring_all(&other, false), 1); /* another ring has rung before */
    CHECK_EQ(rung[0].knock, KNOCK_ANY);
    bell_arm(&a.segment->arrival, 0);
    CHECK_EQ(ring_all(&other, false), 1); /* several of its slots */
    CHECK_EQ(rung[0].knock, KNOCK_ANY);
    bell_arm(&a.segment->arrival, 0);
    CHECK_EQ(ring_all(&w, true), 1); /* there is more than a record */
    CHECK_EQ(rung[0].knock, KNOCK_ANY);
    end(&w, memory);
    end(&other, second);
    free(a.segment);
    free(b.segment);
}

/* A writer has rung for one of its slots. When its gates change, that knock must not count for another slot. */
static void test_a_knock_stands_for_no_other_slot(void)
{
    struct neighbour a = new_neighbour(1);
    void *memory = new_ring(CAPACITY, INDEX, 1), *second = new_ring(CAPACITY, INDEX, 1);
    struct ring_writer w, other;
    ring_writer_attach(&w, memory);
    ring_writer_attach(&other, second);
    for (uint64_t slot = 10; slot < 11 + FEW_RINGS; slot++)
        CHECK(ring_add_gate(&other, slot, &a.process, slot, false));
    CHECK(ring_add_gate(&w, 1, &a.process, 4, false));
    bell_arm(&a.segment->arrival, 0);
    CHECK_EQ(ring_all(&w, false), 1);
    CHECK_EQ(knock_slot(rung[0].knock), 4);
    CHECK(ring_add_gate(&w, 1, &a.process, 5, false));
    CHECK_EQ(ring_all(&w, false), 1);
    CHECK_EQ(rung[0].knock, KNOCK_ANY);
    end(&w, memory);
    end(&other, second);
    free(a.segment);
}

int main(void)
{
    test_come_and_go();
    test_a_lossless_one_holds_back_until_it_is_lossy_or_gone();
    test_tickets();
    test_holes_stay_with_their_slot();
    test_they_go_on_in_another_ring();
    test_each_process_is_rung_once_for_a_sleep();
    test_a_knock_stands_for_no_other_slot();
    puts("gates: ok");
    return 0;
}
