/* One writer and three readers that sleep, lose, pin and follow a growing ring, with every payload checked.
 *
 *     stress threads|processes lossy|lossless [milliseconds]
 *
 * A shared page stands for the broker: it has the number of rings, and a flag for the writer's end. At the end, this is
 * true for each reader: taken + overrun + replaced = published. Ends with status 3 on any violation.
 */
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"

enum { READERS = 3, RINGS = 5, MOST = 3000, INDEX = 128, FIRST_CAPACITY = 16384, LEAST = 2000, WATCHDOG_MS = 5000, PATIENCE_MS = 20000 };

static struct broker {
    _Atomic uint64_t ring_count, is_done, published;
    _Atomic bool has_slept, has_pinned; /* stored relaxed, not to stand in for a fence that a broken build lacks */
    struct result {
        uint64_t taken, overrun, replaced, sleeps, pinned, pins_late;
    } results[READERS];
} *broker;

static int ring_fds[RINGS], slot_fds[READERS], reader_doors[READERS], writer_door;
static void *writer_memory[RINGS], *reader_memory[READERS];
static bool is_lossless, has_processes;

static uint64_t capacity_of(int ring) { return (uint64_t)FIRST_CAPACITY << ring; }
static uint64_t bytes_of(int ring) { return ring_segment_bytes(capacity_of(ring), INDEX); }

static void *map(int fd, uint64_t bytes, int protection)
{
    void *memory = mmap(NULL, bytes, protection, MAP_SHARED, fd, 0);
    if (memory == MAP_FAILED)
        FAIL("mmap: %m");
    return memory;
}

static void knock(int door)
{
    const uint64_t one = 1;
    if (write(door, &one, sizeof one) != sizeof one)
        FAIL("eventfd: %m");
}

/* Sleeps until a ring. False: no process has rung for so long that a wake-up must be lost. */
static bool sleep_at(int door)
{
    struct pollfd set = {.fd = door, .events = POLLIN};
    uint64_t count;
    return poll(&set, 1, WATCHDOG_MS) == 1 && read(door, &count, sizeof count) == sizeof count;
}

/* ---- reader ---- */

struct held {
    const void *payload;
    uint64_t seq;
    uint32_t size;
};

static struct ring_reader open_ring(int ring, struct reader_slot *slot)
{
    struct ring_reader r;
    struct ring_geometry geometry;
    const void *memory = writer_memory[ring];
    if (has_processes) {
        if (mmap(NULL, bytes_of(ring), PROT_READ | PROT_WRITE, MAP_SHARED, ring_fds[ring], 0) != MAP_FAILED)
            FAIL("a reader can write to a ring");
        memory = map(ring_fds[ring], bytes_of(ring), PROT_READ);
    }
    const char *wrong = ring_check(memory, bytes_of(ring), &geometry);
    if (wrong != NULL)
        FAIL("%s", wrong);
    ring_reader_attach(&r, memory, &geometry, slot);
    return r;
}

static void let_go(struct reader_slot *slot, struct held *held, unsigned pin)
{
    if (held[pin].payload == NULL)
        return;
    if (!is_filled(held[pin].payload, held[pin].seq, held[pin].size))
        FAIL("sample %" PRIu64 " changed while it was pinned", held[pin].seq);
    held[pin].payload = NULL;
    ring_unpin(slot, pin);
}

static void run_reader(int me)
{
    static const uint64_t depths[READERS] = {0, 10, 0};
    unsigned char *bytes = malloc(MOST);
    struct readers_header *segment = reader_memory[me]; /* threads share mappings: the sanitizer needs that */
    if (has_processes)
        segment = map(slot_fds[me], readers_segment_bytes(1), PROT_READ | PROT_WRITE);
    struct reader_slot *slot = readers_slots(segment);
    struct held held[READER_PINS] = {{0}};
    struct result result = {0};
    int ring = 0;
    struct ring_reader r = open_ring(ring, slot);
    ring_seek(&r, 1);
    uint64_t state = (uint64_t)me + 11;
    for (;;) {
        const uint64_t depth = is_lossless ? 0 : depths[me];
        while (ring_poll(&r, depth) != 0) {
            for (uint64_t batch = random_next(&state) % 64 + 1; batch != 0; batch--) {
                struct ring_record record;
                unsigned pin = 0;
                enum ring_status status = ring_look(&r, &record);
                if (status == RING_CORRUPT)
                    FAIL("sample %" PRIu64 " is corrupt", r.next);
                if (status != RING_OK)
                    break;
                if (record.size != sample_size(record.seq, MOST) || record.stamp_ns != record.seq * 3
                    || record.flags != (uint32_t)record.seq)
                    FAIL("sample %" PRIu64 " has a wrong head", record.seq);
                const bool wants_pin = me == 2 && random_next(&state) % 2 == 0;
                if (wants_pin) {
                    let_go(slot, held, (unsigned)(random_next(&state) % READER_PINS));
                    status = ring_pin(&r, &record, &pin);
                    result.pins_late += status == RING_OVERRUN;
                }
                if (wants_pin && status == RING_OK) {
                    held[pin] = (struct held){record.payload, record.seq, record.size};
                    result.pinned++;
                    atomic_store_explicit(&broker->has_pinned, true, memory_order_relaxed);
                } else if (status == RING_OVERRUN || ring_copy_out(&r, &record, bytes) == RING_OVERRUN) {
                    break;
                } else if (!is_filled(bytes, record.seq, record.size)) {
                    FAIL("sample %" PRIu64 " is torn", record.seq);
                }
                ring_step(&r);
                result.taken++;
            }
            ring_tell_cursor(&r);
            if (is_lossless && ring_room_is_due(&r))
                knock(writer_door);
            if (me == 0 && random_next(&state) % 64 == 0)
                usleep(300);
        }
        for (unsigned pin = 0; pin < READER_PINS; pin++)
            let_go(slot, held, pin);
        if (ring_is_finished(&r)) {
            if (broker->ring_count > (uint64_t)ring + 1) {
                const struct ring_reader old = r;
                r = open_ring(++ring, slot);
                ring_seek(&r, old.next);
                r.overrun = old.overrun;
                r.replaced = old.replaced;
                continue;
            }
            if (broker->is_done)
                break;
        }
        bell_arm(&segment->arrival, 0);
        if (ring_poll(&r, depth) == 0 && !(ring_is_finished(&r) && broker->ring_count > (uint64_t)ring + 1)) {
            result.sleeps++;
            atomic_store_explicit(&broker->has_slept, true, memory_order_relaxed);
            if (!sleep_at(reader_doors[me]))
                FAIL("reader %d slept too long; %" PRIu64 " samples wait", me, ring_poll(&r, 0));
        }
        bell_disarm(&segment->arrival);
    }
    result.overrun = r.overrun;
    result.replaced = r.replaced;
    broker->results[me] = result;
    free(bytes);
}

/* ---- writer ---- */

static struct ring_gate gates[READERS];
static uint64_t rung[READERS], rings, waits, pinned, pauses;

static void open_gates(struct ring_writer *w)
{
    for (int i = 0; i < READERS; i++)
        gates[i] = (struct ring_gate){.slot = readers_slots(reader_memory[i]), .is_lossless = is_lossless};
    w->gates.list = gates;
    w->gates.count = READERS;
    ring_gates_changed(w);
}

static void ring_readers(bool all)
{
    bell_fence();
    for (int i = 0; i < READERS; i++) {
        const struct readers_header *segment = reader_memory[i];
        if (bell_is_due(&segment->arrival, &rung[i], 0) || all) {
            knock(reader_doors[i]);
            rings++;
        }
    }
}

static void grow(struct ring_writer *w, int ring)
{
    const struct ring_writer old = *w;
    ring_format(writer_memory[ring], capacity_of(ring), INDEX, ring_carry_from(&old, 20));
    ring_writer_attach(w, writer_memory[ring]);
    if (ring_carry(w, &old) != RING_OK || w->latest != old.latest)
        FAIL("carrying failed");
    open_gates(w);
    struct ring_writer last = old;
    ring_close(&last);
    broker->ring_count = (uint64_t)ring + 1;
    ring_readers(true);
}

/* On a busy machine readers may get no turn for a while, so the writer goes on until there is something to judge. */
static bool has_happened(void)
{
    return atomic_load_explicit(&broker->has_slept, memory_order_relaxed)
           && atomic_load_explicit(&broker->has_pinned, memory_order_relaxed);
}

static void run_writer(uint64_t milliseconds)
{
    unsigned char *bytes = malloc(MOST);
    struct ring_writer w;
    ring_writer_attach(&w, writer_memory[0]);
    open_gates(&w);
    const uint64_t begin = now_ns(), length = milliseconds * 1000000u;
    uint64_t state = 3, seq = 1, now = begin, last_progress = begin;
    int ring = 0;
    fill(bytes, seq, sample_size(seq, MOST));
    const uint64_t patience = PATIENCE_MS * UINT64_C(1000000);
    while (now - begin < length || seq <= LEAST || (!has_happened() && now - begin < patience)) {
        const enum ring_status status =
            ring_write(&w, bytes, sample_size(seq, MOST), seq * 3, (uint32_t)seq, true);
        if (status == RING_OK) {
            if (w.latest != seq)
                FAIL("sample %" PRIu64 " got number %" PRIu64, seq, w.latest);
            ring_readers(false);
            seq++;
            fill(bytes, seq, sample_size(seq, MOST));
            last_progress = now;
        } else if (status == RING_FULL) {
            if (ring_wait_for_room(&w)) {
                waits++;
                if (!sleep_at(writer_door))
                    FAIL("writer slept too long");
                bell_disarm(&w.header->room);
            }
        } else {
            CHECK_EQ(status, RING_PINNED);
            pinned++;
            sched_yield();
        }
        if (random_next(&state) % 64 == 0) {
            usleep((useconds_t)(random_next(&state) % 200));
            pauses++;
        }
        now = now_ns();
        if (now - last_progress > WATCHDOG_MS * UINT64_C(1000000))
            FAIL("writer makes no progress");
        if (ring + 1 < RINGS && now - begin > length * ((uint64_t)ring + 1) / RINGS)
            grow(&w, ++ring);
    }
    broker->published = seq - 1;
    ring_close(&w);
    broker->is_done = 1;
    ring_readers(true);
    free(bytes);
}

static void *reader_thread(void *me)
{
    run_reader((int)(intptr_t)me);
    return NULL;
}

int main(int argc, char **argv)
{
    if (argc < 3)
        return 2;
    has_processes = strcmp(argv[1], "processes") == 0;
    is_lossless = strcmp(argv[2], "lossless") == 0;
    const uint64_t milliseconds = argc > 3 ? strtoull(argv[3], NULL, 10) : 1000;
    broker = mmap(NULL, sizeof *broker, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    broker->ring_count = 1;
    writer_door = eventfd(0, EFD_CLOEXEC);
    for (int i = 0; i < RINGS; i++) {
        ring_fds[i] = memfd_create("ring", MFD_CLOEXEC | MFD_ALLOW_SEALING);
        CHECK_EQ(posix_fallocate(ring_fds[i], 0, (off_t)bytes_of(i)), 0);
        writer_memory[i] = map(ring_fds[i], bytes_of(i), PROT_READ | PROT_WRITE);
        CHECK_EQ(fcntl(ring_fds[i], F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_FUTURE_WRITE), 0);
    }
    ring_format(writer_memory[0], capacity_of(0), INDEX, 1);
    for (int i = 0; i < READERS; i++) {
        const uint64_t bytes = readers_segment_bytes(1);
        reader_doors[i] = eventfd(0, EFD_CLOEXEC);
        slot_fds[i] = memfd_create("readers", MFD_CLOEXEC);
        CHECK_EQ(posix_fallocate(slot_fds[i], 0, (off_t)bytes), 0);
        reader_memory[i] = map(slot_fds[i], bytes, PROT_READ | PROT_WRITE);
        readers_format(reader_memory[i], 1);
        atomic_init(&readers_slots(reader_memory[i])->cursor, 1);
        if (has_processes && mprotect(reader_memory[i], 4096, PROT_READ) != 0)
            FAIL("mprotect: %m");
    }
    pthread_t threads[READERS];
    pid_t pids[READERS];
    for (int i = 0; i < READERS; i++) {
        if (!has_processes) {
            pthread_create(&threads[i], NULL, reader_thread, (void *)(intptr_t)i);
        } else if ((pids[i] = fork()) == 0) {
            prctl(PR_SET_PDEATHSIG, SIGKILL);
            run_reader(i);
            _exit(0);
        }
    }
    run_writer(milliseconds);
    for (int i = 0; i < READERS; i++) {
        int status = 0;
        if (!has_processes)
            pthread_join(threads[i], NULL);
        else
            waitpid(pids[i], &status, 0);
        CHECK_EQ(status, 0);
    }
    const uint64_t published = broker->published;
    uint64_t lost = 0, sleeps = 0;
    printf("%s %s: published %" PRIu64 ", rung %" PRIu64 ", writer waited %" PRIu64 ", found no room for pins %" PRIu64
           ", pauses %" PRIu64 "\n", argv[1], argv[2], published, rings, waits, pinned, pauses);
    for (int i = 0; i < READERS; i++) {
        const struct result r = broker->results[i];
        printf("  reader %d: taken %" PRIu64 ", overrun %" PRIu64 ", replaced %" PRIu64 ", sleeps %" PRIu64
               ", pinned %" PRIu64 ", pins too late %" PRIu64 "\n",
               i, r.taken, r.overrun, r.replaced, r.sleeps, r.pinned, r.pins_late);
        CHECK_EQ(r.taken + r.overrun + r.replaced, published);
        lost += r.overrun + r.replaced;
        sleeps += r.sleeps;
    }
    if (is_lossless)
        CHECK_EQ(lost, 0);
    else
        CHECK(lost > 0);
    CHECK(sleeps > 0 && broker->results[2].pinned > 0 && published >= LEAST);
    return 0;
}
