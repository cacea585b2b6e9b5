"""What OpenGL draws, one layer over the other, and how images get to the device."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        "gl": ["Canvas"],
        "radiance_layer": ["RadianceLayer"],
        "handle_layer": ["HandleLayer"],
        "bone_layer": ["BoneLayer"],
        "mesh_layer": ["MeshLayer"],
        "ground_plane": ["line_spacing"],
        "photo_layer": ["PhotoLayer"],
        "upload": ["choose_path"],
        "resolution": ["SAMPLE_COUNT"],
    },
)
