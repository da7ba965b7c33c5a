/* The calls of a subscription. Samples by socket come before those in rings: if a match has changed its route, they are
 * older.
 *
 * A held message is a pinned record or a copy of its own. The lowest bit of `held` tells which. Neither needs the
 * subscription, which may be destroyed before.
 */
#include <stdlib.h>
#include <unistd.h>

#include "internal.h"

#define SOURCE_BYTES 16u
#define AGE_EVERY 32u /* samples, for one age */

enum { HELD_PIN, HELD_COPY, HELD_MASK = 1 };

static void *held(void *thing, unsigned kind) { return (char *)thing + kind; }

/* Takes the time of the message's source out of the payload, if it is there. */
static void take_source_time(busd_message *message)
{
    static const unsigned char mark[] = {0xc7, 0x0d, 0x54, 0, 0, 0, 0, 0};
    if (message->size < SOURCE_BYTES || memcmp(message->data, mark, sizeof mark) != 0)
        return;
    memcpy(&message->source_ns, (const char *)message->data + sizeof mark, 8);
    message->data = (const char *)message->data + SOURCE_BYTES;
    message->size -= SOURCE_BYTES;
}

/* The time since a stamp; 0 if it is in the future. A false stamp can make it longer than an int64_t holds. */
static uint64_t age_of(int64_t stamp_ns)
{
    const int64_t now = now_ns();
    return now > stamp_ns ? (uint64_t)now - (uint64_t)stamp_ns : 0;
}

static void count_taken(busd_subscription *sub, const busd_message *message)
{
    sub->samples++;
    sub->bytes += message->size;
    if (!sub->end.is_dirty || sub->samples % AGE_EVERY == 0) {
        const uint64_t age = age_of(message->stamp_ns);
        sub->age_count++;
        if (age < MAX_SEQ - sub->age_sum_ns) { /* busd accepts no number above MAX_SEQ; a stamp may be false */
            sub->age_sum_ns += age;
            sub->age_max_ns = sizes_max(sub->age_max_ns, age);
        }
    }
    if (!sub->end.is_dirty)
        report_due(&sub->end);
}

static bool is_expired(uint64_t lifespan_ns, int64_t stamp_ns)
{
    return lifespan_ns != 0 && age_of(stamp_ns) > lifespan_ns;
}

static bool take_from_inbox(busd_subscription *sub, busd_message *message)
{
    while (sub->first != NULL) {
        struct sample *sample = inbox_pop(sub);
        inbox_taken(sub, sample);
        if (sample->source != NULL && is_expired(sample->source->lifespan_ns, sample->stamp_ns)) {
            sub->dropped[EXPIRED]++;
            sample_free(sample);
            continue;
        }
        *message = (busd_message){.data = sample->bytes, .size = sample->size, .stamp_ns = sample->stamp_ns,
                                  .seq = sample->seq, .publisher = sample->publisher, .held = held(sample, HELD_COPY)};
        return true;
    }
    return false;
}

/* Pins the head of the feed for the message. RING_PINNED: it must be copied. */
static enum ring_status take_pinned(struct source *source, const struct ring_record *record, busd_message *message)
{
    struct seat *seat = source->seat;
    struct map *map = ((struct ring_of *)source->feed.rings)->map;
    unsigned pin;
    const enum ring_status status = feed_pin(&source->feed, 0, record, &pin);
    if (status != RING_OK)
        return status;
    seat->holds[pin] = (struct hold){seat, pin, map_use(map)};
    seat->pinned++;
    message->data = record->payload;
    message->held = held(&seat->holds[pin], HELD_PIN);
    return RING_OK;
}

static enum ring_status take_copy(busd_subscription *sub, struct source *source, const struct ring_record *record,
                                  busd_message *message)
{
    struct sample *copy = sample_new(sub, record->size + 8);
    if (copy == NULL)
        return RING_EMPTY;
    const enum ring_status status = feed_copy(&source->feed, 0, record, copy->bytes);
    if (status != RING_OK) {
        sample_free(copy);
        return status;
    }
    message->data = copy->bytes;
    message->held = held(copy, HELD_COPY);
    return RING_OK;
}

static int take_from_rings(busd_subscription *sub, busd_message *message)
{
    for (struct source *source; (source = source_oldest(sub)) != NULL;) {
        const struct ring_record record = source->feed.head;
        const int64_t stamp_ns = (int64_t)feed_stamp(&source->feed, &record);
        if (is_expired(source->lifespan_ns, stamp_ns)) {
            sub->dropped[EXPIRED]++;
            feed_step(&source->feed);
            if (sub->end.is_lossless)
                source_show_cursor(source);
            continue;
        }
        *message = (busd_message){.size = record.size, .stamp_ns = stamp_ns, .seq = record.seq,
                                  .publisher = source->number, .by_ring = 1};
        const struct ring_reader before = source->feed.ring;
        enum ring_status status = record.size > COPY_BYTES ? take_pinned(source, &record, message) : RING_PINNED;
        if (status == RING_PINNED)
            status = take_copy(sub, source, &record, message);
        if (status == RING_EMPTY)
            return fail(sub->end.node->bus, ENOMEM, "%s: no memory for a message of %u bytes", sub->end.topic,
                        record.size);
        if (status != RING_OK && !feed_is_sound(&source->feed))
            source_leave_corrupt(sub, source, &before);
        if (status != RING_OK)
            continue; /* overrun meanwhile, and counted */
        if (sub->end.is_lossless)
            source_show_cursor(source);
        return 1;
    }
    return 0;
}

int busd_take(busd_subscription *sub, busd_message *message)
{
    const int status = take_from_inbox(sub, message) ? 1 : take_from_rings(sub, message);
    if (status != 1)
        return status;
    take_source_time(message);
    count_taken(sub, message);
    return 1;
}

void busd_release(busd_message *message)
{
    const uintptr_t kind = (uintptr_t)message->held & HELD_MASK;
    void *thing = message->held == NULL ? NULL : (char *)message->held - kind;
    message->held = NULL;
    message->data = NULL;
    message->size = 0;
    if (thing == NULL)
        return;
    if (kind == HELD_COPY) {
        sample_free(thing);
    } else {
        struct hold *hold = thing;
        struct seat *seat = hold->seat;
        if (seat->bus->pid == getpid()) /* after a fork, the pin is the parent's */
            ring_unpin(seat->slot, hold->pin);
        map_drop(hold->map);
        seat->pinned--;
        seat_release(seat);
    }
}

bool subscription_has_news(const busd_subscription *sub)
{
    if (sub->first != NULL)
        return true;
    for (const struct source *source = sub->sources; source != NULL; source = source->next)
        if (source->seat != NULL && feed_waiting(&source->feed) != 0)
            return true;
    return false;
}

int busd_is_ready(const busd_subscription *sub) { return subscription_has_news(sub); }

/* Calls back for up to `most` messages. True: more wait. */
bool subscription_deliver(busd_subscription *sub, int most)
{
    busd_message message;
    for (; most > 0 && !sub->end.is_closed && busd_take(sub, &message) == 1; most--) {
        sub->callback(sub->user, &message);
        busd_release(&message);
    }
    return most == 0 && !sub->end.is_closed;
}

void busd_subscription_stats(const busd_subscription *sub, busd_stats *stats)
{
    *stats = (busd_stats){
        .samples = sub->samples, .bytes = sub->bytes, .queued = sub->queued, .missed_deadlines = sub->end.missed};
    uint64_t passed = sub->passed, by_busd = 0, lacking[REASONS];
    const uint64_t absent = count_absent(sub, lacking);
    for (int i = 0; i < REASONS; i++) {
        uint64_t *count = i == REPLACED ? &stats->replaced : i == EXPIRED ? &stats->expired : &stats->lost;
        *count += sub->dropped[i] + sub->dropped_by_busd[i] + lacking[i];
        by_busd += sub->dropped_by_busd[i];
    }
    for (const struct source *source = sub->sources; source != NULL; source = source->next) {
        stats->matches += !source->is_gone;
        if (source->seat == NULL)
            continue;
        const struct feed *feed = &source->feed;
        const uint64_t waiting = feed_waiting(feed);
        stats->by_ring += !source->is_gone;
        stats->queued += waiting;
        stats->replaced += feed->ring.replaced;
        *(sub->depth != 0 ? &stats->replaced : &stats->lost) += feed->ring.overrun;
        passed += feed->ring.next + waiting - feed->first;
    }
    stats->expected = passed + sub->received + sub->earlier + sub->away + absent + by_busd;
}

int busd_subscription_matches(const busd_subscription *sub)
{
    busd_stats stats;
    busd_subscription_stats(sub, &stats);
    return (int)stats.matches;
}

void subscription_free(busd_subscription *sub)
{
    inbox_free(sub);
    sources_free(sub);
    endpoint_free(&sub->end);
    free(sub);
}
