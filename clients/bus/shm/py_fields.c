/* Fields of messages that look like rosidl's: constructor, getters and setters, without Python code in the usual case.
 * - MessageField: the descriptor of one field. It stores a value of the usual class and range at once. All other
 *   values go to the field's check, which returns the value to store, or raises
 * - MessageFields: all fields of a class, for the constructor
 * - MessageBase: a base of the classes; it has the constructor
 *
 * They have nothing to do with segments. `bus_ros.rosidl.setters` has the same in Python, for use without the core. */
#include "py.h"

/* The attribute of a class that has its MessageFields. */
#define FIELDS "__message_fields__"

typedef struct {
    PyObject_HEAD
    PyObject *slot; /* the member descriptor of the stored value */
    descrgetfunc get;
    descrsetfunc set;
    PyObject *check;     /* NULL: all values are stored */
    PyTypeObject *usual; /* the usual class; NULL: all values are checked */
    int64_t least, most; /* bounds of an int that is stored at once */
    double largest;      /* the same for the size of a float */
    PyObject *doc;
} MessageField;

struct member {
    PyObject *name;
    MessageField *field;
    PyObject *initial; /* the value without an argument, or a function that makes it */
    bool is_made;
};

typedef struct {
    PyObject_HEAD
    PyObject *known;   /* a frozenset of the names */
    PyObject *strange; /* called with arguments that are not in it, and with it */
    Py_ssize_t count;
    struct member *members;
} MessageFields;

/* --- MessageField */

static bool is_usual(const MessageField *self, PyObject *value)
{
    if (self->check == NULL)
        return true;
    if (Py_TYPE(value) != self->usual)
        return false;
    if (self->usual == &PyLong_Type) {
        int overflow;
        const long long number = PyLong_AsLongLongAndOverflow(value, &overflow);
        return !overflow && self->least <= number && number <= self->most;
    }
    if (self->usual == &PyFloat_Type) {
        const double number = PyFloat_AsDouble(value);
        return !(number > self->largest || number < -self->largest); /* NaN is stored */
    }
    return true;
}

static int store(const MessageField *self, PyObject *message, PyObject *value)
{
    if (is_usual(self, value))
        return self->set(self->slot, message, value);
    PyObject *checked = PyObject_CallFunctionObjArgs(self->check, value, NULL);
    if (checked == NULL)
        return -1;
    const int status = self->set(self->slot, message, checked);
    Py_DECREF(checked);
    return status;
}

static PyObject *field_get(PyObject *object, PyObject *message, PyObject *type)
{
    const MessageField *self = (const MessageField *)object;
    return message == NULL || message == Py_None ? Py_NewRef(object) : self->get(self->slot, message, type);
}

static int field_set(PyObject *object, PyObject *message, PyObject *value)
{
    if (value == NULL) {
        PyErr_SetString(PyExc_AttributeError, "a message's field can't be deleted");
        return -1;
    }
    return store((const MessageField *)object, message, value);
}

static PyObject *field_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"slot", "doc", "check", "usual", "least", "most", "largest", NULL};
    PyObject *slot, *doc, *check = Py_None, *usual = Py_None;
    long long least = 0, most = 0;
    double largest = Py_HUGE_VAL;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O!O|OOLLd", names, &PyMemberDescr_Type, &slot, &doc, &check,
                                     &usual, &least, &most, &largest))
        return NULL;
    if (usual != Py_None && !PyType_Check(usual)) {
        PyErr_SetString(PyExc_TypeError, "usual must be a class or None");
        return NULL;
    }
    MessageField *self = core_allocate(type);
    if (self == NULL)
        return NULL;
    self->slot = Py_NewRef(slot);
    self->get = (descrgetfunc)PyType_GetSlot(&PyMemberDescr_Type, Py_tp_descr_get);
    self->set = (descrsetfunc)PyType_GetSlot(&PyMemberDescr_Type, Py_tp_descr_set);
    self->doc = Py_NewRef(doc);
    self->check = check == Py_None ? NULL : Py_NewRef(check);
    self->usual = usual == Py_None ? NULL : (PyTypeObject *)Py_NewRef(usual);
    self->least = least;
    self->most = most;
    self->largest = largest;
    return (PyObject *)self;
}

static int field_traverse(PyObject *object, visitproc visit, void *arg)
{
    const MessageField *self = (const MessageField *)object;
    Py_VISIT(Py_TYPE(object));
    Py_VISIT(self->slot);
    Py_VISIT(self->check);
    Py_VISIT(self->usual);
    Py_VISIT(self->doc);
    return 0;
}

static void field_dealloc(PyObject *object)
{
    MessageField *self = (MessageField *)object;
    PyObject_GC_UnTrack(object);
    Py_XDECREF(self->slot);
    Py_XDECREF(self->check);
    DROP(self->usual);
    Py_XDECREF(self->doc);
    core_free(self);
}

static PyMemberDef field_members[] = {
    {"__doc__", T_OBJECT, offsetof(MessageField, doc), READONLY, NULL},
    {0},
};

static PyType_Slot field_slots[] = {
    {Py_tp_new, (void *)field_new},
    {Py_tp_dealloc, (void *)field_dealloc},
    {Py_tp_traverse, (void *)field_traverse},
    {Py_tp_descr_get, (void *)field_get},
    {Py_tp_descr_set, (void *)field_set},
    {Py_tp_members, field_members},
    {0},
};

PyType_Spec field_spec = {"bus.shm._core.MessageField", sizeof(MessageField), 0, CORE_TYPE | Py_TPFLAGS_HAVE_GC,
                          field_slots};

/* --- MessageFields */

static bool read_member(const CoreState *state, PyObject *given, struct member *member)
{
    PyObject *name, *field, *initial;
    int is_made;
    if (!PyTuple_Check(given)) {
        PyErr_SetString(PyExc_TypeError, "a member must be a tuple");
        return false;
    }
    if (!PyArg_ParseTuple(given, "UO!Op", &name, state->field, &field, &initial, &is_made))
        return false;
    member->name = Py_NewRef(name);
    member->field = (MessageField *)Py_NewRef(field);
    member->initial = Py_NewRef(initial);
    member->is_made = is_made;
    return true;
}

static PyObject *fields_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"known", "strange", "members", NULL};
    const CoreState *state = PyType_GetModuleState(type);
    PyObject *known, *strange, *members;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O!OO!", names, &PyFrozenSet_Type, &known, &strange, &PyTuple_Type,
                                     &members))
        return NULL;
    const Py_ssize_t count = PyTuple_Size(members);
    MessageFields *self = core_allocate(type);
    if (self == NULL)
        return NULL;
    self->known = Py_NewRef(known);
    self->strange = Py_NewRef(strange);
    self->members = PyMem_Calloc((size_t)count + 1, sizeof *self->members);
    if (self->members == NULL) {
        Py_DECREF(self);
        return PyErr_NoMemory();
    }
    while (self->count < count) {
        if (!read_member(state, PyTuple_GetItem(members, self->count), &self->members[self->count])) {
            Py_DECREF(self);
            return NULL;
        }
        self->count++;
    }
    return (PyObject *)self;
}

static int fields_traverse(PyObject *object, visitproc visit, void *arg)
{
    const MessageFields *self = (const MessageFields *)object;
    Py_VISIT(Py_TYPE(object));
    Py_VISIT(self->known);
    Py_VISIT(self->strange);
    for (Py_ssize_t i = 0; i < self->count; i++) {
        Py_VISIT(self->members[i].field);
        Py_VISIT(self->members[i].initial);
    }
    return 0;
}

static void fields_dealloc(PyObject *object)
{
    MessageFields *self = (MessageFields *)object;
    PyObject_GC_UnTrack(object);
    Py_XDECREF(self->known);
    Py_XDECREF(self->strange);
    for (Py_ssize_t i = 0; i < self->count; i++) {
        Py_DECREF(self->members[i].name);
        DROP(self->members[i].field);
        Py_DECREF(self->members[i].initial);
    }
    PyMem_Free(self->members);
    core_free(self);
}

static PyType_Slot fields_slots[] = {
    {Py_tp_new, (void *)fields_new},
    {Py_tp_dealloc, (void *)fields_dealloc},
    {Py_tp_traverse, (void *)fields_traverse},
    {0},
};

PyType_Spec fields_spec = {"bus.shm._core.MessageFields", sizeof(MessageFields), 0, CORE_TYPE | Py_TPFLAGS_HAVE_GC,
                           fields_slots};

/* --- MessageBase */

/* The fields of a message's class, a new reference. The class is the program's, which may have changed the attribute. */
static MessageFields *fields_of(PyObject *message)
{
    static PyObject *name; /* made once, and kept: all interpreters share the GIL and this text */
    if (name == NULL && (name = PyUnicode_InternFromString(FIELDS)) == NULL)
        return NULL;
    PyObject *fields = PyObject_GetAttr((PyObject *)Py_TYPE(message), name);
    if (fields == NULL || PyType_GetSlot(Py_TYPE(fields), Py_tp_dealloc) == (void *)fields_dealloc)
        return (MessageFields *)fields;
    Py_DECREF(fields);
    PyErr_SetString(PyExc_TypeError, FIELDS " must be a MessageFields");
    return NULL;
}

static bool are_known(const MessageFields *self, PyObject *given)
{
    Py_ssize_t place = 0;
    PyObject *name, *value;
    while (PyDict_Next(given, &place, &name, &value)) {
        const int is_known = PySet_Contains(self->known, name);
        if (is_known < 0)
            return false;
        if (is_known)
            continue;
        PyObject *answer = PyObject_CallFunctionObjArgs(self->strange, given, self->known, NULL);
        Py_XDECREF(answer);
        return answer != NULL;
    }
    return true;
}

static int begin_member(const struct member *member, PyObject *message, PyObject *given)
{
    const MessageField *field = member->field;
    PyObject *value = given == NULL ? NULL : PyDict_GetItemWithError(given, member->name);
    if (value != NULL) {
        Py_INCREF(value);
        const int status = store(field, message, value);
        Py_DECREF(value);
        return status;
    }
    if (given != NULL && PyErr_Occurred())
        return -1;
    if (!member->is_made)
        return field->set(field->slot, message, member->initial);
    if ((value = PyObject_CallNoArgs(member->initial)) == NULL)
        return -1;
    const int status = field->set(field->slot, message, value);
    Py_DECREF(value);
    return status;
}

static int base_init(PyObject *message, PyObject *args, PyObject *given)
{
    if (PyTuple_Size(args) > 0) {
        PyErr_Format(PyExc_TypeError, "__init__() takes 1 positional argument but %zd were given",
                     PyTuple_Size(args) + 1);
        return -1;
    }
    MessageFields *self = fields_of(message);
    if (self == NULL)
        return -1;
    int status = given != NULL && !are_known(self, given) ? -1 : 0;
    for (Py_ssize_t i = 0; status == 0 && i < self->count; i++)
        status = begin_member(&self->members[i], message, given);
    DROP(self);
    return status;
}

static PyType_Slot base_slots[] = {
    {Py_tp_init, (void *)base_init},
    {0},
};

PyType_Spec base_spec = {"bus.shm._core.MessageBase", sizeof(PyObject), 0, CORE_TYPE | Py_TPFLAGS_BASETYPE, base_slots};
