/* A process with many rings checks only the ring that a knock names; wakers wait until it has seen their samples.
 *
 *     knock [milliseconds]
 *
 * Counters stand for rings, and threads for processes. Ends with status 3 if a published sample is not seen. Built with
 * BROKEN_ONE_KNOCK or BROKEN_NO_FENCE, it must end with that status, which proves that it detects the fault.
 */
#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "check.h"

#ifdef BROKEN_ONE_KNOCK
#define IS_BROKEN true
#else
#define IS_BROKEN false
#endif

enum { WAKERS = 2, RINGS = 5, SLOTS = WAKERS * RINGS, LOST_MS = 1500 };

static _Atomic uint64_t latest[SLOTS], seen[SLOTS], is_over;
static struct bell arrival;
static int doorbell, wakers;
static uint64_t looks_at_one, looks_at_all, rung[WAKERS], published[WAKERS];
static uint64_t length_ns;

static void delay(uint64_t steps)
{
    for (volatile uint64_t i = steps; i > 0; i--)
        ;
}

static bool look(uint64_t slot)
{
    const uint64_t newest = atomic_load_explicit(&latest[slot], memory_order_acquire);
    if (newest == atomic_load_explicit(&seen[slot], memory_order_relaxed))
        return false;
    atomic_store_explicit(&seen[slot], newest, memory_order_release);
    return true;
}

static bool look_at_all(void)
{
    bool found = false;
    for (uint64_t slot = 0; slot < SLOTS; slot++)
        found |= look(slot);
    looks_at_all++;
    return found;
}

static uint64_t clear(void)
{
    uint64_t count = 0;
    return read(doorbell, &count, sizeof count) == sizeof count ? count : 0;
}

/* Reads in the way of Readers.deliver(). */
static void *run_reader(void *unused)
{
    struct pollfd set = {.fd = doorbell, .events = POLLIN};
    uint64_t state = 5;
    bell_arm(&arrival, 0);
    look_at_all();
    while (!is_over) {
        if (poll(&set, 1, 20) == 0)
            continue;
        const uint64_t slot = knock_slot(clear());
        if (slot < SLOTS) {
            bell_arm(&arrival, 0);
            if (look(slot)) {
                delay(random_next(&state) % 2000);
                looks_at_one++;
                if (!look(slot))
                    continue;
            }
        }
        do {
            bell_disarm(&arrival);
            look_at_all();
            delay(random_next(&state) % 2000);
            clear();
            bell_arm(&arrival, 0);
        } while (look_at_all());
    }
    return unused;
}

static void wait_for(uint64_t slot)
{
    const uint64_t end = now_ns() + LOST_MS * UINT64_C(1000000);
    while (atomic_load_explicit(&seen[slot], memory_order_acquire)
           != atomic_load_explicit(&latest[slot], memory_order_relaxed))
        if (now_ns() > end)
            FAIL("what was published for slot %" PRIu64 " is not seen", slot);
}

static void *run_waker(void *number)
{
    const uint64_t me = (uint64_t)(uintptr_t)number, begin = now_ns();
    const char places[RINGS] = {0};
    struct knocks knocks = {0};
    uint64_t state = me + 1;
    while (now_ns() - begin < length_ns) {
        for (uint64_t left = 1 + random_next(&state) % 3; left != 0; left--) {
            const uint64_t ring = random_next(&state) % RINGS, slot = me * RINGS + ring;
            /* This thread is the only writer. A locked instruction would order like a fence, even in a build without
             * one. */
            const uint64_t newest = atomic_load_explicit(&latest[slot], memory_order_relaxed) + 1;
            atomic_store_explicit(&latest[slot], newest, memory_order_release);
            bell_fence();
            const uint64_t knock = bell_knock(&arrival, &knocks, &places[ring], knock_for(slot));
            if (knock != 0 && write(doorbell, &knock, sizeof knock) == sizeof knock)
                rung[me]++;
            published[me]++;
            delay(random_next(&state) % 500);
        }
        for (uint64_t ring = 0; ring < RINGS; ring++)
            wait_for(me * RINGS + ring);
    }
    return number;
}

static void test_numbers(void)
{
    for (uint64_t slot = 0; slot < READERS_MAX_SLOTS; slot++) {
        CHECK_EQ(knock_slot(knock_for(slot)), slot);
        CHECK_EQ(knock_slot(knock_for(slot) + KNOCK_ANY), UINT64_MAX);
        CHECK_EQ(knock_slot(knock_for(slot) + knock_for(READERS_MAX_SLOTS - 1 - slot)), UINT64_MAX);
    }
    for (uint64_t count = 0; count < 1000; count++)
        CHECK_EQ(knock_slot(count), UINT64_MAX);
    CHECK_EQ(knock_slot(UINT64_MAX - 1), UINT64_MAX); /* full */
}

/* One knock for each sleep, one more for another ring; none if the sleeper checks all rings anyway, or is awake. */
static void test_once_for_each(void)
{
    struct bell bell = {0};
    struct knocks knocks = {0};
    const char a = 0, b = 0;
    CHECK_EQ(bell_knock(&bell, &knocks, &a, knock_for(1)), 0);
    for (int i = 0; i < 3; i++) {
        bell_arm(&bell, 0);
        CHECK_EQ(bell_knock(&bell, &knocks, &a, knock_for(1)), knock_for(1));
        CHECK_EQ(bell_knock(&bell, &knocks, &a, knock_for(1)), 0);
        CHECK_EQ(bell_knock(&bell, &knocks, &b, knock_for(2)), KNOCK_ANY);
        CHECK_EQ(bell_knock(&bell, &knocks, &b, knock_for(2)), 0);
        CHECK_EQ(bell_knock(&bell, &knocks, &a, knock_for(1)), 0);
    }
    bell_arm(&bell, 0);
    CHECK_EQ(bell_knock(&bell, &knocks, &a, KNOCK_ANY), KNOCK_ANY);
    CHECK_EQ(bell_knock(&bell, &knocks, &b, knock_for(2)), 0);
    bell_disarm(&bell);
    CHECK_EQ(bell_knock(&bell, &knocks, &b, knock_for(2)), 0);
}

static void knock_and_look(void)
{
    pthread_t reader, threads[WAKERS];
    is_over = 0;
    pthread_create(&reader, NULL, run_reader, NULL);
    for (int i = 0; i < wakers; i++)
        pthread_create(&threads[i], NULL, run_waker, (void *)(intptr_t)i);
    for (int i = 0; i < wakers; i++)
        pthread_join(threads[i], NULL);
    is_over = 1;
    pthread_join(reader, NULL);
    bell_disarm(&arrival);
    clear();
}

static bool has_enough(void)
{
    return looks_at_one > 10 && looks_at_all > 10;
}

int main(int argc, char **argv)
{
    length_ns = (argc > 1 ? strtoull(argv[1], NULL, 10) : 1000) * 1000000u / WAKERS;
    test_numbers();
    if (!IS_BROKEN) /* in a broken build, the waiting wakers must detect this */
        test_once_for_each();
    doorbell = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    /* On a busy machine the reader may get few turns, so it goes on until there is something to judge. */
    for (int left = 100; left > 0 && !has_enough(); left--)
        for (wakers = 1; wakers <= WAKERS; wakers++)
            knock_and_look();
    printf("knock: published %" PRIu64 ", rung %" PRIu64 ", looks at one %" PRIu64 ", at all %" PRIu64 "\n",
           published[0] + published[1], rung[0] + rung[1], looks_at_one, looks_at_all);
    CHECK(has_enough());
    return 0;
}
