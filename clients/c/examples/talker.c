/* Publishes a text twice a second: talker [TOPIC] */
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <time.h>

#include "std_msgs/msg/String.h"

static volatile sig_atomic_t has_ended;

static void end(int number)
{
    (void)number;
    has_ended = 1;
}

static void report(void *user, const busd_event *event)
{
    (void)user;
    fprintf(stderr, "%s\n", event->text);
}

static int64_t now_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * INT64_C(1000) + now.tv_nsec / 1000000;
}

static int talk(busd_bus *bus, const char *topic)
{
    busd_node *node;
    busd_publisher *publisher;
    if (busd_node_create(bus, "c_talker", NULL, &node) < 0)
        return -1;
    if (busd_publisher_create(node, topic, &std_msgs__msg__String__type, &BUSD_QOS_DEFAULT, &publisher) < 0)
        return -1;
    int64_t next_ms = now_ms();
    for (uint64_t number = 0; !has_ended;) {
        if (now_ms() >= next_ms) {
            char text[64];
            snprintf(text, sizeof text, "Hello World: %" PRIu64, number++);
            const std_msgs__msg__String message = {.data = busd_text_of(text)};
            if (std_msgs__msg__String__publish(publisher, &message) < 0)
                return -1;
            printf("Publishing: \"%s\"\n", text);
            fflush(stdout);
            next_ms += 500;
        }
        const int64_t left_ms = next_ms - now_ms();
        if (busd_wait(bus, left_ms > 0 ? (int)left_ms : 0) < 0)
            return -1;
    }
    return 0;
}

int main(int argc, char **argv)
{
    busd_bus *bus;
    signal(SIGINT, end);
    signal(SIGTERM, end);
    int status = busd_connect(&bus, NULL, "talker");
    if (status == 0) {
        busd_on_event(bus, report, NULL);
        status = talk(bus, argc > 1 ? argv[1] : "topic");
    }
    if (status < 0)
        fprintf(stderr, "talker: %s\n", busd_error(bus));
    busd_close(bus);
    return status < 0;
}
