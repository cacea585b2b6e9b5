from .modelfile import ModelFileError as ModelFileError, load as load, save as save
from .field import FieldOptions as FieldOptions, TetField as TetField, random_field as random_field
from .reduction import (
    cut as cut,
    reduced as reduced,
    specks as specks,
    without_specks as without_specks,
)

# For the rooms next door.
from .modelfile import (
    WHOLE_OF as WHOLE_OF,
    bytes_of_file as bytes_of_file,
    save_exactly as save_exactly,
)
from .field import same_values as same_values
from .packing import STIFFNESS_RANGE as STIFFNESS_RANGE
from .bounds import check_finite as check_finite, check_geometry as check_geometry
from .reduction import coarsest as coarsest, nearer_to_matter as nearer_to_matter
from .reach import reached_entries as reached_entries
from .isolation.isolating import (
    Isolated as Isolated,
    Isolation as Isolation,
    Stroke as Stroke,
    isolated as isolated,
    isolation_of as isolation_of,
    kept_field as kept_field,
    left_out_in_words as left_out_in_words,
    without_flats as without_flats,
    neck_of as neck_of,
)
from .isolation.subtet_graph import subtet_colors as subtet_colors
from .levels import below_pixel as below_pixel, level_edges as level_edges

# Kernels, their functions and array structs.
from .byte_table import table_in_bytes as table_in_bytes
from .encoding import (
    ENCODING_H as ENCODING_H,
    Tables as Tables,
    encode_backward_kernel as encode_backward_kernel,
    encode_kernel as encode_kernel,
    encoded_half as encoded_half,
    make_tables as make_tables,
)
from .grid import (
    GRID_ENTRIES as GRID_ENTRIES,
    GRID_LEVELS as GRID_LEVELS,
    RESOLUTIONS as RESOLUTIONS,
    Surroundings as Surroundings,
    contracted as contracted,
    grid_encode_backward_kernel as grid_encode_backward_kernel,
    grid_encode_kernel as grid_encode_kernel,
    surroundings_widths as surroundings_widths,
)
from .layout import FEATURES as FEATURES, node_table as node_table
from .networks.basis import (
    BASIS_COUNT as BASIS_COUNT,
    CONSTANT_BASIS as CONSTANT_BASIS,
    basis_of as basis_of,
    basis_vector as basis_vector,
)
from .networks.shapes import GEOMETRY_FEATURES as GEOMETRY_FEATURES
from .networks.layers import (
    LAYERS_H as LAYERS_H,
    NATIVE_VALUES as NATIVE_VALUES,
    NETWORK_BLOCK as NETWORK_BLOCK,
    NativeNetworks as NativeNetworks,
    multiplies_pairs as multiplies_pairs,
    native_networks as native_networks,
)
from .networks.density_rows import (
    OVERWRITTEN_LEVELS as OVERWRITTEN_LEVELS,
    any_of_warp as any_of_warp,
    density_in_shared as density_in_shared,
    density_of_rows as density_of_rows,
    share_density as share_density,
    h_in_shared as h_in_shared,
    put_features as put_features,
    sigma_in_shared as sigma_in_shared,
)
from .networks.torch import TorchNetworks as TorchNetworks
from .networks.dispatch import (
    Evaluators as Evaluators,
    torch_finds_a_gpu as torch_finds_a_gpu,
)
from .networks.mma import networks_kernel as networks_kernel
from .occupancy import (
    SUBTET_COUNT as SUBTET_COUNT,
    is_occupied as is_occupied,
    occupied_share as occupied_share,
    pack_mask as pack_mask,
    subtet_ahead as subtet_ahead,
    subtet_corners as subtet_corners,
    subtet_middles as subtet_middles,
    subtet_of as subtet_of,
    unpack_mask as unpack_mask,
)
