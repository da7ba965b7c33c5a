/* The publishers of a subscription, and their rings. docs/ring.md: "Reading"; feed.h reads one publisher's rings.
 *
 *     no seat               its samples come by socket, if any
 *     a seat                it is read by ring
 *     is_stale              busd was lost, or is back and has not made the match again. Its ring is read on
 *     is_gone with a seat   the samples left in its ring are taken, then the ring is left
 *     is_gone               only its last number is remembered, because it may come back
 */
#include <stdlib.h>
#include <sys/random.h>
#include <unistd.h>

#include "internal.h"

/* --- slots of our readers' segment */

static struct seat *seat_take(busd_bus *bus)
{
    struct seat *seat = bus->free_count == 0 ? NULL : calloc(1, sizeof *seat);
    if (seat == NULL)
        return NULL;
    seat->bus = bus;
    seat->number = bus->free_slots[bus->free_first];
    seat->slot = &readers_slots(bus->readers->memory)[seat->number];
    bus->free_first = (bus->free_first + 1) % SLOTS;
    bus->free_count--;
    return seat;
}

/* Gives the slot back, once its match is over and nothing is pinned. Longest free slots are used first. */
void seat_release(struct seat *seat)
{
    busd_bus *bus = seat->bus;
    if (!seat->is_left || seat->pinned != 0)
        return;
    bus->free_slots[(bus->free_first + bus->free_count++) % SLOTS] = seat->number;
    free(seat);
}

/* --- sources */

/* The source with this number at the present busd, or with it before its return; NULL: none has it. */
struct source *source_find(const busd_subscription *sub, uint64_t number)
{
    struct source *source = number == 0 || number == NO_NUMBER ? NULL : sub->sources;
    while (source != NULL && ((source->number != number && source->before != number) || source->is_stale))
        source = source->next;
    return source;
}

/* The last number that the next busd need not send: received by any route, or counted as lost; 0: none. */
uint64_t source_position(const struct source *source)
{
    return sizes_max(source->seat != NULL ? source->feed.ring.next - 1 : source->last_seq, source->missed_seq);
}

static struct source *source_of_gid(busd_subscription *sub, const unsigned char *gid)
{
    struct source *source = sub->sources;
    while (source != NULL && memcmp(source->gid, gid, sizeof source->gid) != 0)
        source = source->next;
    if (source != NULL || (source = calloc(1, sizeof *source)) == NULL)
        return source;
    memcpy(source->gid, gid, sizeof source->gid);
    source->doorbell = -1;
    source->next = sub->sources;
    sub->sources = source;
    return source;
}

static void forget_oldest_gone(busd_subscription *sub)
{
    struct source **oldest = NULL;
    unsigned count = 0;
    for (struct source **at = &sub->sources; *at != NULL; at = &(*at)->next) {
        if (!(*at)->is_gone || (*at)->seat != NULL)
            continue;
        oldest = at; /* the list begins with the newest */
        count++;
    }
    if (count <= MOST_GONE)
        return;
    struct source *source = *oldest;
    *oldest = source->next;
    inbox_forget(sub, source);
    free(source);
}

/* Shows the publisher how far its samples are taken, and rings it if it waits for that. */
void source_show_cursor(struct source *source)
{
    if (feed_show_cursor(&source->feed) && source->doorbell >= 0)
        doorbell_ring(source->doorbell, KNOCK_ANY);
}

/* Leaves the ring. Its samples that still wait are lost; see drain(). */
void source_leave(busd_subscription *sub, struct source *source)
{
    if (source->seat == NULL)
        return;
    struct feed *feed = &source->feed;
    sub->dropped[sub->depth != 0 ? REPLACED : PUBLISHER_QUEUE] += feed->ring.overrun;
    sub->dropped[REPLACED] += feed->ring.replaced;
    sub->passed += feed->ring.next - feed->first;
    source->last_seq = feed->ring.next - 1;
    feed_close(feed, source->seat->bus->pid == getpid());
    if (source->doorbell >= 0)
        close(source->doorbell);
    source->doorbell = -1;
    source->newest = NULL;
    source->seat->is_left = true;
    seat_release(source->seat);
    source->seat = NULL;
    source->is_by_ring = source->is_complete = false;
}

/* Takes back a jump of the numbers of a broken publisher: busd accepts no such number, and the samples never
 * existed. */
static void go_back(struct feed *feed, const struct ring_reader *before)
{
    feed->ring.next = before->next;
    feed->ring.overrun = before->overrun;
}

/* Moves the samples that wait in the ring into the queue, before the ring is left. */
static void drain(busd_subscription *sub, struct source *source)
{
    struct feed *feed = &source->feed;
    struct ring_reader before = feed->ring;
    enum ring_status status;
    source->taken_seq = feed->ring.next - 1;
    feed_poll(feed, 0);
    while ((status = feed_head(feed, 0)) == RING_OK && feed_is_sound(feed)) {
        const struct ring_record record = feed->head;
        struct sample *sample = sample_new(sub, record.size + 8);
        if (sample == NULL)
            return;
        sample->source = source;
        sample->seq = record.seq;
        sample->publisher = source->number;
        sample->stamp_ns = (int64_t)feed_stamp(feed, &record);
        sample->size = record.size;
        if (feed_copy(feed, 0, &record, sample->bytes) == RING_OK) {
            inbox_add(sub, sample);
            before = feed->ring;
        } else {
            sample_free(sample);
        }
    }
    if (status == RING_CORRUPT || !feed_is_sound(feed))
        go_back(feed, &before);
}

static void refuse(busd_subscription *sub, const struct source *source, const char *fault)
{
    busd_out out;
    control_begin(&out, "noshm", 3);
    field_number(&out, "endpoint", sub->end.id);
    field_number(&out, "other", source->number);
    field_text(&out, "text", fault);
    control_send(sub->end.node->bus, &out, NULL, 0);
    tell(sub->end.node->bus, BUSD_ROUTE, &sub->end, "%s by socket: %s", sub->end.topic, fault);
}

/* --- rings */

static void leave_ring(struct feed_ring *ring)
{
    struct ring_of *ours = (struct ring_of *)ring;
    map_drop(ours->map);
    free(ours);
}

/* Maps a publisher's ring. Returns its fault; NULL: *ring is it. */
static const char *map_ring(int fd, struct ring_of **ring)
{
    struct map *map;
    const char *fault = segment_map(fd, &map);
    struct ring_of *ours = fault == NULL ? calloc(1, sizeof *ours) : NULL;
    if (fault == NULL)
        fault = ours == NULL ? "no memory" : ring_check(map->memory, map->size, &ours->ring.geometry);
    if (fault != NULL) {
        map_drop(map);
        free(ours);
        return fault;
    }
    ours->map = map;
    ours->ring.memory = map->memory;
    ours->ring.leave = leave_ring;
    *ring = ours;
    return NULL;
}

static const char *extend(struct source *source, int fd)
{
    struct ring_of *ring;
    const char *fault = map_ring(fd, &ring);
    if (fault != NULL)
        return fault;
    if (!feed_extend(&source->feed, &ring->ring)) {
        leave_ring(&ring->ring);
        return "too many rings of this publisher wait";
    }
    source->newest = ring->map;
    return NULL;
}

static uint64_t random_number(void)
{
    uint64_t number;
    return getrandom(&number, sizeof number, GRND_NONBLOCK) == sizeof number ? number : (uint64_t)now_ns();
}

/* How many samples a publisher with these QoS keeps. */
static uint64_t kept_by(busd_in qos)
{
    if (!busd_find_is(qos, "durability", "transient_local"))
        return 0;
    const bool keeps_all = busd_find_is(qos, "history", "keep_all");
    return keeps_all ? RING_FOR_EVER : sizes_min(busd_find_number(qos, "depth", 10), RING_FOR_EVER);
}

/* How much of its history the subscription gets. */
static uint64_t history_of(const busd_subscription *sub, const struct source *source)
{
    if (!source->has_history)
        return 0;
    return sub->depth != 0 ? sizes_min(source->kept, sub->depth) : source->kept;
}

/* Begins to read the ring. Returns the fault because of which it can't. */
static const char *attach(busd_subscription *sub, struct source *source, busd_in body, int *fds)
{
    busd_bus *bus = sub->end.node->bus;
    struct feed *feed = &source->feed;
    struct ring_of *ring;
    struct seat *seat = seat_take(bus);
    if (seat == NULL)
        return bus->free_count == 0 ? "all slots of the readers' segment are in use" : "no memory";
    const char *fault = map_ring(fds[0], &ring);
    if (fault != NULL) {
        seat->is_left = true;
        seat_release(seat);
        return fault;
    }
    const uint64_t known = source_position(source); /* before it has the seat */
    source->seat = seat;
    source->newest = ring->map;
    feed_attach(feed, &ring->ring, seat->slot, random_number());
    feed->lifespan_ns = source->lifespan_ns;
    feed->clock_ns = source->clock_ns;
    const uint64_t at_ns = busd_find_number(body, "at_ns", 0);
    uint64_t old = 0, seq = feed_find(feed, at_ns, history_of(sub, source), &old);
    if (known != 0)
        seq = known + 1;
    else if (busd_find_number(body, "next_seq", 1) == 1 && (int64_t)at_ns > sub->declared_ns)
        seq = 1; /* the publisher is younger than the subscription */
    source->history_end = seq + old;
    if (!feed_begin(feed, seq)) {
        feed->first = feed->ring.next = 1; /* nothing of it counts */
        source_leave(sub, source);
        source->last_seq = 0;
        return "the ring's numbers are out of bounds";
    }
    if (sub->end.is_lossless) {
        source->doorbell = fds[1]; /* taken over: a copy may fail, and the publisher would wait for ever */
        fds[1] = -1;
    }
    source->is_by_ring = true;
    source->noted = feed->ring.next - 1;
    return NULL;
}

/* --- messages of busd */

/* Counts the samples up to `last` that have not come and will not come. Does nothing for a number that can't be. */
static void count_missed(busd_subscription *sub, struct source *source, uint64_t last)
{
    if (last > MAX_SEQ)
        return;
    uint64_t known = sizes_max(source_position(source), source->routed_seq);
    if (source->seat != NULL)
        known = sizes_max(known, feed_newest(&source->feed)); /* they wait in its ring */
    if (last > known)
        count_away(sub, last - known);
    source->missed_seq = sizes_max(source->missed_seq, last);
}

static void by_socket(busd_subscription *sub, struct source *source, busd_in body, bool is_new)
{
    const uint64_t next_seq = busd_find_number(body, "next_seq", 1);
    if (source->seat != NULL) {
        drain(sub, source);
        source_leave(sub, source);
    }
    const bool comes_again = source->has_history || (source->is_lossless && sub->end.node->bus->is_new_busd);
    source->is_back = !is_new && comes_again;
    if (!is_new && !comes_again)
        count_missed(sub, source, next_seq - 1);
    const uint64_t known = source_position(source);
    const uint64_t missing = source->is_back && next_seq > known ? next_seq - known - 1 : 0;
    count_again(sub, sizes_min(missing, RING_FOR_EVER) + source->kept);
}

void subscription_matched(busd_subscription *sub, busd_in body, busd_in qos, const unsigned char *gid, int *fds,
                          unsigned count)
{
    busd_bus *bus = sub->end.node->bus;
    struct source *source = source_of_gid(sub, gid);
    if (source == NULL)
        return;
    const bool is_new = source->number == 0, was_gone = source->is_gone;
    const bool is_tap = busd_find_number(body, "is_tap", 0) != 0; /* now: a callback can replace the received bytes */
    const double lifespan_s = busd_find_real(qos, "lifespan", 0);
    source->before = was_gone && source->number != NO_NUMBER ? source->number : 0;
    source->number = busd_find_number(body, "other", 0);
    source->clock_ns = busd_find_number(body, "clock_ns", 0);
    source->lifespan_ns = lifespan_s > 0 && lifespan_s < 1e9 ? (uint64_t)(lifespan_s * 1e9) : 0;
    source->is_lossless = sub->end.is_lossless && busd_find_is(qos, "history", "keep_all")
                          && !busd_find_is(qos, "reliability", "best_effort");
    source->kept = kept_by(qos);
    source->has_history = sub->end.qos.durability != BUSD_VOLATILE && source->kept != 0;
    source->is_stale = source->is_gone = source->is_complete = false;
    source->acked_seq = 0;
    source->first_seq = busd_find_number(body, "next_seq", 1);
    source->awaits_sign = busd_find_number(body, "awaits_sign", 0) != 0;
    if (!busd_find_is(body, "route", "shm") || !bus->shares) {
        by_socket(sub, source, body, is_new);
    } else {
        if (source->seat != NULL && was_gone) {
            drain(sub, source);
            source_leave(sub, source);
        }
        const char *fault = count != 2               ? "descriptors are missing"
                            : source->seat == NULL   ? attach(sub, source, body, fds)
                            : segment_is(fds[0], source->newest) ? NULL
                                                     : extend(source, fds[0]);
        if (fault != NULL)
            refuse(sub, source, fault);
        else
            control_simple(bus, "attach", 3, (const char *const[]){"subscription", "source", "slot"},
                           (const uint64_t[]){sub->end.id, source->number, source->seat->number});
    }
    report_due(&sub->end);
    if (is_tap || source->is_told)
        return;
    source->is_told = true;
    tell(bus, BUSD_MATCHED, &sub->end, "%s has a publisher by %s", sub->end.topic,
         source->is_by_ring ? "shared memory" : "socket");
}

/* Returns whether the program knows of the match: then tell_unmatched() follows, after which there may be other
 * sources. */
static bool source_finish(busd_subscription *sub, struct source *source)
{
    const bool was_told = source->is_told;
    source->is_gone = true;
    source->is_stale = source->is_told = false;
    if (source->seat != NULL && feed_finish(&source->feed))
        source_leave(sub, source);
    return was_told;
}

static void tell_unmatched(busd_subscription *sub)
{
    tell(sub->end.node->bus, BUSD_UNMATCHED, &sub->end, "%s has lost a publisher", sub->end.topic);
}

void subscription_unmatched(busd_subscription *sub, busd_in body)
{
    struct source *source = source_find(sub, busd_find_number(body, "other", 0));
    if (source == NULL || source->is_gone)
        return;
    source->routed_seq = sizes_min(busd_find_number(body, "last_seq", 0), MAX_SEQ);
    const bool was_told = source_finish(sub, source);
    forget_oldest_gone(sub);
    if (was_told)
        tell_unmatched(sub);
}

void subscription_rerouted(busd_subscription *sub, uint64_t number)
{
    struct source *source = source_find(sub, number);
    if (source == NULL)
        return;
    if (source->seat != NULL) {
        drain(sub, source);
        source_leave(sub, source);
    }
    control_simple(sub->end.node->bus, "left", 3, (const char *const[]){"subscription", "source", "seq"},
                   (const uint64_t[]){sub->end.id, number, source->last_seq});
}

/* RingReplaced: the publisher continues in another ring. */
void subscription_ring(busd_subscription *sub, busd_in body, const int *fds, unsigned count)
{
    struct source *source = source_find(sub, busd_find_number(body, "source", 0));
    if (source == NULL || source->seat == NULL)
        return;
    const char *fault = count != 1 ? "descriptors are missing" : extend(source, fds[0]);
    if (fault != NULL)
        refuse(sub, source, fault);
}

/* The connection is lost. The next busd gives the numbers out again, also those of sources that have left. */
void sources_lost(busd_subscription *sub)
{
    for (struct source *source = sub->sources; source != NULL; source = source->next) {
        if (source->seat == NULL && source->routed_seq > source->last_seq) { /* they were queued for us */
            const bool is_later_counted = source->missed_seq >= source->routed_seq; /* those after them */
            const bool is_over = source->is_gone && !source->is_lossless && source->kept == 0; /* repeats nothing */
            uint64_t *count = is_later_counted || is_over ? &sub->skipped : &sub->perhaps_skipped;
            *count += source->routed_seq - source->last_seq;
            if (is_over) /* they must not count a second time */
                source->missed_seq = sizes_max(source->missed_seq, source->routed_seq);
        }
        source->before = source->routed_seq = 0;
        source->is_complete = false;
        source->is_stale = !source->is_gone;
        if (source->is_gone)
            source->number = NO_NUMBER;
    }
}

/* busd has lost this connection before, and the publisher has left meanwhile. Its samples from `first` to `last` were
 * for us; `first` 0: those after the last one that came were. `last` 0: the publisher may return. */
void sources_missed(busd_subscription *sub, const unsigned char *gid, uint64_t first, uint64_t last)
{
    struct source *source = last == 0 || last > MAX_SEQ || first > last ? NULL : source_of_gid(sub, gid);
    if (source == NULL)
        return;
    if (source->number == 0) { /* new: it is remembered, because busd may repeat the report */
        source->is_gone = true;
        source->number = NO_NUMBER;
    }
    if (source_position(source) == 0)
        source->missed_seq = first == 0 ? last : first - 1;
    count_missed(sub, source, last);
    forget_oldest_gone(sub);
}

/* Ends sources that the next busd has not matched again in time. */
void sources_drop_stale(busd_subscription *sub)
{
    unsigned told = 0;
    for (struct source *source = sub->sources; source != NULL; source = source->next) {
        if (!source->is_stale)
            continue;
        told += source_finish(sub, source);
        source->number = NO_NUMBER;
    }
    for (; told > 0; told--)
        tell_unmatched(sub);
}

void sources_free(busd_subscription *sub)
{
    for (struct source *source; (source = sub->sources) != NULL; free(source)) {
        source_leave(sub, source);
        sub->sources = source->next;
    }
}

/* --- the next sample */

/* Samples that the depth must leave alone, because they are history. */
static uint64_t spared(const struct source *source)
{
    const uint64_t next = source->feed.ring.next;
    return source->history_end > next ? sizes_min(source->history_end - next, source->feed.waiting) : 0;
}

/* Leaves a ring with false numbers, at the position `before` them. */
void source_leave_corrupt(busd_subscription *sub, struct source *source, const struct ring_reader *before)
{
    go_back(&source->feed, before);
    source_leave(sub, source);
    refuse(sub, source, "the ring is corrupt");
}

/* Looks at one ring. RING_OK: it has a sample. RING_CORRUPT: it was left, and the event of that can have changed all
 * sources. */
static enum ring_status look(busd_subscription *sub, struct source *source)
{
    const struct ring_reader before = source->feed.ring;
    feed_poll(&source->feed, 0);
    enum ring_status status = feed_head(&source->feed, 0);
    if (status == RING_OK && !feed_is_sound(&source->feed))
        status = RING_CORRUPT;
    if (status == RING_CORRUPT) {
        source_leave_corrupt(sub, source, &before);
    } else if (status == RING_EMPTY && source->is_gone && feed_waiting(&source->feed) == 0) {
        source_leave(sub, source);
    }
    return status;
}

/* Finds the source with the oldest sample in its ring, and how many samples wait in all. False: begin again. */
static bool find_oldest(busd_subscription *sub, struct source **place, uint64_t *waiting)
{
    struct source *oldest = NULL;
    *waiting = 0;
    for (struct source *source = sub->sources; source != NULL; source = source->next) {
        const enum ring_status status = source->seat == NULL ? RING_EMPTY : look(sub, source);
        if (status == RING_CORRUPT)
            return false;
        if (status != RING_OK)
            continue;
        *waiting += source->feed.waiting - spared(source);
        if (oldest == NULL
            || feed_stamp(&source->feed, &source->feed.head) < feed_stamp(&oldest->feed, &oldest->feed.head))
            oldest = source;
    }
    *place = oldest;
    return true;
}

/* The source with the oldest sample in its ring; NULL: no ring has one. Passes over samples above the depth. */
struct source *source_oldest(busd_subscription *sub)
{
    while (!sub->end.is_closed) {
        struct source *oldest;
        uint64_t waiting;
        if (!find_oldest(sub, &oldest, &waiting))
            continue;
        if (oldest == NULL || sub->depth == 0 || waiting <= sub->depth)
            return oldest;
        const bool is_alone = waiting == oldest->feed.waiting;
        feed_skip(&oldest->feed, is_alone ? waiting - sub->depth : 1); /* of several, one by one by their stamps */
    }
    return NULL;
}
