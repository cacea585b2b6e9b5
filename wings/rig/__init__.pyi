from .rig import METHODS as METHODS, Method as Method, Rig as Rig
from .rigfile import arrays_of as arrays_of, load_rig as load_rig, rig_from as rig_from
from .skeleton import (
    BonePose as BonePose,
    Skeleton as Skeleton,
    make_skeleton as make_skeleton,
    mixed as mixed,
    reach as reach,
    turned as turned,
)
from .clips import (
    Channel as Channel,
    Clip as Clip,
    VertexClip as VertexClip,
    clip_of_poses as clip_of_poses,
)
from .weights import automatic_weights as automatic_weights, rigid_weights as rigid_weights
from .fitting import fitted_weights as fitted_weights
from .skinning import Skinner as Skinner, skinned as skinned
from .gltf import GltfRig as GltfRig, aligned as aligned, read_gltf as read_gltf
from .caches import read_cache as read_cache
from .export import MESH_ENDINGS as MESH_ENDINGS, export_mesh as export_mesh

# For the viewer, the commands and the lab.
from . import rotations as rotations
from .export import ply_file as ply_file, ply_lists as ply_lists
from .skeleton import (
    MOST_BONES as MOST_BONES,
    moved_tails as moved_tails,
    pose_of as pose_of,
    posed as posed,
)
from .clips import phase as phase
from .caches import FRAMES_PER_SECOND as FRAMES_PER_SECOND
from .blender import (
    BlenderRig as BlenderRig,
    read_blender as read_blender,
    rig_of as rig_of,
    skinning_error as skinning_error,
)
from .weights import (
    driven_vertices as driven_vertices,
    nearest_point_weights as nearest_point_weights,
)
from .quality import TetQuality as TetQuality, clip_quality as clip_quality
from .fitting import surface_samples as surface_samples
from .alignment import align as align, outer_points as outer_points, shared_space as shared_space
from .matrix_file import read_matrices as read_matrices
from .gltf_nodes import scale_of as scale_of
from .rig import check_weights as check_weights
