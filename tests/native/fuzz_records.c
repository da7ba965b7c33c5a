/* Programs of the recorder's core with hostile payloads: any valid program with any pack stays within its buffers. The
 * result does not depend on the size of the buffer, and each record is whole. */
#include "fuzz.h"

#include "../../clients/bus_bag/core/crc.h"
#include "../../clients/bus_bag/core/records.h"

enum { MOST_PROGRAM = 400, MOST_PACK = 1 << 14, ROOM = 16 * MOST_PACK, STEP = 16 };

static void meddle(void) {}

static void put_u32(uint8_t *at, uint32_t number) { memcpy(at, &number, 4); }

/* Writes an operation as the script wants it; returns its size. */
static size_t make_operation(uint8_t *at, size_t room, int nested)
{
    const unsigned kind = next_byte() % 32;
    const bool is_array = (kind & 1) != 0;
    if (room < 40 || nested > 5 || kind < 16) {
        *at = kind % 8 == 0 ? TEXT : kind % 8 == 1 ? EMPTY : (uint8_t)(next_byte() % NUMBER_KINDS);
        return 1;
    }
    if (kind < 26) {
        const bool is_list = kind >= 20;
        const uint32_t most = kind % 4 == 0 ? UINT32_MAX : next_byte() % 8u;
        at[0] = is_list ? LIST : BYTES;
        at[1] = is_array;
        put_u32(at + 2, is_array ? most : 0);
        put_u32(at + 6, most);
        if (!is_list)
            return SIZE_OF_BYTES;
        const size_t item = make_operation(at + SIZE_OF_LIST, room - SIZE_OF_LIST, nested + 1);
        put_u32(at + 10, (uint32_t)item);
        return SIZE_OF_LIST + item;
    }
    const uint16_t fields = (uint16_t)(1 + next_byte() % 4);
    size_t size = SIZE_OF_MESSAGE;
    at[0] = MESSAGE;
    memcpy(at + 1, &fields, 2);
    for (unsigned i = 0; i < fields; i++)
        size += make_operation(at + size, room - size > 60 ? room - size - 20 : 0, nested + 1);
    return size;
}

/* Copies bytes into memory of exactly their size, so that a sanitizer sees an access behind them. */
static uint8_t *exactly(const uint8_t *bytes, size_t size)
{
    uint8_t *copy = malloc(size + (size == 0));
    memcpy(copy, bytes, size);
    return copy;
}

static size_t make_pack(uint8_t *at)
{
    size_t size = 0;
    for (uint64_t number = 1; goes_on() && size + PACKED_HEAD + 256 <= MOST_PACK; number++) {
        const size_t wanted = next_byte(), left = (size_t)(script_end - script);
        const size_t payload = wanted < left ? wanted : left;
        memcpy(at + size, &number, 8);
        memcpy(at + size + 8, &number, 8);
        put_u32(at + size + 16, (uint32_t)payload);
        memcpy(at + size + PACKED_HEAD, script, payload);
        script += payload;
        size += PACKED_HEAD + payload;
    }
    return size;
}

/* Runs the pack with a buffer of `room` bytes, which grows by STEP bytes. Returns the records; NULL: refused. */
static uint8_t *run(const uint8_t *program, const uint8_t *pack, size_t size, size_t room, struct packing *work)
{
    uint64_t count;
    CHECK(packing_count(pack, pack + size, &count));
    uint8_t *places = malloc(count * PLACE_SIZE + 1), *place = places;
    *work = (struct packing){.program = program, .at = pack, .end = pack + size, .channel = 7};
    work->out.room = room;
    work->out.bytes = malloc(room);
    enum packing_status status;
    while ((status = packing_run(work, &place)) == PACKING_FULL) {
        CHECK(work->out.room < ROOM);
        work->out.room += STEP;
        work->out.bytes = realloc(work->out.bytes, work->out.room);
    }
    if (status == PACKING_DONE)
        CHECK_EQ(place - places, count * PLACE_SIZE);
    free(places);
    if (status == PACKING_DONE)
        return work->out.bytes;
    free(work->out.bytes);
    return NULL;
}

static void check_records(const struct packing *work)
{
    size_t at = 0;
    while (at != work->out.size) {
        uint64_t length;
        CHECK(work->out.size - at >= RECORD_HEAD + MESSAGE_HEAD + 4);
        CHECK_EQ(work->out.bytes[at], OPCODE_MESSAGE);
        memcpy(&length, work->out.bytes + at + 1, 8);
        CHECK(length <= work->out.size - at - RECORD_HEAD);
        at += RECORD_HEAD + length;
    }
}

#ifdef __x86_64__
static void check_crc(const uint8_t *at, size_t size)
{
    const size_t whole = size & ~(size_t)15;
    if (!crc_is_there())
        return;
    CHECK_EQ(crc_of(5, at, size), ~crc_slowly(~UINT32_C(5), at, size));
    if (whole >= 64)
        CHECK_EQ(crc_fold(5, at, whole), crc_slowly(5, at, whole));
    if (whole >= 128 && crc_is_wide())
        CHECK_EQ(crc_fold_wide(5, at, whole), crc_slowly(5, at, whole));
}
#else
static void check_crc(const uint8_t *at, size_t size) { (void)at, (void)size; }
#endif

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static uint8_t made[MOST_PROGRAM + 100], packed[MOST_PACK];
    script = data;
    script_end = data + size;
    size_t length;
    if (next_byte() % 4 == 3) { /* a program that may be wrong */
        length = next_byte();
        for (size_t i = 0; i < length; i++)
            made[i] = (uint8_t)next_byte();
    } else {
        length = make_operation(made, MOST_PROGRAM, 0);
        CHECK(length <= sizeof made && program_is_valid(made, length));
    }
    uint8_t *program = exactly(made, length);
    if (program_is_valid(program, length)) {
        const size_t pack_size = make_pack(packed);
        uint8_t *pack = exactly(packed, pack_size);
        struct packing one, other;
        uint8_t *records = run(program, pack, pack_size, ROOM, &one), *again = run(program, pack, pack_size, 1, &other);
        CHECK((records == NULL) == (again == NULL));
        if (records != NULL) {
            CHECK_EQ(one.out.size, other.out.size);
            CHECK(memcmp(records, again, one.out.size) == 0);
            check_records(&one);
            check_crc(again, one.out.size);
        }
        uint64_t count;
        if (pack_size != 0)
            CHECK(!packing_count(pack, pack + pack_size - 1, &count));
        free(records);
        free(again);
        free(pack);
    }
    free(program);
    return 0;
}
