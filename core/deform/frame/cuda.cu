// One frame on a GPU: the body of frame_native in frame_cuda.py, whose text this is.
// @NAMES are filled in there; GRID is 1 for many blocks, 0 for one.
#if defined(__CUDA_ARCH__)
const int vertex_count = frame.vertex_count, edge_colors = frame.edge_color_count;

// -- where positions are, and how threads wait for each other -------------------------------
// Position and inverse mass of a vertex lie together: one load of 16 bytes.
#if @GRID
const int rank = blockIdx.x, rank_bits = 31 - __clz(gridDim.x);
const int first_vertex = blockIdx.x * @THREADS + threadIdx.x;
const int vertex_step = gridDim.x * @THREADS;
float4* const global_bodies = reinterpret_cast<float4*>(bodies.data);
unsigned* const counter = reinterpret_cast<unsigned*>(arrivals.data);
unsigned goal = 0;
#define SLOT(i) (i)
auto get = [&](int i) { return __ldcg(global_bodies + i); };
auto put = [&](int i, float4 b) { __stcg(global_bodies + i, b); };
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
__shared__ float4 shared_bodies[@SHARED_VERTICES];
const int rank = 0, rank_bits = 0;
const int first_vertex = threadIdx.x, vertex_step = @THREADS;
#define SLOT(i) slots.data[i]
auto get = [&](int i) { return shared_bodies[i]; };
auto put = [&](int i, float4 b) { shared_bodies[i] = b; };
auto arrive = [&]() {};
auto wait = [&]() { __syncthreads(); };
#endif

const int tet_colors = has_volumes ? frame.tet_color_count : 0;
const int tet_room = frame.tet_room;
constexpr int threads = @THREADS;
// What this block does of each color; neighbors in the mesh are mostly in one part.
__shared__ int2 ranges[@MOST_COLORS];
for (int c = threadIdx.x; c < edge_colors + tet_colors; c += threads) {
    const int* const offset = c < edge_colors ? frame.edge_offsets.data + c
                                              : frame.tet_offsets.data + (c - edge_colors);
    const int part = (offset[1] - offset[0] + (1 << rank_bits) - 1) >> rank_bits;
    ranges[c] = make_int2(min(offset[0] + rank * part, offset[1]),
                          min(offset[0] + (rank + 1) * part, offset[1]));
}
const float* const timing = frame.timing.data;
const float h = timing[0], per_h = 1.0f / h, decay = timing[1], limit = timing[2];
const float gx = timing[3], gy = timing[4], gz = timing[5];
const int2* const edge_slot = reinterpret_cast<const int2*>(edge_slots.data);
const int4* const tet_slot = reinterpret_cast<const int4*>(tet_slots.data);
const float4* const edge_span = reinterpret_cast<const float4*>(edge_spans.data);
const float4* const tet_span = reinterpret_cast<const float4*>(tet_spans.data);
const float* const x = reinterpret_cast<const float*>(frame.vertices.data);
const float* const target = reinterpret_cast<const float*>(frame.targets.data);
const float* const anchor = reinterpret_cast<const float*>(frame.anchors.data);
float* const velocity = reinterpret_cast<float*>(frame.velocities.data);
float* const before = reinterpret_cast<float*>(previous.data);
float* const rest_delta = reinterpret_cast<float*>(frame.deltas.data);

auto predict = [&](int i, int substep, float dx, float dy, float dz, float w,
                   float vx, float vy, float vz) {
    if (w > 0.0f) {
        before[3 * i] = dx; before[3 * i + 1] = dy; before[3 * i + 2] = dz;
        vx = decay * vx + h * gx; vy = decay * vy + h * gy; vz = decay * vz + h * gz;
        const float squared = vx * vx + vy * vy + vz * vz;
        if (squared > limit * limit) {
            const float less = limit / sqrtf(squared);
            vx *= less; vy *= less; vz *= less;
        }
        dx += h * vx; dy += h * vy; dz += h * vz;
    } else {
        const float part = (substep + 1.0f) / substep_count;
        dx = part * (target[3 * i] - x[3 * i]);
        dy = part * (target[3 * i + 1] - x[3 * i + 1]);
        dz = part * (target[3 * i + 2] - x[3 * i + 2]);
    }
    put(SLOT(i), make_float4(dx, dy, dz, w));
};

auto project_edge = [&](int k, int2 e, float4 span, float a) {
    if (e.x < 0) return;  // not used
    float4 p = get(e.x), q = get(e.y);
    const float w = p.w + q.w;
    float ux = span.x + (p.x - q.x), uy = span.y + (p.y - q.y), uz = span.z + (p.z - q.z);
    const float squared = ux * ux + uy * uy + uz * uz;
    const float rest = span.w;
    float inverse_length = rsqrtf(squared);
    float length = squared * inverse_length;
    length += 0.5f * inverse_length * (squared - length * length);
    float along = __fdividef(rest - length, w + a) * inverse_length;
    if (!(squared > @COLLAPSED * @COLLAPSED * rest * rest)) {  // it has no direction of its own
        unsigned bits = (unsigned(frame.edge_ids.data[k]) + 1u) * 2654435761u;
        bits ^= bits >> 16;
        bits *= 2246822519u;
        bits ^= bits >> 13;
        uz = (bits & 0xFFFFu) / 32768.0f - 1.0f;
        const float turns = (bits >> 16) / 32768.0f;  // half ones
        const float ring = sqrtf(fmaxf(1.0f - uz * uz, 0.0f));
        ux = ring * cospif(turns);
        uy = ring * sinpif(turns);
        along = rest / (w + a);
    }
    const float mp = p.w * along, mq = q.w * along;
    p.x += mp * ux; p.y += mp * uy; p.z += mp * uz;
    q.x -= mq * ux; q.y -= mq * uy; q.z -= mq * uz;
    put(e.x, p);
    put(e.y, q);
};

auto project_tet = [&](int4 t, float4 s1, float4 s2, float4 s3) {
    if (t.x < 0) return;  // not used
    float4 p0 = get(t.x), p1 = get(t.y), p2 = get(t.z), p3 = get(t.w);
    const float ax = s1.x + (p1.x - p0.x), ay = s1.y + (p1.y - p0.y), az = s1.z + (p1.z - p0.z);
    const float bx = s2.x + (p2.x - p0.x), by = s2.y + (p2.y - p0.y), bz = s2.z + (p2.z - p0.z);
    const float cx = s3.x + (p3.x - p0.x), cy = s3.y + (p3.y - p0.y), cz = s3.z + (p3.z - p0.z);
    const float g1x = by * cz - bz * cy, g1y = bz * cx - bx * cz, g1z = bx * cy - by * cx;
    const float g2x = cy * az - cz * ay, g2y = cz * ax - cx * az, g2z = cx * ay - cy * ax;
    const float g3x = ay * bz - az * by, g3y = az * bx - ax * bz, g3z = ax * by - ay * bx;
    const float g0x = -(g1x + g2x + g3x), g0y = -(g1y + g2y + g3y), g0z = -(g1z + g2z + g3z);
    const float n0 = g0x * g0x + g0y * g0y + g0z * g0z;
    const float n1 = g1x * g1x + g1y * g1y + g1z * g1z;
    const float n2 = g2x * g2x + g2y * g2y + g2z * g2z;
    const float n3 = g3x * g3x + g3y * g3y + g3z * g3z;
    const float rest = s1.w, a = s2.w;
    const float weighted = p0.w * n0 + p1.w * n1 + p2.w * n2 + p3.w * n3;
    float multiplier = __fdividef(rest - (ax * g1x + ay * g1y + az * g1z), weighted + a);
    const float largest = fmaxf(fmaxf(p0.w * p0.w * n0, p1.w * p1.w * n1),
                                fmaxf(p2.w * p2.w * n2, p3.w * p3.w * n3));
    const float squared = multiplier * multiplier * largest;  // of the longest move
    constexpr float cube = @STEP_LIMIT * @STEP_LIMIT * @STEP_LIMIT;
    // To the sixth power, so that only the few that are too long pay for roots.
    if (squared * squared * squared > cube * cube * rest * rest)
        multiplier *= @STEP_LIMIT * cbrtf(rest) * rsqrtf(squared);
    float m = multiplier * p0.w;
    p0.x += m * g0x; p0.y += m * g0y; p0.z += m * g0z;
    m = multiplier * p1.w;
    p1.x += m * g1x; p1.y += m * g1y; p1.z += m * g1z;
    m = multiplier * p2.w;
    p2.x += m * g2x; p2.y += m * g2y; p2.z += m * g2z;
    m = multiplier * p3.w;
    p3.x += m * g3x; p3.y += m * g3y; p3.z += m * g3z;
    put(t.x, p0);
    put(t.y, p1);
    put(t.z, p2);
    put(t.w, p3);
};

for (int i = first_vertex; i < vertex_count; i += vertex_step)
    predict(i, 0, rest_delta[3 * i], rest_delta[3 * i + 1], rest_delta[3 * i + 2],
            frame.inverse_masses.data[i],
            velocity[3 * i], velocity[3 * i + 1], velocity[3 * i + 2]);
__syncthreads();  // ranges
arrive();
wait();

// What a thread needs of the color after the next is on its way while it waits: two edges
// or a tet.  Where it has more of a color, it loads them when it gets there.
struct Stage { int4 id; float4 a, b, c; int k, end; };
auto load_edges = [&](Stage& s) {
    if (s.k < s.end) {
        const int2 e = __ldcg(edge_slot + s.k);
        s.id.x = e.x; s.id.y = e.y;
        s.a = __ldcg(edge_span + s.k);
        s.c.x = __ldcg(frame.edge_regularization.data + s.k);
    }
    const int k = s.k + threads;
    if (k < s.end) {
        const int2 e = __ldcg(edge_slot + k);
        s.id.z = e.x; s.id.w = e.y;
        s.b = __ldcg(edge_span + k);
        s.c.y = __ldcg(frame.edge_regularization.data + k);
    }
};
auto load_tet = [&](Stage& s) {
    if (s.k < s.end) {
        s.id = __ldcg(tet_slot + s.k);
        s.a = __ldcg(tet_span + s.k);
        s.b = __ldcg(tet_span + tet_room + s.k);
        s.c = __ldcg(tet_span + 2 * tet_room + s.k);
    }
};
const int color_count = edge_colors + tet_colors;
auto load = [&](Stage& s, int c) {
    const int2 range = c < color_count ? ranges[c] : make_int2(0, 0);
    s.k = range.x + threadIdx.x;
    s.end = range.y;
    if (c < edge_colors) load_edges(s);
    else load_tet(s);
};
auto project = [&](Stage& s, int c) {
    if (c < edge_colors) {
        while (s.k < s.end) {
            project_edge(s.k, make_int2(s.id.x, s.id.y), s.a, s.c.x);
            if (s.k + threads < s.end)
                project_edge(s.k + threads, make_int2(s.id.z, s.id.w), s.b, s.c.y);
            s.k += 2 * threads;
            load_edges(s);
        }
    } else {
        while (s.k < s.end) {
            project_tet(s.id, s.a, s.b, s.c);
            s.k += threads;
            load_tet(s);
        }
    }
    arrive();
    load(s, c + 2);
    wait();
};
Stage even, odd;
load(even, 0);
load(odd, 1);
for (int substep = 0; substep < substep_count; ++substep) {
    for (int c = 0; c < color_count; c += 2) {
        project(even, c);
        if (c + 1 < color_count) project(odd, c + 1);
    }
    load(even, 0);
    load(odd, 1);
    const bool over = substep + 1 == substep_count;
    const float part = (substep + 1.0f) / substep_count;
    for (int i = first_vertex; i < vertex_count; i += vertex_step) {
        float4 b = get(SLOT(i));
        float vx = 0.0f, vy = 0.0f, vz = 0.0f;
        if (b.w > 0.0f) {
            const float px = before[3 * i], py = before[3 * i + 1], pz = before[3 * i + 2];
            if (has_springs) {
                const float a = frame.springs.data[i][0];
                if (a >= 0.0f) {
                    float u[3], squared = 0.0f;
                    const float d[3] = {b.x, b.y, b.z};
                    for (int j = 0; j < 3; ++j) {
                        const float from = anchor[3 * i + j];
                        const float way = part * (target[3 * i + j] - from);
                        u[j] = ((from - x[3 * i + j]) + way) - d[j];
                        squared += u[j] * u[j];
                    }
                    const float most = frame.springs.data[i][1];
                    const float along
                        = fminf(b.w / (b.w + a), most * rsqrtf(fmaxf(squared, 1e-30f)));
                    b.x += along * u[0]; b.y += along * u[1]; b.z += along * u[2];
                }
            }
            if (has_ground) {
                const float push = (timing[6] - x[3 * i + 2]) - b.z;
                if (push > 0.0f) {
                    b.z += push;
                    const float sx = b.x - px, sy = b.y - py;
                    const float slid = sqrtf(sx * sx + sy * sy);
                    const float held = fminf(1.0f, timing[7] * push / fmaxf(slid, 1e-30f));
                    b.x -= held * sx; b.y -= held * sy;
                }
            }
            vx = (b.x - px) * per_h; vy = (b.y - py) * per_h; vz = (b.z - pz) * per_h;
        }
        if (!over) {
            predict(i, substep + 1, b.x, b.y, b.z, b.w, vx, vy, vz);
            continue;
        }
        velocity[3 * i] = vx; velocity[3 * i + 1] = vy; velocity[3 * i + 2] = vz;
        const float moved = sqrtf(b.x * b.x + b.y * b.y + b.z * b.z);
        float* const place = reinterpret_cast<float*>(frame.vertices.data) + 3 * i;
        const float d[3] = {b.x, b.y, b.z};
        for (int j = 0; j < 3; ++j) {
            const float start = place[j];
            place[j] = b.w > 0.0f ? start + d[j] : target[3 * i + j];
            // What the addition rounded away isn't lost.
            rest_delta[3 * i + j] = b.w > 0.0f ? (start - place[j]) + d[j] : 0.0f;
            const_cast<float*>(anchor)[3 * i + j] = target[3 * i + j];
        }
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
