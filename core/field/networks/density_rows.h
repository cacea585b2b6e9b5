// The density network of 32 samples whose features a warp has put into its block's shared memory:
// what the bodies in density_rows.py share.
enum {
    ROW = 20,  // words from one to the next: 8 rows begin at different banks
    SIGMA = 16,  // behind the features
};
struct Room {
    uint2 weights[24 * 32];
    float bias[80];
    __align__(16) unsigned int rows[@BLOCK_SIZE][ROW];  // of each thread: 32 halves, and more
};
