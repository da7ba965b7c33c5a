/* A place in a publisher's ring for each message: growth, `hold`, and waiting for readers. docs/ring.md has the rules.
 *
 * The ring begins with its usual size. A publisher that can't share memory has a private ring of the same kind.
 */
#include <poll.h>
#include <unistd.h>

#include "internal.h"

#define MOST_TRIES 64 /* answers of the ring for one message; each but the last changes something */

/* Makes a ring. `fd` NULL: private. */
static struct map *make_ring(busd_bus *bus, struct ring_sizes sizes, uint64_t first_seq, struct ring_writer *ring,
                             int *fd)
{
    struct map *map = segment_make(bus, "busd-ring", ring_segment_bytes(sizes.capacity, sizes.index_length), fd);
    if (map == NULL)
        return NULL;
    ring_format(map->memory, sizes.capacity, sizes.index_length, first_seq);
    if (fd != NULL)
        segment_seal(*fd);
    ring_writer_attach(ring, map->memory);
    return map;
}

/* Makes a publisher's first ring. False: no memory. */
bool room_begin(busd_publisher *p)
{
    busd_bus *bus = p->end.node->bus;
    const uint64_t capacity = p->end.qos.history == BUSD_KEEP_ALL ? RING_USUAL_KEEP_ALL : RING_USUAL_CAPACITY;
    const struct ring_sizes sizes = {capacity, capacity / 128};
    p->ring_bytes = capacity;
    if (bus->shares)
        p->map = make_ring(bus, sizes, 1, &p->ring, &p->fd);
    if (p->map == NULL)
        p->map = make_ring(bus, sizes, 1, &p->ring, NULL);
    if (p->map == NULL)
        return false;
    p->is_streaming = p->fd < 0 || p->end.qos.durability == BUSD_TRANSIENT_LOCAL;
    room_set_hold(p);
    return true;
}

/* A record's head; it is in the ring. */
const unsigned char *room_record(const busd_publisher *p, uint64_t seq)
{
    return p->ring.data + (ring_position(&p->ring, seq) & (p->ring.capacity - 1));
}

/* The number of the first record stamped at or after `at_ns`; after the newest one if there is none. */
uint64_t room_since(const busd_publisher *p, uint64_t at_ns)
{
    uint64_t seq = p->ring.latest + 1;
    while (seq > p->ring.oldest && load_word(room_record(p, seq - 1) + 8) >= at_ns)
        seq--;
    return seq;
}

/* Sets `hold` and `keep` anew, after anything has changed on which they depend. */
void room_set_hold(busd_publisher *p)
{
    const busd_qos *qos = &p->end.qos;
    uint64_t hold = UINT64_MAX, keep = qos->history == BUSD_KEEP_ALL ? 1 : sizes_max(qos->depth, 1);
    if (qos->history == BUSD_KEEP_ALL && qos->durability == BUSD_TRANSIENT_LOCAL)
        keep = RING_FOR_EVER;
    for (const struct match *m = p->matches; m != NULL; m = m->next) {
        if (m->is_over || !m->is_by_ring)
            continue;
        keep = sizes_max(keep, m->depth);
        if (m->is_lossless && !m->is_silent && m->process == NULL)
            hold = sizes_min(hold, m->hold);
    }
    if (p->end.is_lossless && p->fd >= 0)
        hold = sizes_min(hold, p->known + 1);
    if (p->end.is_lossless && p->is_streaming)
        hold = sizes_min(hold, p->credit + 1);
    p->ring.hold = hold;
    p->ring.keep = keep;
    p->ring.floor = 0;
}

/* Whether all that busd has sent is taken. Then every match that a subscription knows is known here. */
bool has_nothing_unread(const busd_bus *bus)
{
    struct pollfd poller = {.fd = bus->sock, .events = POLLIN};
    return bus->sock < 0 || (bus->in_begin == bus->in_end && poll(&poller, 1, 0) == 0);
}

/* Moves `known` to the newest record. False: it is there already, or something is unread. */
static bool move_known(busd_publisher *p)
{
    if (!p->end.is_lossless || p->fd < 0 || p->known == p->ring.latest || !has_nothing_unread(p->end.node->bus))
        return false;
    p->known = p->ring.latest;
    room_set_hold(p);
    return true;
}

/* Tells busd of the newest ring, if it does not know it. */
void room_announce(busd_publisher *p)
{
    if (p->is_announced || p->fd < 0 || p->end.state != DECLARED)
        return;
    busd_out out;
    control_begin(&out, "ring", 2);
    field_number(&out, "publisher", p->end.id);
    field_number(&out, "descriptors", 1);
    p->is_announced = control_send(p->end.node->bus, &out, &p->fd, 1) == 0;
}

/* Continues in a larger ring. `size`: of a message that must fit; 0: any. `must`: ring_bytes does not count. */
static bool grow(busd_publisher *p, uint64_t size, bool must)
{
    busd_bus *bus = p->end.node->bus;
    struct ring_writer *ring = &p->ring, fresh;
    const uint64_t held = ring->latest + 1 - ring->oldest;
    if (!must && now_ns() < p->no_growth_ns)
        return false;
    const struct ring_sizes sizes = ring_next_sizes(ring->capacity, held, size, ring->keep, p->ring_bytes,
                                                    p->end.qos.history == BUSD_KEEP_ALL, must);
    int fd = -1;
    struct map *map = NULL;
    if (sizes.capacity != 0)
        map = make_ring(bus, sizes, ring_carry_from(ring, UINT64_MAX), &fresh, p->fd >= 0 ? &fd : NULL);
    if (map == NULL) {
        p->no_growth_ns = now_ns() + SECOND_NS;
        return false;
    }
    ring_carry(&fresh, ring);
    ring_go_on(ring, &fresh);
    ring_doorbells(p, true);
    map_drop(p->map);
    if (p->fd >= 0)
        close(p->fd);
    p->map = map;
    p->fd = fd;
    p->is_announced = false;
    p->wanted = 0;
    room_set_hold(p);
    room_announce(p);
    return true;
}

/* The ring has no room before its readers take records. 0: it has now; -EAGAIN: wait. */
static int make_room(busd_publisher *p, uint64_t size)
{
    if (move_known(p))
        return 0;
    if (!p->end.is_lossless) {
        if (grow(p, size, false))
            return 0;
        for (struct match *m = p->matches; m != NULL; m = m->next)
            match_make_lossy(p, m);
        room_set_hold(p);
        return 0;
    }
    const uint64_t held = p->ring.latest + 1 - p->ring.oldest;
    if (p->end.state == DECLARED && ring_is_filled_by_few(p->ring.capacity, held) && grow(p, size, false))
        return 0;
    if (!ring_wait_for_room(&p->ring))
        return 0;
    p->wanted = atomic_load_explicit(&p->ring.header->room.wanted, memory_order_relaxed); /* own word */
    if (p->end.node->bus->sock < 0)
        set_timer(p->end.node->bus, SWEEP, now_ns() + SECOND_NS); /* nobody else reports the end of a reader now */
    return -EAGAIN;
}

/* A place for `size` bytes: 0, -EAGAIN or -ENOMEM. */
int room_reserve(busd_publisher *p, uint64_t size, void **place)
{
    busd_bus *bus = p->end.node->bus;
    bool force = false;
    for (int i = 0; i < MOST_TRIES; i++) {
        switch (ring_reserve(&p->ring, size, force, place)) {
        case RING_OK:
            if (p->wanted != 0) {
                bell_disarm(&p->ring.header->room);
                p->wanted = 0;
            }
            return 0;
        case RING_HELD: move_known(p); break;
        case RING_SHORT: force = !grow(p, size, false); break;
        case RING_FULL:
            if (make_room(p, size) < 0)
                return fail(bus, EAGAIN, "%s: its subscriptions have not taken enough of the messages yet",
                            p->end.topic);
            break;
        default: /* too large, or pinned */
            if (!grow(p, size, true))
                return fail(bus, ENOMEM, "%s: no memory for a ring for a message of %llu bytes", p->end.topic,
                            (unsigned long long)size);
        }
    }
    return fail(bus, EAGAIN, "%s: no room", p->end.topic);
}

/* After -EAGAIN: whether another try is worth while. */
bool room_is_there(busd_publisher *p)
{
    if (!stream_has_room(p))
        return false;
    if (p->wanted == 0 || ring_taken(&p->ring) >= p->wanted || move_known(p)) {
        bell_disarm(&p->ring.header->room);
        p->wanted = 0;
        return true;
    }
    return false;
}
