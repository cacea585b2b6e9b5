// The features of some samples, on a CPU: `encode` of core/definition with the lanes of a vector side by
// side.  Bodies of functions include this text (native.py) after lanes.h, with the names samples,
// tables, table, words, hashed_start and byte_level (of a NativeShading).
//
// First the entries and weights of a level are found for all samples, and fetched from memory
// while those of the next level are found; then the entries are mixed.
typedef float Entry __attribute__((ext_vector_type(4)));

// Corners of a level's descendants of all samples, and their weights.  [4][sample]
struct Corners { int* entries[4]; float* weights[4]; };

// What the samples of a vector are, whatever the level.
struct Places { Lanes x[3]; Words products[4][3]; Ints tets; };

auto find_corners = [&](const Places& at, int level, Corners found, int first) {
    const float size = 1 << level;
    const Ints last_cell = (1 << level) - 1;
    Ints cell[3];
    Lanes fraction[3];
    for (int axis = 0; axis < 3; ++axis) {
        const Lanes y = at.x[axis] * size;
        cell[axis] = smaller(__builtin_convertvector(y, Ints), last_cell);
        fraction[axis] = y - __builtin_convertvector(cell[axis], Lanes);
    }
    const Ints xy = fraction[0] >= fraction[1], xz = fraction[0] >= fraction[2];
    const Ints yz = fraction[1] >= fraction[2];
    // Masks of the axis of the first and of the last step; the third of them is what is left.
    const Ints first_x = xy & xz, first_y = ~first_x & yz;
    const Ints last_z = xz & yz, last_y = ~last_z & xy;
    auto along = [](Ints is_one, Ints is_two, auto one, auto two, auto three) {
        typedef decltype(one) V;
        const V a = (V)is_one, b = (V)is_two;
        return (a & one) | (~a & ((b & two) | (~b & three)));
    };
    Ints entries[4];
    if (level < tables.dense_level_count) {
        const Ints nx = (cell[0] + 1) * (cell[0] + 2) / 2, ny = cell[1] + 1, one = 1;
        Ints node = (at.tets + 1) * tables.node_counts.data[level] - 1;
        node += tables.node_starts.data[level];
        node -= nx * cell[0] / 3 + ny * cell[1] / 2 + cell[2];
        const Ints end = node - nx - ny - 1;
        entries[0] = node;
        entries[1] = node - along(first_x, first_y, nx, ny, one);
        entries[2] = end + along(~last_z & ~last_y, last_y, nx, ny, one);
        entries[3] = end;
    } else {
        Words h[3], end[3];
        for (int k = 0; k < 3; ++k) {
            const Words s[3] = {at.products[1][k], at.products[2][k], at.products[3][k]};
            h[k] = at.products[0][k] * (1u << level);
            for (int axis = 0; axis < 3; ++axis) h[k] += (Words)cell[axis] * s[axis];
            end[k] = h[k] + s[0] + s[1] + s[2];
        }
        auto entry_of = [&](auto product) {
            const Words mixed = product(0) ^ product(1) ^ product(2);
            return (Ints)(mixed & (unsigned)tables.entry_masks.data[level]);
        };
        auto step = [&](Ints is_x, Ints is_y, int k) {
            return along(is_x, is_y, at.products[1][k], at.products[2][k], at.products[3][k]);
        };
        entries[0] = entry_of([&](int k) { return h[k]; });
        entries[1] = entry_of([&](int k) { return h[k] + step(first_x, first_y, k); });
        entries[2] = entry_of(
            [&](int k) { return end[k] - step(~last_z & ~last_y, last_y, k); });
        entries[3] = entry_of([&](int k) { return end[k]; });
    }
    const Lanes low = smaller(fraction[0], fraction[1]), high = larger(fraction[0], fraction[1]);
    const Lanes middle = larger(low, smaller(high, fraction[2]));
    const Lanes lowest = smaller(low, fraction[2]), highest = larger(high, fraction[2]);
    const Lanes weights[4] = {1.0f - highest, highest - middle, middle - lowest, lowest};
    for (int k = 0; k < 4; ++k) {
        *reinterpret_cast<Ints*>(found.entries[k] + first) = entries[k];
        *reinterpret_cast<Lanes*>(found.weights[k] + first) = weights[k];
    }
};

// The corners of a level of all samples, whose entries are on their way from memory.  Entries are
// places in `words`, or in `table` if the level is coarser than those in bytes.
auto find_all = [&](const Places* places, int count, int level, Corners found) {
    const bool dense = level < tables.dense_level_count, in_bytes = level >= byte_level;
    const int start = (in_bytes && dense ? 0 : tables.entry_starts.data[level])
        + (in_bytes && !dense ? hashed_start : 0);
    const int* const ids = tables.node_ids.data;
    for (int first = 0; first < count; first += LANES) {
        find_corners(places[first / LANES], level, found, first);
        for (int k = 0; k < 4; ++k) {
            int* const entries = found.entries[k] + first;
            if (dense && !in_bytes)
                for (int lane = 0; lane < LANES; ++lane) entries[lane] = ids[entries[lane]];
            *reinterpret_cast<Ints*>(entries) += start;
            for (int lane = 0; lane < LANES; ++lane)
                if (in_bytes)
                    __builtin_prefetch(words.data + entries[lane]);
                else
                    __builtin_prefetch(table.data + entries[lane]);
        }
    }
};

// Features of a level, x [4][step], from entries of four bytes, which take the places of `at`.
auto mix_bytes = [&](Corners at, int count, float* x, int step) {
    const int end = count + LANES - 1 & -LANES;
    for (int k = 0; k < 4; ++k)
        for (int i = 0; i < end; ++i) at.entries[k][i] = words.data[at.entries[k][i]];
    for (int first = 0; first < end; first += LANES)
#pragma clang loop unroll(full)
        for (int feature = 0; feature < 4; ++feature) {
            Lanes f = 0.0f;
#pragma clang loop unroll(full)
            for (int k = 0; k < 4; ++k) {
                const Ints word = *reinterpret_cast<const Ints*>(at.entries[k] + first);
                const Lanes value =
                    __builtin_convertvector(word << (24 - 8 * feature) >> 24, Lanes);
                const Lanes weight = *reinterpret_cast<const Lanes*>(at.weights[k] + first);
                f = k == 0 ? weight * value : multiply_add(weight, value, f);
            }
            *reinterpret_cast<Lanes*>(x + feature * step + first) = f;
        }
};

// The same from entries of four floats.
auto mix_floats = [&](Corners at, int count, float* x, int step) {
    const Entry* const entries = reinterpret_cast<const Entry*>(table.data);
    for (int i = 0; i < count; ++i) {
        Entry f = at.weights[0][i] * entries[at.entries[0][i]];
        for (int k = 1; k < 4; ++k)
            f = multiply_add(Entry(at.weights[k][i]), entries[at.entries[k][i]], f);
        for (int feature = 0; feature < 4; ++feature) x[feature * step + i] = f[feature];
    }
};

// Features x [4 level_count][step] of the samples in some slots.  `corners` are of two levels;
// all arrays hold a multiple of LANES samples.
auto encode = [&](const int* slots, int count, int level_count, Places* places,
                  const Corners* corners, float* x, int step) {
    for (int first = 0; first < count; first += LANES) {
        Places& at = places[first / LANES];
        for (int lane = 0; lane < LANES; ++lane) {
            const int slot = slots[first + lane < count ? first + lane : count - 1];
            const int tet = samples.tet.data[slot];
            const auto& bary = samples.bary.data[slot];
            at.tets[lane] = tet;
            for (int axis = 0; axis < 3; ++axis) at.x[axis][lane] = bary[axis + 1];
            const auto& products = tables.products.data[tet];
            for (int row = 0; row < 4; ++row)
                for (int k = 0; k < 3; ++k) at.products[row][k][lane] = products.data[row][k];
        }
        const Lanes zero = 0.0f, one = 1.0f;
        at.x[2] = larger(at.x[2], zero);
        at.x[1] = at.x[2] + larger(at.x[1], zero);
        at.x[0] = smaller(at.x[1] + larger(at.x[0], zero), one);
        at.x[1] = smaller(at.x[1], one);
        at.x[2] = smaller(at.x[2], one);
    }
    find_all(places, count, 0, corners[0]);
    for (int level = 0; level < level_count; ++level) {
        if (level + 1 < level_count) find_all(places, count, level + 1, corners[(level + 1) & 1]);
        const Corners& at = corners[level & 1];
        float* const of_level = x + 4 * level * step;
        if (level >= byte_level)
            mix_bytes(at, count, of_level, step);
        else
            mix_floats(at, count, of_level, step);
    }
};
