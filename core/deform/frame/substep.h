// The arithmetic of a substep, once for both devices: cpu.cpp and cuda.cu include this text.
// It is the body of a function there, so it has lambdas in place of functions and templates.
// core/definition/solver.py has the same in float64.  Each device defines before:
//
//   real                      one number of each constraint that is projected at once: eight
//                             constraints in the lanes of a vector (CPU), or one (GPU)
//   Body                      x, y, z a vertex's delta, w its inverse mass; each a real
//   Vector                    four floats x, y, z, w
//   FOR_LANES(mask, i)        runs what follows for the lanes i that the mask selects
//   LANE(v, i)                lane i of a real
//   larger(a, b)
//   divided(a, b)             a / b
//   per_root(a, b)            a / sqrt(b), of floats
//   shortfall(squared, rest, total)   (rest - |u|) / (|u| total), where squared = |u|^2
//   cosine(t), sine(t)        of t half turns
//   plus(a, s, b), times(s, a)        a + s b and s a in x, y, z, of Vectors
//   for_each(a, v)            the Vector a, once for each vertex of v: a CPU moves two at once
//
// Constants of the frame, and pointers to the vertices' arrays.
const float* const timing = frame.timing.data;  // xpbd_options.Timing
const float h = timing[0], per_h = 1.0f / h, decay = timing[1], limit = timing[2];
// Constraints are projected at this share of a substep, and what they do is extrapolated to its end.
const float theta = timing[12], per_theta = 1.0f / theta, reach = theta * h;
const bool extrapolates = theta < 1.0f;
const Vector fall = {reach * timing[3], reach * timing[4], reach * timing[5], 0.0f};
const float air = timing[8];  // what it leaves of velocities
const bool has_air = air < 1.0f;
const float per_count = 1.0f / substep_count;
const Vector gust = {timing[9], timing[10], timing[11], 0.0f};
// What gravity adds to a velocity in the rest of a substep.
const float rest_of_fall = air * (1.0f - theta) * h;
const Vector late_fall = {rest_of_fall * timing[3], rest_of_fall * timing[4],
                          rest_of_fall * timing[5], 0.0f};
const int vertex_count = frame.state.vertices.shape[0];
float* const x = reinterpret_cast<float*>(frame.state.vertices.data);
float* const velocity = reinterpret_cast<float*>(frame.state.velocities.data);
float* const rest_delta = reinterpret_cast<float*>(frame.state.deltas.data);
float* const anchor = reinterpret_cast<float*>(frame.state.anchors.data);
const float* const target = reinterpret_cast<const float*>(frame.state.targets.data);

// -- constraints ------------------------------------------------------------------------------

struct Direction { float x, y, z; };
// The direction of an edge that has no length: pseudo-random, but always the same one.
auto fallback_direction = [=](int id) __attribute__((noinline)) {
    unsigned bits = (unsigned(id) + 1u) * 2654435761u;
    bits ^= bits >> 16;
    bits *= 2246822519u;
    bits ^= bits >> 13;
    const float up = (bits & 0xFFFFu) / 32768.0f - 1.0f;
    const float half_turns = (bits >> 16) / 32768.0f;
    const float wide = 1.0f - up * up;
    const float ring = sqrt(wide > 0.0f ? wide : 0.0f);
    return Direction{ring * cosine(half_turns), ring * sine(half_turns), up};
};

// What an edge between p and q does: its direction, not normalized, and its multiplier.  The span
// is the difference of its ends at the frame's start.
struct EdgeMove { real x, y, z, along, total; decltype(real() > real()) collapsed; };
auto edge_move = [&](const Body& p, const Body& q, real span_x, real span_y, real span_z, real rest,
                     real regularization) {
    const real ux = span_x + (p.x - q.x), uy = span_y + (p.y - q.y), uz = span_z + (p.z - q.z);
    const real squared = ux * ux + uy * uy + uz * uz;
    const real total = p.w + q.w + regularization;
    return EdgeMove{ux, uy, uz, shortfall(squared, rest, total), total,
                    !(squared > @COLLAPSED * @COLLAPSED * rest * rest)};
};
auto open_collapsed = [&](EdgeMove& m, real rest, const int* ids) {
    FOR_LANES(m.collapsed, i) {
        const Direction u = fallback_direction(ids[i]);
        LANE(m.x, i) = u.x;
        LANE(m.y, i) = u.y;
        LANE(m.z, i) = u.z;
        LANE(m.along, i) = LANE(divided(rest, m.total), i);
    }
};
auto move_ends = [&](const EdgeMove& m, Body& p, Body& q) {
    const real mp = p.w * m.along, mq = q.w * m.along;
    p.x += mp * m.x; p.y += mp * m.y; p.z += mp * m.z;
    q.x -= mq * m.x; q.y -= mq * m.y; q.z -= mq * m.z;
};

// Tets.  Spans are those of corners 1, 2, 3 from corner 0 at the frame's start: a, b, c.
auto project_tet = [&](Body& p0, Body& p1, Body& p2, Body& p3, const real (&span)[9], real rest,
                       real regularization) {
    const real ax = span[0] + (p1.x - p0.x), ay = span[1] + (p1.y - p0.y);
    const real az = span[2] + (p1.z - p0.z), bx = span[3] + (p2.x - p0.x);
    const real by = span[4] + (p2.y - p0.y), bz = span[5] + (p2.z - p0.z);
    const real cx = span[6] + (p3.x - p0.x), cy = span[7] + (p3.y - p0.y);
    const real cz = span[8] + (p3.z - p0.z);
    const real g1x = by * cz - bz * cy, g1y = bz * cx - bx * cz, g1z = bx * cy - by * cx;
    const real g2x = cy * az - cz * ay, g2y = cz * ax - cx * az, g2z = cx * ay - cy * ax;
    const real g3x = ay * bz - az * by, g3y = az * bx - ax * bz, g3z = ax * by - ay * bx;
    const real g0x = -(g1x + g2x + g3x), g0y = -(g1y + g2y + g3y), g0z = -(g1z + g2z + g3z);
    const real n0 = g0x * g0x + g0y * g0y + g0z * g0z;
    const real n1 = g1x * g1x + g1y * g1y + g1z * g1z;
    const real n2 = g2x * g2x + g2y * g2y + g2z * g2z;
    const real n3 = g3x * g3x + g3y * g3y + g3z * g3z;
    const real weighted = p0.w * n0 + p1.w * n1 + p2.w * n2 + p3.w * n3;
    real multiplier = divided(rest - (ax * g1x + ay * g1y + az * g1z), weighted + regularization);
    const real largest = larger(larger(p0.w * p0.w * n0, p1.w * p1.w * n1),
                                larger(p2.w * p2.w * n2, p3.w * p3.w * n3));
    const real squared = multiplier * multiplier * largest;  // of the longest move
    constexpr float cube = @STEP_LIMIT * @STEP_LIMIT * @STEP_LIMIT;
    // Compared to the sixth power: only the few moves that are too long need roots.
    const auto too_long = squared * squared * squared > cube * cube * rest * rest;
    FOR_LANES(too_long, i)
        LANE(multiplier, i) *= per_root(@STEP_LIMIT * cbrt(LANE(rest, i)), LANE(squared, i));
    real m = multiplier * p0.w;
    p0.x += m * g0x; p0.y += m * g0y; p0.z += m * g0z;
    m = multiplier * p1.w;
    p1.x += m * g1x; p1.y += m * g1y; p1.z += m * g1z;
    m = multiplier * p2.w;
    p2.x += m * g2x; p2.y += m * g2y; p2.z += m * g2z;
    m = multiplier * p3.w;
    p3.x += m * g3x; p3.y += m * g3y; p3.z += m * g3z;
};

// -- vertices ---------------------------------------------------------------------------------

// In most frames vertices do no more than move, and a device may have code for that alone: what
// follows takes Moving() in place of Full() then.
struct Moving { constexpr operator bool() const { return true; } };
struct Full { constexpr operator bool() const { return false; } };
const bool only_move = !(has_springs || has_ground || has_free || collider_count || has_contacts);

// Velocities with which vertices begin a substep, given those at the end of the one before, and
// those at its end, given those and the way that its projections led along.
auto begun = [&](auto v, float kept) {
    v = plus(for_each(fall, v), kept, v);
    return has_air ? plus(for_each(gust, v), air, v) : v;
};
auto ended = [&](auto v, auto way) {
    v = plus(for_each(late_fall, v), 1.0f - per_theta, v);
    return plus(v, per_theta * per_theta * per_h, way);
};

// What is kept of a vertex from a substep's beginning to its end: its delta, or its way in this
// frame if it is kinematic; and, where substeps extrapolate, its velocity.
struct Kept { Vector& delta; Vector& velocity; };

// A substep begins: vertex i moves on by its velocity, or along its way if it is kinematic.
auto predict = [&](auto moving, int i, int substep, Vector d, Vector v, Kept kept) {
    if (!(d.w > 0.0f))
        return plus(Vector{0.0f, 0.0f, 0.0f, d.w}, per_count * (substep + theta), kept.delta);
    kept.delta = d;
    // Free parts are damped once a frame (rigid_motion.py).
    v = begun(v, !moving && has_free && frame.state.free.data[i] ? 1.0f : decay);
    const float squared = v.x * v.x + v.y * v.y + v.z * v.z;
    if (squared > limit * limit) v = times(limit / sqrt(squared), v);
    if (extrapolates) kept.velocity = v;
    return plus(d, reach, v);
};
auto first_prediction = [&](auto moving, int i, Kept kept) {
    const float* const d = rest_delta + 3 * i;
    const float* const v = velocity + 3 * i;
    kept.delta = Vector{target[3 * i] - x[3 * i], target[3 * i + 1] - x[3 * i + 1],
                        target[3 * i + 2] - x[3 * i + 2], 0.0f};
    return predict(moving, i, 0, Vector{d[0], d[1], d[2], frame.state.inverse_masses.data[i]},
                   Vector{v[0], v[1], v[2], 0.0f}, kept);
};

// Pushes vertex i out of collider c (colliders.py), with friction relative to the collider.
auto leave_collider = [&](int i, int c, int substep, Vector& d, Vector from) {
    const float* const row = frame.colliders.data + @COLLIDER_SIZE * c;
    const float share = per_count * (substep + 1);
    const float wx = row[4] - row[1], wy = row[5] - row[2], wz = row[6] - row[3];
    const float px = (x[3 * i] - (row[1] + share * wx)) + d.x;
    const float py = (x[3 * i + 1] - (row[2] + share * wy)) + d.y;
    const float pz = (x[3 * i + 2] - (row[3] + share * wz)) + d.z;
    float nx = 0.0f, ny = 0.0f, nz = 0.0f, push;
    if (row[0] == 0.0f) {  // a sphere
        const float length = sqrt(px * px + py * py + pz * pz);
        push = row[7] - length;
        if (length > 0.0f) {
            nx = px / length; ny = py / length; nz = pz / length;
        } else {
            nz = 1.0f;
        }
    } else {
        const float ax = row[7] - (px < 0.0f ? -px : px);
        const float ay = row[8] - (py < 0.0f ? -py : py);
        const float az = row[9] - (pz < 0.0f ? -pz : pz);
        push = ax < ay ? (ax < az ? ax : az) : (ay < az ? ay : az);
        if (push == ax) nx = px < 0.0f ? -1.0f : 1.0f;
        else if (push == ay) ny = py < 0.0f ? -1.0f : 1.0f;
        else nz = pz < 0.0f ? -1.0f : 1.0f;
    }
    if (!(push > 0.0f)) return;
    d.x += push * nx; d.y += push * ny; d.z += push * nz;
    float sx = d.x - from.x - per_count * wx, sy = d.y - from.y - per_count * wy;
    float sz = d.z - from.z - per_count * wz;
    const float along = nx * sx + ny * sy + nz * sz;
    sx -= along * nx; sy -= along * ny; sz -= along * nz;
    const float slid = sqrt(sx * sx + sy * sy + sz * sz), most = timing[7] * push;
    const float held = slid > most ? most / slid : 1.0f;
    d.x -= held * sx; d.y -= held * sy; d.z -= held * sz;
};

// The spring of vertex i.
auto pull = [&](int i, int substep, Vector& d) {
    if (d.w > 0.0f && frame.state.springs.data[i][0] >= 0.0f) {
        const float share = per_count * (substep + theta);
        auto to_goal = [&](int j, float delta) {
            const float way = target[3 * i + j] - anchor[3 * i + j];
            return ((anchor[3 * i + j] - x[3 * i + j]) + share * way) - delta;
        };
        const float ux = to_goal(0, d.x), uy = to_goal(1, d.y), uz = to_goal(2, d.z);
        const float squared = ux * ux + uy * uy + uz * uz;
        const float most = frame.state.springs.data[i][1];
        const float whole = d.w / (d.w + frame.state.springs.data[i][0]);
        const bool bounded = whole * whole * squared > most * most;
        const float part = bounded ? per_root(most, squared) : whole;
        d.x += part * ux; d.y += part * uy; d.z += part * uz;
    }
};

// The projections of a substep are done: moves a vertex on to its end, and returns its velocity.
auto extrapolate = [&](Vector& d, Kept kept) {
    const Vector way = plus(d, -1.0f, kept.delta), from = kept.delta;
    d = Vector{from.x + per_theta * way.x, from.y + per_theta * way.y,
               from.z + per_theta * way.z, d.w};
    return ended(kept.velocity, way);
};

// Contacts follow: the spring of vertex i, and where it is at the substep's end without them.
auto before_contacts = [&](int i, int substep, Vector& d, Kept kept) {
    if (has_springs) pull(i, substep, d);
    if (!extrapolates) return;
    if (d.w > 0.0f) kept.velocity = extrapolate(d, kept);
    else d = plus(Vector{0.0f, 0.0f, 0.0f, d.w}, per_count * (substep + 1), kept.delta);
};

// A substep ends: the ground, colliders, and vertex i's velocity.
auto finish = [&](auto moving, int i, int substep, Vector& d, Kept kept) {
    if (!(d.w > 0.0f)) return Vector{0.0f, 0.0f, 0.0f, 0.0f};
    if (!moving && has_springs && !has_contacts) pull(i, substep, d);  // contacts come after springs
    // Where there is a ground or a collider, no substep extrapolates (XpbdSolver.integrator).
    if (extrapolates) return has_contacts ? kept.velocity : extrapolate(d, kept);
    Vector from = kept.delta;
    if (!moving && has_ground) {
        // The mean of pushes bounds friction: a vertex that is pushed by fits and starts would
        // slide while it is not, and the body would creep.
        const float ground = timing[6] - x[3 * i + 2], leaving = @LEAVING_SPEED * h;
        const bool deep = from.z < ground - leaving;
        const float lowest = deep ? from.z + leaving : ground;
        const float below = lowest - d.z;
        const float push = below > 0.0f ? below : 0.0f;
        float* const press = frame.state.presses.data + i;
        *press += @PRESS_SHARE * (push - *press);
        d.z += push;
        if (*press > 0.0f) {
            const float sx = d.x - from.x, sy = d.y - from.y;
            const float slid = sqrt(sx * sx + sy * sy);
            const float most = timing[7] * *press;
            const float held = slid > most ? most / slid : 1.0f;
            d.x -= held * sx;
            d.y -= held * sy;
        }
        if (deep && push > 0.0f) from.z = d.z;
    }
    for (int c = 0; c < (moving ? 0 : collider_count); ++c) leave_collider(i, c, substep, d, from);
    return times(per_h, plus(d, -1.0f, from));
};

// The frame ends: vertex i's position, velocity, and what the addition rounded away.  A kinematic
// vertex has the velocity of its way, which it keeps when it is released.
auto store = [&](int i, Vector d, Vector v) {
    const float deltas[3] = {d.x, d.y, d.z}, velocities[3] = {v.x, v.y, v.z};
    const float per_frame = per_h * per_count;
    for (int j = 0; j < 3; ++j) {
        const int k = 3 * i + j;
        const float start = x[k];
        velocity[k] = d.w > 0.0f ? velocities[j] : per_frame * (target[k] - start);
        x[k] = d.w > 0.0f ? start + deltas[j] : target[k];
        rest_delta[k] = d.w > 0.0f ? (start - x[k]) + deltas[j] : 0.0f;
        anchor[k] = target[k];
    }
};
