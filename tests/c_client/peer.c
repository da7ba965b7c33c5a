/* The C side of tests/system/test_c_client.py: one publisher or subscription, or one of each.
 *
 *     peer talk TOPIC COUNT [option ...]     publishes "NUMBER" padded to `size`, once it has `wait` matches
 *     peer listen TOPIC [option ...]         prints "NUMBER SIZE ROUTE" of each message
 *     peer relay IN OUT [option ...]         publishes on OUT what comes on IN
 *
 * Options: keep_all, best_effort, latched, best_available, watch (the graph), create (a publisher, in the event of a
 * lost route), depth=N, size=N, wait=N, pause_ms=N, hold=N, late=N (with hold: takes nothing before N messages are
 * expected), deadline_ms=N. At its end (SIGTERM) it prints its statistics as JSON.
 */
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <time.h>

#include "std_msgs/msg/String.h"

#define MOST_HELD 16

static volatile sig_atomic_t has_ended;

static struct options {
    busd_qos qos;
    unsigned long size, wait, pause_ms, hold, late;
    int watch, create;
} options = {.qos = {.depth = 10}};

static busd_bus *bus;
static busd_node *node;
static busd_publisher *publisher;
static busd_subscription *subscription;

static void end(int number)
{
    (void)number;
    has_ended = 1;
}

static void report(void *user, const busd_event *event)
{
    (void)user;
    printf("event %d: %s\n", (int)event->kind, event->text);
    busd_publisher *more;
    if (options.create && event->kind == BUSD_ROUTE)
        printf("created: %d\n", busd_publisher_create(node, "/more", &std_msgs__msg__String__type, NULL, &more));
    fflush(stdout);
}

static int give_up(const char *where)
{
    printf("%s: %s\n", where, busd_error(bus));
    fflush(stdout);
    busd_close(bus);
    return 1;
}

static unsigned long value(const char *text) { return strtoul(strchr(text, '=') + 1, NULL, 10); }

static void take_options(char **words)
{
    for (; *words != NULL; words++) {
        const char *word = *words;
        if (strcmp(word, "keep_all") == 0)
            options.qos.history = BUSD_KEEP_ALL;
        else if (strcmp(word, "best_effort") == 0)
            options.qos.reliability = BUSD_BEST_EFFORT;
        else if (strcmp(word, "latched") == 0)
            options.qos.durability = BUSD_TRANSIENT_LOCAL;
        else if (strcmp(word, "best_available") == 0)
            options.qos.durability = BUSD_BEST_AVAILABLE;
        else if (strcmp(word, "create") == 0)
            options.create = 1;
        else if (strcmp(word, "watch") == 0)
            options.watch = 1;
        else if (strncmp(word, "depth=", 6) == 0)
            options.qos.depth = (uint32_t)value(word);
        else if (strncmp(word, "size=", 5) == 0)
            options.size = value(word);
        else if (strncmp(word, "wait=", 5) == 0)
            options.wait = value(word);
        else if (strncmp(word, "pause_ms=", 9) == 0)
            options.pause_ms = value(word);
        else if (strncmp(word, "deadline_ms=", 12) == 0)
            options.qos.deadline_ns = (int64_t)value(word) * 1000000;
        else if (strncmp(word, "late=", 5) == 0)
            options.late = value(word);
        else if (strncmp(word, "hold=", 5) == 0)
            options.hold = value(word);
        else
            abort();
    }
}

static void print_stats(const char *what, const busd_stats *s)
{
    printf("%s {\"samples\": %" PRIu64 ", \"bytes\": %" PRIu64 ", \"replaced\": %" PRIu64 ", \"expired\": %" PRIu64
           ", \"lost\": %" PRIu64 ", \"expected\": %" PRIu64 ", \"queued\": %" PRIu64
           ", \"matches\": %u, \"by_ring\": %u, \"missed\": %" PRIu64 "}\n",
           what, s->samples, s->bytes, s->replaced, s->expired, s->lost, s->expected, s->queued, s->matches, s->by_ring,
           s->missed_deadlines);
    fflush(stdout);
}

/* Reads all of it, for the sanitizers. */
static void read_graph(void *user, const busd_graph *graph)
{
    size_t *size = user;
    for (size_t i = 0; i < graph->topic_count; i++) {
        const busd_graph_topic *topic = busd_graph_find_topic(graph, graph->topics[i].name);
        for (size_t n = 0; n < topic->publishers.count; n++)
            *size += strlen(topic->publishers.items[n]->node->full_name);
        for (size_t n = 0; n < topic->types.count; n++)
            *size += strlen(topic->types.items[n]);
    }
    for (size_t i = 0; i < graph->service_count; i++)
        *size += graph->services[i].servers.count;
    for (size_t i = 0; i < graph->matches.count; i++)
        *size += strlen(graph->matches.items[i]->route);
}

/* Waits for what the bus does. -1: the end. */
static int turn(int timeout_ms)
{
    if (has_ended)
        return -1;
    return busd_wait(bus, timeout_ms) < 0 ? -1 : 0;
}

static int put_text(const char *bytes, size_t size)
{
    const std_msgs__msg__String message = {{bytes, size}};
    for (;;) {
        const int status = std_msgs__msg__String__publish(publisher, &message);
        if (status != -EAGAIN)
            return status;
        if (has_ended || busd_publisher_wait(publisher, 1000) < 0)
            return -1;
    }
}

static int talk(unsigned long count)
{
    static char text[4 << 20];
    while ((unsigned long)busd_publisher_matches(publisher) < options.wait)
        if (turn(-1) < 0)
            return 0;
    memset(text, 'x', sizeof text);
    for (unsigned long number = 0; number < count && !has_ended; number++) {
        const int digits = snprintf(text, 32, "%lu ", number);
        const size_t size = options.size > (size_t)digits ? options.size : (size_t)digits;
        text[digits] = 'x';
        if (put_text(text, size) < 0) {
            printf("publish: %s\n", busd_error(bus));
            fflush(stdout);
            break;
        }
        const struct timespec pause = {0, (long)options.pause_ms * 1000000};
        if (options.pause_ms != 0)
            nanosleep(&pause, NULL);
        if (busd_dispatch(bus) < 0)
            return -1;
    }
    const busd_graph *graph; /* busd answers after it has read all messages, of which late joiners get some */
    if (options.qos.durability == BUSD_TRANSIENT_LOCAL && busd_graph_get(bus, 0, &graph) == 0)
        busd_graph_free(graph);
    printf("published\n");
    fflush(stdout);
    while (turn(-1) == 0)
        ;
    return 0;
}

static void print(const busd_message *taken)
{
    std_msgs__msg__String message;
    if (std_msgs__msg__String__decode(taken, &message, NULL) < 0) {
        printf("undecodable\n");
        return;
    }
    size_t digits = 0;
    while (digits < message.data.size && message.data.data[digits] != ' ')
        digits++;
    size_t same = digits + 1;
    while (same < message.data.size && message.data.data[same] == 'x')
        same++;
    printf("%.*s %zu %s%s\n", (int)digits, message.data.data, message.data.size, taken->by_ring ? "shm" : "socket",
           same < message.data.size ? " broken" : "");
}

static void hear(void *user, const busd_message *taken)
{
    (void)user;
    print(taken);
    fflush(stdout);
    const struct timespec pause = {0, (long)options.pause_ms * 1000000};
    if (options.pause_ms != 0)
        nanosleep(&pause, NULL);
}

/* Holds the newest messages, and prints each when it is released. */
static int hold(void)
{
    busd_message held[MOST_HELD];
    busd_stats stats = {.expected = 0};
    size_t count = 0;
    for (; stats.expected < options.late; busd_subscription_stats(subscription, &stats))
        if (turn(100) < 0)
            return 0;
    while (turn(100) == 0) {
        busd_message taken;
        while (busd_take(subscription, &taken) == 1) {
            if (count == options.hold) {
                print(&held[0]);
                busd_release(&held[0]);
                memmove(held, held + 1, --count * sizeof *held);
            }
            held[count++] = taken;
        }
        fflush(stdout);
    }
    for (size_t i = 0; i < count; i++) {
        print(&held[i]);
        busd_release(&held[i]);
    }
    return 0;
}

static void relay(void *user, const busd_message *taken)
{
    (void)user;
    if (busd_publish(publisher, taken->data, taken->size) < 0)
        printf("publish: %s\n", busd_error(bus));
}

int main(int argc, char **argv)
{
    (void)argc;
    signal(SIGTERM, end);
    const char *role = argv[1];
    const int words = strcmp(role, "listen") == 0 ? 3 : 4;
    take_options(argv + words);
    if (busd_connect(&bus, NULL, "peer") < 0)
        return give_up("connect");
    busd_on_event(bus, report, NULL);
    if (busd_node_create(bus, "c_peer", NULL, &node) < 0)
        return give_up("node");
    const busd_type *type = &std_msgs__msg__String__type;
    const char *out = strcmp(role, "talk") == 0 ? argv[2] : strcmp(role, "relay") == 0 ? argv[3] : NULL;
    const char *in = strcmp(role, "talk") == 0 ? NULL : argv[2];
    busd_callback *callback = strcmp(role, "relay") == 0 ? relay : options.hold != 0 ? NULL : hear;
    if (out != NULL && busd_publisher_create(node, out, type, &options.qos, &publisher) < 0)
        return give_up("publisher");
    if (in != NULL && busd_subscription_create(node, in, type, &options.qos, callback, NULL, &subscription) < 0)
        return give_up("subscription");
    static size_t graph_size;
    busd_watch *watch;
    if (options.watch && busd_watch_create(bus, read_graph, &graph_size, &watch) < 0)
        return give_up("watch");
    printf("ready\n");
    fflush(stdout);
    int status = 0;
    if (in == NULL)
        status = talk(strtoul(argv[3], NULL, 10));
    else if (options.hold != 0)
        status = hold();
    else
        while (turn(-1) == 0)
            ;
    if (status < 0 || !has_ended)
        return give_up("wait");
    busd_stats stats;
    if (publisher != NULL) {
        busd_publisher_stats(publisher, &stats);
        print_stats("publisher", &stats);
    }
    if (subscription != NULL) {
        busd_subscription_stats(subscription, &stats);
        print_stats("subscription", &stats);
    }
    busd_close(bus);
    return 0;
}
