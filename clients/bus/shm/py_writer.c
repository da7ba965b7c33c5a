/* Writer: a publisher's end of its ring. It writes, lends places, and continues in another ring. */
#include "py.h"

#include <string.h>

/* Most parts of a record that are kept on the stack; more cost an allocation. */
enum { FEW_PARTS = 16 };

/* --- beginning and end */

static PyObject *writer_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"memory", "keep", NULL};
    const CoreState *state = PyType_GetModuleState(type);
    Mapping *memory;
    uint64_t keep;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O!O&", names, state->mapping, &memory, core_as_u64, &keep))
        return NULL;
    struct ring_geometry geometry;
    const char *fault = ring_check(memory->memory, (uint64_t)memory->size, &geometry);
    if (fault == NULL && !memory->is_writable)
        fault = "mapping is read-only";
    if (fault != NULL) {
        PyErr_SetString(PyExc_ValueError, fault);
        return NULL;
    }
    Writer *self = core_allocate(type);
    if (self == NULL)
        return NULL;
    ring_writer_attach(&self->ring, memory->memory);
    self->ring.keep = keep == 0 ? 1 : keep;
    HOLD(memory);
    self->memory = memory;
    self->home.thread = PyThread_get_thread_ident();
    self->forks = core_forks;
    self->is_report_due = 1;
    self->most = self->longest = UINT64_C(1) << 62;
    return (PyObject *)self;
}

static void writer_dealloc(PyObject *object)
{
    Writer *self = (Writer *)object;
    writer_drop_gates(self);
    encoder_drop(&self->encoder);
    Py_XDECREF(self->home.is_mine);
    DROP(self->memory);
    core_free(self);
}

/* --- writing */

static PyObject *refused(enum ring_status status)
{
    switch (status) {
    case RING_FULL:
        return PyLong_FromLong(FULL);
    case RING_SHORT:
        return PyLong_FromLong(SHORT);
    case RING_PINNED:
        return PyLong_FromLong(PINNED);
    case RING_HELD:
        return PyLong_FromLong(HELD);
    default:
        return PyLong_FromLong(TOO_LARGE);
    }
}

static PyObject *refused_for_now(Writer *self, enum ring_status status)
{
    writer_is_refused(self, status);
    return refused(status);
}

static inline PyObject *published(Writer *self, uint64_t size)
{
    self->samples++;
    self->bytes += size;
    writer_ring_bells(self, false);
    if (self->is_report_due)
        Py_RETURN_TRUE;
    self->is_report_due = 1;
    return PyLong_FromLong(REPORT_DUE);
}

static inline PyObject *put(Writer *self, const void *bytes, Py_ssize_t size)
{
    if ((uint64_t)size > self->ring.max_payload || (uint64_t)size > self->most)
        return PyLong_FromLong(TOO_LARGE);
    const enum ring_status status = ring_write(&self->ring, bytes, (uint32_t)size, writer_next_stamp(self, core_now_ns()), 0,
                                              false);
    return status == RING_OK ? published(self, (uint64_t)size) : refused_for_now(self, status);
}

static PyObject *write_payload(Writer *self, PyObject *payload, uint64_t most)
{
    PyObject *outcome;
    if (!writer_is_open(self, &outcome))
        return outcome;
    if (PyBytes_Check(payload)) {
        const Py_ssize_t size = PyBytes_Size(payload);
        return (uint64_t)size > most ? PyBool_FromLong(0) : put(self, PyBytes_AsString(payload), size);
    }
    Py_buffer buffer;
    if (PyObject_GetBuffer(payload, &buffer, PyBUF_SIMPLE) < 0)
        return NULL;
    outcome = (uint64_t)buffer.len > most ? PyBool_FromLong(0) : put(self, buffer.buf, buffer.len);
    PyBuffer_Release(&buffer);
    return outcome;
}

/* The quick way of an encoded sample. False: nothing was done. */
static PyObject *writer_write(PyObject *object, PyObject *payload)
{
    Writer *self = (Writer *)object;
    PyObject *outcome;
    if (!writer_is_open(self, &outcome))
        return outcome;
    if (self->is_lent)
        Py_RETURN_FALSE;
    return write_payload(self, payload, QUICK_BYTES);
}

static PyObject *writer_prepare(PyObject *object, PyObject *args)
{
    return encoder_prepare(&((Writer *)object)->encoder, object, args) ? Py_NewRef(Py_None) : NULL;
}

/* Writes the long field between the `around` bytes of the rest. */
static PyObject *put_long(Writer *self, const unsigned char *bytes, uint64_t around, const struct plan_long *field)
{
    const uint64_t gap = (uint64_t)field->gap, whole = around + field->size;
    PyObject *outcome;
    unsigned char *place;
    if (field->size > self->most_long)
        Py_RETURN_FALSE;
    if (!writer_is_open(self, &outcome))
        return outcome;
    if (whole > self->most)
        return PyLong_FromLong(TOO_LARGE);
    const enum ring_status status = ring_reserve(&self->ring, whole, false, (void **)&place);
    if (status != RING_OK)
        return refused_for_now(self, status);
    copy_to_shared(place, bytes, gap);
    copy_to_shared(place + gap, field->bytes, field->size);
    copy_to_shared(place + gap + field->size, bytes + gap, around - gap);
    ring_publish(&self->ring, (uint32_t)whole, writer_next_stamp(self, core_now_ns()), 0);
    return published(self, whole);
}

/* Publishes a message with a long field, which is copied once, from where it lies straight to its place. The same in
 * steps costs calls of Python code more, and at 64 KiB a copy. NULL without an error: nothing was done. */
static PyObject *publish_long(Writer *self, PyObject *message)
{
    unsigned char bytes[PLAN_BYTES];
    struct plan_long field;
    const Py_ssize_t around = plan_encode_long(self->encoder.plan, message, bytes, sizeof bytes, &field);
    if (around < 0)
        return NULL;
    PyObject *outcome = put_long(self, bytes, (uint64_t)around, &field);
    Py_DECREF(field.value);
    return outcome;
}

/* The quick way of a publish: check, encode, write. False: nothing was done; the caller goes step by step, and gets an
 * error of the encoder again. */
static PyObject *writer_publish(PyObject *object, PyObject *message)
{
    Writer *self = (Writer *)object;
    const struct encoder *encoder = &self->encoder;
    PyObject *outcome;
    if ((PyObject *)Py_TYPE(message) != encoder->kind || self->is_long || self->is_lent)
        Py_RETURN_FALSE;
    if (encoder->plan != NULL) {
        unsigned char bytes[PLAN_BYTES];
        const Py_ssize_t size = plan_encode(encoder->plan, message, bytes, sizeof bytes);
        if (size >= 0)
            return writer_is_open(self, &outcome) ? put(self, bytes, size) : outcome;
        outcome = size == PLAN_SHORT ? publish_long(self, message) : NULL;
        if (outcome != NULL || PyErr_Occurred())
            return outcome;
    }
    if (self->plans_only)
        Py_RETURN_FALSE;
    PyObject *payload = encoder_encode(encoder, message);
    if (payload == NULL)
        return PyErr_Occurred() ? NULL : PyBool_FromLong(0);
    /* After a long message, expect more of them: writer_write_parts() copies them once less. */
    self->is_long = PyBytes_Check(payload) && (uint64_t)PyBytes_Size(payload) > self->longest;
    outcome = write_payload(self, payload, UINT64_MAX);
    Py_DECREF(payload);
    return outcome;
}

/* Reserves, copies and publishes; the buffers are held by the caller. */
static PyObject *put_parts(Writer *self, const Py_buffer *parts, Py_ssize_t count, bool force, uint64_t stamp_ns)
{
    uint64_t size = 0;
    for (Py_ssize_t i = 0; i < count && size <= self->ring.max_payload; i++)
        size += (uint64_t)parts[i].len;
    if (size > self->most)
        return PyLong_FromLong(TOO_LARGE);
    void *payload;
    const enum ring_status status = ring_reserve(&self->ring, size, force, &payload);
    if (status != RING_OK)
        return refused(status);
    unsigned char *place = payload;
    for (Py_ssize_t i = 0; i < count; i++) {
        copy_to_shared(place, parts[i].buf, (uint64_t)parts[i].len);
        place += parts[i].len;
    }
    ring_publish(&self->ring, (uint32_t)size, writer_next_stamp(self, stamp_ns != 0 ? stamp_ns : core_now_ns()), 0);
    return published(self, size);
}

/* The bytes of a buffer, or the UTF-8 of a text, which the text object keeps. False: an error is set. */
static bool get_part(PyObject *part, Py_buffer *buffer)
{
    if (!PyUnicode_Check(part))
        return PyObject_GetBuffer(part, buffer, PyBUF_SIMPLE) == 0;
    *buffer = (Py_buffer){0};
    buffer->buf = (void *)PyUnicode_AsUTF8AndSize(part, &buffer->len);
    return buffer->buf != NULL;
}

static PyObject *writer_write_parts(PyObject *object, PyObject *const *args, Py_ssize_t count, PyObject *kwnames)
{
    static const char *const names[] = {"parts", "force", "stamp_ns", NULL};
    Writer *self = (Writer *)object;
    PyObject *values[3], *outcome = NULL;
    if (core_arguments(names, args, count, kwnames, 1, values) < 0)
        return NULL;
    uint64_t stamp_ns = 0;
    if (values[2] != NULL && !core_as_u64(values[2], &stamp_ns))
        return NULL;
    const int force = values[1] == NULL ? 0 : PyObject_IsTrue(values[1]);
    if (force < 0)
        return NULL;
    if (values[0] == NULL) {
        PyErr_SetString(PyExc_TypeError, "parts are missing");
        return NULL;
    }
    PyObject *parts = PySequence_Tuple(values[0]); /* a tuple can't change while its buffers are requested */
    if (parts == NULL)
        return NULL;
    const Py_ssize_t length = PyTuple_Size(parts);
    Py_buffer few[FEW_PARTS], *buffers = few;
    Py_ssize_t held = 0;
    if (length > FEW_PARTS && (buffers = PyMem_Malloc((size_t)length * sizeof *buffers)) == NULL) {
        Py_DECREF(parts);
        return PyErr_NoMemory();
    }
    while (held < length && get_part(PyTuple_GetItem(parts, held), &buffers[held]))
        held++;
    if (held == length)
        outcome = writer_is_open(self, &outcome) ? put_parts(self, buffers, length, force, stamp_ns) : outcome;
    while (held > 0)
        PyBuffer_Release(&buffers[--held]);
    if (buffers != few)
        PyMem_Free(buffers);
    Py_DECREF(parts);
    return outcome;
}

/* Lends `size` bytes at `place`, in the reserved record of `whole` bytes. */
static PyObject *lent_out(Writer *self, uint64_t whole, void *place, Py_ssize_t size)
{
    self->lent = (uint32_t)whole;
    self->is_lent = 1; /* before any allocation: a garbage collection may run any code, even a write */
    PyObject *loan = loan_new(core_state((PyObject *)self), self->memory, place, size);
    if (loan == NULL)
        self->is_lent = 0;
    return loan;
}

static PyObject *writer_lend(PyObject *object, PyObject *const *args, Py_ssize_t count, PyObject *kwnames)
{
    static const char *const names[] = {"size", "force", NULL};
    Writer *self = (Writer *)object;
    PyObject *values[2];
    if (core_arguments(names, args, count, kwnames, 1, values) < 0)
        return NULL;
    const int force = values[1] == NULL ? 0 : PyObject_IsTrue(values[1]);
    if (force < 0)
        return NULL;
    const Py_ssize_t size = values[0] == NULL ? -1 : PyLong_AsSsize_t(values[0]);
    if (size < 0) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_ValueError, "size must be a number from 0 on");
        return NULL;
    }
    PyObject *outcome;
    if (!writer_is_open(self, &outcome))
        return outcome;
    if ((uint64_t)size > self->most)
        return PyLong_FromLong(TOO_LARGE);
    void *payload;
    const enum ring_status status = ring_reserve(&self->ring, (uint64_t)size, force, &payload);
    if (status != RING_OK)
        return refused(status);
    return lent_out(self, (uint64_t)size, payload, size);
}

/* The quick way of a loan: encodes around the field, lends its place, and makes the caller's object. This is one
 * step, so that a signal handler that raises an exception can't leave a loan that no object returns. False: as in
 * writer_publish(). */
static PyObject *writer_lend_field(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    Writer *self = (Writer *)object;
    const struct encoder *encoder = &self->encoder;
    unsigned char bytes[PLAN_BYTES], *place;
    Py_ssize_t gap;
    PyObject *outcome;
    if (count != 5) {
        PyErr_SetString(PyExc_TypeError, "message, index, size, the loan's class and what ends it are needed");
        return NULL;
    }
    const Py_ssize_t index = PyLong_AsSsize_t(args[1]), size = PyLong_AsSsize_t(args[2]);
    if (PyErr_Occurred()) {
        PyErr_Clear();
        Py_RETURN_FALSE;
    }
    if (encoder->plan == NULL || self->is_lent || size < 0)
        Py_RETURN_FALSE;
    const Py_ssize_t around = plan_encode_around(encoder->plan, args[0], index, (uint64_t)size, bytes, sizeof bytes,
                                                 &gap);
    if (around < 0)
        Py_RETURN_FALSE;
    if (!writer_is_open(self, &outcome))
        return outcome;
    const uint64_t whole = (uint64_t)(around + size);
    if (whole > self->most)
        return PyLong_FromLong(TOO_LARGE);
    const enum ring_status status = ring_reserve(&self->ring, whole, false, (void **)&place);
    if (status != RING_OK)
        return refused_for_now(self, status);
    copy_to_shared(place, bytes, (uint64_t)gap);
    copy_to_shared(place + gap + size, bytes + gap, (uint64_t)(around - gap));
    PyObject *buffer = lent_out(self, whole, place + gap, size);
    if (buffer == NULL)
        return NULL;
    PyObject *loan = PyObject_CallFunctionObjArgs(args[3], buffer, args[4], NULL);
    Py_DECREF(buffer);
    if (loan == NULL)
        self->is_lent = 0;
    return loan;
}

static PyObject *writer_lent(PyObject *object, PyObject *Py_UNUSED(none))
{
    const Writer *self = (const Writer *)object;
    const struct ring_writer *ring = &self->ring;
    void *place = ring->data + (ring->head & (ring->capacity - 1)) + RING_HEAD_BYTES;
    return loan_new(core_state(object), self->memory, place, self->is_lent && ring->loan != 0 ? self->lent : 0);
}

static PyObject *writer_publish_lent(PyObject *object, PyObject *Py_UNUSED(none))
{
    Writer *self = (Writer *)object;
    PyObject *outcome;
    if (!writer_is_open(self, &outcome))
        return outcome;
    if (!self->is_lent || self->ring.loan == 0) {
        PyErr_SetString(PyExc_ValueError, "nothing is lent: the loan ended, or another write took the place back");
        return NULL;
    }
    if (self->lent > self->most) /* `most` has become smaller since */
        return PyLong_FromLong(TOO_LARGE);
    self->is_lent = 0;
    ring_publish(&self->ring, self->lent, writer_next_stamp(self, core_now_ns()), 0);
    return published(self, self->lent);
}

static PyObject *writer_wait_for_room(PyObject *object, PyObject *Py_UNUSED(none))
{
    return PyBool_FromLong(ring_wait_for_room(&((Writer *)object)->ring));
}

static PyObject *writer_woken(PyObject *object, PyObject *Py_UNUSED(none))
{
    bell_disarm(&((Writer *)object)->ring.header->room);
    Py_RETURN_NONE;
}

static PyObject *writer_close(PyObject *object, PyObject *Py_UNUSED(none))
{
    Writer *self = (Writer *)object;
    if (!self->is_closed) {
        self->is_closed = true;
        ring_close(&self->ring);
        writer_ring_bells(self, true);
    }
    Py_RETURN_NONE;
}

/* --- published records that the ring still has: read once more, or carried to another ring */

/* The writer's own record `seq`, which is between oldest and latest. */
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

static PyObject *writer_seq_since(PyObject *object, PyObject *argument)
{
    uint64_t stamp_ns;
    if (!core_as_u64(argument, &stamp_ns))
        return NULL;
    return PyLong_FromUnsignedLongLong(first_since((Writer *)object, stamp_ns));
}

static PyObject *writer_since(PyObject *object, PyObject *argument)
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
            continue; /* a garbage collection may run any code, even a write */
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

static PyObject *writer_carry_from(PyObject *object, PyObject *argument)
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

static PyObject *writer_move(PyObject *object, PyObject *argument)
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
    ring_go_on(old, &fresh);
    HOLD(memory);
    self->memory = memory;
    DROP(before);
    writer_ring_bells(self, true);
    Py_RETURN_NONE;
}

/* --- attributes */

static PyObject *get_keep(PyObject *object, void *Py_UNUSED(closure))
{
    return PyLong_FromUnsignedLongLong(((Writer *)object)->ring.keep);
}

static PyObject *get_hold(PyObject *object, void *Py_UNUSED(closure))
{
    const uint64_t hold = ((Writer *)object)->ring.hold;
    return PyLong_FromUnsignedLongLong(hold == UINT64_MAX ? 0 : hold);
}

/* Sets *word to a number from 0 on; 0 itself stands for `zero`. */
static int set_number(PyObject *value, uint64_t *word, uint64_t zero)
{
    uint64_t number;
    if (value == NULL) {
        PyErr_SetString(PyExc_AttributeError, "can't be deleted");
        return -1;
    }
    if (!core_as_u64(value, &number))
        return -1;
    *word = number == 0 ? zero : number;
    return 0;
}

static PyObject *get_most(PyObject *object, void *Py_UNUSED(closure))
{
    return PyLong_FromUnsignedLongLong(((Writer *)object)->most);
}

static int set_most(PyObject *object, PyObject *value, void *Py_UNUSED(closure))
{
    return set_number(value, &((Writer *)object)->most, 0);
}

static int set_keep(PyObject *object, PyObject *value, void *Py_UNUSED(closure))
{
    return set_number(value, &((Writer *)object)->ring.keep, 1);
}

static int set_hold(PyObject *object, PyObject *value, void *Py_UNUSED(closure))
{
    ((Writer *)object)->ring.floor = 0; /* the old floor may be above the new hold */
    return set_number(value, &((Writer *)object)->ring.hold, UINT64_MAX);
}

/* Values that only tests use. */
static PyObject *writer_debug(PyObject *object, PyObject *Py_UNUSED(none))
{
    const Writer *self = (Writer *)object;
    uint64_t lossless = 0;
    for (size_t i = 0; i < self->ring.gates.count; i++)
        lossless += self->ring.gates.list[i].is_lossless;
    const uint64_t taken = gates_taken(&self->ring.gates, self->ring.latest + 1);
    return Py_BuildValue("{sKsKsKsKsK}", "index_length", (unsigned long long)self->ring.index_length, "lossless",
                         (unsigned long long)lossless, "max_payload", (unsigned long long)self->ring.max_payload,
                         "rung", (unsigned long long)self->rung, "taken", (unsigned long long)taken);
}

static PyMethodDef methods[] = {
    {"write", writer_write, METH_O, NULL},
    {"prepare", writer_prepare, METH_VARARGS, NULL},
    {"publish", writer_publish, METH_O, NULL},
    {"publish_packed", (PyCFunction)(void (*)(void))writer_publish_packed, METH_FASTCALL, NULL},
    {"write_parts", (PyCFunction)(void (*)(void))writer_write_parts, FAST_KEYWORDS, NULL},
    {"lend", (PyCFunction)(void (*)(void))writer_lend, FAST_KEYWORDS, NULL},
    {"lend_field", (PyCFunction)(void (*)(void))writer_lend_field, METH_FASTCALL, NULL},
    {"lent", writer_lent, METH_NOARGS, NULL},
    {"publish_lent", writer_publish_lent, METH_NOARGS, NULL},
    {"since", writer_since, METH_O, NULL},
    {"seq_since", writer_seq_since, METH_O, NULL},
    {"add_gate", (PyCFunction)(void (*)(void))writer_add_gate, KEYWORDS, NULL},
    {"remove_gate", writer_remove_gate, METH_O, NULL},
    {"has_pins", writer_has_pins, METH_O, NULL},
    {"make_lossy", writer_make_lossy, METH_O, NULL},
    {"wait_for_room", writer_wait_for_room, METH_NOARGS, NULL},
    {"woken", writer_woken, METH_NOARGS, NULL},
    {"carry_from", writer_carry_from, METH_O, NULL},
    {"move", writer_move, METH_O, NULL},
    {"close", writer_close, METH_NOARGS, NULL},
    {"_debug", writer_debug, METH_NOARGS, NULL},
    {0},
};

static PyMemberDef members[] = {
    {"capacity", T_ULONGLONG, offsetof(Writer, ring.capacity), READONLY, NULL},
    {"latest", T_ULONGLONG, offsetof(Writer, ring.latest), READONLY, NULL},
    {"oldest", T_ULONGLONG, offsetof(Writer, ring.oldest), READONLY, NULL},
    {"samples", T_ULONGLONG, offsetof(Writer, samples), READONLY, NULL},
    {"bytes", T_ULONGLONG, offsetof(Writer, bytes), READONLY, NULL},
    {"is_mine", T_OBJECT, offsetof(Writer, home.is_mine), 0, NULL},
    {"is_report_due", T_BOOL, offsetof(Writer, is_report_due), 0, NULL},
    {"is_long", T_BOOL, offsetof(Writer, is_long), 0, NULL},
    {"is_lent", T_BOOL, offsetof(Writer, is_lent), 0, NULL},
    {"longest", T_ULONGLONG, offsetof(Writer, longest), 0, NULL},
    {"most_long", T_ULONGLONG, offsetof(Writer, most_long), 0, NULL},
    {"plans_only", T_BOOL, offsetof(Writer, plans_only), 0, NULL},
    {0},
};

static PyGetSetDef properties[] = {
    {"keep", get_keep, set_keep, NULL, NULL},
    {"hold", get_hold, set_hold, NULL, NULL},
    {"most", get_most, set_most, NULL, NULL},
    {0},
};

static PyType_Slot slots[] = {
    {Py_tp_new, (void *)writer_new},
    {Py_tp_dealloc, (void *)writer_dealloc},
    {Py_tp_methods, methods},
    {Py_tp_members, members},
    {Py_tp_getset, properties},
    {0},
};

PyType_Spec writer_spec = {"bus.shm._core.Writer", sizeof(Writer), 0, CORE_TYPE, slots};
