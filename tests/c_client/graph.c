/* The C side of tests/system/test_c_client_graph.py: prints graphs, each as JSON in one line.
 *
 *     graph get      the graph now
 *     graph counted  the same with statistics
 *     graph watch    each graph of a watch, until SIGTERM
 *     graph story    watches that begin and end in callbacks
 */
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <busd/busd.h>

static volatile sig_atomic_t has_ended;
static busd_bus *bus;

static void end(int number)
{
    (void)number;
    has_ended = 1;
}

static void need(int status)
{
    if (status >= 0)
        return;
    printf("failed %d: %s\n", status, busd_error(bus));
    fflush(stdout);
    exit(1);
}

static void print_text(const char *text) { text == NULL ? printf("null") : printf("\"%s\"", text); }

static void print_names(busd_name_list names)
{
    printf("[");
    for (size_t i = 0; i < names.count; i++)
        printf("%s\"%s\"", i == 0 ? "" : ", ", names.items[i]);
    printf("]");
}

static void print_ids(busd_endpoint_list list)
{
    printf("[");
    for (size_t i = 0; i < list.count; i++)
        printf("%s%" PRIu64, i == 0 ? "" : ", ", list.items[i]->id);
    printf("]");
}

static void print_nodes(busd_node_list nodes)
{
    printf("\"nodes\": [");
    for (size_t i = 0; i < nodes.count; i++) {
        const busd_graph_node *node = nodes.items[i];
        printf("%s[%" PRIu64 ", \"%s\", \"%s\", \"%s\", %" PRId64 ", ", i == 0 ? "" : ", ", node->id, node->full_name,
               node->name, node->ns, node->pid);
        print_text(node->bridge);
        printf(", ");
        print_text(node->bus);
        printf("]");
    }
    printf("]");
}

static void print_statistics(const busd_graph_statistics *s)
{
    printf(", [%" PRIu64 ", %" PRIu64 ", %" PRIu64 ", %" PRIu64 ", %" PRIu64 ", {", s->samples, s->bytes, s->queued,
           s->expected, s->dropped);
    for (size_t i = 0; i < s->drop_count; i++)
        printf("%s\"%s\": %" PRIu64, i == 0 ? "" : ", ", s->drops[i].reason, s->drops[i].count);
    printf("}, %" PRId64 ", %" PRIu64 ", %" PRIu64 ", %" PRIu64 ", %" PRIu64 ", [", s->at_ns, s->age_count,
           s->age_sum_ns, s->age_max_ns, s->most_missed);
    for (size_t i = 0; i < s->age_part_count; i++)
        printf("%s%" PRIu64, i == 0 ? "" : ", ", s->age_parts[i]);
    printf("]]");
}

static void print_endpoints(const char *name, busd_endpoint_list list)
{
    printf(", \"%s\": [", name);
    for (size_t i = 0; i < list.count; i++) {
        const busd_graph_endpoint *one = list.items[i];
        printf("%s[%" PRIu64 ", %" PRIu64 ", \"%s\", \"%s\", \"%s\", \"", i == 0 ? "" : ", ", one->id, one->node->id,
               one->topic, one->type_name, one->type_hash);
        for (size_t byte = 0; byte < sizeof one->gid; byte++)
            printf("%02x", one->gid[byte]);
        printf("\", [%" PRIu32 ", %d, %d, %d, %d, %" PRId64 ", %" PRId64 ", %" PRId64 "]", one->qos.depth,
               one->qos.history, one->qos.reliability, one->qos.durability, one->qos.liveliness, one->qos.deadline_ns,
               one->qos.lifespan_ns, one->qos.lease_ns);
        if (one->statistics != NULL)
            print_statistics(one->statistics);
        printf("]");
    }
    printf("]");
}

static void print_graph(const busd_graph *graph)
{
    printf("{\"revision\": %" PRIu64 ", \"busd_pid\": %" PRId64 ", ", graph->revision, graph->busd_pid);
    print_nodes(graph->nodes);
    print_endpoints("publishers", graph->publishers);
    print_endpoints("subscriptions", graph->subscriptions);
    print_endpoints("taps", graph->taps);
    printf(", \"matches\": [");
    for (size_t i = 0; i < graph->matches.count; i++) {
        const busd_graph_match *match = graph->matches.items[i];
        printf("%s[%" PRIu64 ", %" PRIu64 ", \"%s\"]", i == 0 ? "" : ", ", match->publisher, match->subscription,
               match->route);
    }
    printf("], \"topics\": {");
    for (size_t i = 0; i < graph->topic_count; i++) {
        const busd_graph_topic *topic = busd_graph_find_topic(graph, graph->topics[i].name);
        printf("%s\"%s\": [", i == 0 ? "" : ", ", topic->name);
        print_names(topic->types);
        printf(", ");
        print_ids(topic->publishers);
        printf(", ");
        print_ids(topic->subscriptions);
        printf("]");
    }
    printf("}, \"services\": {");
    for (size_t i = 0; i < graph->service_count; i++) {
        const busd_graph_service *service = busd_graph_find_service(graph, graph->services[i].name);
        printf("%s\"%s\": [", i == 0 ? "" : ", ", service->name);
        print_names(service->types);
        printf(", ");
        print_ids(service->servers);
        printf(", ");
        print_ids(service->clients);
        printf("]");
    }
    printf("}}\n");
    fflush(stdout);
}

static void print_change(void *user, const busd_graph *graph)
{
    (void)user;
    print_graph(graph);
}

static void get(int with_statistics)
{
    const busd_graph *graph;
    need(busd_graph_get(bus, with_statistics, &graph));
    print_graph(graph);
    busd_graph_free(graph);
}

static void watch(void)
{
    busd_watch *one;
    need(busd_watch_create(bus, print_change, NULL, &one));
    while (!has_ended)
        need(busd_wait(bus, -1));
    busd_watch_destroy(one);
}

/* --- watches that begin and end in callbacks */

static const busd_graph *kept;
static busd_watch *first, *second;
static int calls_of_first, calls_of_second;

static void hear_second(void *user, const busd_graph *graph)
{
    const busd_graph *now;
    (void)user;
    calls_of_second++;
    need(busd_graph_get(bus, 0, &now));
    printf("second: %d\n", now->revision == graph->revision);
    busd_graph_free(now);
    printf("wait in a callback: %d\n", busd_wait(bus, 0) < 0);
    busd_watch_destroy(first);
    busd_watch_destroy(second);
    busd_watch_destroy(second);
}

static void hear_first(void *user, const busd_graph *graph)
{
    (void)user;
    if (calls_of_first++ == 0) {
        kept = busd_graph_keep(graph);
        need(busd_watch_create(bus, hear_second, NULL, &second));
    }
}

static void count(void *user, const busd_graph *graph)
{
    (void)graph;
    ++*(int *)user;
}

static void story(void)
{
    busd_node *node;
    busd_watch *one, *other;
    int calls_of_one = 0, calls_of_other = 0;
    need(busd_watch_create(bus, hear_first, NULL, &first));
    while (calls_of_second == 0)
        need(busd_wait(bus, -1));
    printf("calls %d and %d\n", calls_of_first, calls_of_second);
    need(busd_node_create(bus, "late", NULL, &node));
    need(busd_wait(bus, 0)); /* no watch is left */
    need(busd_watch_create(bus, hear_first, NULL, &first));
    while (calls_of_first < 2)
        need(busd_wait(bus, -1));
    need(busd_watch_create(bus, count, &calls_of_one, &one));
    while (calls_of_one == 0)
        need(busd_wait(bus, -1));
    need(busd_watch_create(bus, count, &calls_of_other, &other)); /* it alone needs the graph */
    while (calls_of_other == 0)
        need(busd_wait(bus, -1));
    printf("calls %d and %d\n", calls_of_one, calls_of_other);
    printf("kept %zu nodes\n", kept->nodes.count);
    busd_close(bus);
    printf("topic %d, service %d\n", busd_graph_find_topic(kept, "/none") != NULL,
           busd_graph_find_service(kept, "/none") != NULL);
    busd_graph_free(kept);
}

int main(int argc, char **argv)
{
    const char *role = argc > 1 ? argv[1] : "";
    signal(SIGTERM, end);
    need(busd_connect(&bus, NULL, "graph"));
    if (strcmp(role, "story") == 0) {
        story();
        return 0;
    }
    if (strcmp(role, "get") == 0 || strcmp(role, "counted") == 0)
        get(strcmp(role, "counted") == 0);
    else
        watch();
    busd_close(bus);
    return 0;
}
