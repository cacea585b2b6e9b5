"""Counters on the device that all active threads of a warp change together; votes of a warp."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    // One atomic for all active threads of a warp.
    unsigned mask = __activemask();
    int lane = threadIdx.x & 31;
    int leader = __ffs(mask) - 1;
    int first = 0;
    if (lane == leader) first = atomicAdd(&wp::index(state, place), __popc(mask));
    first = __shfl_sync(mask, first, leader);
    return first + __popc(mask & ((1u << lane) - 1));
#else
    return wp::atomic_add(state, place, 1);
#endif
""")
def claim(state: wp.array(dtype=int), place: int) -> int:
    """Each thread adds 1 to state[place]; returns the value before its own addition."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    unsigned mask = __activemask();
    int sum = __reduce_add_sync(mask, value);
    if ((threadIdx.x & 31) == __ffs(mask) - 1) atomicAdd(&wp::index(state, place), sum);
#else
    wp::atomic_add(state, place, value);
#endif
""")
def add_up(state: wp.array(dtype=int), place: int, value: int):
    """Add each thread's value to state[place]."""
    ...


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return __popc(__ballot_sync(0xffffffffu, flag));
#else
    return flag;
#endif
""")
def count_of_warp(flag: bool) -> int:
    """Of how many threads of the warp a flag is true; all of them call it."""
    ...
