// One frame on a GPU: the body of frame_native in cuda.py, which fills in @NAMES and includes.
// GRID is 1 for many blocks, 0 for one.
#if defined(__CUDA_ARCH__)

// -- what substep.h takes ---------------------------------------------------------------------
typedef float real;
typedef float4 Body;
typedef float4 Vector;
#define FOR_LANES(mask, i) if (__builtin_expect(mask, 0)) for (int i = 0; i < 1; ++i)
#define LANE(v, i) v
auto larger = [](float a, float b) { return fmaxf(a, b); };
// Without the steps that CUDA's functions take for the smallest numbers.
auto inverse = [](float a) {
    float b;
    asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(b) : "f"(a));
    return b;
};
auto inverse_root = [](float a) {
    float b;
    asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(b) : "f"(a));
    return b;
};
auto divided = [&](float a, float b) { return a * inverse(b); };
auto per_root = [&](float a, float b) { return a * inverse_root(b); };
auto shortfall = [&](float squared, float rest, float total) {
    const float inverse_length = inverse_root(squared);
    float length = squared * inverse_length;
    length += 0.5f * inverse_length * (squared - length * length);
    return (rest - length) * inverse(total) * inverse_length;
};
auto plus = [](float4 a, float s, float4 b) {
    return make_float4(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z, a.w);
};
auto for_each = [](float4 a, float4) { return a; };
auto times = [](float s, float4 a) { return make_float4(s * a.x, s * a.y, s * a.z, a.w); };
auto cosine = [](float half_turns) { return cospif(half_turns); };
auto sine = [](float half_turns) { return sinpif(half_turns); };
#include "substep.h"

// -- where positions are, and how threads wait for each other ---------------------------------
// A vertex's delta and inverse mass lie together: one load of 16 bytes.

// What another thread may have written: another block's writes are in L2 alone.
#if @GRID
auto seen = [](auto* p) { return __ldcg(p); };
#else
auto seen = [](auto* p) { return *p; };
#endif
float* const previous = reinterpret_cast<float*>(scratch.previous.data);
auto before = [&](int i) {
    const float* const d = previous + 3 * i;
    if (has_contacts) return make_float4(seen(d), seen(d + 1), seen(d + 2), 0.0f);
    return make_float4(d[0], d[1], d[2], 0.0f);
};
auto keep_before = [&](int i, float4 d) {
    previous[3 * i] = d.x; previous[3 * i + 1] = d.y; previous[3 * i + 2] = d.z;
};
float* const momentary = reinterpret_cast<float*>(scratch.velocities.data);
auto velocity_of = [&](int i) {
    const float* const v = momentary + 3 * i;
    if (has_contacts) return make_float4(seen(v), seen(v + 1), seen(v + 2), 0.0f);
    return make_float4(v[0], v[1], v[2], 0.0f);
};
auto put_velocity = [&](int i, float4 v) {
    momentary[3 * i] = v.x; momentary[3 * i + 1] = v.y; momentary[3 * i + 2] = v.z;
};
constexpr int threads = @THREADS;
#if @GRID
const int rank = blockIdx.x, rank_bits = 31 - __clz(gridDim.x);
const int first_vertex = blockIdx.x * threads + threadIdx.x;
const int vertex_step = gridDim.x * threads;
float4* const bodies = reinterpret_cast<float4*>(scratch.bodies.data);
unsigned* const counter = reinterpret_cast<unsigned*>(scratch.arrivals.data);
unsigned goal = 0;
auto slot_of = [&](int i) { return i; };
auto get = [&](int i) { return __ldcg(bodies + i); };
auto put = [&](int i, float4 b) { __stcg(bodies + i, b); };
// The counter only grows and gridDim.x is a power of two, so wrapping around is harmless,
// and blocks that have arrived already don't change what the others begin with.
if (threadIdx.x == 0) goal = __ldcg(counter) & ~(gridDim.x - 1u);
auto arrive = [&]() {
    __syncthreads();
    if (threadIdx.x == 0) {
        goal += gridDim.x;
        asm volatile("red.add.release.gpu.u32 [%0], 1;" :: "l"(counter) : "memory");
    }
};
auto wait = [&]() {
    if (threadIdx.x == 0) {
        unsigned now;
        do {
            asm volatile("ld.acquire.gpu.u32 %0, [%1];" : "=r"(now) : "l"(counter) : "memory");
        } while ((int)(now - goal) < 0);
    }
    __syncthreads();
};
#else
__shared__ float4 bodies[@SHARED_VERTICES + 1];  // the last is of entries that aren't in use
const int rank = 0, rank_bits = 0;
// The compiler would work out the address of shared memory anew at each access.
unsigned window;
asm volatile("{ .reg .u64 a; cvta.to.shared.u64 a, %1; cvt.u32.u64 %0, a; }"
             : "=r"(window) : "l"(bodies));
auto get_at = [&](unsigned address) {
    float4 b;
    asm volatile("ld.shared.v4.f32 {%0, %1, %2, %3}, [%4];"
                 : "=f"(b.x), "=f"(b.y), "=f"(b.z), "=f"(b.w) : "r"(address) : "memory");
    return b;
};
auto put_at = [&](unsigned address, float4 b) {
    asm volatile("st.shared.v4.f32 [%0], {%1, %2, %3, %4};"
                 :: "r"(address), "f"(b.x), "f"(b.y), "f"(b.z), "f"(b.w) : "memory");
};
const int first_vertex = threadIdx.x, vertex_step = threads;
auto slot_of = [&](int i) { return scratch.slots.data[i]; };
auto get = [&](int i) { return get_at(window + 16 * i); };
auto put = [&](int i, float4 b) { put_at(window + 16 * i, b); };
auto arrive = [&]() {};
auto wait = [&]() { __syncthreads(); };
#endif
// Does something with vertices: f(Moving() or Full(), i, slot, what is kept of vertex i).
#if !@GRID
// Where vertices only move, a thread has in registers what is kept of its own.
float4 deltas[@THREAD_VERTICES], velocities[@THREAD_VERTICES];
int slots[@THREAD_VERTICES];
#pragma unroll
for (int n = 0; n < @THREAD_VERTICES; ++n) {
    const int i = first_vertex + n * vertex_step;
    slots[n] = i < vertex_count ? slot_of(i) : 0;
}
#endif
auto each_vertex = [&](auto f) {
#if !@GRID
    if (only_move) {
#pragma unroll
        for (int n = 0; n < @THREAD_VERTICES; ++n) {
            const int i = first_vertex + n * vertex_step;
            if (i < vertex_count) f(Moving(), i, slots[n], Kept{deltas[n], velocities[n]});
        }
        return;
    }
#endif
    for (int i = first_vertex; i < vertex_count; i += vertex_step) {
        float4 delta = before(i), v = delta;
        if (extrapolates) v = velocity_of(i);
        f(Full(), i, slot_of(i), Kept{delta, v});
        keep_before(i, delta);
        if (extrapolates) put_velocity(i, v);
    }
};
auto body_of = [&](int i) { return get(slot_of(i)); };
auto put_body = [&](int i, float4 d) { put(slot_of(i), d); };
auto seen_four = [&](const float* p) { return seen(reinterpret_cast<const float4*>(p)); };
auto summed = [](float4 v) {
    const unsigned lanes = 0xffu << (threadIdx.x & 24);
    for (int other = 4; other > 0; other /= 2) {
        v.x += __shfl_xor_sync(lanes, v.x, other);
        v.y += __shfl_xor_sync(lanes, v.y, other);
        v.z += __shfl_xor_sync(lanes, v.z, other);
    }
    return v;
};
auto add_load = [&](int i, int n) { atomicAdd(frame.contacts.loads.data + i, n); };
#include "contact.h"

// What this block does of each color; neighbors in the mesh are mostly in one part.
const int edge_colors = frame.edges.color_count.data[0];
const int tet_colors = has_volumes ? frame.volumes.color_count.data[0] : 0;
const int color_count = edge_colors + tet_colors;
__shared__ int2 ranges[@MOST_COLORS + 2];  // and two that are empty
for (int c = threadIdx.x; c < color_count; c += threads) {
    const int* const offset = c < edge_colors ? frame.edges.offsets.data + c
                                              : frame.volumes.offsets.data + (c - edge_colors);
    const int part = (offset[1] - offset[0] + (1 << rank_bits) - 1) >> rank_bits;
    ranges[c] = make_int2(min(offset[0] + rank * part, offset[1]),
                          min(offset[0] + (rank + 1) * part, offset[1]));
}
if (threadIdx.x < 2) ranges[color_count + threadIdx.x] = make_int2(0, 0);

// -- constraints ------------------------------------------------------------------------------
const int tet_space = frame.volumes.vertices.shape[0];
// In registers: the compiler would fetch them from the launch's arguments in every color.
__shared__ const void* volatile addresses[1];
auto held = [&](auto* p) {
    if (threadIdx.x == 0) addresses[0] = p;
    __syncthreads();
    const void* const same = addresses[0];
    __syncthreads();
    return static_cast<decltype(p)>(same);
};
const int2* const edge_slots = held(reinterpret_cast<const int2*>(scratch.edge_slots.data));
const int4* const tet_slots = held(reinterpret_cast<const int4*>(scratch.tet_slots.data));
const float4* const edge_spans = held(reinterpret_cast<const float4*>(scratch.edge_spans.data));
const float4* const tet_spans = held(reinterpret_cast<const float4*>(scratch.tet_spans.data));

#if @GRID
auto project_edge_at = [&](int k, int first, int second, float4 span, float regularization) {
    if (first < 0) return;  // not used
    float4 p = get(first), q = get(second);
    EdgeMove m = edge_move(p, q, span.x, span.y, span.z, span.w, regularization);
    open_collapsed(m, span.w, frame.edges.ids.data + k);
    move_ends(m, p, q);
    put(first, p);
    put(second, q);
};
auto project_edges = [&](int k, bool both, int4 id, float4 a, float4 b, float4 c, auto) {
    project_edge_at(k, id.x, id.y, a, c.x);
    if (both) project_edge_at(k + threads, id.z, id.w, b, c.y);
};
auto load_edge = [&](int k, int& first, int& second, float4& span, float& regularization) {
    const int2 e = __ldg(edge_slots + k);
    first = e.x; second = e.y;
    span = __ldg(edge_spans + k);
    regularization = __ldg(frame.edges.regularization.data + k);
};
#else
// An edge's slots and its a are in two numbers: where its ends are in shared memory, and a.
auto project_edges = [&](int k, bool both, int4 id, float4 a, float4 b, float4 c, auto meanwhile) {
    const unsigned first = window + (id.x & 0xffff), second = window + ((unsigned)id.x >> 16);
    const int* const ids = frame.edges.ids.data + k;
    float4 p = get_at(first), q = get_at(second);
    if (both) {
        const unsigned third = window + (id.z & 0xffff), fourth = window + ((unsigned)id.z >> 16);
        float4 r = get_at(third), s = get_at(fourth);
        meanwhile();
        EdgeMove m = edge_move(p, q, a.x, a.y, a.z, a.w, __int_as_float(id.y));
        EdgeMove n = edge_move(r, s, b.x, b.y, b.z, b.w, __int_as_float(id.w));
        if (__builtin_expect(m.collapsed || n.collapsed, 0)) {
            open_collapsed(m, a.w, ids);
            open_collapsed(n, b.w, ids + threads);
        }
        move_ends(m, p, q);
        move_ends(n, r, s);
        put_at(third, r);
        put_at(fourth, s);
    } else {
        meanwhile();
        EdgeMove m = edge_move(p, q, a.x, a.y, a.z, a.w, __int_as_float(id.y));
        open_collapsed(m, a.w, ids);
        move_ends(m, p, q);
    }
    put_at(first, p);
    put_at(second, q);
};
auto load_edge = [&](int k, int& slots, int& bits, float4& span, float&) {
    const int2 e = __ldg(edge_slots + k);
    slots = e.x; bits = e.y;
    span = __ldg(edge_spans + k);
};
#endif
auto project_tet_at = [&](int4 t, float4 a, float4 b, float4 c) {
    if (t.x < 0) return;  // not used
    float4 p0 = get(t.x), p1 = get(t.y), p2 = get(t.z), p3 = get(t.w);
    const float span[9] = {a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z};
    project_tet(p0, p1, p2, p3, span, a.w, b.w);
    put(t.x, p0);
    put(t.y, p1);
    put(t.z, p2);
    put(t.w, p3);
};

// Ahead of a color, a thread loads its first two edges (or its first tet) of it, and its further
// ones when it gets there.  Nothing writes them during the frame, so L1 may keep them (__ldg).
struct Ahead { int4 id; float4 a, b, c; int k, end; };
auto load_edges = [&](Ahead& s) {
    if (s.k < s.end) load_edge(s.k, s.id.x, s.id.y, s.a, s.c.x);
    if (s.k + threads < s.end) load_edge(s.k + threads, s.id.z, s.id.w, s.b, s.c.y);
};
auto load_tet = [&](Ahead& s) {
    if (s.k < s.end) {
        s.id = __ldg(tet_slots + s.k);
        s.a = __ldg(tet_spans + s.k);
        s.b = __ldg(tet_spans + tet_space + s.k);
        s.c = __ldg(tet_spans + 2 * tet_space + s.k);
    }
};
int2 range = {0, 0};  // of the color that is loaded next
auto load = [&](Ahead& s, int c) {
    s.k = range.x + threadIdx.x;
    s.end = range.y;
    if (c < edge_colors) load_edges(s);
    else load_tet(s);
    range = ranges[min(c + 1, color_count)];
};
// Projects what a thread has of color c; `meanwhile` runs while positions are on their way.
auto nothing = []() {};
auto project = [&](Ahead& s, int c, auto meanwhile) {
    if (c < edge_colors && s.k < s.end) {
        project_edges(s.k, s.k + threads < s.end, s.id, s.a, s.b, s.c, meanwhile);
        for (s.k += 2 * threads; s.k < s.end; s.k += 2 * threads) {
            load_edges(s);
            project_edges(s.k, s.k + threads < s.end, s.id, s.a, s.b, s.c, nothing);
        }
        return;
    }
    meanwhile();
    while (s.k < s.end) {
        project_tet_at(s.id, s.a, s.b, s.c);
        s.k += threads;
        load_tet(s);
    }
};
// A block loads the next color while it waits for positions; a grid, which waits longer at its
// barriers, loads the color after the next there.
#if @GRID
auto pass = [&](Ahead& s, Ahead&, int c) {
    project(s, c, nothing);
    arrive();
    load(s, c + 2);
    wait();
};
#else
auto pass = [&](Ahead& s, Ahead& other, int c) {
    project(s, c, [&]() { load(other, c + 1); });
    wait();
};
#endif
auto load_first = [&](Ahead& even, Ahead& odd) {
    range = ranges[0];
    load(even, 0);
    if (@GRID) load(odd, 1);
};

// -- the frame --------------------------------------------------------------------------------
each_vertex([&](auto moving, int i, int slot, Kept kept) {
    put(slot, first_prediction(moving, i, kept));
});
#if !@GRID
if (threadIdx.x == 0) bodies[@SHARED_VERTICES] = make_float4(0.0f, 0.0f, 0.0f, 0.0f);
#endif
__syncthreads();  // ranges
arrive();
wait();
Ahead even, odd;
load_first(even, odd);
for (int substep = 0; substep < substep_count; ++substep) {
    for (int c = 0; c < color_count; c += 2) {
        pass(even, odd, c);
        if (c + 1 < color_count) pass(odd, even, c + 1);
    }
    if (has_contacts) {
        if (has_springs || extrapolates) {
            each_vertex([&](auto, int i, int slot, Kept kept) {
                float4 d = get(slot);
                before_contacts(i, substep, d, kept);
                put(slot, d);
            });
            arrive();
            wait();
        }
        for (int k = first_vertex; k < contact_count; k += vertex_step) look_at_contact(k);
        arrive();
        wait();
        for (int k = first_vertex; k < contact_count; k += vertex_step) push_contact(k, substep);
        arrive();
        wait();
        for (int k = first_vertex / 8; k < touched_count; k += vertex_step / 8)
            take_contacts(k, threadIdx.x % 8, 8);
        arrive();
        wait();
    }
    load_first(even, odd);
    const bool over = substep + 1 == substep_count;
    each_vertex([&](auto moving, int i, int slot, Kept kept) {
        float4 d = get(slot);
        const float4 v = finish(moving, i, substep, d, kept);
        if (!over) {
            put(slot, predict(moving, i, substep + 1, d, v, kept));
            return;
        }
        store(i, d, v);
        const float moved = sqrtf(d.x * d.x + d.y * d.y + d.z * d.z);
        if (!(moved <= frame.motion.data[0]))  // a plain read spares most threads the atomic
            atomicMax(reinterpret_cast<int*>(frame.motion.data),
                      moved == moved ? __float_as_int(moved) : 0x7f800000);  // infinity
    });
    if (!over) {
        arrive();
        wait();
    }
}
#endif
