/* busd's client for C, with one node of one endpoint at each end. ring, socket: the message is put into the ring, or
   sent, straight from where it lies. The subscriber copies it out of the ring (ring) or looks at it there (viewed). */

#include "roles.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <time.h>

#include "std_msgs/msg/UInt8MultiArray.h"

typedef struct {
    busd_bus *bus;
    busd_publisher *publisher;
    busd_subscription *subscription;
    busd_message message;
} End;

static const busd_qos LOSSLESS = {.depth = 10, .history = BUSD_KEEP_ALL};

static void check(const End *end, int status, const char *what)
{
    if (status < 0)
        fail_because(what, busd_error(end->bus));
}

static busd_node *connect_node(End *end, const char *name)
{
    busd_node *node;
    check(end, busd_connect(&end->bus, NULL, name), "connect");
    check(end, busd_node_create(end->bus, name, NULL, &node), "node");
    return node;
}

static void *publish_to(const Work *work)
{
    End *end = reserve(sizeof *end);
    busd_node *node = connect_node(end, "publisher");
    const busd_type *type = &std_msgs__msg__UInt8MultiArray__type;
    check(end, busd_publisher_create(node, "bench", type, &LOSSLESS, &end->publisher), "publisher");
    while (busd_publisher_matches(end->publisher) == 0)
        check(end, busd_wait(end->bus, -1), "wait");
    busd_stats stats;
    busd_publisher_stats(end->publisher, &stats);
    bool should_share = strcmp(work->way, "socket") != 0;
    if (should_share != (stats.by_ring == 1))
        fail_because("the match is not by", work->way);
    tell_ready(stats.by_ring ? "shm" : "socket");
    return end;
}

static void *subscribe_to(const Work *work)
{
    (void)work;
    End *end = reserve(sizeof *end);
    busd_node *node = connect_node(end, "subscriber");
    const busd_type *type = &std_msgs__msg__UInt8MultiArray__type;
    check(end, busd_subscription_create(node, "bench", type, &LOSSLESS, NULL, NULL, &end->subscription),
          "subscription");
    tell_ready(NULL);
    return end;
}

static void put(void *connection, const char *bytes, size_t size)
{
    End *end = connection;
    std_msgs__msg__UInt8MultiArray message;
    std_msgs__msg__UInt8MultiArray__init(&message);
    message.data = (busd_bytes){.data = (const unsigned char *)bytes, .size = size};
    int status;
    while ((status = std_msgs__msg__UInt8MultiArray__publish(end->publisher, &message)) == -EAGAIN)
        check(end, busd_publisher_wait(end->publisher, -1), "wait for room");
    check(end, status, "publish");
}

static const char *get(void *connection)
{
    End *end = connection;
    while (busd_take(end->subscription, &end->message) == 0)
        check(end, busd_wait(end->bus, -1), "wait");
    std_msgs__msg__UInt8MultiArray message;
    busd_arena arena = {0}; /* the layout has no dimensions */
    if (std_msgs__msg__UInt8MultiArray__decode(&end->message, &message, &arena) < 0)
        fail_because("decode", "not the message's bytes");
    return (const char *)message.data.data;
}

static void done(void *connection)
{
    End *end = connection;
    busd_release(&end->message);
}

static void serve(void *connection, int64_t due_ns, int descriptor)
{
    End *end = connection;
    struct pollfd both[] = {{.fd = busd_fd(end->bus), .events = POLLIN}, {.fd = descriptor, .events = POLLIN}};
    for (;;) {
        int64_t left_ns = due_ns - now_ns();
        if (left_ns <= 0)
            return;
        struct timespec left = {.tv_sec = left_ns / SECOND, .tv_nsec = left_ns % SECOND};
        if (ppoll(both, 2, &left, NULL) < 0 && errno != EINTR)
            fail("ppoll");
        if (both[0].revents)
            while (busd_dispatch(end->bus) > 0)
                ;
        if (both[1].revents)
            return;
    }
}

const Way WAYS[] = {
    {"ring", publish_to, subscribe_to, put, get, done, serve, false},
    {"viewed", publish_to, subscribe_to, put, get, done, serve, true},
    /* Its bytes are the subscriber's own copy already. */
    {"socket", publish_to, subscribe_to, put, get, done, serve, true},
    {0},
};
