/* The calls of a publisher. */
#include <stdlib.h>
#include <unistd.h>

#include "internal.h"

/* Whether a message may be published at all now. */
static int check(busd_publisher *p, uint64_t size)
{
    busd_bus *bus = p->end.node->bus;
    if (p->end.state == REFUSED)
        return fail(bus, EPIPE, "%s: busd has refused this publisher", p->end.topic);
    if (size > p->max_message_bytes)
        return fail(bus, EMSGSIZE, "%s: a message of %llu bytes; the limit is %llu", p->end.topic,
                    (unsigned long long)size, (unsigned long long)p->max_message_bytes);
    if (!stream_has_room(p)) {
        flush(bus);
        return fail(bus, EAGAIN, "%s: %llu messages are not acknowledged yet", p->end.topic,
                    (unsigned long long)(p->ring.latest - p->credit));
    }
    return 0;
}

int busd_loan(busd_publisher *p, size_t size, void **place)
{
    int status = place == NULL ? fail_encoding(p->end.node->bus) : check(p, size);
    status = status == 0 ? room_reserve(p, size, place) : status;
    p->loan = status == 0 ? size : 0;
    return status;
}

int busd_publish_loan(busd_publisher *p, size_t size)
{
    busd_bus *bus = p->end.node->bus;
    if (p->ring.loan == 0)
        return fail(bus, EINVAL, "%s: nothing is lent", p->end.topic);
    if (size > p->loan)
        return fail(bus, EINVAL, "%s: %zu bytes of a loan of %llu", p->end.topic, size, (unsigned long long)p->loan);
    p->stamp_ns = sizes_max(p->stamp_ns, (uint64_t)now_ns());
    ring_publish(&p->ring, (uint32_t)size, p->stamp_ns, 0);
    ring_doorbells(p, false);
    p->samples++;
    p->bytes += size;
    stream_published(p);
    if (p->end.qos.deadline_ns > 0)
        deadline_note(&p->end, (int64_t)p->stamp_ns);
    if (!p->end.is_dirty)
        report_due(&p->end);
    if (p->end.qos.liveliness == BUSD_MANUAL_BY_TOPIC && p->end.qos.lease_ns != 0)
        busd_publisher_assert_liveliness(p);
    return 0;
}

int busd_publish(busd_publisher *p, const void *data, size_t size)
{
    void *place;
    const int status = busd_loan(p, size, &place);
    if (status < 0)
        return status;
    copy_to_shared(place, data, size);
    return busd_publish_loan(p, size);
}

static int wait_for_room(busd_publisher *p, int64_t until_ns)
{
    busd_bus *bus = p->end.node->bus;
    while (!room_is_there(p)) {
        const int64_t left_ns = until_ns - now_ns();
        if (left_ns <= 0)
            return 0;
        const int status = busd_wait(bus, (int)sizes_min((uint64_t)left_ns / 1000000 + 1, 1000));
        if (status < 0)
            return status;
        if (p->end.is_closed || p->end.state == REFUSED)
            return fail(bus, EPIPE, "the publisher has ended");
    }
    return 1;
}

int busd_publisher_wait(busd_publisher *p, int timeout_ms)
{
    busd_bus *bus = p->end.node->bus;
    bus->waits++; /* a callback may destroy the publisher */
    const int status = wait_for_room(p, timeout_ms < 0 ? INT64_MAX : now_ns() + timeout_ms * INT64_C(1000000));
    bus->waits--;
    sweep_unless_in_turn(bus);
    return status;
}

int busd_publisher_assert_liveliness(busd_publisher *p)
{
    busd_bus *bus = p->end.node->bus;
    if (p->end.state != DECLARED)
        return fail(bus, ENOTCONN, "busd is away");
    p->owes_sign = bus->control.first != NULL; /* else the queue would grow while busd reads nothing */
    if (p->owes_sign)
        set_timer(bus, FLUSH, now_ns() + FLUSH_PAUSE_NS);
    else
        control_simple(bus, "alive", 1, (const char *const[]){"publisher"}, &p->end.id);
    return 0;
}

void busd_publisher_stats(const busd_publisher *p, busd_stats *stats)
{
    *stats = (busd_stats){.samples = p->samples, .bytes = p->bytes, .replaced = p->replaced,
                          .missed_deadlines = p->end.missed};
    if (p->is_streaming)
        stats->queued = p->ring.latest - p->sent_seq;
    if (p->end.qos.history == BUSD_KEEP_LAST && stats->queued > p->end.qos.depth) { /* stream.c passes over them */
        stats->replaced += stats->queued - p->end.qos.depth;
        stats->queued = p->end.qos.depth;
    }
    for (const struct match *m = p->matches; m != NULL; m = m->next) {
        const bool is_there = m->is_by_ring ? m->process != NULL : m->is_by_socket || m->is_bridged;
        const bool counts = !m->is_over && !m->is_tap && is_there;
        stats->matches += counts;
        stats->by_ring += counts && m->is_by_ring;
    }
}

int busd_publisher_matches(const busd_publisher *p)
{
    busd_stats stats;
    busd_publisher_stats(p, &stats);
    return (int)stats.matches;
}

void publisher_free(busd_publisher *p)
{
    matches_free(p);
    map_drop(p->map);
    if (p->fd >= 0)
        close(p->fd);
    endpoint_free(&p->end);
    free(p);
}
