/* The least that any program can do, without framing, types, discovery or queues. Each message is copied in once and
   out once. shm: a memfd of up to PLACES places and two counters, and an eventfd that wakes the reader. socket: a UNIX
   stream. */

#include "roles.h"

#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

enum { PLACES = 64 };
static const size_t MOST_BYTES = 32 << 20; /* messages of 4 MiB don't need more */

typedef struct {
    _Alignas(64) _Atomic uint64_t written;
    _Alignas(64) _Atomic uint64_t taken;
    _Atomic uint32_t is_asleep;
    _Alignas(64) char places[];
} Segment;

/* The connection to the other end: `segment` and `bell`, or `sock` with a buffer. `number` of messages until now. */
typedef struct {
    Segment *segment;
    char *buffer;
    size_t size;
    uint64_t number;
    int bell, sock;
    bool is_socket;
} End;

static End *end_of(const Work *work)
{
    End *end = reserve(sizeof *end);
    *end = (End){.size = work->size, .bell = -1, .is_socket = strcmp(work->way, "socket") == 0};
    end->buffer = reserve(work->size);
    return end;
}

/* ---- connecting: the subscriber listens, and passes the memory and the bell to the publisher */

static struct sockaddr_un address_in(const char *folder)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s/c.sock", folder);
    return address;
}

static size_t places_of(size_t size)
{
    size_t fitting = MOST_BYTES / size;
    return fitting < 4 ? 4 : fitting < PLACES ? fitting : PLACES;
}

static size_t segment_size(const Work *work)
{
    return sizeof(Segment) + places_of(work->size) * work->size;
}

static Segment *map(int memory, const Work *work)
{
    void *found = mmap(NULL, segment_size(work), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_POPULATE, memory, 0);
    if (found == MAP_FAILED)
        fail("mmap");
    return found;
}

typedef union {
    char bytes[CMSG_SPACE(2 * sizeof(int))];
    struct cmsghdr align;
} Control;

static void *listen_for_publisher(const Work *work)
{
    End *end = end_of(work);
    struct sockaddr_un address = address_in(work->folder);
    int server = socket(AF_UNIX, SOCK_STREAM, 0);
    if (server < 0 || bind(server, (struct sockaddr *)&address, sizeof address) || listen(server, 1))
        fail("listen");
    tell_ready(NULL);
    end->sock = accept(server, NULL, NULL);
    if (end->sock < 0)
        fail("accept");
    if (end->is_socket)
        return end;
    int memory = memfd_create("floor", 0);
    if (memory < 0 || ftruncate(memory, (off_t)segment_size(work)))
        fail("memfd");
    end->bell = eventfd(0, 0);
    if (end->bell < 0)
        fail("eventfd");
    end->segment = map(memory, work);
    int both[2] = {memory, end->bell};
    Control control = {0};
    struct iovec one = {.iov_base = "!", .iov_len = 1};
    struct msghdr message = {
        .msg_iov = &one, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    struct cmsghdr *head = CMSG_FIRSTHDR(&message);
    *head = (struct cmsghdr){
        .cmsg_level = SOL_SOCKET, .cmsg_type = SCM_RIGHTS, .cmsg_len = CMSG_LEN(sizeof both)};
    memcpy(CMSG_DATA(head), both, sizeof both);
    if (sendmsg(end->sock, &message, 0) != 1)
        fail("sendmsg");
    return end;
}

static void connect_both(End *end, const Work *work)
{
    end->sock = socket(AF_UNIX, SOCK_STREAM, 0);
    struct sockaddr_un address = address_in(work->folder);
    if (end->sock < 0 || connect(end->sock, (struct sockaddr *)&address, sizeof address))
        fail("connect");
    if (end->is_socket)
        return;
    char greeting;
    int both[2];
    Control control = {0};
    struct iovec one = {.iov_base = &greeting, .iov_len = 1};
    struct msghdr message = {
        .msg_iov = &one, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    if (recvmsg(end->sock, &message, 0) != 1 || !CMSG_FIRSTHDR(&message))
        fail("recvmsg");
    memcpy(both, CMSG_DATA(CMSG_FIRSTHDR(&message)), sizeof both);
    end->segment = map(both[0], work);
    end->bell = both[1];
}

static void *connect_to_subscriber(const Work *work)
{
    End *end = end_of(work);
    connect_both(end, work);
    tell_ready(NULL);
    return end;
}

/* ---- one message */

static char *place(const End *end)
{
    return end->segment->places + end->number % places_of(end->size) * end->size;
}

static void put_by_socket(void *connection, const char *message, size_t size)
{
    End *end = connection;
    for (size_t done = 0; done < size;) {
        ssize_t sent = write(end->sock, message + done, size - done);
        if (sent < 0)
            fail("write");
        done += (size_t)sent;
    }
}

static const char *get_by_socket(void *connection)
{
    End *end = connection;
    for (size_t done = 0; done < end->size;) {
        ssize_t came = read(end->sock, end->buffer + done, end->size - done);
        if (came <= 0)
            fail("read");
        done += (size_t)came;
    }
    return end->buffer;
}

static void done_by_socket(void *connection)
{
    (void)connection;
}

static void put_by_memory(void *connection, const char *message, size_t size)
{
    End *end = connection;
    Segment *segment = end->segment;
    /* acquire, with the release in done_by_memory(): the reader has copied the old message. */
    while (end->number - atomic_load_explicit(&segment->taken, memory_order_acquire) >= places_of(size))
        nanosleep(&(struct timespec){.tv_nsec = 20000}, NULL);
    memcpy(place(end), message, size);
    /* seq_cst, with is_asleep and written in get_by_memory(): either that sees the message, or this is_asleep. */
    atomic_store(&segment->written, ++end->number);
    if (atomic_load(&segment->is_asleep)) {
        atomic_store(&segment->is_asleep, 0);
        if (write(end->bell, &(uint64_t){1}, 8) != 8)
            fail("eventfd");
    }
}

static const char *get_by_memory(void *connection)
{
    End *end = connection;
    Segment *segment = end->segment;
    while (atomic_load(&segment->written) <= end->number) {
        atomic_store(&segment->is_asleep, 1);
        uint64_t rings;
        if (atomic_load(&segment->written) <= end->number && read(end->bell, &rings, 8) != 8)
            fail("eventfd");
    }
    return place(end);
}

static void done_by_memory(void *connection)
{
    End *end = connection;
    atomic_store_explicit(&end->segment->taken, ++end->number, memory_order_release);
}

const Way WAYS[] = {
    {"shm", connect_to_subscriber, listen_for_publisher, put_by_memory, get_by_memory, done_by_memory, NULL, false},
    /* Its bytes are the subscriber's own copy already. */
    {"socket", connect_to_subscriber, listen_for_publisher, put_by_socket, get_by_socket, done_by_socket, NULL, true},
    {0},
};
