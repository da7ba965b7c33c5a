/* A writer with hostile readers and an honest one. The hostile segment contains any values; its cursors and pins change
 * while the writer reads them. The writer stays within its ring and the segments, and every write ends. The honest
 * reader takes the written records, and keeps its pinned ones. */
#include "fuzz.h"

#include "../../clients/bus/shm/gates.h"

enum { CAPACITY = 4096, INDEX = 32, SLOTS = 3, MOST_GATES = 5, KEYS = 6 };

static unsigned char *readers;
static struct ring_writer writer;
static struct reading_process hostile;
static bool is_open;

/* The honest reader. */
static struct ring_reader reader;
static struct ring_record held;
static unsigned pin;
static bool is_holding;

static void write_somewhere(void)
{
    const unsigned at = next_byte();
    const uint64_t words = readers_segment_bytes(SLOTS) / 8, slots = sizeof(struct readers_header) / 8;
    const uint64_t number = next_number(writer.oldest);
    set_word(readers, at & 128 ? at % words : slots + at % (words - slots), at & 64 ? number | READER_TICKET : number);
}

static void meddle(void)
{
    if (is_open && goes_on() && next_byte() % 8 == 1)
        write_somewhere();
}

/* Checks that the newest record is the written one; pins it if `is_held`. */
static void check_newest(const struct ring_writer *w, uint32_t size, bool is_held)
{
    static unsigned char copy[CAPACITY];
    struct ring_record record;
    CHECK_EQ(ring_poll(&reader, 1), 1);
    CHECK_EQ(ring_look(&reader, &record), RING_OK);
    CHECK_EQ(record.seq, w->latest);
    CHECK_EQ(record.size, size);
    CHECK_EQ(ring_copy_out(&reader, &record, copy), RING_OK);
    CHECK(is_filled(copy, record.seq, size));
    if (is_held && !is_holding) {
        CHECK_EQ(ring_pin(&reader, &record, &pin), RING_OK);
        held = record;
        is_holding = true;
    }
    ring_step(&reader);
}

static void check_held(void)
{
    if (is_holding)
        CHECK(is_filled(held.payload, held.seq, held.size));
}

static void let_go(void)
{
    if (is_holding)
        ring_unpin(reader.slot, pin);
    is_holding = false;
}

static void publish(bool force)
{
    static unsigned char payload[CAPACITY + 8];
    const unsigned shape = next_byte();
    const uint32_t size = shape * 8;
    fill(payload, writer.latest + 1, size);
    if (ring_write(&writer, payload, size, 0, 0, force) == RING_OK) {
        is_open = false;
        check_newest(&writer, size, shape % 4 == 1);
        is_open = true;
    }
    check_held();
    CHECK(writer.oldest <= writer.latest + 1);
    CHECK(writer.latest + 1 - writer.oldest <= INDEX);
}

/* Adds and removes gates. Some keys come twice: then the new gate replaces the earlier one. */
static void change_gates(void)
{
    const unsigned how = next_byte(), which = how >> 2;
    struct ring_gate *others = &writer.gates.list[1]; /* the first gate is the honest reader's */
    const size_t other_count = writer.gates.count - 1;
    if (how & 1 && writer.gates.count < MOST_GATES)
        CHECK(ring_add_gate(&writer, 1 + which % KEYS, &hostile, which % SLOTS, how & 2));
    else if (how & 2 && other_count != 0)
        ring_make_lossy(&writer, &others[which % other_count]);
    else if (other_count != 0)
        CHECK(ring_remove_gate(&writer, &others[which % other_count]) == &hostile);
    CHECK_EQ(hostile.gates, writer.gates.count - 1);
}

static void count_rung(int doorbell, uint64_t knock)
{
    CHECK(doorbell == hostile.doorbell && knock != 0); /* the honest reader does not sleep */
}

/* Rings all, with any pins and sleeps of hostile readers: the calls return, and do no harm. */
static void ring_all(bool is_for_any)
{
    CHECK(gates_ring(&writer.gates, is_for_any, count_rung) <= 1);
    for (size_t i = 1; i < writer.gates.count; i++)
        gate_has_pins(&writer.gates.list[i]);
}

static void carry(void)
{
    struct ring_writer grown;
    const uint64_t from = ring_carry_from(&writer, next_byte());
    void *memory = new_ring(2 * CAPACITY, 2 * INDEX, from);
    ring_writer_attach(&grown, memory);
    CHECK_EQ(ring_carry(&grown, &writer), RING_OK);
    CHECK_EQ(grown.latest, writer.latest);
    free(memory);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    script = data;
    script_end = data + size;
    is_open = false;
    struct readers_geometry geometry;
    struct reader_slot slot = {0};
    const struct bell awake = {0};
    struct reading_process honest = {.arrival = &awake, .slots = &slot, .slot_count = 1, .doorbell = 7};
    readers = zeroed(readers_segment_bytes(SLOTS));
    readers_format(readers, SLOTS);
    for (unsigned lies = next_byte() % 4; lies != 0; lies--) {
        const uint64_t at = next_byte() % (sizeof geometry / 8);
        set_word(readers, at, next_number(SLOTS));
    }
    void *memory = new_ring(CAPACITY, INDEX, 1);
    ring_writer_attach(&writer, memory);
    CHECK(ring_add_gate(&writer, 0, &honest, 0, false));
    hostile = (struct reading_process){
        .arrival = &((struct readers_header *)readers)->arrival,
        .slots = readers_slots(readers),
        .slot_count = SLOTS,
        .doorbell = 8,
    };
    open_reader(&reader, memory, &slot);
    ring_join(&reader, 0);
    is_holding = false;
    writer.keep = 1 + next_byte() % 8;
    is_open = readers_check(readers, readers_segment_bytes(SLOTS), &geometry) == NULL;
    while (is_open && goes_on()) {
        switch (next_byte() % 8) {
        case 0:
        case 1:
        case 2:
            publish(false);
            break;
        case 3:
            publish(true);
            break;
        case 4:
            change_gates();
            break;
        case 5:
            ring_all(next_byte() % 2);
            if (ring_wait_for_room(&writer))
                bell_disarm(&writer.header->room);
            break;
        case 6:
            if (next_byte() % 2)
                carry();
            else
                let_go();
            break;
        default:
            write_somewhere();
        }
    }
    gates_free(&writer.gates);
    free(memory);
    free(readers);
    return 0;
}
