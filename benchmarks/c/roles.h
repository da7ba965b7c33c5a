/* The work of a publisher and of a subscriber in C, the same for each way to get messages from one to the other. */
#ifndef ROLES_H
#define ROLES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { SECOND = 1000000000, STAMPS = 16 };

typedef struct {
    const char *way, *folder;
    size_t size;
    uint64_t count, warm_up;
    double rate; /* messages/s; 0 means full speed without losses */
} Work;

/* A way. Its functions get what `publish_to` or `subscribe_to` has returned; any of them may end the program. */
typedef struct {
    const char *name;
    void *(*publish_to)(const Work *work);   /* returns as soon as the subscriber is there; tells the route by tell_ready() */
    void *(*subscribe_to)(const Work *work); /* calls tell_ready() as soon as a publisher may come */
    void (*put)(void *end, const char *message, size_t size);
    const char *(*get)(void *end); /* waits for the next message, which stays until done() */
    void (*done)(void *end);
    void (*serve)(void *end, int64_t due_ns, int descriptor); /* NULL: nothing need be done; else see serve_until() */
    bool is_viewed; /* the subscriber looks at the message's head, where get() has it; else it copies the message */
} Way;

/* The ways of a program; the last one has no name. */
extern const Way WAYS[];

_Noreturn void fail(const char *what);
_Noreturn void fail_because(const char *what, const char *why);
int64_t now_ns(void);
void sleep_until(int64_t due_ns);
void *reserve(size_t size);
void tell(const char *event);
void tell_ready(const char *route); /* NULL: it has none, or does not know it yet */

/* Read the next line of the parent, which must be `word`; exit at the end of stdin. */
void wait_for(const char *word);

#endif
