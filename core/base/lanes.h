// Vectors of a CPU: a lane has a number of its own.  Bodies of functions include this text
// (native.py), so it has lambdas in place of functions.
#if defined(__AVX512F__)
typedef float Lanes __attribute__((ext_vector_type(16)));
typedef unsigned short LaneBits;
#else
typedef float Lanes __attribute__((ext_vector_type(8)));
typedef unsigned char LaneBits;
#endif
typedef Lanes LooseLanes __attribute__((aligned(4), may_alias));  // anywhere in memory
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

// A mask as bits, and what to do for each lane that it has.
typedef bool Bits __attribute__((ext_vector_type(LANES)));
auto bits_of = [](Ints mask) -> unsigned {
    return __builtin_bit_cast(LaneBits, __builtin_convertvector(mask, Bits));
};
auto each = [&](Ints mask, auto work) __attribute__((always_inline)) {
    for (unsigned bits = bits_of(mask); bits != 0; bits &= bits - 1) work(__builtin_ctz(bits));
};
