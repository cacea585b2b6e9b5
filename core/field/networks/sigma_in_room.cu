// The body of sigma_in_room in density_rows.py.
#if defined(__CUDA_ARCH__)
#include "density_rows.h"
return __uint_as_float(reinterpret_cast<const Room*>(room)->rows[threadIdx.x][SIGMA]);
#else
return 0.0f;
#endif
