/* MessagePack for generated headers: `busd_put_...` writes into a buffer, `busd_get_...` reads a message and never
 * leaves it. Integers and lengths are written in their shortest form, as busd does. No function here fails by itself: a
 * writer sets `failed` if there is no room, a reader if the bytes are not the value asked for. C11 and C++17. */
#ifndef BUSD_PACK_H
#define BUSD_PACK_H

#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* A writer. Initialised with zeroes, it grows a buffer by realloc(); the owner frees `bytes`. With `is_fixed` it writes
 * into `room` bytes that belong to another owner. With `is_fixed`, without `bytes` and with `room` SIZE_MAX it only
 * counts. */
typedef struct busd_out {
    unsigned char *bytes;
    size_t size, room;
    bool is_fixed, failed;
} busd_out;

/* A reader of the bytes from `at` to `end`. */
typedef struct busd_in {
    const unsigned char *at, *end;
    bool failed;
} busd_in;

/* --- writing */

/* Place for `n` more bytes; NULL if there is none, or if it only counts. */
static inline unsigned char *busd_put_room(busd_out *out, size_t n)
{
    if (n > out->room - out->size) {
        const size_t room = (out->size + n) * 2;
        unsigned char *bytes = out->is_fixed ? NULL : (unsigned char *)realloc(out->bytes, room);
        if (bytes == NULL) {
            out->failed = true;
            return NULL;
        }
        out->bytes = bytes;
        out->room = room;
    }
    out->size += n;
    return out->bytes == NULL ? NULL : out->bytes + (out->size - n);
}

static inline void busd_put_raw(busd_out *out, const void *bytes, size_t n)
{
    unsigned char *to = busd_put_room(out, n);
    if (to != NULL && n != 0)
        memcpy(to, bytes, n);
}

/* A tag and a number of `width` bytes, big-endian. */
static inline void busd_put_head(busd_out *out, unsigned tag, uint64_t number, unsigned width)
{
    unsigned char *to = busd_put_room(out, 1 + (size_t)width);
    if (to == NULL)
        return;
    to[0] = (unsigned char)tag;
    for (unsigned i = 1; i <= width; i++)
        to[i] = (unsigned char)(number >> (8 * (width - i)));
}

static inline void busd_put_bool(busd_out *out, bool value) { busd_put_head(out, value ? 0xc3 : 0xc2, 0, 0); }
static inline void busd_put_nil(busd_out *out) { busd_put_head(out, 0xc0, 0, 0); }

static inline void busd_put_uint(busd_out *out, uint64_t number)
{
    if (number < 128)
        busd_put_head(out, (unsigned)number, 0, 0);
    else if (number <= UINT8_MAX)
        busd_put_head(out, 0xcc, number, 1);
    else if (number <= UINT16_MAX)
        busd_put_head(out, 0xcd, number, 2);
    else if (number <= UINT32_MAX)
        busd_put_head(out, 0xce, number, 4);
    else
        busd_put_head(out, 0xcf, number, 8);
}

static inline void busd_put_int(busd_out *out, int64_t number)
{
    if (number >= 0)
        busd_put_uint(out, (uint64_t)number);
    else if (number >= -32)
        busd_put_head(out, (unsigned)(number & 0xff), 0, 0);
    else if (number >= INT8_MIN)
        busd_put_head(out, 0xd0, (uint64_t)number, 1);
    else if (number >= INT16_MIN)
        busd_put_head(out, 0xd1, (uint64_t)number, 2);
    else if (number >= INT32_MIN)
        busd_put_head(out, 0xd2, (uint64_t)number, 4);
    else
        busd_put_head(out, 0xd3, (uint64_t)number, 8);
}

static inline void busd_put_float(busd_out *out, double number)
{
    uint64_t bits;
    memcpy(&bits, &number, 8);
    busd_put_head(out, 0xcb, bits, 8);
}

static inline void busd_put_length(busd_out *out, size_t n, unsigned tag8, unsigned tag16)
{
    if (tag8 != 0 && n <= UINT8_MAX)
        busd_put_head(out, tag8, n, 1);
    else if (n <= UINT16_MAX)
        busd_put_head(out, tag16, n, 2);
    else
        busd_put_head(out, tag16 + 1, n, 4);
}

static inline void busd_put_text(busd_out *out, const char *text, size_t n)
{
    if (n < 32)
        busd_put_head(out, 0xa0 | (unsigned)n, 0, 0);
    else
        busd_put_length(out, n, 0xd9, 0xda);
    busd_put_raw(out, text, n);
}

static inline void busd_put_bytes(busd_out *out, const void *bytes, size_t n)
{
    busd_put_length(out, n, 0xc4, 0xc5);
    busd_put_raw(out, bytes, n);
}

static inline void busd_put_array(busd_out *out, size_t n)
{
    if (n < 16)
        busd_put_head(out, 0x90 | (unsigned)n, 0, 0);
    else
        busd_put_length(out, n, 0, 0xdc);
}

static inline void busd_put_map(busd_out *out, size_t n)
{
    if (n < 16)
        busd_put_head(out, 0x80 | (unsigned)n, 0, 0);
    else
        busd_put_length(out, n, 0, 0xde);
}

/* --- reading */

typedef enum busd_kind {
    BUSD_NIL, BUSD_BOOL, BUSD_UINT, BUSD_INT, BUSD_FLOAT, BUSD_TEXT_ITEM, BUSD_BYTES_ITEM, BUSD_ARRAY, BUSD_MAP,
    BUSD_EXTENSION
} busd_kind;

/* A value without its parts. `number`: of BUSD_UINT and BUSD_BOOL, the bits of a negative BUSD_INT; else the length. */
typedef struct busd_item {
    busd_kind kind;
    uint64_t number;
    double real;
    const unsigned char *bytes; /* of texts, bytes and extensions */
} busd_item;

static inline uint64_t busd_get_number(busd_in *in, unsigned width)
{
    uint64_t number = 0;
    if ((size_t)(in->end - in->at) < width) {
        in->failed = true;
        in->at = in->end;
        return 0;
    }
    for (; width > 0; width--)
        number = number << 8 | *in->at++;
    return number;
}

static inline void busd_item_signed(busd_item *item, int64_t number)
{
    item->kind = number < 0 ? BUSD_INT : BUSD_UINT;
    item->number = (uint64_t)number;
}

static inline void busd_item_float(busd_item *item, uint64_t bits, bool is_short)
{
    const uint32_t half = (uint32_t)bits;
    float narrow;
    item->kind = BUSD_FLOAT;
    memcpy(&narrow, &half, 4);
    if (is_short)
        item->real = (double)narrow;
    else
        memcpy(&item->real, &bits, 8);
}

/* Values with a tag of 0xc0 to 0xdf. */
static inline bool busd_item_tagged(busd_in *in, unsigned tag, busd_item *item)
{
    switch (tag) {
    case 0xc0: item->kind = BUSD_NIL; return true;
    case 0xc2: case 0xc3: item->kind = BUSD_BOOL; item->number = tag & 1; return true;
    case 0xc4: case 0xc5: case 0xc6:
        item->kind = BUSD_BYTES_ITEM; item->number = busd_get_number(in, 1u << (tag - 0xc4)); return true;
    case 0xc7: case 0xc8: case 0xc9:
        item->kind = BUSD_EXTENSION; item->number = busd_get_number(in, 1u << (tag - 0xc7)) + 1; return true;
    case 0xca: busd_item_float(item, busd_get_number(in, 4), true); return true;
    case 0xcb: busd_item_float(item, busd_get_number(in, 8), false); return true;
    case 0xcc: case 0xcd: case 0xce: case 0xcf:
        item->kind = BUSD_UINT; item->number = busd_get_number(in, 1u << (tag - 0xcc)); return true;
    case 0xd0: busd_item_signed(item, (int8_t)busd_get_number(in, 1)); return true;
    case 0xd1: busd_item_signed(item, (int16_t)busd_get_number(in, 2)); return true;
    case 0xd2: busd_item_signed(item, (int32_t)busd_get_number(in, 4)); return true;
    case 0xd3: busd_item_signed(item, (int64_t)busd_get_number(in, 8)); return true;
    case 0xd4: case 0xd5: case 0xd6: case 0xd7: case 0xd8:
        item->kind = BUSD_EXTENSION; item->number = (1u << (tag - 0xd4)) + 1; return true;
    case 0xd9: case 0xda: case 0xdb:
        item->kind = BUSD_TEXT_ITEM; item->number = busd_get_number(in, 1u << (tag - 0xd9)); return true;
    case 0xdc: case 0xdd: item->kind = BUSD_ARRAY; item->number = busd_get_number(in, 2u << (tag - 0xdc)); return true;
    case 0xde: case 0xdf: item->kind = BUSD_MAP; item->number = busd_get_number(in, 2u << (tag - 0xde)); return true;
    default: return false;
    }
}

/* Reads the next value; of an array or a map only its head. */
static inline bool busd_get_item(busd_in *in, busd_item *item)
{
    memset(item, 0, sizeof *item);
    const unsigned tag = (unsigned)busd_get_number(in, 1);
    if (in->failed)
        return false;
    if (tag < 0x80) {
        item->kind = BUSD_UINT;
        item->number = tag;
    } else if (tag < 0x90) {
        item->kind = BUSD_MAP;
        item->number = tag & 15;
    } else if (tag < 0xa0) {
        item->kind = BUSD_ARRAY;
        item->number = tag & 15;
    } else if (tag < 0xc0) {
        item->kind = BUSD_TEXT_ITEM;
        item->number = tag & 31;
    } else if (tag >= 0xe0) {
        busd_item_signed(item, (int8_t)tag);
    } else if (!busd_item_tagged(in, tag, item)) {
        in->failed = true;
    }
    if (item->kind == BUSD_TEXT_ITEM || item->kind == BUSD_BYTES_ITEM || item->kind == BUSD_EXTENSION) {
        if (item->number > (uint64_t)(in->end - in->at)) {
            in->failed = true;
            return false;
        }
        item->bytes = in->at;
        in->at += item->number;
    }
    return !in->failed;
}

/* Passes over one value with all its parts, without recursion. */
static inline bool busd_get_past(busd_in *in)
{
    busd_item item;
    for (uint64_t left = 1; left > 0; left--) {
        if (!busd_get_item(in, &item))
            return false;
        if (item.kind != BUSD_ARRAY && item.kind != BUSD_MAP)
            continue;
        left += item.kind == BUSD_MAP ? 2 * item.number : item.number;
        if (left > (uint64_t)(in->end - in->at) + 1) { /* each part takes a byte or more */
            in->failed = true;
            return false;
        }
    }
    return true;
}

/* The next value, which must be of this kind. */
static inline busd_item busd_get_kind(busd_in *in, busd_kind kind)
{
    busd_item item;
    if (!busd_get_item(in, &item) || item.kind != kind) {
        in->failed = true;
        memset(&item, 0, sizeof item);
    }
    return item;
}

/* An integer between two bounds. */
static inline int64_t busd_get_int(busd_in *in, int64_t least, int64_t most)
{
    busd_item item;
    if (!busd_get_item(in, &item) || (item.kind != BUSD_INT && item.kind != BUSD_UINT)
        || (item.kind == BUSD_UINT && item.number > INT64_MAX) || (int64_t)item.number < least
        || (int64_t)item.number > most) {
        in->failed = true;
        return 0;
    }
    return (int64_t)item.number;
}

static inline uint64_t busd_get_uint(busd_in *in, uint64_t most)
{
    const uint64_t number = busd_get_kind(in, BUSD_UINT).number;
    in->failed |= number > most;
    return number;
}

static inline double busd_get_float(busd_in *in)
{
    busd_item item;
    busd_get_item(in, &item);
    if (item.kind == BUSD_UINT)
        return (double)item.number;
    if (item.kind == BUSD_INT)
        return (double)(int64_t)item.number;
    in->failed |= item.kind != BUSD_FLOAT;
    return item.real;
}

static inline bool busd_get_bool(busd_in *in) { return busd_get_kind(in, BUSD_BOOL).number != 0; }

/* The head of an array of `n` parts. */
static inline bool busd_get_array(busd_in *in, size_t n)
{
    in->failed |= busd_get_kind(in, BUSD_ARRAY).number != n;
    return !in->failed;
}

/* The head of an array: the number of its parts, at most `most`. The bytes left have room for them all. */
static inline size_t busd_get_count(busd_in *in, size_t most)
{
    const uint64_t number = busd_get_kind(in, BUSD_ARRAY).number;
    if (number > (uint64_t)(in->end - in->at) || number > most)
        in->failed = true;
    return in->failed ? 0 : (size_t)number;
}

/* --- the fields of a map */

/* Finds the value of `key` in the map that `map` begins with. */
static inline bool busd_find(busd_in map, const char *key, busd_in *value)
{
    busd_item item;
    const size_t n = strlen(key);
    if (!busd_get_item(&map, &item) || item.kind != BUSD_MAP)
        return false;
    for (uint64_t left = item.number; left > 0; left--) {
        if (!busd_get_item(&map, &item))
            return false;
        if (item.kind == BUSD_TEXT_ITEM && item.number == n && memcmp(item.bytes, key, n) == 0) {
            *value = map;
            return true;
        }
        if (item.kind == BUSD_ARRAY || item.kind == BUSD_MAP || !busd_get_past(&map))
            return false;
    }
    return false;
}

static inline uint64_t busd_find_number(busd_in map, const char *key, uint64_t otherwise)
{
    busd_in value;
    busd_item item;
    if (!busd_find(map, key, &value) || !busd_get_item(&value, &item)
        || (item.kind != BUSD_UINT && item.kind != BUSD_INT && item.kind != BUSD_BOOL))
        return otherwise;
    return item.number;
}

static inline double busd_find_real(busd_in map, const char *key, double otherwise)
{
    busd_in value;
    if (!busd_find(map, key, &value))
        return otherwise;
    const double number = busd_get_float(&value);
    return value.failed ? otherwise : number;
}

/* A text or bytes; NULL if there is none. */
static inline const unsigned char *busd_find_bytes(busd_in map, const char *key, size_t *n)
{
    busd_in value;
    busd_item item;
    *n = 0;
    if (!busd_find(map, key, &value) || !busd_get_item(&value, &item)
        || (item.kind != BUSD_TEXT_ITEM && item.kind != BUSD_BYTES_ITEM))
        return NULL;
    *n = (size_t)item.number;
    return item.bytes;
}

static inline bool busd_find_is(busd_in map, const char *key, const char *text)
{
    size_t n;
    const unsigned char *bytes = busd_find_bytes(map, key, &n);
    return bytes != NULL && n == strlen(text) && memcmp(bytes, text, n) == 0;
}

#endif
