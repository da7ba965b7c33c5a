/* A reader on a ring of a hostile publisher: the geometry, heads, index and records contain any values, and change
 * while they are being read. The reader never touches memory outside the segment, and every operation ends. */
#include "fuzz.h"

enum { CAPACITY = 4096, MOST_PINS = READER_PINS };

static unsigned char *memory;
static struct ring_geometry geometry;
static struct ring_reader reader;
static bool is_open;

/* The place of a word that a reader uses: in the header, in the index, in a record's head; or of any word. */
static uint64_t next_place(void)
{
    static const uint64_t header[] = {
        offsetof(struct ring_header, latest) / 8,   offsetof(struct ring_header, oldest) / 8,
        offsetof(struct ring_header, closed) / 8,   offsetof(struct ring_header, room.generation) / 8,
        offsetof(struct ring_header, room.wanted) / 8, offsetof(struct ring_header, admitted) / 8,
    };
    const unsigned kind = next_byte(), where = kind >> 2;
    switch (kind & 3) {
    case 0:
        return header[where % (sizeof header / sizeof *header)];
    case 1:
        return geometry.index_offset / 8 + where % geometry.index_length;
    case 2:
        return (geometry.data_offset + where % (CAPACITY / RING_ALIGN) * RING_ALIGN) / 8 + next_byte() % 3;
    default:
        return next_word() % (geometry.segment_bytes / 8);
    }
}

static void write_somewhere(void)
{
    const uint64_t at = next_place();
    set_word(memory, at, next_number(reader.next));
}

static void meddle(void)
{
    if (is_open && goes_on() && next_byte() % 8 == 1)
        write_somewhere();
}

/* Writes some records like an honest publisher: faults begin when the script changes something. */
static void publish_some(void)
{
    struct ring_writer writer;
    ring_writer_attach(&writer, memory);
    for (unsigned left = next_byte() % 64; left != 0; left--) {
        static const unsigned char zeros[1024];
        ring_write(&writer, zeros, next_byte() * 4, 0, 0, true);
    }
}

static void use(void)
{
    struct ring_record found = {0}, pinned[MOST_PINS];
    unsigned pins[MOST_PINS], pin_count = 0;
    bool has_found = false;
    while (goes_on()) {
        switch (next_byte() % 14) {
        case 0:
            ring_poll(&reader, next_byte() % 16);
            has_found = false;
            break;
        case 1:
        case 2:
            has_found = ring_look(&reader, &found) == RING_OK;
            if (has_found && (found.size > geometry.capacity - RING_HEAD_BYTES || found.seq != reader.next))
                FAIL("a record of %u bytes, number %" PRIu64, found.size, found.seq);
            break;
        case 3:
        case 4:
            if (has_found) {
                void *copy = malloc(found.size + 1);
                if (ring_copy_out(&reader, &found, copy) != RING_OK)
                    has_found = false;
                free(copy);
            }
            break;
        case 5:
            if (has_found && pin_count < MOST_PINS && ring_pin(&reader, &found, &pins[pin_count]) == RING_OK)
                pinned[pin_count++] = found;
            break;
        case 6:
            if (pin_count != 0)
                ring_unpin(reader.slot, pins[--pin_count]);
            break;
        case 7:
            if (pin_count != 0) {
                void *copy = malloc(pinned[0].size + 1);
                memcpy(copy, pinned[0].payload, pinned[0].size);
                free(copy);
            }
            break;
        case 8:
            ring_step(&reader);
            has_found = false;
            break;
        case 9:
            ring_tell_cursor(&reader);
            ring_room_is_due(&reader);
            break;
        case 10:
            ring_is_finished(&reader);
            break;
        case 11:
            ring_join(&reader, next_byte());
            has_found = false;
            break;
        case 12:
            ring_ask(reader.slot, 1 + next_byte());
            ring_is_admitted(&reader, 1 + next_byte());
            ring_unpin(reader.slot, READER_PINS - 1);
            break;
        default:
            write_somewhere();
        }
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    script = data;
    script_end = data + size;
    is_open = false;
    const unsigned shape = next_byte();
    const uint64_t index_length = (uint64_t)RING_MIN_INDEX << (shape & 3), bytes = ring_segment_bytes(CAPACITY, index_length);
    memory = zeroed(bytes);
    ring_format(memory, CAPACITY, index_length, 1 + (shape >> 4));
    publish_some();
    if ((shape & 0x0c) == 0x0c) { /* a consistent geometry that disagrees with the segment */
        unsigned char *other = zeroed(sizeof(struct ring_header));
        const unsigned sizes = next_byte();
        const uint64_t other_capacity = (uint64_t)CAPACITY << (sizes & 7);
        const uint64_t other_length = (uint64_t)RING_MIN_INDEX << (sizes >> 4);
        ring_format(other, other_capacity, other_length, 1);
        memcpy(memory, other, sizeof geometry);
        free(other);
    }
    for (unsigned lies = shape >> 2 & 3; lies != 0; lies--) {
        const uint64_t at = next_byte() % (sizeof geometry / 8);
        uint64_t word;
        memcpy(&word, memory + 8 * at, 8);
        set_word(memory, at, next_number(word));
    }
    if (ring_check(memory, bytes, &geometry) == NULL) {
        struct reader_slot *slot = zeroed(sizeof *slot);
        ring_reader_attach(&reader, memory, &geometry, slot);
        ring_join(&reader, UINT64_MAX);
        is_open = true;
        use();
        free(slot);
    }
    free(memory);
    return 0;
}
