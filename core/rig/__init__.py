"""Bones that pose a mesh: skeletons, clips, weights, skinning, and the files of rigs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=["rotations"],
    submod_attrs={
        "skeleton": [
            "MOST_BONES",
            "Pose",
            "Skeleton",
            "make_skeleton",
            "mixed",
            "parents_first",
            "pose_of",
            "posed",
            "posed_tails",
            "reach",
            "skinning_matrices",
            "turned",
        ],
        "clips": [
            "Channel",
            "Clip",
            "VertexClip",
            "clip_of_matrices",
            "clip_of_poses",
            "phase",
        ],
        "caches": ["FRAMES_PER_SECOND", "read_cache", "write_cache"],
        "export": ["Solid", "export_mesh"],
        "weights": [
            "automatic_weights",
            "harmonic_weights",
            "nearest_point_weights",
            "nearest_weights",
            "rigid_weights",
            "weights_near",
        ],
        "untangle": ["Untangler"],
        "physics": ["posed_with_physics"],
        "quality": ["TetQuality", "clip_quality", "clip_vertices", "frame_times"],
        "fitting": ["fitted_weights", "surface_samples"],
        "alignment": ["align", "outer_points"],
        "matrix_file": ["read_matrices"],
        "gltf": ["GltfRig", "aligned", "read_gltf", "scale_of"],
        "methods": ["METHODS", "Method"],
        "skinning": ["Skinner", "skinned"],
        "driving": ["driven_vertices"],
        "rig": ["Rig", "check_weights"],
        "rigfile": ["arrays_of", "load_rig", "rig_from", "save_rig"],
    },
)
