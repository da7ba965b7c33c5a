/* Control messages of busd: each goes to its handler. docs/protocol.md lists them. Unknown messages and fields are
 * ignored, as the protocol demands. */
#include <stdio.h>
#include <unistd.h>

#include "internal.h"

/* A message, with its descriptors. A handler may keep a descriptor by setting it to -1. */
struct message {
    busd_bus *bus;
    busd_in body;
    int fds[2];
    unsigned count;
    busd_publisher *publisher;       /* that the message is about */
    busd_subscription *subscription;
};

static const char *text_of(busd_in body, const char *key, int *n)
{
    size_t size;
    const char *text = (const char *)busd_find_bytes(body, key, &size);
    *n = text == NULL ? 0 : (int)whole_size(text, sizes_min(size, 400));
    return text == NULL ? "" : text;
}

static int take_hello(struct message *m)
{
    busd_bus *bus = m->bus;
    const uint64_t version = busd_find_number(m->body, "version", 0);
    if (bus->is_open)
        return fail(bus, EPROTO, "busd sent Hello a second time");
    if (version != 1)
        return fail(bus, EPROTO, "busd speaks protocol version %llu, this library speaks 1",
                    (unsigned long long)version);
    const uint64_t pid = busd_find_number(m->body, "pid", 0), began_ns = busd_find_number(m->body, "began_ns", 0);
    bus->is_open = true;
    bus->opened_at = now_ns();
    bus->is_new_busd = pid != bus->busd_pid || began_ns != bus->busd_began_ns;
    bus->busd_pid = pid;
    bus->busd_began_ns = began_ns;
    const double lease_s = busd_find_real(m->body, "lease_s", 10);
    bus->lease_ns = lease_s > 0 && lease_s < 1e9 ? (int64_t)(lease_s * 1e9) : GIVE_UP_NS;
    set_timer(bus, HELLO, 0);
    ping_due(bus);
    if (bus->was_connected)
        set_timer(bus, STALE, now_ns() + GIVE_UP_NS);
    const int status = declare_all(bus);
    if (status == 0 && bus->was_connected)
        tell(bus, BUSD_CONNECTED, NULL, "connected to %s", bus->path);
    return status;
}

static int take_fault(struct message *m)
{
    int n;
    const char *text = text_of(m->body, "text", &n);
    const bool again = busd_find_number(m->body, "again", 0) != 0;
    return fail(m->bus, again ? EAGAIN : EPROTO, "%.*s", n, text);
}

static int take_leaving(struct message *m)
{
    m->bus->is_leaving = true;
    flush(m->bus);
    return 0;
}

static int take_created(struct message *m)
{
    answer_take(m->bus, m->body, true);
    return 0;
}

static int take_answer(struct message *m)
{
    answer_take(m->bus, m->body, false);
    return 0;
}

static int take_matched(struct message *m)
{
    size_t n;
    const unsigned char *gid = busd_find_bytes(m->body, "gid", &n);
    busd_in qos;
    if (gid == NULL || n != 16 || !busd_find(m->body, "qos", &qos))
        return fail(m->bus, EPROTO, "busd sent Matched without gid or qos");
    if (m->publisher != NULL)
        publisher_matched(m->publisher, m->body, qos, gid);
    else if (m->subscription != NULL)
        subscription_matched(m->subscription, m->body, qos, gid, m->fds, m->count);
    return 0;
}

static int take_unmatched(struct message *m)
{
    if (m->publisher != NULL)
        publisher_unmatched(m->publisher, m->body);
    else if (m->subscription != NULL)
        subscription_unmatched(m->subscription, m->body);
    return 0;
}

static int take_attached(struct message *m)
{
    const char *fault = m->publisher == NULL ? NULL : publisher_attached(m->publisher, m->body, m->fds, m->count);
    if (fault == NULL)
        return 0;
    busd_out out;
    control_begin(&out, "noshm", 3);
    field_number(&out, "endpoint", m->publisher->end.id);
    field_number(&out, "other", busd_find_number(m->body, "subscription", 0));
    field_text(&out, "text", fault);
    control_send(m->bus, &out, NULL, 0);
    tell(m->bus, BUSD_ROUTE, &m->publisher->end, "%s by socket: %s", m->publisher->end.topic, fault);
    return 0;
}

static int take_ring(struct message *m)
{
    if (m->subscription != NULL)
        subscription_ring(m->subscription, m->body, m->fds, m->count);
    return 0;
}

static int take_rerouted(struct message *m)
{
    if (m->publisher != NULL)
        publisher_rerouted(m->publisher, m->body);
    else if (m->subscription != NULL)
        subscription_rerouted(m->subscription, busd_find_number(m->body, "other", 0));
    return 0;
}

static int take_credit(struct message *m)
{
    if (m->publisher != NULL)
        stream_credit(m->publisher, busd_find_number(m->body, "seq", 0));
    return 0;
}

static int take_silence(struct message *m)
{
    if (m->publisher != NULL)
        publisher_silence(m->publisher, m->body);
    return 0;
}

static int take_dropped(struct message *m)
{
    if (m->subscription != NULL)
        report_dropped(m->subscription, m->body);
    return 0;
}

static int take_incompatible(struct message *m)
{
    int n, node_size, policy_size;
    const char *text = text_of(m->body, "text", &n), *node = text_of(m->body, "node", &node_size);
    const char *policy = text_of(m->body, "policy", &policy_size);
    const struct endpoint *end = m->publisher != NULL      ? &m->publisher->end
                                 : m->subscription != NULL ? &m->subscription->end
                                                           : NULL;
    tell(m->bus, BUSD_INCOMPATIBLE, end, "%s does not match node %.*s: %.*s: %.*s",
         end == NULL ? "an endpoint" : end->topic, node_size, node, policy_size, policy, n, text);
    return 0;
}

static int take_liveliness(struct message *m)
{
    if (m->subscription == NULL)
        return 0;
    struct source *source = source_find(m->subscription, busd_find_number(m->body, "publisher", 0));
    const bool is_alive = busd_find_number(m->body, "alive", 0) != 0;
    if (source == NULL || (source->awaits_sign && !is_alive))
        return 0;
    source->awaits_sign = false;
    tell(m->bus, BUSD_LIVELINESS_CHANGED, &m->subscription->end, "a publisher of %s is %s",
         m->subscription->end.topic, is_alive ? "alive" : "not alive");
    return 0;
}

static int take_liveliness_lost(struct message *m)
{
    if (m->publisher != NULL)
        tell(m->bus, BUSD_LIVELINESS_LOST, &m->publisher->end,
             "the publisher of %s gave no sign of life within its lease", m->publisher->end.topic);
    return 0;
}

static int take_graph(struct message *m) { return graph_take(m->bus, m->body); }
static int take_graph_changed(struct message *m) { return graph_change(m->bus, m->body); }

static int take_namesake(struct message *m)
{
    int n;
    const char *program = text_of(m->body, "program", &n);
    tell(m->bus, BUSD_NAMESAKE, NULL, "another node has the name of a node of this process: program %.*s, process %llu",
         n, program, (unsigned long long)busd_find_number(m->body, "pid", 0));
    return 0;
}

/* The messages by tag; the fields that name an endpoint of ours; the default of `descriptors`. */
static const struct handler {
    const char *tag, *publisher, *subscription;
    unsigned descriptors;
    int (*take)(struct message *message);
} handlers[] = {
    {"hello", NULL, NULL, 0, take_hello},
    {"fault", NULL, NULL, 0, take_fault},
    {"leaving", NULL, NULL, 0, take_leaving},
    {"created", NULL, NULL, 0, take_created},
    {"done", NULL, NULL, 0, take_answer},
    {"refused", NULL, NULL, 0, take_answer},
    {"matched", "endpoint", "endpoint", 0, take_matched},
    {"unmatched", "endpoint", "endpoint", 0, take_unmatched},
    {"attached", "publisher", NULL, 2, take_attached},
    {"ring*", NULL, "subscription", 1, take_ring},
    {"rerouted", "endpoint", "endpoint", 0, take_rerouted},
    {"credit", "publisher", NULL, 0, take_credit},
    {"silence", "publisher", NULL, 0, take_silence},
    {"dropped", NULL, "subscription", 0, take_dropped},
    {"incompatible", "endpoint", "endpoint", 0, take_incompatible},
    {"liveliness", NULL, "subscription", 0, take_liveliness},
    {"lost", "publisher", NULL, 0, take_liveliness_lost},
    {"namesake", NULL, NULL, 0, take_namesake},
    {"graph", NULL, NULL, 0, take_graph},
    {"graph*", NULL, NULL, 0, take_graph_changed},
};

static void find_endpoint(struct message *m, const struct handler *handler)
{
    const uint64_t publisher = handler->publisher == NULL ? 0 : busd_find_number(m->body, handler->publisher, 0);
    const uint64_t subscription =
        handler->subscription == NULL ? 0 : busd_find_number(m->body, handler->subscription, 0);
    for (busd_publisher *p = m->bus->publishers; p != NULL && publisher != 0; p = p->next)
        if (p->end.state == DECLARED && p->end.id == publisher)
            m->publisher = p;
    for (busd_subscription *s = m->bus->subscriptions; s != NULL && subscription != 0; s = s->next)
        if (s->end.state == DECLARED && s->end.id == subscription)
            m->subscription = s;
}

/* Takes one control message. 0, or -EPROTO or -EAGAIN with the reason in `error`: the connection must end. */
int control_take(busd_bus *bus, const unsigned char *bytes, size_t size)
{
    struct message m = {.bus = bus, .body = {bytes, bytes + size, false}, .fds = {-1, -1}};
    const struct handler *handler = NULL;
    size_t n;
    const unsigned char *tag = busd_find_bytes(m.body, "m", &n);
    if (tag == NULL)
        return fail(bus, EPROTO, "busd sent a control message without a tag");
    for (size_t i = 0; i < sizeof handlers / sizeof *handlers && handler == NULL; i++)
        if (strlen(handlers[i].tag) == n && memcmp(handlers[i].tag, tag, n) == 0)
            handler = &handlers[i];
    const uint64_t claimed = busd_find_number(m.body, "descriptors", handler == NULL ? 0 : handler->descriptors);
    m.count = batch_take(bus, (unsigned)sizes_min(claimed, 3), m.fds);
    int status = 0;
    if (handler != NULL) {
        find_endpoint(&m, handler);
        bus->turns++; /* callbacks may destroy what the handler uses */
        status = handler->take(&m);
        bus->turns--;
    }
    for (unsigned i = 0; i < m.count; i++)
        if (m.fds[i] >= 0)
            close(m.fds[i]);
    return status;
}
