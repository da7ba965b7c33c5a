/* libzmq, XPUB and SUB over ipc, as benchmarks/adapters/zeromq.py does it. The subscriber binds. In a flood the
   publisher blocks while the queue is full (XPUB_NODROP), so no message is lost. */

#include "roles.h"

#include <stdio.h>
#include <string.h>
#include <zmq.h>

static const size_t QUEUE = 10000, QUEUE_BYTES = 32 << 20;

typedef struct {
    void *socket;
    zmq_msg_t message;
} End;

static void check(int status, const char *what)
{
    if (status < 0)
        fail_because(what, zmq_strerror(zmq_errno()));
}

static End *end_of(const Work *work, int kind, int limit)
{
    End *end = reserve(sizeof *end);
    end->socket = zmq_socket(zmq_ctx_new(), kind);
    if (!end->socket)
        fail_because("zmq_socket", zmq_strerror(zmq_errno()));
    size_t fitting = QUEUE_BYTES / work->size;
    int depth = (int)(fitting < 2 ? 2 : fitting < QUEUE ? fitting : QUEUE);
    check(zmq_setsockopt(end->socket, limit, &depth, sizeof depth), "zmq_setsockopt");
    return end;
}

static void address_in(const Work *work, char *room, size_t size)
{
    snprintf(room, size, "ipc://%s/zmq.sock", work->folder);
}

static void *publish_to(const Work *work)
{
    End *end = end_of(work, ZMQ_XPUB, ZMQ_SNDHWM);
    char address[200], subscribed[8];
    int yes = 1;
    check(zmq_setsockopt(end->socket, ZMQ_XPUB_NODROP, &yes, sizeof yes), "zmq_setsockopt");
    address_in(work, address, sizeof address);
    check(zmq_connect(end->socket, address), "zmq_connect");
    check(zmq_recv(end->socket, subscribed, sizeof subscribed, 0), "zmq_recv");
    tell_ready(NULL);
    return end;
}

static void *subscribe_to(const Work *work)
{
    End *end = end_of(work, ZMQ_SUB, ZMQ_RCVHWM);
    char address[200];
    check(zmq_setsockopt(end->socket, ZMQ_SUBSCRIBE, "", 0), "zmq_setsockopt");
    address_in(work, address, sizeof address);
    check(zmq_bind(end->socket, address), "zmq_bind");
    tell_ready(NULL);
    return end;
}

static void put(void *connection, const char *message, size_t size)
{
    End *end = connection;
    check(zmq_send(end->socket, message, size, 0), "zmq_send");
}

static const char *get(void *connection)
{
    End *end = connection;
    check(zmq_msg_init(&end->message), "zmq_msg_init");
    check(zmq_msg_recv(&end->message, end->socket, 0), "zmq_msg_recv");
    return zmq_msg_data(&end->message);
}

static void done(void *connection)
{
    End *end = connection;
    check(zmq_msg_close(&end->message), "zmq_msg_close");
}

const Way WAYS[] = {
    /* Its bytes are the subscriber's own copy already. */
    {"ipc", publish_to, subscribe_to, put, get, done, NULL, true},
    {0},
};
