"""One frame of the solver on a GPU, in one launch, without a barrier between colors.

A launch per color costs 1.3 µs or more, a barrier of all blocks 1.1 µs, whatever a color
does, and a substep has 40 of them.  Here constraints wait for their own vertices only.  A
vertex is stored with how many constraints have moved it in this frame, its turn, in one
word of 16 bytes; whoever comes next in the order of colors waits for that turn, moves the
vertex, and counts on.  So every vertex is moved in the order of colors, as with barriers,
and the result is the same to the bit, but neighbors are all that anyone waits for.

Constraints, edges before tets, and then vertices are one list; thread t takes entries t,
t + threads, …, in this order.  The first entry that isn't done yet waits for nothing, so
someone always goes on, if all blocks run at once: there are no more than processors.  A
warp never has constraints of two colors (arrays.py pads them), as lanes that wait for each
other might stand still.

The substep itself is in xpbd.py and reference.py.  Shapes: V vertices, E edges, T tets.
"""

import numpy as np
import warp as wp

from .arrays import FrameArrays
from .constraints import COLLAPSED, STEP_LIMIT

wp.set_module_options({"enable_backward": False})

THREADS = 512  # of a block
PATIENCE = 1 << 24  # looks at a vertex, many seconds, until a frame is given up

_SNIPPET = """
#if defined(__CUDA_ARCH__)
    const int vertex_count = frame.vertex_count;
    const int edge_count = frame.edge_offsets.data[frame.edge_colors];
    const int tet_count = has_volumes ? frame.tet_offsets.data[frame.tet_colors] : 0;
    const int tet_room = frame.tet_room;
    const float* const timing = frame.timing.data;
    const float h = timing[0], per_h = 1.0f / h, decay = timing[1], limit = timing[2];
    const float gx = timing[3], gy = timing[4], gz = timing[5];
    const int2* const ends = reinterpret_cast<const int2*>(frame.edge_vertices.data);
    const int4* const corners = reinterpret_cast<const int4*>(frame.tet_vertices.data);
    float4* const edge_span = reinterpret_cast<float4*>(edge_spans.data);
    float4* const tet_span = reinterpret_cast<float4*>(tet_spans.data);
    const float* const x = reinterpret_cast<const float*>(frame.vertices.data);
    const float* const w = frame.inverse_masses.data;
    const float* const target = reinterpret_cast<const float*>(frame.targets.data);
    float* const anchor = reinterpret_cast<float*>(frame.anchors.data);
    float* const velocity = reinterpret_cast<float*>(frame.velocities.data);
    float* const before = reinterpret_cast<float*>(previous.data);
    float* const rest_delta = reinterpret_cast<float*>(frame.deltas.data);
    const int* const turns_of_vertex = has_volumes ? all_turns.data : edge_turns.data;

    struct Body { float x, y, z; int turn; };
    // Position and turn are read and written at once.
    auto get = [&](int i) {
        int x, y, z, turn;
        asm volatile("{.reg .b128 q; .reg .b64 a, b; ld.relaxed.gpu.global.b128 q, [%4];"
                     "mov.b128 {a, b}, q; mov.b64 {%0, %1}, a; mov.b64 {%2, %3}, b;}"
                     : "=r"(x), "=r"(y), "=r"(z), "=r"(turn) : "l"(bodies.data + i) : "memory");
        return Body{__int_as_float(x), __int_as_float(y), __int_as_float(z), turn};
    };
    auto put = [&](int i, float x, float y, float z, int turn) {
        asm volatile("{.reg .b128 q; .reg .b64 a, b; mov.b64 a, {%1, %2}; mov.b64 b, {%3, %4};"
                     "mov.b128 q, {a, b}; st.relaxed.gpu.global.b128 [%0], q;}"
                     :: "l"(bodies.data + i), "r"(__float_as_int(x)), "r"(__float_as_int(y)),
                     "r"(__float_as_int(z)), "r"(turn) : "memory");
    };
    int looks = 0;
    auto await = [&](int i, int turn) {
        Body b = get(i);
        while (b.turn != turn) {
            if (++looks > @PATIENCE) {
                frame.motion.data[0] = __int_as_float(0x7fc00000);  // not a number
                break;
            }
            b = get(i);
        }
        return b;
    };

    const int worker = blockIdx.x * @THREADS + threadIdx.x, worker_count = gridDim.x * @THREADS;
    // Spans of the frame's start.
#pragma unroll 4
    for (int k = worker; k < edge_count; k += worker_count) {
        const int2 e = ends[k];
        if (e.x < vertex_count)
            edge_span[k] = make_float4(x[3 * e.x] - x[3 * e.y], x[3 * e.x + 1] - x[3 * e.y + 1],
                                       x[3 * e.x + 2] - x[3 * e.y + 2], frame.edge_rest.data[k]);
    }
    for (int k = worker; k < tet_count; k += worker_count) {
        const int4 q = corners[k];
        const int other[3] = {q.y, q.z, q.w};
        if (q.x < vertex_count)
#pragma unroll
            for (int j = 0; j < 3; ++j)
                tet_span[j * tet_room + k] = make_float4(
                    x[3 * other[j]] - x[3 * q.x], x[3 * other[j] + 1] - x[3 * q.x + 1],
                    x[3 * other[j] + 2] - x[3 * q.x + 2],
                    j == 0 ? frame.tet_rest.data[k]
                           : j == 1 ? frame.tet_regularization.data[k] : 0.0f);
    }

    auto predict = [&](int i, int substep, float dx, float dy, float dz,
                       float vx, float vy, float vz) {
        if (w[i] > 0.0f) {
            before[3 * i] = dx; before[3 * i + 1] = dy; before[3 * i + 2] = dz;
            vx = decay * vx + h * gx; vy = decay * vy + h * gy; vz = decay * vz + h * gz;
            const float squared = vx * vx + vy * vy + vz * vz;
            if (squared > limit * limit) {
                const float less = limit * rsqrtf(squared);
                vx *= less; vy *= less; vz *= less;
            }
            dx += h * vx; dy += h * vy; dz += h * vz;
        } else {
            const float part = (substep + 1.0f) / substep_count;
            dx = part * (target[3 * i] - x[3 * i]);
            dy = part * (target[3 * i + 1] - x[3 * i + 1]);
            dz = part * (target[3 * i + 2] - x[3 * i + 2]);
        }
        put(i, dx, dy, dz, substep * turns);
    };

    auto project_edge = [&](int k, int first_turn) {
        const int2 e = __ldcg(ends + k);
        if (e.x >= vertex_count) return;
        const float4 span = __ldcg(edge_span + k);
        const float a = __ldcg(frame.edge_regularization.data + k);
        const unsigned order = edge_order.data[k];
        const float wp = w[e.x], wq = w[e.y];
        const int pt = first_turn + (order & 0xFFFFu), qt = first_turn + (order >> 16);
        Body p = await(e.x, pt), q = await(e.y, qt);
        float ux = span.x + (p.x - q.x), uy = span.y + (p.y - q.y), uz = span.z + (p.z - q.z);
        const float squared = ux * ux + uy * uy + uz * uz;
        const float rest = span.w, total = wp + wq + a;
        float inverse_length = rsqrtf(squared);
        float length = squared * inverse_length;
        length += 0.5f * inverse_length * (squared - length * length);
        float along = __fdividef(rest - length, total) * inverse_length;
        if (!(squared > @COLLAPSED * @COLLAPSED * rest * rest)) {  // it has no direction of its own
            unsigned bits = (unsigned(frame.edge_ids.data[k]) + 1u) * 2654435761u;
            bits ^= bits >> 16;
            bits *= 2246822519u;
            bits ^= bits >> 13;
            uz = (bits & 0xFFFFu) / 32768.0f - 1.0f;
            const float half_turns = (bits >> 16) / 32768.0f;
            const float ring = sqrtf(fmaxf(1.0f - uz * uz, 0.0f));
            ux = ring * cospif(half_turns);
            uy = ring * sinpif(half_turns);
            along = rest / total;
        }
        const float mp = wp * along, mq = wq * along;
        put(e.x, p.x + mp * ux, p.y + mp * uy, p.z + mp * uz, pt + 1);
        put(e.y, q.x - mq * ux, q.y - mq * uy, q.z - mq * uz, qt + 1);
    };

    auto project_tet = [&](int k, int first_turn) {
        const int4 t = __ldcg(corners + k);
        if (t.x >= vertex_count) return;
        const float4 s1 = __ldcg(tet_span + k), s2 = __ldcg(tet_span + tet_room + k);
        const float4 s3 = __ldcg(tet_span + 2 * tet_room + k);
        const uint2 order = reinterpret_cast<const uint2*>(tet_order.data)[k];
        const float w0 = w[t.x], w1 = w[t.y], w2 = w[t.z], w3 = w[t.w];
        const int t0 = first_turn + (order.x & 0xFFFFu), t1 = first_turn + (order.x >> 16);
        const int t2 = first_turn + (order.y & 0xFFFFu), t3 = first_turn + (order.y >> 16);
        Body p0 = await(t.x, t0), p1 = await(t.y, t1), p2 = await(t.z, t2), p3 = await(t.w, t3);
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
        const float weighted = w0 * n0 + w1 * n1 + w2 * n2 + w3 * n3;
        float multiplier = __fdividef(rest - (ax * g1x + ay * g1y + az * g1z), weighted + a);
        const float largest = fmaxf(fmaxf(w0 * w0 * n0, w1 * w1 * n1),
                                    fmaxf(w2 * w2 * n2, w3 * w3 * n3));
        const float squared = multiplier * multiplier * largest;  // of the longest move
        constexpr float cube = @STEP_LIMIT * @STEP_LIMIT * @STEP_LIMIT;
        // To the sixth power, so that only the few that are too long pay for roots.
        if (squared * squared * squared > cube * cube * rest * rest)
            multiplier *= @STEP_LIMIT * cbrtf(rest) * rsqrtf(squared);
        float m = multiplier * w0;
        put(t.x, p0.x + m * g0x, p0.y + m * g0y, p0.z + m * g0z, t0 + 1);
        m = multiplier * w1;
        put(t.y, p1.x + m * g1x, p1.y + m * g1y, p1.z + m * g1z, t1 + 1);
        m = multiplier * w2;
        put(t.z, p2.x + m * g2x, p2.y + m * g2y, p2.z + m * g2z, t2 + 1);
        m = multiplier * w3;
        put(t.w, p3.x + m * g3x, p3.y + m * g3y, p3.z + m * g3z, t3 + 1);
    };

    auto finish = [&](int i, int substep) {
        const int first_turn = substep * turns;
        const float part = (substep + 1.0f) / substep_count;
        Body b = await(i, first_turn + turns_of_vertex[i]);
        float vx = 0.0f, vy = 0.0f, vz = 0.0f;
        const float own = w[i];
        if (own > 0.0f) {
            const float px = before[3 * i], py = before[3 * i + 1], pz = before[3 * i + 2];
            const float a = has_springs ? frame.springs.data[i][0] : -1.0f;
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
                const float along = fminf(own / (own + a), most * rsqrtf(fmaxf(squared, 1e-30f)));
                b.x += along * u[0]; b.y += along * u[1]; b.z += along * u[2];
            }
            const float push = has_ground ? (timing[6] - x[3 * i + 2]) - b.z : 0.0f;
            if (push > 0.0f) {
                b.z += push;
                const float sx = b.x - px, sy = b.y - py;
                const float slid = sqrtf(sx * sx + sy * sy);
                const float held = fminf(1.0f, timing[7] * push / fmaxf(slid, 1e-30f));
                b.x -= held * sx; b.y -= held * sy;
            }
            vx = (b.x - px) * per_h; vy = (b.y - py) * per_h; vz = (b.z - pz) * per_h;
        }
        if (substep + 1 < substep_count) {
            predict(i, substep + 1, b.x, b.y, b.z, vx, vy, vz);
            return;
        }
        velocity[3 * i] = vx; velocity[3 * i + 1] = vy; velocity[3 * i + 2] = vz;
        const float moved = sqrtf(b.x * b.x + b.y * b.y + b.z * b.z);
        float* const place = reinterpret_cast<float*>(frame.vertices.data) + 3 * i;
        const float d[3] = {b.x, b.y, b.z};
        for (int j = 0; j < 3; ++j) {
            const float start = place[j];
            place[j] = own > 0.0f ? start + d[j] : target[3 * i + j];
            // What the addition rounded away isn't lost.
            rest_delta[3 * i + j] = own > 0.0f ? (start - place[j]) + d[j] : 0.0f;
            anchor[3 * i + j] = target[3 * i + j];
        }
        if (moved > frame.motion.data[0])  // a plain read spares most threads the atomic
            atomicMax(reinterpret_cast<int*>(frame.motion.data), __float_as_int(moved));
    };

    for (int i = worker; i < vertex_count; i += worker_count)
        predict(i, 0, rest_delta[3 * i], rest_delta[3 * i + 1], rest_delta[3 * i + 2],
                velocity[3 * i], velocity[3 * i + 1], velocity[3 * i + 2]);
    // All blocks wait for all, once: for spans, and for turns of this frame.  The counter only
    // grows and gridDim.x is a power of two, so wrapping around is harmless.
    __syncthreads();
    if (threadIdx.x == 0) {
        unsigned* const counter = reinterpret_cast<unsigned*>(arrivals.data);
        __threadfence();
        const unsigned goal = (atomicAdd(counter, 1u) & ~(gridDim.x - 1u)) + gridDim.x;
        while ((int)(*reinterpret_cast<volatile unsigned*>(counter) - goal) < 0) {}
        __threadfence();
    }
    __syncthreads();

    const int first_vertex = edge_count + tet_count;
    for (int substep = 0; substep < substep_count; ++substep)
        for (int j = worker; j < first_vertex + vertex_count; j += worker_count) {
            if (j < edge_count) project_edge(j, substep * turns);
            else if (j < first_vertex) project_tet(j - edge_count, substep * turns);
            else finish(j - first_vertex, substep);
        }
#endif
"""


@wp.func_native(
    _SNIPPET.replace("@THREADS", str(THREADS))
    .replace("@PATIENCE", str(PATIENCE))
    .replace("@COLLAPSED", f"{COLLAPSED}f")
    .replace("@STEP_LIMIT", f"{STEP_LIMIT}f")
)
def frame_native(
    frame: FrameArrays,
    edge_order: wp.array(dtype=wp.uint32),
    tet_order: wp.array(dtype=wp.vec2ui),
    edge_turns: wp.array(dtype=int),
    all_turns: wp.array(dtype=int),
    turns: int,
    bodies: wp.array(dtype=wp.vec4),
    previous: wp.array(dtype=wp.vec3),
    edge_spans: wp.array(dtype=wp.vec4),
    tet_spans: wp.array(dtype=wp.vec4),
    arrivals: wp.array(dtype=int),
    substep_count: int,
    has_volumes: int,
    has_springs: int,
    has_ground: int,
): ...


@wp.kernel(grid_stride=False)
def frame_kernel(
    frame: FrameArrays,
    edge_order: wp.array(dtype=wp.uint32),  # [edge_room] turn of each end when it comes
    tet_order: wp.array(dtype=wp.vec2ui),  # [tet_room] of each corner; 16 bits each
    edge_turns: wp.array(dtype=int),  # [V] turns in a substep without volume constraints
    all_turns: wp.array(dtype=int),  # [V] and with them
    turns: int,  # more than any vertex has
    bodies: wp.array(dtype=wp.vec4),  # [V] deltas and turns
    previous: wp.array(dtype=wp.vec3),  # [V] deltas at the substep's start
    edge_spans: wp.array(dtype=wp.vec4),  # [edge_room] of the frame's start, and L
    tet_spans: wp.array(dtype=wp.vec4),  # [3 tet_room] and 6 V0, a, 0
    arrivals: wp.array(dtype=int),  # [1] at the barrier
    substep_count: int,
    has_volumes: int,
    has_springs: int,
    has_ground: int,
):
    frame_native(
        frame,
        edge_order,
        tet_order,
        edge_turns,
        all_turns,
        turns,
        bodies,
        previous,
        edge_spans,
        tet_spans,
        arrivals,
        substep_count,
        has_volumes,
        has_springs,
        has_ground,
    )


class CudaFrame:
    """Runs frames of one solver on a GPU."""

    def __init__(self, frame: FrameArrays, device):
        """Take the arrays to work on."""
        self._frame, self._device = frame, device

        def scratch(count, dtype):
            return wp.zeros(count, dtype=dtype, device=device)

        self._orders = (
            scratch(frame.edge_room, wp.uint32),
            scratch(frame.tet_room, wp.vec2ui),
            scratch(frame.vertex_count, int),
            scratch(frame.vertex_count, int),
        )
        self._turns = 1
        self._scratch = (
            scratch(frame.vertex_count, wp.vec4),
            scratch(frame.vertex_count, wp.vec3),
            scratch(frame.edge_room, wp.vec4),
            scratch(3 * frame.tet_room, wp.vec4),
            scratch(1, int),
        )
        self._launches = {}

    def refresh(self, edges, tets) -> None:
        """Other constraints are in use: find the turns anew.

        Args:
            edges, tets: Vertex ids, V in entries that aren't used.  [edge_room, 2], [tet_room, 4]
        """
        count = self._frame.vertex_count
        edge_turns, counts = turns(edges, np.zeros(count, np.int64))
        tet_turns, all_counts = turns(tets, counts)
        packed = edge_turns.astype(np.uint32) @ np.array([1, 1 << 16], np.uint32)
        values = (
            packed,
            tet_turns.reshape(-1, 2, 2).astype(np.uint32) @ np.array([1, 1 << 16], np.uint32),
            counts.astype(np.int32),
            all_counts.astype(np.int32),
        )
        for array, value in zip(self._orders, values, strict=True):
            array.assign(value)
        self._turns = int(all_counts.max()) + 1
        self._launches.clear()

    def run(self, substep_count: int, volumes: bool, springs: bool, ground: bool) -> None:
        """One frame; what isn't needed isn't done."""
        key = substep_count, volumes, springs, ground
        if key not in self._launches:
            # A power of two, all of which run at once: they wait for each other.
            blocks = 2 ** int(np.log2(self._device.sm_count))
            self._launches[key] = wp.launch(
                frame_kernel,
                blocks * THREADS,
                [self._frame, *self._orders, self._turns, *self._scratch, *map(int, key)],
                device=self._device,
                block_dim=THREADS,
                record_cmd=True,
            )
        self._launches[key].launch()


def turns(constraints, counts):
    """When it is whose turn: how many constraints have moved a vertex before this one.

    Args:
        constraints: Vertex ids in the order of solving; V or more in unused entries.  [C, n]
        counts: How many have moved each vertex before all of these.  [V]

    Returns:
        Turns [C, n], and the counts after these [V].
    """
    flat = constraints.ravel()
    order = np.argsort(flat, kind="stable")
    ids = flat[order]
    first = np.searchsorted(ids, ids)
    result = np.empty(len(flat), np.int64)
    result[order] = (
        np.arange(len(flat)) - first + np.append(counts, 0)[np.minimum(ids, len(counts))]
    )
    added = np.bincount(flat[flat < len(counts)], minlength=len(counts))
    return result.reshape(constraints.shape), counts + added
