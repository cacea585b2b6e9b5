// Contacts in a substep, once for both devices; core/definition/contact.py has the same in float64.
// All contacts are projected at once from the same positions.  A vertex divides its mass among
// them by its weights there, so together they don't move it too far.
// Each device defines before, besides what substep.h takes:
//
//   body_of(i), put_body(i, d)   a Vector: the delta of vertex i, and its inverse mass
//   before(i), keep_before(i, d) what is kept of vertex i in the substep (substep.h)
//   seen(p), seen_four(p)     a number or a Vector, where another thread may have written it
//   add_load(i, n)            adds n to frame.contacts.loads[i], whatever other threads do
//   summed(v)                 the sum of a Vector over the lanes that share a vertex
const int contact_count = has_contacts ? frame.contacts.counts.data[0] : 0;
const int touched_count = has_contacts ? frame.contacts.counts.data[1] : 0;
constexpr float load_unit = @CONTACT_LOAD_UNIT;
float* const contact_results = frame.contacts.results.data;
// An impulse, a distance, a shift, five weights, and what is added to velocities.
enum { IMPULSE = 0, HEIGHT = 3, SHIFT = 4, WEIGHT = 8, KICK = 13, RESULTS = 16 };

auto contact_vertex = [&](int k, int j) { return frame.contacts.vertices.data[5 * k + j]; };

// Where contact k is now: its normal, weights and distance; a distance of 0 if it is not active.
auto look_at_contact = [&](int k) {
    float* const result = contact_results + RESULTS * k;
    const float* const span = frame.contacts.spans.data + 9 * k;
    const float share = frame.contacts.shares.data[k];
    const Vector p = body_of(contact_vertex(k, 0)), q = body_of(contact_vertex(k, 1));
    const Vector a = body_of(contact_vertex(k, 2)), b = body_of(contact_vertex(k, 3));
    const Vector c = body_of(contact_vertex(k, 4));
    const float ux = span[0] + (b.x - a.x), uy = span[1] + (b.y - a.y);
    const float uz = span[2] + (b.z - a.z), vx = span[3] + (c.x - a.x);
    const float vy = span[4] + (c.y - a.y), vz = span[5] + (c.z - a.z);
    const float rx = span[6] + ((p.x - a.x) + share * (q.x - p.x));
    const float ry = span[7] + ((p.y - a.y) + share * (q.y - p.y));
    const float rz = span[8] + ((p.z - a.z) + share * (q.z - p.z));
    const float nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
    const float squared = nx * nx + ny * ny + nz * nz;
    const float height = nx * rx + ny * ry + nz * rz;
    result[HEIGHT] = 0.0f;
    if (!(height < 0.0f && squared > 0.0f)) return;
    const float of_b = ((ry * vz - rz * vy) * nx + (rz * vx - rx * vz) * ny +
                        (rx * vy - ry * vx) * nz) / squared;
    const float of_c = ((uy * rz - uz * ry) * nx + (uz * rx - ux * rz) * ny +
                        (ux * ry - uy * rx) * nz) / squared;
    float weight[3] = {1.0f - of_b - of_c, of_b, of_c};
    const float* const bevel = frame.contacts.bevels.data + 9 * k;
    float sum = 0.0f;
    for (int j = 0; j < 3; ++j) {
        if (weight[j] < bevel[3 + j] || weight[j] > bevel[6 + j]) return;
        if (weight[j] * squared < -height * bevel[j] - @CONTACT_SLACK * squared) return;
        weight[j] = weight[j] > 0.0f ? weight[j] : 0.0f;
        sum += weight[j];
    }
    const float per_length = 1.0f / sqrt(squared);
    result[SHIFT] = per_length * nx;
    result[SHIFT + 1] = per_length * ny;
    result[SHIFT + 2] = per_length * nz;
    result[WEIGHT] = 1.0f - share;
    result[WEIGHT + 1] = share;
    for (int j = 0; j < 3; ++j) result[WEIGHT + 2 + j] = -weight[j] / sum;
    result[HEIGHT] = per_length * height;
    for (int j = 0; j < 5; ++j) {
        const float size = result[WEIGHT + j] < 0.0f ? -result[WEIGHT + j] : result[WEIGHT + j];
        // Integers: their sum doesn't depend on the order of threads.
        const int load = load_unit * size + 0.5f;
        if (load > 0) add_load(contact_vertex(k, j), load);
    }
};

// What contact k does to its vertices: an impulse against approach and friction along the
// triangle, and a shift that moves a point out of the body without giving it a velocity.
auto push_contact = [&](int k, int substep) {
    float* const result = contact_results + RESULTS * k;
    const float height = result[HEIGHT];
    if (!(height < 0.0f)) return;
    const float part = per_count * substep;
    float total = 0.0f;
    Vector u = {0.0f, 0.0f, 0.0f, 0.0f};  // the relative motion since the substep's start
    Vector v = u;  // and the relative velocity, where substeps extrapolate
    for (int j = 0; j < 5; ++j) {
        const int i = contact_vertex(k, j);
        const Vector now = body_of(i);
        const float weight = result[WEIGHT + j];
        Vector from = now;
        if (now.w > 0.0f) {
            from = before(i);
            if (extrapolates) v = plus(v, weight, velocity_of(i));
            const float load = seen(frame.contacts.loads.data + i) / load_unit;
            total += now.w * (weight < 0.0f ? -weight : weight) * load;
        } else {
            from.x = part * (target[3 * i] - x[3 * i]);
            from.y = part * (target[3 * i + 1] - x[3 * i + 1]);
            from.z = part * (target[3 * i + 2] - x[3 * i + 2]);
            if (extrapolates) v = plus(v, weight * per_h, plus(now, -1.0f, from));
        }
        u = plus(u, weight, plus(now, -1.0f, from));
    }
    if (!(total > 0.0f)) {
        result[HEIGHT] = 0.0f;
        return;
    }
    const float nx = result[SHIFT], ny = result[SHIFT + 1], nz = result[SHIFT + 2];
    const float along = nx * u.x + ny * u.y + nz * u.z;
    const float first = height - along;  // the distance at the substep's start
    const float deep = first < 0.0f ? first : 0.0f;
    const float push = deep > height ? deep - height : 0.0f;
    const float part_of_limit = -deep / frame.contacts.limits.data[0];
    const float fastest = h * frame.contacts.limits.data[1];
    const float wanted =
        -@CONTACT_SHARE_OUT * deep * (part_of_limit < 1.0f ? part_of_limit : 1.0f);
    const float out = wanted < fastest ? wanted : fastest;
    const float sx = u.x - along * nx, sy = u.y - along * ny, sz = u.z - along * nz;
    const float slid = sqrt(sx * sx + sy * sy + sz * sz), most = timing[7] * push;
    const float held = slid > most ? most / slid : 1.0f;
    const float per_total = 1.0f / total;
    result[IMPULSE] = per_total * (push * nx - held * sx);
    result[IMPULSE + 1] = per_total * (push * ny - held * sy);
    result[IMPULSE + 2] = per_total * (push * nz - held * sz);
    result[SHIFT] = per_total * out * nx;
    result[SHIFT + 1] = per_total * out * ny;
    result[SHIFT + 2] = per_total * out * nz;
    if (!extrapolates) return;
    const float speed = nx * v.x + ny * v.y + nz * v.z;
    const Vector n = {nx, ny, nz, 0.0f}, across = plus(v, -speed, n);
    const float change = push > 0.0f ? along + push - h * speed : 0.0f;
    const float stopped = change > 0.0f ? change : 0.0f;
    const float way = h * sqrt(across.x * across.x + across.y * across.y + across.z * across.z);
    const float resisted = timing[7] * stopped;
    const float taken = way > resisted ? resisted / way : 1.0f;
    const Vector kick = plus(times(per_h * stopped, n), -taken, across);
    result[KICK] = per_total * kick.x;
    result[KICK + 1] = per_total * kick.y;
    result[KICK + 2] = per_total * kick.z;
};

// What all its contacts do to a vertex, by this lane of those that share it.
auto take_contacts = [&](int place, int lane, int lane_count) {
    const int i = frame.contacts.touched.data[place];
    const int last = frame.contacts.offsets.data[i + 1];
    Vector d = body_of(i);
    Vector moved = {0.0f, 0.0f, 0.0f, 0.0f}, shifted = moved, kicked = moved;
    for (int e = frame.contacts.offsets.data[i] + lane; e < last; e += lane_count) {
        const int entry = frame.contacts.entries.data[e];
        const float* const result = contact_results + RESULTS * (entry >> 3);
        const Vector impulse = seen_four(result + IMPULSE), shift = seen_four(result + SHIFT);
        const float weight = seen(result + WEIGHT + (entry & 7));
        if (!(impulse.w < 0.0f)) continue;  // HEIGHT
        moved = plus(moved, weight, impulse);
        shifted = plus(shifted, weight, shift);
        if (extrapolates) {
            const float* const kick = result + KICK;
            const Vector one = {seen(kick), seen(kick + 1), seen(kick + 2), 0.0f};
            kicked = plus(kicked, weight, one);
        }
    }
    moved = summed(moved);
    shifted = summed(shifted);
    if (extrapolates) kicked = summed(kicked);
    if (lane > 0) return;
    frame.contacts.loads.data[i] = 0;  // for the next substep
    if (!(d.w > 0.0f)) return;
    shifted = times(d.w, shifted);
    keep_before(i, plus(before(i), 1.0f, shifted));
    put_body(i, plus(plus(d, d.w, moved), 1.0f, shifted));
    if (extrapolates) put_velocity(i, plus(velocity_of(i), d.w, kicked));
};
