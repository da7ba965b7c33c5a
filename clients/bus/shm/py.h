/* Common declarations of the native core: the Python binding of ring.h, in the limited API of Python 3.11.
 *
 * Each call from Python is one whole operation on mapped segments, under the GIL. Nothing here waits, with two
 * exceptions: the bounded spin of Readers.sleep, and Reader.wait, which releases the GIL. Nothing here makes, passes or
 * closes descriptors: bus.shm.segments does. Exception: py_timerfd.c makes a timer, which has nothing to do with
 * segments.
 *
 * Files; each calls only earlier ones:
 * - py_core.c: helpers of all others
 * - py_segment.c: Mapping, with View and Loan, the owners of memoryviews into records
 * - py_plan.c: Plan; py_plan.h: its parts
 * - py_unplan.c: decoding by a Plan
 * - py_gates.c: the gates of a Writer
 * - py_feed.c: the feeds of Readers
 * - py_take.c: taking from them
 * - py_pack.c: many samples at once
 * - py_writer.c: Writer
 * - py_readers.c: Readers and Bell
 * - py_reader.c: Reader
 * - py_run.c: OpenRun, of the socket route, without a segment
 * - py_send.c: Sends, without a segment
 * - py_fields.c: fields of messages, without a segment
 * - py_module.c: the module
 */
#ifndef BUS_SHM_PY_H
#define BUS_SHM_PY_H

#define PY_SSIZE_T_CLEAN
#include <Python.h>
#include <structmember.h>

#include "eventfd.h"
#include "feed.h"
#include "gates.h"
#include "sizes.h"
#include "writer.h"

/* Results of a write other than True; see _core.pyi. */
enum { REPORT_DUE = 2, FULL, SHORT, PINNED, TOO_LARGE, WRONG_THREAD, HELD };

/* Beginning of a payload if its source has given it a time: bus.wire.source_time describes it. */
enum { SOURCE_BYTES = 16 };
#define SOURCE_MARK "\xc7\x0d\x54\0\0\0\0\0"

static inline void core_write_source_time(unsigned char *head, int64_t source_ns)
{
    memcpy(head, SOURCE_MARK, 8);
    memcpy(head + 8, &source_ns, 8);
}

/* Reads the source time from `head`, the first SOURCE_BYTES of a payload. False: they belong to the message. */
static inline bool core_source_time(const unsigned char *head, int64_t *source_ns)
{
    if (memcmp(head, SOURCE_MARK, 8) != 0)
        return false;
    memcpy(source_ns, head + 8, 8);
    return *source_ns > 0;
}

/* Reference counts of objects of the core's own types; DROP allows NULL. */
#define HOLD(object) Py_INCREF((PyObject *)(object))
#define DROP(object) Py_XDECREF((PyObject *)(object))

#define CORE_TYPE (Py_TPFLAGS_DEFAULT | Py_TPFLAGS_IMMUTABLETYPE)
#define KEYWORDS (METH_VARARGS | METH_KEYWORDS)
#define FAST_KEYWORDS (METH_FASTCALL | METH_KEYWORDS)

typedef struct {
    PyTypeObject *mapping, *bell, *readers, *view, *loan, *plan, *sending, *field, *text;
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

/* The thread that may use a publisher's end. */
struct home {
    unsigned long thread;
    PyObject *is_mine; /* if threads share it: asked whether the caller may use it now; NULL or None: only `thread` */
};

typedef struct Plan Plan;

/* How the messages of one publisher are checked and encoded. */
struct encoder {
    PyObject *kind, *is_valid, *encode; /* NULL: not prepared */
    Plan *plan;                         /* NULL: all messages go the long way */
};

typedef struct {
    PyObject_HEAD
    struct ring_writer ring;
    Mapping *memory;
    struct home home; /* no thread's after the close */
    unsigned forks;
    bool is_closed;
    char is_report_due;
    char is_long;
    char is_lent; /* the holder of the loan fills the place at head: nothing else may be published */
    uint32_t lent;             /* size requested by the last lend */
    uint64_t most;             /* largest payload that busd allows */
    uint64_t most_long;        /* largest long field that writer_publish() writes; above it, the slow way comes first */
    char plans_only;           /* writer_publish() takes only what agrees with the plan */
    uint64_t longest;          /* largest encoding for writer_publish(); after a longer one, `is_long` turns it off */
    uint64_t samples, bytes, rung;
    uint64_t stamp_ns; /* of the newest record: stamps never decrease, so a search by time works */
    struct encoder encoder;
} Writer;

typedef struct Reader Reader;

/* A feed that Readers watch, and its reader. */
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
    struct watch *watches; /* one for each feed of all living Reader objects; not owned */
    struct feed **feeds;   /* the same feeds by slot; NULL for a free slot */
    size_t count, room;
    uint64_t round; /* number of checks so far */
    PyObject *pending; /* a list: owners that deliver() has not returned yet; NULL: none */
    bool had_news;  /* the last attempt to fall asleep found news */
    bool is_anew;   /* since the last full check, there may be news apart from the slot of a knock */
    const Reader *turn; /* the only reader for which deliver() calls back after a knock */
    uint64_t turned_ns; /* when Reader.wait last found the loop idle, or returned for its turn */
    bool is_turn_due;   /* the next Reader.wait returns at once, for a turn of the loop */
    bool is_rung;       /* Reader.wait has seen the doorbell rung, and perhaps it was not read since */
    char has_writers;   /* writers wait for room, by the same doorbell */
} Readers;

/* A ring of a feed, and the mapping that it lies in. */
struct mapped_ring {
    struct feed_ring ring;
    Mapping *memory;
};

/* A feed, as a Reader keeps it. */
struct feed_source {
    struct feed feed;   /* first, for source_of() */
    PyObject *object;   /* the owner's object for the publisher */
    size_t watch;       /* its index in Readers.watches */
    uint64_t finishing; /* order in which publishers have gone; 0: this one exists */
    int doorbell;       /* of the publisher's process; the caller keeps it open; -1: none */
    unsigned forks;     /* to notice the child of a fork, in which the slot is the parent's */
    bool is_held;       /* waiting samples stay in the ring: see Reader.hold() */
};

static inline struct feed_source *source_of(const struct feed *feed) { return (struct feed_source *)feed; }

/* The mapping of the feed's current ring. */
static inline Mapping *mapping_of(const struct feed *feed) { return ((struct mapped_ring *)feed->rings)->memory; }

/* Ages of samples at the time when they were taken. Up to AGES_AT_ONCE all samples count, then some. */
enum { AGE_PARTS = 50, AGE_FIRST_BITS = 10 }; /* of their histogram, as in bus.base.time_parts */

struct ages {
    uint64_t count, sum_ns, most_ns;
    uint32_t parts[AGE_PARTS];
    uint32_t passed; /* samples since the last one that counts */
};

/* Objects with which a Reader calls back by itself. */
struct prepared {
    PyObject *callback, *decode, *on_error;
    PyObject *queues;        /* a tuple: samples in these queues come before those in the rings */
    PyObject *on_report_due; /* called if `is_report_due` is not set; then that is set */
    PyObject *on_slow;       /* called with the nanoseconds of a slow call of `callback`; None: not called */
    int gives_taken;         /* the callback gets a message as Reader.take() returns it, not the message alone */
};

struct Reader {
    PyObject_HEAD
    Readers *readers;
    PyObject *owner;
    uint64_t round; /* the last check that had news for the owner */
    struct feed **feeds;
    size_t count, room;
    uint64_t depth, finishings;
    uint64_t bound; /* of waiting samples: the depth, plus the history of late joins until nothing waits; 0: none */
    bool tells_cursor;
    unsigned forks;            /* as of a feed_source */
    char takes_held;           /* takes held samples, too */
    PyObject *find_texts;      /* called at the first long payload, for `texts` */
    Plan *texts;               /* of messages that begin with a text; NULL: `decode` alone decodes */
    uint64_t samples, bytes, expired, undecodable;
    struct ages ages;
    uint64_t replaced, overrun, passed; /* of feeds that were left; passed: all samples that they stepped over */
    uint64_t most_missed;      /* the same: the most samples replaced between two taken ones of a feed */
    uint64_t lost_reported;    /* lost samples that the owner has been told */
    PyObject *rejected, *left; /* lists */
    PyObject *interrupted;     /* a list: messages of a batch that an error has ended */
    struct prepared prepared;  /* callback NULL: the owner calls back */
    char is_busy;              /* a call is in progress or about to continue: calls never overlap */
    char is_report_due;        /* the owner has been told that its counters have changed */
};

/* py_core.c */
extern unsigned core_forks; /* number of forks from the process that loaded the core to this one */
CoreState *core_state(PyObject *object);
uint64_t core_now_ns(void);
int core_ask_home(const struct home *home);
int core_arguments(const char *const *names, PyObject *const *args, Py_ssize_t count, PyObject *kwnames,
                   Py_ssize_t positional, PyObject **values);
int core_as_u64(PyObject *value, void *number);
void *core_allocate(PyTypeObject *type);
void core_free(void *object);
/* (message, stamp, number, source, time of receipt), as bus.delivery.receiver.Taken. Takes over all references except
 * that of the source. If one of them is NULL, the result is NULL. */
PyObject *core_with_origin(PyObject *message, PyObject *stamp_ns, uint64_t seq, PyObject *source, PyObject *received_ns);
/* Whether the calling thread may use it. -1: an error is set. Must be called first, because it may run Python code. */
static inline int is_home(const struct home *home)
{
    return home->is_mine == NULL ? PyThread_get_thread_ident() == home->thread : core_ask_home(home);
}

/* Types */
extern PyType_Spec mapping_spec, bell_spec, writer_spec, readers_spec, reader_spec, view_spec, loan_spec,
    plan_spec, run_spec, parts_spec, text_spec, sends_spec, sending_spec, field_spec, fields_spec, base_spec;

/* py_run.c */
PyObject *core_run_messages(PyObject *module, PyObject *const *args, Py_ssize_t count);
PyObject *core_run_samples(PyObject *module, PyObject *const *args, Py_ssize_t count);

/* py_plan.c */

/* How the value of a field is encoded. */
enum { AS_TEXT = 1, AS_FLOAT, AS_BOOL, AS_INT, AS_STRUCT, AS_BYTES, AS_LIST };

/* Failures of plan_encode(): the message must go the long way, or there was too little room to decide. */
enum { PLAN_NONE = -1, PLAN_SHORT = -2 };

/* Room for most messages for which a plan pays off; longer ones spend their time in the copy. */
enum { PLAN_BYTES = 4096 };

/* Encodes `message` into `room` bytes from `at` on. Returns the bytes written, or a failure from above; then the
 * bytes at `at` are lost, and no error is set. After a failure, an error may have been made and dropped, so any
 * Python code may have run. Otherwise no Python code has run. */
Py_ssize_t plan_encode(const Plan *self, PyObject *message, void *at, Py_ssize_t room);

/* Like plan_encode(), but writes only the head of the bytes field `index`, for `size` bytes, which belong at *gap. The
 * gap is a multiple of eight if a longer head of the array can achieve that. PLAN_NONE also if there is too little
 * room.
 */
Py_ssize_t plan_encode_around(const Plan *self, PyObject *message, Py_ssize_t index, uint64_t size, void *bytes,
                              Py_ssize_t room, Py_ssize_t *gap);

/* A long field of a message: its value as bytes, and their place in the encoding of the rest. */
struct plan_long {
    PyObject *value; /* an owned reference, which keeps the bytes */
    const void *bytes;
    uint64_t size;
    Py_ssize_t gap;
};

/* From this size on, a text or bytes field is long: not copied into the encoding and from there to its place, but at
 * once to its place. Its head then has the same bytes as msgspec's. */
enum { LONG_PART = 64 << 10 };

/* Like plan_encode_around(), for the first long field of the message; sets *found, except found->value after a
 * failure. PLAN_NONE also if no field is long. */
Py_ssize_t plan_encode_long(const Plan *self, PyObject *message, void *bytes, Py_ssize_t room, struct plan_long *found);

/* Fills an encoder from the arguments (kind, is_valid, encode, plan or None) of a method of `owner`. False: an error is
 * set. */
bool encoder_prepare(struct encoder *self, PyObject *owner, PyObject *args);
void encoder_drop(struct encoder *self);

/* The long way: the message's encoding. NULL: it may be invalid, or can't be encoded; the caller finds the reason,
 * unless an error is set. */
PyObject *encoder_encode(const struct encoder *self, PyObject *message);

/* py_unplan.c */

/* Payloads from this size on may begin with a long text; for shorter ones the second pass costs more than it saves. */
enum { LONG_TEXT = 16 << 10 };

/* Whether the first field of the plan's class is a text. */
bool plan_begins_with_text(const Plan *self);

/* The message of a payload that begins with a long ASCII text; `decode` decodes the rest. NULL without an error: it does
 * not, so call `decode` with all of it. */
PyObject *plan_decode_text(const Plan *self, PyObject *decode, PyObject *payload);

/* py_segment.c */
PyObject *view_new(CoreState *state, Mapping *ring, Mapping *readers, struct reader_slot *slot, unsigned pin,
                   const struct ring_record *record);
PyObject *loan_new(CoreState *state, Mapping *ring, void *place, Py_ssize_t size);

/* py_gates.c */

/* Rings doorbells after anything became visible in the ring, see gates_ring(). */
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

/* Rings the publisher's process, because there is room. */
static inline void source_ring(const struct feed *feed) { doorbell_ring(source_of(feed)->doorbell, KNOCK_ANY); }

/* py_writer.c */

/* Longer samples go step by step: the copy dominates their cost, and the steps check the memory that they take. */
enum { QUICK_BYTES = 64 << 10 };

/* Whether the writer may be used now. False: *outcome is the reason, or NULL with an error set. */
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

/* After a refused quick way: makes sure that the slow way, which comes next, gets HELD again. */
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

/* Checks all rings, leaves finished ones, and passes over samples above the depth. */
int reader_poll(Reader *self);
/* Whether this process made the reader. Else it is the child of a fork, perhaps of one in a decoder: the slots are the
 * parent's. */
static inline bool reader_is_ours(const Reader *self) { return self->forks == core_forks; }
/* Whether no samples may be taken from the feed for now. */
static inline bool reader_holds(const Reader *self, const struct feed *feed)
{
    return source_of(feed)->is_held && !self->takes_held;
}

/* The feed with the oldest next record, except held feeds. NULL: nothing waits, or an error is set. */
struct feed *reader_oldest(Reader *self);
/* Shows publishers the new positions, after samples were taken or passed over. */
void reader_show(Reader *self);
bool reader_has_more(const Reader *self);
/* Skips the source's time at the beginning of the payload, if there is one. It counts only after the record was found
 * intact. */
void pass_source_time(struct ring_record *record, int64_t *source_ns);
/* Notes the age of a taken sample; `now_ns` 0: the clock was not read. */
void ages_note(struct ages *ages, uint64_t stamp_ns, uint64_t now_ns);
PyObject *reader_take(PyObject *self, PyObject *const *args, Py_ssize_t count, PyObject *kwnames);
PyObject *reader_messages(PyObject *self, PyObject *const *args, Py_ssize_t count, PyObject *kwnames);
bool reader_is_ready(const Reader *self);
int reader_deliver(Reader *self);
PyObject *reader_wait(PyObject *self, PyObject *const *args, Py_ssize_t count);

/* py_pack.c */
PyObject *reader_take_packed(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *reader_take_merged(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *writer_publish_packed(PyObject *self, PyObject *const *args, Py_ssize_t count);
PyObject *core_scan_packed(PyObject *module, PyObject *const *args, Py_ssize_t count);

/* py_timerfd.c */
PyObject *core_timerfd_create(PyObject *module, PyObject *unused);
PyObject *core_timerfd_settime(PyObject *module, PyObject *args);

/* py_threads.c */
PyObject *core_keep_thread(PyObject *module, PyObject *unused);

#endif
