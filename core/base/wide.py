"""Load and store four numbers at once: on CUDA with one instruction instead of four.

Warp loads a vector number by number, because a vector may begin at any address.  Elements of an
array begin at multiples of their size, as these instructions require.
"""

import warp as wp

vec4h = wp.types.vector(4, wp.float16)
vec4b = wp.types.vector(4, wp.bfloat16)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    float4 v = __ldg(reinterpret_cast<const float4*>(&wp::index(values, i)));
    return wp::vec_t<4, wp::float32>(v.x, v.y, v.z, v.w);
#else
    return wp::index(values, i);
#endif
""")
def load_wide(values: wp.array(dtype=wp.vec4), i: int) -> wp.vec4: ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    float4 v = *reinterpret_cast<const float4*>(&wp::index(values, i));
    return wp::vec_t<4, wp::float32>(v.x, v.y, v.z, v.w);
#else
    return wp::index(values, i);
#endif
""")
def load_wide_own(values: wp.array(dtype=wp.vec4), i: int) -> wp.vec4:
    """`load_wide` of what this thread's kernel may have written."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    int4 v = __ldg(reinterpret_cast<const int4*>(&wp::index(values, i)));
    return wp::vec_t<4, wp::int32>(v.x, v.y, v.z, v.w);
#else
    return wp::index(values, i);
#endif
""")
def load_wide_int(values: wp.array(dtype=wp.vec4i), i: int) -> wp.vec4i: ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    uint2 v = __ldg(reinterpret_cast<const uint2*>(&wp::index(values, i)));
    float x, y, z, w;
    asm("{.reg .f16 a, b; mov.b32 {a, b}, %2; cvt.f32.f16 %0, a; cvt.f32.f16 %1, b;}"
        : "=f"(x), "=f"(y) : "r"(v.x));
    asm("{.reg .f16 a, b; mov.b32 {a, b}, %2; cvt.f32.f16 %0, a; cvt.f32.f16 %1, b;}"
        : "=f"(z), "=f"(w) : "r"(v.y));
    return wp::vec_t<4, wp::float32>(x, y, z, w);
#else
    auto v = wp::index(values, i);
    return wp::vec_t<4, wp::float32>(float(v[0]), float(v[1]), float(v[2]), float(v[3]));
#endif
""")
def load_wide_half(values: wp.array(dtype=vec4h), i: int) -> wp.vec4: ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    uint2 v = *reinterpret_cast<const uint2*>(&wp::index(values, i));
    return wp::vec_t<4, wp::float32>(
        __uint_as_float(v.x << 16), __uint_as_float(v.x & 0xffff0000u),
        __uint_as_float(v.y << 16), __uint_as_float(v.y & 0xffff0000u));
#else
    auto v = wp::index(values, i);
    return wp::vec_t<4, wp::float32>(float(v[0]), float(v[1]), float(v[2]), float(v[3]));
#endif
""")
def load_wide_bfloat(values: wp.array(dtype=vec4b), i: int) -> wp.vec4: ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    *reinterpret_cast<float4*>(&wp::index(values, i)) = make_float4(v[0], v[1], v[2], v[3]);
#else
    wp::index(values, i) = v;
#endif
""")
def store_wide(values: wp.array(dtype=wp.vec4), i: int, v: wp.vec4): ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    uint2 bits;
    asm("{.reg .f16 a, b; cvt.rn.f16.f32 a, %1; cvt.rn.f16.f32 b, %2; mov.b32 %0, {a, b};}"
        : "=r"(bits.x) : "f"(v[0]), "f"(v[1]));
    asm("{.reg .f16 a, b; cvt.rn.f16.f32 a, %1; cvt.rn.f16.f32 b, %2; mov.b32 %0, {a, b};}"
        : "=r"(bits.y) : "f"(v[2]), "f"(v[3]));
    *reinterpret_cast<uint2*>(&wp::index(values, i)) = bits;
#else
    wp::index(values, i) = wp::vec_t<4, wp::float16>(
        wp::float16(v[0]), wp::float16(v[1]), wp::float16(v[2]), wp::float16(v[3]));
#endif
""")
def store_wide_half(values: wp.array(dtype=vec4h), i: int, v: wp.vec4): ...
