"""Names for the tensors that the stages of the network hand to each other.

B frames, P pillars in row-major order (``dim`` wide), C classes, V voxels.
"""

from collections.abc import Sequence

from jaxtyping import Float, Int, UInt8
from torch import Tensor

Image = UInt8[Tensor, "b 3 h w"]
# The levels of the feature pyramid at the backbone's strides, finest first; None for a level that
# no lift reads.
Features = Sequence[Float[Tensor, "b dim _ _"] | None]
Pillars = Float[Tensor, "b p dim"]
# Pillars that ask for evidence: one set for all frames of a batch, or one each.
Queries = Float[Tensor, "#b p dim"]
Logits = Float[Tensor, "b c *space"]
Labels = UInt8[Tensor, "b *space"]
# Of the supervised voxels alone, which is all that a term of the loss is given.
VoxelScores = Float[Tensor, "c v"]
VoxelLabels = Int[Tensor, "v"]
Scalar = Float[Tensor, ""]
