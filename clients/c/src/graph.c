/* A mirror of busd's graph, and the watches that get snapshots of it.
 *
 * While there is a watch, busd sends a GraphSnapshot and then each GraphChanged. They change the mirror. The watches
 * get a snapshot of it from the timer GRAPH, so never inside of a call that waits for busd. After it they rest for a
 * multiple of the time that it took: a large graph with many changes costs little.
 */
#include <stdlib.h>

#include "internal.h"

#define REST 16
#define LONGEST_REST_NS (SECOND_NS / 5)
#define AGAIN_NS SECOND_NS /* after busd has refused to send the graph */

/* --- watches */

static bool has_watch(const busd_bus *bus)
{
    const busd_watch *watch = bus->watches;
    while (watch != NULL && watch->is_closed)
        watch = watch->next;
    return watch != NULL;
}

/* Gives a graph soon to the watches that do not have the newest one. */
static void notify_soon(busd_bus *bus)
{
    if (bus->at[GRAPH] == 0)
        set_timer(bus, GRAPH, (int64_t)sizes_max((uint64_t)now_ns(), (uint64_t)bus->graph_rest_ns));
}

static void changed(busd_bus *bus)
{
    bus->graph_changes++;
    notify_soon(bus);
}

static int observe(busd_bus *bus, uint64_t request, bool is_on)
{
    busd_out out;
    control_begin(&out, "observe", 2);
    field_number(&out, "request", request);
    field_bool(&out, "on", is_on);
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
        const int status = mirror_begin(bus, &bus->mirror, body);
        if (status < 0)
            return status;
        if (waiting != NULL)
            waiting->answer = 0;
        changed(bus);
    } else if (waiting != NULL && waiting->wants_graph && waiting->answer > 0) {
        struct mirror mirror = {0};
        int status = mirror_begin(bus, &mirror, body);
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
    const uint64_t revision = busd_find_number(body, "revision", 0);
    if (!bus->mirrors || revision <= bus->mirror.revision)
        return 0;
    const int status = mirror_change(bus, &bus->mirror, body);
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
    notify_soon(bus);
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

int busd_graph_get(busd_bus *bus, int with_statistics, const busd_graph **place)
{
    busd_out out;
    if (!busd_is_connected(bus))
        return fail(bus, ENOTCONN, "busd is away");
    struct waiting waiting = {.request = ++bus->requests, .wants_graph = true};
    control_begin(&out, "graph?", 2);
    field_number(&out, "request", waiting.request);
    field_bool(&out, "statistics", with_statistics != 0);
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
