/* The module bus_bag.core._core: records.h and crc.h for Python, limited API of Python 3.11. See _core.pyi. */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "crc.h"
#include "records.h"

enum {
    LEAST_ROOM = 4096,
    SHORT = 16 << 10 /* work on fewer bytes keeps the GIL: to get it back takes longer */
};

typedef struct {
    PyObject_HEAD
    size_t size;
    uint8_t *operations;
} Program;

static PyObject *new_program(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *words[] = {"", NULL};
    Py_buffer operations;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "y*", words, &operations))
        return NULL;
    Program *self = NULL;
    if (!program_is_valid(operations.buf, (size_t)operations.len)) {
        PyErr_Format(PyExc_ValueError, "%zd bytes are no program", operations.len);
    } else {
        const allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
        self = (Program *)allocate(type, 0); /* zeroed */
    }
    if (self != NULL) {
        self->size = (size_t)operations.len;
        self->operations = PyMem_Malloc(self->size);
        if (self->operations == NULL) {
            Py_CLEAR(self);
            PyErr_NoMemory();
        } else {
            memcpy(self->operations, operations.buf, self->size);
        }
    }
    PyBuffer_Release(&operations);
    return (PyObject *)self;
}

static void free_program(PyObject *object)
{
    PyTypeObject *type = Py_TYPE(object);
    PyMem_Free(((Program *)object)->operations);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(object);
    Py_DECREF(type);
}

/* Runs without the GIL, if the work is long enough. */
static enum packing_status run(struct packing *work, uint8_t **places)
{
    enum packing_status status;
    if (work->end - work->at < SHORT)
        return packing_run(work, places);
    Py_BEGIN_ALLOW_THREADS
    status = packing_run(work, places);
    Py_END_ALLOW_THREADS
    return status;
}

/* Doubles the buffer. False: an error is set. */
static bool grow(struct cdr *out, PyObject *records)
{
    if (PyByteArray_Resize(records, (Py_ssize_t)(2 * out->room)) < 0)
        return false;
    out->bytes = (uint8_t *)PyByteArray_AsString(records);
    out->room *= 2;
    return true;
}

/* Fills both buffers. False: an error is set, or without one, a message was refused. */
static bool fill(struct packing *work, PyObject *records, PyObject *places)
{
    uint8_t *place = (uint8_t *)PyBytes_AsString(places);
    enum packing_status status;
    while ((status = run(work, &place)) == PACKING_FULL)
        if (!grow(&work->out, records))
            return false;
    return status == PACKING_DONE && PyByteArray_Resize(records, (Py_ssize_t)work->out.size) == 0;
}

static PyObject *records_of(Program *self, const uint8_t *pack, size_t size, struct packing *work)
{
    uint64_t count;
    if (!packing_count(pack, pack + size, &count))
        Py_RETURN_NONE;
    work->program = self->operations;
    work->at = pack;
    work->end = pack + size;
    work->out.room = size + size / 4 + count * (RECORD_HEAD + MESSAGE_HEAD - PACKED_HEAD + MOST_ALIGNMENT) + LEAST_ROOM;
    PyObject *records = PyByteArray_FromStringAndSize(NULL, (Py_ssize_t)work->out.room);
    PyObject *places = PyBytes_FromStringAndSize(NULL, (Py_ssize_t)(count * PLACE_SIZE)), *found = NULL;
    if (records != NULL && places != NULL) {
        work->out.bytes = (uint8_t *)PyByteArray_AsString(records);
        if (fill(work, records, places))
            found = Py_BuildValue("(OO)", records, places);
        else if (!PyErr_Occurred())
            found = Py_NewRef(Py_None);
    }
    Py_XDECREF(records);
    Py_XDECREF(places);
    return found;
}

static PyObject *program_records(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    if (count != 4) {
        PyErr_SetString(PyExc_TypeError, "pack, channel, log_time and base are needed");
        return NULL;
    }
    if (!PyBytes_Check(args[0])) { /* another buffer might change while the GIL is released, after it was checked */
        PyErr_SetString(PyExc_TypeError, "pack must be bytes");
        return NULL;
    }
    const unsigned long channel = PyLong_AsUnsignedLong(args[1]);
    struct packing work = {.channel = (uint16_t)channel};
    if (!PyErr_Occurred() && channel > UINT16_MAX)
        PyErr_Format(PyExc_OverflowError, "channel is %lu, and at most 65535", channel);
    if (!PyErr_Occurred())
        work.log_time = PyLong_AsUnsignedLongLong(args[2]);
    if (!PyErr_Occurred())
        work.base = PyLong_AsUnsignedLongLong(args[3]);
    if (PyErr_Occurred())
        return NULL;
    const uint8_t *pack = (const uint8_t *)PyBytes_AsString(args[0]);
    return records_of((Program *)object, pack, (size_t)PyBytes_Size(args[0]), &work);
}

/* The CDR message of a payload. *scratch: a buffer that grows as needed. NULL: an error is set, or without one, the
 * payload was refused. */
static PyObject *message_of(const Program *self, PyObject *payload, struct cdr *scratch)
{
    Py_buffer buffer;
    if (PyObject_GetBuffer(payload, &buffer, PyBUF_SIMPLE) < 0)
        return NULL;
    PyObject *message = NULL;
    bool is_made;
    while (scratch->size = 0, scratch->is_full = false,
           !(is_made = program_encode(self->operations, buffer.buf, (size_t)buffer.len, scratch)) && scratch->is_full) {
        uint8_t *grown = PyMem_Realloc(scratch->bytes, 2 * scratch->room);
        if (grown == NULL) {
            PyErr_NoMemory();
            break;
        }
        scratch->bytes = grown;
        scratch->room *= 2;
    }
    if (is_made)
        message = PyBytes_FromStringAndSize((char *)scratch->bytes, (Py_ssize_t)scratch->size);
    PyBuffer_Release(&buffer);
    return message;
}

static PyObject *program_messages(PyObject *object, PyObject *payloads)
{
    if (!PyTuple_Check(payloads)) {
        PyErr_SetString(PyExc_TypeError, "payloads must be a tuple");
        return NULL;
    }
    const Py_ssize_t count = PyTuple_Size(payloads);
    struct cdr scratch = {.room = LEAST_ROOM, .bytes = PyMem_Malloc(LEAST_ROOM)};
    PyObject *messages = scratch.bytes == NULL ? PyErr_NoMemory() : PyList_New(count);
    for (Py_ssize_t i = 0; messages != NULL && i < count; i++) {
        PyObject *message = message_of((Program *)object, PyTuple_GetItem(payloads, i), &scratch);
        if (message == NULL)
            Py_CLEAR(messages);
        else
            PyList_SetItem(messages, i, message);
    }
    PyMem_Free(scratch.bytes);
    return messages != NULL || PyErr_Occurred() ? messages : Py_NewRef(Py_None);
}

static PyObject *crc32_of(PyObject *Py_UNUSED(module), PyObject *args)
{
    Py_buffer data;
    unsigned int crc = 0;
    if (!PyArg_ParseTuple(args, "y*|I", &data, &crc))
        return NULL;
    if (data.len < SHORT) {
        crc = crc_of(crc, data.buf, (size_t)data.len);
    } else {
        Py_BEGIN_ALLOW_THREADS
        crc = crc_of(crc, data.buf, (size_t)data.len);
        Py_END_ALLOW_THREADS
    }
    PyBuffer_Release(&data);
    return PyLong_FromUnsignedLong(crc);
}

static PyMethodDef methods[] = {
    {"records", (PyCFunction)(void (*)(void))program_records, METH_FASTCALL, NULL},
    {"messages", program_messages, METH_O, NULL},
    {NULL, NULL, 0, NULL}};

static PyType_Slot slots[] = {
    {Py_tp_new, new_program}, {Py_tp_dealloc, free_program}, {Py_tp_methods, methods}, {0, NULL}};

static PyType_Spec spec = {"bus_bag.core._core.Program", sizeof(Program), 0,
                           Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, slots};

static PyMethodDef functions[] = {{"crc32", crc32_of, METH_VARARGS, NULL}, {NULL, NULL, 0, NULL}};

static int fill_module(PyObject *module)
{
    PyObject *type = PyType_FromModuleAndSpec(module, &spec, NULL);
    if (type == NULL)
        return -1;
    const int status = PyModule_AddType(module, (PyTypeObject *)type);
    Py_DECREF(type);
    if (status == 0 && crc_is_there())
        return PyModule_AddFunctions(module, functions);
    return status;
}

static PyModuleDef_Slot module_slots[] = {{Py_mod_exec, fill_module}, {0, NULL}};

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, .m_name = "bus_bag.core._core", .m_slots = module_slots};

PyMODINIT_FUNC PyInit__core(void) { return PyModuleDef_Init(&module); }
