/* A mirror of busd's graph, and the watches that get snapshots of it.
 *
 * While there is a watch, busd sends a GraphSnapshot and then each GraphChanged. They change the mirror. The watches get
 * a snapshot of it from the timer GRAPH, so never inside of a call that waits for busd. After it they rest for a multiple
 * of the time that it took: a large graph with many changes costs little.
 */
#include <stdlib.h>

#include "internal.h"

#define LEAST_ROOM 64u
#define MOST_BYTES (1u << 30) /* of all records of a mirror */
#define REST 16
#define LONGEST_REST_NS (SECOND_NS / 5)
#define AGAIN_NS SECOND_NS    /* after busd has refused to send the graph */

/* --- records */

struct record *record_of(const void *item) { return (struct record *)(uintptr_t)item - 1; }

static struct record *record_new(size_t size, size_t texts, char **text)
{
    struct record *record = calloc(1, sizeof *record + size + texts);
    if (record == NULL)
        return NULL;
    record->users = 1;
    record->bytes = sizeof *record + size + texts;
    *text = (char *)(record + 1) + size;
    return record;
}

void record_drop(struct record *record)
{
    struct record *owner = record->owner;
    if (--record->users != 0)
        return;
    free(record);
    if (owner != NULL)
        record_drop(owner);
}

static size_t bucket_of(const uint64_t key[3], size_t room)
{
    const uint64_t mixed = (key[0] * UINT64_C(0x9e3779b97f4a7c15)) ^ (key[1] * UINT64_C(0xc2b2ae3d27d4eb4f)) ^ key[2];
    return (size_t)((mixed ^ mixed >> 29) & (room - 1));
}

/* The place of the record with this key, or of the end of its bucket; NULL: the table is empty. */
static struct record **records_find(const struct records *table, const uint64_t key[3])
{
    if (table->room == 0)
        return NULL;
    struct record **at = &table->buckets[bucket_of(key, table->room)];
    while (*at != NULL && memcmp((*at)->key, key, sizeof(*at)->key) != 0)
        at = &(*at)->next;
    return at;
}

static bool records_grow(struct records *table)
{
    const size_t room = table->room == 0 ? LEAST_ROOM : 2 * table->room;
    struct record **buckets = calloc(room, sizeof *buckets);
    if (buckets == NULL)
        return false;
    for (size_t i = 0; i < table->room; i++)
        for (struct record *record = table->buckets[i], *next; record != NULL; record = next) {
            struct record **bucket = &buckets[bucket_of(record->key, room)];
            next = record->next;
            record->next = *bucket;
            *bucket = record;
        }
    free(table->buckets);
    table->buckets = buckets;
    table->room = room;
    return true;
}

static void records_remove(struct mirror *mirror, enum records_kind kind, const uint64_t key[3])
{
    struct records *table = &mirror->of[kind];
    struct record **at = records_find(table, key), *record = at == NULL ? NULL : *at;
    if (record == NULL)
        return;
    *at = record->next;
    table->count--;
    mirror->bytes -= record->bytes;
    record_drop(record);
}

/* Takes over the record; NULL: there was no memory for it. It replaces one with its key. */
static int records_add(busd_bus *bus, struct mirror *mirror, enum records_kind kind, struct record *record)
{
    struct records *table = &mirror->of[kind];
    if (record == NULL)
        return fail(bus, ENOMEM, "no memory for the graph");
    records_remove(mirror, kind, record->key);
    if (table->count == table->room && !records_grow(table)) {
        record_drop(record);
        return fail(bus, ENOMEM, "no memory for the graph");
    }
    struct record **at = records_find(table, record->key);
    *at = record;
    table->count++;
    mirror->bytes += record->bytes;
    return mirror->bytes > MOST_BYTES ? fail(bus, EPROTO, "busd's graph has more than %u bytes", MOST_BYTES) : 0;
}

static void mirror_free(struct mirror *mirror)
{
    for (int kind = RECORDS - 1; kind >= 0; kind--) {
        struct records *table = &mirror->of[kind];
        for (size_t i = 0; i < table->room; i++)
            for (struct record *record = table->buckets[i], *next; record != NULL; record = next) {
                next = record->next;
                record_drop(record);
            }
        free(table->buckets);
    }
    *mirror = (struct mirror){0};
}

/* --- records out of messages */

static bool find_text(busd_in map, const char *key, busd_text *text)
{
    busd_in value;
    *text = (busd_text){"", 0};
    if (!busd_find(map, key, &value))
        return false;
    busd_get_text_view(&value, text);
    return !value.failed;
}

static const char *put_text(char **at, busd_text text)
{
    char *copy = *at;
    memcpy(copy, text.data, text.size);
    *at += text.size + 1;
    return copy;
}

static int64_t duration_ns(busd_in qos, const char *key)
{
    const double ns = busd_find_real(qos, key, 0) * 1e9 + 0.5;
    return ns >= 1 && ns < 9.2e18 ? (int64_t)ns : 0;
}

static busd_qos take_qos(busd_in map)
{
    const bool is_manual = busd_find_is(map, "liveliness", "manual_by_topic");
    return (busd_qos){
        .depth = (uint32_t)sizes_min(busd_find_number(map, "depth", 10), UINT32_MAX),
        .history = busd_find_is(map, "history", "keep_all") ? BUSD_KEEP_ALL : BUSD_KEEP_LAST,
        .reliability = busd_find_is(map, "reliability", "best_effort") ? BUSD_BEST_EFFORT : BUSD_RELIABLE,
        .durability = busd_find_is(map, "durability", "transient_local")  ? BUSD_TRANSIENT_LOCAL
                      : busd_find_is(map, "durability", "best_available") ? BUSD_BEST_AVAILABLE
                                                                          : BUSD_VOLATILE,
        .liveliness = is_manual ? BUSD_MANUAL_BY_TOPIC : BUSD_AUTOMATIC,
        .deadline_ns = duration_ns(map, "deadline"),
        .lifespan_ns = duration_ns(map, "lifespan"),
        .lease_ns = duration_ns(map, "liveliness_lease_duration"),
    };
}

static int malformed(busd_bus *bus, const char *what) { return fail(bus, EPROTO, "busd sent a %s that can't be read", what); }

static int take_node(busd_bus *bus, struct mirror *mirror, busd_in map)
{
    busd_text name, ns, bridge, source;
    busd_in origin;
    char *at;
    if (!find_text(map, "name", &name) || !find_text(map, "namespace", &ns))
        return malformed(bus, "node");
    const bool is_mirrored = busd_find(map, "origin", &origin) && find_text(origin, "bridge", &bridge)
                             && find_text(origin, "bus", &source);
    if (!is_mirrored)
        bridge = source = (busd_text){"", 0};
    const bool is_root = ns.size == 1 && *ns.data == '/';
    const size_t texts = 2 * (name.size + ns.size) + bridge.size + source.size + 6; /* zeroes, and a slash */
    struct record *record = record_new(sizeof(busd_graph_node), texts, &at);
    if (record != NULL) {
        busd_graph_node *node = (busd_graph_node *)(record + 1);
        node->id = record->key[0] = busd_find_number(map, "id", 0);
        node->pid = (int64_t)busd_find_number(map, "pid", 0);
        node->name = put_text(&at, name);
        node->ns = put_text(&at, ns);
        node->full_name = at;
        memcpy(at, ns.data, ns.size);
        at += is_root ? 0 : ns.size;
        *at++ = '/';
        put_text(&at, name);
        if (is_mirrored) {
            node->bridge = put_text(&at, bridge);
            node->bus = put_text(&at, source);
        }
    }
    return records_add(bus, mirror, NODES, record);
}

static int take_endpoint(busd_bus *bus, struct mirror *mirror, busd_in map)
{
    busd_text topic, type_name, type_hash;
    busd_in qos;
    size_t gid_size;
    char *at;
    const unsigned char *gid = busd_find_bytes(map, "gid", &gid_size);
    if (!find_text(map, "topic", &topic) || !find_text(map, "type_name", &type_name) || !find_text(map, "type_hash", &type_hash)
        || !busd_find(map, "qos", &qos) || gid_size != 16)
        return malformed(bus, "publisher or subscription");
    const enum records_kind kind = busd_find_is(map, "kind", "publisher")      ? PUBLISHERS
                                   : busd_find_is(map, "kind", "subscription") ? SUBSCRIPTIONS
                                   : busd_find_is(map, "kind", "tap")          ? TAPS
                                                                               : RECORDS;
    if (kind == RECORDS)
        return 0; /* of a later busd */
    const uint64_t owner[3] = {busd_find_number(map, "node", 0)};
    struct record **found = records_find(&mirror->of[NODES], owner);
    if (found == NULL || *found == NULL)
        return fail(bus, EPROTO, "busd sent an endpoint of node %llu, which it never named", (unsigned long long)owner[0]);
    struct record *record = record_new(sizeof(busd_graph_endpoint), topic.size + type_name.size + type_hash.size + 3, &at);
    if (record != NULL) {
        busd_graph_endpoint *endpoint = (busd_graph_endpoint *)(record + 1);
        record->owner = *found;
        record->owner->users++;
        endpoint->node = (const busd_graph_node *)(record->owner + 1);
        endpoint->id = record->key[0] = busd_find_number(map, "id", 0);
        endpoint->topic = put_text(&at, topic);
        endpoint->type_name = put_text(&at, type_name);
        endpoint->type_hash = put_text(&at, type_hash);
        endpoint->qos = take_qos(qos);
        memcpy(endpoint->gid, gid, sizeof endpoint->gid);
    }
    return records_add(bus, mirror, kind, record);
}

/* The key of a match. It has the route: a match on a new route is added before the one on the old route is removed. */
static busd_text match_key(busd_in map, uint64_t key[3])
{
    busd_text route;
    if (!find_text(map, "route", &route))
        route = busd_text_of("socket");
    key[0] = busd_find_number(map, "publisher", 0);
    key[1] = busd_find_number(map, "subscription", 0);
    key[2] = 0;
    memcpy(&key[2], route.data, route.size < sizeof key[2] ? route.size : sizeof key[2]);
    return route;
}

static int take_match(busd_bus *bus, struct mirror *mirror, busd_in map)
{
    uint64_t key[3];
    char *at;
    const busd_text route = match_key(map, key);
    struct record *record = record_new(sizeof(busd_graph_match), route.size + 1, &at);
    if (record != NULL) {
        memcpy(record->key, key, sizeof key);
        *(busd_graph_match *)(record + 1) = (busd_graph_match){key[0], key[1], put_text(&at, route)};
    }
    return records_add(bus, mirror, MATCHES, record);
}

static int remove_match(busd_bus *bus, struct mirror *mirror, busd_in map)
{
    uint64_t key[3];
    (void)bus;
    match_key(map, key);
    records_remove(mirror, MATCHES, key);
    return 0;
}

static int remove_endpoint(busd_bus *bus, struct mirror *mirror, busd_in number)
{
    const uint64_t key[3] = {busd_get_uint(&number, UINT64_MAX)};
    (void)bus;
    for (int kind = PUBLISHERS; kind <= TAPS; kind++)
        records_remove(mirror, (enum records_kind)kind, key);
    return 0;
}

static int remove_node(busd_bus *bus, struct mirror *mirror, busd_in number)
{
    const uint64_t key[3] = {busd_get_uint(&number, UINT64_MAX)};
    (void)bus;
    records_remove(mirror, NODES, key);
    return 0;
}

struct list {
    const char *key;
    int (*take)(busd_bus *bus, struct mirror *mirror, busd_in item);
};

/* Takes each item of the lists of a message. 0, -EPROTO or -ENOMEM. */
static int take_lists(busd_bus *bus, struct mirror *mirror, busd_in body, const struct list *lists, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        busd_in item;
        if (!busd_find(body, lists[i].key, &item))
            continue;
        size_t left = busd_get_count(&item, SIZE_MAX);
        for (; left > 0 && !item.failed; left--) {
            const int status = lists[i].take(bus, mirror, item);
            if (status < 0)
                return status;
            busd_get_past(&item);
        }
        if (item.failed)
            return malformed(bus, "graph");
    }
    return 0;
}

static int take_snapshot(busd_bus *bus, struct mirror *mirror, busd_in body)
{
    static const struct list lists[] = {{"nodes", take_node}, {"endpoints", take_endpoint}, {"matches", take_match}};
    mirror->revision = busd_find_number(body, "revision", 0);
    mirror->busd_pid = (int64_t)busd_find_number(body, "pid", 0);
    return take_lists(bus, mirror, body, lists, 3);
}

/* --- watches */

static bool has_watch(const busd_bus *bus)
{
    const busd_watch *watch = bus->watches;
    while (watch != NULL && watch->is_closed)
        watch = watch->next;
    return watch != NULL;
}

static void changed(busd_bus *bus)
{
    bus->graph_changes++;
    if (bus->at[GRAPH] == 0)
        set_timer(bus, GRAPH, (int64_t)sizes_max((uint64_t)now_ns(), (uint64_t)bus->graph_rest_ns));
}

static int observe(busd_bus *bus, uint64_t request, bool is_on)
{
    busd_out out;
    control_begin(&out, "observe", 2);
    field_number(&out, "request", request);
    busd_put_text(&out, "on", 2);
    busd_put_bool(&out, is_on);
    return control_send(bus, &out, NULL, 0);
}

/* Asks busd for the graph and its changes. 0, or -errno with the reason in `error`. */
int graph_ask(busd_bus *bus)
{
    if (bus->mirrors || bus->graph_request != 0 || !has_watch(bus))
        return 0;
    bus->graph_request = ++bus->requests;
    const int status = observe(bus, bus->graph_request, true);
    if (status < 0)
        bus->graph_request = 0;
    return status;
}

/* Takes a GraphSnapshot: for the watches, for a call that waits for it, or for neither. */
int graph_take(busd_bus *bus, busd_in body)
{
    const uint64_t request = busd_find_number(body, "request", 0);
    struct waiting *waiting = waiting_for(bus, request);
    if (request != 0 && request == bus->graph_request) {
        bus->graph_request = 0;
        bus->mirrors = true;
        const int status = take_snapshot(bus, &bus->mirror, body);
        if (status < 0)
            return status;
        if (waiting != NULL)
            waiting->answer = 0;
        changed(bus);
    } else if (waiting != NULL && waiting->wants_graph && waiting->answer > 0) {
        struct mirror mirror = {0};
        int status = take_snapshot(bus, &mirror, body);
        if (status == 0 && (waiting->graph = graph_view(&mirror)) == NULL)
            status = fail(bus, ENOMEM, "no memory for the graph");
        mirror_free(&mirror);
        waiting->answer = status;
        return status == -EPROTO ? status : 0;
    }
    return 0;
}

int graph_change(busd_bus *bus, busd_in body)
{
    /* A node added and removed within one change is in both lists. */
    static const struct list lists[] = {
        {"nodes_added", take_node},           {"endpoints_added", take_endpoint},     {"matches_added", take_match},
        {"matches_removed", remove_match},    {"endpoints_removed", remove_endpoint}, {"nodes_removed", remove_node},
    };
    const uint64_t revision = busd_find_number(body, "revision", 0);
    if (!bus->mirrors || revision <= bus->mirror.revision)
        return 0;
    bus->mirror.revision = revision;
    const int status = take_lists(bus, &bus->mirror, body, lists, 6);
    if (status == 0)
        changed(bus);
    return status;
}

/* busd has refused to send the graph. It is asked again later, if there are other watches. */
void graph_refused(busd_bus *bus, bool is_told)
{
    bus->graph_request = 0;
    set_timer(bus, GRAPH, now_ns() + AGAIN_NS);
    if (is_told)
        tell(bus, BUSD_REFUSED, NULL, "the graph: %s", bus->error);
}

/* Gives the watches the newest graph. */
void graph_notify(busd_bus *bus, int64_t now)
{
    if (!bus->mirrors || !has_watch(bus)) {
        if (busd_is_connected(bus))
            graph_ask(bus);
        return;
    }
    now = now_ns();
    const busd_graph *graph = graph_view(&bus->mirror);
    const int64_t end = now_ns();
    bus->graph_rest_ns = end + (int64_t)sizes_min((uint64_t)(REST * (end - now)), LONGEST_REST_NS);
    if (graph == NULL) { /* no memory at the moment */
        set_timer(bus, GRAPH, end + LONGEST_REST_NS);
        return;
    }
    const uint64_t changes = bus->graph_changes;
    for (busd_watch *watch = bus->watches; watch != NULL; watch = watch->next) {
        if (watch->is_closed || watch->seen == changes)
            continue;
        watch->seen = changes;
        watch->changed(watch->user, graph);
    }
    busd_graph_free(graph);
}

/* The connection is lost, or the last watch has ended. */
void graph_lost(busd_bus *bus)
{
    mirror_free(&bus->mirror);
    bus->mirrors = false;
    bus->graph_request = 0;
    set_timer(bus, GRAPH, 0);
}

int busd_watch_create(busd_bus *bus, busd_graph_changed *callback, void *user, busd_watch **place)
{
    if (!busd_is_connected(bus))
        return fail(bus, ENOTCONN, "busd is away");
    busd_watch *watch = calloc(1, sizeof *watch);
    if (watch == NULL)
        return fail(bus, ENOMEM, "no memory");
    *watch = (busd_watch){.next = bus->watches, .bus = bus, .changed = callback, .user = user};
    bus->watches = watch;
    int status = graph_ask(bus);
    const uint64_t request = bus->graph_request;
    if (status == 0 && request != 0 && waiting_for(bus, request) == NULL)
        status = await(bus, &(struct waiting){.request = request});
    if (status < 0) {
        busd_watch_destroy(watch);
        return status;
    }
    changed(bus);
    *place = watch;
    return 0;
}

void busd_watch_destroy(busd_watch *watch)
{
    if (watch == NULL || watch->is_closed)
        return;
    busd_bus *bus = watch->bus;
    watch->is_closed = true;
    if (!has_watch(bus)) {
        if ((bus->mirrors || bus->graph_request != 0) && busd_is_connected(bus))
            observe(bus, 0, false);
        graph_lost(bus);
    }
    sweep_unless_in_turn(bus);
}

/* --- questions */

int busd_graph_get(busd_bus *bus, const busd_graph **place)
{
    busd_out out;
    if (!busd_is_connected(bus))
        return fail(bus, ENOTCONN, "busd is away");
    struct waiting waiting = {.request = ++bus->requests, .wants_graph = true};
    control_begin(&out, "graph?", 1);
    field_number(&out, "request", waiting.request);
    int status = control_send(bus, &out, NULL, 0);
    status = status == 0 ? await(bus, &waiting) : status;
    if (status < 0) {
        busd_graph_free(waiting.graph);
        return status;
    }
    if (waiting.graph == NULL)
        return fail(bus, EPROTO, "busd did not send a graph");
    *place = waiting.graph;
    return 0;
}
