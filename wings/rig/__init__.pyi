from . import rotations as rotations
from .skeleton import (
    MOST_BONES as MOST_BONES,
    BonePose as BonePose,
    Skeleton as Skeleton,
    make_skeleton as make_skeleton,
    mixed as mixed,
    moved_tails as moved_tails,
    pose_of as pose_of,
    posed as posed,
    reach as reach,
    turned as turned,
)
from .clips import (
    Channel as Channel,
    Clip as Clip,
    VertexClip as VertexClip,
    clip_of_poses as clip_of_poses,
    phase as phase,
)
from .caches import FRAMES_PER_SECOND as FRAMES_PER_SECOND, read_cache as read_cache
from .export import MESH_ENDINGS as MESH_ENDINGS, export_mesh as export_mesh
from .blender import (
    BlenderRig as BlenderRig,
    read_blender as read_blender,
    rig_of as rig_of,
    skinning_error as skinning_error,
)
from .weights import (
    automatic_weights as automatic_weights,
    driven_vertices as driven_vertices,
    nearest_point_weights as nearest_point_weights,
    rigid_weights as rigid_weights,
)
from .quality import TetQuality as TetQuality, clip_quality as clip_quality
from .fitting import fitted_weights as fitted_weights, surface_samples as surface_samples
from .alignment import align as align, outer_points as outer_points, shared_space as shared_space
from .matrix_file import read_matrices as read_matrices
from .gltf import GltfRig as GltfRig, aligned as aligned, read_gltf as read_gltf
from .gltf_nodes import scale_of as scale_of
from .skinning import Skinner as Skinner, skinned as skinned
from .rig import METHODS as METHODS, Method as Method
from .rig import Rig as Rig, check_weights as check_weights
from .rigfile import arrays_of as arrays_of, load_rig as load_rig, rig_from as rig_from
