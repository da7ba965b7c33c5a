/* Prints each text: listener [TOPIC] */
#include <signal.h>
#include <stdio.h>

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

static void hear(void *user, const busd_message *taken)
{
    std_msgs__msg__String message;
    (void)user;
    if (std_msgs__msg__String__decode(taken, &message, NULL) < 0)
        return;
    printf("I heard: [%.*s]\n", (int)message.data.size, message.data.data);
    fflush(stdout);
}

static int listen_to(busd_bus *bus, const char *topic)
{
    busd_node *node;
    busd_subscription *subscription;
    if (busd_node_create(bus, "c_listener", NULL, &node) < 0)
        return -1;
    if (busd_subscription_create(node, topic, &std_msgs__msg__String__type, &BUSD_QOS_DEFAULT, hear, NULL,
                                 &subscription) < 0)
        return -1;
    while (!has_ended)
        if (busd_wait(bus, -1) < 0)
            return -1;
    return 0;
}

int main(int argc, char **argv)
{
    busd_bus *bus;
    signal(SIGINT, end);
    signal(SIGTERM, end);
    int status = busd_connect(&bus, NULL, "listener");
    if (status == 0) {
        busd_on_event(bus, report, NULL);
        status = listen_to(bus, argc > 1 ? argv[1] : "topic");
    }
    if (status < 0)
        fprintf(stderr, "listener: %s\n", busd_error(bus));
    busd_close(bus);
    return status < 0;
}
