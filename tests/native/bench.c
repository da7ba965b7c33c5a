/* Measures the ring alone, without Python: bench [milliseconds for each figure] [microseconds awake before sleep]. */
#include <sched.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#define RING_LARGE (32u << 10) /* as in the product */
#include "check.h"

enum { MOST = 1 << 20 };

static uint64_t length_ns;
static unsigned spins; /* microseconds for which the reader stays awake and polls each microsecond */
static unsigned char *bytes;

static void *shared(uint64_t size)
{
    void *memory = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS | MAP_POPULATE, -1, 0);
    if (memory == MAP_FAILED)
        FAIL("mmap: %m");
    return memory;
}

static void *shared_ring(uint64_t capacity, uint64_t index_length)
{
    void *memory = shared(ring_segment_bytes(capacity, index_length));
    ring_format(memory, capacity, index_length, 1);
    return memory;
}

static void take_one(struct ring_reader *r)
{
    struct ring_record record;
    if (ring_poll(r, 0) == 0 || ring_look(r, &record) != RING_OK || ring_copy_out(r, &record, bytes) != RING_OK)
        FAIL("lost");
    ring_step(r);
}

/* One thread: write and take in turn, or `burst` writes and then as many takes; with `readers` awake readers. */
static void measure_alone(uint32_t size, uint64_t capacity, unsigned burst, size_t readers)
{
    void *memory = shared_ring(capacity, 8192);
    struct readers_header *segments = shared(readers_segment_bytes(1) * readers);
    struct ring_gate gates[16] = {{0}};
    uint64_t rung[16] = {0};
    struct ring_writer w;
    struct ring_reader r;
    ring_writer_attach(&w, memory);
    w.keep = burst;
    open_reader(&r, memory, NULL);
    ring_join(&r, 0);
    for (size_t i = 0; i < readers; i++)
        gates[i].slot = (void *)((char *)segments + i * readers_segment_bytes(1) + sizeof(struct readers_header));
    w.gates.list = gates;
    w.gates.count = readers;
    ring_gates_changed(&w);
    uint64_t writing = 0, taking = 0, count = 0;
    const uint64_t end = now_ns() + length_ns;
    uint64_t now = now_ns();
    while (now < end) {
        const uint64_t begin = now;
        for (unsigned i = 0; i < burst; i++) {
            if (ring_write(&w, bytes, size, now, 0, true) != RING_OK)
                FAIL("not written");
            bell_fence();
            for (size_t j = 0; j < readers; j++) {
                const struct readers_header *s = (void *)((char *)segments + j * readers_segment_bytes(1));
                if (bell_is_due(&s->arrival, &rung[j], 0))
                    FAIL("all are awake");
            }
        }
        const uint64_t written = now_ns();
        for (unsigned i = 0; i < burst; i++)
            take_one(&r);
        now = now_ns();
        writing += written - begin;
        taking += now - written;
        count += burst;
    }
    printf("alone, %7u B, bursts of %4u, %2zu awake readers: write %8.1f ns, take %8.1f ns\n", size, burst, readers,
           (double)writing / (double)count, (double)taking / (double)count);
    munmap(memory, ring_segment_bytes(capacity, 8192));
    munmap(segments, readers_segment_bytes(1) * readers);
}

static int doors[2];
static struct page {
    _Atomic uint64_t is_over;
    uint64_t count, sum, latencies[100000];
} *page;

/* Binds each side to a separate processor; otherwise the scheduler's choice decides the figures. */
static void stay_on(size_t cpu)
{
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(cpu, &set);
    if (sched_setaffinity(0, sizeof set, &set) != 0)
        FAIL("sched_setaffinity: %m");
}

static void sleep_at(int door)
{
    uint64_t count;
    if (read(door, &count, sizeof count) != sizeof count)
        FAIL("eventfd: %m");
}

static void knock(int door)
{
    const uint64_t one = 1;
    if (write(door, &one, sizeof one) != sizeof one)
        FAIL("eventfd: %m");
}

enum way { COPIED, IN_PLACE };

static void read_for_ever(void *memory, struct readers_header *readers, enum way way, bool is_lossless)
{
    struct ring_reader r;
    open_reader(&r, memory, readers_slots(readers));
    ring_seek(&r, 1);
    uint64_t sum = 0, count = 0;
    for (;;) {
        while (ring_poll(&r, 0) != 0) {
            struct ring_record record;
            unsigned pin = 0;
            for (int i = 0; i < 64 && ring_look(&r, &record) == RING_OK; i++) {
                if (way == COPIED) {
                    if (ring_copy_out(&r, &record, bytes) != RING_OK)
                        break;
                    sum += bytes[record.size / 2];
                } else {
                    if (ring_pin(&r, &record, &pin) != RING_OK)
                        break;
                    sum += *((const unsigned char *)record.payload + record.size / 2);
                    ring_unpin(r.slot, pin);
                }
                ring_step(&r);
                count++;
            }
            ring_tell_cursor(&r);
            if (is_lossless && ring_room_is_due(&r))
                knock(doors[1]);
        }
        if (page->is_over && ring_poll(&r, 0) == 0)
            break;
        bool is_idle = true;
        for (unsigned i = 0; i < spins && is_idle; i++) {
            for (const uint64_t until = now_ns() + 1000; now_ns() < until;)
                ;
            is_idle = ring_poll(&r, 0) == 0;
        }
        if (!is_idle)
            continue;
        bell_arm(&readers->arrival, 0);
        if (ring_poll(&r, 0) == 0 && !page->is_over)
            sleep_at(doors[0]);
        bell_disarm(&readers->arrival);
    }
    page->count = count;
    page->sum = sum;
}

static void measure_across(uint32_t size, uint64_t capacity, bool is_lossless, enum way way)
{
    void *memory = shared_ring(capacity, 8192);
    struct readers_header *readers = shared(readers_segment_bytes(1));
    readers_format(readers, 1);
    struct reader_slot *slot = readers_slots(readers);
    slot->cursor = 1;
    page->is_over = 0;
    const pid_t pid = fork();
    stay_on(pid == 0);
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        read_for_ever(memory, readers, way, is_lossless);
        _exit(0);
    }
    struct ring_gate gate = {.slot = slot, .is_lossless = is_lossless};
    struct ring_writer w;
    ring_writer_attach(&w, memory);
    w.gates.list = &gate;
    w.gates.count = 1;
    ring_gates_changed(&w);
    uint64_t rung = 0, rings = 0, waits = 0, now = now_ns();
    const uint64_t begin = now;
    for (unsigned i = 0; now - begin < length_ns; i++) {
        void *payload;
        const enum ring_status status = ring_reserve(&w, size, true, &payload);
        if (status == RING_OK) {
            if (way == COPIED)
                copy_to_shared(payload, bytes, size);
            else
                *(unsigned char *)payload = 1;
            ring_publish(&w, size, now, 0);
            bell_fence();
            if (bell_is_due(&readers->arrival, &rung, 0)) {
                knock(doors[0]);
                rings++;
            }
        } else if (status == RING_FULL && ring_wait_for_room(&w)) {
            waits++;
            sleep_at(doors[1]);
            bell_disarm(&w.header->room);
        }
        if (i % 32 == 0)
            now = now_ns();
    }
    page->is_over = 1;
    knock(doors[0]);
    waitpid(pid, NULL, 0);
    const double seconds = (double)(now_ns() - begin) / 1e9;
    printf("across, %7u B, %s, %s: published %9.0f/s, taken %9.0f/s", size, is_lossless ? "lossless" : "lossy   ",
           way == COPIED ? "copied  " : "in place", (double)w.latest / seconds, (double)page->count / seconds);
    if (way == COPIED)
        printf(", %6.2f GB/s", (double)page->count * size / seconds / 1e9);
    printf("; rung %" PRIu64 ", waited %" PRIu64 "\n", rings, waits);
    munmap(memory, ring_segment_bytes(capacity, 8192));
    munmap(readers, readers_segment_bytes(1));
}

static int ascending(const void *left, const void *right)
{
    const uint64_t l = *(const uint64_t *)left, r = *(const uint64_t *)right;
    return (l > r) - (l < r);
}

/* Measures the latency of one way, into a sleeping process, at 1,000/s. */
static void measure_latency(void)
{
    void *memory = shared_ring(1 << 16, 512);
    struct readers_header *readers = shared(readers_segment_bytes(1));
    readers_format(readers, 1);
    page->is_over = 0;
    page->count = 0;
    const pid_t pid = fork();
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        struct ring_reader r;
        struct ring_record record;
        open_reader(&r, memory, NULL);
        ring_seek(&r, 1);
        while (!page->is_over) {
            bell_arm(&readers->arrival, 0);
            if (ring_poll(&r, 0) == 0)
                sleep_at(doors[0]);
            bell_disarm(&readers->arrival);
            while (ring_poll(&r, 0) != 0 && ring_look(&r, &record) == RING_OK) {
                ring_copy_out(&r, &record, bytes);
                page->latencies[page->count++] = now_ns() - record.stamp_ns;
                ring_step(&r);
            }
        }
        _exit(0);
    }
    struct ring_writer w;
    ring_writer_attach(&w, memory);
    uint64_t rung = 0;
    for (uint64_t i = 0; i < length_ns / 1000000; i++) {
        usleep(1000);
        ring_write(&w, bytes, 64, now_ns(), 0, true);
        bell_fence();
        if (bell_is_due(&readers->arrival, &rung, 0))
            knock(doors[0]);
    }
    usleep(10000);
    page->is_over = 1;
    knock(doors[0]);
    waitpid(pid, NULL, 0);
    qsort(page->latencies, page->count, sizeof page->latencies[0], ascending);
    printf("latency into a sleeping process, 64 B at 1,000/s: median %.1f us, p99 %.1f us of %" PRIu64 "\n",
           (double)page->latencies[page->count / 2] / 1e3, (double)page->latencies[page->count * 99 / 100] / 1e3,
           page->count);
}

int main(int argc, char **argv)
{
    spins = argc > 2 ? (unsigned)strtoul(argv[2], NULL, 10) : 0;
    length_ns = (argc > 1 ? strtoull(argv[1], NULL, 10) : 500) * 1000000u;
    bytes = malloc(MOST);
    memset(bytes, 1, MOST);
    page = shared(sizeof *page);
    doors[0] = eventfd(0, 0);
    doors[1] = eventfd(0, 0);
    measure_alone(64, 1 << 20, 1000, 1);
    measure_alone(64, 1 << 20, 1000, 16);
    measure_alone(1024, 4 << 20, 1000, 1);
    measure_alone(65536, 4 << 20, 1, 1);
    measure_alone(65536, 4 << 20, 16, 1);
    measure_across(64, 1 << 20, false, COPIED);
    measure_across(64, 1 << 20, true, COPIED);
    measure_across(64, 1 << 20, true, IN_PLACE);
    measure_across(1024, 1 << 20, true, COPIED);
    measure_across(65536, 4 << 20, true, COPIED);
    measure_across(65536, 4 << 20, true, IN_PLACE);
    measure_across(1 << 20, 16 << 20, true, COPIED);
    measure_across(1 << 20, 16 << 20, true, IN_PLACE);
    measure_latency();
    return 0;
}
