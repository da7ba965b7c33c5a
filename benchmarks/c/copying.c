/* Copies memory, and nothing else:

       copying SIZE COUNT

   The same bytes again and again, in turn to places that fit into a cache together. No transport that copies the
   bytes can be faster, wherever in the caches they are. */

#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { SECOND = 1000000000 };
static const size_t CACHED_BYTES = 4 << 20;

static int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * SECOND + now.tv_nsec;
}

static void *reserve(size_t size)
{
    void *memory = malloc(size ? size : 1);
    if (!memory) {
        perror("malloc");
        exit(1);
    }
    return memory;
}

static void copy(size_t size, uint64_t count)
{
    size_t places = size < CACHED_BYTES ? CACHED_BYTES / size : 1;
    char *from = reserve(size), *to = reserve(places * size);
    memset(from, 'x', size);
    memset(to, 0, places * size);
    int64_t begin_ns = now_ns();
    for (uint64_t number = 0; number < count; number++) {
        size_t offset = number % places * size;
        memcpy(to + offset, from, size);
        /* Otherwise a compiler may remove the copy, because nothing reads it. */
        atomic_signal_fence(memory_order_seq_cst);
    }
    printf("{\"event\": \"copied\", \"ns\": %lld}\n", (long long)(now_ns() - begin_ns));
    fflush(stdout);
    while (getchar() != EOF) /* the parent reads the CPU time first */
        ;
}

int main(int count, char **words)
{
    if (count != 3) {
        fprintf(stderr, "%d words and not 3: copying SIZE COUNT\n", count);
        return 2;
    }
    copy(strtoull(words[1], NULL, 10), strtoull(words[2], NULL, 10));
    return 0;
}
