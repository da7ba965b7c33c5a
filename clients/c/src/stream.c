/* A publisher's samples by socket: a position in its ring (`sent_seq`), and the credit of a lossless publisher.
 *
 * A publisher streams while a match uses the socket. It always streams if it has no ring to share, or a history that
 * busd must keep (transient local), and for a while after busd was away. Otherwise its samples only go into the ring;
 * the first run after that has the flag *resumed*.
 *
 * Everything between `sent_seq` and the newest record waits for the socket. If more than the depth waits, the oldest
 * samples are passed over, and counted as replaced. A lossless publisher sends at most a window without credit, and
 * `hold` keeps the records without credit: so after a lost connection they are sent again.
 */
#include <stdlib.h>

#include "stream.h"

#define MOST_RECORDS 64 /* of a run */

static uint64_t record_size(const busd_publisher *p, uint64_t seq)
{
    return load_word(room_record(p, seq) + 16) & UINT32_MAX;
}

/* Whether the samples published now go to busd. */
bool stream_is_on(busd_publisher *p)
{
    if (p->fd < 0 || p->socket_matches != 0 || p->end.qos.durability == BUSD_TRANSIENT_LOCAL)
        return true;
    if (p->stream_until_ns != 0 && now_ns() < p->stream_until_ns)
        return true;
    p->stream_until_ns = 0;
    return false;
}

/* Whether the window has room for another sample. */
bool stream_has_room(const busd_publisher *p)
{
    return !p->end.is_lossless || !p->is_streaming || p->end.window_samples == 0
           || p->ring.latest < p->credit + p->end.window_samples;
}

/* Begins to stream, with the samples after `seq`. */
static void stream_begin(busd_publisher *p, uint64_t seq)
{
    p->is_resumed |= seq != p->sent_seq;
    p->sent_seq = p->credit = seq;
    p->flying_bytes = 0;
    p->is_streaming = true;
    room_set_hold(p);
}

/* A sample is in the ring: sends it, if it must go by socket. */
void stream_published(busd_publisher *p)
{
    if (stream_is_on(p)) {
        if (!p->is_streaming)
            stream_begin(p, p->ring.latest - 1);
        if (p->end.state == DECLARED && p->end.node->bus->current == NULL)
            flush(p->end.node->bus);
    } else if (p->is_streaming) {
        p->is_streaming = false;
        room_set_hold(p);
    }
}

/* A subscription by socket has come: it gets the samples stamped since `at_ns`. */
void stream_match(busd_publisher *p, uint64_t at_ns)
{
    if (!p->is_streaming)
        stream_begin(p, sizes_max(p->sent_seq, room_since(p, at_ns) - 1));
    flush(p->end.node->bus);
}

/* --- runs */

static void run_head(unsigned char head[RUN_HEAD_BYTES], uint64_t size, unsigned flags, uint64_t endpoint,
                     uint64_t other, uint64_t first_seq, uint32_t count)
{
    const uint32_t length = (uint32_t)(RUN_HEAD_BYTES - 4 + size), ids[] = {(uint32_t)endpoint, (uint32_t)other};
    const uint32_t tail[] = {count, 0};
    const unsigned char kind[] = {FRAME_DATA, (unsigned char)flags, 0, 0};
    memcpy(head, &length, 4);
    memcpy(head + 4, kind, 4);
    memcpy(head + 8, ids, 8);
    memcpy(head + 16, &first_seq, 8);
    memcpy(head + 24, tail, 8);
}

static void record_head(unsigned char head[RECORD_BYTES], const unsigned char *record)
{
    const uint32_t size = (uint32_t)load_word(record + 16);
    const uint64_t stamp_ns = load_word(record + 8);
    memcpy(head, &size, 4);
    memcpy(head + 4, &stamp_ns, 8);
}

/* Whether a lossless publisher may send `size` bytes more, with the sample `seq`. */
static bool may_send(const busd_publisher *p, uint64_t seq, uint64_t flying_bytes, uint64_t size)
{
    if (!p->end.is_lossless || flying_bytes == 0 || p->end.window_samples == 0)
        return true;
    return seq - p->credit <= p->end.window_samples && flying_bytes + size <= p->end.window_bytes;
}

/* Passes over samples that are too old to be sent. */
static void skip_old(busd_publisher *p)
{
    uint64_t first = p->sent_seq + 1;
    if (p->end.qos.history == BUSD_KEEP_LAST && p->ring.latest - p->sent_seq > p->end.qos.depth)
        first = p->ring.latest + 1 - p->end.qos.depth;
    first = sizes_max(first, p->ring.oldest);
    p->replaced += first - 1 - p->sent_seq;
    p->sent_seq = first - 1;
}

/* Sends one run. False: nothing is due, or the socket takes nothing. */
bool stream_flush(busd_publisher *p)
{
    if (p->end.state != DECLARED || !p->is_streaming || p->sent_seq >= p->ring.latest)
        return false;
    unsigned char head[RUN_HEAD_BYTES], heads[MOST_RECORDS][RECORD_BYTES];
    struct iovec parts[1 + 2 * MOST_RECORDS];
    uint64_t size = 0, flying = p->flying_bytes;
    uint32_t count = 0;
    skip_old(p);
    for (uint64_t seq = p->sent_seq + 1; seq <= p->ring.latest && count < MOST_RECORDS; seq++, count++) {
        const unsigned char *record = room_record(p, seq);
        const uint64_t payload = record_size(p, seq), whole = RECORD_BYTES + payload;
        if ((count != 0 && size + whole > RUN_BYTES) || !may_send(p, seq, flying, whole))
            break;
        record_head(heads[count], record);
        parts[1 + 2 * count] = (struct iovec){heads[count], RECORD_BYTES};
        parts[2 + 2 * count] = (struct iovec){(void *)(uintptr_t)(record + RING_HEAD_BYTES), payload};
        size += whole;
        flying += whole;
    }
    if (count == 0)
        return false;
    run_head(head, size, p->is_resumed ? FLAG_RESUMED : 0, p->end.id, 0, p->sent_seq + 1, count);
    parts[0] = (struct iovec){head, sizeof head};
    if (!send_run(p->end.node->bus, parts, 1 + 2 * (size_t)count, sizeof head + size))
        return false;
    p->sent_seq += count;
    p->is_resumed = false;
    if (p->end.is_lossless)
        p->flying_bytes = flying;
    return true;
}

/* Whether any sample waits for the socket. */
bool streams_wait(const busd_bus *bus)
{
    for (const busd_publisher *p = bus->publishers; p != NULL; p = p->next)
        if (p->end.state == DECLARED && p->is_streaming && p->sent_seq < p->ring.latest)
            return true;
    return false;
}

/* Sends the samples stamped since `at_ns` and numbered after `after` to one subscription, in order with the control
 * messages. */
void stream_resend(busd_publisher *p, uint64_t at_ns, uint64_t after, uint64_t only_for)
{
    busd_bus *bus = p->end.node->bus;
    for (uint64_t seq = sizes_max(room_since(p, at_ns), after + 1); seq <= p->ring.latest; seq++) {
        const unsigned char *record = room_record(p, seq);
        const uint64_t payload = record_size(p, seq);
        struct frame *frame = malloc(sizeof *frame + RUN_HEAD_BYTES + RECORD_BYTES + payload);
        if (frame == NULL) {
            lose_connection(bus, "no memory to send samples again");
            return;
        }
        *frame = (struct frame){.size = RUN_HEAD_BYTES + RECORD_BYTES + payload};
        run_head(frame->bytes, RECORD_BYTES + payload, 0, p->end.id, only_for, seq, 1);
        record_head(frame->bytes + RUN_HEAD_BYTES, record);
        memcpy(frame->bytes + RUN_HEAD_BYTES + RECORD_BYTES, record + RING_HEAD_BYTES, payload);
        frame_queue(bus, frame);
    }
}

/* --- credit, and a lost connection */

void stream_credit(busd_publisher *p, uint64_t seq)
{
    const uint64_t last = sizes_min(seq, p->sent_seq);
    if (!p->end.is_lossless || last <= p->credit)
        return;
    for (uint64_t one = sizes_max(p->credit + 1, p->ring.oldest); one <= last; one++)
        p->flying_bytes -= sizes_min(p->flying_bytes, RECORD_BYTES + record_size(p, one));
    p->credit = last;
    if (p->credit == p->sent_seq)
        p->flying_bytes = 0;
    room_set_hold(p);
    flush(p->end.node->bus);
}

/* The connection is lost. Matches by socket may come back: until then their samples wait. */
void stream_lost(busd_publisher *p)
{
    if (p->is_streaming && p->end.is_lossless)
        p->sent_seq = p->credit;
    p->flying_bytes = 0;
    p->socket_matches = 0;
    if (p->is_streaming)
        p->stream_until_ns = INT64_MAX;
    for (struct match *m = p->matches; m != NULL; m = m->next) {
        m->is_stale = true;
        m->is_by_socket = m->is_bridged = false;
    }
}

/* The number of the first sample that the next busd gets. Before the publisher is declared. */
uint64_t stream_next_seq(busd_publisher *p)
{
    if (p->stream_until_ns == INT64_MAX)
        p->stream_until_ns = now_ns() + GIVE_UP_NS;
    if (p->end.qos.durability == BUSD_TRANSIENT_LOCAL) { /* its whole history */
        p->sent_seq = p->ring.oldest - 1;
        p->credit = p->sent_seq;
    } else if (!p->end.was_declared) { /* no subscription could match until now */
        p->sent_seq = p->credit = p->ring.latest;
    }
    if (!p->is_streaming)
        return p->ring.latest + 1;
    skip_old(p);
    p->is_resumed = false;
    return p->sent_seq + 1;
}
