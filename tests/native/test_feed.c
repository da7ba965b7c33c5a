/* A feed: attach, read, overrun, from ring to ring, a publisher that ends, comes back, or is killed at any store.
 *
 *     test_feed
 *
 * Any atomic store of the code under test can be a publisher's last one. A kill is tried at each of them, and the
 * result is checked.
 */
#include <setjmp.h>
#include <stdatomic.h>

static void before_store(void);
static void before_fence(void);

#define __atomic_store_n(address, value, order) (before_store(), __atomic_store_n(address, value, order))
#undef atomic_store_explicit
#ifdef __clang__
#define atomic_store_explicit(object, value, order) (before_store(), __c11_atomic_store(object, value, order))
#else
#define atomic_store_explicit(object, value, order) __atomic_store_n(object, value, order)
#endif

#undef atomic_thread_fence
#define atomic_thread_fence(order) (before_fence(), __atomic_thread_fence(order))

#define RING_LARGE (1u << 20) /* none: test_turn.c is about those */
#include "check.h"

#include "../../clients/bus/shm/feed.h"
#include "../../clients/bus/shm/gates.h"

enum { CAPACITY = 4096, INDEX = 64, SLOTS = 4, BATCH = 3 };

static unsigned char bytes[1 << 16], got[1 << 16];

/* --- a publisher that may be killed */

static bool is_mortal;
static int lives; /* stores until it is killed */
static jmp_buf killed;

static void before_store(void)
{
    if (is_mortal && lives-- == 0) {
        is_mortal = false;
        longjmp(killed, 1);
    }
}

/* A ring that drops its oldest record whenever its reader checks whether the record still exists. */
static struct ring_header *lapping;

static void before_fence(void)
{
    if (lapping != NULL)
        lapping->oldest++;
}

/* --- a subscription's process, and a publisher with a gate for it */

static struct readers_header *readers;
static struct reading_process process;
static struct ring_writer w;

static void nobody_sleeps(int doorbell, uint64_t knock) { FAIL("doorbell %d rung by %" PRIu64, doorbell, knock); }

static void start(void *memory)
{
    readers = zeroed(readers_segment_bytes(SLOTS));
    readers_format(readers, SLOTS);
    process = (struct reading_process){.arrival = &readers->arrival, .slots = readers_slots(readers), .slot_count = SLOTS};
    ring_writer_attach(&w, memory);
}

static void end(void)
{
    while (w.gates.count != 0)
        ring_remove_gate(&w, &w.gates.list[0]);
    gates_free(&w.gates);
    free(readers);
}

static uint64_t stamp_of(uint64_t seq) { return 1000 + 10 * seq; }

static enum ring_status put(uint32_t size)
{
    const uint64_t seq = w.latest + 1;
    fill(bytes, seq, size);
    return ring_write(&w, bytes, size, stamp_of(seq), 0, true);
}

static void put_some(int count, uint32_t size)
{
    while (count-- > 0)
        CHECK_EQ(put(size), RING_OK);
}

/* Continues in a ring of `capacity`. */
static void *grow(uint64_t capacity, uint64_t keep)
{
    struct ring_writer fresh;
    void *memory = new_ring(capacity, INDEX, ring_carry_from(&w, keep));
    ring_writer_attach(&fresh, memory);
    CHECK_EQ(ring_carry(&fresh, &w), RING_OK);
    ring_go_on(&w, &fresh);
    return memory;
}

/* --- the feed's side */

static int rings_left; /* number of rings that feeds have left */

static void leave(struct feed_ring *ring)
{
    rings_left++;
    free(ring);
}

static struct feed_ring *map(const void *memory)
{
    struct feed_ring *ring = calloc(1, sizeof *ring);
    CHECK(ring_check(memory, UINT64_MAX, &ring->geometry) == NULL);
    ring->memory = memory;
    ring->leave = leave;
    return ring;
}

static void attach(struct feed *feed, const void *memory, uint64_t slot)
{
    feed_attach(feed, map(memory), &readers_slots(readers)[slot], mix(slot));
}

static void attach_now(struct feed *feed, const void *memory, uint64_t slot)
{
    uint64_t old;
    attach(feed, memory, slot);
    CHECK(feed_begin(feed, feed_find(feed, UINT64_MAX, 0, &old)));
}

/* Takes all samples; returns their number. Checks that each is whole, and that none comes twice. */
static uint64_t take_all(struct feed *feed, uint64_t depth)
{
    uint64_t taken = 0;
    feed_poll(feed, depth);
    while (feed_head(feed, depth) == RING_OK) {
        const struct ring_record record = feed->head;
        CHECK_EQ(record.seq, feed->ring.next);
        CHECK_EQ(record.stamp_ns, stamp_of(record.seq));
        if (feed_copy(feed, depth, &record, got) != RING_OK)
            continue;
        CHECK_EQ(feed->ring.next, record.seq + 1);
        if (!is_filled(got, record.seq, record.size))
            FAIL("sample %" PRIu64 " is torn", record.seq);
        taken++;
    }
    return taken;
}

static void test_attach_and_read(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct feed feed;
    uint64_t old;
    start(memory);
    put_some(5, 100);
    attach_now(&feed, memory, 0);
    CHECK_EQ(feed.first, 6);
    CHECK_EQ(take_all(&feed, 0), 0);
    put_some(4, 100);
    CHECK_EQ(feed_waiting(&feed), 4);
    CHECK_EQ(take_all(&feed, 0), 4);
    CHECK_EQ(feed_waiting(&feed), 0);
    feed_close(&feed, true);

    attach(&feed, memory, 0); /* samples stamped since then, and history before them */
    CHECK_EQ(feed_find(&feed, stamp_of(7), 0, &old), 7);
    CHECK_EQ(old, 0);
    CHECK_EQ(feed_find(&feed, stamp_of(7), 2, &old), 5);
    CHECK_EQ(old, 2);
    CHECK_EQ(feed_find(&feed, 0, 100, &old), 1);
    CHECK_EQ(old, 0);
    CHECK_EQ(feed_find(&feed, UINT64_MAX, 3, &old), 7);
    CHECK_EQ(old, 3);
    feed.clock_ns = 50; /* the publisher's clock is ahead */
    CHECK_EQ(feed_find(&feed, stamp_of(7) - 50, 0, &old), 7);
    CHECK(feed_begin(&feed, 7));
    CHECK_EQ(readers_slots(readers)[0].cursor, 7);
    CHECK_EQ(take_all(&feed, 0), 3);
    feed.lifespan_ns = 10;
    CHECK(!feed_is_expired(&feed, 100, 110));
    CHECK(feed_is_expired(&feed, 100, 111));
    CHECK(!feed_is_expired(&feed, 111, 100));
    feed_close(&feed, true);
    CHECK_EQ(rings_left, 2);
    end();
    free(memory);
}

static void test_depth_and_overrun_are_counted(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct feed feed;
    start(memory);
    attach_now(&feed, memory, 0);
    put_some(20, 100);
    CHECK_EQ(take_all(&feed, 8), 8);
    CHECK_EQ(feed.ring.replaced, 12);
    CHECK_EQ(feed_most_missed(&feed), 12);
    CHECK_EQ(feed.ring.overrun, 0);
    put_some(15, 100);
    feed_poll(&feed, 5);
    put_some(4, 100);
    feed_poll(&feed, 5);
    CHECK_EQ(feed_most_missed(&feed), 14); /* none was taken in between */
    CHECK_EQ(take_all(&feed, 5), 5);
    put_some(500, 100);
    const uint64_t oldest = w.oldest;
    CHECK_EQ(take_all(&feed, 0), 539 - oldest + 1);
    CHECK_EQ(feed.ring.overrun, oldest - 40);
    CHECK_EQ(feed_most_missed(&feed), 14); /* without a depth, it is the publisher's that was too small */
    put_some(500, 100);
    CHECK_EQ(take_all(&feed, 5), 5);
    CHECK_EQ(feed_most_missed(&feed), 495); /* lapped and replaced */

    put_some(3, 100); /* the feed has read the head when the record is lapped */
    feed_poll(&feed, 0);
    CHECK_EQ(feed_head(&feed, 0), RING_OK);
    const struct ring_record record = feed.head;
    put_some(300, 100);
    CHECK_EQ(feed_copy(&feed, 0, &record, got), RING_OVERRUN);
    CHECK_EQ(feed.ring.next, w.oldest);
    CHECK_EQ(take_all(&feed, 5), 5);
    CHECK_EQ(feed.ring.next, w.latest + 1);
    feed_skip(&feed, 0);
    put_some(2, 100);
    CHECK_EQ(feed_waiting(&feed), 2);
    feed_close(&feed, true);
    end();
    free(memory);
}

/* A feed reads a ring that grew to its end, through several rings, and leaves each once. */
static void test_from_ring_to_ring(void)
{
    void *memory[FEED_MOST_FOLLOWING + 2] = {new_ring(CAPACITY, INDEX, 1)};
    struct feed feed;
    start(memory[0]);
    rings_left = 0;
    attach_now(&feed, memory[0], 0);
    put_some(10, 100);
    for (int i = 1; i <= FEED_MOST_FOLLOWING; i++) {
        memory[i] = grow(CAPACITY, 5);
        CHECK(feed_extend(&feed, map(memory[i])));
        put_some(2, 100);
    }
    memory[FEED_MOST_FOLLOWING + 1] = grow(CAPACITY, 5);
    struct feed_ring *one_more = map(memory[FEED_MOST_FOLLOWING + 1]);
    CHECK(!feed_extend(&feed, one_more));
    free(one_more);
    CHECK_EQ(feed_waiting(&feed), 10 + 2 * FEED_MOST_FOLLOWING);
    CHECK_EQ(take_all(&feed, 0), 10 + 2 * FEED_MOST_FOLLOWING);
    CHECK_EQ(feed.ring.overrun + feed.ring.replaced, 0);
    CHECK_EQ(rings_left, FEED_MOST_FOLLOWING);
    CHECK(feed.rings->after == NULL); /* closed, and the next ring is on its way */
    CHECK(feed_extend(&feed, map(memory[FEED_MOST_FOLLOWING + 1])));
    put_some(3, 100);
    CHECK_EQ(take_all(&feed, 0), 3);
    feed_close(&feed, true);
    CHECK_EQ(rings_left, FEED_MOST_FOLLOWING + 2);
    end();
    for (int i = 0; i < FEED_MOST_FOLLOWING + 2; i++)
        free(memory[i]);
}

static void test_a_publisher_that_lies(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1), *next = new_ring(CAPACITY, INDEX, 1);
    struct ring_header *header = memory;
    struct feed feed;
    start(memory);
    put_some(5, 100);
    attach(&feed, memory, 0);
    CHECK(!feed_begin(&feed, 0));
    CHECK(!feed_begin(&feed, MAX_SEQ + 2));
    CHECK(feed_begin(&feed, 1));
    CHECK(feed_extend(&feed, map(next))); /* the publisher continues elsewhere and has not closed this ring */
    atomic_store(&((struct ring_header *)next)->latest, 20);
    feed_poll(&feed, 0);
    for (int i = 0; i < 5; i++) {
        CHECK_EQ(feed_head(&feed, 0), RING_OK);
        feed_step(&feed);
    }
    CHECK_EQ(feed_head(&feed, 0), RING_CORRUPT);
    feed_close(&feed, true);

    attach(&feed, memory, 0);
    CHECK(feed_begin(&feed, 1));
    memset((char *)memory + sizeof *header, 0xff, INDEX * 8); /* false entries */
    feed_poll(&feed, 0);
    CHECK_EQ(feed_head(&feed, 0), RING_CORRUPT);
    atomic_store(&header->latest, MAX_SEQ + 9);
    CHECK(!feed_is_sound(&feed));
    CHECK(!feed_begin(&feed, 1));
    feed_close(&feed, true);
    end();
    free(memory);
    free(next);
}

/* A ring laps its reader at every check: the feed must wait for another turn, and then has news. */
static void test_one_that_is_too_fast_does_not_hold_up_others(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct ring_header *header = memory;
    struct feed feed;
    start(memory);
    attach_now(&feed, memory, 0);
    atomic_store(&header->latest, 1000);
    feed_mark_seen(&feed);
    CHECK(!feed_has_news(&feed));
    feed_poll(&feed, 0);
    lapping = header;
    CHECK_EQ(feed_head(&feed, 0), RING_EMPTY);
    lapping = NULL;
    CHECK_EQ(feed.ring.overrun, FEED_TRIES);
    CHECK_EQ(feed.waiting, 0);
    CHECK(feed_has_news(&feed));
    feed_close(&feed, true);
    end();
    free(memory);
}

/* With the gate, the publisher shows the ticket. From then on, records are held in place until they are unpinned. */
static void test_pins(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct feed feed;
    unsigned pin;
    start(memory);
    attach_now(&feed, memory, 0);
    put_some(1, 500);
    feed_poll(&feed, 0);
    CHECK_EQ(feed_head(&feed, 0), RING_OK);
    CHECK(!feed_may_pin(&feed));
    CHECK_EQ(feed_pin(&feed, 0, &feed.head, &pin), RING_PINNED);
    CHECK(ring_add_gate(&w, 1, &process, 0, false));
    CHECK_EQ(gates_ring(&w.gates, true, nobody_sleeps), 0);
    CHECK(feed_may_pin(&feed));
    CHECK(!gate_has_pins(gates_find(&w.gates, 1)));
    const struct ring_record held = feed.head;
    CHECK_EQ(feed_pin(&feed, 0, &held, &pin), RING_OK);
    CHECK_EQ(feed.ring.next, 2);
    CHECK(gate_has_pins(gates_find(&w.gates, 1)));
    put_some(1, 500);
    feed_poll(&feed, 0);
    CHECK_EQ(feed_head(&feed, 0), RING_OK);
    const struct ring_record late = feed.head;
    put_some(200, 100);
    unsigned none;
    CHECK_EQ(feed_pin(&feed, 0, &late, &none), RING_OVERRUN);
    CHECK(take_all(&feed, 0) > 10);
    feed_close(&feed, true); /* a view outlives its feed */
    put_some(200, 100);
    CHECK(is_filled(held.payload, 1, 500));
    ring_unpin(&readers_slots(readers)[0], pin);
    put_some(200, 100);
    CHECK(!is_filled(held.payload, 1, 500));
    CHECK_EQ(w.gates.hole_count, 0);
    end();
    free(memory);
}

/* A feed that was never admitted removes its ticket from the slot. In the child of a fork, the ticket is the
 * parent's. */
static void test_tickets_are_taken_back(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct feed feed;
    start(memory);
    const struct reader_slot *slot = &readers_slots(readers)[0];
    attach_now(&feed, memory, 0);
    CHECK(slot->pins[READER_PINS - 1] == (READER_TICKET | feed.ticket));
    struct feed in_child = feed;
    in_child.rings = NULL;
    feed_close(&in_child, false);
    CHECK(slot->pins[READER_PINS - 1] != 0);
    feed_close(&feed, true);
    CHECK_EQ(slot->pins[READER_PINS - 1], 0);
    atomic_store(&((struct ring_header *)memory)->admitted[3], 77);
    feed_attach(&feed, map(memory), &readers_slots(readers)[0], 77);
    CHECK_EQ(feed.ticket, 78); /* a number that the ring does not show */
    feed_close(&feed, true);
    feed_attach(&feed, map(memory), &readers_slots(readers)[0], UINT64_C(7) << 32);
    CHECK_EQ(feed.ticket, 1);
    feed_close(&feed, true);
    end();
    free(memory);
}

/* A lossless match: nothing is lost, and the publisher is rung when there is the room that it waits for. */
static void test_credit(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1), *wider;
    struct feed feed;
    uint64_t taken = 0, rung = 0;
    start(memory);
    attach_now(&feed, memory, 0);
    CHECK(ring_add_gate(&w, 1, &process, 0, true));
    for (int round = 0; round < 20; round++) {
        while (put(100) == RING_OK)
            ;
        CHECK(ring_wait_for_room(&w));
        feed_poll(&feed, 0);
        bool is_due = false;
        while (!is_due) {
            CHECK_EQ(feed_head(&feed, 0), RING_OK);
            feed_step(&feed);
            taken++;
            is_due = feed_show_cursor(&feed);
            CHECK(!feed_show_cursor(&feed)); /* the cursor has not moved */
        }
        rung++;
        CHECK(feed_waiting(&feed) > 5); /* rung after half of the ring, not after each record */
        CHECK_EQ(put(100), RING_OK);
        bell_disarm(&w.header->room);
    }
    CHECK_EQ(rung, 20);
    CHECK_EQ(feed.ring.overrun + feed.ring.replaced, 0);

    while (put(100) == RING_OK)
        ;
    wider = grow(2 * CAPACITY, UINT64_MAX);
    while (put(100) == RING_OK)
        ;
    CHECK(ring_wait_for_room(&w)); /* with the bell of the other ring, which the feed does not know yet */
    taken += take_all(&feed, 0);
    CHECK(!feed_show_cursor(&feed));
    CHECK(feed_extend(&feed, map(wider)));
    CHECK(feed_room_is_due(&feed));
    taken += take_all(&feed, 0);
    CHECK_EQ(taken, w.latest);
    CHECK_EQ(feed.ring.overrun + feed.ring.replaced, 0);
    feed_close(&feed, true);
    end();
    free(memory);
    free(wider);
}

/* After growth, the ring has another bell with the same generation as the old one. It must still be rung. */
static void test_credit_in_the_next_ring(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1), *wider;
    struct feed feed;
    start(memory);
    attach_now(&feed, memory, 0);
    CHECK(ring_add_gate(&w, 1, &process, 0, true));
    while (put(100) == RING_OK)
        ;
    CHECK(ring_wait_for_room(&w));
    take_all(&feed, 0);
    CHECK(feed_show_cursor(&feed));
    CHECK(!feed_room_is_due(&feed)); /* already rung for this wait */
    wider = grow(2 * CAPACITY, 1);
    CHECK(feed_extend(&feed, map(wider)));
    while (put(100) == RING_OK)
        ;
    CHECK(ring_wait_for_room(&w));
    take_all(&feed, 0);
    CHECK(feed_show_cursor(&feed));
    feed_close(&feed, true);
    end();
    free(memory);
    free(wider);
}

static void test_news(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1), *next;
    struct feed feed;
    start(memory);
    attach_now(&feed, memory, 0);
    struct feed_watch watch = {.feed = &feed};
    feed_watch_anew(&watch);
    CHECK(!feed_watch_has_news(&watch));
    CHECK_EQ(watch.known, FEED_UNKNOWN); /* the check must find its ticket, too */
    CHECK(ring_add_gate(&w, 1, &process, 0, false));
    CHECK(!feed_watch_has_news(&watch));
    CHECK_EQ(feed.ticket, 0);
    CHECK_EQ(watch.known, 0);
    put_some(1, 100);
    CHECK(feed_watch_has_news(&watch) && feed_watch_has_news(&watch));
    feed_mark_seen(&feed);
    CHECK(!feed_watch_has_news(&watch));
    CHECK_EQ(watch.known, 1);
    CHECK_EQ(take_all(&feed, 0), 1);
    feed_watch_anew(&watch);
    CHECK(!feed_watch_has_news(&watch));
    next = grow(2 * CAPACITY, 1);
    put_some(1, 100);
    CHECK(!feed_watch_has_news(&watch)); /* the watch does not know the other ring */
    CHECK(feed_extend(&feed, map(next)));
    feed_watch_anew(&watch);
    CHECK(feed_watch_has_news(&watch));
    feed_close(&feed, true);
    end();
    free(memory);
    free(next);
}

/* Records after a publisher's end are not taken: another publisher may own the memory then. */
static void test_a_publisher_that_is_gone(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    struct feed feed, idle;
    start(memory);
    attach_now(&feed, memory, 0);
    put_some(7, 100);
    CHECK(!feed_finish(&feed));
    attach_now(&idle, memory, 1);
    CHECK(feed_finish(&idle));
    put_some(5, 100);
    CHECK_EQ(feed_waiting(&feed), 7);
    CHECK_EQ(feed_waiting(&idle), 0);
    CHECK_EQ(take_all(&feed, 0), 7);
    CHECK_EQ(take_all(&feed, 0), 0);
    put_some(500, 100); /* far above its last number */
    CHECK_EQ(take_all(&feed, 0), 0);
    CHECK_EQ(feed.ring.overrun + feed.ring.replaced, 0);
    feed_close(&feed, true);
    feed_close(&idle, true);
    end();
    free(memory);
}

/* After a restart of the broker, the match is made again: the reader continues with its own next number, in the
 * publisher's present ring. */
static void test_matched_again_after_a_restart_of_the_broker(void)
{
    void *memory = new_ring(CAPACITY, INDEX, 1), *wider;
    struct feed feed, again;
    start(memory);
    attach_now(&feed, memory, 0);
    CHECK(ring_add_gate(&w, 1, &process, 0, true));
    put_some(12, 100);
    feed_poll(&feed, 0);
    for (int i = 0; i < 5; i++) {
        CHECK_EQ(feed_head(&feed, 0), RING_OK);
        CHECK_EQ(feed_copy(&feed, 0, &feed.head, got), RING_OK);
    }
    feed_show_cursor(&feed);
    attach(&again, memory, 1); /* another slot, before the old match's slot is freed */
    CHECK(feed_begin(&again, feed.ring.next));
    CHECK(ring_add_gate(&w, 2, &process, 1, true));
    feed_close(&feed, true);
    ring_remove_gate(&w, gates_find(&w.gates, 1));
    put_some(3, 100);
    CHECK_EQ(again.first, 6);
    CHECK_EQ(take_all(&again, 0), 10);
    CHECK_EQ(again.ring.overrun + again.ring.replaced, 0);
    put_some(4, 100);

    wider = grow(2 * CAPACITY, UINT64_MAX); /* while the broker was away: only the new ring is announced */
    put_some(4, 100);
    attach(&feed, wider, 2);
    CHECK(feed_begin(&feed, again.ring.next));
    feed_close(&again, true);
    CHECK_EQ(take_all(&feed, 0), 8);
    CHECK_EQ(feed.ring.overrun + feed.ring.replaced, 0);
    ring_make_lossy(&w, gates_find(&w.gates, 2));
    put_some(500, 100); /* a lossy reader that was away too long counts its losses */
    const uint64_t next = feed.ring.next;
    feed_close(&feed, true);
    attach(&again, wider, 3);
    CHECK(feed_begin(&again, next));
    CHECK_EQ(take_all(&again, 0) + again.ring.overrun, 500);
    CHECK(again.ring.overrun > 400);
    feed_close(&again, true);
    end();
    free(memory);
    free(wider);
}

/* --- killed at any store: at the n-th, for each n until the publisher finishes its work */

static void *killed_in, *killed_before;
static struct feed witness;

/* Writes some records into a full ring; if it `grows`, into the next ring, too. The kill may come during a copy. */
static void publish_and_grow(bool grows)
{
    void *payload;
    for (uint32_t i = 0; i < BATCH; i++) {
        const uint32_t size = 100 + 300 * i;
        fill(bytes, w.latest + 1, size);
        if (ring_reserve(&w, size, true, &payload) != RING_OK)
            FAIL("no room");
        copy_to_shared(payload, bytes, size / 16 * 8);
        before_store();
        copy_to_shared((char *)payload + size / 16 * 8, bytes + size / 16 * 8, size - size / 16 * 8);
        ring_publish(&w, size, stamp_of(w.latest + 1), 0);
    }
    if (grows) {
        struct ring_writer fresh;
        const bool was_mortal = is_mortal;
        is_mortal = false; /* to free the memory */
        killed_in = new_ring(2 * CAPACITY, INDEX, ring_carry_from(&w, 10));
        is_mortal = was_mortal;
        ring_writer_attach(&fresh, killed_in);
        ring_carry(&fresh, &w);
        ring_go_on(&w, &fresh);
        put_some(1, 100);
    }
}

/* Kills a publisher at a store. False: the publisher had no store with this number. */
static bool kill_at_store(int number, bool grows)
{
    void *memory = new_ring(CAPACITY, INDEX, 1);
    start(memory);
    rings_left = 0;
    attach_now(&witness, memory, 0);
    CHECK(ring_add_gate(&w, 1, &process, 0, false));
    put_some(60 + number % 7, 100);
    uint64_t taken = number % 2 ? take_all(&witness, 0) : 0;
    killed_in = NULL;
    killed_before = memory;
    lives = number;
    is_mortal = true;
    const bool is_killed = setjmp(killed) != 0;
    if (!is_killed)
        publish_and_grow(grows);
    is_mortal = false;
    if (!is_killed && grows)
        CHECK(feed_extend(&witness, map(killed_in))); /* announced after it has moved there */
    const struct ring_header *header = is_killed || !grows ? killed_before : killed_in;
    const uint64_t latest = header->latest;
    feed_finish(&witness);
    CHECK_EQ(witness.end, latest);
    taken += take_all(&witness, 0);
    CHECK_EQ(witness.ring.next, latest + 1);
    CHECK_EQ(taken + witness.ring.overrun, latest);
    CHECK(latest >= 60 && taken >= 10);

    /* The next publisher takes over its ring, and the reader continues there with its own next number. */
    if (!is_killed || !grows) {
        struct ring_writer heir;
        struct feed again;
        void *inherited = grows ? killed_in : killed_before;
        ring_writer_attach(&heir, inherited);
        CHECK_EQ(heir.latest, latest);
        attach(&again, inherited, 1);
        CHECK(feed_begin(&again, witness.ring.next));
        for (int i = 0; i < 5; i++) {
            fill(bytes, heir.latest + 1, 200);
            CHECK_EQ(ring_write(&heir, bytes, 200, stamp_of(heir.latest + 1), 0, true), RING_OK);
        }
        CHECK_EQ(take_all(&witness, 0), 0);
        CHECK_EQ(take_all(&again, 0), 5);
        feed_close(&again, true);
    }
    feed_close(&witness, true);
    end();
    free(memory);
    free(killed_in);
    return is_killed;
}

static void test_a_publisher_killed_at_any_store(bool grows)
{
    int stores = 0;
    while (kill_at_store(stores, grows))
        stores++;
    CHECK(stores > (grows ? 60 : 15));
}

int main(void)
{
    test_attach_and_read();
    test_depth_and_overrun_are_counted();
    test_from_ring_to_ring();
    test_a_publisher_that_lies();
    test_one_that_is_too_fast_does_not_hold_up_others();
    test_pins();
    test_tickets_are_taken_back();
    test_credit();
    test_credit_in_the_next_ring();
    test_news();
    test_a_publisher_that_is_gone();
    test_matched_again_after_a_restart_of_the_broker();
    test_a_publisher_killed_at_any_store(false);
    test_a_publisher_killed_at_any_store(true);
    puts("feed: ok");
    return 0;
}
