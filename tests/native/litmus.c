/* Litmus tests: two threads meet in a few instructions, many times; each outcome is allowed or forbidden.
 *
 *     litmus [name] [milliseconds for each]
 *
 * Ends with status 3 at the first forbidden outcome. Built with BROKEN_NO_FENCE, BROKEN_NO_VALIDATE or
 * BROKEN_EARLY_ADMIT, the tests of the missing part must end with that status, which proves that they detect the fault.
 */
#include <pthread.h>
#include <sched.h>

#include "check.h"

enum { CAPACITY = 4096, INDEX = 64, OUTCOMES = 6 };

static void *memory;
static struct ring_writer w;
static struct ring_reader r;
static struct ring_gate gate;
static struct ring_record record;
static struct readers_header *readers;
static uint64_t rung;
static unsigned pin;
static unsigned char sent[1024], got[1024];

static void put(uint32_t size)
{
    fill(sent, w.latest + 1, size);
    if (ring_write(&w, sent, size, 0, 0, true) == RING_TOO_LARGE)
        FAIL("too large");
}

static void start(bool is_lossless)
{
    memory = new_ring(CAPACITY, INDEX, 1);
    readers = zeroed(readers_segment_bytes(1));
    readers_format(readers, 1);
    ring_writer_attach(&w, memory);
    gate = (struct ring_gate){.slot = readers_slots(readers), .is_lossless = is_lossless};
    w.gates.list = &gate;
    w.gates.count = 1;
    open_reader(&r, memory, readers_slots(readers));
    ring_join(&r, 0);
    ring_tell_cursor(&r);
    ring_gates_changed(&w);
    rung = 0;
}

static void delay(int64_t steps)
{
    for (volatile int64_t i = steps; i > 0; i--)
        ;
}

/* sleep: publish and check for a sleeper | fall asleep and check for a sample */
static void prepare_sleep(void)
{
    void *payload;
    bell_disarm(&readers->arrival);
    r.next = w.latest + 1;
    ring_reserve(&w, 8, true, &payload);
}
static int left_sleep(void)
{
    ring_publish(&w, 8, 0, 0);
    bell_fence();
    return bell_is_due(&readers->arrival, &rung, 0);
}
static int right_sleep(void)
{
    bell_arm(&readers->arrival, 0);
    return ring_poll(&r, 0) != 0;
}

/* pin: drop the oldest record and check for pins | pin it and check whether it was dropped */
static void prepare_pin(void)
{
    atomic_store_explicit(&readers_slots(readers)->pins[0], 0, memory_order_relaxed);
    do
        put(96);
    while (w.oldest == 1 || w.gates.hole_count != 0);
    r.next = w.oldest;
    ring_poll(&r, 0);
    CHECK_EQ(ring_look(&r, &record), RING_OK);
}
static int left_pin(void)
{
    void *payload;
    CHECK_EQ(ring_reserve(&w, 96, true, &payload), RING_OK);
    return payload == record.payload; /* the former place of the oldest record */
}
static int right_pin(void) { return ring_pin(&r, &record, &pin) == RING_OK; }

/* admit: drop a record without the gate, add the gate and show its ticket, drop the next record | pin one of the two
 * records, when the ticket is shown */
static uint32_t ticket;
static void prepare_admit(void)
{
    struct reader_slot *slot = readers_slots(readers);
    atomic_store_explicit(&slot->pins[0], 0, memory_order_relaxed);
    gate = (struct ring_gate){.slot = slot};
    w.gates.count = 0;
    ring_gates_changed(&w);
    for (int i = 0; i < CAPACITY / 128; i++) /* removes gaps of earlier pins */
        put(96);
    ring_ask(slot, ++ticket);
    r.next = w.oldest + ticket % 2;
    ring_poll(&r, 0);
    CHECK_EQ(ring_look(&r, &record), RING_OK);
}
static int left_admit(void)
{
    void *first, *second;
#ifdef BROKEN_EARLY_ADMIT
    ring_admit(&w, &gate);
#endif
    CHECK_EQ(ring_reserve(&w, 96, true, &first), RING_OK);
    ring_publish(&w, 96, 0, 0);
    w.gates.count = 1;
    ring_gates_changed(&w);
    ring_admit(&w, &gate);
    delay(mix(ticket) % 256);
    CHECK_EQ(ring_reserve(&w, 96, true, &second), RING_OK);
    return first == record.payload || second == record.payload;
}
static int right_admit(void)
{
    for (int tries = 0; !ring_is_admitted(&r, ticket); tries++)
        if (tries == 40)
            return 0;
    ring_unpin(r.slot, READER_PINS - 1);
    return ring_pin(&r, &record, &pin) == RING_OK;
}

/* room: fall asleep and check the cursor | move the cursor and check for the sleeping writer */
static void prepare_room(void)
{
    bell_disarm(&w.header->room);
    while (ring_write(&w, sent, 96, 0, 0, true) == RING_OK)
        ;
    r.next = w.latest + 1;
}
static int left_room(void) { return ring_wait_for_room(&w); }
static int right_room(void)
{
    ring_tell_cursor(&r);
    return ring_room_is_due(&r);
}

/* message: publish | take the published record */
static void prepare_message(void) { r.next = w.latest + 1; }
static int left_message(void)
{
    put(200);
    return 0;
}
static int take_one(void)
{
    ring_poll(&r, 0);
    enum ring_status status = ring_look(&r, &record);
    if (status == RING_OK)
        status = ring_copy_out(&r, &record, got);
    if (status == RING_OK)
        return record.seq == r.next && is_filled(got, record.seq, record.size) ? 1 : 2;
    return status == RING_CORRUPT ? 2 : 0;
}

/* torn: lap the reader | take a record that is being overwritten */
static void prepare_torn(void)
{
    put(900);
    r.next = w.oldest;
}
static int left_torn(void)
{
    for (int i = 0; i < 6; i++)
        put(900);
    return 0;
}

static const struct litmus {
    const char *name;
    bool is_lossless;
    void (*prepare)(void);
    int (*left)(void), (*right)(void);
    const char *outcomes[OUTCOMES]; /* by 3 * left + right; a leading '!' means forbidden */
} litmuses[] = {
    {"sleep", false, prepare_sleep, left_sleep, right_sleep,
     {"!lost: neither rung nor seen", "seen", NULL, "rung", "both"}},
    {"pin", false, prepare_pin, left_pin, right_pin,
     {"neither: lost, but its place unused", "pinned", NULL, "overwritten", "!pinned and overwritten"}},
    {"admit", false, prepare_admit, left_admit, right_admit,
     {"neither: lost, but its place unused", "pinned", NULL, "overwritten", "!pinned and overwritten"}},
    {"room", true, prepare_room, left_room, right_room,
     {"writer saw the room", "writer saw the room and is rung", NULL, "!lost: writer sleeps, not rung", "rung"}},
    {"message", false, prepare_message, left_message, take_one, {"not yet", "whole", "!not what was sent"}},
    {"torn", false, prepare_torn, left_torn, take_one, {"overrun", "whole", "!torn"}},
};

static const struct litmus *litmus;
static _Atomic uint64_t right_round, right_done, is_over;
static int right_result;

static void wait_until(_Atomic uint64_t *word, uint64_t value)
{
    for (unsigned spins = 0; atomic_load_explicit(word, memory_order_acquire) != value; spins++)
        if (spins % 4096 == 4095)
            sched_yield();
}

/* A delay of the right side (negative: of the left side) that changes sometimes, plus jitter. So the sides meet in
 * every order. */
static int64_t offset(uint64_t round) { return (int64_t)(mix(round / 512) % 1600) - 1300; }

static size_t processors[2];

/* Finds the first two processors that this process may use; false if there is only one. */
static bool find_processors(void)
{
    cpu_set_t allowed;
    size_t found = 0;
    sched_getaffinity(0, sizeof allowed, &allowed);
    for (size_t cpu = 0; cpu < CPU_SETSIZE && found < 2; cpu++)
        if (CPU_ISSET(cpu, &allowed))
            processors[found++] = cpu;
    return found == 2;
}

/* On one processor, a switch from one side to the other would order everything. */
static void stay_on(size_t cpu)
{
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(cpu, &set);
    pthread_setaffinity_np(pthread_self(), sizeof set, &set);
}

static void *run_right(void *unused)
{
    stay_on(processors[1]);
    uint64_t state = 99;
    for (uint64_t round = 1;; round++) {
        wait_until(&right_round, round);
        if (is_over)
            return unused;
        delay(offset(round) + (int64_t)(random_next(&state) % 16));
        right_result = litmus->right();
        atomic_store_explicit(&right_done, round, memory_order_release);
    }
}

static void run(const struct litmus *which, uint64_t milliseconds)
{
    uint64_t counts[OUTCOMES] = {0}, state = 7, round = 0;
    pthread_t thread;
    litmus = which;
    right_round = right_done = is_over = 0;
    start(litmus->is_lossless);
    pthread_create(&thread, NULL, run_right, NULL);
    const uint64_t end = now_ns() + milliseconds * 1000000u;
    int forbidden = -1;
    while (forbidden < 0 && (round % 256 != 0 || now_ns() < end)) {
        litmus->prepare();
        atomic_store_explicit(&right_round, ++round, memory_order_release);
        delay((int64_t)(random_next(&state) % 16) - offset(round));
        const int left = litmus->left();
        wait_until(&right_done, round);
        const int outcome = 3 * left + right_result;
        counts[outcome]++;
        if (litmus->outcomes[outcome] == NULL || litmus->outcomes[outcome][0] == '!')
            forbidden = outcome;
    }
    is_over = 1;
    atomic_store_explicit(&right_round, round + 1, memory_order_release);
    pthread_join(thread, NULL);
    printf("%s, %" PRIu64 " rounds:", litmus->name, round);
    for (int i = 0; i < OUTCOMES; i++)
        if (litmus->outcomes[i] != NULL)
            printf("%s %s %" PRIu64, i ? ";" : "", litmus->outcomes[i], counts[i]);
    puts("");
    free(memory);
    free(readers);
    if (forbidden >= 0)
        exit(FORBIDDEN);
}

int main(int argc, char **argv)
{
    const uint64_t milliseconds = argc > 2 ? strtoull(argv[2], NULL, 10) : 500;
    const char *name = argc > 1 ? argv[1] : "all";
    size_t ran = 0;
    if (!find_processors()) {
        puts("litmus: skipped, needs two processors");
        return SKIPPED;
    }
    stay_on(processors[0]);
    for (size_t i = 0; i < sizeof litmuses / sizeof *litmuses; i++)
        if (strcmp(name, "all") == 0 || strcmp(name, litmuses[i].name) == 0) {
            run(&litmuses[i], milliseconds);
            ran++;
        }
    return ran == 0;
}
