/* A publisher's matches, and the gates of those that read its ring. docs/ring.md: "Gates", "Refused routes".
 *
 *     no gate     Matched has come; `hold` keeps the samples of a lossless match
 *     a gate      Attached has come
 *     is_stale    busd was lost, or is back and has not made the match again. Its gate stays
 *     is_over     Unmatched has come, or the stale match has not been made again. Its gate stays while the reader pins
 *                 anything, or (is_lost) until its process has ended
 */
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

#include "internal.h"

/* --- other processes */

static struct process *process_find(const busd_bus *bus, int readers_fd)
{
    struct process *process = bus->processes;
    while (process != NULL && !segment_is(readers_fd, process->map))
        process = process->next;
    return process;
}

/* Maps another process's readers' segment. Keeps both descriptors' things: the doorbell itself is taken over. */
static const char *process_add(busd_bus *bus, int fds[2], pid_t pid, struct process **place)
{
    struct readers_geometry geometry;
    struct map *map;
    const char *fault = segment_map(fds[0], &map);
    if (fault == NULL && (fault = readers_check(map->memory, map->size, &geometry)) != NULL)
        map_drop(map);
    if (fault != NULL)
        return fault;
    struct process *process = calloc(1, sizeof *process);
    if (process == NULL) {
        map_drop(map);
        return "no memory";
    }
    *process = (struct process){.next = bus->processes, .map = map, .pid = pid};
    process->reads.arrival = &((struct readers_header *)map->memory)->arrival;
    process->reads.slots = readers_slots(map->memory);
    process->reads.slot_count = geometry.slot_count;
    process->reads.doorbell = fds[1];
    fds[1] = -1;
    bus->processes = process;
    *place = process;
    return NULL;
}

/* Frees a process that has no gate any more. */
static void process_drop(busd_bus *bus, struct process *process)
{
    if (process->reads.gates != 0)
        return;
    for (struct process **at = &bus->processes; *at != NULL; at = &(*at)->next) {
        if (*at != process)
            continue;
        *at = process->next;
        break;
    }
    map_drop(process->map);
    close(process->reads.doorbell);
    free(process);
}

static bool has_ended(const struct process *process)
{
    return process->pid > 0 && kill(process->pid, 0) != 0 && errno == ESRCH;
}

/* --- gates */

void ring_doorbells(busd_publisher *p, bool is_for_any) { gates_ring(&p->ring.gates, is_for_any, doorbell_ring); }

static void gate_remove(busd_publisher *p, struct match *m)
{
    struct ring_gate *gate = m->process == NULL ? NULL : gates_find(&p->ring.gates, m->key);
    if (gate != NULL)
        ring_remove_gate(&p->ring, gate);
    if (m->process != NULL)
        process_drop(p->end.node->bus, m->process);
    m->process = NULL;
}

/* Makes the gate as lossless as its match is now. */
static void gate_update(busd_publisher *p, struct match *m)
{
    struct ring_gate *gate = m->process == NULL ? NULL : gates_find(&p->ring.gates, m->key);
    if (gate != NULL)
        gate->is_lossless = m->is_lossless && !m->is_silent && !m->is_over;
    ring_gates_changed(&p->ring);
}

void match_make_lossy(busd_publisher *p, struct match *m)
{
    m->is_lossless = false;
    gate_update(p, m);
}

/* Tells of a match, once until it is over. */
static void tell_matched(busd_publisher *p, struct match *m, const char *place)
{
    if (m->is_told || m->is_tap)
        return;
    m->is_told = true;
    tell(p->end.node->bus, BUSD_MATCHED, &p->end, "%s has a subscription %s", p->end.topic, place);
}

/* Forgets matches that are over, once nothing of them is pinned or their process has ended. Then tells that they are
 * over: that may change the matches. */
void matches_sweep(busd_publisher *p)
{
    busd_bus *bus = p->end.node->bus;
    unsigned told = 0;
    for (struct match **at = &p->matches, *m; (m = *at) != NULL;) {
        if (bus->sock < 0 && m->process != NULL && has_ended(m->process))
            m->is_over = true;
        if (m->is_over && m->is_told) {
            m->is_told = false;
            told++;
        }
        const struct ring_gate *gate = m->process == NULL ? NULL : gates_find(&p->ring.gates, m->key);
        if (!m->is_over || (gate != NULL && (m->is_lost || gate_has_pins(gate)) && !has_ended(m->process))) {
            if (m->is_over)
                set_timer(bus, SWEEP, now_ns() + SECOND_NS);
            at = &m->next;
            continue;
        }
        *at = m->next;
        gate_remove(p, m);
        free(m);
        room_set_hold(p);
    }
    for (; told > 0; told--)
        tell(bus, BUSD_UNMATCHED, &p->end, "%s has lost a subscription", p->end.topic);
}

static void match_end(busd_publisher *p, struct match *m, bool is_lost)
{
    m->is_over = true;
    m->is_lost = is_lost;
    gate_update(p, m);
    p->socket_matches -= m->is_by_socket;
    m->is_by_socket = false;
}

/* Ends matches that the next busd has not made again in time. */
void matches_drop_stale(busd_publisher *p)
{
    bool has_dropped = false;
    for (struct match *m = p->matches; m != NULL; m = m->next) {
        if (!m->is_stale || m->is_over)
            continue;
        match_end(p, m, true);
        has_dropped = true;
    }
    room_set_hold(p);
    if (has_dropped)
        services_matched(p, false);
    matches_sweep(p);
}

void matches_free(busd_publisher *p)
{
    for (struct match *m; (m = p->matches) != NULL; free(m)) {
        p->matches = m->next;
        gate_remove(p, m);
    }
    gates_free(&p->ring.gates);
}

/* --- messages of busd */

static struct match *match_find(const busd_publisher *p, uint64_t other)
{
    struct match *m = p->matches;
    while (m != NULL && (m->is_over || m->is_stale || m->other != other))
        m = m->next;
    return m;
}

static struct match *match_of_gid(busd_publisher *p, const unsigned char *gid, uint64_t at_ns)
{
    struct match *m = p->matches;
    while (m != NULL && (m->is_over || memcmp(m->gid, gid, sizeof m->gid) != 0))
        m = m->next;
    if (m != NULL || (m = calloc(1, sizeof *m)) == NULL)
        return m;
    memcpy(m->gid, gid, sizeof m->gid);
    m->key = ++p->keys;
    m->hold = room_since(p, at_ns);
    m->next = p->matches;
    p->matches = m;
    return m;
}

void publisher_matched(busd_publisher *p, busd_in body, busd_in qos, const unsigned char *gid)
{
    const uint64_t at_ns = busd_find_number(body, "at_ns", 0);
    const bool keeps_all = busd_find_is(qos, "history", "keep_all");
    struct match *m = match_of_gid(p, gid, at_ns);
    if (m == NULL)
        return;
    m->other = busd_find_number(body, "other", 0);
    m->is_stale = false;
    m->is_tap = busd_find_number(body, "is_tap", 0) != 0;
    m->is_by_ring = busd_find_is(body, "route", "shm") && p->fd >= 0;
    m->is_bridged = busd_find_is(body, "route", "bridge");
    m->is_by_socket = !m->is_by_ring && !m->is_bridged;
    m->depth = keeps_all ? 0 : busd_find_number(qos, "depth", 10);
    m->is_silent = false;
    m->is_lossless = m->is_by_ring && keeps_all && !busd_find_is(qos, "reliability", "best_effort");
    if (!m->is_by_ring)
        gate_remove(p, m);
    gate_update(p, m);
    if (m->is_by_socket) {
        p->socket_matches++;
        stream_match(p, at_ns);
    }
    room_set_hold(p);
    if (m->is_by_ring || m->is_tap) /* by ring, it begins to work with Attached; a tap is no server */
        return;
    tell_matched(p, m, m->is_bridged ? "on another bus" : "by socket");
    services_matched(p, true);
}

/* Returns the fault because of which the match can't share memory; NULL: it has a gate. */
const char *publisher_attached(busd_publisher *p, busd_in body, int fds[2], unsigned count)
{
    busd_bus *bus = p->end.node->bus;
    struct match *m = match_find(p, busd_find_number(body, "subscription", 0));
    if (m == NULL || !m->is_by_ring)
        return NULL;
    if (count != 2)
        return "descriptors are missing";
    struct process *process = process_find(bus, fds[0]);
    if (process == NULL) {
        const char *fault = process_add(bus, fds, (pid_t)busd_find_number(body, "pid", 0), &process);
        if (fault != NULL)
            return fault;
    }
    const uint64_t slot = busd_find_number(body, "slot", UINT64_MAX);
    const char *fault = slot >= process->reads.slot_count ? "slot is out of bounds" : NULL;
    if (fault == NULL && !ring_add_gate(&p->ring, m->key, &process->reads, slot, m->is_lossless && !m->is_silent))
        fault = "no memory";
    if (fault != NULL) {
        process_drop(bus, process);
        return fault;
    }
    struct process *before = m->process;
    m->process = process;
    if (before != NULL && before != process)
        process_drop(bus, before);
    room_set_hold(p);
    ring_doorbells(p, true);
    if (m->is_tap)
        return NULL; /* it is no server */
    tell_matched(p, m, "by shared memory");
    services_matched(p, true);
    return NULL;
}

void publisher_unmatched(busd_publisher *p, busd_in body)
{
    struct match *m = match_find(p, busd_find_number(body, "other", 0));
    if (m == NULL)
        return;
    match_end(p, m, busd_find_number(body, "lost", 0) != 0);
    room_set_hold(p);
    services_matched(p, false);
    matches_sweep(p);
}

/* The subscription has left the ring, and gets everything else by socket. */
void publisher_rerouted(busd_publisher *p, busd_in body)
{
    struct match *m = match_find(p, busd_find_number(body, "other", 0));
    if (m == NULL || !m->is_by_ring)
        return;
    m->is_by_ring = m->is_lossless = false;
    m->is_by_socket = true;
    gate_remove(p, m);
    ring_gates_changed(&p->ring);
    stream_resend(p, busd_find_number(body, "at_ns", 0), busd_find_number(body, "last_seq", 0), m->other);
    p->socket_matches++; /* before the connection can be lost, which sets it to 0 */
    control_simple(p->end.node->bus, "caught", 2, (const char *const[]){"publisher", "subscription"},
                   (const uint64_t[]){p->end.id, m->other});
    if (p->end.state != DECLARED)
        return;
    stream_match(p, (uint64_t)now_ns());
    room_set_hold(p);
    tell(p->end.node->bus, BUSD_ROUTE, &p->end, "%s: a subscription uses the socket now", p->end.topic);
}

/* Don't wait for a silent subscription; or wait again. */
void publisher_silence(busd_publisher *p, busd_in body)
{
    struct match *m = match_find(p, busd_find_number(body, "subscription", 0));
    if (m == NULL)
        return;
    m->is_silent = busd_find_number(body, "is_over", 0) == 0;
    gate_update(p, m);
    room_set_hold(p);
}
