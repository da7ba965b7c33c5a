/* What a Writer has published and still has: given out once more, or carried to another ring. */
#include "core.h"

#include <string.h>

/* The own record `seq`, which is between oldest and latest. */
static struct ring_record own_record(const Writer *self, uint64_t seq)
{
    const struct ring_writer *ring = &self->ring;
    /* relaxed: own word */
    const uint64_t at = atomic_load_explicit(&ring->index[seq & (ring->index_length - 1)], memory_order_relaxed);
    const unsigned char *head = ring->data + (at & (ring->capacity - 1));
    return (struct ring_record){seq, load_word(head + 8), (uint32_t)load_word(head + 16), 0, head + RING_HEAD_BYTES};
}

static uint64_t first_since(const Writer *self, uint64_t stamp_ns)
{
    uint64_t seq = self->ring.latest + 1;
    while (seq > self->ring.oldest && own_record(self, seq - 1).stamp_ns >= stamp_ns)
        seq--;
    return seq;
}

PyObject *writer_seq_since(PyObject *object, PyObject *argument)
{
    uint64_t stamp_ns;
    if (!core_as_u64(argument, &stamp_ns))
        return NULL;
    return PyLong_FromUnsignedLongLong(first_since((Writer *)object, stamp_ns));
}

PyObject *writer_since(PyObject *object, PyObject *argument)
{
    Writer *self = (Writer *)object;
    uint64_t stamp_ns;
    if (!core_as_u64(argument, &stamp_ns))
        return NULL;
    const uint64_t end = self->ring.latest + 1;
    uint64_t seq = first_since(self, stamp_ns);
    PyObject *records = PyList_New(0);
    for (; records != NULL && seq < end; seq++) {
        if (seq < self->ring.oldest)
            continue; /* a garbage collection may run anything, also a write */
        const struct ring_record record = own_record(self, seq);
        PyObject *payload = PyBytes_FromStringAndSize(record.payload, record.size);
        PyObject *item = payload == NULL ? NULL
                                         : Py_BuildValue("(KKN)", (unsigned long long)seq,
                                                         (unsigned long long)record.stamp_ns, payload);
        if (item == NULL || PyList_Append(records, item) < 0)
            Py_CLEAR(records);
        Py_XDECREF(item);
    }
    return records;
}

PyObject *writer_carry_from(PyObject *object, PyObject *argument)
{
    uint64_t count;
    if (!core_as_u64(argument, &count))
        return NULL;
    return PyLong_FromUnsignedLongLong(ring_carry_from(&((Writer *)object)->ring, count));
}

static PyObject *does_not_fit(const char *reason)
{
    PyErr_SetString(PyExc_ValueError, reason);
    return NULL;
}

PyObject *writer_move(PyObject *object, PyObject *argument)
{
    Writer *self = (Writer *)object;
    struct ring_writer *old = &self->ring, fresh;
    if (Py_TYPE(argument) != core_state(object)->mapping)
        return PyErr_Format(PyExc_TypeError, "memory must be a Mapping");
    if (self->is_closed)
        return does_not_fit("writer is closed");
    Mapping *memory = (Mapping *)argument, *before = self->memory;
    struct ring_geometry geometry;
    const char *fault = ring_check(memory->memory, (uint64_t)memory->size, &geometry);
    if (fault != NULL)
        return does_not_fit(fault);
    if (!memory->is_writable || memory == before)
        return does_not_fit("ring is read-only or the same");
    ring_writer_attach(&fresh, memory->memory);
    if (fresh.latest + 1 != geometry.first_seq || geometry.first_seq < old->oldest
        || geometry.first_seq > old->latest + 1)
        return does_not_fit("ring is used, or does not begin where this one can be carried from");
    if (ring_carry(&fresh, old) != RING_OK || fresh.oldest != geometry.first_seq)
        return does_not_fit("ring is too small for what is carried");
    fresh.keep = old->keep;
    fresh.hold = old->hold;
    fresh.gates = old->gates;
    fresh.gate_count = old->gate_count;
    for (size_t i = 0; i < fresh.gate_count; i++)
        memset(fresh.gates[i].holes, 0, sizeof fresh.gates[i].holes);
    ring_gates_changed(&fresh);
    bell_disarm(&old->header->room);
    ring_close(old);
    *old = fresh;
    HOLD(memory);
    self->memory = memory;
    DROP(before);
    writer_ring(self, true);
    Py_RETURN_NONE;
}
