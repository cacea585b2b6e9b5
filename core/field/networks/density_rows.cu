// Density and h of the rows whose features a warp has put: the body of density_of_rows in density_rows.py.
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
#include "density_tiles.h"
find_density([&](int row, int j, const Result& r) {
    row += n - lane;
    uint* const to = reinterpret_cast<uint*>(h.data) + size_t(row) * 8 + 4 * j + pair / 2;
    to[0] = halves(finite(r[0]), finite(r[1]));
    to[64] = halves(finite(r[2]), finite(r[3]));
    if (j == 0 && pair == 0) {
        sigma.data[row] = sigma_of(r[0]);
        sigma.data[row + 8] = sigma_of(r[2]);
    }
});
#endif
