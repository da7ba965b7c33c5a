/* Messages from one process to another, and nothing else:

       PROGRAM publisher|subscriber WAY FOLDER SIZE COUNT WARM_UP RATE

   It uses the protocol of benchmarks/harness.py. The first two words of a paced message are its due time and its
   sending time, in ns of CLOCK_MONOTONIC. */

#include "roles.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

void fail(const char *what)
{
    fail_because(what, strerror(errno));
}

void fail_because(const char *what, const char *why)
{
    fprintf(stderr, "%s: %s\n", what, why);
    exit(1);
}

int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * SECOND + now.tv_nsec;
}

void sleep_until(int64_t due_ns)
{
    struct timespec due = {.tv_sec = due_ns / SECOND, .tv_nsec = due_ns % SECOND};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL) == EINTR)
        ;
}

void *reserve(size_t size)
{
    void *memory = malloc(size ? size : 1);
    if (!memory)
        fail("malloc");
    return memory;
}

void tell(const char *event)
{
    printf("{\"event\": \"%s\"}\n", event);
    fflush(stdout);
}

void tell_ready(const char *route)
{
    if (!route) {
        tell("ready");
        return;
    }
    printf("{\"event\": \"ready\", \"route\": \"%s\"}\n", route);
    fflush(stdout);
}

void wait_for(const char *word)
{
    char line[64];
    if (!fgets(line, sizeof line, stdin))
        exit(0);
    line[strcspn(line, "\n")] = '\0';
    if (strcmp(line, word) != 0)
        fail_because("expected another word than", line);
}

/* Have the way do its work until `due_ns`, or until `descriptor` can be read (-1: none). */
static void serve_until(const Way *way, void *end, int64_t due_ns, int descriptor)
{
    if (way->serve)
        way->serve(end, due_ns, descriptor);
    else if (descriptor < 0)
        sleep_until(due_ns);
}

/* wait_for() between messages: what waits in this process is sent meanwhile. */
static void serve_for(const Way *way, void *end, const char *word)
{
    serve_until(way, end, INT64_MAX, STDIN_FILENO);
    wait_for(word);
}

static void publish_paced(const Way *way, void *end, const Work *work, char *message)
{
    double period_ns = SECOND / work->rate;
    int64_t start_ns = now_ns() + (int64_t)period_ns;
    for (uint64_t number = 0; number < work->warm_up + work->count; number++) {
        int64_t stamps[2] = {start_ns + (int64_t)((double)number * period_ns), 0};
        serve_until(way, end, stamps[0], -1);
        stamps[1] = now_ns();
        memcpy(message, stamps, STAMPS);
        way->put(end, message, work->size);
    }
}

static void publish_flood(const Way *way, void *end, const Work *work, const char *message)
{
    serve_for(way, end, "warm_up");
    for (uint64_t number = 0; number < work->warm_up; number++)
        way->put(end, message, work->size);
    serve_for(way, end, "go");
    int64_t begin_ns = now_ns();
    for (uint64_t number = 0; number < work->count; number++)
        way->put(end, message, work->size);
    printf("{\"event\": \"sent\", \"begin_ns\": %lld}\n", (long long)begin_ns);
    fflush(stdout);
}

static void publish(const Way *way, const Work *work)
{
    void *end = way->publish_to(work);
    char *message = reserve(work->size);
    memset(message, 'x', work->size);
    if (work->rate > 0) {
        serve_for(way, end, "go");
        publish_paced(way, end, work, message);
    } else {
        publish_flood(way, end, work, message);
    }
    serve_for(way, end, "end");
}

static void say_list(const char *key, const int64_t *values, uint64_t count)
{
    printf(", \"%s\": [", key);
    for (uint64_t number = 0; number < count; number++)
        printf(number ? ", %lld" : "%lld", (long long)values[number]);
    printf("]");
}

/* The next message's stamps; the rest of it is copied, if the way wants that. */
static void receive(const Way *way, void *end, const Work *work, char *room, int64_t stamps[2])
{
    const char *message = way->get(end);
    if (!way->is_viewed)
        memcpy(room, message, work->size);
    memcpy(stamps, way->is_viewed ? message : room, STAMPS);
    way->done(end);
}

static void subscribe_paced(const Way *way, void *end, const Work *work, char *room)
{
    uint64_t total = work->warm_up + work->count;
    int64_t *late_ns = reserve(total * sizeof *late_ns), *age_ns = reserve(total * sizeof *age_ns);
    int64_t at_ns = 0, stamps[2];
    for (uint64_t number = 0; number < total; number++) {
        receive(way, end, work, room, stamps);
        at_ns = now_ns();
        late_ns[number] = stamps[1] - stamps[0];
        age_ns[number] = at_ns - stamps[1];
    }
    tell("complete");
    serve_for(way, end, "report");
    printf("{\"event\": \"received\", \"at_ns\": %lld", (long long)at_ns);
    say_list("late_ns", late_ns + work->warm_up, work->count);
    say_list("age_ns", age_ns + work->warm_up, work->count);
    printf("}\n");
}

static void subscribe(const Way *way, const Work *work)
{
    void *end = way->subscribe_to(work);
    char *room = reserve(work->size);
    if (work->rate > 0) {
        subscribe_paced(way, end, work, room);
    } else {
        int64_t stamps[2];
        uint64_t number = 0;
        for (; number < work->warm_up; number++)
            receive(way, end, work, room, stamps);
        tell("warm");
        for (; number < work->warm_up + work->count; number++)
            receive(way, end, work, room, stamps);
        printf("{\"event\": \"received\", \"end_ns\": %lld, \"count\": %llu, \"dropped\": {}}\n",
               (long long)now_ns(), (unsigned long long)number);
    }
    fflush(stdout);
    serve_for(way, end, "end");
}

static const Way *way_named(const char *name)
{
    for (const Way *way = WAYS; way->name; way++)
        if (strcmp(way->name, name) == 0)
            return way;
    return NULL;
}

int main(int count, char **words)
{
    if (count != 8) {
        fprintf(stderr, "%d words and not 8; see the head of roles.c\n", count);
        return 2;
    }
    Work work = {
        .way = words[2],
        .folder = words[3],
        .size = strtoull(words[4], NULL, 10),
        .count = strtoull(words[5], NULL, 10),
        .warm_up = strtoull(words[6], NULL, 10),
        .rate = strtod(words[7], NULL),
    };
    const Way *way = way_named(work.way);
    if (!way) {
        fprintf(stderr, "this program has no way %s\n", work.way);
        return 2;
    }
    if (work.size < STAMPS) {
        fprintf(stderr, "a size of %zu B: at least %d\n", work.size, STAMPS);
        return 2;
    }
    (strcmp(words[1], "publisher") == 0 ? publish : subscribe)(way, &work);
    return 0;
}
