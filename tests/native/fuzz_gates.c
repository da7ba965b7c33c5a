/* A writer most of whose readers are hostile: their segment says anything, cursors and pins jump while the writer looks.
 * It stays within its ring and theirs, every write ends, and an honest reader beside them takes what was written, and
 * keeps what it has pinned. */
#include "fuzz.h"

enum { CAPACITY = 4096, INDEX = 32, SLOTS = 3, MOST_GATES = 5 };

static unsigned char *readers;
static struct ring_writer writer;
static bool is_open;

/* The honest one. */
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

/* The newest record is what was written, and is held from now on where `is_held`. */
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

static void change_gates(struct reader_slot *slots)
{
    const unsigned how = next_byte();
    if (how & 1 && writer.gate_count < MOST_GATES) {
        const struct reader_slot *slot = &slots[(how >> 2) % SLOTS];
        writer.gates[writer.gate_count++] = (struct ring_gate){.slot = slot, .is_lossless = how & 2};
        ring_gates_changed(&writer);
        ring_admit(&writer, slot);
    } else if (writer.gate_count > 1) { /* the first is the honest one's */
        writer.gates[1 + (how >> 2) % (writer.gate_count - 1)] = writer.gates[writer.gate_count - 1];
        writer.gate_count--;
        ring_gates_changed(&writer);
    }
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
    struct ring_gate gates[MOST_GATES] = {{.slot = &slot}};
    uint64_t rung = 0;
    readers = zeroed(readers_segment_bytes(SLOTS));
    readers_format(readers, SLOTS);
    for (unsigned lies = next_byte() % 4; lies != 0; lies--) {
        const uint64_t at = next_byte() % (sizeof geometry / 8);
        set_word(readers, at, next_number(SLOTS));
    }
    void *memory = new_ring(CAPACITY, INDEX, 1);
    ring_writer_attach(&writer, memory);
    writer.gates = gates;
    writer.gate_count = 1;
    ring_gates_changed(&writer);
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
            change_gates(readers_slots(readers));
            break;
        case 5:
            bell_is_due(&((struct readers_header *)readers)->arrival, &rung, 0);
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
    free(memory);
    free(readers);
    return 0;
}
