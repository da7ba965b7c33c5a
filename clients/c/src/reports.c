/* Counters for busd's statistics: reported when they have changed, at most twice a second, some endpoints at a time.
 * And busd's own counts of what it dropped. */
#include "internal.h"

#define REPORT_NS (SECOND_NS / 2)
#define PAUSE_NS (SECOND_NS / 10)
#define SOME 64

const char *const reason_names[REASONS] = {
    [REPLACED] = "replaced",         [PUBLISHER_QUEUE] = "publisher_queue", [EXPIRED] = "expired",
    [MEMORY_LIMIT] = "memory_limit", [TOO_LARGE] = "too_large",             [UNDECODABLE] = "undecodable",
    [DISCONNECTED] = "disconnected", [OTHER] = "other",
};

/* Reports the counters of an endpoint soon. */
void report_due(struct endpoint *end)
{
    busd_bus *bus = end->node->bus;
    end->is_dirty = true;
    if (bus->at[REPORT] == 0)
        set_timer(bus, REPORT, now_ns() + REPORT_NS);
}

static void report_publisher(busd_bus *bus, const busd_publisher *p)
{
    control_simple(bus, "report", 4, (const char *const[]){"endpoint", "samples", "bytes", "at_ns"},
                   (const uint64_t[]){p->end.id, p->samples, p->bytes, (uint64_t)now_ns()});
}

/* Samples that were published while this process was away, and that a history lacked, by reason. Returns their number.
 * Not those that busd has dropped from the history: it reports them. */
uint64_t count_absent(const busd_subscription *sub, uint64_t by_reason[REASONS])
{
    const uint64_t missing = sub->skipped + sub->resent;
    uint64_t by_busd = 0;
    for (int i = 0; i < REASONS; i++)
        by_busd += sub->dropped_by_busd[i];
    const uint64_t count = sizes_min(sub->resent, missing - sizes_min(missing, by_busd));
    uint64_t left = count;
    for (int i = 0; i < REASONS; i++) {
        by_reason[i] = sizes_min(left, sub->explained[i]);
        left -= by_reason[i];
    }
    by_reason[DISCONNECTED] += left;
    return count;
}

/* Samples dropped here, by reason; with those in the rings that are read now. */
static unsigned dropped_here(const busd_subscription *sub, uint64_t dropped[REASONS])
{
    unsigned count = 0;
    count_absent(sub, dropped);
    for (int i = 0; i < REASONS; i++)
        dropped[i] += sub->dropped[i];
    for (const struct source *source = sub->sources; source != NULL; source = source->next) {
        if (source->seat == NULL)
            continue;
        dropped[REPLACED] += source->feed.ring.replaced;
        dropped[sub->depth != 0 ? REPLACED : PUBLISHER_QUEUE] += source->feed.ring.overrun;
    }
    for (int i = 0; i < REASONS; i++)
        count += dropped[i] != 0;
    return count;
}

/* Bounded, as busd ends the connection for a larger number. A broken publisher can make a sum so large. */
static void field_count(busd_out *out, const char *key, uint64_t count)
{
    field_number(out, key, sizes_min(count, MAX_SEQ));
}

static void report_subscription(busd_bus *bus, busd_subscription *sub)
{
    uint64_t dropped[REASONS];
    busd_stats stats;
    busd_out out;
    const unsigned reasons = dropped_here(sub, dropped);
    uint64_t by_busd = 0;
    busd_subscription_stats(sub, &stats);
    for (int i = 0; i < REASONS; i++)
        by_busd += sub->dropped_by_busd[i];
    control_begin(&out, "report", 11);
    field_number(&out, "endpoint", sub->end.id);
    field_number(&out, "samples", stats.samples);
    field_number(&out, "bytes", stats.bytes);
    field_count(&out, "queued", stats.queued);
    busd_put_text(&out, "dropped", strlen("dropped"));
    busd_put_map(&out, reasons);
    for (int i = 0; i < REASONS; i++)
        if (dropped[i] != 0)
            field_count(&out, reason_names[i], dropped[i]);
    field_count(&out, "expected", stats.expected - sub->received - by_busd);
    field_number(&out, "repeated", sub->repeated);
    field_number(&out, "at_ns", (uint64_t)now_ns());
    field_number(&out, "age_count", sub->age_count);
    field_number(&out, "age_sum_ns", sub->age_sum_ns);
    field_number(&out, "age_max_ns", sub->age_max_ns);
    control_send(bus, &out, NULL, 0);
    sub->age_count = sub->age_sum_ns = sub->age_max_ns = 0;
    if (stats.queued != 0)
        report_due(&sub->end); /* nothing else reports when they are taken */
}

static void report_one(struct endpoint *end)
{
    busd_bus *bus = end->node->bus;
    end->is_dirty = false;
    end->round = bus->rounds;
    if (end->is_publisher)
        report_publisher(bus, (busd_publisher *)end);
    else
        report_subscription(bus, (busd_subscription *)end);
}

static bool is_due(const struct endpoint *end)
{
    return end->is_dirty && end->state == DECLARED && end->round != end->node->bus->rounds;
}

/* Sends some of the reports that are due. In a round each endpoint has its turn once. */
void report_send(busd_bus *bus)
{
    int left = SOME;
    set_timer(bus, REPORT, 0);
    if (!busd_is_connected(bus))
        return;
    if (bus->control.first != NULL) { /* busd reads nothing: the queue must not grow */
        set_timer(bus, REPORT, now_ns() + PAUSE_NS);
        return;
    }
    for (busd_publisher *p = bus->publishers; p != NULL && left > 0; p = p->next)
        if (is_due(&p->end)) {
            report_one(&p->end);
            left--;
        }
    for (busd_subscription *s = bus->subscriptions; s != NULL && left > 0; s = s->next)
        if (is_due(&s->end)) {
            report_one(&s->end);
            left--;
        }
    bus->rounds += left > 0;
    if (left != SOME) /* those that have had their turn may be due again */
        set_timer(bus, REPORT, now_ns() + (left > 0 ? REPORT_NS : PAUSE_NS));
}

/* The last report of an endpoint that ends. */
void report_last(struct endpoint *end)
{
    if (end->is_dirty)
        report_one(end);
}

/* Samples of publishers that have left while this connection was lost: the first and the last number, by gid. */
static void take_missed(busd_subscription *sub, busd_in body)
{
    busd_in map;
    busd_item head, gid;
    if (!busd_find(body, "missed", &map) || !busd_get_item(&map, &head) || head.kind != BUSD_MAP)
        return;
    for (uint64_t left = head.number; left > 0 && busd_get_item(&map, &gid); left--) {
        if (gid.kind != BUSD_BYTES_ITEM || gid.number != 16 || !busd_get_array(&map, 2))
            return;
        const uint64_t first = busd_get_uint(&map, UINT64_MAX), last = busd_get_uint(&map, UINT64_MAX);
        if (map.failed)
            return;
        sources_missed(sub, gid.bytes, first, last);
    }
    report_due(&sub->end);
}

/* Reads drops by reason. False: there are none. */
static bool take_drops(busd_in body, const char *key, uint64_t drops[REASONS])
{
    busd_in map;
    busd_item head, reason, count;
    memset(drops, 0, REASONS * sizeof *drops);
    if (!busd_find(body, key, &map) || !busd_get_item(&map, &head) || head.kind != BUSD_MAP)
        return false;
    for (uint64_t left = head.number; left > 0 && busd_get_item(&map, &reason) && busd_get_item(&map, &count); left--) {
        int known = 0;
        if (reason.kind != BUSD_TEXT_ITEM || count.kind != BUSD_UINT)
            break;
        while (known < OTHER
               && (strlen(reason_names[known]) != reason.number
                   || memcmp(reason_names[known], reason.bytes, reason.number) != 0))
            known++;
        drops[known] += count.number;
    }
    return head.number != 0;
}

/* Drops on earlier connections: they explain numbers that are missing, except for those that were reported then. */
static void explain(busd_subscription *sub, const uint64_t before[REASONS])
{
    for (int i = 0; i < REASONS; i++) {
        const uint64_t unreported = before[i] > sub->told[i] ? before[i] - sub->told[i] : 0;
        const uint64_t late = sizes_min(unreported, sub->unexplained); /* they are counted */
        sub->unexplained -= late;
        sub->explained[i] = unreported - late;
        sub->told[i] = before[i];
    }
}

/* Dropped: busd's totals of the samples that it dropped for a subscription. */
void report_dropped(busd_subscription *sub, busd_in body)
{
    uint64_t before[REASONS];
    if (take_drops(body, "before", before))
        explain(sub, before);
    take_missed(sub, body);
    take_drops(body, "dropped", sub->dropped_by_busd);
    report_due(&sub->end);
}

/* Counts samples that were published while busd or this process was away, except for those whose drop was reported.
 * Returns how many it counts. */
uint64_t count_away(busd_subscription *sub, uint64_t count)
{
    const uint64_t known = sizes_min(count, sub->ahead);
    sub->ahead -= known;
    const uint64_t counted = count -= known;
    sub->away += counted;
    for (int i = 0; i < REASONS; i++) {
        const uint64_t some = sizes_min(count, sub->explained[i]);
        sub->explained[i] -= some;
        sub->dropped[i] += some;
        count -= some;
    }
    sub->dropped[DISCONNECTED] += count;
    return counted;
}

/* A publisher is matched again, whose samples may come again: `most` at most. Drops of them that busd has reported on an
 * earlier connection no longer count. Those that do not come again are found missing. */
void count_again(busd_subscription *sub, uint64_t most)
{
    uint64_t left = sizes_min(sub->ahead, most);
    sub->ahead -= left;
    sub->earlier -= left;
    for (int i = 0; i < REASONS; i++) {
        const uint64_t some = sizes_min(left, sub->dropped[i]);
        sub->dropped[i] -= some;
        sub->explained[i] += some;
        left -= some;
    }
}

/* The connection is lost: its drops become earlier ones. */
void reports_lost(busd_subscription *sub)
{
    uint64_t reported = 0, lacking[REASONS];
    const uint64_t absent = count_absent(sub, lacking);
    sub->away += absent;
    if (sub->end.node->bus->is_new_busd)
        memset(sub->told, 0, sizeof sub->told);
    memset(sub->explained, 0, sizeof sub->explained);
    for (int i = 0; i < REASONS; i++) {
        sub->dropped[i] += sub->dropped_by_busd[i] + lacking[i];
        sub->told[i] += sub->dropped_by_busd[i];
        reported += sub->dropped_by_busd[i];
        sub->dropped_by_busd[i] = 0;
    }
    sub->unexplained = absent + count_away(sub, sub->skipped - sizes_min(sub->skipped, reported));
    sub->ahead += reported - sizes_min(reported, sub->skipped + sub->perhaps_skipped + sub->resent);
    sub->earlier += sub->received + reported;
    sub->received = sub->repeated = sub->skipped = sub->perhaps_skipped = sub->resent = 0;
}
