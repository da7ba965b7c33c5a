/* From MessagePack to CDR by a program, the operations for one message type. No Python here.
 *
 * A program refuses each payload that `bus_ros.cdr` would refuse. It also refuses a few unusual payloads that
 * `bus_ros.cdr` accepts (see read_float()). The caller encodes a refused payload there, so both ways give the same
 * bytes and the same errors. `program.py` makes programs.
 *
 * An operation is a byte, then its parameters in little-endian order:
 *
 *     a kind of number (BOOL ... FLOAT64)
 *     TEXT
 *     BYTES    is_array u8, least u32, most u32
 *     LIST     is_array u8, least u32, most u32, length of the item's operation u32, that operation
 *     MESSAGE  number of fields u16, an operation for each
 *     EMPTY    a message without fields
 *
 * A value whose operation `is_array` has no count in CDR.
 */
#ifndef BUS_BAG_PROGRAM_H
#define BUS_BAG_PROGRAM_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "it needs a little-endian machine"
#endif

enum {
    BOOL, BYTE, UINT8, INT8, UINT16, INT16, UINT32, INT32, UINT64, INT64, FLOAT32, FLOAT64,
    NUMBER_KINDS,
    TEXT = 16, BYTES, LIST, MESSAGE, EMPTY
};

enum {
    MOST_NESTED = 64,    /* operations within operations */
    SIZE_OF_BYTES = 10,  /* of the operation, with its parameters */
    SIZE_OF_LIST = 14,   /* without the item's operation */
    SIZE_OF_MESSAGE = 3, /* without the fields' operations */
    MOST_ALIGNMENT = 8,
    ASCII_AT_ONCE = 32
};

/* The part of a payload that was not read yet. It may be in the memory of a hostile publisher, so a byte that is checked
 * and then used is read once. */
struct payload {
    const uint8_t *at, *end;
};

/* CDR bytes, at the end of a buffer. They are aligned from `origin` on. */
struct cdr {
    uint8_t *bytes;
    size_t size, room, origin;
    bool is_full; /* the buffer is too small, so nothing was refused */
};

static inline uint32_t program_u32(const uint8_t *at)
{
    uint32_t number;
    memcpy(&number, at, sizeof number);
    return number;
}

static inline uint16_t program_u16(const uint8_t *at)
{
    uint16_t number;
    memcpy(&number, at, sizeof number);
    return number;
}

/* --- the check of a program, before its first run */

/* The end of the operation at `at`; NULL if it is not valid. */
static const uint8_t *program_check(const uint8_t *at, const uint8_t *end, int nested)
{
    const size_t left = (size_t)(end - at);
    if (left == 0 || nested == MOST_NESTED)
        return NULL;
    if (*at < NUMBER_KINDS || *at == TEXT || *at == EMPTY)
        return at + 1;
    if (*at == BYTES)
        return left >= SIZE_OF_BYTES ? at + SIZE_OF_BYTES : NULL;
    if (*at == LIST) {
        if (left < SIZE_OF_LIST)
            return NULL;
        const uint8_t *item = at + SIZE_OF_LIST, *after = program_check(item, end, nested + 1);
        return after != NULL && (size_t)(after - item) == program_u32(at + 10) ? after : NULL;
    }
    if (*at != MESSAGE || left < SIZE_OF_MESSAGE || program_u16(at + 1) == 0)
        return NULL;
    const uint8_t *next = at + SIZE_OF_MESSAGE;
    for (unsigned fields = program_u16(at + 1); fields != 0 && next != NULL; fields--)
        next = program_check(next, end, nested + 1);
    return next;
}

/* Whether the bytes are one whole program. */
static inline bool program_is_valid(const uint8_t *program, size_t size)
{
    return program_check(program, program + size, 0) == program + size;
}

/* --- CDR out */

/* Makes room for `size` bytes after `alignment`, and writes the zeros of the alignment. */
static inline uint8_t *cdr_place(struct cdr *out, size_t alignment, size_t size)
{
    const size_t padding = (0 - (out->size - out->origin)) & (alignment - 1);
    if (out->room - out->size < padding + size) {
        out->is_full = true;
        return NULL;
    }
    uint8_t *place = out->bytes + out->size;
    for (size_t i = 0; i < padding; i++)
        *place++ = 0;
    out->size += padding + size;
    return place;
}

static inline bool cdr_put(struct cdr *out, const void *value, size_t size)
{
    uint8_t *place = cdr_place(out, size, size);
    if (place == NULL)
        return false;
    memcpy(place, value, size);
    return true;
}

static inline bool cdr_put_u32(struct cdr *out, uint32_t value) { return cdr_put(out, &value, sizeof value); }

/* --- MessagePack in */

static inline size_t payload_left(const struct payload *in) { return (size_t)(in->end - in->at); }

/* Reads the big-endian number of 1, 2, 4 or 8 bytes behind a head of one byte. False: it is cut off. */
static inline bool read_behind(struct payload *in, size_t size, uint64_t *number)
{
    if (payload_left(in) < 1 + size)
        return false;
    uint16_t two;
    uint32_t four;
    switch (size) {
    case 1:
        *number = in->at[1];
        break;
    case 2:
        memcpy(&two, in->at + 1, 2);
        *number = __builtin_bswap16(two);
        break;
    case 4:
        memcpy(&four, in->at + 1, 4);
        *number = __builtin_bswap32(four);
        break;
    default:
        memcpy(number, in->at + 1, 8);
        *number = __builtin_bswap64(*number);
    }
    in->at += 1 + size;
    return true;
}

/* A whole number. One of INT64_MIN to -1 `is_negative`, and `bits` are its complement to two. */
struct whole {
    uint64_t bits;
    bool is_negative;
};

static inline bool read_whole(struct payload *in, struct whole *found)
{
    if (payload_left(in) == 0)
        return false;
    const uint8_t head = *in->at;
    found->is_negative = false;
    if (head < 0x80 || head >= 0xe0) {
        found->is_negative = head >= 0xe0;
        found->bits = (uint64_t)(int64_t)(int8_t)head;
        in->at++;
        return true;
    }
    if (head < 0xcc || head > 0xd3)
        return false;
    const unsigned size = 1u << (head & 3);
    if (!read_behind(in, size, &found->bits))
        return false;
    if (head >= 0xd0 && found->bits >> (8 * size - 1) != 0) {
        found->is_negative = true;
        if (size < 8)
            found->bits |= UINT64_MAX << (8 * size);
    }
    return true;
}

/* Reads the double of a float field. MessagePack may have a whole number there. */
static inline bool read_float(struct payload *in, double *found)
{
    if (payload_left(in) == 0)
        return false;
    uint64_t bits;
    if (*in->at == 0xcb) {
        if (!read_behind(in, 8, &bits))
            return false;
        memcpy(found, &bits, sizeof bits);
        return true;
    }
    if (*in->at == 0xca) {
        if (!read_behind(in, 4, &bits))
            return false;
        const uint32_t narrow = (uint32_t)bits;
        float number;
        memcpy(&number, &narrow, sizeof narrow);
        *found = (double)number;
        return !isnan(number); /* to convert a NaN may change its bits */
    }
    struct whole whole;
    if (!read_whole(in, &whole))
        return false;
    *found = whole.is_negative ? (double)(int64_t)whole.bits : (double)whole.bits;
    return true;
}

/* Reads the head of an array. */
static inline bool read_count(struct payload *in, uint32_t *count)
{
    if (payload_left(in) == 0)
        return false;
    const uint8_t head = *in->at;
    if ((head & 0xf0) == 0x90) {
        *count = head & 0x0f;
        in->at++;
        return true;
    }
    uint64_t number;
    if ((head != 0xdc && head != 0xdd) || !read_behind(in, head == 0xdc ? 2 : 4, &number))
        return false;
    *count = (uint32_t)number;
    return true;
}

/* Reads the head of bytes (`first` is 0xc4) or of a long text (0xd9), and checks that all bytes exist. */
static inline bool read_size(struct payload *in, uint8_t first, uint32_t *size)
{
    if (payload_left(in) == 0)
        return false;
    const uint8_t head = *in->at;
    uint64_t number;
    if (head < first || head > first + 2 || !read_behind(in, (size_t)1 << (head - first), &number))
        return false;
    if (number > payload_left(in))
        return false;
    *size = (uint32_t)number;
    return true;
}

/* Whether the next ASCII_AT_ONCE bytes are ASCII. */
static inline bool is_ascii(const uint8_t *at)
{
    uint64_t words[ASCII_AT_ONCE / 8], all = 0;
    memcpy(words, at, sizeof words);
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        all |= words[i];
    return (all & UINT64_C(0x8080808080808080)) == 0;
}

/* Whether the bytes are UTF-8 as Python accepts it: no surrogates, nothing longer than needed. */
static bool is_utf8(const uint8_t *at, const uint8_t *end)
{
    while (at < end) {
        if (end - at >= ASCII_AT_ONCE && is_ascii(at)) {
            at += ASCII_AT_ONCE;
            continue;
        }
        const uint8_t head = *at++;
        if (head < 0x80)
            continue;
        const int more = head < 0xe0 ? 1 : head < 0xf0 ? 2 : 3;
        if (head < 0xc2 || head > 0xf4 || end - at < more)
            return false;
        const uint8_t least = head == 0xe0 ? 0xa0 : head == 0xf0 ? 0x90 : 0x80;
        const uint8_t most = head == 0xed ? 0x9f : head == 0xf4 ? 0x8f : 0xbf;
        if (*at < least || *at > most)
            return false;
        for (int i = 1; i < more; i++)
            if ((at[i] & 0xc0) != 0x80)
                return false;
        at += more;
    }
    return true;
}

/* --- the operations. Each returns false if the payload is refused, or if the buffer is full. */

static inline bool put_whole(struct payload *in, struct cdr *out, uint8_t kind)
{
    static const int64_t least[] = {[INT8] = INT8_MIN, [INT16] = INT16_MIN, [INT32] = INT32_MIN, [INT64] = INT64_MIN};
    static const uint64_t most[] = {[UINT8] = UINT8_MAX,   [INT8] = INT8_MAX,   [UINT16] = UINT16_MAX,
                                    [INT16] = INT16_MAX,   [UINT32] = UINT32_MAX, [INT32] = INT32_MAX,
                                    [UINT64] = UINT64_MAX, [INT64] = INT64_MAX};
    struct whole number;
    if (!read_whole(in, &number))
        return false;
    if (number.is_negative ? (int64_t)number.bits < least[kind] : number.bits > most[kind])
        return false;
    return cdr_put(out, &number.bits, (size_t)1 << ((kind - UINT8) / 2)); /* the lower bytes */
}

/* A float32. False for a number that is too large, as in struct.pack. */
static inline bool put_float32(struct payload *in, struct cdr *out)
{
    double number;
    if (!read_float(in, &number))
        return false;
    uint64_t bits;
    memcpy(&bits, &number, sizeof bits);
    if (isnan(number) && (bits & UINT64_C(0x0008000000000000)) == 0)
        return false; /* a signaling NaN: Python's versions convert it differently */
    const float narrow = (float)number;
    return (isinf(number) || !isinf(narrow)) && cdr_put(out, &narrow, sizeof narrow);
}

static inline bool put_number(struct payload *in, struct cdr *out, uint8_t kind)
{
    double number;
    switch (kind) {
    case BOOL: {
        if (payload_left(in) == 0 || (*in->at & 0xfe) != 0xc2)
            return false;
        const uint8_t value = *in->at++ & 1;
        return cdr_put(out, &value, 1);
    }
    case BYTE:
        if (payload_left(in) < 3 || in->at[0] != 0xc4 || in->at[1] != 1)
            return false;
        in->at += 3;
        return cdr_put(out, in->at - 1, 1);
    case FLOAT32:
        return put_float32(in, out);
    case FLOAT64:
        return read_float(in, &number) && cdr_put(out, &number, sizeof number);
    default:
        return put_whole(in, out, kind);
    }
}

static inline bool put_text(struct payload *in, struct cdr *out)
{
    uint32_t size;
    if (payload_left(in) != 0 && (*in->at & 0xe0) == 0xa0) {
        size = *in->at & 0x1f;
        if (++in->at, size > payload_left(in))
            return false;
    } else if (!read_size(in, 0xd9, &size)) {
        return false;
    }
    if (size == UINT32_MAX || !cdr_put_u32(out, size + 1))
        return false;
    uint8_t *place = cdr_place(out, 1, (size_t)size + 1);
    if (place == NULL)
        return false;
    memcpy(place, in->at, size);
    place[size] = 0;
    in->at += size;
    return is_utf8(place, place + size); /* the copy: its publisher may change a payload in shared memory */
}

/* Whether a list or bytes may have `count` items; `op` is the operation. Writes the count, if CDR has one. */
static inline bool put_count(struct cdr *out, const uint8_t *op, uint32_t count)
{
    if (count < program_u32(op + 2) || count > program_u32(op + 6))
        return false;
    return op[1] != 0 || cdr_put_u32(out, count);
}

static inline bool put_bytes(struct payload *in, struct cdr *out, const uint8_t *op)
{
    uint32_t size;
    if (!read_size(in, 0xc4, &size) || !put_count(out, op, size))
        return false;
    uint8_t *place = cdr_place(out, 1, size);
    if (place == NULL)
        return false;
    memcpy(place, in->at, size);
    in->at += size;
    return true;
}

/* Runs the operation `op`. Returns the next one; NULL if the payload is refused, or if the buffer is full. */
static const uint8_t *program_run(const uint8_t *op, struct payload *in, struct cdr *out)
{
    uint32_t count;
    switch (*op) {
    case TEXT:
        return put_text(in, out) ? op + 1 : NULL;
    case BYTES:
        return put_bytes(in, out, op) ? op + SIZE_OF_BYTES : NULL;
    case LIST: {
        if (!read_count(in, &count) || !put_count(out, op, count))
            return NULL;
        const uint8_t *item = op + SIZE_OF_LIST, *after = item + program_u32(op + 10);
        if (*item < NUMBER_KINDS) {
            for (; count != 0; count--)
                if (!put_number(in, out, *item))
                    return NULL;
            return after;
        }
        for (; count != 0; count--) /* ends: each item needs a byte of the payload */
            if (program_run(item, in, out) == NULL)
                return NULL;
        return after;
    }
    case MESSAGE: {
        const unsigned fields = program_u16(op + 1);
        if (!read_count(in, &count) || count != fields)
            return NULL;
        op += SIZE_OF_MESSAGE;
        for (unsigned i = 0; i < fields && op != NULL; i++)
            op = *op >= NUMBER_KINDS ? program_run(op, in, out) : put_number(in, out, *op) ? op + 1 : NULL;
        return op;
    }
    case EMPTY: {
        static const uint8_t zero = 0;
        return read_count(in, &count) && count == 0 && cdr_put(out, &zero, 1) ? op + 1 : NULL;
    }
    default:
        return put_number(in, out, *op) ? op + 1 : NULL;
    }
}

/* Appends the CDR message of a whole payload, with its encapsulation. False: it is refused, or the buffer is full. */
static inline bool program_encode(const uint8_t *program, const uint8_t *payload, size_t size, struct cdr *out)
{
    static const uint8_t encapsulation[4] = {0, 1, 0, 0};
    uint8_t *place = cdr_place(out, 1, sizeof encapsulation);
    if (place == NULL)
        return false;
    memcpy(place, encapsulation, sizeof encapsulation);
    out->origin = out->size;
    struct payload in = {payload, payload + size};
    return program_run(program, &in, out) != NULL && in.at == in.end;
}

#endif
