// The march of many rays on a CPU: the body of march_native in cpu_march.py, which fills in @NAMES.
//
// Each lane has a ray of its own, and takes the next one when its round is over.  What lanes do in
// an iteration: enter a tet, fill slots of a sub-tet, leave the tet; each for the lanes that are
// so far.  `march_ray` in marching.py does the same, ray by ray.  Sub-tets are found on the
// lattice (core/geometry/subdivision.py): a cube of a quarter of the tet, and the order of the
// fractions in it.
#if !defined(__CUDA_ARCH__)
const auto& entries = rays.entries;
const auto& alive = round.alive;
const auto& samples = round.samples;
const auto& counts = round.counts;
const int first = round.first, ray_count = round.ray_count, slot_count = round.slot_count;
const float step = geometry.step;
static const int paths[] = {@PATHS};  // lattice_paths
#include "lanes.h"
struct alignas(sizeof(Lanes)) Numbers { float at[LANES]; };
struct alignas(sizeof(Lanes)) Integers { int at[LANES]; };
auto all = [](auto& numbers) -> auto& {
    if constexpr (__is_same(decltype(numbers.at[0]), float&))
        return *reinterpret_cast<Lanes*>(numbers.at);
    else
        return *reinterpret_cast<Ints*>(numbers.at);
};
auto chosen = [](Ints mask, auto yes, auto no) {
    typedef decltype(yes) V;
    return (V)((mask & (Ints)yes) | (~mask & (Ints)no));
};
const Lanes FAR = 1.0e30f, zero = 0.0f;
const Ints none = 0;

// -- what the lanes know ------------------------------------------------------------------------
Integers ray, number;  // number: of `alive`; -1: the lane has no ray
Integers tet, entry_face, piece, count, most, tets_left, fresh;  // fresh: a tet to be entered
Numbers origin[3], direction[3], t, depth;
// Of the lane's tet:
Numbers row[12], shape[7];
Numbers alpha[4], slope[4], speed, fade, rest_length, distance, begin;  // begin: entry_of
Integers face, piece_count;
unsigned long long masks[LANES];
// Of its sub-tet:
Numbers expected, bary[4], length, middle;
Integers place, occupied;
int next = 0;

auto take_rays = [&](Ints idle) {
    each(idle, [&](int lane) {
        if (number.at[lane] >= 0) {
            const int r = ray.at[lane];
            rays.t.data[r] = t.at[lane];
            rays.tet.data[r] = tet.at[lane];
            rays.entry_face.data[r] = entry_face.at[lane];
            rays.piece.data[r] = piece.at[lane];
            counts.data[number.at[lane]] = count.at[lane];
            number.at[lane] = -1;
        }
        while (next < ray_count && entries.count.data[alive.data[first + next]] < 0)
            counts.data[next++] = -1;  // it has to search
        if (next == ray_count) return;
        const int r = alive.data[first + next];
        ray.at[lane] = r;
        number.at[lane] = next++;
        for (int k = 0; k < 3; ++k) {
            origin[k].at[lane] = rays.origins.data[r][k];
            direction[k].at[lane] = rays.directions.data[r][k];
        }
        t.at[lane] = rays.t.data[r];
        tet.at[lane] = rays.tet.data[r];
        entry_face.at[lane] = rays.entry_face.data[r];
        piece.at[lane] = rays.piece.data[r];
        depth.at[lane] = wp::log(transmittance.data[r] / stop);
        count.at[lane] = 0;
        most.at[lane] = slot_count;
        tets_left.at[lane] = @MAX_TETS;
        fresh.at[lane] = -1;
    });
};

auto enter_mesh_again = [&](Ints outside) {
    each(outside, [&](int lane) {
        const int r = ray.at[lane], entry = entries.next.data[r];
        tet.at[lane] = -2;
        if (entry >= entries.count.data[r]) return;
        entries.next.data[r] = entry + 1;
        const int at = entry * entries.count.shape[0] + r;
        tet.at[lane] = entries.tet.data[at];
        t.at[lane] = wp::max(t.at[lane], entries.t.data[at]);
        entry_face.at[lane] = -1;
        piece.at[lane] = 0;
        fresh.at[lane] = -1;
    });
};

// line_in_tet, exit_tet, entry_of and speed_and_fade of the lanes' tets.
auto enter_tets = [&](Ints entering) {
    each(entering, [&](int lane) {
        const int k = tet.at[lane];
        const auto* const rows = geometry.rows.data + 3 * k;
        for (int i = 0; i < 12; ++i) row[i].at[lane] = rows[i / 4][i % 4];
        const auto* const shapes = geometry.shapes.data + 2 * k;
        for (int i = 0; i < 7; ++i) shape[i].at[lane] = shapes[i / 4][i % 4];
        masks[lane] = geometry.occupancy.data[k];
    });
    Lanes q[3], a[4], s[4];
    for (int k = 0; k < 3; ++k) {
        const Lanes from = all(origin[k]), corner = all(row[4 * k + 3]), apart = from - corner;
        const Lanes back = apart - from, lost = (from - (apart - back)) - (corner + back);
        q[k] = multiply_add(all(t), all(direction[k]), apart) + lost;
    }
    a[0] = 1.0f;
    s[0] = 0.0f;
    for (int i = 1; i < 4; ++i) {
        const Lanes x = all(row[4 * i - 4]), y = all(row[4 * i - 3]), z = all(row[4 * i - 2]);
        a[i] = multiply_add(z, q[2], multiply_add(y, q[1], x * q[0]));
        s[i] = multiply_add(z, all(direction[2]),
                            multiply_add(y, all(direction[1]), x * all(direction[0])));
        a[0] -= a[i];
        s[0] -= s[i];
    }
    Lanes nearest = FAR, entry = -FAR;
    Ints exit = -1;
    for (int i = 3; i >= 0; --i) {
        const Ints falls = (s[i] < zero) & (all(entry_face) != i);
        const Lanes crossing = -a[i] / s[i], to = chosen(falls, crossing, FAR);
        exit = chosen(falls & (to <= nearest), Ints(i), exit);
        nearest = smaller(nearest, to);
        entry = larger(entry, chosen(s[i] > zero, crossing, -FAR));
    }
    const Lanes slack = @ENTRY_SLACK * larger(all(t), Lanes(1.0f));
    entry = chosen(larger(entry, -entry) <= slack, entry, zero);
    const Lanes x = s[1], y = s[2], z = s[3];
    Lanes square = all(shape[0]) * x * x + all(shape[1]) * y * y + all(shape[2]) * z * z;
    square += all(shape[3]) * x * y + all(shape[4]) * x * z + all(shape[5]) * y * z;
    const Lanes fast = __builtin_elementwise_sqrt(larger(square, zero));
    nearest = larger(nearest, zero);
    const Lanes rest = larger(nearest - entry, zero) * fast;
    const Ints astray = (all(tets_left) <= 0) | (exit < 0);  // walks in circles, or in a flat tet
    Ints empty = all(shape[6]) <= zero;
    for (int lane = 0; lane < LANES; ++lane)
        if (masks[lane] == 0) empty[lane] = -1;
    const Lanes pieces = smaller(__builtin_elementwise_ceil(rest / step), Lanes(1.0e9f));
    for (int i = 0; i < 4; ++i) {
        all(alpha[i]) = chosen(entering, a[i], all(alpha[i]));
        all(slope[i]) = chosen(entering, s[i], all(slope[i]));
    }
    all(tet) = chosen(entering & astray, Ints(-2), all(tet));
    all(speed) = chosen(entering, fast, all(speed));
    all(fade) = chosen(entering, all(shape[6]), all(fade));
    all(distance) = chosen(entering, nearest, all(distance));
    all(begin) = chosen(entering, entry, all(begin));
    all(rest_length) = chosen(entering, rest, all(rest_length));
    all(face) = chosen(entering, exit, all(face));
    const Ints known = chosen(empty, none, __builtin_convertvector(pieces, Ints));
    all(piece_count) = chosen(entering, known, all(piece_count));
    all(fresh) = all(fresh) & ~entering;
};

// The rest length of the lanes' pieces, and their middles as distances from t.
struct Piece { Lanes size, at; };
auto pieces_of_lanes = [&]() -> Piece {
    const Lanes done = __builtin_convertvector(all(piece), Lanes) * step;
    const Lanes size = smaller(Lanes(step), all(rest_length) - done);
    return {size, all(begin) + multiply_add(size, Lanes(0.5f), done) / all(speed)};
};

// The sub-tet of a piece's middle, and how many pieces further middles are in it.
auto find_subtets = [&](Ints going) -> Ints {
    const Lanes at = pieces_of_lanes().at;
    Lanes f[3], g[3];
    Lanes x = 0.0f, rate = 0.0f;
    Ints cube = 0;
    for (int axis = 2; axis >= 0; --axis) {  // x2 = α3, x1 = α3 + α2, x0 = α3 + α2 + α1
        x += larger(multiply_add(at, all(slope[axis + 1]), all(alpha[axis + 1])), zero);
        rate += all(slope[axis + 1]);
        const Lanes scaled = 4.0f * smaller(x, Lanes(1.0f));
        const Ints cell = smaller(__builtin_convertvector(scaled, Ints), Ints(3));
        f[axis] = scaled - __builtin_convertvector(cell, Lanes);
        g[axis] = 4.0f * rate;
        cube = cube * 4 + cell;
    }
    const Ints xy = f[0] >= f[1], xz = f[0] >= f[2], yz = f[1] >= f[2];
    all(place) = cube * 8 - xy - 2 * xz - 4 * yz;  // a true lane is -1
    auto sort = [&](int i, int j) {
        const Ints right = f[i] >= f[j];
        const Lanes high = chosen(right, f[i], f[j]), low = chosen(right, f[j], f[i]);
        const Lanes of_high = chosen(right, g[i], g[j]), of_low = chosen(right, g[j], g[i]);
        f[i] = high, f[j] = low, g[i] = of_high, g[j] = of_low;
    };
    sort(0, 1);
    sort(1, 2);
    sort(0, 1);
    const Lanes weights[4] = {1.0f - f[0], f[0] - f[1], f[1] - f[2], f[2]};
    const Lanes rates[4] = {-g[0], g[0] - g[1], g[1] - g[2], g[2]};
    Lanes ahead = FAR;
    for (int i = 0; i < 4; ++i)
        ahead = smaller(ahead, chosen(rates[i] < zero, -weights[i] / rates[i], FAR));
    const Lanes further =
        smaller(larger(ahead * all(speed) / step, zero), Lanes(@MOST_PIECES));
    const Ints last = all(piece) + 1 + __builtin_convertvector(further, Ints);
    each(going, [&](int lane) {
        const int subtet = paths[place.at[lane]];
        occupied.at[lane] = masks[lane] >> subtet & 1 ? -1 : 0;
        expected.at[lane] = geometry.densities.data[@SUBTET_COUNT * tet.at[lane] + subtet];
    });
    all(expected) *= all(fade);
    return smaller(last, all(piece_count));
};

// Slots for pieces up to `last`.
auto fill_slots = [&](Ints filling, Ints last) {
    const Lanes at_once = larger(all(expected) * step, Lanes(1.0e-9f));
    Lanes enough = smaller(larger(all(depth), zero) / at_once, Lanes(@MOST_PIECES)) + 1.0f;
    enough = larger(enough, Lanes(@FEWEST_AT_ONCE));
    const Ints room =
        smaller(all(most) - all(count), __builtin_convertvector(enough, Ints));
    const Ints end = smaller(last, all(piece) + room);
    for (;;) {
        const Ints now = filling & (all(piece) < end);
        if (bits_of(now) == 0) break;
        const auto [size, at] = pieces_of_lanes();
        all(length) = all(fade) * size;
        all(middle) = all(t) + at;
        for (int i = 0; i < 4; ++i)
            all(bary[i]) = multiply_add(at, all(slope[i]), all(alpha[i]));
        each(now, [&](int lane) {
            const int slot = number.at[lane] * slot_count + count.at[lane];
            samples.tet.data[slot] = tet.at[lane];
            for (int i = 0; i < 4; ++i) samples.bary.data[slot][i] = bary[i].at[lane];
            samples.length.data[slot] = length.at[lane];
            samples.t.data[slot] = middle.at[lane];
        });
        all(depth) = chosen(now, all(depth) - all(expected) * size, all(depth));
        all(count) -= now;
        all(piece) -= now;
    }
    all(most) = chosen(filling & (all(depth) <= zero), all(count), all(most));
    return end;
};

auto leave_tets = [&](Ints leaving) {
    const Lanes least = @SMALLEST_ADVANCE * larger(all(t), Lanes(1.0f));
    all(t) = chosen(leaving, all(t) + larger(all(distance), least), all(t));
    all(piece) = all(piece) & ~leaving;
    all(tets_left) += leaving;
    each(leaving, [&](int lane) {
        const int link = geometry.links.data[tet.at[lane]][face.at[lane]];
        tet.at[lane] = link >= 0 ? link / 4 : -1;
        entry_face.at[lane] = link % 4;
    });
    all(fresh) = all(fresh) | leaving;
};

// -- all rays -------------------------------------------------------------------------------------
all(number) = all(tet) = -1;
all(ray) = all(count) = all(most) = all(piece) = all(piece_count) = all(fresh) = none;
all(entry_face) = all(face) = all(tets_left) = all(occupied) = none;
all(t) = all(depth) = all(speed) = all(fade) = all(rest_length) = all(distance) = zero;
all(begin) = zero;
all(expected) = zero;
for (Numbers& numbers : row) all(numbers) = zero;
for (Numbers& numbers : shape) all(numbers) = zero;
for (int k = 0; k < 3; ++k) all(origin[k]) = all(direction[k]) = zero;
for (int i = 0; i < 4; ++i) all(alpha[i]) = all(slope[i]) = zero;
for (int lane = 0; lane < LANES; ++lane) masks[lane] = 0;
for (;;) {
    // The rays that go on: the others' lanes take new ones.
    Ints going = (all(number) >= 0) & (all(tet) > -2) & (all(count) < all(most));
    if (bits_of(~going) != 0) {
        take_rays(~going);
        going = (all(number) >= 0) & (all(tet) > -2) & (all(count) < all(most));
        if (bits_of(all(number) >= 0) == 0) break;
    }
    const Ints outside = going & (all(tet) == -1);
    if (bits_of(outside) != 0) {
        enter_mesh_again(outside);
        going = going & (all(tet) >= 0);
    }
    const Ints entering = going & all(fresh);
    if (bits_of(entering) != 0) {
        enter_tets(entering);
        going = going & (all(tet) >= 0);
    }
    const Ints inside = going & (all(piece) < all(piece_count));
    if (bits_of(inside) != 0) {
        Ints last = find_subtets(inside);
        const Ints filling = inside & all(occupied);
        if (bits_of(filling) != 0) last = chosen(filling, fill_slots(filling, last), last);
        all(piece) = chosen(inside, last, all(piece));
    }
    const Ints leaving = going & (all(piece) >= all(piece_count));
    if (bits_of(leaving) != 0) leave_tets(leaving);
}
#endif
