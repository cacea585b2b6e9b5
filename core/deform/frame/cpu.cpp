// One frame on a CPU: the body of frame_native in frame_cpu.py, whose text this is.
// @NAMES are filled in there.
#if !defined(__CUDA_ARCH__)
typedef float f4 __attribute__((ext_vector_type(4)));
typedef float f8 __attribute__((ext_vector_type(8)));
typedef int i8 __attribute__((ext_vector_type(8)));
f4* const bodies4 = reinterpret_cast<f4*>(bodies.data);
f4* const before = reinterpret_cast<f4*>(previous.data);
const float* const timing = frame.timing.data;
const float h = timing[0], decay = timing[1], limit = timing[2];
const float per_h = 1.0f / h;
const float cube = @STEP_LIMIT * @STEP_LIMIT * @STEP_LIMIT, limit_6 = cube * cube;
const f4 fall = f4{timing[3], timing[4], timing[5], 0.0f} * h;
float* const x = reinterpret_cast<float*>(frame.vertices.data);
float* const velocity = reinterpret_cast<float*>(frame.velocities.data);
float* const rest_delta = reinterpret_cast<float*>(frame.deltas.data);
const float* const target = reinterpret_cast<const float*>(frame.targets.data);
float* const anchor = reinterpret_cast<float*>(frame.anchors.data);
const int edge_stride = frame.edge_room, tet_stride = frame.tet_room;
float* const edge_span = spans.data;
float* const tet_span = edge_span + 3 * edge_stride;
const int vertex_count = frame.vertex_count, edge_colors = frame.edge_color_count;
const int edge_count = frame.edge_offsets.data[edge_colors];
const int tet_colors = has_volumes ? frame.tet_color_count : 0;
const int tet_count = frame.tet_offsets.data[frame.tet_color_count];

#if defined(__linux__)
int yield_now(void) __asm__("sched_yield");
#endif
// Each thread counts its arrivals in a cache line of its own, which the others look at.
int arrived = 0;
auto meet = [&]() {
    ++arrived;
    if (thread_count == 1) return;
    __atomic_store_n(arrivals.data + @LINE * thread, arrived, __ATOMIC_RELEASE);
    for (int other = 0; other < thread_count; ++other)
        for (int looks = 0;
             __atomic_load_n(arrivals.data + @LINE * other, __ATOMIC_ACQUIRE) < arrived; ++looks) {
#if defined(__linux__)
            if (looks > 2000) yield_now();  // others may need this core, one of ours among them
#endif
#if defined(__x86_64__)
            __builtin_ia32_pause();
#elif defined(__aarch64__)
            asm volatile("yield");
#endif
        }
};
// This thread's part of a range, in whole groups of lanes.
auto part = [&](int first, int last, int thread_id) {
    const long groups = (last - first + 7) / 8;
    const int begin = first + 8 * (int)(groups * thread_id / thread_count);
    return begin < last ? begin : last;
};

struct Eight { f8 x, y, z, w; };
auto gather = [&](const int* id) {
#define ROW(i) bodies4[id[i]]
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
        bodies4[id[i]] = row[i].lo;
        bodies4[id[i + 4]] = row[i].hi;
    }
};
auto load = [&](const float* from) {
    f8 v;
    __builtin_memcpy(&v, from, 32);
    return v;
};
auto larger = [](f8 a, f8 b) { return __builtin_elementwise_max(a, b); };
auto any = [](i8 mask) { return __builtin_reduce_or(mask) != 0; };

// The vertices of eight constraints, by corner.
int* const edge_lanes = lanes.data;
int* const tet_lanes = edge_lanes + 2 * frame.edge_room;
const int* const ends = reinterpret_cast<const int*>(frame.edge_vertices.data);
const int* const corners = reinterpret_cast<const int*>(frame.tet_vertices.data);

auto project_edges = [&](int k) {
    const int* const first_id = edge_lanes + 2 * k;
    const int* const second_id = first_id + 8;
    Eight p = gather(first_id), q = gather(second_id);
    const f8 rest = load(frame.edge_rest.data + k);
    f8 ux = load(edge_span + k) + (p.x - q.x);
    f8 uy = load(edge_span + edge_stride + k) + (p.y - q.y);
    f8 uz = load(edge_span + 2 * edge_stride + k) + (p.z - q.z);
    const f8 squared = ux * ux + uy * uy + uz * uz;
    const f8 length = __builtin_elementwise_sqrt(squared);
    const f8 total = p.w + q.w + load(frame.edge_regularization.data + k);
    f8 along = (rest - length) / (total * length);
    const i8 collapsed = !(length > @COLLAPSED * rest);
    if (any(collapsed)) {
        for (int i = 0; i < 8; ++i) {
            if (!collapsed[i]) continue;
            unsigned bits = (frame.edge_ids.data[k + i] + 1u) * 2654435761u;
            bits ^= bits >> 16;
            bits *= 2246822519u;
            bits ^= bits >> 13;
            const float up = (bits & 0xFFFFu) / 32768.0f - 1.0f;
            const float angle = (bits >> 16) * (6.2831853f / 65536.0f);
            const float wide = 1.0f - up * up;
            const float ring = sqrt(wide > 0.0f ? wide : 0.0f);
            ux[i] = ring * cos(angle);
            uy[i] = ring * sin(angle);
            uz[i] = up;
            along[i] = rest[i] / total[i];
        }
    }
    const f8 mp = p.w * along, mq = q.w * along;
    p.x += mp * ux; p.y += mp * uy; p.z += mp * uz;
    q.x -= mq * ux; q.y -= mq * uy; q.z -= mq * uz;
    scatter(first_id, p);
    scatter(second_id, q);
};

auto project_tets = [&](int k) {
    const int* const id = tet_lanes + 4 * k;
    Eight p0 = gather(id), p1 = gather(id + 8), p2 = gather(id + 16), p3 = gather(id + 24);
    auto span = [&](int j) { return load(tet_span + j * tet_stride + k); };
    const f8 ax = span(0) + (p1.x - p0.x), ay = span(1) + (p1.y - p0.y);
    const f8 az = span(2) + (p1.z - p0.z), bx = span(3) + (p2.x - p0.x);
    const f8 by = span(4) + (p2.y - p0.y), bz = span(5) + (p2.z - p0.z);
    const f8 cx = span(6) + (p3.x - p0.x), cy = span(7) + (p3.y - p0.y);
    const f8 cz = span(8) + (p3.z - p0.z);
    const f8 g1x = by * cz - bz * cy, g1y = bz * cx - bx * cz, g1z = bx * cy - by * cx;
    const f8 g2x = cy * az - cz * ay, g2y = cz * ax - cx * az, g2z = cx * ay - cy * ax;
    const f8 g3x = ay * bz - az * by, g3y = az * bx - ax * bz, g3z = ax * by - ay * bx;
    const f8 g0x = -(g1x + g2x + g3x), g0y = -(g1y + g2y + g3y), g0z = -(g1z + g2z + g3z);
    const f8 n0 = g0x * g0x + g0y * g0y + g0z * g0z;
    const f8 n1 = g1x * g1x + g1y * g1y + g1z * g1z;
    const f8 n2 = g2x * g2x + g2y * g2y + g2z * g2z;
    const f8 n3 = g3x * g3x + g3y * g3y + g3z * g3z;
    const f8 rest = load(frame.tet_rest.data + k);
    const f8 weighted = p0.w * n0 + p1.w * n1 + p2.w * n2 + p3.w * n3;
    f8 multiplier = (rest - (ax * g1x + ay * g1y + az * g1z))
        / (weighted + load(frame.tet_regularization.data + k));
    const f8 largest = larger(larger(p0.w * p0.w * n0, p1.w * p1.w * n1),
                              larger(p2.w * p2.w * n2, p3.w * p3.w * n3));
    const f8 squared = multiplier * multiplier * largest;  // of the longest move
    // To the sixth power, so that only the few that are too long pay for roots.
    const i8 too_long = squared * squared * squared > limit_6 * rest * rest;
    if (any(too_long))
        for (int i = 0; i < 8; ++i)
            if (too_long[i]) multiplier[i] *= @STEP_LIMIT * cbrt(rest[i]) / sqrt(squared[i]);
    f8 m = multiplier * p0.w;
    p0.x += m * g0x; p0.y += m * g0y; p0.z += m * g0z;
    m = multiplier * p1.w;
    p1.x += m * g1x; p1.y += m * g1y; p1.z += m * g1z;
    m = multiplier * p2.w;
    p2.x += m * g2x; p2.y += m * g2y; p2.z += m * g2z;
    m = multiplier * p3.w;
    p3.x += m * g3x; p3.y += m * g3y; p3.z += m * g3z;
    scatter(id, p0);
    scatter(id + 8, p1);
    scatter(id + 16, p2);
    scatter(id + 24, p3);
};

auto predict = [&](int i, int substep, f4 d, f4 v) {
    if (d.w > 0.0f) {
        before[i] = d;
        v = decay * v + fall;
        const float squared = v.x * v.x + v.y * v.y + v.z * v.z;
        if (squared > limit * limit) v *= limit / sqrt(squared);
        d.xyz += h * v.xyz;
    } else {
        const float share = (substep + 1.0f) / substep_count;
        for (int j = 0; j < 3; ++j) d[j] = share * (target[3 * i + j] - x[3 * i + j]);
    }
    bodies4[i] = d;
};

// The frame begins: spans, and the first prediction.
for (int k = part(0, edge_count, thread), last = part(0, edge_count, thread + 1); k < last;
     ++k) {
    for (int j = 0; j < 2; ++j) edge_lanes[2 * (k - k % 8) + 8 * j + k % 8] = ends[2 * k + j];
    if (ends[2 * k] == vertex_count) continue;
    for (int j = 0; j < 3; ++j)
        edge_span[j * edge_stride + k]
            = x[3 * ends[2 * k] + j] - x[3 * ends[2 * k + 1] + j];
}
if (tet_colors > 0)
    for (int k = part(0, tet_count, thread), last = part(0, tet_count, thread + 1); k < last;
         ++k) {
        for (int j = 0; j < 4; ++j)
            tet_lanes[4 * (k - k % 8) + 8 * j + k % 8] = corners[4 * k + j];
        if (corners[4 * k] == vertex_count) continue;
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j)
                tet_span[(3 * i + j) * tet_stride + k] = x[3 * corners[4 * k + i + 1] + j]
                    - x[3 * corners[4 * k] + j];
    }
const int first_vertex = part(0, vertex_count, thread);
const int last_vertex = part(0, vertex_count, thread + 1);
for (int i = first_vertex; i < last_vertex; ++i)
    predict(i, 0,
            f4{rest_delta[3 * i], rest_delta[3 * i + 1], rest_delta[3 * i + 2],
               frame.inverse_masses.data[i]},
            f4{velocity[3 * i], velocity[3 * i + 1], velocity[3 * i + 2], 0.0f});
float farthest = 0.0f;
meet();
for (int substep = 0; substep < substep_count; ++substep) {
    for (int c = 0; c < edge_colors; ++c) {
        const int first = frame.edge_offsets.data[c], end = frame.edge_offsets.data[c + 1];
        const int last = part(first, end, thread + 1);
        for (int k = part(first, end, thread); k < last; k += 8) project_edges(k);
        meet();
    }
    for (int c = 0; c < tet_colors; ++c) {
        const int first = frame.tet_offsets.data[c], end = frame.tet_offsets.data[c + 1];
        const int last = part(first, end, thread + 1);
        for (int k = part(first, end, thread); k < last; k += 8) project_tets(k);
        meet();
    }
    const bool over = substep + 1 == substep_count;
    const float share = (substep + 1.0f) / substep_count;
    for (int i = first_vertex; i < last_vertex; ++i) {
        f4 d = bodies4[i];
        f4 v = 0.0f;
        if (d.w > 0.0f) {
            const f4 from = before[i];
            if (has_springs && frame.springs.data[i][0] >= 0.0f) {
                f4 u = 0.0f;
                for (int j = 0; j < 3; ++j) {
                    const float way = target[3 * i + j] - anchor[3 * i + j];
                    u[j] = ((anchor[3 * i + j] - x[3 * i + j]) + share * way) - d[j];
                }
                const float squared = u.x * u.x + u.y * u.y + u.z * u.z;
                const float most = frame.springs.data[i][1];
                const float whole = d.w / (d.w + frame.springs.data[i][0]);
                const bool bounded = whole * whole * squared > most * most;
                d.xyz += (bounded ? most / sqrt(squared) : whole) * u.xyz;
            }
            if (has_ground) {
                const float push = (timing[6] - x[3 * i + 2]) - d.z;
                if (push > 0.0f) {
                    d.z += push;
                    const float sx = d.x - from.x, sy = d.y - from.y;
                    const float slid = sqrt(sx * sx + sy * sy);
                    const float most = timing[7] * push;
                    const float held = slid > most ? most / slid : 1.0f;
                    d.x -= held * sx;
                    d.y -= held * sy;
                }
            }
            v = (d - from) * per_h;
        }
        if (!over) {
            predict(i, substep + 1, d, v);
            continue;
        }
        const float moved = d.x * d.x + d.y * d.y + d.z * d.z;
        farthest = moved <= farthest ? farthest : moved == moved ? moved : __builtin_inff();
        for (int j = 0; j < 3; ++j) {
            const float start = x[3 * i + j];
            velocity[3 * i + j] = v[j];
            x[3 * i + j] = d.w > 0.0f ? start + d[j] : target[3 * i + j];
            // What the addition rounded away isn't lost.
            rest_delta[3 * i + j] = d.w > 0.0f ? (start - x[3 * i + j]) + d[j] : 0.0f;
            anchor[3 * i + j] = target[3 * i + j];
        }
    }
    if (!over) meet();
}
frame.motion.data[thread] = sqrt(farthest);
#endif
