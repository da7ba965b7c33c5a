/* A subscription's samples by socket: a bounded queue, and the acknowledgements of a lossless one. */
#include <stdlib.h>

#include "internal.h"

#define ACK_NS INT64_C(20000000) /* longest delay of an acknowledgement */
#define ACK_PART 8u              /* of the window, which is acknowledged at once */
#define SPARE_BYTES (64u << 10)

/* --- samples */

/* A sample with room for `size` bytes. NULL: no memory. */
struct sample *sample_new(busd_subscription *sub, size_t size)
{
    busd_bus *bus = sub->end.node->bus;
    struct sample *sample = bus->spare;
    if (sample != NULL && sample->room >= size) {
        bus->spare = NULL;
    } else {
        const size_t room = size < 256 ? 256 : size;
        sample = malloc(sizeof *sample + room);
        if (sample == NULL)
            return NULL;
        sample->room = room;
    }
    *sample = (struct sample){.bus = bus, .size = size, .room = sample->room};
    return sample;
}

/* Keeps the larger one of this sample and the spare one, unless it is too large: then a paced message needs no new
 * memory. */
void sample_free(struct sample *sample)
{
    struct sample **spare = &sample->bus->spare, *other = sample;
    if (sample->room <= SPARE_BYTES && (*spare == NULL || (*spare)->room < sample->room)) {
        other = *spare;
        *spare = sample;
    }
    free(other);
}

/* Memory of a sample, which for a short one is mostly its head. */
static size_t sample_bytes(const struct sample *sample) { return sizeof *sample + sample->room; }

/* Takes a sample out of the queue; `at` points to it there. */
static struct sample *take_out(busd_subscription *sub, struct sample **at)
{
    struct sample *sample = *at;
    if ((*at = sample->next) == NULL)
        sub->last = at;
    if (sub->kept == &sample->next)
        sub->kept = at;
    sub->queued--;
    sub->queued_bytes -= sample_bytes(sample);
    sub->queued_replays -= sample->is_replay;
    return sample;
}

/* Takes the oldest sample out of the queue, which is not empty. */
struct sample *inbox_pop(busd_subscription *sub) { return take_out(sub, &sub->first); }

static void drop(busd_subscription *sub, struct sample **at, enum reason reason)
{
    struct sample *sample = take_out(sub, at);
    sub->dropped[reason]++;
    inbox_taken(sub, sample);
    sample_free(sample);
}

/* Whether the sample must not be lost. Its publisher sends at most a window without acknowledgements. */
static bool is_kept(const struct sample *sample) { return sample->source != NULL && sample->source->is_lossless; }

/* The oldest sample that may be lost; NULL: there is none. */
static struct sample **oldest_lossy(busd_subscription *sub)
{
    while (*sub->kept != NULL && is_kept(*sub->kept))
        sub->kept = &(*sub->kept)->next;
    return *sub->kept == NULL ? NULL : sub->kept;
}

/* Adds a sample. Above the bounds, the oldest samples are dropped. History does not count against the depth. */
void inbox_add(busd_subscription *sub, struct sample *sample)
{
    sample->next = NULL;
    *sub->last = sample;
    sub->last = &sample->next;
    sub->queued++;
    sub->queued_bytes += sample_bytes(sample);
    sub->queued_replays += sample->is_replay;
    while (sub->depth != 0 && sub->queued - sub->queued_replays > sub->depth)
        drop(sub, &sub->first, REPLACED);
    for (struct sample **at; sub->queued_bytes > INBOX_BYTES && sub->queued > 1 && (at = oldest_lossy(sub)) != NULL;)
        drop(sub, at, MEMORY_LIMIT);
}

/* Notes the numbers missing before `seq`. */
static void note_missing(busd_subscription *sub, struct source *source, uint64_t seq, unsigned flags)
{
    const bool is_replay = (flags & FLAG_REPLAY) != 0;
    uint64_t known = sizes_max(source->last_seq, source->missed_seq);
    const uint64_t routed = sizes_max(known, source->routed_seq), away_end = sizes_min(seq, source->first_seq);
    if (source->is_back && known != 0 && away_end > routed + 1 && (flags & FLAG_RESUMED) == 0 && source->seat == NULL) {
        sub->resent += away_end - routed - 1;
        source->missed_seq = known = away_end - 1;
    }
    const uint64_t next = is_replay ? known + 1 : sizes_max(known + 1, source->first_seq);
    const bool is_history = is_replay && known == 0; /* it begins anywhere */
    if (seq > next && !is_history && (flags & FLAG_RESUMED) == 0 && source->seat == NULL)
        *(source->is_complete ? &sub->skipped : &sub->perhaps_skipped) += seq - next;
    if (!is_replay && source->seat == NULL && source->routed_seq > source->last_seq && seq > source->routed_seq)
        sub->skipped += source->routed_seq - source->last_seq; /* busd dropped them before the publisher returned */
    source->is_complete = source->is_complete || !is_replay;
}

/* Adds the samples of a run, without those that came before. `body`: after the frame's first 8 bytes. 0, -EPROTO
 * or -ENOMEM. */
int inbox_run(busd_subscription *sub, const unsigned char *body, size_t size, unsigned flags)
{
    uint32_t number, count, payload;
    uint64_t seq;
    memcpy(&number, body + 4, 4);
    memcpy(&seq, body + 8, 8);
    memcpy(&count, body + 16, 4);
    struct source *source = source_find(sub, number);
    size_t at = RUN_HEAD_BYTES - HEAD_BYTES;
    if (source != NULL && count > 0)
        note_missing(sub, source, seq, flags);
    for (; count > 0; count--, seq++) {
        int64_t stamp_ns;
        if (size - at < RECORD_BYTES)
            return -EPROTO;
        memcpy(&payload, body + at, 4);
        memcpy(&stamp_ns, body + at + 4, 8);
        at += RECORD_BYTES;
        if (size - at < payload)
            return -EPROTO;
        const unsigned char *bytes = body + at;
        at += payload;
        if (source != NULL && seq <= source->last_seq) {
            sub->repeated++;
            if (seq <= source->taken_seq) { /* the publisher asks for it again */
                source->acked_seq = 0;
                if (sub->end.node->bus->at[ACK] == 0)
                    set_timer(sub->end.node->bus, ACK, now_ns() + ACK_NS);
            }
            continue;
        }
        struct sample *sample = sample_new(sub, payload);
        if (sample == NULL)
            return fail(sub->end.node->bus, ENOMEM, "%s: no memory for a message of %u bytes", sub->end.topic, payload);
        memcpy(sample->bytes, bytes, payload);
        sample->size = payload;
        sample->source = source;
        sample->seq = seq;
        sample->publisher = number;
        sample->stamp_ns = source == NULL ? stamp_ns : (int64_t)((uint64_t)stamp_ns - source->clock_ns);
        sample->is_replay = (flags & FLAG_REPLAY) != 0;
        if (source != NULL)
            source->last_seq = seq;
        sub->received++;
        inbox_add(sub, sample);
        if (sub->end.qos.deadline_ns > 0)
            deadline_note(&sub->end, now_ns());
    }
    if (!sub->end.is_dirty)
        report_due(&sub->end);
    return 0;
}

/* Samples of a forgotten source stay in the queue. */
void inbox_forget(busd_subscription *sub, const struct source *source)
{
    for (struct sample *sample = sub->first; sample != NULL; sample = sample->next)
        if (sample->source == source)
            sample->source = NULL;
    sub->kept = &sub->first;
}

void inbox_free(busd_subscription *sub)
{
    while (sub->first != NULL)
        free(inbox_pop(sub));
}

/* --- acknowledgements */

static void ack(const busd_subscription *sub, struct source *source)
{
    if (!source->is_lossless || source->seat != NULL || source->is_gone || source->is_stale
        || source->taken_seq <= source->acked_seq || sub->end.state != DECLARED)
        return;
    source->acked_seq = source->taken_seq;
    source->unacked_bytes = 0;
    control_simple(sub->end.node->bus, "ack", 3, (const char *const[]){"subscription", "source", "seq"},
                   (const uint64_t[]){sub->end.id, source->number, source->acked_seq});
}

/* Acknowledges everything that is taken. */
void inbox_ack(busd_subscription *sub)
{
    if (!sub->end.is_lossless)
        return;
    for (struct source *source = sub->sources; source != NULL; source = source->next)
        ack(sub, source);
}

/* Notes that a sample was taken, or dropped here. Acknowledges it soon. */
void inbox_taken(busd_subscription *sub, const struct sample *sample)
{
    struct source *source = sample->source;
    if (source == NULL || !source->is_lossless)
        return;
    busd_bus *bus = sub->end.node->bus;
    source->taken_seq = sizes_max(source->taken_seq, sample->seq);
    source->unacked_bytes += RECORD_BYTES + sample->size;
    if (source->taken_seq - source->acked_seq >= sizes_max(sub->end.window_samples / ACK_PART, 1)
        || source->unacked_bytes >= sub->end.window_bytes / ACK_PART)
        ack(sub, source);
    else if (bus->at[ACK] == 0)
        set_timer(bus, ACK, now_ns() + ACK_NS);
}
