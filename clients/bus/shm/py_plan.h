/* The parts of a plan, for the files that encode and decode by it: py_plan.c and py_unplan.c. */
#ifndef BUS_SHM_PY_PLAN_H
#define BUS_SHM_PY_PLAN_H

#include "py.h"

/* Most bytes in the head of a number, a text or an array; a number consists only of its head. */
enum { MOST_HEAD = 9 };

struct plan_value {
    int code;
    int64_t least; /* AS_INT: its value; AS_LIST and AS_BYTES: its length */
    uint64_t most;
    Plan *plan;              /* AS_STRUCT */
    struct plan_value *item; /* AS_LIST: the plan of each item */
};

struct plan_field {
    PyObject *slot; /* its member descriptor */
    descrgetfunc get;
    descrsetfunc set;
    PyObject *key; /* bytes that come before the value: its encoded name in a map, nothing in an array */
    struct plan_value value;
};

struct Plan {
    PyObject_HEAD
    PyObject *kind;
    bool is_array;
    Py_ssize_t count;
    struct plan_field *fields;
    PyObject *decode_slowly; /* NULL: it does not decode */
};

/* The message of a payload. NULL without an error: the payload differs from the plan. */
PyObject *plan_decode(const Plan *self, const void *bytes, Py_ssize_t size);

#endif
