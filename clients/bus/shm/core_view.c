/* View and Loan: what a memoryview into a ring holds. Made here only, never seen from Python but as memoryview.obj.
 *
 * A View is a pinned record, for reading; the pin goes with the last memoryview of it. A Loan is the place of a
 * record that is being filled. Both keep their mapping.
 */
#include "core.h"

typedef struct {
    PyObject_HEAD
    Mapping *ring, *readers;
    struct reader_slot *slot;
    unsigned pin, forks;
    const void *payload;
    Py_ssize_t size;
} View;

typedef struct {
    PyObject_HEAD
    Mapping *ring;
    void *place;
    Py_ssize_t size;
} Loan;

/* Takes over the pin, also where it fails. */
PyObject *view_new(CoreState *state, Mapping *ring, Mapping *readers, struct reader_slot *slot, unsigned pin,
                   const struct ring_record *record)
{
    View *self = core_allocate(state->view);
    if (self == NULL) {
        ring_unpin(slot, pin);
        return NULL;
    }
    HOLD(ring);
    HOLD(readers);
    self->ring = ring;
    self->readers = readers;
    self->slot = slot;
    self->pin = pin;
    self->forks = core_forks;
    self->payload = record->payload;
    self->size = record->size;
    PyObject *memory = PyMemoryView_FromObject((PyObject *)self);
    DROP(self);
    return memory;
}

static void view_dealloc(PyObject *object)
{
    View *self = (View *)object;
    if (self->forks == core_forks)
        ring_unpin(self->slot, self->pin);
    DROP(self->ring);
    DROP(self->readers);
    core_free(self);
}

static int view_get(PyObject *object, Py_buffer *buffer, int flags)
{
    View *self = (View *)object;
    return PyBuffer_FillInfo(buffer, object, (void *)self->payload, self->size, 1, flags);
}

PyObject *loan_new(CoreState *state, Mapping *ring, void *place, Py_ssize_t size)
{
    Loan *self = core_allocate(state->loan);
    if (self == NULL)
        return NULL;
    HOLD(ring);
    self->ring = ring;
    self->place = place;
    self->size = size;
    PyObject *memory = PyMemoryView_FromObject((PyObject *)self);
    DROP(self);
    return memory;
}

static void loan_dealloc(PyObject *object)
{
    DROP(((Loan *)object)->ring);
    core_free(object);
}

static int loan_get(PyObject *object, Py_buffer *buffer, int flags)
{
    Loan *self = (Loan *)object;
    return PyBuffer_FillInfo(buffer, object, self->place, self->size, 0, flags);
}

static PyType_Slot view_slots[] = {
    {Py_tp_dealloc, (void *)view_dealloc},
    {Py_bf_getbuffer, (void *)view_get},
    {0},
};

static PyType_Slot loan_slots[] = {
    {Py_tp_dealloc, (void *)loan_dealloc},
    {Py_bf_getbuffer, (void *)loan_get},
    {0},
};

#define INNER_TYPE (CORE_TYPE | Py_TPFLAGS_DISALLOW_INSTANTIATION)

PyType_Spec view_spec = {"bus.shm._core.View", sizeof(View), 0, INNER_TYPE, view_slots};
PyType_Spec loan_spec = {"bus.shm._core.Loan", sizeof(Loan), 0, INNER_TYPE, loan_slots};
