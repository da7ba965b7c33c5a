/* The C side of tests/system/test_c_client_callbacks.py: callbacks that destroy, create and close; bad names. One
 * process is both ends. Prints what has happened; the sanitizers report the rest.
 *
 *     callbacks own|wait|idle|calls|many|node|close|late|kept|fork|create|names|slots|ping|warm|poll|alive   run to
 *                                                  their end
 *     callbacks away                               waits for busd's end; a forked child has the socket, too
 *     callbacks again                              creates a publisher when it is connected again
 *     callbacks phantom                            waits for room of a publisher until it is killed
 *     callbacks grow                               makes large rings until there is no memory
 *     callbacks at_once                            creates while busd is away, and is heard by the next busd
 *     callbacks reply|call                         wait for SIGUSR1 after busd's end, and find it by a reply or call
 */
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "example_interfaces/srv/AddTwoInts.h"
#include "std_msgs/msg/String.h"

#define WAIT_MS 10000

static busd_bus *bus;
static busd_node *node;
static busd_publisher *publisher;
static busd_subscription *subscription;
static busd_client *client;
static int heard;

static void need(int status)
{
    if (status >= 0)
        return;
    printf("failed: %s\n", busd_error(bus));
    exit(1);
}

static void publish(busd_publisher *to, const char *text)
{
    const std_msgs__msg__String message = {.data = busd_text_of(text)};
    need(std_msgs__msg__String__publish(to, &message));
}

static void make(const char *topic, const busd_qos *qos, busd_callback *callback)
{
    need(busd_subscription_create(node, topic, &std_msgs__msg__String__type, qos, callback, NULL, &subscription));
    need(busd_publisher_create(node, topic, &std_msgs__msg__String__type, qos, &publisher));
    while (busd_publisher_matches(publisher) == 0 || busd_subscription_matches(subscription) == 0)
        need(busd_wait(bus, WAIT_MS));
}

static void wait_for_callback(void)
{
    while (!heard)
        need(busd_wait(bus, WAIT_MS));
}

static void destroy_all(void *user, const busd_message *message)
{
    (void)user;
    heard++;
    busd_subscription_destroy(subscription);
    busd_publisher_destroy(publisher);
    busd_node_destroy(node);
    busd_node_destroy(node);
    printf("size %zu, first byte %d\n", message->size, *(const unsigned char *)message->data);
}

static void own(void)
{
    make("/t", &BUSD_QOS_DEFAULT, destroy_all);
    publish(publisher, "one");
    publish(publisher, "two");
    wait_for_callback();
    need(busd_wait(bus, 0));
    printf("heard %d\n", heard);
}

static busd_publisher *full;

static void destroy_full(void *user, const busd_message *message)
{
    (void)user;
    (void)message;
    heard++;
    busd_publisher_destroy(full);
}

static void fill(void)
{
    static char text[100001];
    memset(text, 'x', sizeof text - 1);
    const std_msgs__msg__String message = {.data = busd_text_of(text)};
    make("/full", &BUSD_QOS_LOSSLESS, NULL);
    full = publisher;
    int status;
    do { /* what busd has just sent may make room */
        status = std_msgs__msg__String__publish(full, &message);
        need(busd_dispatch(bus));
    } while (status == 0 || busd_publisher_wait(full, 100) > 0);
    printf("full: %d\n", status == -EAGAIN);
}

static void destroy_subscription(void *user, const busd_message *message)
{
    (void)user;
    (void)message;
    heard++;
    busd_subscription_destroy(subscription);
}

/* The destroyed subscription has a message that waits. It must not keep the publisher's wait awake. */
static void wait_idly(void)
{
    fill();
    make("/t", &BUSD_QOS_DEFAULT, destroy_subscription);
    publish(publisher, "one");
    publish(publisher, "two");
    const clock_t begin = clock();
    need(busd_publisher_wait(full, 1000));
    printf("idle: %d\n", clock() - begin < CLOCKS_PER_SEC / 2);
}

static void make_phantom(void *user, const busd_event *event)
{
    (void)user;
    if (event->kind == BUSD_DISCONNECTED)
        printf("phantom: %d\n",
               busd_publisher_create(node, "/phantom", &std_msgs__msg__String__type, NULL, &publisher) == -ENOTCONN);
    fflush(stdout);
}

/* During the wait, the next busd gets everything declared again. */
static void wait_for_next_busd(void)
{
    fill();
    busd_on_event(bus, make_phantom, NULL);
    printf("ready\n");
    fflush(stdout);
    need(busd_publisher_wait(full, -1));
}

static void wait_and_lose_it(void)
{
    fill();
    make("/t", &BUSD_QOS_DEFAULT, destroy_full);
    publish(publisher, "end it");
    const int status = busd_publisher_wait(full, WAIT_MS);
    printf("wait: %d: %s\n", status == -EPIPE, busd_error(bus));
}

static void ask(void);
static void make_service(busd_serve *its_serve);

static void hear(void *user, int status, const char *error, const busd_message *response)
{
    (void)user;
    (void)response;
    heard++;
    printf("answer %d: %s\n", status == -ECANCELED, error);
    ask();
    busd_client_destroy(client);
    busd_node_destroy(node);
}

static void ask(void)
{
    const example_interfaces__srv__AddTwoInts_Request request = {.a = 1};
    if (example_interfaces__srv__AddTwoInts__call(client, &request, hear, NULL) < 0)
        printf("call: %s\n", busd_error(bus));
}

static void serve(void *user, busd_server *its_server, const busd_call *call, const busd_message *request)
{
    (void)user;
    (void)its_server;
    (void)call;
    (void)request;
}

static void call_twice(void)
{
    make_service(serve);
    ask();
    ask();
}

static void close_it(void *user, const busd_message *message)
{
    (void)user;
    (void)message;
    heard++;
    busd_close(bus);
}

static void keep(void)
{
    busd_message kept;
    make("/t", &BUSD_QOS_DEFAULT, NULL);
    publish(publisher, "kept");
    int count;
    while ((count = busd_take(subscription, &kept)) == 0)
        need(busd_wait(bus, WAIT_MS));
    need(count);
    busd_subscription_destroy(subscription);
    busd_publisher_destroy(publisher);
    std_msgs__msg__String message;
    need(std_msgs__msg__String__decode(&kept, &message, NULL));
    printf("%.*s\n", (int)message.data.size, message.data.data);
    busd_release(&kept);
}

static void take(busd_message *message)
{
    int count;
    while ((count = busd_take(subscription, message)) == 0)
        need(busd_wait(bus, WAIT_MS));
    need(count);
}

/* A message by ring is long, so that it stays in the ring. */
static void publish_long(char letter)
{
    static char text[20001];
    memset(text, letter, sizeof text - 1);
    publish(publisher, text);
}

static void end_in_child(busd_message *kept)
{
    busd_release(kept);
    busd_client_destroy(client);
    busd_subscription_destroy(subscription);
    busd_publisher_destroy(publisher);
    busd_node_destroy(node);
    busd_close(bus);
    fflush(stdout);
    _exit(0);
}

/* The child ends everything. The parent's message stays in place, and its endpoints continue. */
static void fork_and_go_on(void)
{
    busd_message kept, taken;
    call_twice();
    make("/t", &BUSD_QOS_DEFAULT, NULL);
    publish_long('k');
    take(&kept);
    fflush(stdout);
    const pid_t child = fork();
    if (child == 0)
        end_in_child(&kept);
    waitpid(child, NULL, 0);
    for (int i = 0; i < 1000; i++) { /* around the ring many times */
        publish_long('x');
        take(&taken);
        busd_release(&taken);
    }
    std_msgs__msg__String message;
    need(std_msgs__msg__String__decode(&kept, &message, NULL));
    printf("kept: %d\n", message.data.data[0] == 'k' && message.data.data[message.data.size - 1] == 'k');
    busd_release(&kept);
    busd_client_destroy(client);
}

static int64_t now_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * INT64_C(1000) + now.tv_nsec / 1000000;
}

static void wait_without_busd(void)
{
    const pid_t child = fork();
    if (child == 0) {
        pause();
        _exit(0);
    }
    printf("ready\n");
    fflush(stdout);
    while (busd_is_connected(bus))
        need(busd_wait(bus, WAIT_MS));
    const int64_t begin = now_ms();
    for (int i = 0; i < 10; i++) /* each retry waits twice as long as the one before */
        need(busd_wait(bus, -1));
    printf("ten turns in %lld ms\n", (long long)(now_ms() - begin));
    kill(child, SIGKILL);
    waitpid(child, NULL, 0);
}

static void make_another(void *user, const busd_event *event)
{
    busd_node *another;
    (void)user;
    if (event->kind != BUSD_CONNECTED)
        return;
    need(busd_node_create(bus, "another", NULL, &another));
    need(busd_publisher_create(another, "/t", &std_msgs__msg__String__type, &BUSD_QOS_DEFAULT, &publisher));
    heard++;
}

static void make_again(void)
{
    busd_on_event(bus, make_another, NULL);
    need(busd_subscription_create(node, "/t", &std_msgs__msg__String__type, NULL, NULL, NULL, &subscription));
    printf("ready\n");
    fflush(stdout);
    wait_for_callback();
    while (busd_publisher_matches(publisher) == 0)
        need(busd_wait(bus, WAIT_MS));
    busd_stats stats;
    busd_publisher_stats(publisher, &stats);
    printf("matched, by ring %d\n", stats.by_ring);
}

static void make_one_more(void *user, const busd_event *event)
{
    static int has_begun;
    busd_publisher *more;
    (void)user;
    if (event->kind != BUSD_MATCHED || has_begun)
        return;
    has_begun = 1;
    need(busd_publisher_create(node, "/more", &std_msgs__msg__String__type, NULL, &more));
    heard++;
}

/* The match usually is in the socket before the answer to the last request. */
static void create_inside_of_create(void)
{
    busd_publisher *last;
    need(busd_subscription_create(node, "/t", &std_msgs__msg__String__type, NULL, NULL, NULL, &subscription));
    busd_on_event(bus, make_one_more, NULL);
    need(busd_publisher_create(node, "/t", &std_msgs__msg__String__type, NULL, &publisher));
    const int64_t begin = now_ms();
    need(busd_publisher_create(node, "/last", &std_msgs__msg__String__type, NULL, &last));
    wait_for_callback();
    printf("soon: %d\n", now_ms() - begin < 5000);
}

/* Waits for SIGUSR1, which says that busd has ended. The library has not seen it yet. */
static void wait_for_end(void)
{
    sigset_t signals;
    int number;
    sigemptyset(&signals);
    sigaddset(&signals, SIGUSR1);
    sigprocmask(SIG_BLOCK, &signals, NULL);
    printf("ready\n");
    fflush(stdout);
    sigwait(&signals, &number);
}

static busd_server *server;
static busd_call open_call;

static void keep_call(void *user, busd_server *its_server, const busd_call *call, const busd_message *request)
{
    (void)user;
    (void)its_server;
    (void)request;
    open_call = *call;
    heard++;
}

static void make_service(busd_serve *its_serve)
{
    const busd_service_type *type = &example_interfaces__srv__AddTwoInts__service;
    need(busd_server_create(node, "/add", type, NULL, its_serve, NULL, &server));
    need(busd_client_create(node, "/add", type, NULL, &client));
    while (busd_client_servers(client) == 0)
        need(busd_wait(bus, WAIT_MS));
}

static int reply_to_it(void)
{
    const example_interfaces__srv__AddTwoInts_Response response = {.sum = 3};
    return example_interfaces__srv__AddTwoInts__reply(server, &open_call, &response);
}

static void reply_in_event(void *user, const busd_event *event)
{
    (void)user;
    if (event->kind == BUSD_DISCONNECTED)
        printf("reply in the event: %d\n", reply_to_it());
}

static void hear_end(void *user, int status, const char *error, const busd_message *response)
{
    (void)user;
    (void)status;
    (void)error;
    (void)response;
}

/* The reply finds that busd has ended. Its event replies to the same call. */
static void reply_twice(void)
{
    const example_interfaces__srv__AddTwoInts_Request request = {.a = 1};
    make_service(keep_call);
    need(example_interfaces__srv__AddTwoInts__call(client, &request, hear_end, NULL));
    wait_for_callback();
    wait_for_end();
    busd_on_event(bus, reply_in_event, NULL);
    printf("reply: %d\n", reply_to_it());
    busd_service_stats stats;
    busd_server_stats(server, &stats);
    printf("responses %d, open %u\n", (int)stats.responses, stats.open);
}

static void serve_sum(void *user, busd_server *its_server, const busd_call *call, const busd_message *taken)
{
    example_interfaces__srv__AddTwoInts_Request request;
    (void)user;
    need(example_interfaces__srv__AddTwoInts_Request__decode(taken, &request, NULL));
    const example_interfaces__srv__AddTwoInts_Response response = {.sum = request.a};
    need(example_interfaces__srv__AddTwoInts__reply(its_server, call, &response));
}

static void hear_sum(void *user, int status, const char *error, const busd_message *taken)
{
    example_interfaces__srv__AddTwoInts_Response response = {.sum = status};
    (void)error;
    if (taken != NULL)
        need(example_interfaces__srv__AddTwoInts_Response__decode(taken, &response, NULL));
    printf("%s: %d\n", (const char *)user, (int)response.sum);
    fflush(stdout);
    heard++;
}

static void call_in_event(void *user, const busd_event *event)
{
    const example_interfaces__srv__AddTwoInts_Request request = {.a = 2};
    (void)user;
    if (event->kind == BUSD_DISCONNECTED)
        need(example_interfaces__srv__AddTwoInts__call(client, &request, hear_sum, "second"));
}

/* The call finds that busd has ended. Its event calls, too. */
static void call_in_call(void)
{
    const example_interfaces__srv__AddTwoInts_Request request = {.a = 1};
    make_service(serve_sum);
    wait_for_end();
    busd_on_event(bus, call_in_event, NULL);
    need(example_interfaces__srv__AddTwoInts__call(client, &request, hear_sum, "first"));
    printf("called\n");
    fflush(stdout);
    while (heard < 2)
        need(busd_wait(bus, WAIT_MS));
}

static void count(void *user, busd_server *its_server, const busd_call *call, const busd_message *request)
{
    (void)user;
    (void)its_server;
    (void)call;
    (void)request;
    heard++;
}

static int has_refused;

static void hear_refusal(void *user, int status, const char *error, const busd_message *response)
{
    (void)response;
    if (status != -EREMOTEIO)
        return;
    printf("call %d: %s\n", *(int *)user, error);
    has_refused = 1;
}

/* One call more than a server keeps open. */
static void call_too_often(void)
{
    enum { CLIENTS = 11, EACH = 1000, MOST = 10000 };
    static int numbers[MOST + 1];
    busd_client *clients[CLIENTS];
    const example_interfaces__srv__AddTwoInts_Request request = {.a = 1};
    const busd_service_type *type = &example_interfaces__srv__AddTwoInts__service;
    make_service(count);
    for (int i = 0; i < CLIENTS; i++) {
        need(busd_client_create(node, "/add", type, NULL, &clients[i]));
        while (busd_client_servers(clients[i]) == 0)
            need(busd_wait(bus, WAIT_MS));
    }
    for (int i = 0; i <= MOST; i++) {
        numbers[i] = i;
        need(example_interfaces__srv__AddTwoInts__call(clients[i / EACH], &request, hear_refusal, &numbers[i]));
        while (i % 100 == 0 && heard <= i)
            need(busd_wait(bus, WAIT_MS));
    }
    while (!has_refused)
        need(busd_wait(bus, WAIT_MS));
}

static void show(int status)
{
    const char *text = busd_error(bus);
    printf("%d: %.*s\n", status, (int)strcspn(text, "\n"), text);
}

static void make_with_bad_names(void)
{
    busd_node *bad;
    const busd_type *type = &std_msgs__msg__String__type;
    show(busd_node_create(bus, "caf\xe9", NULL, &bad));
    show(busd_node_create(bus, "good", "/\xc0\xaf", &bad));
    show(busd_publisher_create(node, "\xed\xa0\x80", type, NULL, &publisher));
    show(busd_publisher_create(node, "~tilde", type, NULL, &publisher));
    need(busd_publisher_create(node, "~/private", type, NULL, &publisher)); /* still connected */
    const std_msgs__msg__String message = {.data = {"too long", SIZE_MAX}};
    show(std_msgs__msg__String__publish(publisher, &message));
}

static void use_all_memory(void)
{
    static unsigned char message[4 << 20];
    char topic[16];
    for (int i = 0; i < 16; i++) {
        snprintf(topic, sizeof topic, "/t%d", i);
        need(busd_publisher_create(node, topic, &std_msgs__msg__String__type, NULL, &publisher));
        const int status = busd_publish(publisher, message, sizeof message);
        if (status < 0) {
            show(status);
            break;
        }
        printf("ring %d\n", i);
    }
}

/* More subscriptions, one after the other, than a process has slots for readers. */
static void use_all_slots(void)
{
    busd_stats stats;
    for (int i = 0; i < 1030; i++) {
        need(busd_subscription_create(node, "/t", &std_msgs__msg__String__type, NULL, NULL, NULL, &subscription));
        if (publisher == NULL)
            need(busd_publisher_create(node, "/t", &std_msgs__msg__String__type, NULL, &publisher));
        while (busd_subscription_matches(subscription) == 0)
            need(busd_wait(bus, WAIT_MS));
        busd_subscription_stats(subscription, &stats);
        busd_subscription_destroy(subscription);
    }
    printf("by ring %u\n", stats.by_ring);
}

/* The pings of the shortest lease that there is: neither none nor a flood. */
static void ping(void)
{
    const busd_qos qos = {.depth = 1, .lease_ns = 1};
    need(busd_publisher_create(node, "/t", &std_msgs__msg__String__type, &qos, &publisher));
    const int64_t begin = now_ms();
    for (int i = 0; i < 50; i++)
        need(busd_wait(bus, -1));
    printf("enough: %d\n", now_ms() - begin > 200 && now_ms() - begin < 20000);
}

/* The linker puts these in place of the functions of the C library (tests/c_programs.py). */
void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *old, size_t size);
static int allocated;

void *__wrap_malloc(size_t size) { return allocated++, __real_malloc(size); }
void *__wrap_calloc(size_t count, size_t size) { return allocated++, __real_calloc(count, size); }
void *__wrap_realloc(void *old, size_t size) { return allocated++, __real_realloc(old, size); }

static void hear_paced(void *user, const busd_message *message)
{
    (void)user;
    (void)message;
    heard++;
}

/* One message after the other. Those that are not heard are taken. */
static void pace(int messages, int is_heard)
{
    busd_message taken;
    for (int i = 0; i < messages; i++) {
        const int before = heard;
        publish(publisher, "paced");
        while (is_heard && heard == before)
            need(busd_wait(bus, WAIT_MS));
        if (is_heard)
            continue;
        take(&taken);
        busd_release(&taken);
    }
}

/* Reports and pings go to busd a few times in a second, and may take memory. Messages take none. */
static void stay_warm(void)
{
    enum { MESSAGES = 500 };
    const struct {
        const char *topic;
        busd_qos qos;
        int is_heard;
    } ways[] = {
        {"/heard", BUSD_QOS_DEFAULT, 1},
        {"/taken", BUSD_QOS_DEFAULT, 0},
        {"/lossless", BUSD_QOS_LOSSLESS, 0},
        {"/alive", {.depth = 10, .liveliness = BUSD_MANUAL_BY_TOPIC, .lease_ns = INT64_C(10000000000)}, 1},
    };
    for (size_t i = 0; i < sizeof ways / sizeof *ways; i++) {
        make(ways[i].topic, &ways[i].qos, ways[i].is_heard ? hear_paced : NULL);
        pace(100, ways[i].is_heard);
        const int before = allocated;
        pace(MESSAGES, ways[i].is_heard);
        if (allocated - before < MESSAGES / 5)
            printf("%s: none for a message\n", ways[i].topic);
        else
            printf("%s: %d times for %d messages\n", ways[i].topic, allocated - before, MESSAGES);
    }
}

/* An event loop of the program. The descriptor is readable for each message, and only then one is there. */
static void use_own_loop(void)
{
    enum { MESSAGES = 100 };
    struct pollfd poller = {.fd = busd_fd(bus), .events = POLLIN};
    busd_message taken;
    int count = 0, was_ready = 0;
    make("/t", &BUSD_QOS_DEFAULT, NULL);
    while (count < MESSAGES) {
        while (busd_dispatch(bus) > 0)
            ;
        was_ready += busd_is_ready(subscription);
        publish(publisher, "polled");
        do {
            if (poll(&poller, 1, WAIT_MS) != 1)
                exit(1);
            need(busd_dispatch(bus));
        } while (!busd_is_ready(subscription));
        need(busd_take(subscription, &taken));
        busd_release(&taken);
        count++;
    }
    printf("taken %d, ready without a message %d\n", count, was_ready);
}

static int refusals;

static void show_refusal(void *user, const busd_event *event)
{
    (void)user;
    if (event->kind != BUSD_REFUSED)
        return;
    printf("refused: %.*s\n", (int)strcspn(event->text, "\n"), event->text);
    refusals++;
}

/* Without a wait: while busd is away, while it is there, and destroyed before busd has answered. */
static void create_at_once(void)
{
    const busd_type *type = &std_msgs__msg__String__type;
    busd_node *early, *late, *wrong;
    busd_publisher *ended, *refused, *its;
    busd_on_event(bus, show_refusal, NULL);
    busd_create_at_once(bus, 1);
    wait_for_end();
    while (busd_is_connected(bus))
        need(busd_wait(bus, 10));
    need(busd_node_create(bus, "early", NULL, &early));
    need(busd_subscription_create(early, "/t", type, NULL, hear_paced, NULL, &subscription));
    need(busd_publisher_create(early, "/t", type, NULL, &publisher));
    need(busd_client_create(early, "/add", &example_interfaces__srv__AddTwoInts__service, NULL, &client));
    publish(publisher, "for nobody");
    ask();
    printf("created\n");
    fflush(stdout);
    while (busd_publisher_matches(publisher) == 0 || busd_subscription_matches(subscription) == 0)
        need(busd_wait(bus, WAIT_MS));
    publish(publisher, "for itself");
    wait_for_callback();
    need(busd_publisher_create(early, "/ended", type, NULL, &ended));
    busd_publisher_destroy(ended);
    need(busd_node_create(bus, "late", NULL, &late));
    busd_node_destroy(late);
    need(busd_publisher_create(early, "/a b", type, NULL, &refused));
    need(busd_node_create(bus, "a b", NULL, &wrong));
    need(busd_publisher_create(wrong, "/its", type, NULL, &its));
    while (refusals < 2)
        need(busd_wait(bus, WAIT_MS));
    printf("publish: %d\n", busd_publish(its, "", 0) == -EPIPE && busd_publish(refused, "", 0) == -EPIPE);
    const busd_graph *graph;
    need(busd_graph_get(bus, 0, &graph));
    for (size_t i = 0; i < graph->nodes.count; i++)
        printf("node %s\n", graph->nodes.items[i]->full_name);
    printf("ended: %d\n", busd_graph_find_topic(graph, "/ended") == NULL);
    busd_graph_free(graph);
}

static int changes, losses;

static void note_liveliness(void *user, const busd_event *event)
{
    (void)user;
    if (event->kind == BUSD_LIVELINESS_CHANGED && event->subscription == subscription && ++changes <= 3)
        printf("%s\n", event->text);
    losses += event->kind == BUSD_LIVELINESS_LOST && event->publisher == publisher;
}

static void be_alive(void)
{
    const busd_qos qos = {.depth = 1, .liveliness = BUSD_MANUAL_BY_TOPIC, .lease_ns = 200000000};
    busd_on_event(bus, note_liveliness, NULL);
    make("/t", &qos, NULL);
    for (int wanted = 2; wanted <= 3; wanted++) {
        need(busd_publisher_assert_liveliness(publisher));
        while (changes < wanted || losses == 0)
            need(busd_wait(bus, WAIT_MS));
    }
}

static void destroy_late(void *user, const busd_event *event)
{
    (void)user;
    if (event->kind != BUSD_DEADLINE_MISSED)
        return;
    printf("missed %d by the %s\n", (int)event->count, event->publisher != NULL ? "publisher" : "subscription");
    busd_node_destroy(node);
    heard++;
}

/* The publisher is late first. Its callback destroys the subscription, too, which then must say nothing. */
static void destroy_late_ones(void)
{
    const busd_qos qos = {.depth = 1, .deadline_ns = 20000000};
    make("/t", &qos, NULL);
    publish(publisher, "the only one");
    busd_on_event(bus, destroy_late, NULL);
    wait_for_callback();
    for (int i = 0; i < 3; i++)
        need(busd_wait(bus, 30));
}

static void end_client_with_calls(void)
{
    call_twice();
    busd_client_destroy(client);
}

static void close_in_callback(void)
{
    make("/t", &BUSD_QOS_DEFAULT, close_it);
    publish(publisher, "close");
    wait_for_callback();
    printf("connected: %d\n", busd_is_connected(bus));
}

static const struct {
    const char *name;
    void (*play)(void);
} stories[] = {
    {"own", own}, {"idle", wait_idly}, {"phantom", wait_for_next_busd}, {"wait", wait_and_lose_it},
    {"calls", end_client_with_calls}, {"many", call_too_often}, {"node", call_twice}, {"close", close_in_callback},
    {"late", destroy_late_ones}, {"kept", keep}, {"fork", fork_and_go_on}, {"create", create_inside_of_create},
    {"names", make_with_bad_names}, {"slots", use_all_slots}, {"ping", ping}, {"away", wait_without_busd},
    {"again", make_again}, {"reply", reply_twice}, {"call", call_in_call}, {"warm", stay_warm},
    {"poll", use_own_loop}, {"alive", be_alive}, {"at_once", create_at_once},
    {"grow", use_all_memory},
};

int main(int argc, char **argv)
{
    const char *story = argc > 1 ? argv[1] : "";
    need(busd_connect(&bus, NULL, "callbacks \xff"));
    need(busd_node_create(bus, "callbacks", NULL, &node));
    for (size_t i = 0; i < sizeof stories / sizeof *stories; i++)
        if (strcmp(story, stories[i].name) == 0)
            stories[i].play();
    busd_close(bus);
    printf("heard %d in all\n", heard);
    return 0;
}
