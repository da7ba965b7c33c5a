/* The module bus_tf2.core._core: frames.h for Python, limited API of Python 3.11. See _core.pyi.
 *
 * Each call is one whole operation under the GIL, so threads need no extra lock.
 */
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include "frames.h"

typedef struct {
    PyObject_HEAD
    tree frames;
    PyObject *numbers;     /* dict: the number of a frame by its name */
    PyObject *names;       /* list */
    PyObject *authorities; /* list: the authority of each frame's last transform, or None */
} FrameTree;

static PyObject *new_tree(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *words[] = {"cache_ns", NULL};
    long long cache_ns;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "L", words, &cache_ns))
        return NULL;
    if (cache_ns < 0) {
        PyErr_SetString(PyExc_ValueError, "cache_ns is below zero");
        return NULL;
    }
    const allocfunc allocate = (allocfunc)PyType_GetSlot(type, Py_tp_alloc);
    FrameTree *self = (FrameTree *)allocate(type, 0); /* zeroed */
    if (self == NULL)
        return NULL;
    self->frames.cache_ns = cache_ns;
    self->numbers = PyDict_New();
    self->names = PyList_New(0);
    self->authorities = PyList_New(0);
    if (self->numbers == NULL || self->names == NULL || self->authorities == NULL) {
        Py_DECREF(self);
        return NULL;
    }
    return (PyObject *)self;
}

static void free_tree(PyObject *object)
{
    FrameTree *self = (FrameTree *)object;
    PyTypeObject *type = Py_TYPE(object);
    release(&self->frames);
    Py_XDECREF(self->numbers);
    Py_XDECREF(self->names);
    Py_XDECREF(self->authorities);
    ((freefunc)PyType_GetSlot(type, Py_tp_free))(object);
    Py_DECREF(type);
}

/* Checks the arguments: a TypeError if there are fewer than `least`, or if one of the first `texts` is no text. */
static bool are_fitting(PyObject *const *args, Py_ssize_t count, Py_ssize_t least, Py_ssize_t texts)
{
    if (count != least) {
        PyErr_Format(PyExc_TypeError, "%zd arguments, not %zd", least, count);
        return false;
    }
    for (Py_ssize_t i = 0; i < texts; i++)
        if (!PyUnicode_Check(args[i])) {
            PyErr_Format(PyExc_TypeError, "argument %zd must be str, not %R", i + 1, (PyObject *)Py_TYPE(args[i]));
            return false;
        }
    return true;
}

/* The number of a frame; NO_FRAME for an unknown name, or with an error set. */
static uint32_t number_of(const FrameTree *self, PyObject *name)
{
    PyObject *number = PyDict_GetItemWithError(self->numbers, name);
    return number == NULL ? NO_FRAME : (uint32_t)PyLong_AsUnsignedLong(number);
}

/* Removes the last frame, because memory ran out while it was added. This keeps the numbers right. An error is set. */
static void forget_last(FrameTree *self, uint32_t number)
{
    PyObject *type, *value, *traceback;
    PyErr_Fetch(&type, &value, &traceback);
    self->frames.count = number;
    PyList_SetSlice(self->names, number, PY_SSIZE_T_MAX, NULL);
    PyList_SetSlice(self->authorities, number, PY_SSIZE_T_MAX, NULL);
    PyErr_Restore(type, value, traceback);
}

static uint32_t number_or_new(FrameTree *self, PyObject *name)
{
    const uint32_t known = number_of(self, name);
    if (known != NO_FRAME || PyErr_Occurred())
        return known;
    const uint32_t added = add_frame(&self->frames);
    PyObject *number = added == NO_FRAME ? PyErr_NoMemory() : PyLong_FromUnsignedLong(added);
    const bool is_kept = number != NULL && PyList_Append(self->names, name) == 0
                         && PyList_Append(self->authorities, Py_None) == 0
                         && PyDict_SetItem(self->numbers, name, number) == 0;
    Py_XDECREF(number);
    if (!is_kept && added != NO_FRAME && self->frames.count == added + 1)
        forget_last(self, added);
    return is_kept ? added : NO_FRAME;
}

static PyObject *insert_transform(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    FrameTree *self = (FrameTree *)object;
    if (!are_fitting(args, count, 12, 2))
        return NULL;
    sample new = {.stamp_ns = PyLong_AsLongLong(args[2])};
    double *const places[] = {&new.translation.x, &new.translation.y, &new.translation.z, &new.rotation.x,
                              &new.rotation.y,    &new.rotation.z,    &new.rotation.w};
    for (int i = 0; i < 7; i++)
        *places[i] = PyFloat_AsDouble(args[3 + i]);
    const int is_static = PyObject_IsTrue(args[11]);
    if (PyErr_Occurred())
        return NULL;
    int status = refusal(&new);
    if (status == 0) {
        const uint32_t child = number_or_new(self, args[0]);
        new.parent = child == NO_FRAME ? NO_FRAME : number_or_new(self, args[1]);
        if (new.parent == NO_FRAME)
            return NULL;
        status = insert(&self->frames, child, &new, is_static);
        if (status < 0)
            return PyErr_NoMemory();
        if (status == 0 && PyList_SetItem(self->authorities, child, Py_NewRef(args[10])) < 0)
            return NULL;
    }
    return PyLong_FromLong(status);
}

static PyObject *as_failure(const failure *why)
{
    return Py_BuildValue("(iLL)", why->kind, (long long)why->asked_ns, (long long)why->have_ns);
}

static PyObject *as_answer(int64_t stamp_ns, const transform *found)
{
    const double parts[] = {found->translation.x, found->translation.y, found->translation.z, found->rotation.x,
                            found->rotation.y,    found->rotation.z,    found->rotation.w};
    PyObject *answer = PyTuple_New(8);
    for (int i = 0; answer != NULL && i < 8; i++) {
        PyObject *part = i == 0 ? PyLong_FromLongLong(stamp_ns) : PyFloat_FromDouble(parts[i - 1]);
        if (part == NULL || PyTuple_SetItem(answer, i, part) < 0)
            Py_CLEAR(answer);
    }
    return answer;
}

/* Finds the numbers of the frames in `args`, and whether both are the same. Returns 0 if one of them is unknown. */
static int pair_of(const FrameTree *self, PyObject *const *args, uint32_t *target, uint32_t *source, bool *is_one)
{
    *target = number_of(self, args[0]);
    *source = number_of(self, args[1]);
    if (PyErr_Occurred())
        return -1;
    if (*target != NO_FRAME && *source != NO_FRAME) {
        *is_one = *target == *source;
        return 1;
    }
    *is_one = *target == *source && PyUnicode_Compare(args[0], args[1]) == 0;
    return PyErr_Occurred() ? -1 : 0;
}

static int64_t latest_of(const FrameTree *self, uint32_t number)
{
    return number == NO_FRAME ? 0 : latest_stamp(&self->frames.frames[number]);
}

static PyObject *lookup(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    const FrameTree *self = (FrameTree *)object;
    if (!are_fitting(args, count, 3, 2))
        return NULL;
    int64_t time_ns = PyLong_AsLongLong(args[2]);
    if (PyErr_Occurred())
        return NULL;
    uint32_t target, source;
    bool is_one;
    failure why = {UNKNOWN, 0, 0};
    transform found = identity;
    const int are_known = pair_of(self, args, &target, &source, &is_one);
    if (are_known < 0)
        return NULL;
    if (is_one)
        return as_answer(time_ns == 0 ? latest_of(self, target) : time_ns, &found);
    if (!are_known || !look_up(&self->frames, target, source, &time_ns, &found, &why))
        return as_failure(&why);
    return as_answer(time_ns, &found);
}

static PyObject *latest_common(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    const FrameTree *self = (FrameTree *)object;
    uint32_t target, source;
    bool is_one;
    int64_t time_ns = 0;
    failure why = {UNKNOWN, 0, 0};
    const int are_known = are_fitting(args, count, 2, 2) ? pair_of(self, args, &target, &source, &is_one) : -1;
    if (are_known < 0)
        return NULL;
    if (is_one && are_known)
        return PyLong_FromLongLong(latest_of(self, target));
    if (!are_known || !common_time(&self->frames, target, source, &time_ns, &why))
        return as_failure(&why);
    return PyLong_FromLongLong(time_ns);
}

static PyObject *parent(PyObject *object, PyObject *const *args, Py_ssize_t count)
{
    const FrameTree *self = (FrameTree *)object;
    if (!are_fitting(args, count, 2, 1))
        return NULL;
    const int64_t time_ns = PyLong_AsLongLong(args[1]);
    const uint32_t number = PyErr_Occurred() ? NO_FRAME : number_of(self, args[0]);
    if (PyErr_Occurred())
        return NULL;
    sample found;
    failure why;
    if (number == NO_FRAME || !sample_at(&self->frames.frames[number], time_ns, &found, &why))
        Py_RETURN_NONE;
    return Py_XNewRef(PyList_GetItem(self->names, found.parent));
}

static PyObject *rows(PyObject *object, PyObject *Py_UNUSED(none))
{
    const FrameTree *self = (FrameTree *)object;
    PyObject *all = PyList_New(0);
    for (uint32_t i = 0; all != NULL && i < self->frames.count; i++) {
        const frame *here = &self->frames.frames[i];
        if (!here->is_child)
            continue;
        const bool has_times = !here->is_static && here->count > 0;
        PyObject *up = here->count == 0 ? Py_None : PyList_GetItem(self->names, newest(here)->parent);
        /* Owned references, because a garbage collection may run any code, even an insert. */
        PyObject *row = Py_BuildValue("(NNNILL)", Py_XNewRef(PyList_GetItem(self->names, i)), Py_XNewRef(up),
                                      Py_XNewRef(PyList_GetItem(self->authorities, i)), here->count,
                                      (long long)latest_stamp(here),
                                      (long long)(has_times ? oldest(here)->stamp_ns : 0));
        if (row == NULL || PyList_Append(all, row) < 0)
            Py_CLEAR(all);
        Py_XDECREF(row);
    }
    return all;
}

static PyObject *names(PyObject *object, PyObject *Py_UNUSED(none))
{
    return PyList_GetSlice(((FrameTree *)object)->names, 0, PY_SSIZE_T_MAX);
}

static PyObject *knows(PyObject *object, PyObject *name)
{
    const int is_known = PyDict_Contains(((FrameTree *)object)->numbers, name);
    return is_known < 0 ? NULL : PyBool_FromLong(is_known);
}

static PyObject *clear_all(PyObject *object, PyObject *Py_UNUSED(none))
{
    clear(&((FrameTree *)object)->frames);
    Py_RETURN_NONE;
}

#define FAST(function) (PyCFunction)(void (*)(void))(function), METH_FASTCALL

static PyMethodDef methods[] = {
    {"insert", FAST(insert_transform), NULL}, {"lookup", FAST(lookup), NULL},
    {"latest", FAST(latest_common), NULL},    {"parent", FAST(parent), NULL},
    {"rows", rows, METH_NOARGS, NULL},        {"names", names, METH_NOARGS, NULL},
    {"knows", knows, METH_O, NULL},           {"clear", clear_all, METH_NOARGS, NULL},
    {NULL, NULL, 0, NULL},
};

static PyType_Slot slots[] = {
    {Py_tp_new, new_tree}, {Py_tp_dealloc, free_tree}, {Py_tp_methods, methods}, {0, NULL}};

static PyType_Spec spec = {"bus_tf2.core._core.FrameTree", sizeof(FrameTree), 0,
                           Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE, slots};

static int fill(PyObject *module)
{
    PyObject *type = PyType_FromModuleAndSpec(module, &spec, NULL);
    if (type == NULL)
        return -1;
    const int status = PyModule_AddType(module, (PyTypeObject *)type);
    Py_DECREF(type);
    return status;
}

static PyModuleDef_Slot module_slots[] = {{Py_mod_exec, fill}, {0, NULL}};

static struct PyModuleDef module = {
    PyModuleDef_HEAD_INIT, .m_name = "bus_tf2.core._core", .m_slots = module_slots};

PyMODINIT_FUNC PyInit__core(void) { return PyModuleDef_Init(&module); }
