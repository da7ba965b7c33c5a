/* A publisher's view of its readers: one gate for each match, and the processes whose doorbells are rung for them.
 *
 * A gate shows the writer one slot: up to where its reader has taken (cursor), and which records it holds in place (pins).
 * The writer only reads slots; their process alone writes them. A lossless gate keeps the writer from overwriting what
 * its reader has not taken. A pinned record that is given up becomes a hole, and the writer steps over its place until
 * the pin is released. A process that lies in its slots loses messages of its own, and at most delays the writer as a
 * slow lossless reader does.
 *
 * Must not know: where records lie (writer.h), Python, system calls. gates_ring() says which doorbell is due, and its
 * caller writes to it. One thread at a time may use the gates of a writer, and all writers of a process share the
 * `struct reading_process` of each other process, so one thread at a time may use those, too.
 *
 * Each atomic access names its order; ring.h lists the PAIRs and doorbell.h the two of a sleep.
 */
#ifndef BUS_SHM_GATES_H
#define BUS_SHM_GATES_H

#include <stdlib.h>

#include "doorbell.h"
#include "layout.h"

/* A pinned record that the writer has given up and steps over; active while the pin still holds `seq`. */
struct ring_hole {
    uint64_t seq; /* 0: none */
    uint64_t begin, end;
};

/* Another process that reads rings of this one. Begin with zeroes and the first four members. */
struct reading_process {
    const struct bell *arrival;      /* in its readers' segment, as are the slots */
    const struct reader_slot *slots;
    uint64_t slot_count;
    int doorbell;         /* its eventfd, which the caller keeps open */
    struct knocks knocks; /* of all writers of this process */
    size_t gates;         /* that these have for it */
};

/* One match, as its writer sees it. Has a hole for each pin, so holes never run out. */
struct ring_gate {
    const struct reader_slot *slot;
    bool is_lossless;
    struct ring_hole holes[READER_PINS];
    uint64_t key; /* by which the owner knows the match */
    struct reading_process *process;
};

/* A process of the gates, as this writer rings it. */
struct gate_bell {
    struct reading_process *process;
    uint64_t knock; /* for the slot of its gate; KNOCK_ANY if it has several */
};

/* The gates of one writer. Begin with zeroes. It must not move in memory while it has gates: knocks know its address. */
struct ring_gates {
    struct ring_gate *list;
    struct gate_bell *bells; /* each process of the list once */
    size_t count, bell_count;
    size_t room;             /* allocated, of both arrays */
    size_t hole_count;
};

/* --- what readers have taken and pinned */

/* What all lossless readers have taken, at most `limit`: they need nothing before it. */
static inline uint64_t gates_taken(const struct ring_gates *gates, uint64_t limit)
{
    uint64_t taken = limit;
    for (size_t i = 0; i < gates->count; i++) {
        if (!gates->list[i].is_lossless)
            continue;
        /* PAIR(cursor): acquire. The reader's copies of what it took are over. Counterpart: ring_tell_cursor(). */
        const uint64_t cursor = atomic_load_explicit(&gates->list[i].slot->cursor, memory_order_acquire);
        if (cursor < taken)
            taken = cursor;
    }
    return taken;
}

/* The number in one of the pin words: of a record, 0 if it is free, or a ticket. */
static inline uint64_t gate_pin(const struct ring_gate *gate, unsigned pin)
{
    /* PAIR(unpin): acquire. If it no longer holds a record, its reader's reads of that are over. Counterpart:
     * ring_unpin(), ring_pin(). */
    return atomic_load_explicit(&gate->slot->pins[pin], memory_order_acquire);
}

/* Whether its reader holds any record in place. */
static inline bool gate_has_pins(const struct ring_gate *gate)
{
    for (unsigned i = 0; i < READER_PINS; i++) {
        const uint64_t pin = gate_pin(gate, i);
        if (pin != 0 && (pin & READER_TICKET) == 0)
            return true;
    }
    return false;
}

/* The ticket with which its reader asks to be admitted; 0: it does not ask. */
static inline uint32_t gate_ticket(const struct ring_gate *gate)
{
    const uint64_t pin = gate_pin(gate, READER_PINS - 1);
    return (pin & READER_TICKET) != 0 ? (uint32_t)pin : 0;
}

/* --- holes */

/* The record that the pin holds is given up, and its place is stepped over from now on. */
static inline void gates_add_hole(struct ring_gates *gates, size_t gate, unsigned pin, struct ring_hole hole)
{
    struct ring_hole *place = &gates->list[gate].holes[pin];
    gates->hole_count += place->seq == 0;
    *place = hole;
}

/* End of a hole that [begin, end) runs into, 0 if there is none. Forgets the holes whose pins are released. */
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

/* After gates came or went. */
static inline void gates_count_holes(struct ring_gates *gates)
{
    gates->hole_count = 0;
    for (size_t i = 0; i < gates->count; i++)
        for (size_t j = 0; j < READER_PINS; j++)
            gates->hole_count += gates->list[i].holes[j].seq != 0;
}

/* The writer goes on in another ring. What is pinned stays in the one before, which is never written again. */
static inline void gates_forget_holes(struct ring_gates *gates)
{
    for (size_t i = 0; i < gates->count; i++)
        memset(gates->list[i].holes, 0, sizeof gates->list[i].holes);
    gates->hole_count = 0;
}

/* --- gates come and go. Then ring_gates_changed(), which ring_add_gate() and its like do. */

/* The gate of `key`; NULL if there is none. Good until gates come or go. */
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

/* The process forgets what this writer rang for: its gates change, and another writer may get its address. */
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

/* Adds the gate of match `key`, for a slot of `process`; one with this key goes, and if it was for the same slot, its
 * holes stay. False: no memory, and nothing has changed. */
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

/* After anything became visible in the ring: calls `ring` for each process that sleeps, with its doorbell and what to add
 * to that. Once for each sleep, and once more if another ring of this process was rung for. `is_for_any`: there is more
 * than a new record, so the process must look at all rings. Returns how many were rung. */
static inline uint64_t gates_ring(const struct ring_gates *gates, bool is_for_any,
                                  void (*ring)(int doorbell, uint64_t knock))
{
    uint64_t rung = 0;
    bell_fence(); /* PAIR(sleep): after what became visible. Counterpart: bell_arm() of the arrival bell. */
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
