/* Services: calls with one answer, over two topics. docs/services.md: "On the bus".
 *
 * A call at its client is pending until its answer, or until its servers have left. At its server it is open until the
 * reply. A request or an answer can be lost with the connection, or by a bridge. Then the client asks the servers about
 * the call. A server that does not work on it says so; once all have said so, the call has failed. A bridge can lose
 * the question, too, so the client asks again after 1, 2, 4 and so on up to 16 seconds.
 */
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "internal.h"

#define HEAD_ROOM 64u /* of an envelope, without its texts and body */
#define FIRST_PAUSE_NS (2 * SECOND_NS)  /* until the first question about a bridged call: most answers come sooner */
#define MOST_PAUSE_NS (16 * SECOND_NS)  /* between two questions */
#define LEAST_PAUSE_NS (SECOND_NS / 4)  /* between two looks at all calls */
#define GRACE_NS (SECOND_NS / 2)        /* the report that a server has left may overtake its last answer */
#define MOST_PENDING 1000u              /* calls of a client */
#define MOST_OPEN 10000u                /* calls of a server */

static const unsigned char nil = 0xc0;

/* --- envelopes */

struct envelope {
    busd_call call;
    busd_text error;
    busd_message message; /* data and size: of the body */
    bool is_nil;
};

static bool envelope_take(const busd_message *taken, bool is_reply, struct envelope *envelope)
{
    const unsigned char *bytes = taken->data;
    busd_in in = {bytes, bytes + taken->size, false};
    memset(envelope, 0, sizeof *envelope);
    if (!busd_get_array(&in, is_reply ? 4 : 3))
        return false;
    busd_get_bytes_copy(&in, envelope->call.client, sizeof envelope->call.client);
    envelope->call.number = busd_get_uint(&in, UINT64_MAX);
    if (is_reply)
        busd_get_text_view(&in, &envelope->error);
    if (in.failed || in.at == in.end)
        return false;
    envelope->message = *taken;
    envelope->message.data = in.at;
    envelope->message.size = (size_t)(in.end - in.at);
    envelope->is_nil = *in.at == nil;
    return true;
}

/* Publishes an envelope. `error` NULL: a request. */
static int envelope_publish(busd_publisher *publisher, const busd_call *call, const char *error, const void *body,
                            size_t size)
{
    unsigned char *place;
    const size_t text = error == NULL ? 0 : strlen(error);
    const size_t room = HEAD_ROOM + text + size;
    const int status = busd_loan(publisher, room, (void **)&place);
    if (status < 0)
        return status;
    busd_out out = {place, 0, room, true, false};
    busd_put_array(&out, error == NULL ? 3 : 4);
    busd_put_bytes(&out, call->client, sizeof call->client);
    busd_put_uint(&out, call->number);
    if (error != NULL)
        busd_put_text(&out, error, text);
    busd_put_raw(&out, body, size);
    return busd_publish_loan(publisher, out.size);
}

/* --- both ends */

static bool is_call(const busd_call *a, const busd_call *b)
{
    return a->number == b->number && memcmp(a->client, b->client, sizeof a->client) == 0;
}

static struct call *call_find(struct service *service, const busd_call *wanted)
{
    /* From both ends: calls mostly end in their order; but a callback that replies at once ends the newest. */
    struct call *old = service->oldest, *young = service->newest;
    while (old != NULL) {
        if (is_call(&old->id, wanted))
            return old;
        if (is_call(&young->id, wanted))
            return young;
        if (old == young || old->newer == young)
            return NULL;
        old = old->newer;
        young = young->older;
    }
    return NULL;
}

static struct call *call_add(struct service *service, const busd_call *id)
{
    struct call *call = calloc(1, sizeof *call);
    if (call == NULL)
        return NULL;
    call->id = *id;
    call->older = service->newest;
    *(call->older == NULL ? &service->oldest : &call->older->newer) = call;
    service->newest = call;
    service->call_count++;
    return call;
}

static void call_free(struct call *call)
{
    free(call->denied);
    free(call);
}

/* Takes a call out of the list. */
static struct call call_end(struct service *service, struct call *call)
{
    struct call ended = *call;
    *(call->older == NULL ? &service->oldest : &call->older->newer) = call->newer;
    *(call->newer == NULL ? &service->newest : &call->newer->older) = call->older;
    service->call_count--;
    call_free(call);
    return ended;
}

static int service_create(struct service *service, busd_node *node, const char *name, const busd_service_type *type,
                          const busd_qos *qos, bool is_server, busd_callback *hear)
{
    static const busd_qos usual = {.depth = 1000};
    busd_bus *bus = node->bus;
    const busd_qos sent = qos == NULL ? usual : *qos;
    busd_qos taken = sent;
    taken.history = BUSD_KEEP_ALL;
    char *full = topic_name(node, name), *topics[2] = {NULL, NULL};
    if (full == NULL || asprintf(&topics[0], "%s/_request", full) < 0 || asprintf(&topics[1], "%s/_reply", full) < 0) {
        free(full);
        free(topics[0]);
        return fail(bus, ENOMEM, "no memory");
    }
    free(full);
    service->node = node;
    int status = 0;
    if (is_server)
        status = busd_publisher_create(node, topics[1], &type->reply, &sent, &service->publisher);
    if (status == 0)
        status = busd_subscription_create(node, topics[!is_server], is_server ? &type->request : &type->reply, &taken,
                                          hear, service, &service->subscription);
    if (status == 0 && !is_server)
        status = busd_publisher_create(node, topics[0], &type->request, &sent, &service->publisher);
    free(topics[0]);
    free(topics[1]);
    if (status < 0) {
        busd_subscription_destroy(service->subscription);
        if (is_server)
            busd_publisher_destroy(service->publisher);
        return status;
    }
    service->next = bus->services;
    bus->services = service;
    return 0;
}

static void end_calls(struct service *service, int status, const char *error)
{
    struct call *call = service->oldest;
    service->oldest = service->newest = NULL;
    service->call_count = 0;
    while (call != NULL) {
        struct call *next = call->newer;
        call->answer(call->user, status, error, NULL);
        call_free(call);
        call = next;
    }
}

static void service_destroy(struct service *service)
{
    if (service->is_closed)
        return;
    service->is_closed = true; /* an answer can't begin another call now */
    busd_bus *bus = service->node->bus;
    bus->turns++; /* one sweep at the end; and answers may destroy, too */
    if (service->is_client && bus->pid == getpid()) /* after a fork, the calls are the parent's */
        end_calls(service, -ECANCELED, "the client was destroyed");
    busd_subscription_destroy(service->subscription);
    busd_publisher_destroy(service->publisher);
    bus->turns--;
    sweep_unless_in_turn(bus);
}

/* Frees a closed service, and the open calls of a server. */
void service_free(struct service *service)
{
    while (service->oldest != NULL)
        call_end(service, service->oldest);
    free(service);
}

static void take_stats(const struct service *service, int matches, busd_service_stats *stats)
{
    *stats = (busd_service_stats){.requests = service->requests,
                                  .responses = service->responses,
                                  .errors = service->errors,
                                  .late = service->late,
                                  .open = (uint32_t)service->call_count,
                                  .matches = (uint32_t)matches};
}

/* The node is destroyed, with the endpoints. */
void services_close(busd_node *node)
{
    for (struct service *service = node->bus->services; service != NULL; service = service->next)
        if (service->node == node)
            service_destroy(service);
}

/* --- servers */

/* Ends the oldest call, so that another one has room. */
static void end_oldest(busd_server *server)
{
    struct call *oldest = server->service.oldest;
    const busd_call id = oldest->id;
    if (busd_reply_error(server, &id, "the server has too many open calls") < 0
        && (oldest = call_find(&server->service, &id)) != NULL)
        call_end(&server->service, oldest); /* its client asks about it, perhaps, and learns that it is lost */
}

static void hear_request(void *user, const busd_message *taken)
{
    busd_server *server = user;
    struct envelope envelope;
    if (server->service.is_closed || !envelope_take(taken, false, &envelope))
        return;
    if (envelope.is_nil) {
        if (call_find(&server->service, &envelope.call) == NULL)
            envelope_publish(server->service.publisher, &envelope.call, "", &nil, 1);
        return;
    }
    server->service.requests++;
    if (server->service.call_count >= MOST_OPEN)
        end_oldest(server);
    if (server->service.is_closed)
        return; /* by a callback meanwhile */
    if (call_add(&server->service, &envelope.call) == NULL)
        envelope_publish(server->service.publisher, &envelope.call, "the server has no memory", &nil, 1);
    else
        server->serve(server->user, server, &envelope.call, &envelope.message);
}

int busd_server_create(busd_node *node, const char *name, const busd_service_type *type, const busd_qos *qos,
                       busd_serve *serve, void *user, busd_server **place)
{
    busd_server *server = calloc(1, sizeof *server);
    if (server == NULL)
        return fail(node->bus, ENOMEM, "no memory");
    server->serve = serve;
    server->user = user;
    const int status = service_create(&server->service, node, name, type, qos, true, hear_request);
    if (status < 0)
        free(server);
    else
        *place = server;
    return status;
}

static int reply(busd_server *server, const busd_call *id, const char *error, const void *body, size_t size)
{
    struct call *call = call_find(&server->service, id);
    if (call == NULL)
        return fail(server->service.node->bus, ENOENT, "this call has its reply already");
    const int status = envelope_publish(server->service.publisher, id, error, body, size);
    call = call_find(&server->service, id); /* the loss of the connection has a callback, which may reply, too */
    if (status == 0 && call != NULL) {
        call_end(&server->service, call);
        server->service.responses++;
        server->service.errors += *error != '\0';
    }
    return status;
}

int busd_reply(busd_server *server, const busd_call *call, const void *body, size_t size)
{
    return body == NULL ? fail_encoding(server->service.node->bus) : reply(server, call, "", body, size);
}

int busd_reply_error(busd_server *server, const busd_call *call, const char *reason)
{
    char *text = strdup(*reason == '\0' ? "failed" : reason);
    if (text == NULL)
        return fail(server->service.node->bus, ENOMEM, "no memory");
    make_utf8(text); /* else the client can't decode the reply, and waits on */
    const int status = reply(server, call, text, &nil, 1);
    free(text);
    return status;
}

void busd_server_stats(const busd_server *server, busd_service_stats *stats)
{
    take_stats(&server->service, busd_subscription_matches(server->service.subscription), stats);
}

void busd_server_destroy(busd_server *server)
{
    if (server != NULL)
        service_destroy(&server->service);
}

/* --- clients */

static void answer(struct service *service, struct call *call, int status, const char *error,
                   const busd_message *response)
{
    const struct call ended = call_end(service, call);
    ended.answer(ended.user, status, error, response);
}

static bool has_denied(const struct call *call, const struct source *source)
{
    for (size_t i = 0; i < call->denied_count; i++)
        if (memcmp(call->denied[i], source->gid, sizeof source->gid) == 0)
            return true;
    return false;
}

/* A server does not work on the call. Returns whether none does: then it is lost. */
static bool deny(struct service *service, struct call *call, const struct source *from)
{
    size_t known = 0, left = 0;
    if (from != NULL && !has_denied(call, from)) {
        unsigned char(*denied)[16] = realloc(call->denied, (call->denied_count + 1) * sizeof *denied);
        if (denied == NULL)
            return false; /* it says so again after the next question */
        call->denied = denied;
        memcpy(denied[call->denied_count++], from->gid, sizeof from->gid);
    }
    for (const struct source *source = service->subscription->sources; source != NULL; source = source->next) {
        if (source->is_gone || source->is_stale)
            continue;
        known++;
        left += !has_denied(call, source);
    }
    /* A server's publisher of replies may come later than its subscription, or never, with another QoS. */
    const bool are_all_known = known >= (size_t)busd_publisher_matches(service->publisher);
    return left == 0 && (are_all_known || call->pause_ns >= MOST_PAUSE_NS);
}

static void hear_reply(void *user, const busd_message *taken)
{
    busd_client *client = user;
    struct envelope envelope;
    if (client->service.is_closed || !envelope_take(taken, true, &envelope))
        return;
    struct call *call = call_find(&client->service, &envelope.call);
    if (call == NULL) {
        const unsigned char *own = client->service.publisher->end.gid;
        client->service.late += memcmp(envelope.call.client, own, sizeof envelope.call.client) == 0;
        return;
    }
    client->service.responses += envelope.error.size != 0 || !envelope.is_nil;
    client->service.errors += envelope.error.size != 0;
    if (envelope.error.size != 0) {
        char text[400];
        snprintf(text, sizeof text, "%.*s", (int)sizes_min(envelope.error.size, sizeof text - 1), envelope.error.data);
        end_whole(text);
        answer(&client->service, call, -EREMOTEIO, text, NULL);
    } else if (envelope.is_nil) {
        if (deny(&client->service, call, source_find(client->service.subscription, taken->publisher)))
            answer(&client->service, call, -EPIPE, "the request or the answer was lost", NULL);
    } else {
        answer(&client->service, call, 0, NULL, &envelope.message);
    }
}

int busd_client_create(busd_node *node, const char *name, const busd_service_type *type, const busd_qos *qos,
                       busd_client **place)
{
    busd_client *client = calloc(1, sizeof *client);
    if (client == NULL)
        return fail(node->bus, ENOMEM, "no memory");
    const int status = service_create(&client->service, node, name, type, qos, false, hear_reply);
    if (status < 0) {
        free(client);
        return status;
    }
    client->service.is_client = true;
    *place = client;
    return 0;
}

static bool has_bridged_server(const struct service *service)
{
    for (const struct match *m = service->publisher->matches; m != NULL; m = m->next)
        if (m->is_bridged && !m->is_over)
            return true;
    return false;
}

/* Looks at all calls at this time, or earlier. */
static void look_at(busd_bus *bus, int64_t at_ns)
{
    if (bus->at[QUESTIONS] == 0 || at_ns < bus->at[QUESTIONS])
        set_timer(bus, QUESTIONS, at_ns);
}

int busd_client_call(busd_client *client, const void *body, size_t size, busd_answer *callback, void *user)
{
    busd_call id;
    if (client->service.is_closed)
        return fail(client->service.node->bus, ECANCELED, "the client was destroyed");
    if (body == NULL)
        return fail_encoding(client->service.node->bus);
    if (client->service.call_count >= MOST_PENDING)
        return fail(client->service.node->bus, ENOBUFS,
                    "%u calls of this client have no answer yet, which is the limit", MOST_PENDING);
    const struct endpoint *end = &client->service.publisher->end;
    const bool is_declared = end->state == DECLARED;
    if ((is_declared || !end->was_declared) && busd_client_servers(client) == 0)
        return fail(client->service.node->bus, EHOSTUNREACH, "%s has no server", client->service.publisher->end.topic);
    memcpy(id.client, client->service.publisher->end.gid, sizeof id.client);
    id.number = client->numbers++; /* now, because a callback inside of the publish may call, too */
    struct call *call = call_add(&client->service, &id);
    if (call == NULL)
        return fail(client->service.node->bus, ENOMEM, "no memory");
    call->answer = callback;
    call->user = user;
    const bool is_bridged = has_bridged_server(&client->service);
    call->is_unsure = is_bridged || !is_declared;
    call->ask_ns = is_bridged ? now_ns() + FIRST_PAUSE_NS : 0;
    const int status = envelope_publish(client->service.publisher, &id, NULL, body, size);
    if (status < 0) {
        if ((call = call_find(&client->service, &id)) == NULL)
            return 0; /* a callback has ended it, with its answer */
        call_end(&client->service, call);
        return status;
    }
    client->service.requests++;
    if (is_bridged)
        look_at(client->service.node->bus, now_ns() + FIRST_PAUSE_NS);
    return 0;
}

int busd_client_servers(const busd_client *client) { return busd_publisher_matches(client->service.publisher); }

void busd_client_stats(const busd_client *client, busd_service_stats *stats)
{
    take_stats(&client->service, busd_client_servers(client), stats);
}

void busd_client_destroy(busd_client *client)
{
    if (client != NULL)
        service_destroy(&client->service);
}

/* Asks the servers about a call, if it is time for that. False: the service was closed meanwhile, with its calls. */
static bool ask(struct service *service, struct call *call, int64_t now)
{
    if (!call->is_unsure || call->ask_ns > now)
        return true;
    if (envelope_publish(service->publisher, &call->id, NULL, &nil, 1) < 0) {
        if (service->is_closed)
            return false;
        call->ask_ns = now + SECOND_NS;
        return true;
    }
    if (service->is_closed)
        return false;
    call->pause_ns = call->pause_ns == 0 ? SECOND_NS : (int64_t)sizes_min(2 * (uint64_t)call->pause_ns, MOST_PAUSE_NS);
    call->ask_ns = now + call->pause_ns;
    return true;
}

/* Fails the calls whose servers have left. */
static void give_up(struct service *service)
{
    struct call *call;
    service->give_up_ns = 0;
    do {
        for (call = service->oldest; call != NULL && !call->is_lost;)
            call = call->newer;
        if (call != NULL)
            answer(service, call, -EPIPE, "no server is left", NULL); /* this may end the client, and its calls */
    } while (call != NULL);
}

/* Looks at the calls of one client. Returns the time of the next look; INT64_MAX: there is none. */
static int64_t look(struct service *service, int64_t now)
{
    int64_t next = INT64_MAX;
    if (service->give_up_ns != 0 && service->give_up_ns <= now)
        give_up(service);
    if (service->give_up_ns != 0)
        next = service->give_up_ns;
    if (busd_publisher_matches(service->publisher) == 0)
        return next;
    for (struct call *call = service->oldest; call != NULL; call = call->newer) {
        if (!ask(service, call, now))
            return INT64_MAX;
        if (call->is_unsure && call->ask_ns < next)
            next = call->ask_ns;
    }
    return next;
}

/* Asks about the calls that may be lost, and fails the calls that are. */
void services_look(busd_bus *bus, int64_t now)
{
    int64_t next = INT64_MAX;
    for (struct service *service = bus->services; service != NULL; service = service->next)
        if (service->is_client && !service->is_closed)
            next = (int64_t)sizes_min((uint64_t)next, (uint64_t)look(service, now));
    if (next != INT64_MAX)
        look_at(bus, (int64_t)sizes_max((uint64_t)next, (uint64_t)(now + LEAST_PAUSE_NS)));
}

/* The publisher's service, if it is of a client. */
static struct service *client_of(const busd_publisher *publisher)
{
    struct service *service = publisher->end.node->bus->services;
    while (service != NULL && (service->publisher != publisher || !service->is_client || service->is_closed))
        service = service->next;
    return service;
}

/* A publisher's matches have changed: if it is of a client, its pending calls may have lost their server, or their
 * server may have lost them. */
void services_matched(busd_publisher *publisher, bool has_come)
{
    struct service *service = client_of(publisher);
    if (service == NULL || service->oldest == NULL)
        return;
    const int64_t now = now_ns();
    const bool has_server = busd_publisher_matches(publisher) != 0;
    for (struct call *call = service->oldest; call != NULL; call = call->newer) {
        if (has_come) {
            call->ask_ns = 0;
        } else if (has_server && !call->is_unsure) { /* the remaining ones may not know it: they may be newer */
            call->is_unsure = true;
            call->ask_ns = now + SECOND_NS;
        } else if (!has_server) {
            call->is_lost = true;
            service->give_up_ns = now + GRACE_NS;
        }
    }
    const int64_t next = has_come ? look(service, now) : !has_server ? now + GRACE_NS : now + SECOND_NS;
    if (next != INT64_MAX)
        look_at(publisher->end.node->bus, next);
}

/* Servers had time to come back with the next busd: calls without one are lost. */
void services_absent(busd_bus *bus)
{
    for (struct service *service = bus->services; service != NULL; service = service->next)
        if (service->is_client && !service->is_closed && busd_publisher_matches(service->publisher) == 0)
            services_matched(service->publisher, false);
}

/* The connection is lost: requests and answers may be lost, too. */
void services_lost(busd_bus *bus)
{
    for (struct service *service = bus->services; service != NULL; service = service->next) {
        for (struct call *call = service->oldest; call != NULL; call = call->newer) {
            call->is_unsure = service->is_client;
            call->ask_ns = call->pause_ns = 0;
        }
    }
}
