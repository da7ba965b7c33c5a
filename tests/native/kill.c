/* Writers and readers killed at any instruction, many times, on one ring.
 *
 *     kill [milliseconds]
 *
 * This process takes samples of writer processes until each is killed. Then it checks that everything up to the last
 * published sample exists and is whole, and that the next writer continues from it. Reader processes that pin and hold
 * the writer back are killed, too; without their gates, the writer continues as if they had never existed.
 *
 * The same is done with a feed, while its publisher moves from ring to ring. Samples published before the kill are
 * taken once and whole. After a reader's kill, its publisher continues.
 */
#include <signal.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "check.h"

#include "../../clients/bus/shm/feed.h"

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
    struct ring_reader whole; /* checks that the ring has all its records, like an untouched ring */
    open_reader(&whole, memory, NULL);
    ring_join(&whole, UINT64_MAX);
    CHECK_EQ(whole.next, w.oldest);
    const uint64_t before = taken;
    take(&whole, UINT64_MAX);
    CHECK_EQ(taken - before, w.latest + 1 - w.oldest);
    taken = before;
}

/* The writer runs with a reader that pins, moves its lossless cursor, and dies; then its gate is removed. */
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

/* --- a feed and its publisher, which moves from ring to ring */

enum { RINGS = 4, IN_A_RING = 40, HELD = 4, KEPT = 5 };

/* The memory of both processes. */
struct world {
    void *rings[RINGS];
    struct readers_header *readers;
    _Atomic int *announced; /* number of rings that the reader may know */
};

/* A feed, with the records that its reader holds in place. */
struct reading {
    struct feed feed;
    int rings; /* number of rings that it knows */
    uint64_t taken;
    bool is_held[HELD];
    unsigned pins[HELD];
    struct ring_record held[HELD];
};

static struct world new_world(void)
{
    struct world world = {.readers = shared(readers_segment_bytes(1)), .announced = shared(sizeof(_Atomic int))};
    readers_format(world.readers, 1);
    for (int i = 0; i < RINGS; i++)
        world.rings[i] = shared(ring_segment_bytes(CAPACITY, INDEX));
    ring_format(world.rings[0], CAPACITY, INDEX, 1);
    atomic_store(world.announced, 1);
    return world;
}

static void free_world(struct world *world)
{
    for (int i = 0; i < RINGS; i++)
        munmap(world->rings[i], ring_segment_bytes(CAPACITY, INDEX));
    munmap(world->readers, readers_segment_bytes(1));
    munmap(world->announced, sizeof(_Atomic int));
}

static void leave(struct feed_ring *ring) { free(ring); }

static struct feed_ring *map(const void *memory)
{
    struct feed_ring *ring = calloc(1, sizeof *ring);
    if (ring == NULL)
        FAIL("no memory");
    CHECK(ring_check(memory, UINT64_MAX, &ring->geometry) == NULL);
    ring->memory = memory;
    ring->leave = leave;
    return ring;
}

static void start_reading(struct reading *r, const struct world *world)
{
    *r = (struct reading){.rings = 1};
    feed_attach(&r->feed, map(world->rings[0]), readers_slots(world->readers), 4711);
    CHECK(feed_begin(&r->feed, 1));
}

static void follow(struct reading *r, const struct world *world)
{
    while (r->rings < atomic_load(world->announced))
        CHECK(feed_extend(&r->feed, map(world->rings[r->rings++])));
}

static void let_go(struct reading *r, uint64_t which)
{
    if (!r->is_held[which])
        return;
    const struct ring_record *record = &r->held[which];
    if (!is_filled(record->payload, record->seq, record->size))
        FAIL("sample %" PRIu64 " was overwritten while it was held", record->seq);
    ring_unpin(r->feed.ring.slot, r->pins[which]);
    r->is_held[which] = false;
}

static void take_head(struct reading *r)
{
    const struct ring_record record = r->feed.head;
    const uint64_t which = record.seq % HELD;
    const unsigned char *payload = record.payload;
    CHECK_EQ(record.seq, r->feed.ring.next);
    CHECK_EQ(record.size, sample_size(record.seq, MOST));
    let_go(r, which);
    enum ring_status status = feed_pin(&r->feed, 0, &record, &r->pins[which]);
    if (status == RING_OK) {
        r->is_held[which] = true;
        r->held[which] = record;
    } else if (status == RING_PINNED) {
        status = feed_copy(&r->feed, 0, &record, bytes);
        payload = bytes;
    }
    if (status != RING_OK)
        return;
    if (!is_filled(payload, record.seq, record.size))
        FAIL("sample %" PRIu64 " is torn", record.seq);
    r->taken++;
}

static void take_by_feed(struct reading *r, uint64_t most)
{
    enum ring_status status = RING_EMPTY;
    feed_poll(&r->feed, 0);
    while (most-- != 0 && (status = feed_head(&r->feed, 0)) == RING_OK)
        take_head(r);
    if (status == RING_CORRUPT)
        FAIL("sample %" PRIu64 " is corrupt", r->feed.ring.next);
    for (uint64_t i = 0; status == RING_EMPTY && i < HELD; i++)
        let_go(r, i); /* the publisher may wait for the place of the record */
    feed_show_cursor(&r->feed);
}

/* Begins to publish, with one gate, for the slot of the feed. */
static void start_publishing(struct ring_writer *w, struct reading_process *process, const struct world *world,
                             bool is_lossless)
{
    *process = (struct reading_process){
        .arrival = &world->readers->arrival,
        .slots = readers_slots(world->readers),
        .slot_count = 1,
    };
    ring_writer_attach(w, world->rings[0]);
    CHECK(ring_add_gate(w, 1, process, 0, is_lossless));
}

/* Publishes the next sample, and sometimes continues in another ring. Not RING_OK: there is no room for now. */
static enum ring_status publish(struct ring_writer *w, const struct world *world)
{
    const uint64_t seq = w->latest + 1;
    const uint32_t size = sample_size(seq, MOST);
    const int ring = atomic_load(world->announced);
    if (ring < RINGS && seq > IN_A_RING * (uint64_t)ring) {
        struct ring_writer fresh;
        ring_format(world->rings[ring], CAPACITY, INDEX, ring_carry_from(w, KEPT));
        ring_writer_attach(&fresh, world->rings[ring]);
        CHECK_EQ(ring_carry(&fresh, w), RING_OK);
        ring_go_on(w, &fresh);
        atomic_store(world->announced, ring + 1);
    }
    fill(bytes, seq, size);
    return ring_write(w, bytes, size, 0, 0, true);
}

/* Kills a publisher; returns the number of samples taken. */
static uint64_t kill_a_publisher(uint64_t after_ns, bool is_lossless)
{
    struct world world = new_world();
    struct reading r;
    start_reading(&r, &world);
    const uint64_t end = now_ns() + after_ns;
    const pid_t pid = fork();
    if (pid == 0) {
        struct ring_writer w;
        struct reading_process process;
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        start_publishing(&w, &process, &world, is_lossless);
        for (;;)
            publish(&w, &world);
    }
    while (now_ns() < end) {
        follow(&r, &world);
        take_by_feed(&r, 100);
    }
    kill(pid, SIGKILL);
    int how = 0;
    waitpid(pid, &how, 0);
    CHECK(WIFSIGNALED(how));
    follow(&r, &world);
    feed_finish(&r.feed);
    take_by_feed(&r, UINT64_MAX);
    const struct ring_header *last = world.rings[r.rings - 1];
    CHECK_EQ(r.feed.ring.next, last->latest + 1);
    CHECK_EQ(r.taken + r.feed.ring.overrun, last->latest);
    if (is_lossless)
        CHECK_EQ(r.feed.ring.overrun, 0);
    feed_close(&r.feed, true);
    free_world(&world);
    return r.taken;
}

static void kill_a_feed(uint64_t after_ns)
{
    struct world world = new_world();
    struct reading r;
    struct ring_writer w;
    struct reading_process process;
    start_reading(&r, &world);
    start_publishing(&w, &process, &world, true);
    const uint64_t end = now_ns() + after_ns;
    const pid_t pid = fork();
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        for (;;) {
            follow(&r, &world);
            take_by_feed(&r, 100);
        }
    }
    while (now_ns() < end)
        publish(&w, &world);
    kill(pid, SIGKILL);
    int how = 0;
    waitpid(pid, &how, 0);
    CHECK(WIFSIGNALED(how));
    enum ring_status status = RING_OK;
    for (int i = 0; i < RINGS * IN_A_RING + 1000 && status == RING_OK; i++)
        status = publish(&w, &world);
    CHECK(status == RING_FULL || status == RING_PINNED);
    CHECK(ring_remove_gate(&w, gates_find(&w.gates, 1)) == &process);
    for (int i = 0; i < RINGS * IN_A_RING; i++)
        CHECK_EQ(publish(&w, &world), RING_OK);
    gates_free(&w.gates);
    feed_close(&r.feed, false);
    free_world(&world);
}

int main(int argc, char **argv)
{
    const uint64_t end = now_ns() + (argc > 1 ? strtoull(argv[1], NULL, 10) : 1000) * 1000000u;
    void *memory = shared(ring_segment_bytes(CAPACITY, INDEX));
    ring_format(memory, CAPACITY, INDEX, 1);
    struct ring_reader r;
    open_reader(&r, memory, NULL);
    ring_join(&r, 0);
    uint64_t rounds = 0, fed = 0, state = (uint64_t)getpid();
    while (now_ns() < end) {
        kill_a_writer(memory, &r, random_next(&state) % 1500000);
        kill_a_reader(random_next(&state) % 1500000);
        fed += kill_a_publisher(random_next(&state) % 1500000, rounds % 2);
        kill_a_feed(random_next(&state) % 1500000);
        rounds++;
    }
    CHECK_EQ(taken + r.overrun, r.next - 1);
    printf("kill: %" PRIu64 " writers and readers killed, %" PRIu64 " samples taken, %" PRIu64 " overrun, %" PRIu64
           " by feeds\n",
           rounds, taken, r.overrun, fed);
    return 0;
}
