"""The handcrafted coarse matcher: descriptors of oriented gradients, normalised cross-correlation (NCC) with a robust
kernel, and semi-global aggregation (Hirschmüller, PAMI 2008). Nothing is learned.
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

ORIENTATIONS = 8
DESCRIPTOR_CHANNELS = 9 * ORIENTATIONS


class GradientMatcher(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        angles = torch.arange(ORIENTATIONS) * (2 * math.pi / ORIENTATIONS)
        self.register_buffer("directions", torch.stack((angles.cos(), angles.sin()), dim=1))  # (8, 2)
        self.register_buffer("luminance", torch.tensor([0.299, 0.587, 0.114]).view(1, 3, 1, 1))
        self.kernel = 3.0  # sharpness of the robust kernel: similarity is exp(−kernel · (1 − NCC))
        self.noise = 2e-6  # added to the variances of HOG cells
        # Semi-global aggregation: the penalties of a step of one plane and of a larger jump, and the factor by
        # which the aggregated costs are multiplied, so that softmax(−costs) is a probability.
        self.small_step = 0.04
        self.jump = 0.6
        self.sharpness = 50.0

    def grey(self, images: Tensor) -> Tensor:
        return (images * self.luminance).sum(dim=1, keepdim=True)

    def descriptors(self, images: Tensor) -> Tensor:
        """Descriptors of 3×3 HOG cells, each 8×8 pixels, normalised to zero mean and unit length:
        (B, 3, H, W) → (B, 72, H/8, W/8)."""
        cells = self.cells(images)
        b, c, h, w = cells.shape
        around = F.unfold(F.pad(cells, [1, 1, 1, 1], mode="replicate"), 3).view(b, c * 9, h, w)
        centred = around - around.mean(dim=1, keepdim=True)
        return centred / (centred.square().sum(dim=1, keepdim=True) + 1e-4).sqrt()

    def cells(self, images: Tensor) -> Tensor:
        """Histograms of oriented gradients in HOG cells, each 8×8 pixels: (B, 3, H, W) → (B, 8, H/8, W/8)."""
        grey = F.avg_pool2d(self.grey(images), 2)
        padded = F.pad(grey, [1, 1, 1, 1], mode="replicate")
        dx = padded[:, :, 1:-1, 2:] - padded[:, :, 1:-1, :-2]
        dy = padded[:, :, 2:, 1:-1] - padded[:, :, :-2, 1:-1]
        d = self.directions
        oriented = F.relu(dx * d[:, 0].view(1, -1, 1, 1) + dy * d[:, 1].view(1, -1, 1, 1)).square()
        oriented = oriented / (oriented.mean(dim=1, keepdim=True) + 1e-6).sqrt()
        return F.avg_pool2d(oriented, 4)

    def similarity(self, ref: Tensor, src: Tensor) -> Tensor:
        """Similarity of descriptors in [0, 1]: (1, 72, h, w), (D, 72, h, w) → (D, 1, h, w)."""
        return similarity(ref, src, self.kernel)

    def cell_similarity(self, ref: Tensor, src: Tensor) -> Tensor:
        """Similarity of HOG cells over windows of 3×3 cells: (1, 8, h, w), (D, 8, h, w) → (D, 1, h, w)."""
        product, mean_ref, mean_src = box(ref * src), box(ref), box(src)
        var_ref = box(ref.square()) - mean_ref.square()
        var_src = box(src.square()) - mean_src.square()
        ncc = (product - mean_ref * mean_src) * torch.rsqrt((var_ref + self.noise) * (var_src + self.noise))
        return torch.exp(self.kernel * (ncc - 1.0))

    def costs(self, matches: Tensor) -> Tensor:
        """Semi-global costs from similarities averaged over the views: (B, D, h, w) → (B, D, h, w); a low cost is
        likely."""
        costs = 1.0 - matches
        return torch.stack([self.semi_global(costs[b]) for b in range(costs.shape[0])]) * self.sharpness

    def semi_global(self, costs: Tensor) -> Tensor:
        """The mean over four directions of the costs of the cheapest paths: (D, h, w) → (D, h, w)."""
        rows = self.paths(costs)
        columns = self.paths(costs.transpose(1, 2)).transpose(1, 2)
        return 0.25 * (rows + columns)

    def paths(self, costs: Tensor) -> Tensor:
        """The costs of the cheapest paths from the left and from the right, summed: (D, h, w) → (D, h, w)."""
        both = torch.stack((costs, costs.flip(2))).permute(3, 1, 0, 2).contiguous()  # (w, D, 2, h)
        w, d, _, _ = both.shape
        for x in range(1, w):
            before = both[x - 1]
            best = before.amin(dim=0, keepdim=True)
            beside = F.max_pool1d(-before.view(1, d, -1).transpose(1, 2), 3, 1, 1).transpose(1, 2)
            step = self.small_step - beside.view_as(before)
            cheapest = torch.minimum(torch.minimum(before, step), best + self.jump)
            both[x] += cheapest - best
        both = both.permute(2, 1, 3, 0)  # (2, D, h, w)
        return both[0] + both[1].flip(2)


def similarity(ref: Tensor, src: Tensor, sharpness: float) -> Tensor:
    """exp(−sharpness · (1 − NCC)) over the channels, dimension 1, which becomes one channel: 1 for a perfect match,
    nearly 0 for none."""
    ncc = (ref * src).sum(dim=1, keepdim=True) * torch.rsqrt(
        (ref.square().sum(dim=1, keepdim=True) + 1e-3) * (src.square().sum(dim=1, keepdim=True) + 1e-3)
    )
    return torch.exp(sharpness * (ncc - 1.0))


def box(x: Tensor) -> Tensor:
    """The mean over all channels and a 3×3 window: (B, C, h, w) → (B, 1, h, w)."""
    return F.avg_pool2d(x.mean(dim=1, keepdim=True), 3, 1, 1, count_include_pad=False)
