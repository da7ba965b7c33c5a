/* Decoding by a plan: whole messages of some classes, and the long first text of any other.
 */
#include "py_plan.h"

#include <string.h>

/* Decoding. NULL without an error: the payload differs from the plan. */

struct source {
    const unsigned char *at, *end;
};

static inline bool has_left(const struct source *from, uint64_t size) { return (uint64_t)(from->end - from->at) >= size; }

/* Reads the number of `size` bytes behind a head. The caller has checked that the bytes exist. */
static inline uint64_t get_number(struct source *from, int size)
{
    uint64_t number = 0;
    for (int i = 1; i <= size; i++)
        number = number << 8 | from->at[i];
    from->at += 1 + size;
    return number;
}

static PyObject *get_text(struct source *from)
{
    const unsigned char head = *from->at;
    uint64_t size;
    if (head >= 0xa0 && head <= 0xbf) {
        size = head & 0x1f;
        from->at++;
    } else if (head >= 0xd9 && head <= 0xdb && has_left(from, 1 + (UINT64_C(1) << (head - 0xd9)))) {
        size = get_number(from, 1 << (head - 0xd9));
    } else {
        return NULL;
    }
    if (!has_left(from, size))
        return NULL;
    PyObject *text = PyUnicode_DecodeUTF8((const char *)from->at, (Py_ssize_t)size, NULL);
    from->at += size;
    return text;
}

static PyObject *get_int(struct source *from, int64_t least, uint64_t most)
{
    const unsigned char head = *from->at;
    uint64_t whole;
    if (head < 0x80) {
        whole = head;
        from->at++;
    } else if (head >= 0xe0) {
        whole = (uint64_t)(int64_t)(int8_t)head;
        from->at++;
    } else if (head >= 0xcc && head <= 0xd3) {
        const int size = 1 << (head & 3);
        if (!has_left(from, 1 + (uint64_t)size))
            return NULL;
        whole = get_number(from, size);
        if (head >= 0xd0 && size < 8 && whole >> (8 * size - 1) != 0)
            whole |= UINT64_MAX << (8 * size); /* its sign */
    } else {
        return NULL;
    }
    const bool is_negative = (head >= 0xd0) && (int64_t)whole < 0;
    if (is_negative)
        return (int64_t)whole < least ? NULL : PyLong_FromLongLong((int64_t)whole);
    return whole > most || (least > 0 && whole < (uint64_t)least) ? NULL : PyLong_FromUnsignedLongLong(whole);
}

static PyObject *get_double(struct source *from)
{
    if (*from->at != 0xcb || !has_left(from, MOST_HEAD))
        return NULL;
    const uint64_t bits = get_number(from, 8);
    double number;
    memcpy(&number, &bits, sizeof number);
    return PyFloat_FromDouble(number);
}

static PyObject *get_struct(const Plan *self, struct source *from);

static PyObject *get_value(const struct plan_value *plan, struct source *from)
{
    if (!has_left(from, 1))
        return NULL;
    switch (plan->code) {
    case AS_TEXT:
        return get_text(from);
    case AS_FLOAT:
        return get_double(from);
    case AS_BOOL:
        return *from->at == 0xc2 || *from->at == 0xc3 ? PyBool_FromLong(*from->at++ == 0xc3) : NULL;
    case AS_INT:
        return get_int(from, plan->least, plan->most);
    case AS_STRUCT:
        return get_struct(plan->plan, from);
    default:
        return NULL;
    }
}

static PyObject *get_struct(const Plan *self, struct source *from)
{
    if (!self->is_array || !has_left(from, 1))
        return NULL;
    if (self->count < 16 && *from->at == (0x90 | self->count))
        from->at++;
    else if (*from->at != 0xdc || !has_left(from, 3) || get_number(from, 2) != (uint64_t)self->count)
        return NULL;
    PyTypeObject *kind = (PyTypeObject *)self->kind;
    PyObject *message = ((allocfunc)PyType_GetSlot(kind, Py_tp_alloc))(kind, 0);
    for (Py_ssize_t i = 0; message != NULL && i < self->count; i++) {
        const struct plan_field *field = &self->fields[i];
        PyObject *value = get_value(&field->value, from);
        if (value == NULL || field->set(field->slot, message, value) < 0)
            Py_CLEAR(message);
        Py_XDECREF(value);
    }
    return message;
}

PyObject *plan_decode(const Plan *self, const void *bytes, Py_ssize_t size)
{
    struct source from = {.at = bytes, .end = (const unsigned char *)bytes + size};
    PyObject *message = get_struct(self, &from);
    if (message != NULL && from.at != from.end)
        Py_CLEAR(message);
    return message;
}

/* --- long texts */

enum { BLOCK = 8 << 10 }; /* stays in the first cache between its copy and its check */

typedef uint64_t pair __attribute__((vector_size(16), may_alias, aligned(1)));

static bool is_ascii(const unsigned char *bytes, size_t size)
{
    pair some = {0}, others = {0};
    uint64_t all = 0;
    size_t i = 0;
    for (; i + 4 * sizeof(pair) <= size; i += 4 * sizeof(pair)) {
        some |= *(const pair *)(bytes + i) | *(const pair *)(bytes + i + sizeof(pair));
        others |= *(const pair *)(bytes + i + 2 * sizeof(pair)) | *(const pair *)(bytes + i + 3 * sizeof(pair));
    }
    for (; i < size; i++)
        all |= bytes[i];
    some |= others;
    return ((all | some[0] | some[1]) & UINT64_C(0x8080808080808080)) == 0;
}

/* The text of bytes that are ASCII. NULL without an error: they are not.
 *
 * CPython's decoder checks and copies eight bytes at a time. Blocks, which memcpy() copies and which are then checked
 * in the cache, take 30 % less at 64 KiB and at 1 MiB. The check is of the copy, because another process may change
 * the original meanwhile. A text that no other code has seen may be filled: PyUnicode_WriteChar() does it, too. */
static PyObject *ascii_text(const unsigned char *bytes, Py_ssize_t size)
{
    PyObject *text = PyUnicode_FromStringAndSize("..", 2); /* one character would be shared */
    if (text == NULL || PyUnicode_Resize(&text, size) < 0) {
        Py_XDECREF(text);
        return NULL;
    }
    char *place = (char *)PyUnicode_AsUTF8AndSize(text, NULL); /* of an ASCII text: its characters themselves */
    for (Py_ssize_t i = 0; place != NULL && i < size; i += BLOCK) {
        const size_t part = (size_t)(size - i < BLOCK ? size - i : BLOCK);
        copy_from_shared(place + i, bytes + i, part);
        if (!is_ascii((const unsigned char *)place + i, part))
            break;
        if (size - i <= BLOCK)
            return text;
    }
    Py_DECREF(text);
    return NULL;
}

/* Passes everything before the first field's value. False: the payload differs from the plan. */
static bool pass_to_first(const Plan *self, struct source *from)
{
    const uint64_t count = (uint64_t)self->count;
    const unsigned char few = self->is_array ? 0x90 : 0x80, many = self->is_array ? 0xdc : 0xde;
    const uint64_t length = self->is_array ? 0 : (uint64_t)PyBytes_Size(self->fields[0].key);
    if (!has_left(from, MOST_HEAD))
        return false;
    if (count < 16 && *from->at == (few | count))
        from->at++;
    else if (*from->at != many || get_number(from, 2) != count)
        return false;
    if (!has_left(from, length) || memcmp(from->at, PyBytes_AsString(self->fields[0].key), (size_t)length) != 0)
        return false;
    from->at += length;
    return true;
}

/* Decodes the message without its text, by `decode`, and then adds that. */
static PyObject *decode_around(const Plan *self, PyObject *decode, const unsigned char *bytes, Py_ssize_t size)
{
    struct source from = {.at = bytes, .end = bytes + size};
    unsigned char rest[PLAN_BYTES];
    if (!pass_to_first(self, &from) || !has_left(&from, MOST_HEAD))
        return NULL;
    const size_t before = (size_t)(from.at - bytes);
    const unsigned char head = *from.at; /* read once: its owner may change it */
    if (head != 0xda && head != 0xdb)
        return NULL;
    const uint64_t length = get_number(&from, head == 0xda ? 2 : 4);
    if (length < LONG_TEXT || !has_left(&from, length))
        return NULL;
    const unsigned char *behind = from.at + length;
    const size_t after = (size_t)(from.end - behind);
    if (before + 1 + after > sizeof rest)
        return NULL;
    copy_from_shared(rest, bytes, before);
    rest[before] = 0xa0; /* an empty text */
    copy_from_shared(rest + before + 1, behind, after);
    PyObject *text = ascii_text(from.at, (Py_ssize_t)length), *message = NULL;
    PyObject *payload = text == NULL ? NULL
                                     : PyBytes_FromStringAndSize((const char *)rest, (Py_ssize_t)(before + 1 + after));
    if (payload != NULL)
        message = PyObject_CallFunctionObjArgs(decode, payload, NULL);
    if (message != NULL && (PyObject *)Py_TYPE(message) != self->kind)
        Py_CLEAR(message); /* another decoder, as of a drain, which takes the bytes themselves */
    if (message != NULL && self->fields[0].set(self->fields[0].slot, message, text) < 0)
        Py_CLEAR(message);
    Py_XDECREF(payload);
    Py_XDECREF(text);
    return message;
}

bool plan_begins_with_text(const Plan *self) { return self->count != 0 && self->fields[0].value.code == AS_TEXT; }

PyObject *plan_decode_text(const Plan *self, PyObject *decode, PyObject *payload)
{
    Py_buffer buffer;
    if (PyObject_GetBuffer(payload, &buffer, PyBUF_SIMPLE) < 0)
        return NULL;
    PyObject *message = decode_around(self, decode, buffer.buf, buffer.len);
    PyBuffer_Release(&buffer);
    return message;
}
