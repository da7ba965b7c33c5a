/* The mirror of the graph: records of nodes, endpoints and matches, made from messages of busd. */
#include <stdlib.h>

#include "internal.h"

#define LEAST_ROOM 64u
#define MOST_BYTES (1u << 30) /* of all records of a mirror */

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

void mirror_free(struct mirror *mirror)
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

/* --- statistics */

struct parts {
    size_t drops, reason_bytes, ages;
};

/* The next reason of a map of drops, and its count. */
static bool take_drop(busd_in *in, busd_text *reason, uint64_t *count)
{
    busd_get_text_view(in, reason);
    *count = busd_get_uint(in, UINT64_MAX);
    return !in->failed;
}

static bool count_parts(busd_in map, struct parts *parts)
{
    busd_in in;
    busd_item head;
    if (busd_find(map, "dropped", &in)) {
        if (!busd_get_item(&in, &head) || head.kind != BUSD_MAP)
            return false;
        for (uint64_t left = head.number; left > 0; left--) {
            busd_text reason;
            uint64_t count;
            if (!take_drop(&in, &reason, &count))
                return false;
            parts->drops++;
            parts->reason_bytes += reason.size + 1;
        }
    }
    if (busd_find(map, "age_parts", &in)) {
        parts->ages = busd_get_count(&in, SIZE_MAX);
        return !in.failed;
    }
    return true;
}

static size_t parts_size(const struct parts *parts)
{
    return sizeof(busd_graph_statistics) + parts->drops * sizeof(busd_graph_drop) + parts->ages * sizeof(uint64_t);
}

static const char *put_text(char **at, busd_text text)
{
    char *copy = *at;
    memcpy(copy, text.data, text.size);
    *at += text.size + 1;
    return copy;
}

/* Fills the place of counted parts. Texts go to `at`. */
static void put_statistics(busd_in map, const struct parts *parts, busd_graph_statistics *to, char **at)
{
    busd_graph_drop *drops = (busd_graph_drop *)(to + 1);
    uint64_t *ages = (uint64_t *)(drops + parts->drops);
    busd_in in;
    busd_item head;
    *to = (busd_graph_statistics){
        .samples = busd_find_number(map, "samples", 0),
        .bytes = busd_find_number(map, "bytes", 0),
        .queued = busd_find_number(map, "queued", 0),
        .expected = busd_find_number(map, "expected", 0),
        .drops = drops,
        .drop_count = parts->drops,
        .at_ns = (int64_t)busd_find_number(map, "at_ns", 0),
        .age_count = busd_find_number(map, "age_count", 0),
        .age_sum_ns = busd_find_number(map, "age_sum_ns", 0),
        .age_max_ns = busd_find_number(map, "age_max_ns", 0),
        .most_missed = busd_find_number(map, "most_missed", 0),
        .age_parts = ages,
        .age_part_count = parts->ages,
    };
    if (parts->drops != 0 && busd_find(map, "dropped", &in) && busd_get_item(&in, &head))
        for (size_t i = 0; i < parts->drops; i++) {
            busd_text reason;
            take_drop(&in, &reason, &drops[i].count);
            drops[i].reason = put_text(at, reason);
            to->dropped += drops[i].count;
        }
    if (parts->ages != 0 && busd_find(map, "age_parts", &in) && busd_get_item(&in, &head))
        for (size_t i = 0; i < parts->ages; i++)
            ages[i] = busd_get_uint(&in, UINT64_MAX);
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

static int malformed(busd_bus *bus, const char *what)
{
    return fail(bus, EPROTO, "busd sent a %s that can't be read", what);
}

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
    busd_in qos, statistics, look;
    busd_item head;
    struct parts parts = {0};
    size_t gid_size;
    char *at;
    const unsigned char *gid = busd_find_bytes(map, "gid", &gid_size);
    if (!find_text(map, "topic", &topic) || !find_text(map, "type_name", &type_name)
        || !find_text(map, "type_hash", &type_hash) || !busd_find(map, "qos", &qos) || gid_size != 16)
        return malformed(bus, "publisher or subscription");
    const bool has_statistics = busd_find(map, "statistics", &statistics)
                                && (look = statistics, busd_get_item(&look, &head)) && head.kind == BUSD_MAP;
    if (has_statistics && !count_parts(statistics, &parts))
        return malformed(bus, "statistics");
    const enum records_kind kind = busd_find_is(map, "kind", "publisher")      ? PUBLISHERS
                                   : busd_find_is(map, "kind", "subscription") ? SUBSCRIPTIONS
                                   : busd_find_is(map, "kind", "tap")          ? TAPS
                                                                               : RECORDS;
    if (kind == RECORDS)
        return 0; /* of a later busd */
    const uint64_t owner[3] = {busd_find_number(map, "node", 0)};
    struct record **found = records_find(&mirror->of[NODES], owner);
    if (found == NULL || *found == NULL)
        return fail(bus, EPROTO, "busd sent an endpoint of node %llu, which it never named",
                    (unsigned long long)owner[0]);
    const size_t size = sizeof(busd_graph_endpoint) + (has_statistics ? parts_size(&parts) : 0);
    const size_t texts = topic.size + type_name.size + type_hash.size + 3 + parts.reason_bytes;
    struct record *record = record_new(size, texts, &at);
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
        if (has_statistics) {
            busd_graph_statistics *place = (busd_graph_statistics *)(endpoint + 1);
            put_statistics(statistics, &parts, place, &at);
            endpoint->statistics = place;
        }
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

/* Fills an empty mirror from a GraphSnapshot. 0, or -errno with the reason in `error`. */
int mirror_begin(busd_bus *bus, struct mirror *mirror, busd_in body)
{
    static const struct list lists[] = {{"nodes", take_node}, {"endpoints", take_endpoint}, {"matches", take_match}};
    mirror->revision = busd_find_number(body, "revision", 0);
    mirror->busd_pid = (int64_t)busd_find_number(body, "pid", 0);
    return take_lists(bus, mirror, body, lists, 3);
}

/* Changes it by a GraphChanged. */
int mirror_change(busd_bus *bus, struct mirror *mirror, busd_in body)
{
    /* A node added and removed within one change is in both lists. */
    static const struct list lists[] = {
        {"nodes_added", take_node},           {"endpoints_added", take_endpoint},     {"matches_added", take_match},
        {"matches_removed", remove_match},    {"endpoints_removed", remove_endpoint}, {"nodes_removed", remove_node},
    };
    mirror->revision = busd_find_number(body, "revision", 0);
    return take_lists(bus, mirror, body, lists, 6);
}
