/* Parts: a long sample in pieces, each where its owner has it. A socket sends the pieces without joining them.
 *
 * Text: the UTF-8 of a str as a buffer, without a copy. Python keeps ASCII text as UTF-8; for other text, Python adds it
 * to the str and keeps it there. */
#include "py.h"

#include <string.h>

typedef struct {
    PyObject_HEAD
    PyObject *text;
} Text;

typedef struct {
    PyObject_HEAD
    PyObject *pieces; /* tuple of buffers */
    Py_ssize_t size;
    PyObject *whole; /* bytes; NULL before the first use as one buffer */
} Parts;

static int text_get(PyObject *object, Py_buffer *buffer, int flags)
{
    Py_ssize_t size;
    const char *bytes = PyUnicode_AsUTF8AndSize(((Text *)object)->text, &size);
    if (bytes == NULL) {
        buffer->obj = NULL;
        return -1;
    }
    return PyBuffer_FillInfo(buffer, object, (void *)bytes, size, 1, flags);
}

static void text_dealloc(PyObject *object)
{
    Py_XDECREF(((Text *)object)->text);
    core_free(object);
}

/* A read-only view of the memory of a piece. The view has a reference to the piece. */
static PyObject *view_of(CoreState *state, PyObject *piece)
{
    if (!PyUnicode_CheckExact(piece))
        return PyMemoryView_FromObject(piece);
    Text *text = core_allocate(state->text);
    if (text == NULL)
        return NULL;
    text->text = Py_NewRef(piece);
    PyObject *view = PyMemoryView_FromObject((PyObject *)text);
    DROP(text);
    return view;
}

static PyObject *parts_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    CoreState *state = PyType_GetModuleState(type);
    const Py_ssize_t count = PyTuple_Size(args);
    if (kwargs != NULL && PyDict_Size(kwargs) > 0) {
        PyErr_SetString(PyExc_TypeError, "pieces have no names");
        return NULL;
    }
    Parts *self = core_allocate(type);
    if (self == NULL || (self->pieces = PyTuple_New(count)) == NULL)
        goto failed;
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *view = view_of(state, PyTuple_GetItem(args, i));
        if (view == NULL)
            goto failed;
        PyTuple_SetItem(self->pieces, i, view);
        const Py_ssize_t size = PyObject_Size(view);
        if (size < 0)
            goto failed;
        self->size += size;
    }
    return (PyObject *)self;
failed:
    DROP(self);
    return NULL;
}

static void parts_dealloc(PyObject *object)
{
    Parts *self = (Parts *)object;
    Py_XDECREF(self->pieces);
    Py_XDECREF(self->whole);
    core_free(object);
}

static Py_ssize_t parts_length(PyObject *object) { return ((Parts *)object)->size; }

/* Joins the pieces. False: an error is set. */
static bool join(Parts *self)
{
    PyObject *whole = PyBytes_FromStringAndSize(NULL, self->size);
    char *place = whole == NULL ? NULL : PyBytes_AsString(whole), *end = place + self->size;
    for (Py_ssize_t i = 0; place != NULL && i < PyTuple_Size(self->pieces); i++) {
        Py_buffer piece;
        if (PyObject_GetBuffer(PyTuple_GetItem(self->pieces, i), &piece, PyBUF_SIMPLE) < 0) {
            place = NULL; /* and `piece` may have no content: a released memoryview leaves it as it was */
            break;
        }
        if (piece.len > end - place) /* items of several bytes */
            place = NULL, PyErr_SetString(PyExc_TypeError, "a piece must consist of bytes");
        else
            memcpy(place, piece.buf, (size_t)piece.len), place += piece.len;
        PyBuffer_Release(&piece);
    }
    if (place != NULL)
        self->whole = whole;
    else
        Py_XDECREF(whole);
    return place != NULL;
}

static int parts_get(PyObject *object, Py_buffer *buffer, int flags)
{
    Parts *self = (Parts *)object;
    if (self->whole == NULL && !join(self)) {
        buffer->obj = NULL;
        return -1;
    }
    return PyBuffer_FillInfo(buffer, object, PyBytes_AsString(self->whole), self->size, 1, flags);
}

static PyMemberDef parts_members[] = {
    {"pieces", T_OBJECT_EX, offsetof(Parts, pieces), READONLY, NULL},
    {0},
};

static PyType_Slot text_slots[] = {
    {Py_tp_dealloc, (void *)text_dealloc},
    {Py_bf_getbuffer, (void *)text_get},
    {0},
};

static PyType_Slot parts_slots[] = {
    {Py_tp_new, (void *)parts_new},
    {Py_tp_dealloc, (void *)parts_dealloc},
    {Py_tp_members, parts_members},
    {Py_sq_length, (void *)parts_length},
    {Py_bf_getbuffer, (void *)parts_get},
    {0},
};

PyType_Spec text_spec = {"bus.shm._core.Text", sizeof(Text), 0, CORE_TYPE | Py_TPFLAGS_DISALLOW_INSTANTIATION,
                         text_slots};
PyType_Spec parts_spec = {"bus.shm._core.Parts", sizeof(Parts), 0, CORE_TYPE, parts_slots};
