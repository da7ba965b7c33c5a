/* The library's own types, and the functions of each file that other files call.
 *
 *     session.c        the connection's life, timers, the turn
 *     declare.c        nodes, types and endpoints become known to busd; requests and their answers
 *     control.c        control messages of busd: each goes to its handler
 *     frames.c         bytes and descriptors of the socket, both ways
 *     publisher.c      the calls of a publisher
 *     room.c           a place in its ring for a message: growth, hold, waiting
 *     matches.c        its matches and their gates
 *     stream.c         its samples by socket: a position in its ring, credit
 *     subscription.c   the calls of a subscription
 *     sources.c        its publishers, and their rings
 *     inbox.c          its samples by socket, acknowledgements
 *     services.c       servers and clients of services
 *     reports.c        counters for busd
 *     deadlines.c      missed deadlines
 *     graph.c          questions for the graph, and watches
 *     graph_mirror.c   a mirror of the graph
 *     graph_view.c     a snapshot of the mirror for the program
 *     segment.c        memory and doorbells
 *     headroom.c       how much memory may be used
 *     names.c          topics, and the path of the socket
 *
 * Every publisher has a ring. If it can share memory, readers map it. The samples by socket are read from it, too: so
 * it is the only queue, for slow sockets, for the time without busd, for histories, and for samples without credit.
 */
#ifndef BUSD_INTERNAL_H
#define BUSD_INTERNAL_H

#include <errno.h>
#include <stdbool.h>
#include <sys/types.h>
#include <time.h>

#include "busd/busd.h"
#include "busd/pack.h"
#include "busd/types.h"

/* clients/bus/shm: the core of shared memory, as the library for Python uses it */
#include "doorbell.h"
#include "eventfd.h"
#include "feed.h"
#include "gates.h"
#include "sizes.h"
#include "writer.h"

#include "prefixed.h" /* last, so that it changes only names of the library */

#define SLOTS 1020u                      /* of a process's readers' segment */
#define SECOND_NS INT64_C(1000000000)
#define GIVE_UP_NS (10 * SECOND_NS)      /* without an answer; and until an endpoint that is away counts as gone */
#define FLUSH_PAUSE_NS (SECOND_NS / 20)
#define LEAST_BEAT_NS (SECOND_NS / 100)  /* between pings */
#define FRAME_CONTROL 1u
#define FRAME_DATA 2u
#define FLAG_REPLAY 1u
#define FLAG_RESUMED 2u
#define MOST_CONTROL (256u << 20)
#define MOST_MESSAGE (1u << 30)
#define RUN_BYTES (64u << 10)            /* a run ends here */
#define HEAD_BYTES 8u
#define RUN_HEAD_BYTES 32u
#define RECORD_BYTES 12u
#define COPY_BYTES 4096u                 /* shorter payloads are copied out of a ring, longer ones pinned */
#ifndef INBOX_BYTES                      /* the tests' is smaller */
#define INBOX_BYTES (256u << 20)         /* most bytes of samples by socket that wait for a subscription */
#endif
#define MOST_LAST_SEQS 1024u             /* positions that busd takes with a subscription */
#define MOST_GONE 128u                   /* publishers that have left, and are remembered */

/* --- memory */

/* A mapping, with the number of its users. */
struct map {
    void *memory;
    size_t size;
    dev_t device;
    ino_t inode;
    size_t users;
};

/* Another process that reads our rings. */
struct process {
    struct process *next;
    struct reading_process reads;
    struct map *map;
    pid_t pid;
};

/* A record pinned by a message that the program holds. */
struct hold {
    struct seat *seat;
    unsigned pin;
    struct map *map;
};

/* A slot of our readers' segment. It is given out again when its match is over and nothing is pinned. */
struct seat {
    busd_bus *bus;
    struct reader_slot *slot;
    unsigned number, pinned;
    bool is_left;
    struct hold holds[READER_PINS];
};

/* A ring of a source. */
struct ring_of {
    struct feed_ring ring; /* first */
    struct map *map;
};

/* --- frames */

struct frame {
    struct frame *next;
    size_t size, sent;
    int fds[2];       /* copies, closed when they are sent */
    unsigned fd_count;
    unsigned char bytes[];
};

struct frame_list {
    struct frame *first, **end;
};

struct batch { /* descriptors received together */
    int fds[2];
    unsigned count;
};

enum { MOST_BATCHES = 16 };

/* --- endpoints */

enum declared { UNDECLARED, ASKED, DECLARED, REFUSED };

/* A call that waits for the answer to its request. A callback meanwhile may begin another one. */
struct waiting {
    struct waiting *outer;
    uint64_t request;
    int answer;              /* 0 or -errno, the text in `error`; 1: none yet */
    bool wants_graph;
    const busd_graph *graph; /* the answer, then */
};

struct busd_node {
    busd_node *next;
    busd_bus *bus;
    char *name, *ns;
    uint64_t id, request;
    enum declared state;
    bool is_closed;
};

/* Members that publishers and subscriptions share. */
struct endpoint {
    busd_node *node;
    char *topic;
    busd_type type;
    busd_qos qos;
    unsigned char gid[16];
    uint64_t id, request;
    enum declared state;
    bool is_publisher, is_lossless, is_dirty, is_closed;
    bool was_declared;
    uint64_t window_samples, window_bytes;
    int64_t last_ns; /* with a deadline: of the last message, or the last missed deadline; 0: none yet */
    uint64_t missed; /* deadlines */
    uint64_t round; /* of the last report, see reports.c */
};

/* A publisher's match. With a gate it is attached. */
struct match {
    struct match *next;
    unsigned char gid[16];
    uint64_t other, key, hold, depth;
    struct process *process; /* of its gate; NULL: none */
    bool is_by_ring, is_by_socket, is_lossless, is_tap, is_silent;
    bool is_bridged;         /* its subscription is on another bus, and a tap takes the samples */
    bool is_stale;           /* busd is away, or is back and has not made it again */
    bool is_over, is_lost;   /* over: its gate stays while anything is pinned. Lost: until its process ends */
    bool is_told;            /* the program got BUSD_MATCHED, and gets BUSD_UNMATCHED */
};

struct busd_publisher {
    struct endpoint end; /* first */
    busd_publisher *next;
    struct match *matches;
    uint64_t keys;
    /* room.c */
    struct ring_writer ring;
    struct map *map;
    int fd;             /* of the ring; -1: it is private */
    bool is_announced;  /* busd knows this ring */
    uint64_t ring_bytes, known, wanted, stamp_ns, loan;
    int64_t no_growth_ns;
    /* stream.c */
    uint64_t sent_seq, credit, flying_bytes, max_message_bytes;
    size_t socket_matches;
    int64_t stream_until_ns; /* after busd was away */
    bool is_streaming, is_resumed;
    bool owes_sign;          /* of life, because busd reads nothing at the moment */
    uint64_t samples, bytes, replaced;
};

enum reason { REPLACED, PUBLISHER_QUEUE, EXPIRED, MEMORY_LIMIT, TOO_LARGE, UNDECODABLE, DISCONNECTED, OTHER, REASONS };
extern const char *const reason_names[REASONS];

#define NO_NUMBER UINT64_MAX /* of a source that has left an earlier busd. 0: of a new source */

/* A publisher, as a subscription sees it. */
struct source {
    struct source *next;
    unsigned char gid[16];
    uint64_t number, lifespan_ns;
    uint64_t clock_ns;             /* lead of the publisher's clock over ours, modulo 2^64 */
    uint64_t before;               /* its number at this busd before it returned; 0: none */
    uint64_t last_seq;             /* received */
    uint64_t routed_seq;           /* after its end: up to here, busd still delivers samples, or reports their drops */
    uint64_t missed_seq;           /* missing samples up to here are counted */
    uint64_t taken_seq, acked_seq; /* by socket */
    uint64_t unacked_bytes;
    uint64_t noted;                /* in its rings, see deadlines.c */
    uint64_t first_seq;            /* at the match: its next number then */
    uint64_t history_end;          /* samples before this are history, which the depth leaves alone */
    bool is_by_ring, is_lossless, is_stale, is_gone;
    bool is_told; /* as in a match */
    bool awaits_sign;              /* it counts neither as alive nor as not alive before its first sign of life */
    uint64_t kept;                 /* the most samples of its history; 0: it has none */
    bool has_history;              /* it keeps samples, and this subscription wants them */
    bool is_back;                  /* after a lost connection, samples may come that were published meanwhile */
    bool is_complete;              /* every number that is missing by socket from now on was dropped by busd */
    /* by ring, while it has a seat */
    struct feed feed;
    struct seat *seat;
    struct map *newest;            /* of its newest ring */
    int doorbell;                  /* -1: none is needed */
};

struct sample { /* by socket, or copied out of a ring */
    struct sample *next;
    busd_bus *bus;
    struct source *source; /* NULL: it is forgotten */
    uint64_t seq, publisher;
    int64_t stamp_ns;
    size_t size, room;
    bool is_replay;
    unsigned char bytes[];
};

struct busd_subscription {
    struct endpoint end; /* first */
    busd_subscription *next;
    busd_callback *callback;
    void *user;
    uint64_t depth; /* 0: keep all */
    int64_t declared_ns;
    struct source *sources;
    struct sample *first, **last, **kept; /* the samples before `*kept` must not be lost */
    uint64_t queued, queued_bytes, queued_replays;
    uint64_t samples, bytes;
    uint64_t passed;                     /* through rings that were left */
    uint64_t received, repeated;         /* by socket from this busd */
    uint64_t away;                       /* published while busd or this process was away */
    uint64_t earlier;                    /* samples of earlier busds: received, or dropped there */
    uint64_t dropped[REASONS];           /* here, and by earlier busds */
    uint64_t dropped_by_busd[REASONS];
    /* reports.c, by socket from this busd */
    uint64_t skipped, perhaps_skipped;   /* missing numbers: busd has dropped them; perhaps */
    uint64_t resent;                     /* missing: busd has dropped them from a history, or the history lacked them */
    uint64_t ahead;                      /* drops reported on an earlier connection, whose numbers will be missing */
    uint64_t unexplained;                /* of `skipped` on the last connection, without a report */
    uint64_t told[REASONS];              /* drops that this busd has reported on earlier connections */
    uint64_t explained[REASONS];         /* drops without a report, whose numbers will be missing */
    uint64_t age_count, age_sum_ns, age_max_ns;
};

/* --- services */

/* A call: pending at its client, or open at its server. */
struct call {
    struct call *older, *newer;
    busd_call id;
    busd_answer *answer;
    void *user;
    /* of a client */
    bool is_unsure;         /* the request or the answer may be lost: the servers are asked */
    bool is_lost;           /* its servers have left */
    int64_t ask_ns;         /* the time of the next question; 0: now */
    int64_t pause_ns;       /* between the last question and the next one; 0: none yet */
    unsigned char (*denied)[16]; /* gids of the publishers of replies that do not work on it */
    size_t denied_count;
};

struct service {
    struct service *next;
    busd_node *node;
    busd_publisher *publisher;
    busd_subscription *subscription;
    struct call *oldest, *newest; /* one of the two is mostly the next one that ends */
    size_t call_count;
    uint64_t requests, responses, errors, late;
    int64_t give_up_ns; /* of a client: then calls that are lost end; 0: none is */
    bool is_client, is_closed;
};

struct busd_server {
    struct service service; /* first */
    busd_serve *serve;
    void *user;
};

struct busd_client {
    struct service service; /* first */
    uint64_t numbers;
};

/* --- the graph */

/* Before a node, an endpoint or a match, which never change. The mirror and snapshots use the same ones. */
struct record {
    struct record *next;
    struct record *owner; /* of an endpoint: its node */
    uint64_t key[3];      /* id; of a match: both ids and the route */
    size_t users, bytes;
};

/* Records by key, as lists in `room` buckets. */
struct records {
    struct record **buckets;
    size_t room, count;
};

enum records_kind { NODES, PUBLISHERS, SUBSCRIPTIONS, TAPS, MATCHES, RECORDS };

struct mirror {
    struct records of[RECORDS];
    uint64_t revision;
    int64_t busd_pid;
    size_t bytes;
};

struct busd_watch {
    busd_watch *next;
    busd_bus *bus;
    busd_graph_changed *changed;
    void *user;
    uint64_t seen; /* the change that it has got */
    bool is_closed;
};

/* --- the connection */

enum timer { PING, REPORT, RETRY, STALE, SWEEP, ACK, FLUSH, HELLO, GRAPH, DEADLINE, QUESTIONS, TIMERS };

struct busd_bus {
    pid_t pid;
    int epoll, sock, bell, timer, readers_fd;
    char path[108], program[256], error[512];
    bool is_open;    /* busd's Hello has come */
    bool is_leaving; /* busd ends: only the frame that is being sent */
    bool is_again;   /* its Fault said so */
    bool is_new_busd; /* not the one of the connection before */
    uint64_t busd_pid, busd_began_ns;
    bool was_connected, watches_output;
    bool is_blocked; /* the socket takes no more at the moment */
    int turns;       /* inside of calls that may call back */
    int waits;       /* inside of busd_publisher_wait(), which uses the publisher after the turn */
    int64_t lease_ns, at[TIMERS], timer_at, opened_at, retry_ns;
    unsigned char *in;
    size_t in_begin, in_end, in_room;
    struct batch batches[MOST_BATCHES];
    unsigned batch_count;
    struct sample *spare;   /* a released one, for the next message */
    struct frame_list control;
    struct frame *current;  /* partly sent */
    uint64_t rounds; /* of reports */
    uint64_t requests;
    bool creates_at_once;    /* functions that create do not wait */
    struct waiting *waiting; /* the innermost call that waits for an answer */
    bool shares;            /* this process may share memory */
    struct map *readers;
    struct readers_header *header;
    unsigned free_slots[SLOTS], free_first, free_count;
    struct process *processes;
    busd_node *nodes;
    busd_publisher *publishers;
    busd_subscription *subscriptions;
    struct service *services;
    bool has_deadlines;      /* of subscriptions */
    /* graph.c */
    struct mirror mirror;
    bool mirrors;            /* the mirror has begun */
    uint64_t graph_request;  /* the question for it; 0: none is on its way */
    uint64_t graph_changes;
    int64_t graph_rest_ns;   /* until then, watches get no other graph */
    busd_watch *watches;
    int64_t memory_until_ns;
    uint64_t memory_left;   /* until then, segments may take this without a check */
    void (*event)(void *user, const busd_event *event);
    void *user;
};

/* Whether a node or an endpoint must not be freed. A closed one stays until busd has answered: busd must forget it. */
static inline bool is_used(const busd_bus *bus, bool is_closed, enum declared state)
{
    return !is_closed || (state == ASKED && bus->sock >= 0);
}

static inline int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * SECOND_NS + now.tv_nsec;
}

/* session.c */
int fail(busd_bus *bus, int code, const char *form, ...) __attribute__((format(printf, 3, 4)));
int fail_encoding(busd_bus *bus);
void tell(busd_bus *bus, busd_event_kind kind, const struct endpoint *end, const char *form, ...)
    __attribute__((format(printf, 4, 5)));
void set_timer(busd_bus *bus, enum timer timer, int64_t at_ns);
void lose_connection(busd_bus *bus, const char *reason);
int take_in(busd_bus *bus);
void sweep_unless_in_turn(busd_bus *bus);
void ping_due(busd_bus *bus);

/* frames.c */
void control_begin(busd_out *out, const char *tag, unsigned fields);
void field_number(busd_out *out, const char *key, uint64_t number);
void field_bool(busd_out *out, const char *key, bool value);
void field_text(busd_out *out, const char *key, const char *text);
void field_bytes(busd_out *out, const char *key, const void *bytes, size_t size);
int control_send(busd_bus *bus, busd_out *out, const int *fds, unsigned fd_count);
void control_simple(busd_bus *bus, const char *tag, unsigned count, const char *const *keys, const uint64_t *numbers);
struct frame *frame_new(const void *bytes, size_t size);
void frame_queue(busd_bus *bus, struct frame *frame);
void frames_drop(busd_bus *bus);
void flush(busd_bus *bus);
int read_more(busd_bus *bus);
void read_shrink(busd_bus *bus);
unsigned batch_take(busd_bus *bus, unsigned claimed, int fds[2]);

/* control.c */
int control_take(busd_bus *bus, const unsigned char *bytes, size_t size);

/* declare.c */
int declare_node(busd_node *node);
int declare_endpoint(struct endpoint *end);
int declare_all(busd_bus *bus);
void answer_take(busd_bus *bus, busd_in body, bool is_created);
int await(busd_bus *bus, struct waiting *waiting);
struct waiting *waiting_for(const busd_bus *bus, uint64_t request);
void endpoint_free(struct endpoint *end);
void endpoint_gone(struct endpoint *end);

/* segment.c */
struct map *segment_make(busd_bus *bus, const char *name, uint64_t size, int *fd);
void segment_seal(int fd);
const char *segment_map(int fd, struct map **map);
bool segment_is(int fd, const struct map *map);
struct map *map_use(struct map *map);
void map_drop(struct map *map);

/* headroom.c */
bool headroom_claim(busd_bus *bus, uint64_t size, uint64_t whole);

/* names.c */
bool is_utf8(const char *text);
void make_utf8(char *text);
size_t whole_size(const char *text, size_t size);
void end_whole(char *text);
char *topic_name(const busd_node *node, const char *topic);
int socket_path(char *path, size_t size);

/* room.c */
bool room_begin(busd_publisher *publisher);
void room_set_hold(busd_publisher *publisher);
int room_reserve(busd_publisher *publisher, uint64_t size, void **place);
bool room_is_there(busd_publisher *publisher);
void room_announce(busd_publisher *publisher);
const unsigned char *room_record(const busd_publisher *publisher, uint64_t seq);
uint64_t room_since(const busd_publisher *publisher, uint64_t at_ns);
bool has_nothing_unread(const busd_bus *bus);

/* matches.c */
void publisher_matched(busd_publisher *publisher, busd_in body, busd_in qos, const unsigned char *gid);
const char *publisher_attached(busd_publisher *publisher, busd_in body, int fds[2], unsigned count);
void publisher_unmatched(busd_publisher *publisher, busd_in body);
void publisher_rerouted(busd_publisher *publisher, busd_in body);
void publisher_silence(busd_publisher *publisher, busd_in body);
void match_make_lossy(busd_publisher *publisher, struct match *match);
void matches_sweep(busd_publisher *publisher);
void matches_drop_stale(busd_publisher *publisher);
void matches_free(busd_publisher *publisher);
void ring_doorbells(busd_publisher *publisher, bool is_for_any);

/* stream.c */
bool stream_is_on(busd_publisher *publisher);
bool stream_has_room(const busd_publisher *publisher);
void stream_published(busd_publisher *publisher);
bool stream_flush(busd_publisher *publisher);
void stream_match(busd_publisher *publisher, uint64_t at_ns);
void stream_resend(busd_publisher *publisher, uint64_t at_ns, uint64_t after, uint64_t only_for);
void stream_credit(busd_publisher *publisher, uint64_t seq);
void stream_lost(busd_publisher *publisher);
uint64_t stream_next_seq(busd_publisher *publisher);

/* sources.c */
void subscription_matched(busd_subscription *sub, busd_in body, busd_in qos, const unsigned char *gid, int *fds,
                          unsigned count);
void subscription_unmatched(busd_subscription *sub, busd_in body);
void subscription_rerouted(busd_subscription *sub, uint64_t number);
void subscription_ring(busd_subscription *sub, busd_in body, const int *fds, unsigned count);
struct source *source_find(const busd_subscription *sub, uint64_t number);
uint64_t source_position(const struct source *source);
void sources_missed(busd_subscription *sub, const unsigned char *gid, uint64_t first, uint64_t last);
struct source *source_oldest(busd_subscription *sub);
void source_leave(busd_subscription *sub, struct source *source);
void source_leave_corrupt(busd_subscription *sub, struct source *source, const struct ring_reader *before);
void source_show_cursor(struct source *source);
void sources_lost(busd_subscription *sub);
void sources_drop_stale(busd_subscription *sub);
void sources_free(busd_subscription *sub);
void seat_release(struct seat *seat);

/* inbox.c */
int inbox_run(busd_subscription *sub, const unsigned char *body, size_t size, unsigned flags);
struct sample *sample_new(busd_subscription *sub, size_t size);
void sample_free(struct sample *sample);
void inbox_add(busd_subscription *sub, struct sample *sample);
struct sample *inbox_pop(busd_subscription *sub);
void inbox_taken(busd_subscription *sub, const struct sample *sample);
void inbox_forget(busd_subscription *sub, const struct source *source);
void inbox_ack(busd_subscription *sub);
void inbox_free(busd_subscription *sub);

/* subscription.c */
void subscription_free(busd_subscription *sub);
bool subscription_has_news(const busd_subscription *sub);
bool subscription_deliver(busd_subscription *sub, int most);

/* publisher.c */
void publisher_free(busd_publisher *publisher);

/* services.c */
void services_close(busd_node *node);
void services_matched(busd_publisher *publisher, bool has_come);
void services_absent(busd_bus *bus);
void services_lost(busd_bus *bus);
void services_look(busd_bus *bus, int64_t now);
void service_free(struct service *service);

/* deadlines.c */
void deadline_note(struct endpoint *end, int64_t at_ns);
void deadlines_look(busd_bus *bus);
void deadlines_check(busd_bus *bus, int64_t now);

/* graph.c */
int graph_ask(busd_bus *bus);
int graph_take(busd_bus *bus, busd_in body);
int graph_change(busd_bus *bus, busd_in body);
void graph_refused(busd_bus *bus, bool is_told);
void graph_notify(busd_bus *bus, int64_t now);
void graph_lost(busd_bus *bus);

/* graph_mirror.c */
int mirror_begin(busd_bus *bus, struct mirror *mirror, busd_in body);
int mirror_change(busd_bus *bus, struct mirror *mirror, busd_in body);
void mirror_free(struct mirror *mirror);
struct record *record_of(const void *item);
void record_drop(struct record *record);

/* graph_view.c */
const busd_graph *graph_view(const struct mirror *mirror);

/* reports.c */
void report_due(struct endpoint *end);
void report_send(busd_bus *bus);
void report_last(struct endpoint *end);
void report_dropped(busd_subscription *sub, busd_in body);
uint64_t count_absent(const busd_subscription *sub, uint64_t by_reason[REASONS]);
void count_again(busd_subscription *sub, uint64_t most);
uint64_t count_away(busd_subscription *sub, uint64_t count);
void reports_lost(busd_subscription *sub);

#endif
