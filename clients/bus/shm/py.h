/* What the parts of the native core share: the Python binding of ring.h, limited API of Python 3.11.
 *
 * Each call from Python is one whole operation on mapped segments, under the GIL. Nothing here waits (but for the
 * bounded spin of Readers.sleep, and Reader.wait, which gives the GIL away) and nothing here makes, passes or closes
 * descriptors: bus.shm.segments does. Exception: py_timerfd.c makes a timer, which has nothing to do with segments.
 * Files, each calls only those before it: py_core.c (what all use); py_segment.c: Mapping, with View and Loan, which are
 * what memoryviews of records hold; py_plan.c: Plan; py_gates.c: the gates of a Writer; py_feed.c: the feeds of Readers;
 * py_take.c: taking from them; py_pack.c: many samples at once; py_writer.c: Writer; py_readers.c: Readers and Bell;
 * py_reader.c: Reader; py_run.c: OpenRun, and py_send.c: Sends, of the other route, have no segment; py_module.c.
 */
#ifndef BUS_SHM_PY_H
#define BUS_SHM_PY_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <structmember.h>

#include "eventfd.h"
#include "feed.h"
#include "gates.h"
#include "writer.h"

/* What a write says where it is not just True; see _core.pyi. */
enum { REPORT_DUE = 2, FULL, SHORT, PINNED, TOO_LARGE, WRONG_THREAD, HELD };

/* What a payload begins with where its source has given it a time: bus.wire.source_time says it. */
enum { SOURCE_BYTES = 16 };
#define SOURCE_MARK "\xc7\x0d\x54\0\0\0\0\0"

static inline void core_write_source_time(unsigned char *head, int64_t source_ns)
{
    memcpy(head, SOURCE_MARK, 8);
    memcpy(head + 8, &source_ns, 8);
}

/* `head`: the first SOURCE_BYTES of a payload. True: they are none of the message, but the time. */
static inline bool core_source_time(const unsigned char *head, int64_t *source_ns)
{
    if (memcmp(head, SOURCE_MARK, 8) != 0)
        return false;
    memcpy(source_ns, head + 8, 8);
    return *source_ns > 0;
}

/* References to objects of the core's own types; DROP allows NULL. */
#define HOLD(object) Py_INCREF((PyObject *)(object))
#define DROP(object) Py_XDECREF((PyObject *)(object))

#define CORE_TYPE (Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE)
#define KEYWORDS (METH_VARARGS | METH_KEYWORDS)
#define FAST_KEYWORDS (METH_FASTCALL | METH_KEYWORDS)

typedef struct {
    PyTypeObject *mapping, *bell, *readers, *view, *loan, *plan, *sending;
} CoreState;

typedef struct {
    PyObject_HEAD
    unsigned char *memory;
    Py_ssize_t size;
    bool is_writable;
} Mapping;

typedef struct {
    PyObject_HEAD
    Mapping *memory;
    struct reading_process process; /* each of its gates holds a reference to the Bell */
} Bell;

static inline Bell *bell_of(struct reading_process *process)
{
    return (Bell *)((char *)process - offsetof(Bell, process));
}

/* The thread and process that may use a publisher's end. */
struct home {
    unsigned long thread;
    PyObject *is_mine; /* where threads share it: says whether it is the caller's now; NULL or None: `thread`'s */
};

typedef struct Plan Plan;

/* How the messages of one publisher are checked and encoded. */
struct encoder {
    PyObject *kind, *is_valid, *encode; /* NULL: not prepared */
    Plan *plan;                         /* NULL: all go the long way */
};

typedef struct {
    PyObject_HEAD
    struct ring_writer ring;
    Mapping *memory;
    struct home home; /* of no thread once it is closed */
    unsigned forks;
    bool is_closed;
    char is_report_due;
    char is_long;
    char is_lent; /* the holder of the loan fills the place at head: nothing else may be published */
    uint32_t lent;             /* bytes asked for by the last lend */
    uint64_t most;             /* largest payload that busd allows */
    uint64_t longest;          /* that writer_publish() encodes; when one is longer, `is_long` ends its work */
    uint64_t samples, bytes, rung;
    uint64_t stamp_ns; /* of the newest record: stamps don't go back, so that a time finds a place among them */
    struct encoder encoder;
} Writer;

typedef struct Reader Reader;

/* A feed that Readers watch, and who reads it. */
struct watch {
    struct feed_watch feed;
    Reader *reader;
};

typedef struct {
    PyObject_HEAD
    Mapping *memory;
    struct readers_header *header;
    struct reader_slot *slots;
    uint64_t slot_count;
    int doorbell; /* -1: closed */
    struct watch *watches; /* one for each feed of all Readers that live; not owned */
    struct feed **feeds;   /* the same by slot; NULL where there is none */
    size_t count, room;
    uint64_t round; /* looks so far */
    PyObject *pending; /* a list: owners that deliver() has yet to give out; NULL: none */
    bool had_news;  /* at the last attempt to fall asleep */
    bool is_anew;   /* since the last look at all, more than what a knock is for may be news */
    const Reader *turn; /* which deliver() calls back for after a knock */
    uint64_t turned_ns; /* when Reader.wait saw last that the loop has nothing to do, or left it to it */
    bool is_turn_due;   /* the next Reader.wait leaves it to the loop */
    bool is_rung;       /* Reader.wait has seen the doorbell rung, and perhaps it was not read since */
    char has_writers;   /* that wait for room, by the same doorbell */
} Readers;

/* A ring of a feed, and the mapping that it lies in. */
struct mapped_ring {
    struct feed_ring ring;
    Mapping *memory;
};

/* A feed, as a Reader keeps it. */
struct feed_source {
    struct feed feed;   /* first, for source_of() */
    PyObject *object;   /* by which the owner knows the publisher */
    size_t watch;       /* its place among those of Readers */
    uint64_t finishing; /* order in which publishers went; 0: there */
    int doorbell;       /* of the publisher's process, which the caller keeps open; -1: none */
    unsigned forks;     /* in a child of a fork, the slot is the parent's */
    bool is_held;       /* what waits stays where it is: see Reader.hold() */
};

static inline struct feed_source *source_of(const struct feed *feed) { return (struct feed_source *)feed; }

/* Of the ring that the feed reads. */
static inline Mapping *mapping_of(const struct feed *feed) { return ((struct mapped_ring *)feed->rings)->memory; }

/* How old samples were when they were taken, of some: below AGES_AT_ONCE, of all. */
struct ages {
    uint64_t count, sum_ns, most_ns;
    uint32_t passed; /* samples since the last that counts */
};

/* With what a Reader calls back by itself. */
struct prepared {
    PyObject *callback, *decode, *on_error;
    PyObject *queues;        /* a tuple: what waits in these comes before what is in the rings */
    PyObject *on_report_due; /* called where `is_report_due` is not set, and then it is */
    PyObject *on_slow;       /* called with the nanoseconds of a slow call of `callback`; None: not */
    int gives_taken;         /* the callback gets what Reader.take() returns for a message, not the message alone */
};

struct Reader {
    PyObject_HEAD
    Readers *readers;
    PyObject *owner;
    uint64_t round; /* the last look that had news for the owner */
    struct feed **feeds;
    size_t count, room;
    uint64_t depth, finishings;
    uint64_t bound; /* on what may wait: the depth, and the history of late joins until nothing waits; 0: none */
    bool tells_cursor;
    char takes_held;           /* what is held is taken all the same */
    uint64_t samples, bytes, expired, undecodable;
    struct ages ages;
    uint64_t replaced, overrun, passed; /* of feeds that were left; passed: all that they have stepped over */
    uint64_t lost_reported;    /* of all that was lost, what the owner knows */
    PyObject *rejected, *left; /* lists */
    struct prepared prepared;  /* callback NULL: the owner calls back */
    char is_busy;              /* a call is under way or about to go on: calls never overlap */
    char is_report_due;        /* the owner knows that its counters have changed */
};

/* py_core.c */
extern unsigned core_forks; /* of this process's ancestors since they loaded the core */
CoreState *core_state(PyObject *object);
uint64_t core_now_ns(void);
int core_ask_home(const struct home *home);
int core_arguments(const char *const *names, PyObject *const *args, Py_ssize_t count, PyObject *kwnames,
                   Py_ssize_t positional, PyObject **values);
int core_as_u64(PyObject *value, void *number);
void *core_allocate(PyTypeObject *type);
void core_free(void *object);
/* (message, stamp, number, source, time of receipt), as bus.delivery.receiver.Taken; takes over all but the source. Where one of them
 * is NULL, so is the answer. */
PyObject *core_with_origin(PyObject *message, PyObject *stamp_ns, uint64_t seq, PyObject *source, PyObject *received_ns);
/* Whether the thread that calls may use it. -1: an error is set. To be asked first: it may run Python code. */
static inline int is_home(const struct home *home)
{
    return home->is_mine == NULL ? PyThread_get_thread_ident() == home->thread : core_ask_home(home);
}

/* The types */
extern PyType_Spec mapping_spec, bell_spec, writer_spec, readers_spec, reader_spec, view_spec, loan_spec,
    plan_spec, run_spec, sends_spec, sending_spec;

/* py_run.c */
PyObject *core_run_messages(PyObject *module, PyObject *const *args, Py_ssize_t count);
PyObject *core_run_samples(PyObject *module, PyObject *const *args, Py_ssize_t count);

/* py_plan.c */

/* How the value of a field is encoded. */
enum { AS_TEXT = 1, AS_FLOAT, AS_BOOL, AS_INT, AS_STRUCT, AS_BYTES, AS_LIST };

/* plan_encode() gave up: the message is to go the long way; or there was not room enough to tell. */
enum { PLAN_NONE = -1, PLAN_SHORT = -2 };

/* Room for most messages that are worth a plan; in longer ones the copy is what costs. */
enum { PLAN_BYTES = 4096 };

/* Encodes `message` into `room` bytes from `at` on: how many it took, or one of the two above; what was at `at` is then
 * lost, and no error is set. Where it gives up, an error may have been made and dropped, and with that anything may
 * have run; else no Python code has. */
Py_ssize_t plan_encode(const Plan *self, PyObject *message, void *at, Py_ssize_t room);

/* The same, but of field `index`, which is bytes, only the head is put, for `size` of them; they belong at *gap. That is
 * a multiple of eight where a longer head of the array makes it one. PLAN_NONE, also where there is not room enough. */
Py_ssize_t plan_encode_around(const Plan *self, PyObject *message, Py_ssize_t index, uint64_t size, void *bytes,
                              Py_ssize_t room, Py_ssize_t *gap);

/* From the arguments (kind, is_valid, encode, plan or None) of a method of `owner`. False: an error is set. */
bool encoder_prepare(struct encoder *self, PyObject *owner, PyObject *args);
void encoder_drop(struct encoder *self);

/* The long way: the message's encoding. NULL: it is not surely valid, or can't be encoded; the caller finds out why, unless
 * an error is set. */
PyObject *encoder_encode(const struct encoder *self, PyObject *message);

/* py_segment.c */
PyObject *view_new(CoreState *state, Mapping *ring, Mapping *readers, struct reader_slot *slot, unsigned pin,
                   const struct ring_record *record);
PyObject *loan_new(CoreState *state, Mapping *ring, void *place, Py_ssize_t size);

/* py_gates.c */

/* After anything became visible in the ring, see gates_ring(). */
void writer_ring_bells(Writer *self, bool is_for_any);
void writer_drop_gates(Writer *self);
PyObject *writer_add_gate(PyObject *object, PyObject *args, PyObject *kwargs);
PyObject *writer_remove_gate(PyObject *object, PyObject *key);
PyObject *writer_has_pins(PyObject *object, PyObject *key);
PyObject *writer_make_lossy(PyObject *object, PyObject *key);

/* py_feed.c */
struct feed *source_new(PyObject *object, Mapping *memory, const struct ring_geometry *geometry, struct reader_slot *slot,
                        int doorbell);
void source_free(struct feed *feed);
const char *source_extend(struct feed *feed, Mapping *memory, const struct ring_geometry *geometry);
bool readers_watch(Readers *self, Reader *reader, struct feed *feed);
void readers_watch_anew(Readers *self, const struct feed *feed);
bool readers_have_news_besides(Readers *self, const Reader *reader);
void reader_remove(Reader *self, struct feed *feed);
int reader_leave(Reader *self, struct feed *feed, const char *reason);

/* Rings the publisher's process: there is room. */
static inline void source_ring(const struct feed *feed) { doorbell_ring(source_of(feed)->doorbell, KNOCK_ANY); }

/* py_writer.c */

/* Longer samples go step by step: the copy is what costs, and the memory that they take is seen to there. */
enum { QUICK_BYTES = 64 << 10 };

/* Whether it may be written to now. False: *outcome says why not, or is NULL with an error set. */
static inline bool writer_is_open(const Writer *self, PyObject **outcome)
{
    const int is_mine = is_home(&self->home);
    if (is_mine == 1 && self->forks == core_forks && !self->is_closed)
        return true;
    *outcome = NULL;
    if (is_mine >= 0 && self->is_closed)
        PyErr_SetString(PyExc_ValueError, "writer is closed");
    else if (is_mine >= 0)
        *outcome = PyLong_FromLong(WRONG_THREAD);
    return false;
}

/* A quick way is refused: the slow way, which comes next, must get HELD again. */
static inline void writer_is_refused(Writer *self, enum ring_status status)
{
    if (status == RING_HELD)
        self->ring.asked = 0;
}

static inline uint64_t writer_next_stamp(Writer *self, uint64_t stamp_ns)
{
    if (stamp_ns > self->stamp_ns)
        self->stamp_ns = stamp_ns;
    return self->stamp_ns;
}

/* py_take.c */
#define RING_IS_BROKEN "its ring contradicts itself"

/* Looks at all rings, leaves those that are done with, and passes over what is beyond the depth. */
int reader_poll(Reader *self);
/* Whether nothing is to be taken of the feed for now. */
static inline bool reader_holds(const Reader *self, const struct feed *feed)
{
    return source_of(feed)->is_held && !self->takes_held;
}

/* The feed whose next record is the oldest of all that are not held. NULL: nothing waits, or an error is set. */
struct feed *reader_oldest(Reader *self);
/* Samples were taken or passed over. */
void reader_show(Reader *self);
bool reader_has_more(const Reader *self);
/* Goes past the time that the source gave, where it did; its bytes count once the record is found intact. */
void pass_source_time(struct ring_record *record, int64_t *source_ns);
/* A sample was taken; `now_ns` 0: the clock was not read. */
void ages_note(struct ages *ages, uint64_t stamp_ns, uint64_t now_ns);
PyObject *reader_take(PyObject *self, PyObject *const *args, Py_ssize_t count, PyObject *kwnames);
PyObject *reader_messages(PyObject *self, PyObject *const *args, Py_ssize_t count, PyObject *kwnames);
bool reader_is_ready(const Reader *self);
int reader_deliver(Reader *self);
PyObject *reader_wait(PyObject *self, PyObject *const *args, Py_ssize_t count);

/* py_pack.c */
PyObject *reader_take_packed(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *writer_publish_packed(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *core_scan_packed(PyObject *module, PyObject *const *args, Py_ssize_t count);

/* py_timerfd.c */
PyObject *core_timerfd_create(PyObject *module, PyObject *unused);
PyObject *core_timerfd_settime(PyObject *module, PyObject *args);

/* py_threads.c */
PyObject *core_keep_thread(PyObject *module, PyObject *unused);

#endif
