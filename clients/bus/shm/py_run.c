/* Runs of the socket route: OpenRun, the frame that a publisher fills, and functions that decode a run's body.
 *
 * OpenRun has no segment. It is in this folder because the core is one compiled file, present as a whole or not at all,
 * and because OpenRun encodes like Writer. Without the core, bus.delivery.open_run does the same in Python, byte for
 * byte.
 */
#include "py.h"

#include <string.h>

/* Layout of frames, as in bus.wire.layout. Wire and machine are little-endian; on another machine, PUT and GET would
 * have to swap bytes. */
enum { FRAME_HEAD = 32, LENGTH = 4, DATA_KIND = 2, RECORD_HEAD = 12 };
/* Longer payloads are decoded in place. */
enum { SHORT_BYTES = 4096 };

#define PUT(place, value) memcpy(place, &(value), sizeof(value))

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "the wire is little-endian"
#endif

typedef struct {
    PyObject_HEAD
    struct encoder encoder;
    PyObject *may_begin; /* called with a sample's size before it begins a run; NULL: it always may */
    PyObject *begun;     /* called with the sample's stamp after that */
    PyObject *frame;     /* bytearray: room for the head, then records; NULL: no run is open */
    uint64_t room;       /* bytes of records that fit into `frame` */
    uint64_t samples, size, budget, most;
    uint64_t begins_below; /* publish() begins a run only with a shorter payload; 0: never */
    uint64_t longest;      /* largest encoding for run_publish(); after a longer one, `is_long` turns it off */
    char is_long;
    uint64_t before; /* size of the last run that had more than one sample; the estimate for the next */
    struct home home;
} OpenRun;

static PyObject *run_new(PyTypeObject *type, PyObject *Py_UNUSED(args), PyObject *Py_UNUSED(kwargs))
{
    OpenRun *self = core_allocate(type);
    if (self == NULL)
        return NULL;
    self->home.thread = PyThread_get_thread_ident();
    self->most = self->longest = UINT64_MAX;
    return (PyObject *)self;
}

static int run_traverse(PyObject *object, visitproc visit, void *arg)
{
    OpenRun *self = (OpenRun *)object;
    Py_VISIT(Py_TYPE(object));
    Py_VISIT(self->encoder.kind);
    Py_VISIT(self->encoder.is_valid);
    Py_VISIT(self->encoder.encode);
    Py_VISIT(self->may_begin);
    Py_VISIT(self->begun);
    Py_VISIT(self->home.is_mine);
    return 0;
}

static int run_clear(PyObject *object)
{
    OpenRun *self = (OpenRun *)object;
    encoder_drop(&self->encoder);
    Py_CLEAR(self->may_begin);
    Py_CLEAR(self->begun);
    Py_CLEAR(self->home.is_mine);
    return 0;
}

static void run_dealloc(PyObject *object)
{
    PyObject_GC_UnTrack(object);
    run_clear(object);
    Py_XDECREF(((OpenRun *)object)->frame);
    core_free(object);
}

/* Whether a payload of that size may go into the open run. */
static inline bool fits(const OpenRun *self, uint64_t size)
{
    return self->budget >= RECORD_HEAD && size <= self->budget - RECORD_HEAD && self->samples < self->most;
}

static bool make_room(OpenRun *self, uint64_t size)
{
    if (size <= self->room)
        return true;
    if (self->frame == NULL) {
        self->frame = PyByteArray_FromStringAndSize(NULL, (Py_ssize_t)(FRAME_HEAD + size));
    } else {
        const uint64_t most = self->before > 2 * self->room ? self->before : 2 * self->room;
        size = size > most ? size : most;
        if (PyByteArray_Resize(self->frame, (Py_ssize_t)(FRAME_HEAD + size)) < 0)
            return false; /* the frame is unchanged */
    }
    self->room = self->frame == NULL ? 0 : size;
    return self->frame != NULL;
}

/* Appends a sample. False: there is no memory for it. */
static bool append(OpenRun *self, const void *payload, uint64_t size, uint64_t stamp_ns)
{
    if (!make_room(self, self->size + RECORD_HEAD + size))
        return false;
    unsigned char *place = (unsigned char *)PyByteArray_AsString(self->frame) + FRAME_HEAD + self->size;
    const uint32_t length = (uint32_t)size;
    PUT(place, length);
    PUT(place + 4, stamp_ns);
    memcpy(place + RECORD_HEAD, payload, size);
    const uint64_t record = RECORD_HEAD + size;
    self->size += record;
    self->budget -= self->samples != 0 ? record : self->budget; /* begin() sets the budget after this */
    self->samples++;
    return true;
}

static PyObject *run_add(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    OpenRun *self = (OpenRun *)object;
    uint64_t stamp_ns = 0;
    if (count < 1 || count > 2) {
        PyErr_SetString(PyExc_TypeError, "a payload is needed, and a stamp at most");
        return NULL;
    }
    if (count == 2 && !core_as_u64(args[1], &stamp_ns))
        return NULL;
    const int is_mine = is_home(&self->home);
    if (is_mine < 0)
        return NULL;
    Py_buffer buffer;
    if (PyObject_GetBuffer(args[0], &buffer, PyBUF_SIMPLE) < 0)
        return NULL;
    const bool does_fit = is_mine && fits(self, (uint64_t)buffer.len);
    const bool is_done = !does_fit || append(self, buffer.buf, (uint64_t)buffer.len,
                                             stamp_ns != 0 ? stamp_ns : core_now_ns());
    PyBuffer_Release(&buffer);
    return is_done ? PyBool_FromLong(does_fit) : NULL;
}

static PyObject *run_begin(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    OpenRun *self = (OpenRun *)object;
    uint64_t stamp_ns;
    if (count != 2) {
        PyErr_SetString(PyExc_TypeError, "a payload and a stamp are needed");
        return NULL;
    }
    if (!core_as_u64(args[1], &stamp_ns))
        return NULL;
    Py_buffer buffer;
    if (PyObject_GetBuffer(args[0], &buffer, PyBUF_SIMPLE) < 0)
        return NULL;
    bool is_done = false;
    if (self->samples != 0) /* checked only now: from Python 3.12 on, Python code may provide a buffer */
        PyErr_SetString(PyExc_ValueError, "a run is open");
    else if ((uint64_t)buffer.len > UINT32_MAX)
        PyErr_SetString(PyExc_OverflowError, "payload is too long for a record");
    else
        is_done = append(self, buffer.buf, (uint64_t)buffer.len, stamp_ns);
    PyBuffer_Release(&buffer);
    return is_done ? Py_NewRef(Py_None) : NULL;
}

static PyObject *run_prepare(PyObject *object, PyObject *args)
{
    return encoder_prepare(&((OpenRun *)object)->encoder, object, args) ? Py_NewRef(Py_None) : NULL;
}

static PyObject *run_begin_by(PyObject *object, PyObject *args)
{
    OpenRun *self = (OpenRun *)object;
    PyObject *begun, *may_begin;
    if (self->begun != NULL) {
        PyErr_SetString(PyExc_ValueError, "run has its ways already");
        return NULL;
    }
    if (!PyArg_ParseTuple(args, "OO", &begun, &may_begin))
        return NULL;
    self->begun = Py_NewRef(begun);
    self->may_begin = may_begin == Py_None ? NULL : Py_NewRef(may_begin);
    Py_RETURN_NONE;
}

/* Adds an encoding to the open run, or begins one with it. 1: done; 0: the run can't take it; -1: an error is set.
 *
 * Must be called only after the message was encoded: its check or its encoder may have published with this very run, or
 * have ended it. */
static int take(OpenRun *self, const void *bytes, uint64_t size)
{
    if (self->samples == 0 && self->may_begin != NULL && size < self->begins_below) {
        PyObject *answer = PyObject_CallFunction(self->may_begin, "K", (unsigned long long)size);
        const bool is_allowed = answer == Py_True;
        Py_XDECREF(answer);
        if (!is_allowed)
            return answer == NULL ? -1 : 0;
    }
    const bool begins = self->samples == 0; /* checked only now: any Python code above may publish here */
    if (begins ? self->begun == NULL || size >= self->begins_below : !fits(self, size))
        return 0;
    const uint64_t stamp_ns = core_now_ns();
    if (!append(self, bytes, size, stamp_ns))
        return -1;
    if (!begins)
        return 1;
    PyObject *stamp = PyLong_FromUnsignedLongLong(stamp_ns), *begun = Py_NewRef(self->begun);
    PyObject *answer = stamp == NULL ? NULL : PyObject_CallFunctionObjArgs(begun, stamp, NULL);
    Py_XDECREF(stamp);
    Py_DECREF(begun);
    Py_XDECREF(answer);
    return answer == NULL ? -1 : 1;
}

/* Publishes a message into the run. Returns True, False if nothing was done, or the message's encoding if the caller
 * must publish that in another way. */
static PyObject *run_publish(PyObject *object, PyObject *message)
{
    OpenRun *self = (OpenRun *)object;
    const struct encoder *encoder = &self->encoder;
    int status = (PyObject *)Py_TYPE(message) == encoder->kind && !self->is_long ? is_home(&self->home) : 0;
    if (status <= 0)
        return status < 0 ? NULL : PyBool_FromLong(0);
    unsigned char bytes[PLAN_BYTES];
    const Py_ssize_t size = encoder->plan == NULL ? PLAN_NONE : plan_encode(encoder->plan, message, bytes, sizeof bytes);
    if (size >= 0) {
        status = take(self, bytes, (uint64_t)size);
        if (status == 0)
            return PyBytes_FromStringAndSize((const char *)bytes, size);
    } else {
        PyObject *payload = encoder_encode(encoder, message);
        if (payload != NULL && !PyBytes_Check(payload))
            Py_CLEAR(payload);
        if (payload == NULL)
            return PyErr_Occurred() ? NULL : PyBool_FromLong(0);
        const uint64_t length = (uint64_t)PyBytes_Size(payload);
        self->is_long = length > self->longest; /* this one is encoded already, but not the next one like it */
        status = take(self, PyBytes_AsString(payload), length);
        if (status == 0)
            return payload;
        Py_DECREF(payload);
    }
    return status < 0 ? NULL : PyBool_FromLong(1);
}

static PyObject *run_write(PyObject *object, PyObject *payload)
{
    OpenRun *self = (OpenRun *)object;
    Py_buffer buffer;
    int status = is_home(&self->home);
    if (status <= 0)
        return status < 0 ? NULL : PyBool_FromLong(0);
    if (PyObject_GetBuffer(payload, &buffer, PyBUF_SIMPLE) < 0)
        return NULL;
    status = take(self, buffer.buf, (uint64_t)buffer.len);
    PyBuffer_Release(&buffer);
    return status < 0 ? NULL : PyBool_FromLong(status);
}

static void forget(OpenRun *self)
{
    self->room = self->samples = self->size = self->budget = 0;
}

static PyObject *run_end(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    OpenRun *self = (OpenRun *)object;
    uint64_t endpoint, first_seq, flags;
    if (count != 3 || !core_as_u64(args[0], &endpoint) || !core_as_u64(args[1], &first_seq)
        || !core_as_u64(args[2], &flags)) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_TypeError, "endpoint, number and flags are needed");
        return NULL;
    }
    if (self->samples == 0 || endpoint > UINT32_MAX || flags > UINT8_MAX) {
        PyErr_SetString(PyExc_ValueError, "no run is open, or a number is too large");
        return NULL;
    }
    if (self->room != self->size && PyByteArray_Resize(self->frame, (Py_ssize_t)(FRAME_HEAD + self->size)) < 0)
        return NULL;
    const struct {
        uint32_t length;
        uint8_t kind, flags;
        uint16_t zero;
        uint32_t endpoint, only_for;
        uint64_t first_seq;
        uint32_t count, last;
    } head = {
        .length = (uint32_t)(FRAME_HEAD - LENGTH + self->size),
        .kind = DATA_KIND,
        .flags = (uint8_t)flags,
        .endpoint = (uint32_t)endpoint,
        .first_seq = first_seq,
        .count = (uint32_t)self->samples,
    };
    _Static_assert(sizeof head == FRAME_HEAD, "the head has no holes");
    PyObject *frame = self->frame;
    PUT(PyByteArray_AsString(frame), head);
    if (self->samples > 1)
        self->before = self->size;
    self->frame = NULL;
    forget(self);
    return frame;
}

static PyObject *run_forget(PyObject *object, PyObject *Py_UNUSED(none))
{
    OpenRun *self = (OpenRun *)object;
    forget(self);
    Py_CLEAR(self->frame);
    Py_RETURN_NONE;
}

/* --- decoding a body */

/* Reads the head of the record at `offset`. False: the body ends before the end of the head or of the payload. */
static bool look(const Py_buffer *body, uint64_t offset, uint32_t *size, int64_t *stamp_ns)
{
    const uint64_t length = (uint64_t)body->len;
    if (offset > length || length - offset < RECORD_HEAD)
        return false;
    const unsigned char *place = (const unsigned char *)body->buf + offset;
    memcpy(size, place, 4);
    memcpy(stamp_ns, place + 4, 8);
    return length - offset - RECORD_HEAD >= *size;
}

/* The payload for the decoder: bytes, or for a long one a part of `view`, a memoryview of the body, made at first
 * use. */
static PyObject *payload_at(PyObject *object, const Py_buffer *body, PyObject **view, uint64_t start, uint32_t size)
{
    if (size < SHORT_BYTES)
        return PyBytes_FromStringAndSize((const char *)body->buf + start, size);
    if (*view == NULL && (*view = PyMemoryView_FromObject(object)) == NULL)
        return NULL;
    return PySequence_GetSlice(*view, (Py_ssize_t)start, (Py_ssize_t)(start + size));
}

/* Common values of a run's samples: their publisher and times. NULL: the caller wants only messages. */
struct origin {
    uint64_t first_seq;
    PyObject *source, *received_ns;
};

static PyObject *decode_run(PyObject *const *args, const struct origin *origin)
{
    uint64_t offset, number;
    if (!core_as_u64(args[1], &offset) || !core_as_u64(args[2], &number))
        return NULL;
    Py_buffer body;
    if (PyObject_GetBuffer(args[0], &body, PyBUF_SIMPLE) < 0)
        return NULL;
    PyObject *list = PyList_New(0), *view = NULL;
    bool is_sound = list != NULL;
    for (uint64_t i = 0; i < number && is_sound; i++) {
        uint32_t size;
        int64_t stamp_ns;
        is_sound = look(&body, offset, &size, &stamp_ns);
        if (!is_sound)
            break;
        uint64_t start = offset + RECORD_HEAD;
        uint32_t length = size;
        int64_t source_ns;
        if (size > SOURCE_BYTES && core_source_time((const unsigned char *)body.buf + start, &source_ns)) {
            start += SOURCE_BYTES;
            length -= SOURCE_BYTES;
            stamp_ns = -source_ns;
        }
        PyObject *payload = payload_at(args[0], &body, &view, start, length), *item = NULL;
        if (payload != NULL)
            item = PyObject_CallFunctionObjArgs(args[3], payload, NULL);
        Py_XDECREF(payload);
        if (item != NULL && origin != NULL)
            item = core_with_origin(item, PyLong_FromLongLong(stamp_ns), origin->first_seq + i, origin->source,
                                    Py_NewRef(origin->received_ns));
        is_sound = item != NULL && PyList_Append(list, item) == 0;
        Py_XDECREF(item);
        offset += RECORD_HEAD + size;
    }
    Py_XDECREF(view);
    PyBuffer_Release(&body);
    if (is_sound)
        return Py_BuildValue("(NK)", list, (unsigned long long)offset);
    Py_XDECREF(list);
    if (PyErr_Occurred() && !PyErr_ExceptionMatches(PyExc_Exception))
        return NULL;
    PyErr_Clear();
    Py_RETURN_NONE;
}

/* run_messages(body, offset, number, decode): (messages, offset behind them). None if one of them is cut off, or
 * can't be decoded. */
PyObject *core_run_messages(PyObject *Py_UNUSED(module), PyObject *const *args, Py_ssize_t count)
{
    if (count != 4) {
        PyErr_SetString(PyExc_TypeError, "body, offset, number and decode are needed");
        return NULL;
    }
    return decode_run(args, NULL);
}

/* run_samples(body, offset, number, decode, first_seq, source, received_ns): the same, with the tuple (message, stamp,
 * number, source, time of receipt) instead of each message. */
PyObject *core_run_samples(PyObject *Py_UNUSED(module), PyObject *const *args, Py_ssize_t count)
{
    struct origin origin;
    if (count != 7) {
        PyErr_SetString(PyExc_TypeError, "body, offset, number, decode, first number, source and time are needed");
        return NULL;
    }
    if (!core_as_u64(args[4], &origin.first_seq))
        return NULL;
    origin.source = args[5];
    origin.received_ns = args[6];
    return decode_run(args, &origin);
}

static PyMethodDef methods[] = {
    {"prepare", run_prepare, METH_VARARGS, NULL},
    {"begin_by", run_begin_by, METH_VARARGS, NULL},
    {"publish", run_publish, METH_O, NULL},
    {"write", run_write, METH_O, NULL},
    {"add", (PyCFunction)(void (*)(void))run_add, METH_FASTCALL, NULL},
    {"begin", (PyCFunction)(void (*)(void))run_begin, METH_FASTCALL, NULL},
    {"end", (PyCFunction)(void (*)(void))run_end, METH_FASTCALL, NULL},
    {"forget", run_forget, METH_NOARGS, NULL},
    {0},
};

static PyMemberDef members[] = {
    {"samples", T_ULONGLONG, offsetof(OpenRun, samples), READONLY, NULL},
    {"size", T_ULONGLONG, offsetof(OpenRun, size), READONLY, NULL},
    {"budget", T_ULONGLONG, offsetof(OpenRun, budget), 0, NULL},
    {"most", T_ULONGLONG, offsetof(OpenRun, most), 0, NULL},
    {"begins_below", T_ULONGLONG, offsetof(OpenRun, begins_below), 0, NULL},
    {"longest", T_ULONGLONG, offsetof(OpenRun, longest), 0, NULL},
    {"is_long", T_BOOL, offsetof(OpenRun, is_long), 0, NULL},
    {"thread", T_ULONG, offsetof(OpenRun, home.thread), 0, NULL},
    {"is_mine", T_OBJECT, offsetof(OpenRun, home.is_mine), 0, NULL},
    {0},
};

static PyType_Slot slots[] = {
    {Py_tp_new, (void *)run_new},
    {Py_tp_dealloc, (void *)run_dealloc},
    {Py_tp_traverse, (void *)run_traverse},
    {Py_tp_clear, (void *)run_clear},
    {Py_tp_methods, methods},
    {Py_tp_members, members},
    {0},
};

PyType_Spec run_spec = {"bus.shm._core.OpenRun", sizeof(OpenRun), 0, CORE_TYPE | Py_TPFLAGS_HAVE_GC, slots};
