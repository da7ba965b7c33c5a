/* Mapping: the bytes of a descriptor, mapped while it or a View or a Loan of it exists. */
#include "py.h"

#include <errno.h>
#include <sys/mman.h>
#include <unistd.h>

/* Maps all pages at once, so that no hot path causes a page fault. */
static PyObject *mapping_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"descriptor", "size", "writable", NULL};
    int descriptor, is_writable = 0;
    Py_ssize_t size;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "in|$p", names, &descriptor, &size, &is_writable))
        return NULL;
    const off_t end = lseek(descriptor, 0, SEEK_END); /* fstat would need glibc 2.33; only mmap uses the file */
    if (end < 0)
        return PyErr_SetFromErrno(PyExc_OSError);
    if (size <= 0 || size > end) {
        errno = EINVAL; /* an access above the file's end would raise a signal */
        return PyErr_SetFromErrno(PyExc_OSError);
    }
    Mapping *self = core_allocate(type);
    if (self == NULL)
        return NULL;
    void *memory;
    Py_BEGIN_ALLOW_THREADS
    memory = mmap(NULL, (size_t)size, is_writable ? PROT_READ | PROT_WRITE : PROT_READ, MAP_SHARED | MAP_POPULATE,
                  descriptor, 0);
    Py_END_ALLOW_THREADS
    if (memory == MAP_FAILED) {
        PyErr_SetFromErrno(PyExc_OSError);
        DROP(self);
        return NULL;
    }
    self->memory = memory;
    self->size = size;
    self->is_writable = is_writable;
    return (PyObject *)self;
}

static void mapping_dealloc(PyObject *object)
{
    Mapping *self = (Mapping *)object;
    if (self->memory != NULL)
        munmap(self->memory, (size_t)self->size);
    core_free(self);
}

/* Whether `bytes` (0: out of bounds) fit into the mapping; else an error is set. */
static bool has_room(const Mapping *self, uint64_t bytes)
{
    if (bytes == 0)
        PyErr_SetString(PyExc_ValueError, "size is out of bounds");
    else if (!self->is_writable || bytes > (uint64_t)self->size)
        PyErr_SetString(PyExc_ValueError, "mapping is read-only or too small");
    else
        return true;
    return false;
}

static PyObject *mapping_format_ring(PyObject *object, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"capacity", "index_length", "first_seq", NULL};
    Mapping *self = (Mapping *)object;
    uint64_t capacity, index_length, first_seq;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O&O&O&", names, core_as_u64, &capacity, core_as_u64,
                                     &index_length, core_as_u64, &first_seq))
        return NULL;
    if (!has_room(self, ring_segment_bytes(capacity, index_length)))
        return NULL;
    if (first_seq == 0 || first_seq > MAX_SEQ) {
        PyErr_SetString(PyExc_ValueError, "first sequence number is out of bounds");
        return NULL;
    }
    ring_format(self->memory, capacity, index_length, first_seq);
    Py_RETURN_NONE;
}

static PyObject *mapping_format_readers(PyObject *object, PyObject *argument)
{
    Mapping *self = (Mapping *)object;
    uint64_t slot_count;
    if (!core_as_u64(argument, &slot_count) || !has_room(self, readers_segment_bytes(slot_count)))
        return NULL;
    readers_format(self->memory, slot_count);
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"format_ring", (PyCFunction)(void (*)(void))mapping_format_ring, KEYWORDS, NULL},
    {"format_readers", mapping_format_readers, METH_O, NULL},
    {0},
};

static PyMemberDef members[] = {{"size", T_PYSSIZET, offsetof(Mapping, size), READONLY, NULL}, {0}};

static PyType_Slot slots[] = {
    {Py_tp_new, (void *)mapping_new},
    {Py_tp_dealloc, (void *)mapping_dealloc},
    {Py_tp_methods, methods},
    {Py_tp_members, members},
    {0},
};

PyType_Spec mapping_spec = {"bus.shm._core.Mapping", sizeof(Mapping), 0, CORE_TYPE, slots};

/* --- View and Loan: the owners of memoryviews into a ring. Only this file makes them; Python sees them only as
 * memoryview.obj.
 *
 * A View is a pinned record, for reading; the pin is released with the last memoryview of it. A Loan is the place of a
 * record that the program fills. Both keep their mapping.
 */

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

/* Makes a View, which takes over the pin. A failure releases the pin. */
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
