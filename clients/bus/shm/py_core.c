/* Helpers of all parts of the core: the clock, memory of objects, arguments, the process and thread of a publisher. */
#include "py.h"

#include <time.h>

unsigned core_forks;

uint64_t core_now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

/* The module's state. Only MessageBase can be subclassed, and its code does not call this: so an object's type is always
 * made by the module. */
CoreState *core_state(PyObject *object) { return PyType_GetModuleState(Py_TYPE(object)); }

void *core_allocate(PyTypeObject *type)
{
    const allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    return allocate(type, 0); /* zeroed */
}

void core_free(void *object)
{
    PyTypeObject *type = Py_TYPE((PyObject *)object);
    const freefunc release = (freefunc)PyType_GetSlot(type, Py_tp_free);
    release(object);
    DROP(type);
}

PyObject *core_with_origin(PyObject *message, PyObject *stamp_ns, uint64_t seq, PyObject *source, PyObject *received_ns)
{
    PyObject *item = PyTuple_New(5), *number = PyLong_FromUnsignedLongLong(seq);
    if (item == NULL || number == NULL || message == NULL || stamp_ns == NULL || received_ns == NULL) {
        Py_XDECREF(item);
        Py_XDECREF(number);
        Py_XDECREF(message);
        Py_XDECREF(stamp_ns);
        Py_XDECREF(received_ns);
        return NULL;
    }
    PyTuple_SetItem(item, 0, message);
    PyTuple_SetItem(item, 1, stamp_ns);
    PyTuple_SetItem(item, 2, number);
    PyTuple_SetItem(item, 3, Py_NewRef(source));
    PyTuple_SetItem(item, 4, received_ns);
    return item;
}

/* The answer of is_home() if threads share the publisher. */
int core_ask_home(const struct home *home)
{
    if (home->is_mine == Py_None)
        return PyThread_get_thread_ident() == home->thread;
    PyObject *answer = PyObject_CallNoArgs(home->is_mine);
    const int is_mine = answer == NULL ? -1 : answer == Py_True;
    Py_XDECREF(answer);
    return is_mine;
}

/* A converter for the "O&" of PyArg_ParseTuple, because "K" accepts a negative number as a huge one. */
int core_as_u64(PyObject *value, void *number)
{
    const unsigned long long word = PyLong_AsUnsignedLongLong(value);
    if (word == (unsigned long long)-1 && PyErr_Occurred())
        return 0;
    *(uint64_t *)number = word;
    return 1;
}

/* Puts the arguments of a fast call into `values` in the order of `names` (NULL-terminated). They are borrowed
 * references; a missing argument is NULL. The first `positional` may be given by position. */
int core_arguments(const char *const *names, PyObject *const *args, Py_ssize_t count, PyObject *kwnames,
                   Py_ssize_t positional, PyObject **values)
{
    if (count > positional) {
        PyErr_Format(PyExc_TypeError, "at most %zd positional arguments, not %zd", positional, count);
        return -1;
    }
    for (Py_ssize_t i = 0; names[i] != NULL; i++)
        values[i] = i < count ? args[i] : NULL;
    const Py_ssize_t named = kwnames == NULL ? 0 : PyTuple_Size(kwnames);
    for (Py_ssize_t i = 0; i < named; i++) {
        PyObject *name = PyTuple_GetItem(kwnames, i);
        Py_ssize_t at = 0;
        while (names[at] != NULL && PyUnicode_CompareWithASCIIString(name, names[at]) != 0)
            at++;
        if (names[at] == NULL || values[at] != NULL) {
            PyErr_Format(PyExc_TypeError, "unexpected argument %R", name);
            return -1;
        }
        values[at] = args[count + i];
    }
    return 0;
}
