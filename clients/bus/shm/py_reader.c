/* Reader: the rings of one subscription. This file adds and removes its feeds; py_take.c takes from them. */
#include "py.h"

enum { MAX_FINISHING = 64 };

static PyObject *reader_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"readers", "owner", "depth", "tells_cursor", NULL};
    const CoreState *state = PyType_GetModuleState(type);
    Readers *readers;
    PyObject *owner;
    uint64_t depth;
    int tells_cursor;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O!OO&$p", names, state->readers, &readers, &owner, core_as_u64,
                                     &depth, &tells_cursor))
        return NULL;
    Reader *self = core_allocate(type);
    if (self == NULL)
        return NULL;
    HOLD(readers);
    Py_INCREF(owner);
    self->readers = readers;
    self->owner = owner;
    self->depth = self->bound = depth;
    self->tells_cursor = tells_cursor;
    self->forks = core_forks;
    self->rejected = PyList_New(0);
    self->left = PyList_New(0);
    self->interrupted = PyList_New(0);
    if (self->rejected != NULL && self->left != NULL && self->interrupted != NULL)
        return (PyObject *)self;
    DROP(self);
    return NULL;
}

static void forget_callback(Reader *self)
{
    struct prepared prepared = self->prepared;
    self->prepared = (struct prepared){0}; /* first, because the releases below may run any code */
    Py_XDECREF(prepared.callback);
    Py_XDECREF(prepared.decode);
    Py_XDECREF(prepared.on_error);
    Py_XDECREF(prepared.queues);
    Py_XDECREF(prepared.on_report_due);
    Py_XDECREF(prepared.on_slow);
}

static int reader_clear(PyObject *object)
{
    Reader *self = (Reader *)object;
    while (self->count != 0)
        reader_remove(self, self->feeds[self->count - 1]);
    Py_CLEAR(self->owner);
    Py_CLEAR(self->rejected);
    Py_CLEAR(self->left);
    Py_CLEAR(self->interrupted);
    Py_CLEAR(self->find_texts);
    forget_callback(self);
    return 0;
}

static int reader_traverse(PyObject *object, visitproc visit, void *arg)
{
    Reader *self = (Reader *)object;
    Py_VISIT(Py_TYPE(object));
    Py_VISIT(self->owner);
    Py_VISIT(self->rejected);
    Py_VISIT(self->left);
    Py_VISIT(self->interrupted);
    Py_VISIT(self->find_texts);
    Py_VISIT(self->prepared.callback);
    Py_VISIT(self->prepared.decode);
    Py_VISIT(self->prepared.on_error);
    Py_VISIT(self->prepared.queues);
    Py_VISIT(self->prepared.on_report_due);
    Py_VISIT(self->prepared.on_slow);
    for (size_t i = 0; i < self->count; i++)
        Py_VISIT(source_of(self->feeds[i])->object);
    return 0;
}

static void reader_dealloc(PyObject *object)
{
    Reader *self = (Reader *)object;
    PyObject_GC_UnTrack(object);
    reader_clear(object);
    PyMem_Free(self->feeds);
    DROP(self->texts);
    DROP(self->readers);
    core_free(self);
}

/* The feed of `source`. NULL: there is none, or a comparison has raised an error. Comparisons may run any code. */
static struct feed *find(Reader *self, PyObject *source)
{
    for (size_t i = 0; i < self->count; i++) {
        struct feed *feed = self->feeds[i];
        PyObject *other = source_of(feed)->object;
        Py_INCREF(other);
        const int is_equal = PyObject_RichCompareBool(other, source, Py_EQ);
        Py_DECREF(other);
        if (is_equal < 0)
            return NULL;
        if (is_equal && i < self->count && self->feeds[i] == feed)
            return feed;
    }
    return NULL;
}

static PyObject *value_error(const char *reason)
{
    PyErr_SetString(PyExc_ValueError, reason);
    return NULL;
}

/* The slot of a new match, with all pins free; else NULL with an error set. */
static struct reader_slot *free_slot(const Readers *readers, uint64_t number)
{
    if (number >= readers->slot_count) {
        value_error("slot is beyond the segment");
        return NULL;
    }
    struct reader_slot *slot = &readers->slots[number];
    for (unsigned i = 0; i < READER_PINS; i++) {
        if (atomic_load_explicit(&slot->pins[i], memory_order_relaxed) != 0) { /* own word */
            value_error("slot has pins in use");
            return NULL;
        }
    }
    return slot;
}

static bool make_room(Reader *self)
{
    if (self->count < self->room)
        return true;
    const size_t room = self->room == 0 ? 2 : 2 * self->room;
    struct feed **feeds = PyMem_Realloc(self->feeds, room * sizeof *feeds);
    if (feeds == NULL)
        return false;
    self->feeds = feeds;
    self->room = room;
    return true;
}

static PyObject *reader_attach(PyObject *object, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"source", "memory", "slot", "start", "since_ns",
                            "history", "lifespan_ns", "clock_ns", "doorbell", NULL};
    Reader *self = (Reader *)object;
    PyObject *source, *memory;
    uint64_t number, start = 0, since_ns = 0, history = 0, lifespan_ns = 0;
    long long clock_ns = 0;
    int doorbell = -1;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOO&|$O&O&O&O&Li", names, &source, &memory, core_as_u64, &number,
                                     core_as_u64, &start, core_as_u64, &since_ns, core_as_u64, &history, core_as_u64,
                                     &lifespan_ns, &clock_ns, &doorbell))
        return NULL;
    if (Py_TYPE(memory) != core_state((PyObject *)self->readers)->mapping)
        return PyErr_Format(PyExc_TypeError, "memory must be a Mapping");
    Mapping *mapping = (Mapping *)memory;
    struct ring_geometry geometry;
    const char *fault = ring_check(mapping->memory, (uint64_t)mapping->size, &geometry);
    if (fault != NULL)
        return value_error(fault);
    if (find(self, source) != NULL)
        return value_error("source is attached already");
    if (PyErr_Occurred())
        return NULL;
    struct reader_slot *slot = free_slot(self->readers, number);
    if (slot == NULL)
        return NULL;
    struct feed *feed = make_room(self) ? source_new(source, mapping, &geometry, slot, doorbell) : NULL;
    if (feed == NULL)
        return PyErr_NoMemory();
    feed->clock_ns = (uint64_t)clock_ns;
    feed->lifespan_ns = lifespan_ns;
    uint64_t old = 0; /* history does not count against the depth */
    if (!feed_begin(feed, start != 0 ? start : feed_find(feed, since_ns, history, &old))) {
        source_free(feed);
        return value_error("ring's sequence numbers are out of bounds");
    }
    if (!readers_watch(self->readers, self, feed)) {
        source_free(feed);
        return PyErr_NoMemory();
    }
    self->feeds[self->count++] = feed;
    if (self->bound != 0 && self->bound <= MAX_SEQ)
        self->bound += old;
    return PyLong_FromUnsignedLongLong(feed->ring.next);
}

static PyObject *reader_extend(PyObject *object, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"source", "memory", NULL};
    Reader *self = (Reader *)object;
    PyObject *source, *memory;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OO", names, &source, &memory))
        return NULL;
    if (Py_TYPE(memory) != core_state((PyObject *)self->readers)->mapping)
        return PyErr_Format(PyExc_TypeError, "memory must be a Mapping");
    Mapping *mapping = (Mapping *)memory;
    struct feed *feed = find(self, source);
    if (feed == NULL)
        return PyErr_Occurred() ? NULL : value_error("source is not attached");
    struct ring_geometry geometry;
    const char *fault = ring_check(mapping->memory, (uint64_t)mapping->size, &geometry);
    if (fault != NULL)
        return value_error(fault);
    if ((fault = source_extend(feed, mapping, &geometry)) != NULL)
        return PyErr_Occurred() ? NULL : value_error(fault);
    readers_watch_anew(self->readers, feed);
    if (self->tells_cursor && feed_room_is_due(feed))
        source_ring(feed); /* the cursor has moved since the ring grew, and no doorbell was rung for that */
    Py_RETURN_NONE;
}

/* Bounds the number of publishers that have gone: leaves the oldest one, with its waiting samples. */
static int bound_finishing(Reader *self)
{
    struct feed *oldest = NULL;
    size_t finishing = 0;
    for (size_t i = 0; i < self->count; i++) {
        struct feed *feed = self->feeds[i];
        if (source_of(feed)->finishing == 0)
            continue;
        finishing++;
        if (oldest == NULL || source_of(feed)->finishing < source_of(oldest)->finishing)
            oldest = feed;
    }
    if (finishing <= MAX_FINISHING)
        return 0;
    feed_skip(oldest, feed_waiting(oldest));
    return reader_leave(self, oldest, "");
}

static PyObject *reader_finish(PyObject *object, PyObject *source)
{
    Reader *self = (Reader *)object;
    struct feed *feed = find(self, source);
    if (feed != NULL && source_of(feed)->finishing == 0) {
        source_of(feed)->finishing = ++self->finishings;
        const bool is_empty = feed_finish(feed);
        readers_watch_anew(self->readers, feed);
        if ((is_empty ? reader_leave(self, feed, "") : bound_finishing(self)) < 0)
            return NULL;
    }
    if (PyErr_Occurred())
        return NULL;
    Py_RETURN_NONE;
}

static PyObject *reader_detach(PyObject *object, PyObject *source)
{
    Reader *self = (Reader *)object;
    struct feed *feed = find(self, source);
    if (feed != NULL)
        reader_remove(self, feed);
    if (PyErr_Occurred())
        return NULL;
    Py_RETURN_NONE;
}

static PyObject *reader_hold(PyObject *object, PyObject *args)
{
    Reader *self = (Reader *)object;
    PyObject *source;
    int is_on;
    if (!PyArg_ParseTuple(args, "Op", &source, &is_on))
        return NULL;
    struct feed *feed = find(self, source);
    if (feed != NULL)
        source_of(feed)->is_held = is_on;
    if (PyErr_Occurred())
        return NULL;
    Py_RETURN_NONE;
}

static PyObject *reader_next_seq(PyObject *object, PyObject *source)
{
    const struct feed *feed = find((Reader *)object, source);
    if (feed == NULL && PyErr_Occurred())
        return NULL;
    return PyLong_FromUnsignedLongLong(feed == NULL ? 0 : feed->ring.next);
}

static PyObject *reader_waiting(PyObject *object, PyObject *Py_UNUSED(none))
{
    const Reader *self = (const Reader *)object;
    const uint64_t most = self->bound == 0 || self->bound > MAX_SEQ ? MAX_SEQ : self->bound;
    uint64_t waiting = 0;
    for (size_t i = 0; i < self->count && waiting < most; i++)
        waiting += feed_waiting(self->feeds[i]); /* each is a difference of two numbers below 2^62 + 2: no wrap */
    return PyLong_FromUnsignedLongLong(waiting < most ? waiting : most);
}

/* Returns the list and begins another. */
static PyObject *pop(PyObject **list)
{
    PyObject *fresh = PyList_New(0), *full = *list;
    if (fresh == NULL || full == NULL)
        return fresh;
    *list = fresh;
    return full;
}

static PyObject *reader_pop_rejected(PyObject *object, PyObject *Py_UNUSED(none))
{
    return pop(&((Reader *)object)->rejected);
}

static PyObject *reader_pop_interrupted(PyObject *object, PyObject *Py_UNUSED(none))
{
    return pop(&((Reader *)object)->interrupted);
}

static PyObject *reader_pop_left(PyObject *object, PyObject *Py_UNUSED(none))
{
    return pop(&((Reader *)object)->left);
}

static PyObject *reader_pop_ages(PyObject *object, PyObject *Py_UNUSED(none))
{
    Reader *self = (Reader *)object;
    const struct ages ages = self->ages;
    Py_ssize_t used = AGE_PARTS;
    while (used > 0 && ages.parts[used - 1] == 0)
        used--;
    PyObject *parts = PyTuple_New(used);
    for (Py_ssize_t i = 0; parts != NULL && i < used; i++) {
        PyObject *number = PyLong_FromUnsignedLong(ages.parts[i]);
        if (number == NULL || PyTuple_SetItem(parts, i, number) < 0)
            Py_CLEAR(parts);
    }
    if (parts == NULL)
        return NULL;
    self->ages = (struct ages){0};
    return Py_BuildValue("(KKKN)", (unsigned long long)ages.count, (unsigned long long)ages.sum_ns,
                         (unsigned long long)ages.most_ns, parts);
}

static PyObject *get_depth(PyObject *object, void *Py_UNUSED(closure))
{
    return PyLong_FromUnsignedLongLong(((Reader *)object)->depth);
}

static int set_depth(PyObject *object, PyObject *value, void *Py_UNUSED(closure))
{
    Reader *self = (Reader *)object;
    if (value == NULL)
        PyErr_SetString(PyExc_AttributeError, "can't be deleted");
    const uint64_t old = self->bound > self->depth ? self->bound - self->depth : 0; /* waiting history */
    if (value == NULL || !core_as_u64(value, &self->depth))
        return -1;
    self->bound = self->depth != 0 && self->depth <= MAX_SEQ ? self->depth + old : self->depth;
    return 0;
}

static PyObject *get_lost(PyObject *object, void *is_overrun)
{
    const Reader *self = (const Reader *)object;
    uint64_t sum = is_overrun ? self->overrun : self->replaced;
    for (size_t i = 0; i < self->count; i++)
        sum += is_overrun ? self->feeds[i]->ring.overrun : self->feeds[i]->ring.replaced;
    return PyLong_FromUnsignedLongLong(sum);
}

static PyObject *get_most_missed(PyObject *object, void *Py_UNUSED(closure))
{
    const Reader *self = (const Reader *)object;
    uint64_t most = self->most_missed;
    for (size_t i = 0; i < self->count; i++)
        if (feed_most_missed(self->feeds[i]) > most)
            most = feed_most_missed(self->feeds[i]);
    return PyLong_FromUnsignedLongLong(most);
}

/* The number of samples that should have arrived, by sequence numbers alone: from the first to the newest of each
 * feed. */
static PyObject *get_expected(PyObject *object, void *Py_UNUSED(closure))
{
    const Reader *self = (const Reader *)object;
    uint64_t sum = self->passed;
    for (size_t i = 0; i < self->count; i++) {
        const struct feed *feed = self->feeds[i];
        const uint64_t newest = feed_newest(feed), next = feed->ring.next;
        sum += (newest < next || newest > MAX_SEQ ? next : newest + 1) - feed->first; /* `next` if newest is false */
    }
    return PyLong_FromUnsignedLongLong(sum);
}

static PyObject *reader_prepare(PyObject *object, PyObject *args, PyObject *kwargs)
{
    static char *names[] = {"callback", "decode", "on_error", "queues", "on_report_due", "on_slow", "gives_taken", NULL};
    Reader *self = (Reader *)object;
    struct prepared prepared = {.on_slow = Py_None};
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "OOOO!O|Op", names, &prepared.callback, &prepared.decode,
                                     &prepared.on_error, &PyTuple_Type, &prepared.queues, &prepared.on_report_due,
                                     &prepared.on_slow, &prepared.gives_taken))
        return NULL;
    Py_INCREF(prepared.callback);
    Py_INCREF(prepared.decode);
    Py_INCREF(prepared.on_error);
    Py_INCREF(prepared.queues);
    Py_INCREF(prepared.on_report_due);
    Py_INCREF(prepared.on_slow);
    forget_callback(self);
    self->prepared = prepared;
    Py_RETURN_NONE;
}

static PyObject *reader_forget_callback(PyObject *object, PyObject *Py_UNUSED(none))
{
    forget_callback((Reader *)object);
    Py_RETURN_NONE;
}

static PyObject *reader_expect_texts(PyObject *object, PyObject *find)
{
    Reader *self = (Reader *)object;
    PyObject *before = self->find_texts;
    self->find_texts = Py_NewRef(find);
    Py_XDECREF(before);
    Py_RETURN_NONE;
}

static PyMethodDef methods[] = {
    {"attach", (PyCFunction)(void (*)(void))reader_attach, KEYWORDS, NULL},
    {"extend", (PyCFunction)(void (*)(void))reader_extend, KEYWORDS, NULL},
    {"finish", reader_finish, METH_O, NULL},
    {"detach", reader_detach, METH_O, NULL},
    {"hold", reader_hold, METH_VARARGS, NULL},
    {"expect_texts", reader_expect_texts, METH_O, NULL},
    {"next_seq", reader_next_seq, METH_O, NULL},
    {"waiting", reader_waiting, METH_NOARGS, NULL},
    {"prepare", (PyCFunction)(void (*)(void))reader_prepare, KEYWORDS, NULL},
    {"forget_callback", reader_forget_callback, METH_NOARGS, NULL},
    {"take", (PyCFunction)(void (*)(void))reader_take, FAST_KEYWORDS, NULL},
    {"messages", (PyCFunction)(void (*)(void))reader_messages, FAST_KEYWORDS, NULL},
    {"take_packed", (PyCFunction)(void (*)(void))reader_take_packed, METH_FASTCALL, NULL},
    {"take_merged", (PyCFunction)(void (*)(void))reader_take_merged, METH_FASTCALL, NULL},
    {"wait", (PyCFunction)(void (*)(void))reader_wait, METH_FASTCALL, NULL},
    {"pop_rejected", reader_pop_rejected, METH_NOARGS, NULL},
    {"pop_interrupted", reader_pop_interrupted, METH_NOARGS, NULL},
    {"pop_left", reader_pop_left, METH_NOARGS, NULL},
    {"pop_ages", reader_pop_ages, METH_NOARGS, NULL},
    {0},
};

static PyMemberDef members[] = {
    {"samples", T_ULONGLONG, offsetof(Reader, samples), READONLY, NULL},
    {"bytes", T_ULONGLONG, offsetof(Reader, bytes), READONLY, NULL},
    {"expired", T_ULONGLONG, offsetof(Reader, expired), READONLY, NULL},
    {"undecodable", T_ULONGLONG, offsetof(Reader, undecodable), READONLY, NULL},
    {"is_busy", T_BOOL, offsetof(Reader, is_busy), 0, NULL},
    {"is_report_due", T_BOOL, offsetof(Reader, is_report_due), 0, NULL},
    {"takes_held", T_BOOL, offsetof(Reader, takes_held), 0, NULL},
    {0},
};

static PyGetSetDef properties[] = {
    {"depth", get_depth, set_depth, NULL, NULL},
    {"replaced", get_lost, NULL, NULL, NULL},
    {"overrun", get_lost, NULL, NULL, (void *)true},
    {"expected", get_expected, NULL, NULL, NULL},
    {"most_missed", get_most_missed, NULL, NULL, NULL},
    {0},
};

static PyType_Slot slots[] = {
    {Py_tp_new, (void *)reader_new},
    {Py_tp_dealloc, (void *)reader_dealloc},
    {Py_tp_traverse, (void *)reader_traverse},
    {Py_tp_clear, (void *)reader_clear},
    {Py_tp_methods, methods},
    {Py_tp_members, members},
    {Py_tp_getset, properties},
    {0},
};

PyType_Spec reader_spec = {"bus.shm._core.Reader", sizeof(Reader), 0, CORE_TYPE | Py_TPFLAGS_HAVE_GC, slots};
