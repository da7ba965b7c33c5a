/* A Writer's gates: the readers of its ring, and the bells that are rung for them. */
#include "py.h"

#include <string.h>

void writer_ring_bells(Writer *self, bool is_for_any)
{
    bell_fence(); /* PAIR(sleep): after what was published. Counterpart: bell_arm() of Readers.sleep. */
    for (size_t i = 0; i < self->bell_count; i++) {
        Bell *bell = self->bells[i].bell;
        const bool is_one = !is_for_any && bell->gates > FEW_RINGS;
        const uint64_t knock = bell_knock(bell->arrival, &bell->knocks, self, is_one ? self->bells[i].knock : KNOCK_ANY);
        if (knock != 0) {
            doorbell_ring(bell->doorbell, knock);
            self->rung++;
        }
    }
}

static bool make_room(Writer *self)
{
    if (self->ring.gate_count < self->room)
        return true;
    const size_t room = self->room == 0 ? 4 : 2 * self->room;
    struct ring_gate *gates = PyMem_Realloc(self->ring.gates, room * sizeof *gates);
    if (gates != NULL)
        self->ring.gates = gates;
    struct gate_owner *owners = PyMem_Realloc(self->owners, room * sizeof *owners);
    if (owners != NULL)
        self->owners = owners;
    struct bell_pull *bells = PyMem_Realloc(self->bells, room * sizeof *bells);
    if (bells != NULL)
        self->bells = bells;
    if (gates == NULL || owners == NULL || bells == NULL)
        return false;
    self->room = room;
    return true;
}

static void list_bells(Writer *self)
{
    self->bell_count = 0;
    for (size_t i = 0; i < self->ring.gate_count; i++) {
        Bell *bell = self->owners[i].bell;
        size_t at = 0;
        while (at < self->bell_count && self->bells[at].bell != bell)
            at++;
        if (at == self->bell_count)
            self->bells[self->bell_count++] =
                (struct bell_pull){bell, knock_for((uint64_t)(self->ring.gates[i].slot - bell->slots))};
        else
            self->bells[at].knock = KNOCK_ANY;
    }
}

static size_t find_gate(const Writer *self, uint64_t key)
{
    size_t at = 0;
    while (at < self->ring.gate_count && self->owners[at].key != key)
        at++;
    return at;
}

/* The gate of `key`; NULL with *is_error where that is no number. */
static struct ring_gate *gate_of(Writer *self, PyObject *key, bool *is_error)
{
    uint64_t number;
    *is_error = !core_as_u64(key, &number);
    if (*is_error)
        return NULL;
    const size_t at = find_gate(self, number);
    return at < self->ring.gate_count ? &self->ring.gates[at] : NULL;
}

/* The bell forgets what this writer rang for: its gates change, and another writer may get its address. */
static void forget_knock(const Writer *self, Bell *bell)
{
    if (bell->knocks.by == self)
        bell->knocks.by = bell;
}

static void drop_gate(Writer *self, size_t at)
{
    Bell *bell = self->owners[at].bell;
    const size_t last = --self->ring.gate_count;
    self->owners[at] = self->owners[last];
    self->ring.gates[at] = self->ring.gates[last];
    list_bells(self);
    ring_gates_changed(&self->ring);
    forget_knock(self, bell);
    bell->gates--;
    DROP(bell);
}

void writer_drop_gates(Writer *self)
{
    while (self->ring.gate_count != 0)
        drop_gate(self, self->ring.gate_count - 1);
}

PyObject *writer_add_gate(PyObject *object, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"key", "bell", "slot", "is_lossless", NULL};
    Writer *self = (Writer *)object;
    uint64_t key, slot;
    PyObject *argument;
    int is_lossless;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O&OO&$p", names, core_as_u64, &key, &argument, core_as_u64, &slot,
                                     &is_lossless))
        return NULL;
    if (Py_TYPE(argument) != core_state(object)->bell) {
        PyErr_SetString(PyExc_TypeError, "bell must be a Bell");
        return NULL;
    }
    Bell *bell = (Bell *)argument;
    if (slot >= bell->slot_count) {
        PyErr_Format(PyExc_ValueError, "slot %llu of %llu", (unsigned long long)slot,
                     (unsigned long long)bell->slot_count);
        return NULL;
    }
    struct ring_gate gate = {.slot = &bell->slots[slot], .is_lossless = is_lossless};
    const size_t before = find_gate(self, key);
    if (before < self->ring.gate_count) {
        if (self->ring.gates[before].slot == gate.slot)
            memcpy(gate.holes, self->ring.gates[before].holes, sizeof gate.holes);
    } else if (!make_room(self)) {
        return PyErr_NoMemory();
    }
    HOLD(bell);
    if (before < self->ring.gate_count)
        drop_gate(self, before);
    self->ring.gates[self->ring.gate_count] = gate;
    self->owners[self->ring.gate_count++] = (struct gate_owner){key, bell};
    bell->gates++;
    forget_knock(self, bell);
    list_bells(self);
    ring_gates_changed(&self->ring);
    ring_admit(&self->ring, gate.slot);
    writer_ring_bells(self, true); /* what was published since its last look did not wake it */
    Py_RETURN_NONE;
}

PyObject *writer_remove_gate(PyObject *object, PyObject *key)
{
    Writer *self = (Writer *)object;
    bool is_error;
    const struct ring_gate *gate = gate_of(self, key, &is_error);
    if (is_error)
        return NULL;
    if (gate != NULL)
        drop_gate(self, (size_t)(gate - self->ring.gates));
    Py_RETURN_NONE;
}

PyObject *writer_has_pins(PyObject *object, PyObject *key)
{
    bool is_error, has_pins = false;
    const struct ring_gate *gate = gate_of((Writer *)object, key, &is_error);
    if (is_error)
        return NULL;
    for (unsigned i = 0; gate != NULL && i < READER_PINS; i++) {
        /* PAIR(unpin): acquire. Where it is free, the holder's reads are over. Counterpart: ring_unpin(). */
        const uint64_t pin = atomic_load_explicit(&gate->slot->pins[i], memory_order_acquire);
        has_pins |= pin != 0 && (pin & READER_TICKET) == 0;
    }
    return PyBool_FromLong(has_pins);
}

PyObject *writer_make_lossy(PyObject *object, PyObject *key)
{
    Writer *self = (Writer *)object;
    bool is_error;
    struct ring_gate *gate = gate_of(self, key, &is_error);
    if (is_error)
        return NULL;
    if (gate != NULL)
        gate->is_lossless = false;
    ring_gates_changed(&self->ring);
    Py_RETURN_NONE;
}
