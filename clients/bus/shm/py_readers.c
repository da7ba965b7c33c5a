/* Readers and Bell: sleeping and waking.
 *
 * Readers hold this process's readers' segment and doorbell, and wake and fall asleep for all its Reader objects at
 * once. A Bell holds the segment and doorbell of another process; all writers of this process share it.
 */
#include "py.h"

#define SLICE_NS 50000u /* of a spin, between looks at signals and other threads */

/* Reads the arguments of both types (memory, doorbell) and checks the segment. Returns a borrowed reference, or NULL
 * with an error. */
static Mapping *readers_segment(PyTypeObject *type, PyObject *args, PyObject *kwargs, bool is_written,
                                uint64_t *slot_count, int *doorbell)
{
    static char *names[] = {"memory", "doorbell", NULL};
    const CoreState *state = PyType_GetModuleState(type);
    Mapping *memory;
    if (!PyArg_ParseTupleAndKeywords(args, kwargs, "O!i", names, state->mapping, &memory, doorbell))
        return NULL;
    struct readers_geometry geometry;
    const char *fault = readers_check(memory->memory, (uint64_t)memory->size, &geometry);
    if (fault == NULL && is_written && !memory->is_writable)
        fault = "mapping is read-only";
    if (fault != NULL) {
        PyErr_SetString(PyExc_ValueError, fault);
        return NULL;
    }
    *slot_count = geometry.slot_count;
    return memory;
}

/* --- Bell */

static PyObject *bell_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    uint64_t slot_count;
    int doorbell;
    Mapping *memory = readers_segment(type, args, kwargs, false, &slot_count, &doorbell);
    if (memory == NULL)
        return NULL;
    Bell *self = core_allocate(type);
    if (self == NULL)
        return NULL;
    HOLD(memory);
    self->memory = memory;
    self->process = (struct reading_process){
        .arrival = &((const struct readers_header *)memory->memory)->arrival,
        .slots = readers_slots(memory->memory),
        .slot_count = slot_count,
        .doorbell = doorbell,
    };
    return (PyObject *)self;
}

static void bell_dealloc(PyObject *object)
{
    DROP(((Bell *)object)->memory);
    core_free(object);
}

static PyType_Slot bell_slots[] = {
    {Py_tp_new, (void *)bell_new},
    {Py_tp_dealloc, (void *)bell_dealloc},
    {0},
};

PyType_Spec bell_spec = {"bus.shm._core.Bell", sizeof(Bell), 0, CORE_TYPE, bell_slots};

/* --- Readers */

static PyObject *readers_new(PyTypeObject *type, PyObject *args, PyObject *kwargs)
{
    uint64_t slot_count;
    int doorbell;
    Mapping *memory = readers_segment(type, args, kwargs, true, &slot_count, &doorbell);
    if (memory == NULL)
        return NULL;
    Readers *self = core_allocate(type);
    if (self == NULL)
        return NULL;
    HOLD(memory);
    self->memory = memory;
    self->header = (struct readers_header *)memory->memory;
    self->slots = readers_slots(memory->memory);
    self->slot_count = slot_count;
    self->doorbell = doorbell;
    self->feeds = PyMem_Calloc(slot_count, sizeof *self->feeds);
    if (self->feeds == NULL) {
        Py_DECREF((PyObject *)self);
        return PyErr_NoMemory();
    }
    return (PyObject *)self;
}

static void readers_dealloc(PyObject *object)
{
    PyMem_Free(((Readers *)object)->watches);
    PyMem_Free(((Readers *)object)->feeds);
    Py_XDECREF(((Readers *)object)->pending);
    DROP(((Readers *)object)->memory);
    core_free(object);
}

static bool any_news(Readers *self)
{
    for (size_t i = 0; i < self->count; i++)
        if (feed_watch_has_news(&self->watches[i].feed))
            return true;
    return false;
}

/* Adds the owners of readers with news. Each is told only once, so if one can't be added, the whole call fails. */
static int collect(Readers *self, PyObject *owners)
{
    self->round++;
    for (size_t i = 0; i < self->count; i++) {
        struct watch *watch = &self->watches[i];
        if (!feed_watch_has_news(&watch->feed))
            continue;
        feed_mark_seen(watch->feed.feed);
        if (watch->reader->round == self->round)
            continue;
        watch->reader->round = self->round;
        if (PyList_Append(owners, watch->reader->owner) < 0)
            return -1;
    }
    return 0;
}

/* Notes that the owner of `reader` must check it. */
static int tell(Readers *self, const Reader *reader)
{
    if (self->pending == NULL && (self->pending = PyList_New(0)) == NULL)
        return -1;
    return PyList_Append(self->pending, reader->owner);
}

/* Passes an exception on. Rings, so that the event loop, if it continues, calls again for the other readers. */
static int interrupted(const Readers *self)
{
    if (self->doorbell >= 0)
        doorbell_ring(self->doorbell, KNOCK_ANY);
    return -1;
}

/* Gives each reader with news one turn: it calls back for one message, or leaves it to its owner. A callback may add
 * readers, remove them, check for news, or close everything. Samples skipped for that reason, and samples that arrive
 * after their reader's turn, are found by the check before the sleep. */
static int give_turns(Readers *self)
{
    const uint64_t round = ++self->round;
    bool is_quick = true;
    for (size_t i = 0; i < self->count && self->doorbell >= 0; i++) {
        if (!feed_watch_has_news(&self->watches[i].feed) || self->watches[i].reader->round >= round)
            continue;
        Reader *reader = self->watches[i].reader;
        HOLD(reader);
        reader->round = round;
        for (size_t j = 0; j < reader->count; j++)
            feed_mark_seen(reader->feeds[j]);
        /* If an owner calls back itself, the following readers are left to their owners, too: the order never
         * changes. */
        is_quick = is_quick && reader_is_ready(reader);
        int status = is_quick ? reader_deliver(reader) : 0;
        if (status <= 0 && tell(self, reader) < 0)
            status = -1;
        DROP(reader);
        if (status < 0)
            return interrupted(self);
    }
    return 0;
}

static inline bool is_asleep(const Readers *self)
{
    return atomic_load_explicit(&self->header->arrival.generation, memory_order_relaxed) & 1; /* own word */
}

/* Returns the only feed for which the doorbell was rung, by its `count`, if the feed has news. All rings were checked
 * before the sleep. This process counts as asleep meanwhile: a writer that publishes from now on rings again. */
static struct feed *feed_rung_for(Readers *self, uint64_t count)
{
    const uint64_t slot = knock_slot(count);
    if (slot >= self->slot_count || self->is_anew || self->feeds[slot] == NULL || !is_asleep(self))
        return NULL;
    bell_arm(&self->header->arrival, 0); /* PAIR(sleep): before the check. Counterpart: gates_ring(). */
    struct feed *feed = self->feeds[slot];
    return feed_watch_has_news(&self->watches[source_of(feed)->watch].feed) ? feed : NULL;
}

/* Gives a turn to the feed's reader, the only one with news. 1: nothing is left to do, and this process sleeps; 0:
 * it is awake, and owners may be pending; -1: an error. */
static int give_turn(Readers *self, const struct feed *feed)
{
    Reader *reader = self->watches[source_of(feed)->watch].reader;
    const Reader *before = self->turn;
    HOLD(reader);
    reader->round = ++self->round;
    for (size_t i = 0; i < reader->count; i++)
        feed_mark_seen(reader->feeds[i]);
    self->turn = reader;
    int status = reader_is_ready(reader) ? reader_deliver(reader) : 0;
    self->turn = before;
    if (status == 0 && tell(self, reader) < 0)
        status = -1;
    bool is_over = status == 1 && self->pending == NULL && self->doorbell >= 0 && !self->is_anew && is_asleep(self);
    for (size_t i = 0; is_over && i < reader->count; i++)
        is_over = !feed_watch_has_news(&self->watches[source_of(reader->feeds[i])->watch].feed);
    DROP(reader);
    if (is_over)
        self->had_news = false;
    else if (self->doorbell >= 0) /* else closed: in the child of a fork, the bell is the parent's */
        bell_disarm(&self->header->arrival);
    return status < 0 ? interrupted(self) : is_over;
}

/* Returns the owners that give_turns() has left pending, perhaps none. */
static PyObject *give_out(Readers *self)
{
    PyObject *owners = self->pending;
    self->pending = NULL;
    return owners == NULL ? PyList_New(0) : owners;
}

static PyObject *readers_deliver(PyObject *object, PyObject *may_sleep)
{
    Readers *self = (Readers *)object;
    if (self->doorbell < 0)
        Py_RETURN_NONE;
    const struct feed *feed = NULL;
    if (self->count > FEW_RINGS && may_sleep == Py_True)
        feed = feed_rung_for(self, doorbell_clear(self->doorbell));
    if (feed == NULL)
        bell_disarm(&self->header->arrival);
    const int status = feed != NULL ? give_turn(self, feed) : give_turns(self);
    if (status < 0)
        return NULL;
    if (status == 1)
        Py_RETURN_NONE;
    if (self->doorbell < 0)
        Py_RETURN_NONE; /* closed: the number may be another file's now, or the parent's doorbell after a fork */
    doorbell_clear(self->doorbell); /* a writer that rang before had published before: the check finds it */
    if (self->pending == NULL && may_sleep == Py_True) {
        bell_arm(&self->header->arrival, 0); /* PAIR(sleep): before the check. Counterpart: gates_ring(). */
        self->had_news = any_news(self);
        if (!self->had_news) {
            self->is_anew = false;
            Py_RETURN_NONE;
        }
        bell_disarm(&self->header->arrival);
    }
    return give_out(self);
}

static PyObject *readers_close(PyObject *object, PyObject *Py_UNUSED(none))
{
    Readers *self = (Readers *)object;
    self->doorbell = -1;
    Py_CLEAR(self->pending);
    Py_RETURN_NONE;
}

static inline void relax(void)
{
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    __asm__ volatile("yield");
#endif
}

/* Polls for news for up to `spin_ns`: 1 if there is any, 0 if not, -1 with an error. */
static int spin(Readers *self, uint64_t spin_ns)
{
    const uint64_t end = core_now_ns() + (spin_ns < MAX_SEQ ? spin_ns : MAX_SEQ);
    while (true) {
        const uint64_t now = core_now_ns(), until = end < now + SLICE_NS ? end : now + SLICE_NS;
        while (core_now_ns() < until) {
            if (any_news(self))
                return 1;
            relax();
        }
        if (until == end)
            return 0;
        Py_BEGIN_ALLOW_THREADS
        Py_END_ALLOW_THREADS
        if (PyErr_CheckSignals() < 0)
            return -1;
        if (self->doorbell < 0)
            return 0; /* closed by the handler of a signal, perhaps in the child of a fork */
    }
}

static PyObject *readers_sleep(PyObject *object, PyObject *const *args, Py_ssize_t count, PyObject *kwnames)
{
    static const char *const names[] = {"spin_ns", NULL};
    Readers *self = (Readers *)object;
    PyObject *value;
    uint64_t spin_ns = 0;
    if (core_arguments(names, args, count, kwnames, 1, &value) < 0 || (value != NULL && !core_as_u64(value, &spin_ns)))
        return NULL;
    PyObject *owners = PyList_New(0);
    if (owners == NULL)
        return NULL;
    int status = 0;
    /* Under load, this check saves writers the ring of a bell that would be disarmed at once. Else it would be one
     * check too many. */
    if (self->had_news || spin_ns != 0)
        status = collect(self, owners);
    if (status == 0 && spin_ns != 0 && PyList_Size(owners) == 0)
        status = spin(self, spin_ns);
    if (self->doorbell < 0) { /* closed: the bell may be the parent's */
        if (status < 0)
            Py_CLEAR(owners);
        return owners;
    }
    if (status == 1)
        status = collect(self, owners);
    if (status == 0 && PyList_Size(owners) == 0) {
        bell_arm(&self->header->arrival, 0); /* PAIR(sleep): before the check. Counterpart: gates_ring(). */
        status = collect(self, owners);
    }
    self->had_news = PyList_Size(owners) != 0;
    self->is_anew = self->is_anew && (status < 0 || self->had_news);
    if (status < 0 || self->had_news)
        bell_disarm(&self->header->arrival);
    if (status < 0)
        Py_CLEAR(owners);
    return owners;
}

static PyObject *readers_look(PyObject *object, PyObject *argument)
{
    Readers *self = (Readers *)object;
    uint64_t spin_ns;
    if (!core_as_u64(argument, &spin_ns))
        return NULL;
    const int found = any_news(self) ? 1 : spin(self, spin_ns);
    if (found == 0 && self->pending == NULL)
        Py_RETURN_NONE;
    return found < 0 || give_turns(self) < 0 ? NULL : give_out(self);
}

static PyObject *readers_is_free(PyObject *object, PyObject *argument)
{
    const Readers *self = (Readers *)object;
    uint64_t slot;
    if (!core_as_u64(argument, &slot))
        return NULL;
    if (slot >= self->slot_count)
        return PyErr_Format(PyExc_ValueError, "slot %llu of %llu", (unsigned long long)slot,
                            (unsigned long long)self->slot_count);
    for (unsigned i = 0; i < READER_PINS; i++)
        if (atomic_load_explicit(&self->slots[slot].pins[i], memory_order_relaxed) != 0) /* own word */
            Py_RETURN_FALSE;
    Py_RETURN_TRUE;
}

static PyMethodDef methods[] = {
    {"deliver", readers_deliver, METH_O, NULL},
    {"sleep", (PyCFunction)(void (*)(void))readers_sleep, FAST_KEYWORDS, NULL},
    {"look", readers_look, METH_O, NULL},
    {"is_free", readers_is_free, METH_O, NULL},
    {"close", readers_close, METH_NOARGS, NULL},
    {0},
};

static PyMemberDef members[] = {
    {"has_writers", T_BOOL, offsetof(Readers, has_writers), 0, NULL},
    {0},
};

static PyType_Slot slots[] = {
    {Py_tp_new, (void *)readers_new},
    {Py_tp_dealloc, (void *)readers_dealloc},
    {Py_tp_methods, methods},
    {Py_tp_members, members},
    {0},
};

PyType_Spec readers_spec = {"bus.shm._core.Readers", sizeof(Readers), 0, CORE_TYPE, slots};
