/* Bytes and descriptors of the socket, both ways. docs/protocol.md: "Frames", "Descriptors", "Order".
 *
 * Control frames leave before samples, in their order. Samples are no frames here: stream.c reads them from the rings
 * when the socket takes them. Only the rest of a run that the socket took in part is copied.
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "internal.h"
#include "stream.h"

#define READ_BYTES 65536u
#define KEPT_BYTES (1u << 20) /* of memory for received bytes, if there are none */
#define SIMPLE_BYTES 256u     /* most of a control message of numbers only */

/* --- control messages to busd */

static void put_begin(busd_out *out, const char *tag, unsigned fields)
{
    static const unsigned char head[HEAD_BYTES] = {0, 0, 0, 0, FRAME_CONTROL, 0, 0, 0};
    busd_put_raw(out, head, sizeof head);
    busd_put_map(out, fields + 1);
    field_text(out, "m", tag);
}

void control_begin(busd_out *out, const char *tag, unsigned fields)
{
    *out = (busd_out){0};
    put_begin(out, tag, fields);
}

void field_number(busd_out *out, const char *key, uint64_t number)
{
    busd_put_text(out, key, strlen(key));
    busd_put_uint(out, number);
}

void field_bool(busd_out *out, const char *key, bool value)
{
    busd_put_text(out, key, strlen(key));
    busd_put_bool(out, value);
}

void field_text(busd_out *out, const char *key, const char *text)
{
    busd_put_text(out, key, strlen(key));
    busd_put_text(out, text, strlen(text));
}

void field_bytes(busd_out *out, const char *key, const void *bytes, size_t size)
{
    busd_put_text(out, key, strlen(key));
    busd_put_bytes(out, bytes, size);
}

struct frame *frame_new(const void *bytes, size_t size)
{
    struct frame *frame = malloc(sizeof *frame + size);
    if (frame == NULL)
        return NULL;
    *frame = (struct frame){.size = size};
    memcpy(frame->bytes, bytes, size);
    return frame;
}

static void close_descriptors(struct frame *frame)
{
    while (frame->fd_count != 0)
        close(frame->fds[--frame->fd_count]);
}

static void frame_free(struct frame *frame)
{
    if (frame != NULL)
        close_descriptors(frame);
    free(frame);
}

void frame_queue(busd_bus *bus, struct frame *frame)
{
    *bus->control.end = frame;
    bus->control.end = &frame->next;
}

static struct frame *frame_pop(busd_bus *bus)
{
    struct frame *frame = bus->control.first;
    if (frame != NULL && (bus->control.first = frame->next) == NULL)
        bus->control.end = &bus->control.first;
    return frame;
}

/* Frees everything on its way to a busd that is gone. */
void frames_drop(busd_bus *bus)
{
    for (struct frame *frame; (frame = frame_pop(bus)) != NULL;)
        frame_free(frame);
    frame_free(bus->current);
    bus->current = NULL;
    for (unsigned i = 0; i < bus->batch_count; i++)
        for (unsigned j = 0; j < bus->batches[i].count; j++)
            close(bus->batches[i].fds[j]);
    bus->batch_count = 0;
    bus->in_begin = bus->in_end = 0;
}

/* Sends a control message, with copies of the descriptors. 0, -ENOTCONN, -ENOMEM or -EMFILE; frees `out`. */
int control_send(busd_bus *bus, busd_out *out, const int *fds, unsigned fd_count)
{
    struct frame *frame = NULL;
    int status = out->failed ? -ENOMEM : bus->sock < 0 || bus->is_leaving ? -ENOTCONN : 0;
    if (status == 0 && (frame = frame_new(out->bytes, out->size)) == NULL)
        status = -ENOMEM;
    free(out->bytes);
    for (unsigned i = 0; status == 0 && i < fd_count; i++) {
        frame->fds[i] = fcntl(fds[i], F_DUPFD_CLOEXEC, 0);
        if (frame->fds[i] < 0)
            status = -EMFILE;
        else
            frame->fd_count++;
    }
    if (status < 0) {
        frame_free(frame);
        return fail(bus, -status, "%s", status == -ENOTCONN ? "busd is away"
                                        : status == -EMFILE ? "no descriptors are left"
                                                            : "no memory");
    }
    const uint32_t length = (uint32_t)frame->size - 4;
    memcpy(frame->bytes, &length, 4);
    frame_queue(bus, frame);
    flush(bus);
    return 0;
}

/* Sends a control message of numbers only. If it can't be sent, the connection is gone, and a new one makes it
 * needless. It may belong to a message, so it takes no memory if the socket takes it now. */
void control_simple(busd_bus *bus, const char *tag, unsigned count, const char *const *keys, const uint64_t *numbers)
{
    unsigned char bytes[SIMPLE_BYTES];
    busd_out out = {.bytes = bytes, .room = sizeof bytes, .is_fixed = true};
    put_begin(&out, tag, count);
    for (unsigned i = 0; i < count; i++)
        field_number(&out, keys[i], numbers[i]);
    const uint32_t length = (uint32_t)out.size - 4;
    memcpy(bytes, &length, 4);
    if (bus->sock < 0 || bus->is_leaving)
        return;
    const bool is_first = bus->current == NULL && bus->control.first == NULL && bus->pid == getpid();
    if (!is_first || !send_run(bus, &(struct iovec){bytes, out.size}, 1, out.size)) {
        struct frame *frame = bus->sock < 0 ? NULL : frame_new(bytes, out.size);
        if (frame != NULL)
            frame_queue(bus, frame);
    }
    flush(bus);
}

/* --- sending */

static void watch_output(busd_bus *bus, bool is_on)
{
    struct epoll_event event = {.events = EPOLLIN | (is_on ? (uint32_t)EPOLLOUT : 0), .data.u32 = WAKE_SOCKET};
    if (bus->watches_output != is_on)
        epoll_ctl(bus->epoll, EPOLL_CTL_MOD, bus->sock, &event);
    bus->watches_output = is_on;
}

/* The bytes that the socket took; 0: none now; -1: the connection is lost. */
static ssize_t send_parts(busd_bus *bus, struct iovec *parts, size_t count, const int *fds, unsigned fd_count)
{
    union {
        struct cmsghdr head;
        char bytes[CMSG_SPACE(2 * sizeof(int))];
    } control = {0};
    struct msghdr message = {.msg_iov = parts, .msg_iovlen = count};
    if (fd_count != 0) {
        message.msg_control = control.bytes;
        message.msg_controllen = CMSG_SPACE(fd_count * sizeof(int));
        struct cmsghdr *head = CMSG_FIRSTHDR(&message);
        head->cmsg_level = SOL_SOCKET;
        head->cmsg_type = SCM_RIGHTS;
        head->cmsg_len = CMSG_LEN(fd_count * sizeof(int));
        memcpy(CMSG_DATA(head), fds, fd_count * sizeof(int));
    }
    const ssize_t sent = sendmsg(bus->sock, &message, MSG_DONTWAIT | MSG_NOSIGNAL);
    if (sent >= 0)
        return sent;
    if (errno == ETOOMANYREFS)
        set_timer(bus, FLUSH, now_ns() + FLUSH_PAUSE_NS);
    else if (errno == EAGAIN || errno == EINTR || errno == ENOBUFS)
        bus->is_blocked = true;
    else {
        lose_connection(bus, strerror(errno));
        return -1;
    }
    return 0;
}

/* Sends a run of `size` bytes. False: the socket took nothing of it. */
bool send_run(busd_bus *bus, struct iovec *parts, size_t count, size_t size)
{
    const ssize_t sent = send_parts(bus, parts, count, NULL, 0);
    if (sent <= 0)
        return false;
    if ((size_t)sent == size)
        return true;
    struct frame *rest = malloc(sizeof *rest + size - (size_t)sent);
    if (rest == NULL) {
        lose_connection(bus, "no memory for the rest of a message");
        return false;
    }
    *rest = (struct frame){.size = size - (size_t)sent};
    size_t skip = (size_t)sent, at = 0;
    for (size_t i = 0; i < count; i++) {
        const size_t passed = skip < parts[i].iov_len ? skip : parts[i].iov_len;
        memcpy(rest->bytes + at, (char *)parts[i].iov_base + passed, parts[i].iov_len - passed);
        at += parts[i].iov_len - passed;
        skip -= passed;
    }
    bus->current = rest;
    return true;
}

/* Continues with `current`. False: the socket takes no more. */
static bool send_current(busd_bus *bus)
{
    struct frame *frame = bus->current;
    struct iovec part = {frame->bytes + frame->sent, frame->size - frame->sent};
    const ssize_t sent = send_parts(bus, &part, 1, frame->fds, frame->fd_count);
    if (sent <= 0)
        return false;
    close_descriptors(frame); /* they went with the first byte */
    frame->sent += (size_t)sent;
    if (frame->sent == frame->size) {
        frame_free(frame);
        bus->current = NULL;
    }
    return true;
}

/* Sends what the socket takes. After a fork, the child sends nothing: the socket is the parent's. */
void flush(busd_bus *bus)
{
    if (bus->pid != getpid())
        return;
    bus->is_blocked = false;
    while (bus->sock >= 0) {
        if (bus->current == NULL && !bus->is_leaving)
            bus->current = frame_pop(bus);
        if (bus->current != NULL) {
            if (!send_current(bus))
                break;
            continue;
        }
        bool has_sent = false;
        for (busd_publisher *p = bus->publishers; p != NULL && bus->current == NULL && bus->sock >= 0; p = p->next)
            has_sent |= !bus->is_leaving && stream_flush(p);
        if (!has_sent)
            break;
    }
    if (bus->sock < 0)
        return;
    if (bus->is_leaving && bus->current == NULL)
        shutdown(bus->sock, SHUT_WR);
    watch_output(bus, bus->is_blocked);
}

/* --- receiving */

/* Takes over received descriptors: one batch, which is empty if it is not complete. */
static void take_descriptors(busd_bus *bus, struct msghdr *message)
{
    for (struct cmsghdr *head = CMSG_FIRSTHDR(message); head != NULL; head = CMSG_NXTHDR(message, head)) {
        if (head->cmsg_level != SOL_SOCKET || head->cmsg_type != SCM_RIGHTS)
            continue;
        const unsigned count = (unsigned)((head->cmsg_len - CMSG_LEN(0)) / sizeof(int));
        const bool is_kept = count <= 2 && (message->msg_flags & MSG_CTRUNC) == 0 && bus->batch_count < MOST_BATCHES;
        struct batch batch = {.count = is_kept ? count : 0};
        for (unsigned i = 0; i < count; i++) {
            int fd;
            memcpy(&fd, CMSG_DATA(head) + i * sizeof(int), sizeof(int));
            if (is_kept)
                batch.fds[i] = fd;
            else
                close(fd);
        }
        if (bus->batch_count < MOST_BATCHES)
            bus->batches[bus->batch_count++] = batch;
    }
}

/* The oldest batch, for a message that claims so many descriptors. Returns their number: `claimed`, or 0. */
unsigned batch_take(busd_bus *bus, unsigned claimed, int fds[2])
{
    if (claimed == 0 || bus->batch_count == 0)
        return 0;
    const struct batch batch = bus->batches[0];
    memmove(bus->batches, bus->batches + 1, --bus->batch_count * sizeof batch);
    for (unsigned i = 0; i < batch.count; i++) {
        if (batch.count == claimed)
            fds[i] = batch.fds[i];
        else
            close(batch.fds[i]);
    }
    return batch.count == claimed ? claimed : 0;
}

/* Room to read: for the rest of the frame that has begun, but at most twice the bytes that have come of it. */
static bool make_room(busd_bus *bus)
{
    const size_t held = bus->in_end - bus->in_begin;
    uint32_t length = 0;
    if (held >= 4)
        memcpy(&length, bus->in + bus->in_begin, 4);
    if (held == 0)
        bus->in_begin = bus->in_end = 0;
    if (bus->in_room - bus->in_end >= READ_BYTES)
        return true;
    if (bus->in_begin != 0) {
        memmove(bus->in, bus->in + bus->in_begin, held);
        bus->in_begin = 0;
        bus->in_end = held;
    }
    const size_t whole = (size_t)length + 4 + READ_BYTES, doubled = 2 * held + 2 * READ_BYTES;
    const size_t room = whole < doubled && whole >= held + READ_BYTES ? whole : doubled;
    if (room <= bus->in_room && bus->in_room - bus->in_end >= READ_BYTES)
        return true;
    unsigned char *in = realloc(bus->in, room);
    if (in == NULL)
        return false;
    bus->in = in;
    bus->in_room = room;
    return true;
}

/* Gives the memory of a large message back. Called now and then: a stream of them must not pay for it each time. */
void read_shrink(busd_bus *bus)
{
    if (bus->in_room <= KEPT_BYTES || bus->in_begin != bus->in_end)
        return;
    free(bus->in);
    bus->in = NULL;
    bus->in_begin = bus->in_end = bus->in_room = 0;
}

/* Reads once from the socket. 1: bytes came; 0: none now; or -errno, -ECONNRESET at the end. */
int read_more(busd_bus *bus)
{
    union {
        struct cmsghdr head;
        char bytes[CMSG_SPACE(8 * sizeof(int))];
    } control;
    if (!make_room(bus))
        return fail(bus, ENOMEM, "no memory for a message of busd");
    struct iovec part = {bus->in + bus->in_end, bus->in_room - bus->in_end};
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = control.bytes, .msg_controllen = sizeof control};
    const ssize_t size = recvmsg(bus->sock, &message, MSG_DONTWAIT | MSG_CMSG_CLOEXEC);
    if (size < 0)
        return errno == EAGAIN || errno == EINTR ? 0 : fail(bus, errno, "%s", strerror(errno));
    take_descriptors(bus, &message);
    if (size == 0)
        return fail(bus, ECONNRESET, "busd has gone");
    bus->in_end += (size_t)size;
    return 1;
}
