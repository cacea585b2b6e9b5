// One frame on a CPU: the body of frame_native in cpu.py, which fills in @NAMES and includes.
#if !defined(__CUDA_ARCH__)
typedef float f4 __attribute__((ext_vector_type(4)));
typedef float f8 __attribute__((ext_vector_type(8)));
typedef int i8 __attribute__((ext_vector_type(8)));
struct Eight { f8 x, y, z, w; };

// -- what substep.h takes ---------------------------------------------------------------------
typedef f8 real;
typedef Eight Body;
typedef f4 Vector;
auto any = [](i8 mask) { return __builtin_reduce_or(mask) != 0; };
#define FOR_LANES(mask, i) \
    if (any(mask)) \
        for (int i = 0; i < 8; ++i) \
            if ((mask)[i])
#define LANE(v, i) v[i]
auto larger = [](f8 a, f8 b) { return __builtin_elementwise_max(a, b); };
auto divided = [](f8 a, f8 b) { return a / b; };
auto per_root = [](auto a, float b) { return a / sqrt(b); };
auto shortfall = [](f8 squared, f8 rest, f8 total) {
    const f8 length = __builtin_elementwise_sqrt(squared);
    return (rest - length) / (total * length);
};
auto two = [](f4 a, f4 b) { return __builtin_shufflevector(a, b, 0, 1, 2, 3, 4, 5, 6, 7); };
auto plus = [](auto a, float s, auto b) {
    if constexpr (sizeof(a) == sizeof(f4)) a.xyz += s * b.xyz;
    else a += s * b;  // w of b is 0
    return a;
};
auto for_each = [&](f4 a, auto v) {
    if constexpr (sizeof(v) == sizeof(f4)) return a;
    else return two(a, a);
};
auto times = [](float s, f4 a) { a.xyz *= s; return a; };
auto cosine = [](float half_turns) { return cos(half_turns * 3.1415927f); };
auto sine = [](float half_turns) { return sin(half_turns * 3.1415927f); };
f4* const bodies = reinterpret_cast<f4*>(scratch.bodies.data);
f4* const previous = reinterpret_cast<f4*>(scratch.previous.data);
f4* const momentary = reinterpret_cast<f4*>(scratch.velocities.data);
const int* const slots = scratch.slots.data;
#include "substep.h"
auto body_of = [&](int i) { return bodies[slots[i]]; };
auto put_body = [&](int i, f4 d) { bodies[slots[i]] = d; };
auto before = [&](int i) { return previous[slots[i]]; };
auto keep_before = [&](int i, f4 d) { previous[slots[i]] = d; };
auto velocity_of = [&](int i) { return momentary[slots[i]]; };
auto put_velocity = [&](int i, f4 v) { momentary[slots[i]] = v; };
auto kept_of = [&](int slot) { return Kept{previous[slot], momentary[slot]}; };
auto seen = [](auto* p) { return *p; };
auto seen_four = [](const float* p) { return *reinterpret_cast<const f4*>(p); };
auto summed = [](f4 v) { return v; };
auto add_load = [&](int i, int n) {
    __atomic_fetch_add(frame.contacts.loads.data + i, n, __ATOMIC_RELAXED);
};
#include "contact.h"

// -- threads ----------------------------------------------------------------------------------
#if defined(__linux__)
int yield_now(void) __asm__("sched_yield");
#endif
// Each thread counts how far it has come in a cache line of its own, which the others read.
int* const arrivals = scratch.arrivals.data;
int arrived = 0;
auto post = [&]() {
    ++arrived;
    if (thread_count > 1)
        __atomic_store_n(arrivals + @LINE * thread, arrived, __ATOMIC_RELEASE);
};
auto wait_for = [&](int other) {
    for (int looks = 0;
         __atomic_load_n(arrivals + @LINE * other, __ATOMIC_ACQUIRE) < arrived; ++looks) {
#if defined(__linux__)
        if (looks > 2000) yield_now();  // another thread may need this core, even one of ours
#endif
#if defined(__x86_64__)
        __builtin_ia32_pause();
#elif defined(__aarch64__)
        asm volatile("yield");
#endif
    }
};
auto meet = [&]() {
    post();
    for (int other = 0; other < thread_count; ++other)
        if (other != thread) wait_for(other);
};
// Where a thread's part of a range begins, in whole groups of lanes.
auto part = [&](int first, int last, int thread_id) {
    const long groups = (last - first + 7) / 8;
    const int begin = first + 8 * (int)(groups * thread_id / thread_count);
    return begin < last ? begin : last;
};
// Does something with this thread's vertices: f(i, its slot).
const int* const halves = scratch.halves.data;
const bool has_halves = halves[4] > 0;
// The compiler may round differently in each place that it copies `f` to, so there is one place
// for any number of threads; likewise below.
auto each_slot = [&](int slot, int last, auto f) {
    for (; slot < last; ++slot) f(scratch.order.data[slot], slot);
};
const bool in_halves = has_halves && thread_count > 1, has_half = in_halves && thread < 2;
auto each_vertex = [&](auto f) {
    int first = part(0, vertex_count, thread), last = part(0, vertex_count, thread + 1);
    if (in_halves) {
        first = has_half ? halves[2 * thread] : 0;
        last = has_half ? halves[2 * thread + 2] : 0;
    }
    each_slot(first, last, f);
};

// -- eight vertices to lanes and back ---------------------------------------------------------
auto gather = [&](const int* id) {
#define ROW(i) bodies[id[i]]
#define PAIR(i) __builtin_shufflevector(ROW(i), ROW(i + 4), 0, 1, 2, 3, 4, 5, 6, 7)
    const f8 a = PAIR(0), b = PAIR(1), c = PAIR(2), d = PAIR(3);
    const f8 ab = __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13);
    const f8 cd = __builtin_shufflevector(c, d, 0, 8, 1, 9, 4, 12, 5, 13);
    const f8 AB = __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15);
    const f8 CD = __builtin_shufflevector(c, d, 2, 10, 3, 11, 6, 14, 7, 15);
    return Eight{__builtin_shufflevector(ab, cd, 0, 1, 8, 9, 4, 5, 12, 13),
                 __builtin_shufflevector(ab, cd, 2, 3, 10, 11, 6, 7, 14, 15),
                 __builtin_shufflevector(AB, CD, 0, 1, 8, 9, 4, 5, 12, 13),
                 __builtin_shufflevector(AB, CD, 2, 3, 10, 11, 6, 7, 14, 15)};
};
auto scatter = [&](const int* id, const Eight& p) {
    const f8 xy = __builtin_shufflevector(p.x, p.y, 0, 8, 1, 9, 4, 12, 5, 13);
    const f8 XY = __builtin_shufflevector(p.x, p.y, 2, 10, 3, 11, 6, 14, 7, 15);
    const f8 zw = __builtin_shufflevector(p.z, p.w, 0, 8, 1, 9, 4, 12, 5, 13);
    const f8 ZW = __builtin_shufflevector(p.z, p.w, 2, 10, 3, 11, 6, 14, 7, 15);
    const f8 row[4] = {__builtin_shufflevector(xy, zw, 0, 1, 8, 9, 4, 5, 12, 13),
                       __builtin_shufflevector(xy, zw, 2, 3, 10, 11, 6, 7, 14, 15),
                       __builtin_shufflevector(XY, ZW, 0, 1, 8, 9, 4, 5, 12, 13),
                       __builtin_shufflevector(XY, ZW, 2, 3, 10, 11, 6, 7, 14, 15)};
    for (int i = 0; i < 4; ++i) {
        bodies[id[i]] = row[i].lo;
        bodies[id[i + 4]] = row[i].hi;
    }
};
auto load = [&](const float* from) {
    f8 v;
    __builtin_memcpy(&v, from, 32);
    return v;
};

// -- eight constraints at once ----------------------------------------------------------------
const int edge_space = frame.edges.vertices.shape[0], tet_space = frame.volumes.vertices.shape[0];
float* const edge_span = scratch.spans.data;
float* const tet_span = edge_span + 3 * edge_space;
int* const edge_lanes = scratch.lanes.data;  // the vertices of eight constraints, by corner
int* const tet_lanes = edge_lanes + 2 * edge_space;

auto project_edges = [&](int k) {
    const int* const id = edge_lanes + 2 * k;
    Eight p = gather(id), q = gather(id + 8);
    const f8 rest = load(frame.edges.rest_values.data + k);
    EdgeMove move = edge_move(p, q, load(edge_span + k), load(edge_span + edge_space + k),
                              load(edge_span + 2 * edge_space + k), rest,
                              load(frame.edges.regularization.data + k));
    open_collapsed(move, rest, frame.edges.ids.data + k);
    move_ends(move, p, q);
    scatter(id, p);
    scatter(id + 8, q);
};
auto project_tets = [&](int k) {
    const int* const id = tet_lanes + 4 * k;
    Eight p0 = gather(id), p1 = gather(id + 8), p2 = gather(id + 16), p3 = gather(id + 24);
    f8 span[9];
    for (int j = 0; j < 9; ++j) span[j] = load(tet_span + j * tet_space + k);
    project_tet(p0, p1, p2, p3, span, load(frame.volumes.rest_values.data + k),
                load(frame.volumes.regularization.data + k));
    scatter(id, p0);
    scatter(id + 8, p1);
    scatter(id + 16, p2);
    scatter(id + 24, p3);
};
// The vertices of constraint k by corner, and their differences from the base corner.
auto begin = [&](const int* corners, int corner_count, int base, int space, int* lanes,
                 float* spans, int k) {
    const int* const id = corners + corner_count * k;
    for (int j = 0; j < corner_count; ++j)
        lanes[corner_count * (k - k % 8) + 8 * j + k % 8] = slots[id[j]];
    if (id[0] == vertex_count) return;  // not used
    int row = 0;
    for (int i = 0; i < corner_count; ++i)
        for (int j = 0; j < 3 && i != base; ++j)
            spans[row++ * space + k] = x[3 * id[i] + j] - x[3 * id[base] + j];
};

// All constraints of a list, eight at a time.
auto project_all = [&](const auto& list, auto project) {
    for (int c = 0; c < list.color_count.data[0]; ++c) {
        const int first = list.offsets.data[c], last = list.offsets.data[c + 1];
        int begins[3] = {part(first, last, thread), 0, 0};
        int ends[3] = {part(first, last, thread + 1), 0, 0};
        if (in_halves) {
            // Near ones come in the middle: until then the other thread has done those of before.
            const int* const section = list.sections.data + 4 * c;
            const int one = section[3 * (thread & 1)], other = section[3 * (thread & 1) + 1];
            const int middle = one + 8 * ((other - one) / 16);
            const int near = section[(thread & 1) + 1], behind = section[(thread & 1) + 2];
            const int from[3] = {one, near, middle}, to[3] = {middle, behind, other};
            for (int i = 0; i < 3; ++i) {
                begins[i] = has_half ? from[i] : 0;
                ends[i] = has_half ? to[i] : 0;
            }
        }
        for (int i = 0; i < 3; ++i) {
            if (i == 1 && has_half) wait_for(1 - thread);
            for (int k = begins[i]; k < ends[i]; k += 8) project(k);
            if (i == 1 && in_halves) post();
        }
        if (!in_halves) meet();
    }
};

// -- the frame --------------------------------------------------------------------------------
auto count_of = [](const auto& list) { return list.offsets.data[list.color_count.data[0]]; };
const int edge_count = count_of(frame.edges), tet_count = count_of(frame.volumes);
for (int k = part(0, edge_count, thread), last = part(0, edge_count, thread + 1); k < last; ++k)
    begin(frame.edges.vertices.data, 2, 1, edge_space, edge_lanes, edge_span, k);
if (has_volumes)
    for (int k = part(0, tet_count, thread), last = part(0, tet_count, thread + 1); k < last; ++k)
        begin(frame.volumes.vertices.data, 4, 0, tet_space, tet_lanes, tet_span, k);
each_vertex([&](int i, int slot) { bodies[slot] = first_prediction(Full(), i, kept_of(slot)); });
float farthest = 0.0f;
meet();
for (int substep = 0; substep < substep_count; ++substep) {
    project_all(frame.edges, project_edges);
    if (has_volumes) project_all(frame.volumes, project_tets);
    if (has_contacts) {
        if (in_halves) meet();  // contacts join any vertices
        if (has_springs || extrapolates) {
            each_vertex([&](int i, int slot) {
                before_contacts(i, substep, bodies[slot], kept_of(slot));
            });
            meet();
        }
        const int first = part(0, contact_count, thread), last = part(0, contact_count, thread + 1);
        for (int k = first; k < last; ++k) look_at_contact(k);
        meet();
        for (int k = first; k < last; ++k) push_contact(k, substep);
        meet();
        const int touched = part(0, touched_count, thread);
        for (int k = touched; k < part(0, touched_count, thread + 1); ++k) take_contacts(k, 0, 1);
        meet();
    }
    const bool over = substep + 1 == substep_count;
    auto end_substep = [&](int i, int slot) {
        f4 d = bodies[slot];
        const f4 v = finish(Full(), i, substep, d, kept_of(slot));
        if (!over) {
            bodies[slot] = predict(Full(), i, substep + 1, d, v, kept_of(slot));
            return;
        }
        const float moved = d.x * d.x + d.y * d.y + d.z * d.z;
        farthest = moved <= farthest ? farthest : moved == moved ? moved : __builtin_inff();
        store(i, d, v);
    };
    // The same of vertices that only move, two at once; the last of an odd number twice.
    auto end_two = [&](int slot, int other) {
        const f8 d = two(bodies[slot], bodies[other]), from = two(previous[slot], previous[other]);
        const f8 way = d - from, now = from + per_theta * way;
        f8 v = begun(ended(two(momentary[slot], momentary[other]), way), decay);
        const f8 of_axes = v * v;
        const float squared[2] = {of_axes[0] + of_axes[1] + of_axes[2],
                                  of_axes[4] + of_axes[5] + of_axes[6]};
        if (squared[0] > limit * limit) v.lo = times(limit / sqrt(squared[0]), v.lo);
        if (squared[1] > limit * limit) v.hi = times(limit / sqrt(squared[1]), v.hi);
        const f8 next = plus(now, reach, v);
        auto put = [&](int slot, f4 d, f4 v, f4 now, f4 next) {
            if (d.w > 0.0f) momentary[slot] = v, previous[slot] = now, bodies[slot] = next;
            else bodies[slot] = predict(Full(), 0, substep + 1, d, v, kept_of(slot));
        };
        put(slot, d.lo, v.lo, now.lo, next.lo);
        if (other != slot) put(other, d.hi, v.hi, now.hi, next.hi);
    };
    const bool twos = extrapolates && only_move && !over;
    int begins[2] = {part(0, vertex_count, thread), 0};
    int ends[2] = {part(0, vertex_count, thread + 1), 0};
    if (in_halves) {  // those that no near constraint touches first
        const int half = thread & 1;
        begins[0] = has_half ? halves[3 * half] : 0;
        ends[0] = has_half ? halves[3 * half + 1] : 0;
        begins[1] = has_half ? halves[half + 1] : 0;
        ends[1] = has_half ? halves[half + 2] : 0;
    }
    for (int i = 0; i < 2; ++i) {
        if (i == 1 && has_half) wait_for(1 - thread);
        if (!twos) each_slot(begins[i], ends[i], end_substep);
        for (int slot = begins[i]; twos && slot < ends[i]; slot += 2)
            end_two(slot, slot + 1 < ends[i] ? slot + 1 : slot);
    }
    if (in_halves) post();
    else if (!over) meet();
}
frame.motion.data[thread] = sqrt(farthest);
for (int other = thread_count; other < frame.motion.shape[0]; ++other)
    frame.motion.data[other] = 0.0f;  // of threads that took part before
#endif
