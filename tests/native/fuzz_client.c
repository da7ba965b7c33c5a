/* The C client with a hostile busd: any control messages, runs and bytes on the socket, in any pieces. The client stays
 * within its memory, frees it, and ends. tests/c_hostile.py has hostile memories and descriptors. */
#include "fuzz.h"

#include <fcntl.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/timerfd.h>

#define now_ns client_now_ns /* check.h has one, too */
#include "../../clients/c/src/internal.h"

enum { MOST_BYTES = 1 << 13, OF_THE_NODE = 1, OF_ENDPOINTS = 2, OF_THE_GRAPH = 9 }; /* numbers of requests */

static void meddle(void) {}

static const busd_type type = {.name = "a/msg/B", .hash = "RIHS01_0"};
static const busd_service_type service = {
    {.name = "a/srv/B_Request", .hash = "0"}, {.name = "a/srv/B_Response", .hash = "0"}};
static int other; /* busd's end of the socket */

static void send_all(const void *bytes, size_t size) { CHECK_EQ(send(other, bytes, size, MSG_DONTWAIT), size); }

static void send_frame(unsigned kind, unsigned flags, const void *body, size_t size)
{
    unsigned char frame[MOST_BYTES + 8] = {0};
    const uint32_t length = (uint32_t)size + 4;
    memcpy(frame, &length, 4);
    frame[4] = (unsigned char)kind;
    frame[5] = (unsigned char)flags;
    memcpy(frame + 8, body, size);
    send_all(frame, size + 8);
}

/* busd's answer to a request. */
static void answer(uint64_t request)
{
    static const char *const keys[] = {"id",           "depth",      "max_message_bytes", "window_samples",
                                       "window_bytes", "ring_bytes"};
    static const char *const lists[] = {"nodes", "endpoints", "matches"};
    unsigned char bytes[256];
    busd_out out = {.bytes = bytes, .room = sizeof bytes, .is_fixed = true};
    const bool is_graph = request == OF_THE_GRAPH;
    busd_put_map(&out, is_graph ? 5 : 8);
    field_text(&out, "m", is_graph ? "graph" : "created");
    field_number(&out, "request", request);
    for (size_t i = 0; i < (is_graph ? 3 : 6); i++) {
        busd_put_text(&out, is_graph ? lists[i] : keys[i], strlen(is_graph ? lists[i] : keys[i]));
        if (is_graph)
            busd_put_array(&out, 0);
        else
            busd_put_uint(&out, i == 0 ? request : 1000);
    }
    CHECK(!out.failed);
    send_frame(FRAME_CONTROL, 0, bytes, out.size);
}

static void hear(void *user, const busd_message *message) { *(size_t *)user += message->size; }

static void look(void *user, const busd_graph *graph) { *(size_t *)user += graph->topic_count; }

static void note(void *user, const busd_event *event) { *(size_t *)user += strlen(event->text); }

static void take_answer(void *user, int status, const char *error, const busd_message *response)
{
    *(size_t *)user += status == 0 ? response->size : strlen(error);
}

static void serve(void *user, busd_server *server, const busd_call *call, const busd_message *request)
{
    *(size_t *)user += request->size;
    busd_reply(server, call, "\xc0", 1);
}

/* A connection with everything that a message can be about. Publishers have the ids 2 (of the client), 3 (of the
 * server) and 4, subscriptions 5 (of the client), 6 (of the server), 7 (heard) and 8 (taken). */
static busd_bus *begin(int sock, size_t *seen, busd_publisher **publisher, busd_subscription **taken,
                       busd_client **client)
{
    const busd_qos lossless = {.depth = 10, .history = BUSD_KEEP_ALL, .deadline_ns = 1};
    busd_bus *bus = calloc(1, sizeof *bus);
    busd_node *node;
    busd_subscription *heard;
    busd_server *server;
    busd_watch *watch;
    *bus = (busd_bus){.pid = getpid(), .epoll = epoll_create1(0), .sock = sock, .bell = eventfd(0, EFD_NONBLOCK),
                      .timer = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK), .readers_fd = -1, .rounds = 1,
                      .is_open = true, .was_connected = true, .lease_ns = SECOND_NS};
    bus->control.end = &bus->control.first;
    struct epoll_event event = {.events = EPOLLIN, .data.u32 = 1};
    epoll_ctl(bus->epoll, EPOLL_CTL_ADD, sock, &event);
    busd_on_event(bus, note, seen);
    busd_create_at_once(bus, 1);
    CHECK_EQ(busd_node_create(bus, "n", NULL, &node), 0);
    CHECK_EQ(busd_publisher_create(node, "/t", &type, &lossless, publisher), 0);
    CHECK_EQ(busd_subscription_create(node, "/t", &type, &lossless, NULL, NULL, taken), 0);
    CHECK_EQ(busd_subscription_create(node, "/t", &type, NULL, hear, seen, &heard), 0);
    CHECK_EQ(busd_server_create(node, "s", &service, NULL, serve, seen, &server), 0);
    CHECK_EQ(busd_client_create(node, "s", &service, NULL, client), 0);
    answer(OF_THE_NODE);
    busd_dispatch(bus);
    for (uint64_t request = OF_ENDPOINTS; request <= OF_THE_GRAPH; request++)
        answer(request);
    CHECK_EQ(busd_watch_create(bus, look, seen, &watch), 0);
    return bus;
}

/* Sends as much of a frame as the script says. */
static void send_something(void)
{
    static unsigned char body[MOST_BYTES];
    const unsigned kind = next_byte();
    size_t size = 0, wanted = next_byte();
    wanted += (size_t)next_byte() << 8;
    if (kind % 4 == 2) { /* a run */
        const uint32_t ids[] = {next_byte() % 10, next_byte() % 10};
        const uint64_t seq = next_number(1);
        const uint32_t tail[] = {next_byte(), 0};
        memcpy(body, ids, 8);
        memcpy(body + 8, &seq, 8);
        memcpy(body + 16, tail, 8);
        size = 24;
    }
    while (goes_on() && wanted-- > 0 && size < sizeof body)
        body[size++] = (unsigned char)next_byte();
    if (kind % 4 == 3)
        send_all(body, size);
    else
        send_frame(kind % 4 == 2 ? FRAME_DATA : FRAME_CONTROL, kind >> 4, body, size);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    int pair[2];
    size_t seen = 0;
    static unsigned char drained[1 << 16];
    busd_publisher *publisher;
    busd_subscription *taken;
    busd_client *client;
    busd_message message;
    script = data;
    script_end = data + size;
    CHECK_EQ(socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair), 0);
    other = pair[1];
    fcntl(pair[0], F_SETFL, O_NONBLOCK);
    busd_bus *bus = begin(pair[0], &seen, &publisher, &taken, &client);
    while (goes_on() && busd_is_connected(bus)) {
        send_something();
        busd_dispatch(bus);
        busd_publish(publisher, "text", 4);
        busd_client_call(client, "\xc0", 1, take_answer, &seen);
        while (busd_take(taken, &message) > 0)
            busd_release(&message);
        while (recv(other, drained, sizeof drained, MSG_DONTWAIT) > 0)
            ;
    }
    close(other); /* then the end waits for nothing */
    busd_close(bus);
    return 0;
}
