// The body of put_features in density_rows.py.
#if defined(__CUDA_ARCH__)
#include "density_rows.h"
uint2 bits;
asm("{.reg .f16 a, b; cvt.rn.f16.f32 a, %1; cvt.rn.f16.f32 b, %2; mov.b32 %0, {a, b};}"
    : "=r"(bits.x) : "f"(f[0]), "f"(f[1]));
asm("{.reg .f16 a, b; cvt.rn.f16.f32 a, %1; cvt.rn.f16.f32 b, %2; mov.b32 %0, {a, b};}"
    : "=r"(bits.y) : "f"(f[2]), "f"(f[3]));
*reinterpret_cast<uint2*>(&reinterpret_cast<Room*>(room)->rows[threadIdx.x][2 * level]) = bits;
#endif
