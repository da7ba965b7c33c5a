/* Base of the headers that `bus interface c` writes. C11 and C++17.
 *
 * A message is a struct. Texts, bytes and lists are views: of the program's data when it is published, of the taken
 * message and the arena when it is decoded. For each message type T there are
 *
 *     T__init(&m)                        all fields with their defaults
 *     T__put(&out, &m)                   encodes it, see pack.h
 *     T__get(&in, &m, &arena)            decodes it
 *     T__size(&m)                        bytes of the encoded message
 *     T__publish(publisher, &m)          encodes it in place in the ring; results as busd_publish()
 *     T__decode(&taken, &m, &arena)      0; -EBADMSG: the bytes are no such message; -ENOMEM
 *     T__type                            its name, hash and schema
 */
#ifndef BUSD_TYPES_H
#define BUSD_TYPES_H

#include <errno.h>

#include "busd.h"
#include "pack.h"

/* --- views */

typedef struct busd_text {
    const char *data; /* UTF-8, `size` bytes; not ended by a zero */
    size_t size;
} busd_text;

typedef struct busd_bytes {
    const void *data;
    size_t size;
} busd_bytes;

static inline busd_text busd_text_of(const char *text)
{
    const busd_text view = {text, strlen(text)};
    return view;
}

#define BUSD_LIST(NAME, T)                                                                                             \
    typedef struct NAME {                                                                                              \
        const T *items;                                                                                                \
        size_t count;                                                                                                  \
    } NAME

BUSD_LIST(busd_bool_list, bool);
BUSD_LIST(busd_int8_list, int8_t);
BUSD_LIST(busd_int16_list, int16_t);
BUSD_LIST(busd_int32_list, int32_t);
BUSD_LIST(busd_int64_list, int64_t);
BUSD_LIST(busd_uint8_list, uint8_t);
BUSD_LIST(busd_uint16_list, uint16_t);
BUSD_LIST(busd_uint32_list, uint32_t);
BUSD_LIST(busd_uint64_list, uint64_t);
BUSD_LIST(busd_float32_list, float);
BUSD_LIST(busd_float64_list, double);
BUSD_LIST(busd_text_list, busd_text);

/* --- memory of decoded lists */

#define BUSD_ARENA_BLOCK 4096u

struct busd_arena_block {
    struct busd_arena_block *before;
    size_t size, used;
};

/* Initialise with zeroes. Lists stay valid until it is cleared or freed. NULL in place of an arena: the message has no
 * list, or only empty ones. */
typedef struct busd_arena {
    struct busd_arena_block *last;
    bool failed; /* no memory */
} busd_arena;

/* Place for `count` things of `size` bytes; NULL without memory, and for none. */
static inline void *busd_arena_take(busd_arena *arena, size_t count, size_t size)
{
    const size_t head = (sizeof(struct busd_arena_block) + 15) & ~(size_t)15;
    if (arena == NULL || count == 0 || count > (SIZE_MAX / 4) / size)
        return NULL;
    const size_t wanted = (count * size + 15) & ~(size_t)15;
    struct busd_arena_block *block = arena->last;
    if (block == NULL || block->size - block->used < wanted) {
        const size_t room = wanted > BUSD_ARENA_BLOCK ? wanted : BUSD_ARENA_BLOCK;
        block = (struct busd_arena_block *)malloc(head + room);
        if (block == NULL) {
            arena->failed = true;
            return NULL;
        }
        block->before = arena->last;
        block->size = room;
        block->used = 0;
        arena->last = block;
    }
    block->used += wanted;
    return (char *)block + head + (block->used - wanted);
}

static inline void busd_arena_free(busd_arena *arena)
{
    while (arena->last != NULL) {
        struct busd_arena_block *block = arena->last;
        arena->last = block->before;
        free(block);
    }
    arena->failed = false;
}

/* Forgets all lists, and keeps the newest block for the next message. */
static inline void busd_arena_clear(busd_arena *arena)
{
    struct busd_arena_block *kept = arena->last;
    if (kept == NULL)
        return;
    arena->last = kept->before;
    busd_arena_free(arena);
    kept->before = NULL;
    kept->used = 0;
    arena->last = kept;
}

/* --- fields */

static inline void busd_put_text_view(busd_out *out, busd_text text, size_t most)
{
    out->failed |= text.size > most;
    busd_put_text(out, text.data, text.size);
}

static inline void busd_get_text_view(busd_in *in, busd_text *text)
{
    const busd_item item = busd_get_kind(in, BUSD_TEXT_ITEM);
    text->data = (const char *)item.bytes;
    text->size = (size_t)item.number;
}

static inline void busd_put_bytes_view(busd_out *out, busd_bytes bytes, size_t most)
{
    out->failed |= bytes.size > most;
    busd_put_bytes(out, bytes.data, bytes.size);
}

static inline void busd_get_bytes_view(busd_in *in, busd_bytes *bytes, size_t most)
{
    const busd_item item = busd_get_kind(in, BUSD_BYTES_ITEM);
    bytes->data = item.bytes;
    bytes->size = (size_t)item.number;
    in->failed |= bytes->size > most;
}

/* Exactly `n` bytes, into the message. */
static inline void busd_get_bytes_copy(busd_in *in, void *to, size_t n)
{
    const busd_item item = busd_get_kind(in, BUSD_BYTES_ITEM);
    if (in->failed || item.number != n)
        in->failed = true;
    else
        memcpy(to, item.bytes, n);
}

static inline void busd_put_count(busd_out *out, size_t count, size_t most)
{
    out->failed |= count > most;
    busd_put_array(out, count);
}

/* --- a message type: the functions that need no fields */

/* The functions of any body: a message, a request, a response. */
#define BUSD_BODY(T)                                                                                                   \
    static inline size_t T##__size(const T *m)                                                                         \
    {                                                                                                                  \
        busd_out out = {NULL, 0, SIZE_MAX, true, false};                                                               \
        T##__put(&out, m);                                                                                             \
        return out.failed ? 0 : out.size;                                                                              \
    }                                                                                                                  \
    static inline int T##__decode(const busd_message *taken, T *m, busd_arena *arena)                                  \
    {                                                                                                                  \
        const unsigned char *bytes = (const unsigned char *)taken->data;                                               \
        busd_in in = {bytes, bytes + taken->size, false};                                                              \
        T##__get(&in, m, arena);                                                                                       \
        if (arena != NULL && arena->failed)                                                                            \
            return -ENOMEM;                                                                                            \
        return in.failed ? -EBADMSG : 0;                                                                               \
    }

#define BUSD_MESSAGE(T)                                                                                                \
    BUSD_BODY(T)                                                                                                       \
    static inline int T##__publish(busd_publisher *publisher, const T *m)                                              \
    {                                                                                                                  \
        void *place;                                                                                                   \
        const size_t size = T##__size(m);                                                                              \
        if (size == 0)                                                                                                 \
            return busd_loan(publisher, 0, NULL); /* -EINVAL: a text, bytes or a list longer than its type permits */  \
        const int status = busd_loan(publisher, size, &place);                                                         \
        if (status < 0)                                                                                                \
            return status;                                                                                             \
        busd_out out = {(unsigned char *)place, 0, size, true, false};                                                 \
        T##__put(&out, m);                                                                                             \
        return busd_publish_loan(publisher, out.size);                                                                 \
    }

/* A service S, with the bodies S_Request and S_Response:
 *
 *     S__call(client, &request, answer, user)    as busd_client_call()
 *     S__reply(server, call, &response)          as busd_reply()
 *     S_Request__decode, S_Response__decode      of the messages that the callbacks get
 *     S__service                                 its types
 */
#define BUSD_SERVICE(S)                                                                                                \
    BUSD_BODY(S##_Request)                                                                                             \
    BUSD_BODY(S##_Response)                                                                                            \
    static inline int S##__call(busd_client *client, const S##_Request *request, busd_answer *answer, void *user)      \
    {                                                                                                                  \
        busd_out out = {NULL, 0, 0, false, false};                                                                     \
        S##_Request__put(&out, request);                                                                               \
        const int status = busd_client_call(client, out.failed ? NULL : out.bytes, out.size, answer, user);            \
        free(out.bytes);                                                                                               \
        return status;                                                                                                 \
    }                                                                                                                  \
    static inline int S##__reply(busd_server *server, const busd_call *call, const S##_Response *response)             \
    {                                                                                                                  \
        busd_out out = {NULL, 0, 0, false, false};                                                                     \
        S##_Response__put(&out, response);                                                                             \
        const int status = busd_reply(server, call, out.failed ? NULL : out.bytes, out.size);                          \
        free(out.bytes);                                                                                               \
        return status;                                                                                                 \
    }

#endif
