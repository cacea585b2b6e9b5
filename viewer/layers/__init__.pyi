from .gl import Canvas as Canvas
from .radiance_layer import RadianceLayer as RadianceLayer
from .handle_layer import HandleLayer as HandleLayer, MarkLayer as MarkLayer
from .bone_layer import BoneLayer as BoneLayer
from .photographed import Photographed as Photographed
from .mesh_layer import MeshLayer as MeshLayer
from .ground_plane import line_spacing as line_spacing
from .photo_layer import PhotoLayer as PhotoLayer
from .upload import choose_path as choose_path
from .resolution import SAMPLE_COUNT as SAMPLE_COUNT
