/* busd in C: nodes, publishers and subscriptions on the bus of this machine. docs/c.md is the manual.
 *
 * One thread at a time may use a connection and everything made with it. The library has no threads, no signal
 * handlers and no global state. After a fork, the child may only release, destroy and close, which then changes nothing
 * for busd and the parent, and calls no callbacks.
 *
 * Functions that return int return 0, a number of things, or a negative errno; busd_error() then says why in words.
 */
#ifndef BUSD_BUSD_H
#define BUSD_BUSD_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#pragma GCC visibility push(default)

typedef struct busd_bus busd_bus;
typedef struct busd_node busd_node;
typedef struct busd_publisher busd_publisher;
typedef struct busd_subscription busd_subscription;

/* A message type. `bus interface c PKG/msg/Type` writes it. All pointers must stay valid. */
typedef struct busd_type {
    const char *name, *hash;
    const void *schema;
    size_t schema_size;
} busd_type;

/* --- QoS */

enum { BUSD_KEEP_LAST, BUSD_KEEP_ALL };
enum { BUSD_RELIABLE, BUSD_BEST_EFFORT };
enum { BUSD_VOLATILE, BUSD_TRANSIENT_LOCAL, BUSD_BEST_AVAILABLE };
enum { BUSD_AUTOMATIC, BUSD_MANUAL_BY_TOPIC };

/* Durations in nanoseconds; 0 is infinite. All zero except depth 10 is the default profile. */
typedef struct busd_qos {
    uint32_t depth;
    uint8_t history, reliability, durability, liveliness;
    int64_t deadline_ns, lifespan_ns, lease_ns;
} busd_qos;

#ifndef __cplusplus
#define BUSD_QOS_DEFAULT ((busd_qos){.depth = 10})
#define BUSD_QOS_SENSOR ((busd_qos){.depth = 5, .reliability = BUSD_BEST_EFFORT})
#define BUSD_QOS_LOSSLESS ((busd_qos){.depth = 10, .history = BUSD_KEEP_ALL})
#define BUSD_QOS_LATCHED ((busd_qos){.depth = 1, .durability = BUSD_TRANSIENT_LOCAL})
#endif

/* --- the connection */

/* Connects to busd. `path` NULL: $BUSD_SOCKET, or the socket of $BUSD_DOMAIN. `program`: its name in `bus top`.
 * *bus is set even if this fails, for busd_error() and busd_close(); it is NULL only for -ENOMEM.
 * Errors: -ENOENT or -ECONNREFUSED without a busd, -EACCES, -ETIMEDOUT, -EPROTO for another protocol version,
 * -EAGAIN if busd has ended each connection for 10 s. */
int busd_connect(busd_bus **bus, const char *path, const char *program);

/* Sends queued samples for up to a second, ends all nodes, and frees everything of the connection. Pending calls of
 * clients end with -ECANCELED. Messages that the program still holds must be released before. Not in a callback: there
 * it only ends the events. */
void busd_close(busd_bus *bus);

/* A descriptor for poll(), epoll or another event loop. If it is readable, call busd_dispatch(). */
int busd_fd(const busd_bus *bus);

/* Does everything that is due, and never waits: calls callbacks, sends, answers busd. Returns 1 if it must be called
 * again soon, although the descriptor may not be readable; else 0. */
int busd_dispatch(busd_bus *bus);

/* Waits up to `timeout_ms` (-1: without limit) for anything to do, then as busd_dispatch(). Returns early, with 0, on a
 * signal. */
int busd_wait(busd_bus *bus, int timeout_ms);

/* 1 while busd knows this process; 0 in its child after a fork. If the connection is lost, the library connects again
 * by itself. */
int busd_is_connected(const busd_bus *bus);

/* The reason of the last call that failed. Never NULL. */
const char *busd_error(const busd_bus *bus);

typedef enum busd_event_kind {
    BUSD_CONNECTED,          /* again, after BUSD_DISCONNECTED */
    BUSD_DISCONNECTED,
    BUSD_REFUSED,            /* busd does not accept a node or an endpoint that was created before */
    BUSD_MATCHED,
    BUSD_UNMATCHED,
    BUSD_INCOMPATIBLE,       /* another endpoint of the topic does not match: type, QoS or access */
    BUSD_ROUTE,              /* a match can't share memory, and uses the socket */
    BUSD_LIVELINESS_CHANGED, /* of a publisher */
    BUSD_LIVELINESS_LOST,    /* to the publisher itself */
    BUSD_NAMESAKE,           /* another node has the name of a node of ours */
    BUSD_DEADLINE_MISSED,    /* no message was published, or arrived, within the deadline */
} busd_event_kind;

typedef struct busd_event {
    busd_event_kind kind;
    const char *text;                /* a sentence for the log */
    busd_publisher *publisher;       /* the endpoint of ours, if the event is about one; else NULL */
    busd_subscription *subscription;
    uint64_t count;                  /* BUSD_DEADLINE_MISSED: of the endpoint until now; else 0 */
} busd_event;

/* `callback` gets every later event, inside of calls of the library. */
void busd_on_event(busd_bus *bus, void (*callback)(void *user, const busd_event *event), void *user);

/* 0: functions that create a node, an endpoint, a server or a client wait for busd's answer, for up to 10 s without any
 * sign of it. 1: from now on they return at once, also while busd is away, and busd learns of the new thing as soon as
 * possible. Then BUSD_REFUSED tells what it refuses, and why. Messages before that go to nobody, unless the publisher
 * is transient local. */
void busd_create_at_once(busd_bus *bus, int is_on);

/* `ns` NULL: "/". Errors: -EINVAL with busd's reason, -ENOTCONN, -ETIMEDOUT. */
int busd_node_create(busd_bus *bus, const char *name, const char *ns, busd_node **node);

/* Destroys its endpoints, too. */
void busd_node_destroy(busd_node *node);

/* --- publishers */

/* `topic`: relative to the namespace, absolute (/a), or private (~/a). Errors: -EINVAL with busd's reason, -EACCES,
 * -EDQUOT for a used-up limit, -ENOTCONN, -ETIMEDOUT. */
int busd_publisher_create(busd_node *node, const char *topic, const busd_type *type, const busd_qos *qos,
                          busd_publisher **publisher);

/* Publishes an encoded message. -EAGAIN: a lossless publisher has no room, see busd_publisher_wait(). -EMSGSIZE: above
 * busd's limit. -ENOMEM: no memory for a larger ring. While busd is away, it keeps messages up to the depth. */
int busd_publish(busd_publisher *publisher, const void *data, size_t size);

/* Lends `size` bytes in the ring. The program fills them, then calls busd_publish_loan() with the size that it used.
 * Another loan or busd_publish() gives the loan up. Errors as busd_publish(). */
int busd_loan(busd_publisher *publisher, size_t size, void **place);
int busd_publish_loan(busd_publisher *publisher, size_t size);

/* After -EAGAIN: waits for room, and calls callbacks meanwhile. 1: there is room; 0: timeout. */
int busd_publisher_wait(busd_publisher *publisher, int timeout_ms);

/* A sign of life, for liveliness manual by topic. A message is one, too. */
int busd_publisher_assert_liveliness(busd_publisher *publisher);

/* Subscriptions that get the messages, also on other buses. */
int busd_publisher_matches(const busd_publisher *publisher);

void busd_publisher_destroy(busd_publisher *publisher);

/* --- subscriptions */

/* A message as it came. `data` is valid until busd_release(), and may lie in shared memory. */
typedef struct busd_message {
    const void *data;
    size_t size;
    int64_t stamp_ns;   /* of publishing, by this process's CLOCK_MONOTONIC */
    int64_t source_ns;  /* wall clock, from the message's source; 0: none */
    uint64_t seq;       /* of its publisher, from 1 on */
    uint64_t publisher; /* busd's number of it; UINT64_MAX: it had left before the connection was made again */
    int by_ring;        /* 1: through shared memory, 0: by socket */
    void *held;         /* for busd_release() */
} busd_message;

typedef void busd_callback(void *user, const busd_message *message);

/* `callback` is called inside of busd_dispatch() and busd_wait(), and its message is released after it. NULL: messages
 * wait for busd_take(). A callback may create and destroy everything, and must not wait or dispatch.
 * Errors as busd_publisher_create(). */
int busd_subscription_create(busd_node *node, const char *topic, const busd_type *type, const busd_qos *qos,
                             busd_callback *callback, void *user, busd_subscription **subscription);

/* Takes the oldest message: 1; or 0 if none waits. At most seven messages of one publisher are held without a copy.
 * Take and release them in any order. */
int busd_take(busd_subscription *subscription, busd_message *message);
void busd_release(busd_message *message);

/* 1 if busd_take() would probably find a message. */
int busd_is_ready(const busd_subscription *subscription);

/* Publishers whose messages it gets. */
int busd_subscription_matches(const busd_subscription *subscription);

void busd_subscription_destroy(busd_subscription *subscription);

/* --- services: calls with one answer */

typedef struct busd_server busd_server;
typedef struct busd_client busd_client;

/* The types of the two topics. `bus interface c PKG/srv/Type` writes it. */
typedef struct busd_service_type {
    busd_type request, reply;
} busd_service_type;

/* Names a call at its server. */
typedef struct busd_call {
    unsigned char client[16];
    uint64_t number;
} busd_call;

/* Gets each request, as encoded bytes. The server replies in the callback, or later with a copy of `call`. */
typedef void busd_serve(void *user, busd_server *server, const busd_call *call, const busd_message *request);

/* `qos` NULL: depth 1000. Errors as busd_publisher_create(). */
int busd_server_create(busd_node *node, const char *name, const busd_service_type *type, const busd_qos *qos,
                       busd_serve *serve, void *user, busd_server **server);

/* Replies to a call, once. busd_reply_error() ends the call with an error instead: the client gets the reason, with `?`
 * for bytes that are not UTF-8. -ENOENT: the call has its reply, or it has ended with an error, because 10,000 later
 * calls have no reply. */
int busd_reply(busd_server *server, const busd_call *call, const void *body, size_t size);
int busd_reply_error(busd_server *server, const busd_call *call, const char *reason);

void busd_server_destroy(busd_server *server);

/* Gets the answer to a call: status 0 and the encoded response; or a reason, and -EREMOTEIO: the server replied with an
 * error; -EPIPE: no server is left, or the request or its answer was lost; -ECANCELED: the client was destroyed. */
typedef void busd_answer(void *user, int status, const char *error, const busd_message *response);

int busd_client_create(busd_node *node, const char *name, const busd_service_type *type, const busd_qos *qos,
                       busd_client **client);

/* Sends a request. `answer` is called once, later. -EHOSTUNREACH: there is no server; while busd is away, the
 * call waits for the next one instead. -ENOBUFS: 1,000 calls of the client wait for an answer. */
int busd_client_call(busd_client *client, const void *body, size_t size, busd_answer *answer, void *user);

/* Servers that get the requests, on this bus and on others. Usually 0 or 1. */
int busd_client_servers(const busd_client *client);

void busd_client_destroy(busd_client *client);

/* --- statistics */

/* At a quiet moment, of a subscription: expected = samples + queued + replaced + expired + lost. */
typedef struct busd_stats {
    uint64_t samples, bytes; /* published; or taken */
    uint64_t replaced;       /* dropped for the depth */
    uint64_t expired;        /* older than the lifespan */
    uint64_t lost;           /* dropped for other reasons, here and in busd */
    uint64_t expected;       /* samples for this subscription since its matches began */
    uint64_t queued;         /* that wait */
    uint32_t matches, by_ring;
    uint64_t missed_deadlines;
} busd_stats;

void busd_publisher_stats(const busd_publisher *publisher, busd_stats *stats);
void busd_subscription_stats(const busd_subscription *subscription, busd_stats *stats);

/* Calls of a client, or at a server. */
typedef struct busd_service_stats {
    uint64_t requests;  /* sent; or taken */
    uint64_t responses; /* taken by their calls; or sent */
    uint64_t errors;    /* among the responses */
    uint64_t late;      /* of a client: answers to calls that have ended */
    uint32_t open;      /* calls without an answer, now */
    uint32_t matches;   /* servers of the client, or clients of the server, now */
} busd_service_stats;

void busd_client_stats(const busd_client *client, busd_service_stats *stats);
void busd_server_stats(const busd_server *server, busd_service_stats *stats);

/* --- the graph: nodes and endpoints of all programs, as far as busd's rules of access show them to this user */

typedef struct busd_graph_node {
    uint64_t id;             /* busd's number of it */
    const char *name, *ns;
    const char *full_name;
    int64_t pid;
    const char *bridge;      /* of a node that a bridge mirrors: the kind of the bridge, as "zenoh"; else NULL */
    const char *bus;         /* and the bus that the bridge took it from */
} busd_graph_node;

typedef struct busd_graph_drop {
    const char *reason;
    uint64_t count;
} busd_graph_drop;

/* Counters of an endpoint, as its process has reported them last. docs/protocol.md: "Records inside a graph". */
typedef struct busd_graph_statistics {
    uint64_t samples, bytes;      /* published; or taken */
    uint64_t queued, expected;    /* of a subscription, as the rest */
    uint64_t dropped;             /* the sum of the drops */
    const busd_graph_drop *drops; /* by reason */
    size_t drop_count;
    int64_t at_ns;                /* of samples and bytes, CLOCK_MONOTONIC; 0: not reported */
    uint64_t age_count, age_sum_ns, age_max_ns, most_missed;
    const uint64_t *age_parts;    /* the histogram of the ages */
    size_t age_part_count;
} busd_graph_statistics;

typedef struct busd_graph_endpoint {
    uint64_t id;
    const busd_graph_node *node;
    const char *topic, *type_name, *type_hash;
    unsigned char gid[16];
    busd_qos qos;
    const busd_graph_statistics *statistics; /* only if busd_graph_get() has asked for them; else NULL */
} busd_graph_endpoint;

typedef struct busd_graph_match {
    uint64_t publisher, subscription; /* their ids */
    const char *route;                /* "shm", "socket", or "bridge": the subscription is on another bus */
} busd_graph_match;

typedef struct busd_node_list {
    const busd_graph_node *const *items;
    size_t count;
} busd_node_list;

typedef struct busd_endpoint_list {
    const busd_graph_endpoint *const *items;
    size_t count;
} busd_endpoint_list;

typedef struct busd_match_list {
    const busd_graph_match *const *items;
    size_t count;
} busd_match_list;

typedef struct busd_name_list {
    const char *const *items;
    size_t count;
} busd_name_list;

typedef struct busd_graph_topic {
    const char *name;
    busd_name_list types; /* more than one is a conflict */
    busd_endpoint_list publishers, subscriptions;
} busd_graph_topic;

typedef struct busd_graph_service {
    const char *name;
    busd_name_list types;
    busd_endpoint_list servers; /* their subscriptions to requests */
    busd_endpoint_list clients; /* their publishers of requests */
} busd_graph_service;

/* A snapshot, which never changes. All lists are sorted: nodes by full name, endpoints by topic, topics and services by
 * name. Topics include those of services. */
typedef struct busd_graph {
    uint64_t revision; /* grows with every change */
    int64_t busd_pid;
    busd_node_list nodes;
    busd_endpoint_list publishers, subscriptions;
    busd_endpoint_list taps; /* subscriptions of bridges for other buses; no other list has them */
    busd_match_list matches;
    const busd_graph_topic *topics;
    size_t topic_count;
    const busd_graph_service *services;
    size_t service_count;
} busd_graph;

/* Asks busd for the graph, and waits for it. `with_statistics` 1: with the counters of endpoints. Errors: -ENOTCONN,
 * -ETIMEDOUT, -ENOMEM. Free it with busd_graph_free(). A graph may outlive the connection. */
int busd_graph_get(busd_bus *bus, int with_statistics, const busd_graph **graph);

/* NULL if no endpoint has that topic or service. */
const busd_graph_topic *busd_graph_find_topic(const busd_graph *graph, const char *name);
const busd_graph_service *busd_graph_find_service(const busd_graph *graph, const char *name);

/* Keeps the graph of a callback after it. Free it, too. */
const busd_graph *busd_graph_keep(const busd_graph *graph);
void busd_graph_free(const busd_graph *graph);

typedef struct busd_watch busd_watch;

/* Gets a graph, which is valid until the callback returns. */
typedef void busd_graph_changed(void *user, const busd_graph *graph);

/* Calls `changed` with the graph now, and again after changes, inside of busd_dispatch() and busd_wait(). Changes in
 * quick succession come as one. It continues after a restart of busd. busd sends changes only while there is a watch.
 * Errors as busd_graph_get(). */
int busd_watch_create(busd_bus *bus, busd_graph_changed *changed, void *user, busd_watch **watch);

void busd_watch_destroy(busd_watch *watch);

#pragma GCC visibility pop

#ifdef __cplusplus
}
#endif
#endif
