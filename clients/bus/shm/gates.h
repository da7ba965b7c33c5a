/* A publisher's view of its readers: one gate for each match, and the doorbells of the readers' processes.
 *
 * A gate shows the writer one slot: the reader's position (cursor), and the records that it holds in place (pins). The
 * writer only reads slots; only their process writes them. A lossless gate keeps the writer from overwriting records
 * that its reader has not taken. A pinned record becomes a hole when it is dropped, and the writer steps over its place
 * until the pin is released. A process that lies in its slots loses its own messages. At most it delays the writer, as
 * a slow lossless reader does.
 *
 * Must not know: positions of records (writer.h), Python, system calls. gates_ring() reports the doorbells that are
 * due, and its caller writes to them. One thread at a time may use the gates of a writer. All writers of a process
 * share the `struct reading_process` of each other process, so one thread at a time may use these, too.
 *
 * Each atomic access names its order; ring.h lists the PAIRs and doorbell.h the two of a sleep.
 */
#ifndef BUS_SHM_GATES_H
#define BUS_SHM_GATES_H

#include <stdlib.h>

#include "doorbell.h"
#include "layout.h"

/* A pinned record that the writer has dropped and steps over; active while the pin still holds `seq`. */
struct ring_hole {
    uint64_t seq; /* 0: none */
    uint64_t begin, end;
};

/* Another process that reads rings of this one. Initialise with zeroes and the first four members. */
struct reading_process {
    const struct bell *arrival;      /* in its readers' segment, as are the slots */
    const struct reader_slot *slots;
    uint64_t slot_count;
    int doorbell;         /* its eventfd, which the caller keeps open */
    struct knocks knocks; /* of all writers of this process */
    size_t gates;         /* gates of these writers for it */
};

/* One match, as its writer sees it. It has a hole for each pin, so holes never run out. */
struct ring_gate {
    const struct reader_slot *slot;
    bool is_lossless;
    struct ring_hole holes[READER_PINS];
    uint64_t key; /* the owner's number for the match */
    struct reading_process *process;
};

/* A process of the gates, as this writer rings it. */
struct gate_bell {
    struct reading_process *process;
    uint64_t knock; /* for the slot of its gate; KNOCK_ANY if it has several */
};

/* The gates of one writer. Initialise with zeroes. It must not move in memory while it has gates: knocks keep its
 * address. */
struct ring_gates {
    struct ring_gate *list;
    struct gate_bell *bells; /* each process of the list once */
    size_t count, bell_count;
    size_t room;             /* allocated entries of both arrays */
    size_t hole_count;
};

/* --- cursors and pins of readers */

/* The seq before which all lossless readers have taken everything, at most `limit`. They need no earlier record. */
static inline uint64_t gates_taken(const struct ring_gates *gates, uint64_t limit)
{
    uint64_t taken = limit;
    for (size_t i = 0; i < gates->count; i++) {
        if (!gates->list[i].is_lossless)
            continue;
        /* PAIR(cursor): acquire. The reader's copies of taken records are complete. Counterpart: ring_tell_cursor(). */
        const uint64_t cursor = atomic_load_explicit(&gates->list[i].slot->cursor, memory_order_acquire);
        if (cursor < taken)
            taken = cursor;
    }
    return taken;
}

/* The number in one of the pin words: a record's, a ticket, or 0 if it is free. */
static inline uint64_t gate_pin(const struct ring_gate *gate, unsigned pin)
{
    /* PAIR(unpin): acquire. If the pin no longer holds a record, the reader's reads of that record are complete.
     * Counterpart: ring_unpin(), ring_pin(). */
    return atomic_load_explicit(&gate->slot->pins[pin], memory_order_acquire);
}

/* Whether the gate's reader holds any record in place. */
static inline bool gate_has_pins(const struct ring_gate *gate)
{
    for (unsigned i = 0; i < READER_PINS; i++) {
        const uint64_t pin = gate_pin(gate, i);
        if (pin != 0 && (pin & READER_TICKET) == 0)
            return true;
    }
    return false;
}

/* The ticket with which the gate's reader asks to be admitted; 0: it does not ask. */
static inline uint32_t gate_ticket(const struct ring_gate *gate)
{
    const uint64_t pin = gate_pin(gate, READER_PINS - 1);
    return (pin & READER_TICKET) != 0 ? (uint32_t)pin : 0;
}

/* --- holes */

/* Makes a hole of a dropped record that the pin holds. The writer steps over its place from now on. */
static inline void gates_add_hole(struct ring_gates *gates, size_t gate, unsigned pin, struct ring_hole hole)
{
    struct ring_hole *place = &gates->list[gate].holes[pin];
    gates->hole_count += place->seq == 0;
    *place = hole;
}

/* End of a hole that overlaps [begin, end), 0 if there is none. Forgets holes with released pins. */
static inline uint64_t gates_hole_in(struct ring_gates *gates, uint64_t begin, uint64_t end)
{
    for (size_t i = 0; gates->hole_count != 0 && i < gates->count; i++) {
        for (unsigned j = 0; j < READER_PINS; j++) {
            struct ring_hole *hole = &gates->list[i].holes[j];
            if (hole->seq == 0)
                continue;
            if (gate_pin(&gates->list[i], j) != hole->seq) {
                hole->seq = 0;
                gates->hole_count--;
            } else if (hole->begin < end && begin < hole->end) {
                return hole->end;
            }
        }
    }
    return 0;
}

/* Counts the holes anew, after gates were added or removed. */
static inline void gates_count_holes(struct ring_gates *gates)
{
    gates->hole_count = 0;
    for (size_t i = 0; i < gates->count; i++)
        for (size_t j = 0; j < READER_PINS; j++)
            gates->hole_count += gates->list[i].holes[j].seq != 0;
}

/* Forgets all holes, because the writer continues in another ring. Pinned records stay in the old ring, which is never
 * written again. */
static inline void gates_forget_holes(struct ring_gates *gates)
{
    for (size_t i = 0; i < gates->count; i++)
        memset(gates->list[i].holes, 0, sizeof gates->list[i].holes);
    gates->hole_count = 0;
}

/* --- adding and removing gates. Then ring_gates_changed(), which ring_add_gate() and similar functions call. */

/* The gate of `key`; NULL if there is none. Valid until a gate is added or removed. */
static inline struct ring_gate *gates_find(const struct ring_gates *gates, uint64_t key)
{
    for (size_t i = 0; i < gates->count; i++)
        if (gates->list[i].key == key)
            return &gates->list[i];
    return NULL;
}

static inline bool gates_make_room(struct ring_gates *gates)
{
    if (gates->count < gates->room)
        return true;
    const size_t room = gates->room == 0 ? 4 : 2 * gates->room;
    struct ring_gate *list = realloc(gates->list, room * sizeof *list);
    if (list != NULL)
        gates->list = list;
    struct gate_bell *bells = realloc(gates->bells, room * sizeof *bells);
    if (bells != NULL)
        gates->bells = bells;
    if (list == NULL || bells == NULL)
        return false;
    gates->room = room;
    return true;
}

static inline void gates_list_bells(struct ring_gates *gates)
{
    gates->bell_count = 0;
    for (size_t i = 0; i < gates->count; i++) {
        const struct ring_gate *gate = &gates->list[i];
        size_t at = 0;
        while (at < gates->bell_count && gates->bells[at].process != gate->process)
            at++;
        if (at == gates->bell_count)
            gates->bells[gates->bell_count++] =
                (struct gate_bell){gate->process, knock_for((uint64_t)(gate->slot - gate->process->slots))};
        else
            gates->bells[at].knock = KNOCK_ANY;
    }
}

/* Forgets in `process` that this writer rang: its gates change, and another writer may get its address. */
static inline void gates_forget_knock(const struct ring_gates *gates, struct reading_process *process)
{
    if (process->knocks.by == gates)
        process->knocks.by = process;
}

/* Removes a gate. Returns its process, which may have no other gate of this writer. */
static inline struct reading_process *gates_remove(struct ring_gates *gates, struct ring_gate *gate)
{
    struct reading_process *process = gate->process;
    *gate = gates->list[--gates->count];
    gates_list_bells(gates);
    gates_forget_knock(gates, process);
    process->gates--;
    return process;
}

/* Adds the gate of match `key`, for a slot of `process`. It replaces an earlier gate with this key, whose holes stay
 * if it had the same slot. False: no memory, and nothing has changed. */
static inline bool gates_add(struct ring_gates *gates, uint64_t key, struct reading_process *process, uint64_t slot,
                             bool is_lossless)
{
    struct ring_gate gate = {.slot = &process->slots[slot], .is_lossless = is_lossless, .key = key, .process = process};
    struct ring_gate *before = gates_find(gates, key);
    if (before == NULL && !gates_make_room(gates))
        return false;
    if (before != NULL) {
        if (before->slot == gate.slot)
            memcpy(gate.holes, before->holes, sizeof gate.holes);
        gates_remove(gates, before);
    }
    gates->list[gates->count++] = gate;
    process->gates++;
    gates_forget_knock(gates, process);
    gates_list_bells(gates);
    return true;
}

/* Frees the arrays, once all gates are removed. */
static inline void gates_free(struct ring_gates *gates)
{
    free(gates->list);
    free(gates->bells);
    *gates = (struct ring_gates){0};
}

/* --- doorbells */

/* After anything became visible in the ring: calls `ring` for each sleeping process, with its doorbell and the
 * number to add to that. It rings once for each sleep, and once more if another ring of this process has rung.
 * `is_for_any`: there is more than a new record, so the process must check all rings. Returns the number of
 * doorbells rung. */
static inline uint64_t gates_ring(const struct ring_gates *gates, bool is_for_any,
                                  void (*ring)(int doorbell, uint64_t knock))
{
    uint64_t rung = 0;
    bell_fence(); /* PAIR(sleep): after everything that became visible. Counterpart: bell_arm() of the arrival bell. */
    for (size_t i = 0; i < gates->bell_count; i++) {
        struct reading_process *process = gates->bells[i].process;
        const bool is_one = !is_for_any && process->gates > FEW_RINGS;
        const uint64_t knock =
            bell_knock(process->arrival, &process->knocks, gates, is_one ? gates->bells[i].knock : KNOCK_ANY);
        if (knock != 0) {
            ring(process->doorbell, knock);
            rung++;
        }
    }
    return rung;
}

#endif
