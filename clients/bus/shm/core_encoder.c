/* What Writer and OpenRun know of a publisher's messages, and the long way to their bytes, which calls the class's check
 * and its encoder. The short way is a Plan (core_plan.c). */
#include "core.h"

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
