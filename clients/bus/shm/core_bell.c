/* Bell: another process's sleep and doorbell, as all writers of this process know them. */
#include "core.h"

static PyObject *bell_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    uint64_t slot_count;
    int doorbell;
    Mapping *memory = core_readers_segment(type, args, kwargs, false, &slot_count, &doorbell);
    if (memory == NULL)
        return NULL;
    Bell *self = core_allocate(type);
    if (self == NULL)
        return NULL;
    HOLD(memory);
    self->memory = memory;
    self->arrival = &((const struct readers_header *)memory->memory)->arrival;
    self->slots = readers_slots(memory->memory);
    self->slot_count = slot_count;
    self->doorbell = doorbell;
    return (PyObject *)self;
}

static void bell_dealloc(PyObject *object)
{
    DROP(((Bell *)object)->memory);
    core_free(object);
}

static PyMemberDef members[] = {{"slot_count", T_ULONGLONG, offsetof(Bell, slot_count), READONLY, NULL}, {0}};

static PyType_Slot slots[] = {
    {Py_tp_new, (void *)bell_new},
    {Py_tp_dealloc, (void *)bell_dealloc},
    {Py_tp_members, members},
    {0},
};

PyType_Spec bell_spec = {"bus.shm._core.Bell", sizeof(Bell), 0, CORE_TYPE, slots};
