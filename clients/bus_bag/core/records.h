/* Message records of MCAP, out of packed messages. No Python here.
 *
 * A packed message is: number u64, publish time i64, size u32, payload; see `bus.Subscription.take_packed`.
 */
#ifndef BUS_BAG_RECORDS_H
#define BUS_BAG_RECORDS_H

#include "program.h"

enum {
    PACKED_HEAD = 20,
    RECORD_HEAD = 9, /* opcode u8, length of the rest u64 */
    MESSAGE_HEAD = 22, /* channel u16, sequence u32, log time u64, publish time u64 */
    PLACE_SIZE = 16, /* of an index entry: log time u64, offset u64 */
    OPCODE_MESSAGE = 5
};

/* Work on one pack: packed messages in, records out. */
struct packing {
    const uint8_t *program;
    const uint8_t *at, *end; /* the rest of the pack */
    uint64_t log_time, base; /* base: offset of the first record in the chunk */
    uint16_t channel;
    struct cdr out;
};

enum packing_status { PACKING_DONE, PACKING_FULL, PACKING_REFUSED };

/* The number of messages in a pack, which must be complete. False: it is not. */
static inline bool packing_count(const uint8_t *at, const uint8_t *end, uint64_t *count)
{
    *count = 0;
    while (end - at >= PACKED_HEAD) {
        const uint32_t size = program_u32(at + 16);
        at += PACKED_HEAD;
        if (size > (size_t)(end - at))
            return false;
        at += size;
        ++*count;
    }
    return at == end;
}

/* Appends the record of the next message. `place`: its index entry, of PLACE_SIZE bytes. */
static inline enum packing_status packing_add(struct packing *self, uint8_t *place)
{
    struct cdr *out = &self->out;
    const size_t begin = out->size;
    const uint8_t *payload = self->at + PACKED_HEAD;
    const uint32_t size = program_u32(self->at + 16);
    uint8_t *record = cdr_place(out, 1, RECORD_HEAD + MESSAGE_HEAD);
    if (record == NULL || !program_encode(self->program, payload, size, out)) {
        const bool is_full = out->is_full;
        out->is_full = false;
        out->size = begin;
        return is_full ? PACKING_FULL : PACKING_REFUSED;
    }
    const uint64_t length = out->size - begin - RECORD_HEAD, offset = self->base + begin;
    record[0] = OPCODE_MESSAGE;
    memcpy(record + 1, &length, 8);
    memcpy(record + 9, &self->channel, 2);
    memcpy(record + 11, self->at, 4); /* the lower half of the number */
    memcpy(record + 15, &self->log_time, 8);
    memcpy(record + 23, self->at + 8, 8);
    memcpy(place, &self->log_time, 8);
    memcpy(place + 8, &offset, 8);
    self->at = payload + size;
    return PACKING_DONE;
}

/* Appends records until the pack ends, the buffer is full, or a message is refused. *places: the next index entry. */
static inline enum packing_status packing_run(struct packing *self, uint8_t **places)
{
    enum packing_status status = PACKING_DONE;
    while (status == PACKING_DONE && self->at != self->end) {
        status = packing_add(self, *places);
        if (status == PACKING_DONE)
            *places += PLACE_SIZE;
    }
    return status;
}

#endif
