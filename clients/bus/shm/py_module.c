/* The module bus.shm._core: its types, constants and functions. */
#include "py.h"

static PyObject *core_ring_bytes(PyObject *module, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"capacity", "index_length", NULL};
    uint64_t capacity, index_length;
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O&O&", names, core_as_u64, &capacity, core_as_u64, &index_length))
        return NULL;
    return PyLong_FromUnsignedLongLong(ring_segment_bytes(capacity, index_length));
}

static PyObject *core_readers_bytes(PyObject *module, PyObject *argument)
{
    uint64_t slot_count;
    (void)module;
    if (!core_as_u64(argument, &slot_count))
        return NULL;
    return PyLong_FromUnsignedLongLong(readers_segment_bytes(slot_count));
}

static PyObject *core_next_ring(PyObject *module, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"capacity", "held", "size", "keep", "most", "keeps_all", "must", NULL};
    uint64_t capacity, held, size, keep, most;
    int keeps_all, must;
    (void)module;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O&O&O&O&O&$pp", names, core_as_u64, &capacity, core_as_u64, &held,
                                     core_as_u64, &size, core_as_u64, &keep, core_as_u64, &most, &keeps_all, &must))
        return NULL;
    if (ring_segment_bytes(capacity, RING_FIRST_INDEX) == 0) {
        PyErr_SetString(PyExc_ValueError, "no ring has this capacity");
        return NULL;
    }
    const struct ring_sizes next = ring_next_sizes(capacity, held, size, keep, most, keeps_all, must);
    if (next.capacity == 0)
        Py_RETURN_NONE;
    return Py_BuildValue("KK", (unsigned long long)next.capacity, (unsigned long long)next.index_length);
}

static PyObject *core_is_filled_by_few(PyObject *module, PyObject *args)
{
    uint64_t capacity, held;
    (void)module;
    if (!PyArg_ParseTuple(args, "O&O&", core_as_u64, &capacity, core_as_u64, &held))
        return NULL;
    return PyBool_FromLong(ring_is_filled_by_few(capacity, held));
}

static PyObject *core_room(PyObject *module, PyObject *size)
{
    (void)module;
    const Py_ssize_t bytes = PyLong_AsSsize_t(size);
    if (bytes < 0) {
        if (!PyErr_Occurred())
            PyErr_SetString(PyExc_ValueError, "a room has no negative size");
        return NULL;
    }
    return PyByteArray_FromStringAndSize(NULL, bytes);
}

static PyObject *core_forget_pins(PyObject *module, PyObject *Py_UNUSED(none))
{
    (void)module;
    core_forks++;
    Py_RETURN_NONE;
}

static int add_type(PyObject *module, PyType_Spec *spec, PyTypeObject **kept, bool is_public)
{
    PyObject *type = PyType_FromModuleAndSpec(module, spec, NULL);
    if (type == NULL)
        return -1;
    const int status = is_public ? PyModule_AddType(module, (PyTypeObject *)type) : 0;
    if (kept != NULL)
        *kept = (PyTypeObject *)type;
    else
        Py_DECREF(type);
    return status;
}

static int core_exec(PyObject *module)
{
    CoreState *state = PyModule_GetState(module);
    if (add_type(module, &mapping_spec, &state->mapping, true) < 0
        || add_type(module, &bell_spec, &state->bell, true) < 0
        || add_type(module, &readers_spec, &state->readers, true) < 0
        || add_type(module, &view_spec, &state->view, false) < 0
        || add_type(module, &loan_spec, &state->loan, false) < 0
        || add_type(module, &plan_spec, &state->plan, true) < 0
        || add_type(module, &sending_spec, &state->sending, false) < 0
        || add_type(module, &sends_spec, NULL, true) < 0
        || add_type(module, &field_spec, &state->field, true) < 0
        || add_type(module, &fields_spec, NULL, true) < 0
        || add_type(module, &base_spec, NULL, true) < 0
        || add_type(module, &writer_spec, NULL, true) < 0
        || add_type(module, &run_spec, NULL, true) < 0
        || add_type(module, &parts_spec, NULL, true) < 0
        || add_type(module, &text_spec, &state->text, false) < 0
        || add_type(module, &reader_spec, NULL, true) < 0)
        return -1;
    static const struct {
        const char *name;
        long number;
    } numbers[] = {{"REPORT_DUE", REPORT_DUE},   {"FULL", FULL},           {"SHORT", SHORT},
                   {"PINNED", PINNED}, {"TOO_LARGE", TOO_LARGE}, {"WRONG_THREAD", WRONG_THREAD}, {"HELD", HELD},
                   {"AS_TEXT", AS_TEXT}, {"AS_FLOAT", AS_FLOAT}, {"AS_BOOL", AS_BOOL},
                   {"AS_INT", AS_INT}, {"AS_STRUCT", AS_STRUCT}, {"AS_BYTES", AS_BYTES},
                   {"AS_LIST", AS_LIST}};
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        if (PyModule_AddIntConstant(module, numbers[i].name, numbers[i].number) < 0)
            return -1;
    return 0;
}

static int core_traverse(PyObject *module, visitproc visit, void *arg)
{
    const CoreState *state = PyModule_GetState(module);
    Py_VISIT(state->mapping);
    Py_VISIT(state->bell);
    Py_VISIT(state->readers);
    Py_VISIT(state->view);
    Py_VISIT(state->loan);
    Py_VISIT(state->plan);
    Py_VISIT(state->sending);
    Py_VISIT(state->field);
    Py_VISIT(state->text);
    return 0;
}

static int core_clear(PyObject *module)
{
    CoreState *state = PyModule_GetState(module);
    Py_CLEAR(state->mapping);
    Py_CLEAR(state->bell);
    Py_CLEAR(state->readers);
    Py_CLEAR(state->view);
    Py_CLEAR(state->loan);
    Py_CLEAR(state->plan);
    Py_CLEAR(state->sending);
    Py_CLEAR(state->field);
    Py_CLEAR(state->text);
    return 0;
}

static void core_release(void *module) { core_clear(module); }

static PyMethodDef functions[] = {
    {"ring_bytes", (PyCFunction)(void (*)(void))core_ring_bytes, KEYWORDS, NULL},
    {"readers_bytes", core_readers_bytes, METH_O, NULL},
    {"next_ring", (PyCFunction)(void (*)(void))core_next_ring, KEYWORDS, NULL},
    {"is_filled_by_few", core_is_filled_by_few, METH_VARARGS, NULL},
    {"run_messages", (PyCFunction)(void (*)(void))core_run_messages, METH_FASTCALL, NULL},
    {"run_samples", (PyCFunction)(void (*)(void))core_run_samples, METH_FASTCALL, NULL},
    {"scan_packed", (PyCFunction)(void (*)(void))core_scan_packed, METH_FASTCALL, NULL},
    {"room", core_room, METH_O, NULL},
    {"keep_thread", core_keep_thread, METH_NOARGS, NULL},
    {"timerfd_create", core_timerfd_create, METH_NOARGS, NULL},
    {"timerfd_settime", core_timerfd_settime, METH_VARARGS, NULL},
    {"forget_pins", core_forget_pins, METH_NOARGS, NULL},
    {0},
};

static PyModuleDef_Slot slots[] = {{Py_mod_exec, (void *)core_exec}, {0}};

static struct PyModuleDef core_module = {
    PyModuleDef_HEAD_INIT,
    .m_name = "bus.shm._core",
    .m_doc = "The native core: whole operations on mapped segments. _core.pyi says what they do.",
    .m_size = sizeof(CoreState),
    .m_methods = functions,
    .m_slots = slots,
    .m_traverse = core_traverse,
    .m_clear = core_clear,
    .m_free = core_release,
};

PyMODINIT_FUNC PyInit__core(void) { return PyModuleDef_Init(&core_module); }
