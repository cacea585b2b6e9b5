// The density network of 32 samples whose features a warp has put into its block's shared memory:
// what the bodies in density_rows.py share.
struct Room {
    uint2 weights[24 * 32];
    float bias[80];
    // A row of 32 halves for each thread, and some more so that 8 rows begin at different banks.
    __align__(16) unsigned int rows[@BLOCK_SIZE][20];
};
