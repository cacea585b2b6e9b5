"""Rounds of march, shade and composite until no ray is left."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "compositing": [
            "Pixels",
            "empty_pixels",
            "ray_sums",
            "resolve",
            "resolve_kernel",
            "to_bytes",
        ],
        "cpu": ["SMALLEST", "CpuShader", "NativeShading", "shade_native", "trace_kernel"],
        "host": ["HostRounds"],
        "ray_color": ["Sums", "paint_kernel", "rest_direction", "store_sums", "with_slot"],
        "slot_densities": ["slot_densities_kernel"],
        "slot_march": ["march_known", "march_slots_kernel"],
        "slot_shading": ["shade_slots_kernel"],
        "slots": [
            "BLOCK_SIZE",
            "CROWDED",
            "LEAST_SLOTS",
            "LISTED",
            "MOST_SLOTS",
            "PARITY",
            "PER_RAY",
            "SAMPLES",
            "STRIDE",
            "STUCK",
            "TAKEN",
            "Buffers",
            "add_up",
            "begin_kernel",
            "claim",
            "composite_slots",
            "has_ray_colors",
            "keep_or_finish",
            "list_ray",
        ],
        "tiles": ["pixel_of", "pixel_threads"],
        "wavefront": ["Wavefront", "Way"],
    },
)
