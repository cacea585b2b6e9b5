// One frame on a GPU: the body of frame_native in cuda.py, which fills in @NAMES and includes.
// GRID is 1 for many blocks, 0 for one.
#if defined(__CUDA_ARCH__)

// -- what substep.h takes ---------------------------------------------------------------------
typedef float real;
typedef float4 Body;
typedef float4 Vector;
#define FOR_LANES(mask, i) for (int i = 0; i < 1; ++i) if (mask)
#define LANE(v, i) v
auto larger = [](float a, float b) { return fmaxf(a, b); };
auto divided = [](float a, float b) { return __fdividef(a, b); };
auto per_root = [](float a, float b) { return a * rsqrtf(b); };
auto shortfall = [](float squared, float rest, float total) {
    const float inverse_length = rsqrtf(squared);
    float length = squared * inverse_length;
    length += 0.5f * inverse_length * (squared - length * length);
    return __fdividef(rest - length, total) * inverse_length;
};
auto plus = [](float4 a, float s, float4 b) {
    return make_float4(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z, a.w);
};
auto times = [](float s, float4 a) { return make_float4(s * a.x, s * a.y, s * a.z, a.w); };
auto cosine = [](float half_turns) { return cospif(half_turns); };
auto sine = [](float half_turns) { return sinpif(half_turns); };
float* const previous = reinterpret_cast<float*>(scratch.previous.data);
// What another thread may have written: another block's writes are in L2 alone.
#if @GRID
auto seen = [](auto* p) { return __ldcg(p); };
#else
auto seen = [](auto* p) { return *p; };
#endif
auto before = [&](int i) {
    const float* const d = previous + 3 * i;
    if (has_contacts) return make_float4(seen(d), seen(d + 1), seen(d + 2), 0.0f);
    return make_float4(d[0], d[1], d[2], 0.0f);
};
auto keep_before = [&](int i, float4 d) {
    previous[3 * i] = d.x; previous[3 * i + 1] = d.y; previous[3 * i + 2] = d.z;
};
#include "substep.h"

// -- where positions are, and how threads wait for each other ---------------------------------
// A vertex's delta and inverse mass lie together: one load of 16 bytes.
constexpr int threads = @THREADS;
#if @GRID
const int rank = blockIdx.x, rank_bits = 31 - __clz(gridDim.x);
const int first_vertex = blockIdx.x * threads + threadIdx.x;
const int vertex_step = gridDim.x * threads;
float4* const bodies = reinterpret_cast<float4*>(scratch.bodies.data);
unsigned* const counter = reinterpret_cast<unsigned*>(scratch.arrivals.data);
unsigned goal = 0;
#define SLOT(i) (i)
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
__shared__ float4 bodies[@SHARED_VERTICES];
const int rank = 0, rank_bits = 0;
const int first_vertex = threadIdx.x, vertex_step = threads;
#define SLOT(i) scratch.slots.data[i]
auto get = [&](int i) { return bodies[i]; };
auto put = [&](int i, float4 b) { bodies[i] = b; };
auto arrive = [&]() {};
auto wait = [&]() { __syncthreads(); };
#endif
auto body_of = [&](int i) { return get(SLOT(i)); };
auto put_body = [&](int i, float4 d) { put(SLOT(i), d); };
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
__shared__ int2 ranges[@MOST_COLORS];
for (int c = threadIdx.x; c < color_count; c += threads) {
    const int* const offset = c < edge_colors ? frame.edges.offsets.data + c
                                              : frame.volumes.offsets.data + (c - edge_colors);
    const int part = (offset[1] - offset[0] + (1 << rank_bits) - 1) >> rank_bits;
    ranges[c] = make_int2(min(offset[0] + rank * part, offset[1]),
                          min(offset[0] + (rank + 1) * part, offset[1]));
}

// -- constraints ------------------------------------------------------------------------------
const int tet_room = frame.volumes.vertices.shape[0];
const int2* const edge_slots = reinterpret_cast<const int2*>(scratch.edge_slots.data);
const int4* const tet_slots = reinterpret_cast<const int4*>(scratch.tet_slots.data);
const float4* const edge_spans = reinterpret_cast<const float4*>(scratch.edge_spans.data);
const float4* const tet_spans = reinterpret_cast<const float4*>(scratch.tet_spans.data);

auto project_edge_at = [&](int k, int first, int second, float4 span, float regularization) {
    if (first < 0) return;  // not used
    float4 p = get(first), q = get(second);
    project_edge(p, q, span.x, span.y, span.z, span.w, regularization, frame.edges.ids.data + k);
    put(first, p);
    put(second, q);
};
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

// While a thread waits at the barrier, it loads its first two edges (or its first tet) of the
// color after the next.  It loads its further edges and tets of that color when it gets there.
struct Ahead { int4 id; float4 a, b, c; int k, end; };
auto load_edges = [&](Ahead& s) {
    if (s.k < s.end) {
        const int2 e = __ldcg(edge_slots + s.k);
        s.id.x = e.x; s.id.y = e.y;
        s.a = __ldcg(edge_spans + s.k);
        s.c.x = __ldcg(frame.edges.regularization.data + s.k);
    }
    const int k = s.k + threads;
    if (k < s.end) {
        const int2 e = __ldcg(edge_slots + k);
        s.id.z = e.x; s.id.w = e.y;
        s.b = __ldcg(edge_spans + k);
        s.c.y = __ldcg(frame.edges.regularization.data + k);
    }
};
auto load_tet = [&](Ahead& s) {
    if (s.k < s.end) {
        s.id = __ldcg(tet_slots + s.k);
        s.a = __ldcg(tet_spans + s.k);
        s.b = __ldcg(tet_spans + tet_room + s.k);
        s.c = __ldcg(tet_spans + 2 * tet_room + s.k);
    }
};
auto load = [&](Ahead& s, int c) {
    const int2 range = c < color_count ? ranges[c] : make_int2(0, 0);
    s.k = range.x + threadIdx.x;
    s.end = range.y;
    if (c < edge_colors) load_edges(s);
    else load_tet(s);
};
auto project = [&](Ahead& s, int c) {
    if (c < edge_colors) {
        while (s.k < s.end) {
            project_edge_at(s.k, s.id.x, s.id.y, s.a, s.c.x);
            if (s.k + threads < s.end)
                project_edge_at(s.k + threads, s.id.z, s.id.w, s.b, s.c.y);
            s.k += 2 * threads;
            load_edges(s);
        }
    } else {
        while (s.k < s.end) {
            project_tet_at(s.id, s.a, s.b, s.c);
            s.k += threads;
            load_tet(s);
        }
    }
    arrive();
    load(s, c + 2);
    wait();
};

// -- the frame --------------------------------------------------------------------------------
for (int i = first_vertex; i < vertex_count; i += vertex_step) put(SLOT(i), first_prediction(i));
__syncthreads();  // ranges
arrive();
wait();
Ahead even, odd;
load(even, 0);
load(odd, 1);
for (int substep = 0; substep < substep_count; ++substep) {
    for (int c = 0; c < color_count; c += 2) {
        project(even, c);
        if (c + 1 < color_count) project(odd, c + 1);
    }
    if (has_contacts) {
        if (has_springs) {
            for (int i = first_vertex; i < vertex_count; i += vertex_step) {
                float4 d = get(SLOT(i));
                pull(i, substep, d);
                put(SLOT(i), d);
            }
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
    load(even, 0);
    load(odd, 1);
    const bool over = substep + 1 == substep_count;
    for (int i = first_vertex; i < vertex_count; i += vertex_step) {
        float4 d = get(SLOT(i));
        const float4 v = finish(i, substep, d);
        if (!over) {
            put(SLOT(i), predict(i, substep + 1, d, v));
            continue;
        }
        store(i, d, v);
        const float moved = sqrtf(d.x * d.x + d.y * d.y + d.z * d.z);
        if (!(moved <= frame.motion.data[0]))  // a plain read spares most threads the atomic
            atomicMax(reinterpret_cast<int*>(frame.motion.data),
                      moved == moved ? __float_as_int(moved) : 0x7f800000);  // infinity
    }
    if (!over) {
        arrive();
        wait();
    }
}
#endif
