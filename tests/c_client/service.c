/* The C side of tests/system/test_c_client_services.py.
 *
 *     service serve NAME      adds; fails for a negative `a`, for -2 with bytes that are not UTF-8; replies to `a` 1000
 *                             only with the next request
 *     service call NAME A...  calls with each A and b = 1, one after the other, and prints the answers
 *     service away NAME       calls while busd is away
 */
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>

#include "example_interfaces/srv/AddTwoInts.h"

static volatile sig_atomic_t has_ended;
static busd_bus *bus;
static int is_answered;

static struct {
    busd_call call;
    int64_t sum;
    int is_there;
} later;

static void end(int number)
{
    (void)number;
    has_ended = 1;
}

static void send_reply(busd_server *server, const busd_call *call, int64_t sum)
{
    const example_interfaces__srv__AddTwoInts_Response response = {.sum = sum};
    if (example_interfaces__srv__AddTwoInts__reply(server, call, &response) < 0)
        printf("reply: %s\n", busd_error(bus));
}

static void serve(void *user, busd_server *server, const busd_call *call, const busd_message *taken)
{
    example_interfaces__srv__AddTwoInts_Request request;
    (void)user;
    if (example_interfaces__srv__AddTwoInts_Request__decode(taken, &request, NULL) < 0) {
        busd_reply_error(server, call, "not understood");
        return;
    }
    printf("request %" PRId64 "\n", request.a);
    if (later.is_there) {
        later.is_there = 0;
        send_reply(server, &later.call, later.sum);
    }
    if (request.a == -2) {
        busd_reply_error(server, call, "caf\xe9, tr\xc3\xa8s \xe2\x82");
    } else if (request.a < 0) {
        busd_reply_error(server, call, "a is negative");
    } else if (request.a == 1000) {
        later.call = *call;
        later.sum = request.a + request.b;
        later.is_there = 1;
    } else {
        send_reply(server, call, request.a + request.b);
        if (busd_reply(server, call, "", 0) != -ENOENT)
            printf("two replies\n");
    }
    fflush(stdout);
}

static void hear(void *user, int status, const char *error, const busd_message *taken)
{
    example_interfaces__srv__AddTwoInts_Response response;
    (void)user;
    is_answered = 1;
    if (status < 0)
        printf("answer %d: %s\n", status, error);
    else if (example_interfaces__srv__AddTwoInts_Response__decode(taken, &response, NULL) < 0)
        printf("undecodable\n");
    else
        printf("answer %" PRId64 "\n", response.sum);
    fflush(stdout);
}

static void print_stats(const busd_service_stats *s)
{
    printf("requests %" PRIu64 " responses %" PRIu64 " errors %" PRIu64 " late %" PRIu64 " open %u matches %u\n",
           s->requests, s->responses, s->errors, s->late, s->open, s->matches);
    fflush(stdout);
}

static int call_all(busd_client *client, char **numbers)
{
    for (; *numbers != NULL; numbers++) {
        const example_interfaces__srv__AddTwoInts_Request request = {.a = atoll(*numbers), .b = 1};
        while (busd_client_servers(client) == 0)
            if (has_ended || busd_wait(bus, 100) < 0)
                return 0;
        is_answered = 0;
        if (example_interfaces__srv__AddTwoInts__call(client, &request, hear, NULL) < 0)
            return -1;
        printf("called %s\n", *numbers);
        fflush(stdout);
        while (!is_answered && !has_ended)
            if (busd_wait(bus, 100) < 0)
                return -1;
    }
    return 0;
}

static int call_without_busd(busd_client *client)
{
    const example_interfaces__srv__AddTwoInts_Request request = {.a = 1, .b = 1};
    while (busd_is_connected(bus))
        if (busd_wait(bus, 100) < 0)
            return -1;
    if (example_interfaces__srv__AddTwoInts__call(client, &request, hear, NULL) < 0)
        return -1;
    printf("called\n");
    fflush(stdout);
    while (!is_answered && !has_ended)
        if (busd_wait(bus, 100) < 0)
            return -1;
    return 0;
}

int main(int argc, char **argv)
{
    busd_node *node;
    busd_server *server;
    busd_client *client;
    busd_service_stats stats;
    (void)argc;
    signal(SIGTERM, end);
    int status = busd_connect(&bus, NULL, "service");
    if (status == 0)
        status = busd_node_create(bus, "c_service", NULL, &node);
    const busd_service_type *type = &example_interfaces__srv__AddTwoInts__service;
    if (status == 0 && strcmp(argv[1], "serve") == 0) {
        status = busd_server_create(node, argv[2], type, NULL, serve, NULL, &server);
        printf("ready\n");
        fflush(stdout);
        while (status == 0 && !has_ended)
            status = busd_wait(bus, -1) < 0 ? -1 : 0;
        if (status == 0) {
            busd_server_stats(server, &stats);
            print_stats(&stats);
        }
    } else if (status == 0) {
        status = busd_client_create(node, argv[2], type, NULL, &client);
        printf("ready\n");
        fflush(stdout);
        if (status == 0 && busd_client_servers(client) == 0
            && busd_client_call(client, "", 0, hear, NULL) == -EHOSTUNREACH)
            printf("%s\n", busd_error(bus));
        fflush(stdout);
        if (status == 0)
            status = strcmp(argv[1], "away") == 0 ? call_without_busd(client) : call_all(client, argv + 3);
        if (status == 0) {
            busd_client_stats(client, &stats);
            print_stats(&stats);
            busd_client_destroy(client);
        }
    }
    if (status < 0)
        printf("failed: %s\n", busd_error(bus));
    busd_close(bus);
    return status < 0;
}
