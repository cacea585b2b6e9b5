// Shared memory with the density network's weights: the body of density_room in density_rows.py.
#if defined(__CUDA_ARCH__)
#include "density_rows.h"
__shared__ Room shared;
for (int i = threadIdx.x; i < 24 * 32; i += blockDim.x)
    shared.weights[i] = reinterpret_cast<const uint2*>(fragments.data)[i];
for (int i = threadIdx.x; i < 80; i += blockDim.x) shared.bias[i] = biases.data[i];
for (int i = 0; i < ROW; ++i) shared.rows[threadIdx.x][i] = 0u;
__syncthreads();
return reinterpret_cast<size_t>(&shared);
#else
return 0;
#endif
