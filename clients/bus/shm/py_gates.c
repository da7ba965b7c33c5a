/* A Writer's gates for Python: Bells, and their references. gates.h does the work. */
#include "py.h"

void writer_ring_bells(Writer *self, bool is_for_any)
{
    self->rung += gates_ring(&self->ring.gates, is_for_any, doorbell_ring);
}

/* The gate of `key`; NULL with *is_error if that is no number. */
static struct ring_gate *gate_of(Writer *self, PyObject *key, bool *is_error)
{
    uint64_t number;
    *is_error = !core_as_u64(key, &number);
    return *is_error ? NULL : gates_find(&self->ring.gates, number);
}

static void drop_gate(Writer *self, struct ring_gate *gate)
{
    struct reading_process *process = ring_remove_gate(&self->ring, gate);
    DROP(bell_of(process));
}

void writer_drop_gates(Writer *self)
{
    while (self->ring.gates.count != 0)
        drop_gate(self, &self->ring.gates.list[self->ring.gates.count - 1]);
    gates_free(&self->ring.gates);
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
    if (slot >= bell->process.slot_count) {
        PyErr_Format(PyExc_ValueError, "slot %llu of %llu", (unsigned long long)slot,
                     (unsigned long long)bell->process.slot_count);
        return NULL;
    }
    const struct ring_gate *before = gates_find(&self->ring.gates, key);
    Bell *bell_before = before == NULL ? NULL : bell_of(before->process);
    if (!ring_add_gate(&self->ring, key, &bell->process, slot, is_lossless))
        return PyErr_NoMemory();
    HOLD(bell);
    DROP(bell_before);
    writer_ring_bells(self, true); /* samples published since its last check did not wake it */
    Py_RETURN_NONE;
}

PyObject *writer_remove_gate(PyObject *object, PyObject *key)
{
    Writer *self = (Writer *)object;
    bool is_error;
    struct ring_gate *gate = gate_of(self, key, &is_error);
    if (is_error)
        return NULL;
    if (gate != NULL)
        drop_gate(self, gate);
    Py_RETURN_NONE;
}

PyObject *writer_has_pins(PyObject *object, PyObject *key)
{
    bool is_error;
    const struct ring_gate *gate = gate_of((Writer *)object, key, &is_error);
    return is_error ? NULL : PyBool_FromLong(gate != NULL && gate_has_pins(gate));
}

PyObject *writer_make_lossy(PyObject *object, PyObject *key)
{
    Writer *self = (Writer *)object;
    bool is_error;
    struct ring_gate *gate = gate_of(self, key, &is_error);
    if (is_error)
        return NULL;
    if (gate != NULL)
        ring_make_lossy(&self->ring, gate);
    Py_RETURN_NONE;
}
