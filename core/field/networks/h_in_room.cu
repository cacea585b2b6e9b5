// The body of h_in_room in density_rows.py.
#if defined(__CUDA_ARCH__)
#include "density_rows.h"
const uint2 bits = *reinterpret_cast<const uint2*>(
    &reinterpret_cast<const Room*>(room)->rows[threadIdx.x][2 * k]);
float a, b, c, d;
asm("{.reg .f16 x, y; mov.b32 {x, y}, %2; cvt.f32.f16 %0, x; cvt.f32.f16 %1, y;}"
    : "=f"(a), "=f"(b) : "r"(bits.x));
asm("{.reg .f16 x, y; mov.b32 {x, y}, %2; cvt.f32.f16 %0, x; cvt.f32.f16 %1, y;}"
    : "=f"(c), "=f"(d) : "r"(bits.y));
return wp::vec_t<4, wp::float32>(a, b, c, d);
#else
return wp::vec_t<4, wp::float32>();
#endif
