// Features of samples first .. first + chunk - 1 on the CPU: corner_entries for 16 samples at
// a time, in loops that the compiler turns into vector instructions.  Entries of the hashed
// levels are rarely in the cache; they are asked for here, and read one block later.
#if !defined(__CUDA_ARCH__)
    using uint32 = wp::uint32;
    constexpr int B = 16, MAX_LEVELS = 10;
    struct Block {
        int entries[MAX_LEVELS][4][B];
        float weights[MAX_LEVELS][4][B];
    } blocks[2];

    const int end_of_all = wp::min(first + chunk, wp::min(sample_tet.shape[0], features.shape[0]));
    const int* node_ids = tables.node_ids.data;
    for (int begin = first; begin < end_of_all + B; begin += B) {
        if (begin < end_of_all) {
            Block& block = blocks[begin / B % 2];
            int tet[B];
            float x[3][B];           // lattice_point
            uint32 origin[3][B];     // hash_products of corner 0 ...
            uint32 edges[3][3][B];   // ... and of an edge along each axis
            for (int i = 0; i < B; ++i) {
                const int n = wp::min(begin + i, end_of_all - 1);
                tet[i] = wp::max(wp::index(sample_tet, n), 0);
                const auto& bary = wp::index(sample_bary, n);
                const float z = wp::max(bary[3], 0.0f);
                const float y = z + wp::max(bary[2], 0.0f);
                x[0][i] = wp::min(y + wp::max(bary[1], 0.0f), 1.0f);
                x[1][i] = wp::min(y, 1.0f);
                x[2][i] = wp::min(z, 1.0f);
                const auto& products = wp::index(tables.products, tet[i]);
                for (int d = 0; d < 3; ++d) {
                    origin[d][i] = products.data[0][d];
                    for (int axis = 0; axis < 3; ++axis)
                        edges[axis][d][i] = products.data[axis + 1][d];
                }
            }
            for (int level = 0; level < level_count; ++level) {
                auto& e = block.entries[level];
                auto& w = block.weights[level];
                int cell[3][B];
                float f[3][B];
                const int last = (1 << level) - 1;
                const float size = static_cast<float>(last + 1);
                for (int d = 0; d < 3; ++d)
                    for (int i = 0; i < B; ++i) {
                        const float y = size * x[d][i];
                        const int c = static_cast<int>(y);
                        cell[d][i] = c < last ? c : last;
                        f[d][i] = y - static_cast<float>(cell[d][i]);
                    }
                for (int i = 0; i < B; ++i) {
                    const float low_xy = f[0][i] < f[1][i] ? f[0][i] : f[1][i];
                    const float high_xy = f[0][i] < f[1][i] ? f[1][i] : f[0][i];
                    const float low = low_xy < f[2][i] ? low_xy : f[2][i];
                    const float high = high_xy < f[2][i] ? f[2][i] : high_xy;
                    const float high_z = high_xy < f[2][i] ? high_xy : f[2][i];
                    const float middle = low_xy < high_z ? high_z : low_xy;
                    w[0][i] = 1.0f - high;
                    w[1][i] = high - middle;
                    w[2][i] = middle - low;
                    w[3][i] = low;
                }
                const int start = wp::index(tables.entry_starts, level);
                if (level < tables.dense_level_count) {
                    const int node_count = wp::index(tables.node_counts, level);
                    const int node_end = wp::index(tables.node_starts, level) + node_count - 1;
                    for (int i = 0; i < B; ++i) {
                        const bool xy = f[0][i] >= f[1][i];
                        const bool xz = f[0][i] >= f[2][i];
                        const bool yz = f[1][i] >= f[2][i];
                        const int nx = static_cast<uint32>((cell[0][i] + 1) * (cell[0][i] + 2)) / 2;
                        const int ny = cell[1][i] + 1;
                        const int rank = static_cast<uint32>(nx * cell[0][i]) / 3
                            + static_cast<uint32>(ny * cell[1][i]) / 2 + cell[2][i];
                        e[0][i] = node_end + tet[i] * node_count - rank;
                        e[3][i] = e[0][i] - nx - ny - 1;
                        e[1][i] = e[0][i] - ((xy & xz) ? nx : yz ? ny : 1);
                        e[2][i] = e[3][i] + ((xz & yz) ? 1 : xy ? ny : nx);
                    }
                    for (int corner = 0; corner < 4; ++corner)
                        for (int i = 0; i < B; ++i)
                            e[corner][i] = start + node_ids[e[corner][i]];
                } else {
                    uint32 hash[4][B] = {};
                    for (int d = 0; d < 3; ++d)
                        for (int i = 0; i < B; ++i) {
                            const bool xy = f[0][i] >= f[1][i];
                            const bool xz = f[0][i] >= f[2][i];
                            const bool yz = f[1][i] >= f[2][i];
                            const uint32 sx = edges[0][d][i], sy = edges[1][d][i], sz = edges[2][d][i];
                            const uint32 h = (origin[d][i] << level) + cell[0][i] * sx
                                + cell[1][i] * sy + cell[2][i] * sz;
                            const uint32 end = h + sx + sy + sz;
                            hash[0][i] ^= h;
                            hash[1][i] ^= h + ((xy & xz) ? sx : yz ? sy : sz);
                            hash[2][i] ^= end - ((xz & yz) ? sz : xy ? sy : sx);
                            hash[3][i] ^= end;
                        }
                    const uint32 mask = wp::index(tables.entry_masks, level);
                    for (int corner = 0; corner < 4; ++corner)
                        for (int i = 0; i < B; ++i)
                            e[corner][i] = start + static_cast<int>(hash[corner][i] & mask);
                    for (int corner = 0; corner < 4; ++corner)
                        for (int i = 0; i < B; ++i)
                            __builtin_prefetch(table.data + e[corner][i]);
                }
            }
        }
        if (begin > first) {
            const Block& block = blocks[(begin / B - 1) % 2];
            const int end = wp::min(begin, end_of_all);
            for (int n = begin - B; n < end; ++n) {
                const int i = n - (begin - B);
                const bool empty = wp::index(sample_tet, n) < 0;
                for (int level = 0; level < level_count; ++level) {
                    float sum[4] = {};
                    for (int corner = 0; corner < 4; ++corner) {
                        const auto& entry = table.data[block.entries[level][corner][i]];
                        const float weight = block.weights[level][corner][i];
                        for (int j = 0; j < 4; ++j)
                            sum[j] += weight * static_cast<float>(entry[j]);
                    }
                    auto& out = wp::index(features, n, level);
                    for (int j = 0; j < 4; ++j)
                        out[j] = empty ? 0.0f : sum[j];
                }
            }
        }
    }
#endif
