/* iceoryx 1 by its C binding, with RouDi as its daemon. The publisher fills a loaned chunk by one copy. The subscriber
   waits in a wait set, and looks at the chunk in place (viewed) or copies it (copied). Lossless: a full queue blocks the
   publisher. */

#include "roles.h"

#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <iceoryx_binding_c/enums.h>
#include <iceoryx_binding_c/publisher.h>
#include <iceoryx_binding_c/runtime.h>
#include <iceoryx_binding_c/subscriber.h>
#include <iceoryx_binding_c/types.h>
#include <iceoryx_binding_c/wait_set.h>

enum { MOST_QUEUED = 256, MOST_HELD_BYTES = 16 << 20 };

typedef struct {
    iox_pub_storage_t publisher_room;
    iox_sub_storage_t subscriber_room;
    iox_ws_storage_t waiting_room;
    iox_pub_t publisher;
    iox_sub_t subscriber;
    iox_ws_t waiting;
    const void *chunk;
} End;

static End *end_of(const char *role)
{
    char name[64];
    snprintf(name, sizeof name, "%s-%d", role, (int)getpid());
    iox_runtime_init(name);
    return reserve(sizeof(End));
}

static void *publish_to(const Work *work)
{
    (void)work;
    End *end = end_of("publisher");
    iox_pub_options_t options;
    iox_pub_options_init(&options);
    options.subscriberTooSlowPolicy = ConsumerTooSlowPolicy_WAIT_FOR_CONSUMER;
    end->publisher = iox_pub_init(&end->publisher_room, "bench", "bench", "bench", &options);
    while (!iox_pub_has_subscribers(end->publisher)) /* it has no event for this */
        nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
    tell_ready(NULL);
    return end;
}

static void *subscribe_to(const Work *work)
{
    End *end = end_of("subscriber");
    iox_sub_options_t options;
    iox_sub_options_init(&options);
    size_t fitting = MOST_HELD_BYTES / work->size;
    options.queueCapacity = fitting < 2 ? 2 : fitting < MOST_QUEUED ? fitting : MOST_QUEUED;
    options.queueFullPolicy = QueueFullPolicy_BLOCK_PRODUCER;
    end->subscriber = iox_sub_init(&end->subscriber_room, "bench", "bench", "bench", &options);
    end->waiting = iox_ws_init(&end->waiting_room);
    if (iox_ws_attach_subscriber_state(end->waiting, end->subscriber, SubscriberState_HAS_DATA, 0, NULL) !=
        WaitSetResult_SUCCESS)
        fail_because("iox_ws_attach_subscriber_state", "no success");
    tell_ready(NULL);
    return end;
}

static void put(void *connection, const char *message, size_t size)
{
    End *end = connection;
    void *chunk;
    enum iox_AllocationResult found;
    while ((found = iox_pub_loan_chunk(end->publisher, &chunk, (uint32_t)size)) ==
           AllocationResult_RUNNING_OUT_OF_CHUNKS)
        nanosleep(&(struct timespec){.tv_nsec = 20000}, NULL);
    if (found != AllocationResult_SUCCESS)
        fail_because("iox_pub_loan_chunk", "no chunk of this size");
    memcpy(chunk, message, size);
    iox_pub_publish_chunk(end->publisher, chunk);
}

static const char *get(void *connection)
{
    End *end = connection;
    iox_notification_info_t notification;
    uint64_t missed;
    while (iox_sub_take_chunk(end->subscriber, &end->chunk) != ChunkReceiveResult_SUCCESS)
        iox_ws_wait(end->waiting, &notification, 1, &missed);
    return end->chunk;
}

static void done(void *connection)
{
    End *end = connection;
    iox_sub_release_chunk(end->subscriber, end->chunk);
}

const Way WAYS[] = {
    {"viewed", publish_to, subscribe_to, put, get, done, NULL, true},
    {"copied", publish_to, subscribe_to, put, get, done, NULL, false},
    {0},
};
