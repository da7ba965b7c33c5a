/* CRC-32 of MCAP and zlib, several times as fast as zlib's, on x86-64 with PCLMULQDQ. No Python here.
 *
 * A polynomial of any length is folded: a carry-less product with x^n mod P moves 64 bits forward by n bits. Four
 * folds run side by side, or eight with wide registers. See "Fast CRC Computation for Generic Polynomials Using
 * PCLMULQDQ Instruction" by Gopal et al., Intel, 2009. A constant `by_n` is the pair x^(n+32) and x^(n-32) mod P,
 * reflected and shifted by one bit.
 */
#ifndef BUS_BAG_CRC_H
#define BUS_BAG_CRC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#if defined(__x86_64__) && defined(__GNUC__)

#include <immintrin.h>

/* Whether this processor has what crc_of() needs. */
static inline bool crc_is_there(void) { return __builtin_cpu_supports("pclmul") && __builtin_cpu_supports("sse4.1"); }

/* The CRC by four bits at a time, for the ends of a buffer. `crc` is inverted here and in crc_fold(). */
static inline uint32_t crc_slowly(uint32_t crc, const uint8_t *at, size_t size)
{
    static const uint32_t nibbles[16] = {
        0x00000000, 0x1db71064, 0x3b6e20c8, 0x26d930ac, 0x76dc4190, 0x6b6b51f4, 0x4db26158, 0x5005713c,
        0xedb88320, 0xf00f9344, 0xd6d6a3e8, 0xcb61b38c, 0x9b64c2b0, 0x86d3d2d4, 0xa00ae278, 0xbdbdf21c};
    for (; size != 0; size--) {
        crc ^= *at++;
        crc = crc >> 4 ^ nibbles[crc & 15];
        crc = crc >> 4 ^ nibbles[crc & 15];
    }
    return crc;
}

#define CRC_TARGET __attribute__((target("pclmul,sse4.1")))

/* Moves `value` forward by the distance of the pair `by`, and adds `next`. */
CRC_TARGET static inline __m128i crc_step(__m128i value, __m128i by, __m128i next)
{
    const __m128i low = _mm_clmulepi64_si128(value, by, 0x00), high = _mm_clmulepi64_si128(value, by, 0x11);
    return _mm_xor_si128(_mm_xor_si128(low, high), next);
}

CRC_TARGET static inline __m128i crc_load(const uint8_t *at)
{
    return _mm_loadu_si128((const __m128i *)(const void *)at);
}

/* Folds the rest of the bytes, a multiple of 16, into one CRC: from 128 bits to 64, then Barrett's reduction to 32. */
CRC_TARGET static inline uint32_t crc_end(__m128i one, const uint8_t *at, size_t size)
{
    const __m128i by_128 = _mm_set_epi64x(0x0ccaa009e, 0x1751997d0), by_64 = _mm_set_epi64x(0, 0x163cd6124);
    const __m128i mask = _mm_set_epi32(0, 0, 0, -1), barrett = _mm_set_epi64x(0x1f7011641, 0x1db710641);
    for (; size >= 16; at += 16, size -= 16)
        one = crc_step(one, by_128, crc_load(at));
    one = _mm_xor_si128(_mm_srli_si128(one, 8), _mm_clmulepi64_si128(one, by_128, 0x10));
    one = _mm_xor_si128(_mm_srli_si128(one, 4), _mm_clmulepi64_si128(_mm_and_si128(one, mask), by_64, 0x00));
    __m128i quotient = _mm_clmulepi64_si128(_mm_and_si128(one, mask), barrett, 0x10);
    quotient = _mm_clmulepi64_si128(_mm_and_si128(quotient, mask), barrett, 0x00);
    return (uint32_t)_mm_extract_epi32(_mm_xor_si128(one, quotient), 1);
}

/* The CRC of at least 64 bytes, a multiple of 16. */
CRC_TARGET static uint32_t crc_fold(uint32_t crc, const uint8_t *at, size_t size)
{
    const __m128i by_512 = _mm_set_epi64x(0x1c6e41596, 0x154442bd4), by_128 = _mm_set_epi64x(0x0ccaa009e, 0x1751997d0);
    __m128i a = _mm_xor_si128(crc_load(at), _mm_cvtsi32_si128((int)crc));
    __m128i b = crc_load(at + 16), c = crc_load(at + 32), d = crc_load(at + 48);
    for (at += 64, size -= 64; size >= 64; at += 64, size -= 64) {
        a = crc_step(a, by_512, crc_load(at));
        b = crc_step(b, by_512, crc_load(at + 16));
        c = crc_step(c, by_512, crc_load(at + 32));
        d = crc_step(d, by_512, crc_load(at + 48));
    }
    a = crc_step(crc_step(crc_step(a, by_128, b), by_128, c), by_128, d);
    return crc_end(a, at, size);
}

#define CRC_WIDE_TARGET __attribute__((target("pclmul,sse4.1,avx2,vpclmulqdq")))

CRC_WIDE_TARGET static inline __m256i crc_wide_load(const uint8_t *at)
{
    return _mm256_loadu_si256((const __m256i *)(const void *)at);
}

/* As crc_step(), for two values at once, forward by 1024 bits. */
CRC_WIDE_TARGET static inline __m256i crc_wide_step(__m256i value, const uint8_t *next)
{
    const __m256i by_1024 = _mm256_set_epi64x(0x14a7fe880, 0x1e88ef372, 0x14a7fe880, 0x1e88ef372);
    const __m256i low = _mm256_clmulepi64_epi128(value, by_1024, 0x00);
    const __m256i high = _mm256_clmulepi64_epi128(value, by_1024, 0x11);
    return _mm256_xor_si256(_mm256_xor_si256(low, high), crc_wide_load(next));
}

/* As crc_fold(), for at least 128 bytes, at twice the speed. */
CRC_WIDE_TARGET static uint32_t crc_fold_wide(uint32_t crc, const uint8_t *at, size_t size)
{
    const __m128i by_128 = _mm_set_epi64x(0x0ccaa009e, 0x1751997d0);
    __m256i a = crc_wide_load(at), b = crc_wide_load(at + 32), c = crc_wide_load(at + 64), d = crc_wide_load(at + 96);
    a = _mm256_xor_si256(a, _mm256_zextsi128_si256(_mm_cvtsi32_si128((int)crc)));
    for (at += 128, size -= 128; size >= 128; at += 128, size -= 128) {
        a = crc_wide_step(a, at);
        b = crc_wide_step(b, at + 32);
        c = crc_wide_step(c, at + 64);
        d = crc_wide_step(d, at + 96);
    }
    const __m256i lanes[] = {a, b, c, d};
    __m128i one = _mm256_castsi256_si128(a);
    one = crc_step(one, by_128, _mm256_extracti128_si256(a, 1));
    for (int i = 1; i < 4; i++) {
        one = crc_step(one, by_128, _mm256_castsi256_si128(lanes[i]));
        one = crc_step(one, by_128, _mm256_extracti128_si256(lanes[i], 1));
    }
    return crc_end(one, at, size);
}

/* Whether this processor has what crc_fold_wide() needs, and the kernel keeps its registers. */
static inline bool crc_is_wide(void) { return __builtin_cpu_supports("vpclmulqdq") && __builtin_cpu_supports("avx2"); }

/* As zlib.crc32. Call it only if crc_is_there(). */
static inline uint32_t crc_of(uint32_t crc, const uint8_t *at, size_t size)
{
    crc = ~crc;
    if (size >= 64) {
        const size_t whole = size & ~(size_t)15;
        crc = size >= 256 && crc_is_wide() ? crc_fold_wide(crc, at, whole) : crc_fold(crc, at, whole);
        at += whole;
        size -= whole;
    }
    return ~crc_slowly(crc, at, size);
}

#else

static inline bool crc_is_there(void) { return false; }

static inline uint32_t crc_of(uint32_t crc, const uint8_t *at, size_t size)
{
    (void)at, (void)size;
    return crc;
}

#endif
#endif
