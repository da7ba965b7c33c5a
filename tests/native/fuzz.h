/* Common helpers of the fuzzers: an input is a script of bytes, and another process's memory changes at every read.
 *
 * Before every atomic load of the code under test, the other side may change memory, as the script decides. So the
 * actions of a hostile process between two instructions can be repeated. Must be included before anything else.
 */
#ifndef TESTS_NATIVE_FUZZ_H
#define TESTS_NATIVE_FUZZ_H

#include <stdatomic.h>

static void meddle(void);

#define __atomic_load_n(address, order) (meddle(), __atomic_load_n(address, order))
#undef atomic_load_explicit
#ifdef __clang__
#define atomic_load_explicit(object, order) (meddle(), __c11_atomic_load(object, order))
#else
#define atomic_load_explicit(object, order) __atomic_load_n(object, order)
#endif

#include "check.h"

#include <unistd.h>

static const unsigned char *script, *script_end;

static inline bool goes_on(void) { return script < script_end; }

static inline unsigned next_byte(void) { return goes_on() ? *script++ : 0; }

static inline uint64_t next_word(void)
{
    uint64_t word = 0;
    for (int i = 0; i < 8; i++)
        word = word << 8 | next_byte();
    return word;
}

/* A number, usually near `near`, because faults are likely there. */
static inline uint64_t next_number(uint64_t near)
{
    const unsigned kind = next_byte();
    switch (kind >> 5) {
    case 0:
        return kind & 31;
    case 1:
    case 2:
        return near + (kind & 31);
    case 3:
        return near - (kind & 31);
    case 4:
        return (UINT64_C(1) << (kind & 31) << (kind & 31)) - 1;
    case 5:
        return UINT64_MAX - (kind & 31);
    case 6:
        return (uint64_t)next_byte() << (kind & 31);
    default:
        return next_word();
    }
}

static inline void set_word(void *memory, uint64_t at, uint64_t word)
{
    memcpy((char *)memory + 8 * at, &word, 8);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

#ifndef LIBFUZZER
/* Decodes an input from a line of base64. */
static inline size_t decode(const char *line, unsigned char *input)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    size_t size = 0;
    unsigned bits = 0, count = 0;
    for (const char *digit; *line && (digit = strchr(digits, *line)) != NULL; line++) {
        bits = (bits << 6 | (unsigned)(digit - digits)) & 0xFFFF;
        count += 6;
        if (count >= 8) {
            count -= 8;
            input[size++] = (unsigned char)(bits >> count);
        }
    }
    return size;
}

/* Without libFuzzer: runs the inputs in the named files, one input in each line (tests/fuzz/kept.py). */
int main(int count, char **names)
{
    static char line[1 << 16];
    static unsigned char input[sizeof line];
    int inputs = 0;
    for (int i = 1; i < count; i++) {
        FILE *file = fopen(names[i], "r");
        if (file == NULL)
            FAIL("%s: can't be read", names[i]);
        while (fgets(line, sizeof line, file) != NULL) {
            if (strchr(line, '\n') == NULL)
                FAIL("%s: a line is too long", names[i]);
            const size_t size = decode(line, input);
            unsigned char *exact = malloc(size + 1); /* then a sanitizer sees an access after its end */
            memcpy(exact, input, size);
            alarm(10);
            LLVMFuzzerTestOneInput(exact, size);
            free(exact);
            inputs++;
        }
        fclose(file);
    }
    printf("%d inputs: ok\n", inputs);
    return 0;
}
#endif

#endif
