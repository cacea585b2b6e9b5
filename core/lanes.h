// Vectors of a CPU: a lane has a number of its own.  Bodies of functions include this text
// (native.py), so it has lambdas in place of functions.
#if defined(__AVX512F__)
typedef float Lanes __attribute__((ext_vector_type(16)));
typedef unsigned short LaneBits;
#else
typedef float Lanes __attribute__((ext_vector_type(8)));
typedef unsigned char LaneBits;
#endif
enum { LANES = sizeof(Lanes) / sizeof(float) };
typedef int Ints __attribute__((ext_vector_type(LANES)));
typedef unsigned Words __attribute__((ext_vector_type(LANES)));

// a b + c, in one instruction where there is one: elsewhere fma would call a function for each lane.
auto multiply_add = [](auto a, auto b, auto c) __attribute__((always_inline)) {
#if defined(__FMA__) || defined(__aarch64__)
    return __builtin_elementwise_fma(a, b, c);
#else
    return a * b + c;
#endif
};

auto smaller = [](auto a, auto b) { return __builtin_elementwise_min(a, b); };
auto larger = [](auto a, auto b) { return __builtin_elementwise_max(a, b); };
