/* Sends: a publisher's `send` without a coroutine, if there is room. Sending: its awaitable result.
 *
 * A Sending behaves like the coroutine of an async function: nothing happens before it is awaited or a task runs it, it
 * can be cancelled, and it can be used once. If the quick way takes the message, the Sending is finished. Else it runs
 * the coroutine of the publisher's own `send`.
 *
 * If threads share the event loop, `publish_shared` holds the loop's guard for the quick way. */
#include "py.h"

/* A program that sends without ever waiting gives the event loop a turn after PER_TURN messages. With
 * `spares_turns`, it does so only if the loop has had no turn for TURN_NS. */
enum { PER_TURN = 100 };
#define TURN_NS UINT64_C(200000)

enum sending_state { IS_NEW, HAS_TURNED, IS_BUSY, IS_RUNNING, IS_DONE };

typedef struct {
    PyObject_HEAD
    PyObject *publish;   /* the present quick way, with the results of Writer.publish; NULL: none */
    PyObject *slow;      /* async, called with a message */
    PyObject *go_on;     /* called with a message and a result of `publish` other than True and False */
    PyObject *forgotten; /* called with a message that was never awaited */
    PyTypeObject *sending;
    unsigned in_turn;
    uint64_t turn_ns; /* end of the last turn given to the loop */
    char spares_turns;
    /* Attributes of a loop that threads share; NULL: no threads share it. */
    PyObject *acquire, *release; /* methods of the loop's guard */
    PyObject *loop;              /* has `is_interrupted`, which `rest_shared` handles. None: no guard is needed */
    PyObject *interrupted;       /* the name of that attribute */
    PyObject *rest_shared;       /* called with a message and the result of `publish` */
} Sends;

typedef struct {
    PyObject_HEAD
    Sends *sends;
    PyObject *message;
    PyObject *coroutine; /* IS_RUNNING */
    enum sending_state state;
} Sending;

static PyObject *sends_send(PyObject *object, PyObject *message)
{
    Sends *self = (Sends *)object;
    Sending *sending = PyObject_GC_New(Sending, self->sending);
    if (sending == NULL)
        return NULL;
    HOLD(self);
    sending->sends = self;
    sending->message = Py_NewRef(message);
    sending->coroutine = NULL;
    sending->state = IS_NEW;
    return (PyObject *)sending; /* the collector tracks it only after it has a coroutine */
}

/* Ends the Sending: the message is taken, or an error is set. */
static bool ends(Sending *self, bool is_taken)
{
    self->state = IS_DONE;
    Py_CLEAR(self->message);
    return is_taken;
}

static bool begin_slowly(Sending *self)
{
    self->state = IS_BUSY;
    PyObject *slow = Py_XNewRef(self->sends->slow); /* it may be exchanged meanwhile */
    self->coroutine = slow == NULL ? NULL : PyObject_CallFunctionObjArgs(slow, self->message, NULL);
    if (slow == NULL)
        PyErr_SetString(PyExc_AttributeError, "slow");
    Py_XDECREF(slow);
    if (self->coroutine == NULL)
        return ends(self, false);
    Py_CLEAR(self->message);
    self->state = IS_RUNNING;
    PyObject_GC_Track(self);
    return true;
}

/* Leaves the busy state after a step of the coroutine. During the step, the called code may have used this Sending. */
static void rest(Sending *self, bool is_over)
{
    self->state = is_over ? IS_DONE : IS_RUNNING;
    if (is_over)
        Py_CLEAR(self->coroutine);
}

static PySendResult run_on(Sending *self, PyObject *value, PyObject **result)
{
    self->state = IS_BUSY;
    const PySendResult outcome = PyIter_Send(self->coroutine, value, result);
    rest(self, outcome != PYGEN_NEXT);
    return outcome;
}

static bool is_turn_due(Sends *sends)
{
    if (++sends->in_turn <= PER_TURN)
        return false;
    sends->in_turn = 1;
    return !sends->spares_turns || core_now_ns() - sends->turn_ns >= TURN_NS;
}

/* Tries the quick way. 1: the message is taken; 0: it must go the slow way; -1: an error is set. */
static int try_quickly(const Sends *sends, PyObject *message)
{
    if (sends->publish == NULL)
        return 0;
    PyObject *publish = Py_NewRef(sends->publish); /* it may be exchanged meanwhile */
    PyObject *status = PyObject_CallFunctionObjArgs(publish, message, NULL);
    Py_DECREF(publish);
    if (status != NULL && status != Py_True && status != Py_False) {
        PyObject *answer = PyObject_CallFunctionObjArgs(sends->go_on, message, status, NULL);
        Py_DECREF(status);
        status = answer;
    }
    const int is_taken = status == NULL ? -1 : status == Py_True;
    Py_XDECREF(status);
    return is_taken;
}

static PySendResult begin(Sending *self, PyObject **result)
{
    Sends *sends = self->sends;
    *result = NULL;
    if (self->state == HAS_TURNED) {
        sends->turn_ns = core_now_ns();
    } else if (is_turn_due(sends)) {
        self->state = HAS_TURNED;
        *result = Py_NewRef(Py_None); /* the value that asyncio.sleep(0) yields */
        return PYGEN_NEXT;
    }
    self->state = IS_BUSY;
    const int is_taken = try_quickly(sends, self->message);
    if (is_taken != 0) {
        ends(self, is_taken > 0);
        *result = is_taken > 0 ? Py_NewRef(Py_None) : NULL;
        return is_taken > 0 ? PYGEN_RETURN : PYGEN_ERROR;
    }
    sends->in_turn--; /* the slow way counts the message itself */
    return begin_slowly(self) ? run_on(self, Py_None, result) : PYGEN_ERROR;
}

static PySendResult refuse(enum sending_state state, PyObject **result)
{
    *result = NULL;
    if (state == IS_BUSY)
        PyErr_SetString(PyExc_ValueError, "coroutine already executing");
    else
        PyErr_SetString(PyExc_RuntimeError, "cannot reuse already awaited coroutine");
    return PYGEN_ERROR;
}

static PySendResult sending_go_on(PyObject *object, PyObject *value, PyObject **result)
{
    Sending *self = (Sending *)object;
    if (self->state == IS_RUNNING)
        return run_on(self, value, result);
    if (self->state == IS_NEW && value != Py_None) {
        *result = NULL;
        PyErr_SetString(PyExc_TypeError, "can't send non-None value to a just-started coroutine");
        return PYGEN_ERROR;
    }
    return self->state == IS_NEW || self->state == HAS_TURNED ? begin(self, result) : refuse(self->state, result);
}

/* The outcome as a method returns it: the end is a StopIteration. */
static PyObject *outcome_of(PySendResult outcome, PyObject *result)
{
    if (outcome == PYGEN_RETURN) {
        PyObject *error = PyObject_CallFunctionObjArgs(PyExc_StopIteration, result == Py_None ? NULL : result, NULL);
        if (error != NULL)
            PyErr_SetObject(PyExc_StopIteration, error);
        Py_XDECREF(error);
        Py_CLEAR(result);
    }
    return result;
}

static PyObject *sending_send(PyObject *object, PyObject *value)
{
    PyObject *result;
    const PySendResult outcome = sending_go_on(object, value, &result);
    return outcome_of(outcome, result);
}

static PyObject *sending_next(PyObject *object) { return sending_send(object, Py_None); }

/* Throws an error into the coroutine. If the Sending has not begun, it never begins: its coroutine raises the error,
 * and the message is not published. */
static PyObject *sending_throw(PyObject *object, PyObject *args)
{
    Sending *self = (Sending *)object;
    PyObject *result = NULL;
    if (self->state == IS_BUSY || self->state == IS_DONE) {
        refuse(self->state, &result);
        return NULL;
    }
    if (self->state != IS_RUNNING && !begin_slowly(self))
        return NULL;
    self->state = IS_BUSY;
    PyObject *method = PyObject_GetAttrString(self->coroutine, "throw");
    if (method != NULL) {
        result = PyObject_CallObject(method, args);
        Py_DECREF(method);
    }
    rest(self, result == NULL);
    return result;
}

static PyObject *sending_close(PyObject *object, PyObject *Py_UNUSED(none))
{
    Sending *self = (Sending *)object;
    PyObject *result = NULL;
    if (self->state == IS_BUSY) {
        refuse(self->state, &result);
        return NULL;
    }
    if (self->state == IS_RUNNING) {
        self->state = IS_BUSY;
        PyObject *method = PyObject_GetAttrString(self->coroutine, "close");
        result = method == NULL ? NULL : PyObject_CallObject(method, NULL);
        Py_XDECREF(method);
        rest(self, false);
        if (result == NULL)
            return NULL;
        Py_DECREF(result);
    }
    ends(self, true);
    Py_RETURN_NONE;
}

static PyObject *sending_await(PyObject *object)
{
    const enum sending_state state = ((Sending *)object)->state;
    PyObject *none;
    if (state == IS_DONE) {
        refuse(state, &none);
        return NULL;
    }
    return Py_NewRef(object);
}

static PyObject *sending_repr(PyObject *object)
{
    return PyUnicode_FromFormat("<coroutine object Publisher.send at %p>", object);
}

static PyObject *get_name(PyObject *Py_UNUSED(object), void *name) { return PyUnicode_FromString(name); }

static int sending_traverse(PyObject *object, visitproc visit, void *arg)
{
    const Sending *self = (Sending *)object;
    Py_VISIT(Py_TYPE(object));
    Py_VISIT(self->sends);
    Py_VISIT(self->message);
    Py_VISIT(self->coroutine);
    return 0;
}

static int sending_clear(PyObject *object)
{
    Sending *self = (Sending *)object;
    Py_CLEAR(self->message);
    Py_CLEAR(self->coroutine);
    return 0;
}

static void tell_of_forgotten(const Sends *sends, PyObject *message)
{
    PyObject *type, *value, *traceback;
    PyErr_Fetch(&type, &value, &traceback);
    PyObject *call = PyObject_CallFunctionObjArgs(sends->forgotten, message, NULL);
    if (call == NULL)
        PyErr_WriteUnraisable(sends->forgotten);
    Py_XDECREF(call);
    PyErr_Restore(type, value, traceback);
}

static void sending_dealloc(PyObject *object)
{
    Sending *self = (Sending *)object;
    PyTypeObject *type = Py_TYPE(object);
    Sends *sends = self->sends;
    PyObject *message = self->message, *coroutine = self->coroutine;
    const bool is_forgotten = self->state == IS_NEW;
    PyObject_GC_UnTrack(object);
    PyObject_GC_Del(object);
    if (is_forgotten)
        tell_of_forgotten(sends, message);
    Py_XDECREF(message);
    Py_XDECREF(coroutine);
    DROP(sends);
    DROP(type);
}

static PyMethodDef sending_methods[] = {
    {"send", sending_send, METH_O, NULL},
    {"throw", sending_throw, METH_VARARGS, NULL},
    {"close", sending_close, METH_NOARGS, NULL},
    {0},
};

static PyGetSetDef sending_properties[] = {
    {"__name__", get_name, NULL, NULL, "send"},
    {"__qualname__", get_name, NULL, NULL, "Publisher.send"},
    {0},
};

static PyType_Slot sending_slots[] = {
    {Py_tp_dealloc, (void *)sending_dealloc},
    {Py_tp_traverse, (void *)sending_traverse},
    {Py_tp_clear, (void *)sending_clear},
    {Py_tp_repr, (void *)sending_repr},
    {Py_tp_iternext, (void *)sending_next},
    {Py_am_await, (void *)sending_await},
    {Py_am_send, (void *)sending_go_on},
    {Py_tp_methods, sending_methods},
    {Py_tp_getset, sending_properties},
    {0},
};

PyType_Spec sending_spec = {"bus.shm._core.Sending", sizeof(Sending), 0,
                            CORE_TYPE | Py_TPFLAGS_HAVE_GC | Py_TPFLAGS_DISALLOW_INSTANTIATION, sending_slots};

/* Sends */

static PyObject *sends_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"slow", "go_on", "forgotten", NULL};
    const CoreState *state = PyType_GetModuleState(type);
    PyObject *slow, *go_on, *forgotten;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOO", names, &slow, &go_on, &forgotten))
        return NULL;
    Sends *self = core_allocate(type);
    if (self == NULL)
        return NULL;
    self->slow = Py_NewRef(slow);
    self->go_on = Py_NewRef(go_on);
    self->forgotten = Py_NewRef(forgotten);
    HOLD(state->sending);
    self->sending = state->sending;
    return (PyObject *)self;
}

static PyObject *sends_share(PyObject *object, PyObject *args)
{
    Sends *self = (Sends *)object;
    PyObject *loop, *rest;
    if (!PyArg_ParseTuple(args, "OO", &loop, &rest))
        return NULL;
    if (self->loop != NULL) {
        PyErr_SetString(PyExc_RuntimeError, "share() is called once");
        return NULL;
    }
    if (loop == Py_None) {
        self->rest_shared = Py_NewRef(rest);
        self->loop = Py_NewRef(loop);
        Py_RETURN_NONE;
    }
    PyObject *guard = PyObject_GetAttrString(loop, "guard");
    if (guard == NULL)
        return NULL;
    self->acquire = PyObject_GetAttrString(guard, "acquire");
    self->release = PyObject_GetAttrString(guard, "release");
    Py_DECREF(guard);
    self->interrupted = PyUnicode_InternFromString("is_interrupted");
    if (self->acquire == NULL || self->release == NULL || self->interrupted == NULL) {
        Py_CLEAR(self->acquire);
        Py_CLEAR(self->release);
        Py_CLEAR(self->interrupted);
        return NULL;
    }
    self->rest_shared = Py_NewRef(rest);
    self->loop = Py_NewRef(loop);
    Py_RETURN_NONE;
}

/* Calls the quick way under the guard. Returns a new reference to its result, or to None if another thread has the
 * guard or there is no quick way. NULL: an error is set. */
static PyObject *publish_guarded(const Sends *self, PyObject *message)
{
    PyObject *is_held = PyObject_CallFunctionObjArgs(self->acquire, Py_False, NULL);
    if (is_held == NULL)
        return NULL;
    Py_DECREF(is_held);
    if (is_held != Py_True)
        Py_RETURN_NONE;
    PyObject *publish = Py_XNewRef(self->publish); /* it may be exchanged meanwhile */
    PyObject *status = publish == NULL ? Py_NewRef(Py_None) : PyObject_CallFunctionObjArgs(publish, message, NULL);
    Py_XDECREF(publish);
    PyObject *type, *value, *traceback;
    PyErr_Fetch(&type, &value, &traceback);
    PyObject *released = PyObject_CallNoArgs(self->release);
    if (released != NULL) {
        PyErr_Restore(type, value, traceback);
    } else {
        Py_CLEAR(status);
        Py_XDECREF(type);
        Py_XDECREF(value);
        Py_XDECREF(traceback);
    }
    Py_XDECREF(released);
    return status;
}

/* Publishes a message without a guard. */
static PyObject *publish_alone(const Sends *self, PyObject *message)
{
    PyObject *publish = Py_NewRef(self->publish); /* it may be exchanged meanwhile */
    PyObject *status = PyObject_CallFunctionObjArgs(publish, message, NULL);
    Py_DECREF(publish);
    return status;
}

/* Publishes a message while threads share the loop. `rest_shared` does the rest: a wait for the guard, a message
 * that the quick way does not take, an interrupt that came while the message's encoding ran Python code. */
static PyObject *sends_publish_shared(PyObject *object, PyObject *const *args, Py_ssize_t count, PyObject *kwnames)
{
    static const char *const names[] = {"msg", NULL};
    const Sends *self = (const Sends *)object;
    PyObject *message;
    if (core_arguments(names, args, count, kwnames, 1, &message) < 0)
        return NULL;
    if (message == NULL) {
        PyErr_SetString(PyExc_TypeError, "publish() missing 1 required positional argument: 'msg'");
        return NULL;
    }
    if (self->loop == NULL || self->publish == NULL) {
        PyErr_SetString(PyExc_RuntimeError, "share() comes first");
        return NULL;
    }
    const bool has_guard = self->loop != Py_None;
    PyObject *status = has_guard ? publish_guarded(self, message) : publish_alone(self, message);
    if (status == NULL)
        return NULL;
    if (status == Py_True && !has_guard) {
        Py_DECREF(status);
        Py_RETURN_NONE;
    }
    if (status == Py_True) {
        PyObject *is_interrupted = PyObject_GetAttr(self->loop, self->interrupted);
        if (is_interrupted == Py_False) {
            Py_DECREF(is_interrupted);
            Py_DECREF(status);
            Py_RETURN_NONE;
        }
        Py_XDECREF(is_interrupted);
        if (is_interrupted == NULL) {
            Py_DECREF(status);
            return NULL;
        }
    }
    PyObject *answer = PyObject_CallFunctionObjArgs(self->rest_shared, message, status, NULL);
    Py_DECREF(status);
    return answer;
}

static int sends_traverse(PyObject *object, visitproc visit, void *arg)
{
    const Sends *self = (Sends *)object;
    Py_VISIT(Py_TYPE(object));
    Py_VISIT(self->publish);
    Py_VISIT(self->slow);
    Py_VISIT(self->go_on);
    Py_VISIT(self->forgotten);
    Py_VISIT(self->acquire);
    Py_VISIT(self->release);
    Py_VISIT(self->loop);
    Py_VISIT(self->rest_shared);
    return 0;
}

static void sends_dealloc(PyObject *object)
{
    Sends *self = (Sends *)object;
    PyObject_GC_UnTrack(object);
    Py_XDECREF(self->publish);
    Py_XDECREF(self->slow);
    Py_XDECREF(self->go_on);
    Py_XDECREF(self->forgotten);
    Py_XDECREF(self->acquire);
    Py_XDECREF(self->release);
    Py_XDECREF(self->loop);
    Py_XDECREF(self->interrupted);
    Py_XDECREF(self->rest_shared);
    DROP(self->sending);
    core_free(self);
}

static PyMethodDef sends_methods[] = {
    {"send", sends_send, METH_O, NULL},
    {"share", sends_share, METH_VARARGS, NULL},
    {"publish_shared", (PyCFunction)(void (*)(void))sends_publish_shared, FAST_KEYWORDS, NULL},
    {0},
};

static PyMemberDef sends_members[] = {
    {"publish", T_OBJECT_EX, offsetof(Sends, publish), 0, NULL},
    {"slow", T_OBJECT_EX, offsetof(Sends, slow), 0, NULL},
    {"spares_turns", T_BOOL, offsetof(Sends, spares_turns), 0, NULL},
    {0},
};

/* Marks this method as async for its use as a callback (bus.base.awaited). */
static PyObject *get_mark(PyObject *Py_UNUSED(object), void *Py_UNUSED(closure)) { Py_RETURN_TRUE; }

static PyGetSetDef sends_properties[] = {
    {"_is_to_be_awaited", get_mark, NULL, NULL, NULL},
    {0},
};

static PyType_Slot sends_slots[] = {
    {Py_tp_new, (void *)sends_new},
    {Py_tp_dealloc, (void *)sends_dealloc},
    {Py_tp_traverse, (void *)sends_traverse},
    {Py_tp_methods, sends_methods},
    {Py_tp_members, sends_members},
    {Py_tp_getset, sends_properties},
    {0},
};

PyType_Spec sends_spec = {"bus.shm._core.Sends", sizeof(Sends), 0, CORE_TYPE | Py_TPFLAGS_HAVE_GC, sends_slots};
