/* Plan: checks and encodes the messages of one class in one pass, with the bytes that msgspec's encoder gives.
 *
 * A plan is for classes of text, bytes, numbers, bool, such classes again, and lists of all these. If a value differs
 * from the plan, the plan gives up, and the caller goes the long way, which finds the fault. Examples: another
 * type, a number out of range, a lone surrogate, a deleted field. Fields are read from their slots, as msgspec's
 * encoder does; no Python code runs. py_unplan.c decodes by a plan.
 */
#include "py_plan.h"

#include <endian.h>
#include <string.h>

/* The place of the next byte of an encoding. */
struct place {
    unsigned char *at, *end;
    bool is_full;
    const struct plan_field *left_out; /* a field of which only the head is written; NULL: none */
    uint64_t left_bytes;               /* size of that field */
    unsigned char *gap;                /* place of its bytes */
};

static inline bool has_room(struct place *place, Py_ssize_t size)
{
    if (place->end - place->at >= size)
        return true;
    place->is_full = true;
    return false;
}

static inline void put_number(struct place *place, unsigned char head, uint64_t number, int size)
{
    const uint64_t big_endian = htobe64(number << (64 - 8 * size));
    *place->at = head;
    memcpy(place->at + 1, &big_endian, sizeof big_endian); /* there is room for MOST_HEAD */
    place->at += 1 + size;
}

static inline void put_whole(struct place *place, uint64_t number)
{
    if (number < 0x80)
        *place->at++ = (unsigned char)number;
    else if (number <= UINT8_MAX)
        put_number(place, 0xcc, number, 1);
    else if (number <= UINT16_MAX)
        put_number(place, 0xcd, number, 2);
    else if (number <= UINT32_MAX)
        put_number(place, 0xce, number, 4);
    else
        put_number(place, 0xcf, number, 8);
}

static inline void put_negative(struct place *place, int64_t number)
{
    if (number >= -32)
        *place->at++ = (unsigned char)number;
    else if (number >= INT8_MIN)
        put_number(place, 0xd0, (uint64_t)number, 1);
    else if (number >= INT16_MIN)
        put_number(place, 0xd1, (uint64_t)number, 2);
    else if (number >= INT32_MIN)
        put_number(place, 0xd2, (uint64_t)number, 4);
    else
        put_number(place, 0xd3, (uint64_t)number, 8);
}

static inline void put_double(struct place *place, PyObject *value)
{
    const double number = PyFloat_AsDouble(value);
    uint64_t bits;
    memcpy(&bits, &number, sizeof bits);
    put_number(place, 0xcb, bits, 8);
}

static bool put_int(struct place *place, PyObject *value, int64_t least, uint64_t most)
{
    int overflow;
    const long long number = PyLong_AsLongLongAndOverflow(value, &overflow);
    if (overflow < 0 || (overflow == 0 && number < least))
        return false;
    if (overflow == 0 && number < 0) {
        put_negative(place, number);
        return true;
    }
    const uint64_t whole = overflow == 0 ? (uint64_t)number : PyLong_AsUnsignedLongLong(value);
    if (overflow > 0 && whole == UINT64_MAX && PyErr_Occurred())
        return false;
    if (whole > most)
        return false;
    put_whole(place, whole);
    return true;
}

static bool put_text_head(struct place *place, uint64_t size)
{
    if (size < 32)
        *place->at++ = (unsigned char)(0xa0 | size);
    else if (size <= UINT8_MAX)
        put_number(place, 0xd9, size, 1);
    else if (size <= UINT16_MAX)
        put_number(place, 0xda, size, 2);
    else if (size <= UINT32_MAX)
        put_number(place, 0xdb, size, 4);
    else
        return false;
    return true;
}

static bool put_text(struct place *place, PyObject *text)
{
    Py_ssize_t size;
    const char *bytes = PyUnicode_AsUTF8AndSize(text, &size);
    if (bytes == NULL || !has_room(place, MOST_HEAD + size) || !put_text_head(place, (uint64_t)size))
        return false;
    memcpy(place->at, bytes, (size_t)size);
    place->at += size;
    return true;
}

static bool put_bytes(struct place *place, PyObject *bytes, const struct plan_value *plan)
{
    const Py_ssize_t size = PyBytes_Size(bytes);
    if (size < plan->least || (uint64_t)size > plan->most || !has_room(place, MOST_HEAD + size))
        return false;
    if (size <= UINT8_MAX)
        put_number(place, 0xc4, (uint64_t)size, 1);
    else if (size <= UINT16_MAX)
        put_number(place, 0xc5, (uint64_t)size, 2);
    else if ((uint64_t)size <= UINT32_MAX)
        put_number(place, 0xc6, (uint64_t)size, 4);
    else
        return false;
    memcpy(place->at, PyBytes_AsString(bytes), (size_t)size);
    place->at += size;
    return true;
}

static bool put_value(const struct plan_value *plan, PyObject *value, struct place *place);

/* Encodes a list. Nothing changes the list meanwhile, because no Python code runs. */
static bool put_list(struct place *place, PyObject *list, const struct plan_value *plan)
{
    const Py_ssize_t count = PyList_Size(list), each = plan->item->code == AS_FLOAT ? MOST_HEAD : 1;
    if (count < plan->least || (uint64_t)count > plan->most || (uint64_t)count > UINT32_MAX)
        return false;
    if (!has_room(place, MOST_HEAD + count * each)) /* before any work, which would be lost */
        return false;
    if (count < 16)
        *place->at++ = (unsigned char)(0x90 | count);
    else if (count <= UINT16_MAX)
        put_number(place, 0xdc, (uint64_t)count, 2);
    else
        put_number(place, 0xdd, (uint64_t)count, 4);
    for (Py_ssize_t i = 0; i < count; i++) {
        PyObject *item = PyList_GetItem(list, i);
        if (each == MOST_HEAD && PyFloat_CheckExact(item))
            put_double(place, item);
        else if (!put_value(plan->item, item, place))
            return false;
    }
    return true;
}

static bool put_struct(const Plan *self, PyObject *message, struct place *place);

static bool put_value(const struct plan_value *plan, PyObject *value, struct place *place)
{
    if (!has_room(place, MOST_HEAD))
        return false;
    switch (plan->code) {
    case AS_TEXT:
        return PyUnicode_CheckExact(value) && put_text(place, value);
    case AS_FLOAT:
        if (PyFloat_CheckExact(value)) {
            put_double(place, value);
            return true;
        }
        return PyLong_CheckExact(value) && put_int(place, value, INT64_MIN, UINT64_MAX);
    case AS_BOOL:
        if (value != Py_True && value != Py_False)
            return false;
        *place->at++ = value == Py_True ? 0xc3 : 0xc2;
        return true;
    case AS_INT:
        return PyLong_CheckExact(value) && put_int(place, value, plan->least, plan->most);
    case AS_BYTES:
        return PyBytes_CheckExact(value) && put_bytes(place, value, plan);
    case AS_LIST:
        return PyList_CheckExact(value) && put_list(place, value, plan);
    default:
        return put_struct(plan->plan, value, place);
    }
}

static bool put_struct(const Plan *self, PyObject *message, struct place *place)
{
    if ((PyObject *)Py_TYPE(message) != self->kind || !has_room(place, MOST_HEAD))
        return false;
    if (self->count < 16)
        *place->at++ = (unsigned char)((self->is_array ? 0x90 : 0x80) | self->count);
    else
        put_number(place, self->is_array ? 0xdc : 0xde, (uint64_t)self->count, 2);
    for (Py_ssize_t i = 0; i < self->count; i++) {
        const struct plan_field *field = &self->fields[i];
        if (!self->is_array) {
            const Py_ssize_t size = PyBytes_Size(field->key);
            if (!has_room(place, size))
                return false;
            memcpy(place->at, PyBytes_AsString(field->key), (size_t)size);
            place->at += size;
        }
        if (field == place->left_out) {
            if (!has_room(place, MOST_HEAD))
                return false;
            if (field->value.code == AS_BYTES)
                put_number(place, 0xc6, place->left_bytes, 4);
            else if (!put_text_head(place, place->left_bytes))
                return false;
            place->gap = place->at;
            continue;
        }
        PyObject *value = field->get(field->slot, message, self->kind);
        if (value == NULL)
            return false;
        const bool is_put = put_value(&field->value, value, place);
        Py_DECREF(value); /* the slot has it still */
        if (!is_put)
            return false;
    }
    return true;
}

Py_ssize_t plan_encode(const Plan *self, PyObject *message, void *at, Py_ssize_t room)
{
    struct place place = {.at = at, .end = (unsigned char *)at + room};
    if (put_struct(self, message, &place))
        return place.at - (unsigned char *)at;
    PyErr_Clear();
    return place.is_full ? PLAN_SHORT : PLAN_NONE;
}

/* Encodes all but the field `left_out`, of which it writes the head only. */
static Py_ssize_t encode_around(const Plan *self, PyObject *message, const struct plan_field *left_out, uint64_t size,
                                unsigned char *at, Py_ssize_t room, Py_ssize_t *gap)
{
    enum { LONGER = 2 };
    struct place place = {.at = at, .end = at + room - LONGER, .left_out = left_out, .left_bytes = size};
    if (!put_struct(self, message, &place)) {
        PyErr_Clear();
        return PLAN_NONE;
    }
    Py_ssize_t length = place.at - at;
    *gap = place.gap - at;
    if (self->is_array && self->count < 16 && *gap % 8 == 8 - LONGER) {
        memmove(at + 1 + LONGER, at + 1, (size_t)length - 1);
        at[0] = 0xdc;
        at[1] = 0;
        at[2] = (unsigned char)self->count;
        length += LONGER;
        *gap += LONGER;
    }
    return length;
}

Py_ssize_t plan_encode_around(const Plan *self, PyObject *message, Py_ssize_t index, uint64_t size, void *bytes,
                              Py_ssize_t room, Py_ssize_t *gap)
{
    if (index < 0 || index >= self->count || size > UINT32_MAX)
        return PLAN_NONE;
    const struct plan_field *field = &self->fields[index];
    if (field->value.code != AS_BYTES || (int64_t)size < field->value.least || size > field->value.most)
        return PLAN_NONE;
    return encode_around(self, message, field, size, bytes, room, gap);
}

/* Finds the first field with a long text or long bytes, of a length that the plan allows. NULL: there is none, and an
 * error may be set. */
static const struct plan_field *find_long(const Plan *self, PyObject *message, struct plan_long *found)
{
    for (Py_ssize_t i = 0; i < self->count; i++) {
        const struct plan_field *field = &self->fields[i];
        if (field->value.code != AS_TEXT && field->value.code != AS_BYTES)
            continue;
        PyObject *value = field->get(field->slot, message, self->kind);
        if (value == NULL)
            return NULL;
        Py_ssize_t size = -1;
        if (field->value.code == AS_TEXT && PyUnicode_CheckExact(value)) {
            found->bytes = PyUnicode_AsUTF8AndSize(value, &size);
        } else if (field->value.code == AS_BYTES && PyBytes_CheckExact(value)) {
            found->bytes = PyBytes_AsString(value);
            size = (uint64_t)PyBytes_Size(value) <= field->value.most ? PyBytes_Size(value) : -1;
        }
        if (size >= LONG_PART && size >= field->value.least && (uint64_t)size <= UINT32_MAX) {
            found->value = value;
            found->size = (uint64_t)size;
            return field;
        }
        Py_DECREF(value); /* the slot has it still */
        if (PyErr_Occurred())
            return NULL; /* a lone surrogate */
    }
    return NULL;
}

Py_ssize_t plan_encode_long(const Plan *self, PyObject *message, void *bytes, Py_ssize_t room, struct plan_long *found)
{
    const struct plan_field *field = (PyObject *)Py_TYPE(message) == self->kind ? find_long(self, message, found) : NULL;
    Py_ssize_t length = PLAN_NONE;
    if (field != NULL && (length = encode_around(self, message, field, found->size, bytes, room, &found->gap)) < 0)
        Py_DECREF(found->value);
    PyErr_Clear();
    return length;
}

/* Types */

static void forget_value(struct plan_value *value)
{
    DROP(value->plan);
    if (value->item != NULL)
        forget_value(value->item);
    PyMem_Free(value->item);
}

static void plan_dealloc(PyObject *object)
{
    Plan *self = (Plan *)object;
    for (Py_ssize_t i = 0; i < self->count; i++) {
        Py_DECREF(self->fields[i].slot);
        Py_DECREF(self->fields[i].key);
        forget_value(&self->fields[i].value);
    }
    PyMem_Free(self->fields);
    Py_XDECREF(self->decode_slowly);
    Py_XDECREF(self->kind);
    core_free(self);
}

/* Reads the plan of one value. The caller must forget `value` also after a failure. */
static bool read_value(const CoreState *state, PyObject *given, struct plan_value *value)
{
    PyObject *inner;
    if (!PyTuple_Check(given)) {
        PyErr_SetString(PyExc_TypeError, "a value must be a tuple");
        return false;
    }
    if (!PyArg_ParseTuple(given, "iLO&O", &value->code, &value->least, core_as_u64, &value->most, &inner))
        return false;
    const bool is_struct = value->code == AS_STRUCT;
    if (value->code < AS_TEXT || value->code > AS_LIST || (is_struct && Py_TYPE(inner) != state->plan)) {
        PyErr_SetString(PyExc_ValueError, "no such value");
        return false;
    }
    if (is_struct)
        value->plan = (Plan *)Py_NewRef(inner);
    if (value->code != AS_LIST)
        return true;
    if ((value->item = PyMem_Calloc(1, sizeof *value->item)) == NULL) {
        PyErr_NoMemory();
        return false;
    }
    return read_value(state, inner, value->item);
}

static bool read_field(const CoreState *state, PyObject *given, struct plan_field *field)
{
    PyObject *value;
    if (!PyTuple_Check(given)) {
        PyErr_SetString(PyExc_TypeError, "a field must be a tuple");
        return false;
    }
    if (!PyArg_ParseTuple(given, "O!SO", &PyMemberDescr_Type, &field->slot, &field->key, &value))
        return false;
    if (!read_value(state, value, &field->value)) {
        forget_value(&field->value);
        return false;
    }
    field->get = (descrgetfunc)PyType_GetSlot(&PyMemberDescr_Type, Py_tp_descr_get);
    field->set = (descrsetfunc)PyType_GetSlot(&PyMemberDescr_Type, Py_tp_descr_set);
    Py_INCREF(field->slot);
    Py_INCREF(field->key);
    return true;
}

static PyObject *plan_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"kind", "fields", "is_array", NULL};
    const CoreState *state = PyType_GetModuleState(type);
    PyObject *kind, *fields;
    int is_array;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O!O!p", names, &PyType_Type, &kind, &PyTuple_Type, &fields,
                                     &is_array))
        return NULL;
    const Py_ssize_t count = PyTuple_Size(fields);
    if (count > UINT16_MAX) {
        PyErr_SetString(PyExc_ValueError, "too many fields");
        return NULL;
    }
    Plan *self = core_allocate(type);
    if (self == NULL)
        return NULL;
    self->kind = Py_NewRef(kind);
    self->is_array = is_array;
    self->fields = PyMem_Calloc((size_t)count + 1, sizeof *self->fields);
    if (self->fields == NULL) {
        Py_DECREF(self);
        return PyErr_NoMemory();
    }
    while (self->count < count) {
        if (!read_field(state, PyTuple_GetItem(fields, self->count), &self->fields[self->count])) {
            Py_DECREF(self);
            return NULL;
        }
        self->count++;
    }
    return (PyObject *)self;
}

/* The encoding as bytes, for callers that have no buffer. */
static PyObject *plan_encoded(PyObject *object, PyObject *message)
{
    unsigned char few[PLAN_BYTES], *bytes = few;
    Py_ssize_t room = sizeof few, size;
    PyObject *encoded = NULL;
    while ((size = plan_encode((const Plan *)object, message, bytes, room)) == PLAN_SHORT) {
        unsigned char *larger = PyMem_Realloc(bytes == few ? NULL : bytes, (size_t)(room *= 8));
        if (larger == NULL) {
            PyErr_NoMemory();
            break;
        }
        bytes = larger;
    }
    if (size >= 0)
        encoded = PyBytes_FromStringAndSize((const char *)bytes, size);
    else if (size == PLAN_NONE)
        encoded = Py_NewRef(Py_None);
    if (bytes != few)
        PyMem_Free(bytes);
    return encoded;
}

static PyObject *plan_decoded(PyObject *object, PyObject *payload)
{
    const Plan *self = (const Plan *)object;
    PyObject *message = NULL;
    Py_buffer buffer;
    if (self->decode_slowly == NULL) {
        PyErr_SetString(PyExc_TypeError, "this plan does not decode");
        return NULL;
    }
    if (PyBytes_Check(payload)) {
        message = plan_decode(self, PyBytes_AsString(payload), PyBytes_Size(payload));
    } else if (PyObject_GetBuffer(payload, &buffer, PyBUF_SIMPLE) == 0) {
        message = plan_decode(self, buffer.buf, buffer.len);
        PyBuffer_Release(&buffer);
    }
    if (message != NULL)
        return message;
    PyErr_Clear();
    return PyObject_CallFunctionObjArgs(self->decode_slowly, payload, NULL);
}

static PyMethodDef methods[] = {
    {"encode", plan_encoded, METH_O, NULL},
    {"decode", plan_decoded, METH_O, NULL},
    {0},
};

static PyMemberDef members[] = {
    {"decode_slowly", T_OBJECT_EX, offsetof(Plan, decode_slowly), 0, NULL},
    {0},
};

static PyType_Slot slots[] = {
    {Py_tp_new, (void *)plan_new},
    {Py_tp_dealloc, (void *)plan_dealloc},
    {Py_tp_methods, methods},
    {Py_tp_members, members},
    {0},
};

PyType_Spec plan_spec = {"bus.shm._core.Plan", sizeof(Plan), 0, CORE_TYPE, slots};

/* --- the encoder of a publisher's messages, used by Writer and OpenRun; its long way calls the class's check and
 * encoder */

bool encoder_prepare(struct encoder *self, PyObject *owner, PyObject *args)
{
    PyObject *kind, *is_valid, *encode, *plan = Py_None;
    if (self->kind != NULL) {
        PyErr_SetString(PyExc_ValueError, "prepared already");
        return false;
    }
    if (!PyArg_ParseTuple(args, "OOO|O", &kind, &is_valid, &encode, &plan))
        return false;
    if (plan != Py_None && Py_TYPE(plan) != core_state(owner)->plan) {
        PyErr_SetString(PyExc_TypeError, "plan must be a Plan or None");
        return false;
    }
    self->kind = Py_NewRef(kind);
    self->is_valid = Py_NewRef(is_valid);
    self->encode = Py_NewRef(encode);
    self->plan = plan == Py_None ? NULL : (Plan *)Py_NewRef(plan);
    return true;
}

void encoder_drop(struct encoder *self)
{
    Py_CLEAR(self->kind);
    Py_CLEAR(self->is_valid);
    Py_CLEAR(self->encode);
    Py_CLEAR(self->plan);
}

PyObject *encoder_encode(const struct encoder *self, PyObject *message)
{
    PyObject *answer = PyObject_CallFunctionObjArgs(self->is_valid, message, NULL);
    const bool is_valid = answer == Py_True;
    Py_XDECREF(answer);
    PyObject *payload = is_valid ? PyObject_CallFunctionObjArgs(self->encode, message, NULL) : NULL;
    if (payload == NULL && PyErr_Occurred() && PyErr_ExceptionMatches(PyExc_Exception))
        PyErr_Clear();
    return payload;
}
