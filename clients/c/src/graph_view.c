/* Snapshots of the mirror: sorted lists, topics and services. They share its nodes, endpoints and matches. */
#include <stddef.h>
#include <stdlib.h>

#include "internal.h"

#define REQUEST "/_request"
#define REPLY "/_reply"
#define REQUEST_TYPE "_Request"

struct view {
    busd_graph graph; /* first */
    busd_arena arena; /* of the lists */
    size_t users;
};

/* --- sorting */

static int by_number(uint64_t a, uint64_t b) { return (a > b) - (a < b); }

static int by_full_name(const void *a, const void *b)
{
    const busd_graph_node *x = *(const busd_graph_node *const *)a, *y = *(const busd_graph_node *const *)b;
    const int names = strcmp(x->full_name, y->full_name);
    return names != 0 ? names : by_number(x->id, y->id);
}

static int by_topic(const void *a, const void *b)
{
    const busd_graph_endpoint *x = *(const busd_graph_endpoint *const *)a, *y = *(const busd_graph_endpoint *const *)b;
    const int topics = strcmp(x->topic, y->topic);
    return topics != 0 ? topics : by_number(x->id, y->id);
}

static int by_ends(const void *a, const void *b)
{
    const busd_graph_match *x = *(const busd_graph_match *const *)a, *y = *(const busd_graph_match *const *)b;
    const int publishers = by_number(x->publisher, y->publisher);
    return publishers != 0 ? publishers : by_number(x->subscription, y->subscription);
}

static int by_text(const void *a, const void *b) { return strcmp(*(const char *const *)a, *(const char *const *)b); }

/* --- lists */

/* The records of a table, in order. They get one more user. */
static const void *const *list_of(busd_arena *arena, const struct records *table,
                                  int (*order)(const void *, const void *))
{
    const void **items = busd_arena_take(arena, table->count, sizeof *items);
    size_t count = 0;
    if (items == NULL)
        return NULL;
    for (size_t i = 0; i < table->room; i++)
        for (struct record *record = table->buckets[i]; record != NULL; record = record->next)
            items[count++] = record + 1;
    qsort(items, count, sizeof *items, order);
    return items;
}

/* The part of a sorted list that has this topic, from `begin` on. */
static busd_endpoint_list part_of(busd_endpoint_list list, size_t begin, const char *topic)
{
    size_t end = begin;
    while (end < list.count && strcmp(list.items[end]->topic, topic) == 0)
        end++;
    return (busd_endpoint_list){list.items == NULL ? NULL : list.items + begin, end - begin};
}

/* Sorts names, and leaves each once. */
static busd_name_list names_of(const char **names, size_t count)
{
    size_t kept = 0;
    if (names == NULL)
        return (busd_name_list){NULL, 0};
    qsort(names, count, sizeof *names, by_text);
    for (size_t i = 0; i < count; i++)
        if (kept == 0 || strcmp(names[kept - 1], names[i]) != 0)
            names[kept++] = names[i];
    return (busd_name_list){names, kept};
}

static busd_name_list types_of(busd_arena *arena, busd_endpoint_list publishers, busd_endpoint_list subscriptions)
{
    const size_t count = publishers.count + subscriptions.count;
    const char **names = busd_arena_take(arena, count, sizeof *names);
    for (size_t i = 0; i < count && names != NULL; i++)
        names[i] = i < publishers.count ? publishers.items[i]->type_name
                                        : subscriptions.items[i - publishers.count]->type_name;
    return names_of(names, count);
}

static void add_topics(struct view *view)
{
    busd_graph *graph = &view->graph;
    const busd_endpoint_list publishers = graph->publishers, subscriptions = graph->subscriptions;
    busd_graph_topic *topics = busd_arena_take(&view->arena, publishers.count + subscriptions.count, sizeof *topics);
    if (topics == NULL)
        return;
    for (size_t p = 0, s = 0; p < publishers.count || s < subscriptions.count;) {
        busd_graph_topic *topic = &topics[graph->topic_count++];
        const char *from = p < publishers.count ? publishers.items[p]->topic : NULL;
        const char *to = s < subscriptions.count ? subscriptions.items[s]->topic : NULL;
        topic->name = to == NULL || (from != NULL && strcmp(from, to) <= 0) ? from : to;
        topic->publishers = part_of(publishers, p, topic->name);
        topic->subscriptions = part_of(subscriptions, s, topic->name);
        topic->types = types_of(&view->arena, topic->publishers, topic->subscriptions);
        p += topic->publishers.count;
        s += topic->subscriptions.count;
    }
    graph->topics = topics;
}

/* --- services */

/* Bytes of a text before `end`; 0: it does not end so. */
static size_t size_before(const char *text, const char *end)
{
    const size_t size = strlen(text), tail = strlen(end);
    return size > tail && strcmp(text + size - tail, end) == 0 ? size - tail : 0;
}

/* The first `size` bytes of a text, with another end. */
static char *with_end(busd_arena *arena, const char *text, size_t size, const char *end)
{
    const size_t tail = strlen(end);
    char *copy = busd_arena_take(arena, size + tail + 1, 1);
    if (copy == NULL)
        return NULL;
    memcpy(copy, text, size);
    memcpy(copy + size, end, tail + 1);
    return copy;
}

/* Types of requests, without the end of their names. */
static busd_name_list service_types(busd_arena *arena, busd_name_list types)
{
    const char **names = busd_arena_take(arena, types.count, sizeof *names);
    for (size_t i = 0; i < types.count && names != NULL; i++) {
        const size_t size = size_before(types.items[i], REQUEST_TYPE);
        names[i] = size == 0 ? types.items[i] : with_end(arena, types.items[i], size, "");
        names = names[i] == NULL ? NULL : names;
    }
    return names_of(names, types.count);
}

static bool answers(const busd_graph_topic *replies, const busd_graph_node *node)
{
    for (size_t i = 0; replies != NULL && i < replies->publishers.count; i++)
        if (replies->publishers.items[i]->node == node)
            return true;
    return false;
}

/* Subscriptions to requests, of nodes that publish replies: not those of observers. */
static busd_endpoint_list servers_of(struct view *view, const busd_graph_topic *requests, size_t size)
{
    const busd_endpoint_list all = requests->subscriptions;
    const char *name = with_end(&view->arena, requests->name, size, REPLY);
    const busd_graph_endpoint **items = busd_arena_take(&view->arena, all.count, sizeof *items);
    busd_endpoint_list servers = {items, 0};
    if (name == NULL || items == NULL)
        return (busd_endpoint_list){NULL, 0};
    const busd_graph_topic *replies = busd_graph_find_topic(&view->graph, name);
    for (size_t i = 0; i < all.count; i++)
        if (answers(replies, all.items[i]->node))
            items[servers.count++] = all.items[i];
    return servers;
}

static void add_services(struct view *view)
{
    busd_graph *graph = &view->graph;
    size_t count = 0;
    for (size_t i = 0; i < graph->topic_count; i++)
        count += size_before(graph->topics[i].name, REQUEST) != 0;
    busd_graph_service *services = busd_arena_take(&view->arena, count, sizeof *services);
    for (size_t i = 0; i < graph->topic_count && services != NULL; i++) {
        const busd_graph_topic *topic = &graph->topics[i];
        const size_t size = size_before(topic->name, REQUEST);
        if (size == 0)
            continue;
        services[graph->service_count++] = (busd_graph_service){
            .name = with_end(&view->arena, topic->name, size, ""),
            .types = service_types(&view->arena, topic->types),
            .servers = servers_of(view, topic, size),
            .clients = topic->publishers,
        };
    }
    graph->services = services;
}

/* --- snapshots */

/* A snapshot; NULL: no memory. */
const busd_graph *graph_view(const struct mirror *mirror)
{
    struct view *view = calloc(1, sizeof *view);
    if (view == NULL)
        return NULL;
    busd_arena *arena = &view->arena;
    busd_graph *graph = &view->graph;
    const void *const *lists[RECORDS];
    for (int kind = 0; kind < RECORDS; kind++)
        lists[kind] =
            list_of(arena, &mirror->of[kind], kind == NODES ? by_full_name : kind == MATCHES ? by_ends : by_topic);
    if (arena->failed) {
        busd_arena_free(arena);
        free(view);
        return NULL;
    }
    for (int kind = 0; kind < RECORDS; kind++)
        for (size_t i = 0; i < mirror->of[kind].count; i++)
            record_of(lists[kind][i])->users++;
    view->users = 1;
    graph->revision = mirror->revision;
    graph->busd_pid = mirror->busd_pid;
    graph->nodes = (busd_node_list){(const busd_graph_node *const *)lists[NODES], mirror->of[NODES].count};
    graph->publishers =
        (busd_endpoint_list){(const busd_graph_endpoint *const *)lists[PUBLISHERS], mirror->of[PUBLISHERS].count};
    graph->subscriptions =
        (busd_endpoint_list){(const busd_graph_endpoint *const *)lists[SUBSCRIPTIONS], mirror->of[SUBSCRIPTIONS].count};
    graph->taps = (busd_endpoint_list){(const busd_graph_endpoint *const *)lists[TAPS], mirror->of[TAPS].count};
    graph->matches = (busd_match_list){(const busd_graph_match *const *)lists[MATCHES], mirror->of[MATCHES].count};
    add_topics(view);
    add_services(view);
    if (arena->failed) {
        busd_graph_free(graph);
        return NULL;
    }
    return graph;
}

const busd_graph *busd_graph_keep(const busd_graph *graph)
{
    ((struct view *)(uintptr_t)graph)->users++;
    return graph;
}

void busd_graph_free(const busd_graph *graph)
{
    struct view *view = (struct view *)(uintptr_t)graph;
    if (view == NULL || --view->users != 0)
        return;
    for (size_t i = 0; i < graph->matches.count; i++)
        record_drop(record_of(graph->matches.items[i]));
    const busd_endpoint_list lists[] = {graph->publishers, graph->subscriptions, graph->taps};
    for (size_t kind = 0; kind < 3; kind++)
        for (size_t i = 0; i < lists[kind].count; i++)
            record_drop(record_of(lists[kind].items[i]));
    for (size_t i = 0; i < graph->nodes.count; i++)
        record_drop(record_of(graph->nodes.items[i]));
    busd_arena_free(&view->arena);
    free(view);
}

/* --- look-ups */

static int by_topic_name(const void *name, const void *topic)
{
    return strcmp(name, ((const busd_graph_topic *)topic)->name);
}

static int by_service_name(const void *name, const void *service)
{
    return strcmp(name, ((const busd_graph_service *)service)->name);
}

const busd_graph_topic *busd_graph_find_topic(const busd_graph *graph, const char *name)
{
    return graph->topic_count == 0
               ? NULL
               : bsearch(name, graph->topics, graph->topic_count, sizeof *graph->topics, by_topic_name);
}

const busd_graph_service *busd_graph_find_service(const busd_graph *graph, const char *name)
{
    return graph->service_count == 0
               ? NULL
               : bsearch(name, graph->services, graph->service_count, sizeof *graph->services, by_service_name);
}
