/* Frames and their motion: histories of transforms, and the walk from one frame to another. No Python here.
 *
 * The rules are those of ROS 2's tf2: a static frame has one transform for all times. Any other frame has the
 * transforms of the last seconds; times in between are interpolated. A frame may change its parent.
 * `clients/bus_tf2/core/twin.py` is the same in Python, and tests compare the two.
 */
#ifndef BUS_TF2_FRAMES_H
#define BUS_TF2_FRAMES_H

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define NO_FRAME UINT32_MAX
#define NO_TIME INT64_MAX

enum {
    MAX_DEPTH = 1000,    /* a longer path counts as a loop */
    MAX_SAMPLES = 100000 /* limit for one frame; the oldest are dropped first */
};

/* Reasons to refuse a transform: a set of bits. */
enum { IS_NAN = 1, IS_DENORMALIZED = 2, IS_OLD = 4 };

/* Reasons why a look-up has no answer. */
enum { UNKNOWN = 1, LOOP, UNCONNECTED, NO_DATA, ONE_VALUE, FUTURE, PAST };

typedef struct {
    double x, y, z;
} vector;

typedef struct {
    double x, y, z, w;
} quaternion;

typedef struct {
    double row[3][3];
} matrix;

typedef struct {
    int64_t stamp_ns;
    vector translation;
    quaternion rotation;
    uint32_t parent;
} sample;

/* One frame. `samples` are sorted by time, from `first` on; of equal times, the newer sample comes later. */
typedef struct {
    sample *samples;
    uint32_t first, count, capacity;
    bool is_child;  /* it has received a transform, so it has a history, which may be empty */
    bool is_static;
} frame;

typedef struct {
    frame *frames;
    uint32_t count, capacity;
    int64_t cache_ns;
} tree;

/* The reason why there is no answer, with the requested and the available time. */
typedef struct {
    int kind;
    int64_t asked_ns, have_ns;
} failure;

/* Converts the source's coordinates into another frame's coordinates. */
typedef struct {
    vector translation;
    quaternion rotation;
} transform;

static const transform identity = {{0, 0, 0}, {0, 0, 0, 1}};

/* --- rotations */

static inline quaternion multiply(quaternion a, quaternion b)
{
    return (quaternion){a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y + a.y * b.w + a.z * b.x - a.x * b.z,
                        a.w * b.z + a.z * b.w + a.x * b.y - a.y * b.x, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z};
}

static inline quaternion inverse(quaternion q) { return (quaternion){-q.x, -q.y, -q.z, q.w}; }

static inline double dot(quaternion a, quaternion b) { return a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w; }

static inline vector rotate(quaternion q, vector v)
{
    const quaternion turned = multiply(multiply(q, (quaternion){v.x, v.y, v.z, 0}), inverse(q));
    return (vector){turned.x, turned.y, turned.z};
}

static inline vector add(vector a, vector b) { return (vector){a.x + b.x, a.y + b.y, a.z + b.z}; }

static inline matrix as_matrix(quaternion q)
{
    const double s = 2.0 / dot(q, q);
    const double xs = q.x * s, ys = q.y * s, zs = q.z * s;
    return (matrix){{{1.0 - (q.y * ys + q.z * zs), q.x * ys - q.w * zs, q.x * zs + q.w * ys},
                     {q.x * ys + q.w * zs, 1.0 - (q.x * xs + q.z * zs), q.y * zs - q.w * xs},
                     {q.x * zs - q.w * ys, q.y * zs + q.w * xs, 1.0 - (q.x * xs + q.y * ys)}}};
}

static inline quaternion as_quaternion(const matrix *m)
{
    const double trace = m->row[0][0] + m->row[1][1] + m->row[2][2];
    double part[4];
    if (trace > 0.0) {
        double s = sqrt(trace + 1.0);
        part[3] = s * 0.5;
        s = 0.5 / s;
        part[0] = (m->row[2][1] - m->row[1][2]) * s;
        part[1] = (m->row[0][2] - m->row[2][0]) * s;
        part[2] = (m->row[1][0] - m->row[0][1]) * s;
    } else {
        const int i = m->row[0][0] < m->row[1][1] ? (m->row[1][1] < m->row[2][2] ? 2 : 1)
                                                  : (m->row[0][0] < m->row[2][2] ? 2 : 0);
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        double s = sqrt(m->row[i][i] - m->row[j][j] - m->row[k][k] + 1.0);
        part[i] = s * 0.5;
        s = 0.5 / s;
        part[3] = (m->row[k][j] - m->row[j][k]) * s;
        part[j] = (m->row[j][i] + m->row[i][j]) * s;
        part[k] = (m->row[k][i] + m->row[i][k]) * s;
    }
    return (quaternion){part[0], part[1], part[2], part[3]};
}

/* The quaternion with length one, and with the sign that results from a rotation matrix. */
static inline quaternion normal(quaternion q)
{
    const matrix m = as_matrix(q);
    return as_quaternion(&m);
}

static inline quaternion slerp(quaternion a, quaternion b, double ratio)
{
    const double along = dot(a, b);
    const double cosine = fabs(along) / sqrt(dot(a, a) * dot(b, b));
    const double theta = acos(cosine > 1.0 ? 1.0 : cosine);
    if (theta == 0.0)
        return a;
    const double d = 1.0 / sin(theta), s0 = sin((1.0 - ratio) * theta) * d;
    const double s1 = (along < 0.0 ? -1.0 : 1.0) * sin(ratio * theta) * d;
    return (quaternion){a.x * s0 + b.x * s1, a.y * s0 + b.y * s1, a.z * s0 + b.z * s1, a.w * s0 + b.w * s1};
}

static inline vector lerp(vector a, vector b, double ratio)
{
    const double rest = 1.0 - ratio;
    return (vector){rest * a.x + ratio * b.x, rest * a.y + ratio * b.y, rest * a.z + ratio * b.z};
}

/* --- one frame's history */

static inline const sample *oldest(const frame *of) { return &of->samples[of->first]; }
static inline const sample *newest(const frame *of) { return &of->samples[of->first + of->count - 1]; }

/* The time of the newest sample; 0 for a static frame and an empty one. */
static inline int64_t latest_stamp(const frame *of)
{
    return of->is_static || of->count == 0 ? 0 : newest(of)->stamp_ns;
}

/* The number of samples at `stamp_ns` or before. */
static inline uint32_t samples_until(const frame *of, int64_t stamp_ns)
{
    const sample *samples = &of->samples[of->first];
    uint32_t low = 0, high = of->count;
    if (high > 0 && samples[high - 1].stamp_ns <= stamp_ns)
        return high; /* the common case: it is the newest */
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (samples[middle].stamp_ns <= stamp_ns)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

static inline bool is_same(const sample *a, const sample *b)
{
    return a->stamp_ns == b->stamp_ns && a->parent == b->parent && a->translation.x == b->translation.x
           && a->translation.y == b->translation.y && a->translation.z == b->translation.z
           && a->rotation.x == b->rotation.x && a->rotation.y == b->rotation.y && a->rotation.z == b->rotation.z
           && a->rotation.w == b->rotation.w;
}

/* Makes room for one more sample at the end; false without memory. */
static bool make_room(frame *of)
{
    if (of->first + of->count < of->capacity)
        return true;
    if (of->first > of->capacity / 2) {
        memmove(of->samples, &of->samples[of->first], of->count * sizeof *of->samples);
        of->first = 0;
        return true;
    }
    const uint32_t capacity = of->capacity == 0 ? 4 : of->capacity * 2;
    sample *samples = realloc(of->samples, capacity * sizeof *samples);
    if (samples == NULL)
        return false;
    of->samples = samples;
    of->capacity = capacity;
    return true;
}

/* Keeps a sample. Returns 0, IS_OLD, or -1 without memory. Drops samples that are too old first. A sample that the
 * history already has is not added again. */
static int keep(frame *of, const sample *new, int64_t cache_ns)
{
    if (of->is_static)
        of->count = 0;
    if (of->count > 0) {
        const int64_t latest_ns = newest(of)->stamp_ns;
        const int64_t horizon_ns = latest_ns < INT64_MIN + cache_ns ? INT64_MIN : latest_ns - cache_ns;
        while (oldest(of)->stamp_ns < horizon_ns) {
            of->first++;
            of->count--;
        }
        if (new->stamp_ns < horizon_ns)
            return IS_OLD;
    }
    uint32_t at = samples_until(of, new->stamp_ns);
    for (uint32_t before = at; before > 0; before--) {
        const sample *other = &of->samples[of->first + before - 1];
        if (other->stamp_ns != new->stamp_ns)
            break;
        if (is_same(other, new))
            return 0;
    }
    if (of->count == MAX_SAMPLES) {
        if (at == 0)
            return 0;
        of->first++;
        of->count--;
        at--;
    }
    if (!make_room(of))
        return -1;
    sample *place = &of->samples[of->first + at];
    memmove(place + 1, place, (of->count - at) * sizeof *place);
    *place = *new;
    of->count++;
    return 0;
}

/* The duration from one time to a later one, without overflow. */
static inline double between(int64_t from_ns, int64_t to_ns) { return (double)((uint64_t)to_ns - (uint64_t)from_ns); }

/* The sample at a time (0: the newest), interpolated if the samples around it have the same parent. */
static bool sample_at(const frame *of, int64_t time_ns, sample *found, failure *why)
{
    if (of->count == 0) {
        *why = (failure){NO_DATA, time_ns, 0};
        return false;
    }
    if (of->is_static || time_ns == 0 || time_ns == newest(of)->stamp_ns) {
        *found = *newest(of);
        return true;
    }
    if (of->count == 1) {
        *why = (failure){ONE_VALUE, time_ns, newest(of)->stamp_ns};
        return false;
    }
    if (time_ns == oldest(of)->stamp_ns) {
        *found = *oldest(of);
        return true;
    }
    if (time_ns > newest(of)->stamp_ns) {
        *why = (failure){FUTURE, time_ns, newest(of)->stamp_ns};
        return false;
    }
    if (time_ns < oldest(of)->stamp_ns) {
        *why = (failure){PAST, time_ns, oldest(of)->stamp_ns};
        return false;
    }
    const sample *after = &of->samples[of->first + samples_until(of, time_ns)], *before = after - 1;
    *found = *before;
    if (before->parent == after->parent) {
        const double ratio = between(before->stamp_ns, time_ns) / between(before->stamp_ns, after->stamp_ns);
        found->translation = lerp(before->translation, after->translation, ratio);
        found->rotation = slerp(before->rotation, after->rotation, ratio);
    }
    return true;
}

/* --- the tree */

/* Adds a frame; NO_FRAME without memory. */
static uint32_t add_frame(tree *of)
{
    if (of->count == of->capacity) {
        const uint32_t capacity = of->capacity == 0 ? 16 : of->capacity * 2;
        frame *frames = realloc(of->frames, capacity * sizeof *frames);
        if (frames == NULL)
            return NO_FRAME;
        of->frames = frames;
        of->capacity = capacity;
    }
    of->frames[of->count] = (frame){0};
    return of->count++;
}

/* The reasons to refuse a transform; 0 if there are none. */
static inline int refusal(const sample *new)
{
    const vector *moved = &new->translation;
    const double length = dot(new->rotation, new->rotation);
    return (isnan(moved->x) || isnan(moved->y) || isnan(moved->z) || isnan(length) ? IS_NAN : 0)
           | (length >= DBL_MIN && isfinite(length) ? 0 : IS_DENORMALIZED);
}

/* Inserts a transform that is not refused. Returns 0, IS_OLD, or -1 without memory. */
static int insert(tree *of, uint32_t child, sample *new, bool is_static)
{
    frame *place = &of->frames[child];
    new->rotation = normal(new->rotation);
    if (place->is_static != is_static) {
        place->first = place->count = 0;
        place->is_static = is_static;
    }
    place->is_child = true;
    return keep(place, new, of->cache_ns);
}

static void clear(tree *of)
{
    for (uint32_t i = 0; i < of->count; i++)
        if (!of->frames[i].is_static)
            of->frames[i].first = of->frames[i].count = 0;
}

static void release(tree *of)
{
    for (uint32_t i = 0; i < of->count; i++)
        free(of->frames[i].samples);
    free(of->frames);
}

static inline int64_t earlier(int64_t common_ns, int64_t stamp_ns)
{
    return stamp_ns != 0 && stamp_ns < common_ns ? stamp_ns : common_ns;
}

/* The newest parent of a frame; NO_FRAME for a root, and without data. */
static inline uint32_t newest_parent(const frame *of) { return of->count == 0 ? NO_FRAME : newest(of)->parent; }

/* The latest time at which all transforms between two frames are known; 0 if all of them are static. */
static bool common_time(const tree *of, uint32_t target, uint32_t source, int64_t *time_ns, failure *why)
{
    uint32_t way[MAX_DEPTH + 1]; /* frames from the source up, without the source */
    int64_t stamps[MAX_DEPTH + 1];
    uint32_t length = 0, at = source;
    int64_t common_ns = NO_TIME;
    *why = (failure){0};
    for (uint32_t up; (up = newest_parent(&of->frames[at])) != NO_FRAME; at = up) {
        stamps[length] = latest_stamp(&of->frames[at]);
        way[length++] = up;
        common_ns = earlier(common_ns, stamps[length - 1]);
        if (up == target) {
            *time_ns = common_ns == NO_TIME ? 0 : common_ns;
            return true;
        }
        if (length > MAX_DEPTH) {
            why->kind = LOOP;
            return false;
        }
    }
    common_ns = NO_TIME;
    uint32_t depth = 0, meets = NO_FRAME;
    at = target;
    for (uint32_t up; (up = newest_parent(&of->frames[at])) != NO_FRAME; at = up) {
        common_ns = earlier(common_ns, latest_stamp(&of->frames[at]));
        if (up == source) {
            *time_ns = common_ns == NO_TIME ? 0 : common_ns;
            return true;
        }
        for (meets = 0; meets < length && way[meets] != up; meets++)
            ;
        if (meets < length)
            break;
        meets = NO_FRAME;
        if (++depth > MAX_DEPTH) {
            why->kind = LOOP;
            return false;
        }
    }
    if (meets == NO_FRAME) {
        why->kind = UNCONNECTED;
        return false;
    }
    for (uint32_t i = 0; i <= meets; i++)
        common_ns = earlier(common_ns, stamps[i]);
    *time_ns = common_ns == NO_TIME ? 0 : common_ns;
    return true;
}

static inline void climb(transform *to, const sample *step)
{
    to->translation = add(rotate(step->rotation, to->translation), step->translation);
    to->rotation = multiply(step->rotation, to->rotation);
}

static inline transform inverted(const transform *of)
{
    const quaternion back = inverse(of->rotation);
    const vector away = {-of->translation.x, -of->translation.y, -of->translation.z};
    return (transform){rotate(back, away), back};
}

/* The transform from coordinates in `source` to coordinates in `target`, at a time. 0: the latest common time, which is
 * stored in *time_ns. `source` and `target` differ. */
static bool look_up(const tree *of, uint32_t target, uint32_t source, int64_t *time_ns, transform *found, failure *why)
{
    *why = (failure){0};
    if (*time_ns == 0 && !common_time(of, target, source, time_ns, why))
        return false;
    transform from_source = identity, from_target = identity;
    failure missing = {0};
    sample step;
    uint32_t at = source, top = source, depth = 0;
    for (;;) {
        top = at;
        if (at == target)
            break;
        const frame *here = &of->frames[at];
        if (!here->is_child || !sample_at(here, *time_ns, &step, &missing))
            break;
        climb(&from_source, &step);
        at = step.parent;
        if (++depth > MAX_DEPTH) {
            why->kind = LOOP;
            return false;
        }
    }
    bool is_below = false;
    for (at = target, depth = 0; at != top; at = step.parent) {
        const frame *here = &of->frames[at];
        if (at == source) {
            is_below = true;
            break;
        }
        if (!here->is_child)
            break;
        if (!sample_at(here, *time_ns, &step, why))
            return false;
        climb(&from_target, &step);
        if (++depth > MAX_DEPTH) {
            why->kind = LOOP;
            return false;
        }
    }
    if (is_below) { /* the source is above the target: the first walk's result is not needed */
        *found = inverted(&from_target);
    } else if (at != top) {
        *why = missing;
        if (missing.kind == 0)
            why->kind = UNCONNECTED;
        return false;
    } else {
        const transform back = inverted(&from_target);
        found->translation = add(rotate(back.rotation, from_source.translation), back.translation);
        found->rotation = multiply(back.rotation, from_source.rotation);
    }
    found->rotation = normal(found->rotation);
    return true;
}

#endif
