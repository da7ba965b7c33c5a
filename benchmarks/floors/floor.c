/* The same work as a program in C: messages from one process to another, and nothing else.

       floor publisher|subscriber shm|socket FOLDER SIZE COUNT WARM_UP RATE
       floor memcpy SIZE COUNT

   shm: a memfd of up to PLACES places and two counters, and an eventfd that wakes the reader. socket: a UNIX stream.
   It has no framing, types, discovery or queue; each message is copied in once and out once. It uses the protocol of
   benchmarks/harness.py. RATE is in messages/s; 0 means full speed without losses. The first two words of a paced
   message are its due time and its sending time, in ns of CLOCK_MONOTONIC. */

#include <errno.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

enum { PLACES = 64, SECOND = 1000000000 };
static const size_t MOST_BYTES = 32 << 20; /* messages of 4 MiB don't need more */
static const size_t CACHED_BYTES = 4 << 20;

typedef struct {
    bool is_socket;
    const char *folder;
    size_t size;
    uint64_t count, warm_up;
    double rate;
} Work;

typedef struct {
    _Alignas(64) _Atomic uint64_t written;
    _Alignas(64) _Atomic uint64_t taken;
    _Atomic uint32_t is_asleep;
    _Alignas(64) char places[];
} Segment;

/* The connection to the other end: `segment` and `bell`, or `sock`. */
typedef struct {
    Segment *segment;
    int bell, sock;
} Way;

static void fail(const char *what)
{
    perror(what);
    exit(1);
}

static int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * SECOND + now.tv_nsec;
}

static void sleep_until(int64_t due_ns)
{
    struct timespec due = {.tv_sec = due_ns / SECOND, .tv_nsec = due_ns % SECOND};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL) == EINTR)
        ;
}

static void say(const char *event)
{
    printf("{\"event\": \"%s\"}\n", event);
    fflush(stdout);
}

/* Read the next line of the parent, which must be `word`; exit at the end of stdin. */
static void wait_for(const char *word)
{
    char line[64];
    if (!fgets(line, sizeof line, stdin))
        exit(0);
    line[strcspn(line, "\n")] = '\0';
    if (strcmp(line, word) != 0) {
        fprintf(stderr, "expected the word %s, got %s\n", word, line);
        exit(1);
    }
}

static void *reserve(size_t size)
{
    void *memory = malloc(size ? size : 1);
    if (!memory)
        fail("malloc");
    return memory;
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

static Way listen_for_publisher(const Work *work)
{
    Way way = {.sock = -1, .bell = -1};
    struct sockaddr_un address = address_in(work->folder);
    int server = socket(AF_UNIX, SOCK_STREAM, 0);
    if (server < 0 || bind(server, (struct sockaddr *)&address, sizeof address) || listen(server, 1))
        fail("listen");
    say("ready");
    way.sock = accept(server, NULL, NULL);
    if (way.sock < 0)
        fail("accept");
    if (work->is_socket)
        return way;
    int memory = memfd_create("floor", 0);
    if (memory < 0 || ftruncate(memory, (off_t)segment_size(work)))
        fail("memfd");
    way.bell = eventfd(0, 0);
    if (way.bell < 0)
        fail("eventfd");
    way.segment = map(memory, work);
    int both[2] = {memory, way.bell};
    Control control = {0};
    struct iovec one = {.iov_base = "!", .iov_len = 1};
    struct msghdr message = {
        .msg_iov = &one, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    struct cmsghdr *head = CMSG_FIRSTHDR(&message);
    *head = (struct cmsghdr){
        .cmsg_level = SOL_SOCKET, .cmsg_type = SCM_RIGHTS, .cmsg_len = CMSG_LEN(sizeof both)};
    memcpy(CMSG_DATA(head), both, sizeof both);
    if (sendmsg(way.sock, &message, 0) != 1)
        fail("sendmsg");
    return way;
}

static Way connect_to_subscriber(const Work *work)
{
    Way way = {.sock = socket(AF_UNIX, SOCK_STREAM, 0), .bell = -1};
    struct sockaddr_un address = address_in(work->folder);
    if (way.sock < 0 || connect(way.sock, (struct sockaddr *)&address, sizeof address))
        fail("connect");
    if (work->is_socket)
        return way;
    char greeting;
    int both[2];
    Control control = {0};
    struct iovec one = {.iov_base = &greeting, .iov_len = 1};
    struct msghdr message = {
        .msg_iov = &one, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    if (recvmsg(way.sock, &message, 0) != 1 || !CMSG_FIRSTHDR(&message))
        fail("recvmsg");
    memcpy(both, CMSG_DATA(CMSG_FIRSTHDR(&message)), sizeof both);
    way.segment = map(both[0], work);
    way.bell = both[1];
    return way;
}

/* ---- one message */

static char *place(const Way *way, uint64_t number, size_t size)
{
    return way->segment->places + number % places_of(size) * size;
}

static void put(const Way *way, const Work *work, uint64_t number, const char *message)
{
    if (work->is_socket) {
        for (size_t done = 0; done < work->size;) {
            ssize_t sent = write(way->sock, message + done, work->size - done);
            if (sent < 0)
                fail("write");
            done += (size_t)sent;
        }
        return;
    }
    Segment *segment = way->segment;
    /* acquire, with the release in get(): the reader has copied the old message. */
    while (number - atomic_load_explicit(&segment->taken, memory_order_acquire) >= places_of(work->size))
        nanosleep(&(struct timespec){.tv_nsec = 20000}, NULL);
    memcpy(place(way, number, work->size), message, work->size);
    /* seq_cst, with is_asleep and written in get(): either get() sees the message, or put() sees is_asleep. */
    atomic_store(&segment->written, number + 1);
    if (atomic_load(&segment->is_asleep)) {
        atomic_store(&segment->is_asleep, 0);
        if (write(way->bell, &(uint64_t){1}, 8) != 8)
            fail("eventfd");
    }
}

static void get(const Way *way, const Work *work, uint64_t number, char *message)
{
    if (work->is_socket) {
        for (size_t done = 0; done < work->size;) {
            ssize_t came = read(way->sock, message + done, work->size - done);
            if (came <= 0)
                fail("read");
            done += (size_t)came;
        }
        return;
    }
    Segment *segment = way->segment;
    while (atomic_load(&segment->written) <= number) {
        atomic_store(&segment->is_asleep, 1);
        uint64_t rings;
        if (atomic_load(&segment->written) <= number && read(way->bell, &rings, 8) != 8)
            fail("eventfd");
    }
    memcpy(message, place(way, number, work->size), work->size);
    atomic_store_explicit(&segment->taken, number + 1, memory_order_release);
}

/* ---- the roles */

static void publish(const Work *work)
{
    Way way = connect_to_subscriber(work);
    uint64_t total = work->warm_up + work->count;
    char *message = reserve(work->size);
    memset(message, 'x', work->size);
    say("ready");
    if (work->rate > 0) {
        wait_for("go");
        double period_ns = SECOND / work->rate;
        int64_t start_ns = now_ns() + (int64_t)period_ns;
        for (uint64_t number = 0; number < total; number++) {
            int64_t stamps[2] = {start_ns + (int64_t)((double)number * period_ns), 0};
            sleep_until(stamps[0]);
            stamps[1] = now_ns();
            memcpy(message, stamps, sizeof stamps);
            put(&way, work, number, message);
        }
    } else {
        wait_for("warm_up");
        uint64_t number = 0;
        for (; number < work->warm_up; number++)
            put(&way, work, number, message);
        wait_for("go");
        int64_t begin_ns = now_ns();
        for (; number < total; number++)
            put(&way, work, number, message);
        printf("{\"event\": \"sent\", \"begin_ns\": %lld}\n", (long long)begin_ns);
        fflush(stdout);
    }
    wait_for("end");
}

static void say_list(const char *key, const int64_t *values, uint64_t count)
{
    printf(", \"%s\": [", key);
    for (uint64_t number = 0; number < count; number++)
        printf(number ? ", %lld" : "%lld", (long long)values[number]);
    printf("]");
}

static void subscribe(const Work *work)
{
    Way way = listen_for_publisher(work);
    uint64_t total = work->warm_up + work->count, number = 0;
    char *message = reserve(work->size);
    int64_t *late_ns = reserve(total * sizeof *late_ns), *age_ns = reserve(total * sizeof *age_ns);
    if (work->rate > 0) {
        int64_t at_ns = 0;
        for (; number < total; number++) {
            int64_t stamps[2];
            get(&way, work, number, message);
            at_ns = now_ns();
            memcpy(stamps, message, sizeof stamps);
            late_ns[number] = stamps[1] - stamps[0];
            age_ns[number] = at_ns - stamps[1];
        }
        say("complete");
        wait_for("report");
        printf("{\"event\": \"received\", \"at_ns\": %lld", (long long)at_ns);
        say_list("late_ns", late_ns + work->warm_up, work->count);
        say_list("age_ns", age_ns + work->warm_up, work->count);
        printf("}\n");
    } else {
        for (; number < work->warm_up; number++)
            get(&way, work, number, message);
        say("warm");
        for (; number < total; number++)
            get(&way, work, number, message);
        printf("{\"event\": \"received\", \"end_ns\": %lld, \"count\": %llu, \"dropped\": {}}\n",
               (long long)now_ns(), (unsigned long long)number);
    }
    fflush(stdout);
    wait_for("end");
}

/* Copy the same bytes again and again, in turn to places that fit into a cache together. No transport that copies
   the bytes can be faster, wherever in the caches they are. */
static void copy(size_t size, uint64_t count)
{
    size_t places = size < CACHED_BYTES ? CACHED_BYTES / size : 1;
    char *from = reserve(size), *to = reserve(places * size);
    memset(from, 'x', size);
    memset(to, 0, places * size);
    int64_t begin_ns = now_ns();
    for (uint64_t number = 0; number < count; number++) {
        size_t offset = number % places * size;
        memcpy(to + offset, from, size);
        /* Otherwise a compiler may remove the copy, because nothing reads it. */
        atomic_signal_fence(memory_order_seq_cst);
    }
    printf("{\"event\": \"copied\", \"ns\": %lld}\n", (long long)(now_ns() - begin_ns));
    fflush(stdout);
    wait_for("end");
}

int main(int count, char **words)
{
    if (count == 4 && strcmp(words[1], "memcpy") == 0) {
        copy(strtoull(words[2], NULL, 10), strtoull(words[3], NULL, 10));
        return 0;
    }
    if (count != 8) {
        fprintf(stderr, "%d words and not 8; see the head of floor.c\n", count);
        return 2;
    }
    Work work = {
        .is_socket = strcmp(words[2], "socket") == 0,
        .folder = words[3],
        .size = strtoull(words[4], NULL, 10),
        .count = strtoull(words[5], NULL, 10),
        .warm_up = strtoull(words[6], NULL, 10),
        .rate = strtod(words[7], NULL),
    };
    if (work.size < 2 * sizeof(int64_t)) {
        fprintf(stderr, "a size of %zu B: at least 16\n", work.size);
        return 2;
    }
    (strcmp(words[1], "publisher") == 0 ? publish : subscribe)(&work);
    return 0;
}
