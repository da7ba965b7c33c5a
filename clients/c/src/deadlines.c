/* Missed deadlines: no message was published, or arrived, within the deadline of the QoS after the last one. The first
 * message starts the watch. Each further deadline counts again.
 *
 * Messages in a ring arrive unnoticed, so each turn looks for new ones. */
#include "internal.h"

static int64_t due_ns(const struct endpoint *end) { return end->last_ns + end->qos.deadline_ns; }

static bool is_watched(const struct endpoint *end)
{
    return end->qos.deadline_ns > 0 && end->last_ns != 0 && !end->is_closed && end->state != REFUSED
           && end->last_ns <= INT64_MAX - end->qos.deadline_ns;
}

/* Notes a message of an endpoint with a deadline. */
void deadline_note(struct endpoint *end, int64_t at_ns)
{
    busd_bus *bus = end->node->bus;
    end->last_ns = at_ns;
    if (is_watched(end) && (bus->at[DEADLINE] == 0 || due_ns(end) < bus->at[DEADLINE]))
        set_timer(bus, DEADLINE, due_ns(end));
}

/* Notes new messages in the rings of subscriptions. */
void deadlines_look(busd_bus *bus)
{
    for (busd_subscription *s = bus->subscriptions; s != NULL && bus->has_deadlines; s = s->next) {
        bool has_come = false;
        for (struct source *source = s->sources; source != NULL && s->end.qos.deadline_ns > 0; source = source->next) {
            const uint64_t newest = source->seat == NULL ? 0 : feed_newest(&source->feed);
            has_come |= newest > source->noted;
            source->noted = newest > source->noted ? newest : source->noted;
        }
        if (has_come)
            deadline_note(&s->end, now_ns());
    }
}

static void check(struct endpoint *end, int64_t now)
{
    if (!is_watched(end) || now < due_ns(end))
        return;
    end->last_ns = now;
    end->missed++;
    tell(end->node->bus, BUSD_DEADLINE_MISSED, end, "%s: no message was %s within the deadline of %.9g s; missed %llu",
         end->topic, end->is_publisher ? "published" : "received", (double)end->qos.deadline_ns / 1e9,
         (unsigned long long)end->missed);
}

void deadlines_check(busd_bus *bus, int64_t now)
{
    deadlines_look(bus);
    now = now_ns();
    for (busd_publisher *p = bus->publishers; p != NULL; p = p->next)
        check(&p->end, now);
    for (busd_subscription *s = bus->subscriptions; s != NULL; s = s->next)
        check(&s->end, now);
    for (busd_publisher *p = bus->publishers; p != NULL; p = p->next)
        deadline_note(&p->end, p->end.last_ns);
    for (busd_subscription *s = bus->subscriptions; s != NULL; s = s->next)
        deadline_note(&s->end, s->end.last_ns);
}
