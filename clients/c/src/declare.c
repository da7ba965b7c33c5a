/* Nodes, types and endpoints become known to busd, and again to the next busd.
 *
 *     UNDECLARED   busd does not know it
 *     ASKED        the request is on its way
 *     DECLARED     Created has come: it has an id
 *     REFUSED      by this or an earlier busd; it is not asked for again
 *
 * The first declaration is awaited by the call that creates the thing, unless the program wants no wait. Later ones
 * need none: each node's Created declares the endpoints of the node.
 */
#include <poll.h>
#include <stdlib.h>
#include <sys/random.h>
#include <unistd.h>

#include "internal.h"

/* --- requests and answers */

static int wait_for(busd_bus *bus, const struct waiting *waiting)
{
    int64_t until = now_ns() + GIVE_UP_NS;
    while (waiting->answer > 0) {
        if (bus->sock < 0)
            return -ENOTCONN;
        struct pollfd poller = {.fd = bus->sock, .events = POLLIN};
        poller.events |= bus->current != NULL || bus->control.first != NULL ? POLLOUT : 0;
        const int count = poll(&poller, 1, 1000);
        if (poller.revents & POLLIN)
            until = now_ns() + GIVE_UP_NS;
        else if (now_ns() > until) {
            lose_connection(bus, "busd does not answer");
            return -ETIMEDOUT;
        }
        if (count <= 0)
            continue;
        flush(bus);
        if (bus->sock >= 0)
            take_in(bus);
    }
    return waiting->answer;
}

/* Waits for the answer to `waiting->request`. 0, or -errno with the reason in `error`. */
int await(busd_bus *bus, struct waiting *waiting)
{
    waiting->outer = bus->waiting;
    waiting->answer = 1;
    bus->waiting = waiting;
    const int status = wait_for(bus, waiting);
    bus->waiting = waiting->outer;
    return status;
}

/* The call that waits for the answer to this request; NULL: none does. */
struct waiting *waiting_for(const busd_bus *bus, uint64_t request)
{
    struct waiting *waiting = bus->waiting;
    while (waiting != NULL && waiting->request != request)
        waiting = waiting->outer;
    return waiting;
}

static int refusal(busd_bus *bus, busd_in body)
{
    size_t n;
    const unsigned char *text = busd_find_bytes(body, "text", &n), *resource;
    size_t resource_size;
    resource = busd_find_bytes(body, "resource", &resource_size);
    const int code = busd_find_number(body, "denied", 0)  ? EACCES
                     : resource != NULL && resource_size  ? EDQUOT
                     : busd_find_number(body, "again", 0) ? EAGAIN
                                                          : EINVAL;
    return fail(bus, code, "%.*s", (int)n, text == NULL ? "" : (const char *)text);
}

static void endpoint_answer(struct endpoint *end, busd_in body, bool is_created)
{
    busd_bus *bus = end->node->bus;
    if (!is_created) {
        end->state = REFUSED;
        if (waiting_for(bus, end->request) == NULL && !end->is_closed)
            tell(bus, BUSD_REFUSED, end, "%s: %s", end->topic, bus->error);
        return;
    }
    end->id = busd_find_number(body, "id", 0);
    if (end->is_closed) {
        end->state = REFUSED;
        control_simple(bus, "end-", 1, (const char *const[]){"endpoint"}, &end->id);
        return;
    }
    end->state = DECLARED;
    end->was_declared = true;
    end->window_samples = busd_find_number(body, "window_samples", 0);
    end->window_bytes = busd_find_number(body, "window_bytes", 0);
    report_due(end);
    if (end->is_publisher) {
        busd_publisher *p = (busd_publisher *)end;
        p->max_message_bytes = busd_find_number(body, "max_message_bytes", 0);
        p->ring_bytes = busd_find_number(body, "ring_bytes", 0);
        room_announce(p);
        room_set_hold(p);
        if (end->qos.lease_ns > 0)
            ping_due(bus);
    } else {
        busd_subscription *s = (busd_subscription *)end;
        s->depth = end->qos.history == BUSD_KEEP_ALL ? 0 : busd_find_number(body, "depth", end->qos.depth);
        s->declared_ns = now_ns();
    }
}

/* --- declarations */

int declare_node(busd_node *node)
{
    busd_out out;
    control_begin(&out, "node+", 3);
    node->request = ++node->bus->requests;
    node->state = ASKED;
    field_number(&out, "request", node->request);
    field_text(&out, "name", node->name);
    field_text(&out, "namespace", node->ns);
    const int status = control_send(node->bus, &out, NULL, 0);
    if (status < 0)
        node->state = UNDECLARED;
    return status;
}

static bool is_declared_with(const struct endpoint *other, const struct endpoint *end)
{
    return other != end && (other->state == ASKED || other->state == DECLARED)
           && strcmp(other->type.name, end->type.name) == 0 && strcmp(other->type.hash, end->type.hash) == 0;
}

/* Declares the endpoint's type, unless another endpoint has done so on this connection. */
static void declare_type(const struct endpoint *end)
{
    const busd_bus *bus = end->node->bus;
    for (const busd_publisher *p = bus->publishers; p != NULL; p = p->next)
        if (is_declared_with(&p->end, end))
            return;
    for (const busd_subscription *s = bus->subscriptions; s != NULL; s = s->next)
        if (is_declared_with(&s->end, end))
            return;
    busd_out out;
    control_begin(&out, "type", end->type.schema == NULL ? 2 : 3);
    field_text(&out, "type_name", end->type.name);
    field_text(&out, "type_hash", end->type.hash);
    if (end->type.schema != NULL)
        field_bytes(&out, "schema", end->type.schema, end->type.schema_size);
    control_send(end->node->bus, &out, NULL, 0);
}

static void field_qos(busd_out *out, const busd_qos *qos)
{
    const struct {
        const char *key;
        int64_t ns;
    } durations[] = {
        {"deadline", qos->deadline_ns}, {"lifespan", qos->lifespan_ns}, {"liveliness_lease_duration", qos->lease_ns}};
    const struct {
        const char *key, *value;
        bool is_set;
    } policies[] = {{"history", "keep_all", qos->history == BUSD_KEEP_ALL},
                    {"reliability", "best_effort", qos->reliability == BUSD_BEST_EFFORT},
                    {"durability", "transient_local", qos->durability == BUSD_TRANSIENT_LOCAL},
                    {"liveliness", "manual_by_topic", qos->liveliness == BUSD_MANUAL_BY_TOPIC}};
    size_t fields = 1;
    for (int i = 0; i < 3; i++)
        fields += durations[i].ns != 0;
    for (int i = 0; i < 4; i++)
        fields += policies[i].is_set;
    busd_put_text(out, "qos", 3);
    busd_put_map(out, fields);
    field_number(out, "depth", qos->depth);
    for (int i = 0; i < 4; i++)
        if (policies[i].is_set)
            field_text(out, policies[i].key, policies[i].value);
    for (int i = 0; i < 3; i++) {
        if (durations[i].ns == 0)
            continue;
        busd_put_text(out, durations[i].key, strlen(durations[i].key));
        busd_put_float(out, (double)durations[i].ns / 1e9);
    }
}

/* Positions of sources that have not left, or that have. At most `left` of them; returns how many more would fit. */
static size_t put_positions(busd_out *out, const busd_subscription *sub, bool are_gone, size_t left)
{
    for (const struct source *source = sub->sources; source != NULL && left > 0; source = source->next) {
        if (source_position(source) == 0 || source->is_gone != are_gone)
            continue;
        busd_put_bytes(out, source->gid, sizeof source->gid);
        busd_put_uint(out, source_position(source));
        left--;
    }
    return left;
}

static void field_last_seqs(busd_out *out, const busd_subscription *sub, size_t known)
{
    busd_put_text(out, "last_seqs", strlen("last_seqs"));
    busd_put_map(out, known);
    put_positions(out, sub, true, put_positions(out, sub, false, known));
}

/* Asks busd for a publisher or subscription of a declared node. */
int declare_endpoint(struct endpoint *end)
{
    busd_bus *bus = end->node->bus;
    busd_publisher *p = end->is_publisher ? (busd_publisher *)end : NULL;
    const busd_subscription *s = end->is_publisher ? NULL : (busd_subscription *)end;
    size_t known = 0;
    busd_out out;
    for (const struct source *source = s != NULL ? s->sources : NULL; source != NULL; source = source->next)
        known += source_position(source) != 0 && known < MOST_LAST_SEQS;
    declare_type(end);
    const bool has_ring = p != NULL && p->fd >= 0;
    const bool takes_history = s != NULL && end->qos.durability == BUSD_BEST_AVAILABLE; /* beside volatile durability */
    control_begin(&out, p != NULL ? "pub+" : "sub+", p != NULL ? 8 + has_ring : 7 + (known != 0) + takes_history);
    end->request = ++bus->requests;
    end->state = ASKED;
    field_number(&out, "request", end->request);
    field_number(&out, "node", end->node->id);
    field_text(&out, "topic", end->topic);
    field_text(&out, "type_name", end->type.name);
    field_text(&out, "type_hash", end->type.hash);
    field_qos(&out, &end->qos);
    field_bytes(&out, "gid", end->gid, sizeof end->gid);
    if (p != NULL) {
        field_number(&out, "next_seq", stream_next_seq(p));
        if (has_ring)
            field_number(&out, "descriptors", 1);
        p->is_announced = true;
    } else if (known != 0) {
        field_last_seqs(&out, s, known);
    }
    if (takes_history)
        field_bool(&out, "takes_history", true);
    const int status = control_send(bus, &out, p != NULL ? &p->fd : NULL, has_ring);
    if (status < 0)
        end->state = UNDECLARED;
    return status;
}

/* Declares an endpoint of a node that busd knows again. If that can't be sent, the next connection tries it again. */
static void declare_again(struct endpoint *end)
{
    busd_bus *bus = end->node->bus;
    if (bus->sock >= 0 && declare_endpoint(end) < 0 && bus->sock >= 0)
        lose_connection(bus, NULL);
}

/* After busd's Hello: everything of this process. 0, or -errno with the reason in `error`. */
int declare_all(busd_bus *bus)
{
    int status = 0;
    if (bus->shares) {
        const int fds[2] = {bus->bell, bus->readers_fd};
        busd_out out;
        control_begin(&out, "share", 1);
        field_number(&out, "descriptors", 2);
        status = control_send(bus, &out, fds, 2);
    }
    for (busd_node *node = bus->nodes; node != NULL && status == 0; node = node->next)
        if (node->state == UNDECLARED && !node->is_closed)
            status = declare_node(node);
    return status == 0 && bus->watches != NULL ? graph_ask(bus) : status;
}

/* The endpoints of a node that busd has refused. */
static void refuse_endpoints(const busd_node *node)
{
    for (busd_publisher *p = node->bus->publishers; p != NULL; p = p->next)
        if (p->end.node == node)
            p->end.state = REFUSED;
    for (busd_subscription *s = node->bus->subscriptions; s != NULL; s = s->next)
        if (s->end.node == node)
            s->end.state = REFUSED;
}

/* Takes Created, Done or Refused. */
void answer_take(busd_bus *bus, busd_in body, bool is_created)
{
    const uint64_t request = busd_find_number(body, "request", 0);
    const bool is_refused = busd_find_is(body, "m", "refused");
    const int answer = is_refused ? refusal(bus, body) : 0;
    struct waiting *waiting = waiting_for(bus, request);
    if (waiting != NULL)
        waiting->answer = answer;
    if (is_refused && request == bus->graph_request && request != 0) {
        graph_refused(bus, waiting == NULL);
        return;
    }
    for (busd_node *node = bus->nodes; node != NULL; node = node->next) {
        if (node->state != ASKED || node->request != request)
            continue;
        node->state = is_created ? DECLARED : REFUSED;
        node->id = busd_find_number(body, "id", 0);
        if (node->is_closed) {
            node->state = REFUSED;
            if (is_created)
                control_simple(bus, "node-", 1, (const char *const[]){"node"}, &node->id);
            return;
        }
        if (is_refused && waiting == NULL)
            tell(bus, BUSD_REFUSED, NULL, "node %s: %s", node->name, bus->error);
        for (busd_publisher *p = bus->publishers; p != NULL; p = p->next)
            if (p->end.node == node && p->end.state == UNDECLARED && !p->end.is_closed && is_created)
                declare_again(&p->end);
        for (busd_subscription *s = bus->subscriptions; s != NULL; s = s->next)
            if (s->end.node == node && s->end.state == UNDECLARED && !s->end.is_closed && is_created)
                declare_again(&s->end);
        if (is_refused)
            refuse_endpoints(node);
        return;
    }
    for (busd_publisher *p = bus->publishers; p != NULL; p = p->next)
        if (p->end.state == ASKED && p->end.request == request)
            endpoint_answer(&p->end, body, is_created);
    for (busd_subscription *s = bus->subscriptions; s != NULL; s = s->next)
        if (s->end.state == ASKED && s->end.request == request)
            endpoint_answer(&s->end, body, is_created);
}

/* --- the life of nodes and endpoints */

void busd_create_at_once(busd_bus *bus, int is_on) { bus->creates_at_once = is_on != 0; }

/* The result of the first declaration. Without a wait, one that has not been sent comes with the next connection. */
static int first_answer(busd_bus *bus, int status, uint64_t request)
{
    if (bus->creates_at_once)
        return status == -ENOTCONN ? 0 : status;
    return status == 0 ? await(bus, &(struct waiting){.request = request}) : status;
}

int busd_node_create(busd_bus *bus, const char *name, const char *ns, busd_node **place)
{
    if (!busd_is_connected(bus) && !bus->creates_at_once)
        return fail(bus, ENOTCONN, "busd is away");
    if (!is_utf8(name) || (ns != NULL && !is_utf8(ns)))
        return fail(bus, EINVAL, "the name of a node is not UTF-8");
    busd_node *node = calloc(1, sizeof *node);
    if (node == NULL)
        return fail(bus, ENOMEM, "no memory");
    *node = (busd_node){.bus = bus, .name = strdup(name), .ns = strdup(ns == NULL || *ns == '\0' ? "/" : ns)};
    busd_node **end = &bus->nodes;
    while (*end != NULL)
        end = &(*end)->next;
    *end = node;
    int status = 0;
    if (node->name == NULL || node->ns == NULL)
        status = fail(bus, ENOMEM, "no memory");
    else if (busd_is_connected(bus)) /* else busd's Hello declares it */
        status = declare_node(node);
    status = first_answer(bus, status, node->request);
    if (status == 0) {
        *place = node;
        return 0;
    }
    node->is_closed = true;
    sweep_unless_in_turn(bus);
    return status;
}

static void end_endpoint(struct endpoint *end)
{
    if (end->is_closed)
        return;
    if (end->state == DECLARED && busd_is_connected(end->node->bus)) {
        report_last(end);
        control_simple(end->node->bus, "end-", 1, (const char *const[]){"endpoint"}, &end->id);
    }
    end->is_closed = true;
    if (end->state != ASKED) /* else the answer ends it */
        end->state = REFUSED; /* nothing more about it is taken */
}

void busd_publisher_destroy(busd_publisher *publisher)
{
    if (publisher == NULL)
        return;
    busd_bus *bus = publisher->end.node->bus;
    flush(bus);
    end_endpoint(&publisher->end);
    sweep_unless_in_turn(bus);
}

void busd_subscription_destroy(busd_subscription *subscription)
{
    if (subscription == NULL)
        return;
    busd_bus *bus = subscription->end.node->bus;
    end_endpoint(&subscription->end);
    sweep_unless_in_turn(bus);
}

void busd_node_destroy(busd_node *node)
{
    if (node == NULL || node->is_closed)
        return;
    busd_bus *bus = node->bus;
    flush(bus);
    bus->turns++; /* one sweep at the end */
    services_close(node);
    for (busd_publisher *p = bus->publishers; p != NULL; p = p->next)
        if (p->end.node == node)
            busd_publisher_destroy(p);
    for (busd_subscription *s = bus->subscriptions; s != NULL; s = s->next)
        if (s->end.node == node)
            busd_subscription_destroy(s);
    bus->turns--;
    refuse_endpoints(node); /* busd forgets them with the node */
    if (node->state == DECLARED && busd_is_connected(bus))
        control_simple(bus, "node-", 1, (const char *const[]){"node"}, &node->id);
    node->is_closed = true;
    sweep_unless_in_turn(bus);
}

/* Fills the members of a new endpoint. 0, -ENOMEM, -EINVAL or -EIO. */
static int endpoint_begin(struct endpoint *end, busd_node *node, const char *topic, const busd_type *type,
                          const busd_qos *qos, bool is_publisher)
{
    static const busd_qos usual = {.depth = 10};
    *end = (struct endpoint){.node = node, .topic = topic_name(node, topic), .type = *type,
                             .qos = qos == NULL ? usual : *qos, .is_publisher = is_publisher};
    end->is_lossless = end->qos.history == BUSD_KEEP_ALL && end->qos.reliability == BUSD_RELIABLE;
    if (end->qos.history == BUSD_KEEP_ALL)
        end->qos.depth = sizes_max(end->qos.depth, 1);
    if (!is_utf8(topic))
        return fail(node->bus, EINVAL, "the name of a topic is not UTF-8");
    if (is_publisher && end->qos.durability == BUSD_BEST_AVAILABLE)
        return fail(node->bus, EINVAL, "%s: the durability best available is for subscriptions only", topic);
    if (getrandom(end->gid, sizeof end->gid, 0) != sizeof end->gid)
        return fail(node->bus, EIO, "no random numbers");
    return end->topic == NULL ? fail(node->bus, ENOMEM, "no memory") : 0;
}

/* Asks for a new endpoint, and waits for the answer. */
static int endpoint_declare_first(struct endpoint *end)
{
    busd_bus *bus = end->node->bus;
    int status = 0;
    if (end->node->state == REFUSED)
        status = fail(bus, EPIPE, "busd has refused the node %s", end->node->name);
    else if (end->node->state == DECLARED && busd_is_connected(bus))
        status = declare_endpoint(end);
    else /* the answer about the node declares it, if there is no wait */
        status = fail(bus, ENOTCONN, "busd is away");
    status = first_answer(bus, status, end->request);
    if (status < 0) {
        end->is_closed = true;
        sweep_unless_in_turn(bus);
    }
    return status;
}

int busd_publisher_create(busd_node *node, const char *topic, const busd_type *type, const busd_qos *qos,
                          busd_publisher **place)
{
    busd_bus *bus = node->bus;
    busd_publisher *p = calloc(1, sizeof *p);
    if (p == NULL)
        return fail(bus, ENOMEM, "no memory");
    int status = endpoint_begin(&p->end, node, topic, type, qos, true);
    p->fd = -1;
    p->max_message_bytes = MOST_MESSAGE; /* until busd says it */
    if (status == 0 && !room_begin(p))
        status = fail(bus, ENOMEM, "no memory for a ring");
    if (status < 0) {
        publisher_free(p);
        return status;
    }
    p->next = bus->publishers;
    bus->publishers = p;
    status = endpoint_declare_first(&p->end);
    if (status == 0)
        *place = p;
    return status;
}

int busd_subscription_create(busd_node *node, const char *topic, const busd_type *type, const busd_qos *qos,
                             busd_callback *callback, void *user, busd_subscription **place)
{
    busd_bus *bus = node->bus;
    busd_subscription *s = calloc(1, sizeof *s);
    if (s == NULL)
        return fail(bus, ENOMEM, "no memory");
    int status = endpoint_begin(&s->end, node, topic, type, qos, false);
    s->callback = callback;
    s->user = user;
    s->depth = s->end.qos.history == BUSD_KEEP_ALL ? 0 : s->end.qos.depth;
    s->last = s->kept = &s->first;
    bus->has_deadlines |= s->end.qos.deadline_ns > 0;
    if (status < 0) {
        subscription_free(s);
        return status;
    }
    s->next = bus->subscriptions;
    bus->subscriptions = s;
    status = endpoint_declare_first(&s->end);
    if (status == 0)
        *place = s;
    return status;
}

/* The connection is lost: busd does not know the endpoint any more. */
void endpoint_gone(struct endpoint *end)
{
    end->state = end->state == REFUSED ? REFUSED : UNDECLARED;
    end->id = 0;
}

/* Frees the members of an endpoint. */
void endpoint_free(struct endpoint *end) { free(end->topic); }
