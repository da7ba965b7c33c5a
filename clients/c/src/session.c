/* The connection's life, its timers, and its turn: everything that is due at one moment.
 *
 *     socket   is_open    state
 *     none     -          away: RETRY is set, unless the connection was never made
 *     some     false      waits for busd's Hello, until HELLO
 *     some     true       connected; is_leaving: busd ends, and the next frames wait for the next busd
 */
#include <fcntl.h>
#include <poll.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/timerfd.h>
#include <sys/un.h>
#include <unistd.h>

#include "internal.h"
#include "stream.h"

#define FIRST_RETRY_NS INT64_C(20000000)
#define MOST_READS 16   /* of the socket in one turn */
#define MOST_TAKES 256  /* of one subscription in one turn */

/* --- errors and events */

/* Notes the reason of a failure. Returns -code. */
int fail(busd_bus *bus, int code, const char *form, ...)
{
    va_list arguments;
    va_start(arguments, form);
    vsnprintf(bus->error, sizeof bus->error, form, arguments);
    end_whole(bus->error);
    va_end(arguments);
    return -code;
}

/* For the headers of types: a message could not be encoded. */
int fail_encoding(busd_bus *bus)
{
    return fail(bus, EINVAL, "a text, bytes or a list is longer than its type permits, or there is no memory");
}

void tell(busd_bus *bus, busd_event_kind kind, const struct endpoint *end, const char *form, ...)
{
    char text[600];
    va_list arguments;
    if (bus->event == NULL)
        return;
    va_start(arguments, form);
    vsnprintf(text, sizeof text, form, arguments);
    end_whole(text);
    va_end(arguments);
    busd_event event = {.kind = kind, .text = text, .count = kind == BUSD_DEADLINE_MISSED ? end->missed : 0};
    if (end != NULL && end->is_publisher)
        event.publisher = (busd_publisher *)(uintptr_t)end;
    else if (end != NULL)
        event.subscription = (busd_subscription *)(uintptr_t)end;
    bus->turns++;
    bus->event(bus->user, &event);
    bus->turns--;
}

const char *busd_error(const busd_bus *bus) { return bus == NULL ? "no memory" : bus->error; }

void busd_on_event(busd_bus *bus, void (*callback)(void *user, const busd_event *event), void *user)
{
    bus->event = callback;
    bus->user = user;
}

/* --- timers */

/* Sets a timer; 0: off. The descriptor fires at the earliest one; it may fire too early once. */
void set_timer(busd_bus *bus, enum timer timer, int64_t at_ns)
{
    bus->at[timer] = at_ns;
    if (at_ns == 0 || (bus->timer_at != 0 && at_ns >= bus->timer_at))
        return;
    bus->timer_at = at_ns;
    const struct itimerspec spec = {.it_value = {at_ns / SECOND_NS, at_ns % SECOND_NS}};
    timerfd_settime(bus->timer, TFD_TIMER_ABSTIME, &spec, NULL);
}

/* The longest pause between pings: a third of the shortest lease. */
static int64_t beat_ns(const busd_bus *bus)
{
    int64_t lease = bus->lease_ns;
    for (const busd_publisher *p = bus->publishers; p != NULL; p = p->next)
        if (p->end.qos.lease_ns > 0 && p->end.qos.lease_ns < lease)
            lease = p->end.qos.lease_ns;
    return (int64_t)sizes_max((uint64_t)lease / 3, LEAST_BEAT_NS);
}

/* Pings in time, after a lease was added. */
void ping_due(busd_bus *bus)
{
    const int64_t at = now_ns() + beat_ns(bus), before = bus->at[PING];
    set_timer(bus, PING, before == 0 || at < before ? at : before);
}

static void do_ping(busd_bus *bus, int64_t now)
{
    set_timer(bus, PING, now + beat_ns(bus));
    read_shrink(bus);
    if (bus->control.first == NULL) /* else that is the sign of life, once busd reads it */
        control_simple(bus, "ping", 0, NULL, NULL);
}

static int connect_once(busd_bus *bus);

static void do_retry(busd_bus *bus, int64_t now)
{
    (void)now;
    if (bus->sock < 0 && connect_once(bus) < 0)
        lose_connection(bus, NULL);
}

static void do_hello(busd_bus *bus, int64_t now)
{
    (void)now;
    if (bus->sock >= 0 && !bus->is_open)
        lose_connection(bus, "busd does not answer");
}

static void do_stale(busd_bus *bus, int64_t now)
{
    (void)now;
    for (busd_publisher *p = bus->publishers; p != NULL; p = p->next)
        matches_drop_stale(p);
    for (busd_subscription *s = bus->subscriptions; s != NULL; s = s->next)
        sources_drop_stale(s);
    services_absent(bus);
}

static void do_sweep(busd_bus *bus, int64_t now)
{
    (void)now;
    for (busd_publisher *p = bus->publishers; p != NULL; p = p->next)
        matches_sweep(p);
}

static void do_report(busd_bus *bus, int64_t now)
{
    (void)now;
    report_send(bus);
}

static void do_ack(busd_bus *bus, int64_t now)
{
    (void)now;
    for (busd_subscription *s = bus->subscriptions; s != NULL; s = s->next)
        inbox_ack(s);
}

static void do_flush(busd_bus *bus, int64_t now)
{
    (void)now;
    flush(bus);
    for (busd_publisher *p = bus->publishers; p != NULL; p = p->next)
        if (p->owes_sign)
            busd_publisher_assert_liveliness(p);
}

static void (*const due[TIMERS])(busd_bus *bus, int64_t now) = {
    [PING] = do_ping,   [REPORT] = do_report, [RETRY] = do_retry, [STALE] = do_stale,
    [SWEEP] = do_sweep, [ACK] = do_ack,       [FLUSH] = do_flush, [HELLO] = do_hello,
    [GRAPH] = graph_notify, [DEADLINE] = deadlines_check, [QUESTIONS] = services_look,
};

static void take_timers(busd_bus *bus)
{
    uint64_t count;
    const int64_t now = now_ns();
    if (read(bus->timer, &count, sizeof count) != sizeof count && now < bus->timer_at)
        return;
    bus->timer_at = 0;
    for (int i = 0; i < TIMERS; i++) {
        if (bus->at[i] == 0 || bus->at[i] > now)
            continue;
        bus->at[i] = 0;
        due[i](bus, now);
    }
    for (int i = 0; i < TIMERS; i++)
        set_timer(bus, (enum timer)i, bus->at[i]);
}

/* --- connecting */

/* How far this clock is ahead of the machine's first time namespace; 0 without time namespaces. */
static int64_t clock_offset_ns(void)
{
    FILE *file = fopen("/proc/self/timens_offsets", "re");
    char name[32];
    long long seconds, nanoseconds;
    int64_t offset_ns = 0;
    while (file != NULL && fscanf(file, "%31s %lld %lld", name, &seconds, &nanoseconds) == 3)
        if (strcmp(name, "monotonic") == 0)
            offset_ns = seconds * SECOND_NS + nanoseconds;
    if (file != NULL)
        fclose(file);
    return offset_ns;
}

static int say_hello(busd_bus *bus)
{
    static const char *const capabilities[] = {"leaving", "namesakes", "silence"};
    busd_out out;
    control_begin(&out, "hello", 5);
    field_number(&out, "version", 1);
    busd_put_text(&out, "capabilities", strlen("capabilities"));
    busd_put_array(&out, 3);
    for (int i = 0; i < 3; i++)
        busd_put_text(&out, capabilities[i], strlen(capabilities[i]));
    field_number(&out, "pid", (uint64_t)bus->pid);
    field_text(&out, "program", bus->program);
    busd_put_text(&out, "clock_ns", strlen("clock_ns"));
    busd_put_int(&out, clock_offset_ns());
    return control_send(bus, &out, NULL, 0);
}

/* Connects, and sends Hello. 0, or -errno without a socket. */
static int connect_once(busd_bus *bus)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    memcpy(address.sun_path, bus->path, sizeof address.sun_path);
    bus->sock = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (bus->sock < 0 || connect(bus->sock, (struct sockaddr *)&address, sizeof address) != 0) {
        const int code = errno;
        if (bus->sock >= 0)
            close(bus->sock);
        bus->sock = -1;
        const char *form = code == EMFILE || code == ENFILE ? "no socket for %s: %s" : "no busd at %s: %s";
        return fail(bus, code, form, bus->path, strerror(code));
    }
    struct epoll_event event = {.events = EPOLLIN, .data.u32 = WAKE_SOCKET};
    epoll_ctl(bus->epoll, EPOLL_CTL_ADD, bus->sock, &event);
    bus->watches_output = bus->is_open = bus->is_leaving = bus->is_again = false;
    set_timer(bus, RETRY, 0);
    set_timer(bus, HELLO, now_ns() + GIVE_UP_NS);
    return say_hello(bus);
}

/* Ends the connection, if there is one, and tries again later. `reason` NULL: it is in `error`. */
void lose_connection(busd_bus *bus, const char *reason)
{
    const bool was_open = bus->is_open;
    if (reason != NULL)
        fail(bus, 0, "%s", reason);
    if (bus->sock >= 0) {
        /* close() does not do it if a forked child has the socket */
        epoll_ctl(bus->epoll, EPOLL_CTL_DEL, bus->sock, NULL);
        close(bus->sock);
    }
    bus->sock = -1;
    bus->is_open = bus->is_leaving = false;
    frames_drop(bus);
    set_timer(bus, PING, 0);
    set_timer(bus, HELLO, 0);
    if (!bus->was_connected)
        return; /* busd_connect() tries again, or fails */
    const int64_t now = now_ns(), least = was_open && now - bus->opened_at > SECOND_NS ? 0 : 2 * bus->retry_ns;
    bus->retry_ns = sizes_min(sizes_max(least, FIRST_RETRY_NS), SECOND_NS); /* longer if busd cuts it off at once */
    set_timer(bus, RETRY, now + bus->retry_ns);
    if (!was_open)
        return;
    set_timer(bus, STALE, 0);
    for (busd_node *node = bus->nodes; node != NULL; node = node->next)
        node->state = node->state == REFUSED ? REFUSED : UNDECLARED;
    for (busd_publisher *p = bus->publishers; p != NULL; p = p->next) {
        endpoint_gone(&p->end);
        stream_lost(p);
    }
    for (busd_subscription *s = bus->subscriptions; s != NULL; s = s->next) {
        endpoint_gone(&s->end);
        sources_lost(s);
        reports_lost(s);
    }
    services_lost(bus);
    graph_lost(bus);
    char text[sizeof bus->error];
    memcpy(text, bus->error, sizeof text);
    tell(bus, BUSD_DISCONNECTED, NULL, "connection lost: %s", text);
}

/* Takes what the socket has. 1: more may be there; 0: no more; or -errno, and the connection is lost. */
int take_in(busd_bus *bus)
{
    for (int i = 0; i < MOST_READS; i++) {
        int status = read_more(bus);
        if (status == 0)
            return 0;
        while (status > 0 && bus->sock >= 0 && bus->in_end - bus->in_begin >= HEAD_BYTES) {
            const unsigned char *frame = bus->in + bus->in_begin;
            uint32_t length;
            memcpy(&length, frame, 4);
            const bool is_control = frame[4] == FRAME_CONTROL;
            const uint32_t least = is_control ? 4 : RUN_HEAD_BYTES - 4;
            if ((!is_control && frame[4] != FRAME_DATA) || length < least
                || length > (is_control ? MOST_CONTROL + 4 : MOST_MESSAGE + RUN_BYTES + RUN_HEAD_BYTES)) {
                status = fail(bus, EPROTO, "busd sent a frame of kind %u with %u bytes", frame[4], length);
                break;
            }
            if (bus->in_end - bus->in_begin - 4 < length)
                break;
            bus->in_begin += (size_t)length + 4;
            if (is_control) {
                status = control_take(bus, frame + HEAD_BYTES, length - 4);
            } else {
                uint32_t id;
                memcpy(&id, frame + HEAD_BYTES, 4);
                for (busd_subscription *s = bus->subscriptions; s != NULL && status > 0; s = s->next)
                    if (s->end.id == id && s->end.state == DECLARED)
                        status = inbox_run(s, frame + HEAD_BYTES, length - 4, frame[5]);
                if (status == -EPROTO)
                    fail(bus, EPROTO, "busd sent a run that is shorter than it claims");
            }
            status = status == 0 ? 1 : status;
        }
        if (bus->sock < 0)
            return -ENOTCONN;
        if (status < 0) {
            lose_connection(bus, NULL);
            return status;
        }
    }
    return 1;
}

static bool make_readers(busd_bus *bus)
{
    bus->readers = segment_make(bus, "busd-readers", readers_segment_bytes(SLOTS), &bus->readers_fd);
    if (bus->readers == NULL)
        return false;
    readers_format(bus->readers->memory, SLOTS);
    segment_seal(bus->readers_fd);
    bus->header = bus->readers->memory;
    for (; bus->free_count < SLOTS; bus->free_count++)
        bus->free_slots[bus->free_count] = bus->free_count;
    return true;
}

static bool make_descriptors(busd_bus *bus)
{
    struct epoll_event bell = {.events = EPOLLIN, .data.u32 = WAKE_BELL};
    struct epoll_event timer = {.events = EPOLLIN, .data.u32 = WAKE_TIMER};
    bus->epoll = epoll_create1(EPOLL_CLOEXEC);
    bus->bell = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    bus->timer = timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC | TFD_NONBLOCK);
    return bus->epoll >= 0 && bus->bell >= 0 && bus->timer >= 0
           && epoll_ctl(bus->epoll, EPOLL_CTL_ADD, bus->bell, &bell) == 0
           && epoll_ctl(bus->epoll, EPOLL_CTL_ADD, bus->timer, &timer) == 0;
}

/* Waits for busd's Hello. 0, -EAGAIN: try again; or another -errno. */
static int await_hello(busd_bus *bus)
{
    const int64_t until = now_ns() + GIVE_UP_NS;
    while (bus->sock >= 0 && !bus->is_open && now_ns() < until) {
        struct pollfd poller = {.fd = bus->sock, .events = POLLIN};
        poll(&poller, 1, 1000);
        const int status = take_in(bus);
        if (status < 0)
            return status == -ECONNRESET ? -EAGAIN : status;
    }
    if (bus->is_open)
        return 0;
    lose_connection(bus, "busd does not answer");
    return -ETIMEDOUT;
}

int busd_connect(busd_bus **place, const char *path, const char *program)
{
    busd_bus *bus = *place = calloc(1, sizeof *bus);
    if (bus == NULL)
        return -ENOMEM;
    *bus = (busd_bus){.pid = getpid(), .epoll = -1, .sock = -1, .bell = -1, .timer = -1, .readers_fd = -1, .rounds = 1};
    bus->control.end = &bus->control.first;
    snprintf(bus->program, sizeof bus->program, "%s", program != NULL ? program : program_invocation_short_name);
    end_whole(bus->program);
    make_utf8(bus->program);
    const int length = path == NULL ? socket_path(bus->path, sizeof bus->path)
                                    : snprintf(bus->path, sizeof bus->path, "%s", path);
    if (length < 0 || (size_t)length >= sizeof bus->path)
        return fail(bus, ENAMETOOLONG, "the path of the socket is longer than %zu bytes", sizeof bus->path - 1);
    if (!make_descriptors(bus))
        return fail(bus, errno, "no descriptors: %s", strerror(errno));
    const char *route = getenv("BUS_ROUTE");
    bus->shares = (route == NULL || strcmp(route, "socket") != 0) && make_readers(bus);
    const int64_t until = now_ns() + GIVE_UP_NS;
    int status;
    for (int pause_ms = 1;; pause_ms = pause_ms < 25 ? 2 * pause_ms : 50) {
        status = connect_once(bus);
        if (status == 0)
            status = await_hello(bus);
        if (status != -EAGAIN || now_ns() > until)
            break;
        poll(NULL, 0, pause_ms);
    }
    bus->was_connected = status == 0;
    return status;
}

int busd_fd(const busd_bus *bus) { return bus->epoll; }

/* Not after a fork in the child: the socket is the parent's. */
int busd_is_connected(const busd_bus *bus) { return bus->sock >= 0 && bus->is_open && bus->pid == getpid(); }

/* --- the turn */

static bool has_news(const busd_bus *bus)
{
    for (const busd_subscription *s = bus->subscriptions; s != NULL; s = s->next)
        if (s->callback != NULL && !s->end.is_closed && subscription_has_news(s))
            return true;
    return false;
}

/* Calls back for waiting samples. True: there are more. */
static bool deliver(busd_bus *bus)
{
    bool has_more = false;
    for (busd_subscription *s = bus->subscriptions; s != NULL; s = s->next)
        if (s->callback != NULL)
            has_more |= subscription_deliver(s, MOST_TAKES);
    return has_more;
}

/* Frees services, endpoints, nodes and watches that callbacks have closed. */
static void sweep_closed(busd_bus *bus)
{
    for (struct service **at = &bus->services, *service; (service = *at) != NULL;) {
        if (!service->is_closed) {
            at = &service->next;
            continue;
        }
        *at = service->next;
        service_free(service);
    }
    for (busd_publisher **at = &bus->publishers, *p; (p = *at) != NULL;) {
        if (is_used(bus, p->end.is_closed, p->end.state)) {
            at = &p->next;
            continue;
        }
        *at = p->next;
        publisher_free(p);
    }
    for (busd_subscription **at = &bus->subscriptions, *s; (s = *at) != NULL;) {
        if (is_used(bus, s->end.is_closed, s->end.state)) {
            at = &s->next;
            continue;
        }
        *at = s->next;
        subscription_free(s);
    }
    for (busd_node **at = &bus->nodes, *node; (node = *at) != NULL;) {
        if (is_used(bus, node->is_closed, node->state)) {
            at = &node->next;
            continue;
        }
        *at = node->next;
        free(node->name);
        free(node->ns);
        free(node);
    }
    for (busd_watch **at = &bus->watches, *watch; (watch = *at) != NULL;) {
        if (!watch->is_closed) {
            at = &watch->next;
            continue;
        }
        *at = watch->next;
        free(watch);
    }
}

void sweep_unless_in_turn(busd_bus *bus)
{
    if (bus->turns == 0 && bus->waits == 0)
        sweep_closed(bus);
}

static int take_turn(busd_bus *bus, const struct epoll_event *events, int count)
{
    bus->turns++;
    if (bus->header != NULL)
        bell_disarm(&bus->header->arrival);
    deadlines_look(bus);
    bool has_more = deliver(bus), has_timer = false; /* first, because the doorbell is the usual reason to wake up */
    for (int i = 0; i < count; i++) {
        switch (events[i].data.u32) {
        case WAKE_BELL: doorbell_clear(bus->bell); break;
        case WAKE_TIMER: has_timer = true; break;
        default:
            if (events[i].events & EPOLLOUT)
                flush(bus);
            if (bus->sock >= 0 && take_in(bus) > 0)
                has_more = true;
        }
    }
    deadlines_look(bus);
    has_more |= deliver(bus);
    if (has_timer) { /* last: a call is given up only after the answers that have come */
        take_timers(bus);
        has_more |= deliver(bus);
    }
    bus->turns--;
    sweep_unless_in_turn(bus);
    if (bus->header != NULL)
        bell_arm(&bus->header->arrival, 0); /* PAIR(sleep): before the next line looks */
    return has_more || has_news(bus);
}

static int check_turn(busd_bus *bus)
{
    if (bus->turns != 0)
        return fail(bus, EDEADLK, "a callback must not wait or dispatch");
    if (bus->pid != getpid())
        return fail(bus, EPERM, "the connection belongs to process %d, before its fork", (int)bus->pid);
    return 0;
}

int busd_dispatch(busd_bus *bus)
{
    struct epoll_event events[4];
    const int status = check_turn(bus);
    return status < 0 ? status : take_turn(bus, events, epoll_wait(bus->epoll, events, 4, 0));
}

int busd_wait(busd_bus *bus, int timeout_ms)
{
    struct epoll_event events[4];
    const int status = check_turn(bus);
    if (status < 0)
        return status;
    if (bus->header != NULL)
        bell_arm(&bus->header->arrival, 0);
    deadlines_look(bus); /* messages that have come without a turn, while a call waited for busd */
    const int count = epoll_wait(bus->epoll, events, 4, has_news(bus) ? 0 : timeout_ms);
    if (count < 0 && errno != EINTR)
        return fail(bus, errno, "epoll_wait: %s", strerror(errno));
    return count < 0 ? 0 : take_turn(bus, events, count);
}

/* --- the end */

static void send_rest(busd_bus *bus)
{
    const int64_t until = now_ns() + SECOND_NS;
    flush(bus);
    while (bus->sock >= 0 && !bus->is_leaving && now_ns() < until
           && (bus->current != NULL || bus->control.first != NULL || streams_wait(bus))) {
        struct pollfd poller = {.fd = bus->sock, .events = (short)(POLLIN | (bus->is_blocked ? POLLOUT : 0))};
        poll(&poller, 1, 10);
        flush(bus);
        if (bus->sock >= 0 && poller.revents & POLLIN)
            take_in(bus);
    }
}

void busd_close(busd_bus *bus)
{
    if (bus == NULL)
        return;
    bus->event = NULL;
    if (bus->turns != 0)
        return; /* the caller of the callback still uses it */
    if (bus->pid == getpid()) {
        send_rest(bus);
        bus->turns++; /* one sweep at the end */
        for (busd_node *node = bus->nodes; node != NULL; node = node->next)
            busd_node_destroy(node);
        send_rest(bus);
    }
    for (busd_node *node = bus->nodes; node != NULL; node = node->next)
        node->is_closed = true;
    for (struct service *service = bus->services; service != NULL; service = service->next)
        service->is_closed = true;
    for (busd_publisher *p = bus->publishers; p != NULL; p = p->next)
        p->end.is_closed = true;
    for (busd_subscription *s = bus->subscriptions; s != NULL; s = s->next)
        s->end.is_closed = true;
    for (busd_watch *watch = bus->watches; watch != NULL; watch = watch->next)
        watch->is_closed = true;
    graph_lost(bus);
    if (bus->sock >= 0)
        close(bus->sock);
    bus->sock = -1;
    frames_drop(bus);
    sweep_closed(bus);
    map_drop(bus->readers);
    const int fds[] = {bus->readers_fd, bus->epoll, bus->bell, bus->timer};
    for (int i = 0; i < 4; i++)
        if (fds[i] >= 0)
            close(fds[i]);
    free(bus->in);
    free(bus->spare);
    free(bus);
}
