/* Writers and readers killed at any instruction, many times, on one ring.
 *
 *     kill [milliseconds]
 *
 * This process takes what writer processes publish until each is killed, and then checks: everything up to the
 * last published sample is there and whole, and the next writer goes on from it. Reader processes that pin and
 * hold the writer back are killed too; without their gates, it writes on as if they had never been.
 */
#include <signal.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"

enum { CAPACITY = 1 << 16, INDEX = 512, MOST = 8000 };

static unsigned char bytes[MOST];
static uint64_t taken;

static void *shared(uint64_t size)
{
    void *memory = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (memory == MAP_FAILED)
        FAIL("mmap: %m");
    return memory;
}

static void write_for_ever(void *memory)
{
    unsigned char *sample = malloc(MOST);
    struct ring_writer w;
    ring_writer_attach(&w, memory);
    for (;;) {
        const uint64_t seq = w.latest + 1;
        fill(sample, seq, sample_size(seq, MOST));
        ring_write(&w, sample, sample_size(seq, MOST), 0, 0, true);
    }
}

static void take(struct ring_reader *r, uint64_t most)
{
    struct ring_record record;
    for (; most != 0 && ring_poll(r, 0) != 0; most--) {
        const enum ring_status status = ring_look(r, &record);
        if (status == RING_CORRUPT)
            FAIL("sample %" PRIu64 " is corrupt", r->next);
        if (status != RING_OK)
            continue;
        CHECK_EQ(record.size, sample_size(record.seq, MOST));
        if (ring_copy_out(r, &record, bytes) != RING_OK)
            continue;
        if (!is_filled(bytes, record.seq, record.size))
            FAIL("sample %" PRIu64 " is torn", record.seq);
        ring_step(r);
        taken++;
    }
}

static void kill_a_writer(void *memory, struct ring_reader *r, uint64_t after_ns)
{
    const uint64_t end = now_ns() + after_ns;
    const pid_t pid = fork();
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        write_for_ever(memory);
    }
    while (now_ns() < end)
        take(r, 100);
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
    take(r, UINT64_MAX);
    struct ring_writer w;
    ring_writer_attach(&w, memory);
    CHECK_EQ(r->next, w.latest + 1);
    struct ring_reader whole; /* what an untouched ring holds, the killed one holds */
    open_reader(&whole, memory, NULL);
    ring_join(&whole, UINT64_MAX);
    CHECK_EQ(whole.next, w.oldest);
    const uint64_t before = taken;
    take(&whole, UINT64_MAX);
    CHECK_EQ(taken - before, w.latest + 1 - w.oldest);
    taken = before;
}

/* The writer runs beside a reader that pins, moves its lossless cursor, and dies; then the gate is taken away. */
static void kill_a_reader(uint64_t after_ns)
{
    void *memory = shared(ring_segment_bytes(CAPACITY, INDEX));
    struct readers_header *readers = shared(readers_segment_bytes(1));
    ring_format(memory, CAPACITY, INDEX, 1);
    readers_format(readers, 1);
    struct reader_slot *slot = readers_slots(readers);
    struct ring_gate gate = {.slot = slot, .is_lossless = true};
    struct ring_writer w;
    struct ring_reader r;
    struct ring_record record;
    ring_writer_attach(&w, memory);
    open_reader(&r, memory, slot);
    ring_join(&r, 0);
    ring_tell_cursor(&r);
    w.gates.list = &gate;
    w.gates.count = 1;
    ring_gates_changed(&w);
    const pid_t pid = fork();
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        for (unsigned pin = 0, pins[4] = {99, 99, 99, 99};; pin = (pin + 1) % 4) {
            while (ring_poll(&r, 0) == 0)
                ;
            if (pins[pin] != 99)
                ring_unpin(slot, pins[pin]);
            if (ring_look(&r, &record) != RING_OK || ring_pin(&r, &record, &pins[pin]) != RING_OK)
                _exit(FORBIDDEN);
            ring_step(&r);
            ring_tell_cursor(&r);
            if (!is_filled(record.payload, record.seq, record.size))
                _exit(FORBIDDEN);
        }
    }
    const uint64_t end = now_ns() + after_ns;
    enum ring_status status = RING_OK;
    while (now_ns() < end) {
        const uint64_t seq = w.latest + 1;
        fill(bytes, seq, sample_size(seq, 4000));
        status = ring_write(&w, bytes, sample_size(seq, 4000), 0, 0, true);
        CHECK(status == RING_OK || status == RING_FULL || status == RING_PINNED);
    }
    kill(pid, SIGKILL);
    int how = 0;
    waitpid(pid, &how, 0);
    CHECK(WIFSIGNALED(how));
    for (int i = 0; i < 1000 && status == RING_OK; i++)
        status = ring_write(&w, bytes, 500, 0, 0, true);
    CHECK_EQ(status, RING_FULL);
    w.gates.count = 0;
    ring_gates_changed(&w);
    for (int i = 0; i < 1000; i++)
        CHECK_EQ(ring_write(&w, bytes, 500, 0, 0, true), RING_OK);
    munmap(memory, ring_segment_bytes(CAPACITY, INDEX));
    munmap(readers, readers_segment_bytes(1));
}

int main(int argc, char **argv)
{
    const uint64_t end = now_ns() + (argc > 1 ? strtoull(argv[1], NULL, 10) : 1000) * 1000000u;
    void *memory = shared(ring_segment_bytes(CAPACITY, INDEX));
    ring_format(memory, CAPACITY, INDEX, 1);
    struct ring_reader r;
    open_reader(&r, memory, NULL);
    ring_join(&r, 0);
    uint64_t rounds = 0, state = (uint64_t)getpid();
    while (now_ns() < end) {
        kill_a_writer(memory, &r, random_next(&state) % 1500000);
        kill_a_reader(random_next(&state) % 1500000);
        rounds++;
    }
    CHECK_EQ(taken + r.overrun, r.next - 1);
    printf("kill: %" PRIu64 " writers and readers killed, %" PRIu64 " samples taken, %" PRIu64 " overrun\n",
           rounds, taken, r.overrun);
    return 0;
}
