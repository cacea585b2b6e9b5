// Density and h of the rows whose features a warp has put, in the same rows: the body of
// density_in_room in density_rows.py.
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
#include "density_tiles.h"
find_density([&](int row, int j, const Result& r) {
    uint* const to = mine + ROW * row + 4 * j + pair / 2;
    to[0] = halves(finite(r[0]), finite(r[1]));
    to[ROW * 8] = halves(finite(r[2]), finite(r[3]));
    if (j == 0 && pair == 0) {
        mine[ROW * row + SIGMA] = __float_as_uint(sigma_of(r[0]));
        mine[ROW * (row + 8) + SIGMA] = __float_as_uint(sigma_of(r[2]));
    }
});
#endif
