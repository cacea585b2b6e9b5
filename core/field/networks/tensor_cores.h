// Layers on a GPU's tensor cores: lambdas that mma.cu, colors.cu and density_rows.cu share.
//
// A thread has four numbers of a product of 16 rows and 8 columns: two neighbors of row `group`
// and two of row group + 8, in the columns pair, pair + 1.  Rounded to half precision, the results
// of two products side by side are the operand of the next layer.
using uint = unsigned int;
using Operand = uint[4];  // Warp has macros named float and int: no brackets behind them
using Result = float[4];

const int lane = threadIdx.x & 31, group = lane >> 2, pair = 2 * (lane & 3);

auto multiply = [](Result& c, const Operand& a, uint2 b) {
    asm("mma.sync.aligned.m16n8k16.row.col.f32.f16.f16.f32 "
        "{%0, %1, %2, %3}, {%4, %5, %6, %7}, {%8, %9}, {%0, %1, %2, %3};"
        : "+f"(c[0]), "+f"(c[1]), "+f"(c[2]), "+f"(c[3])
        : "r"(a[0]), "r"(a[1]), "r"(a[2]), "r"(a[3]), "r"(b.x), "r"(b.y));
};
auto halves = [](float low, float high) {
    uint bits;
    asm("cvt.rn.f16x2.f32 %0, %1, %2;" : "=r"(bits) : "f"(high), "f"(low));
    return bits;
};
auto relu = [](float v) { return v > 0.0f ? v : 0.0f; };
auto join = [&](Operand& a, const Result& c, const Result& d) {
    a[0] = halves(c[0], c[1]);
    a[1] = halves(c[2], c[3]);
    a[2] = halves(d[0], d[1]);
    a[3] = halves(d[2], d[3]);
};
auto start = [&](Result& c, const float* biases_) {
    c[0] = c[2] = biases_[pair];
    c[1] = c[3] = biases_[pair + 1];
};
