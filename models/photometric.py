"""`photometric`: a hand-made network of the same contract, with nothing learned.

A classical plane-sweep matcher. Coarse stage: descriptors of oriented gradients at 1/8, similarity to
each source view by normalised correlation under a robust kernel, the mean over the views, semi-global
aggregation along the image's rows and columns (Hirschmüller, PAMI 2008). Flow stage:
normalised patches at 1/2, 1/4 and 1/8, the same robust mean, averaged along the present surface.

A source view that does not see the point matches badly there and so adds (nearly) nothing to the mean
of the robust kernel, while two views that do see it suffice: this is what "vis-avg" stands for here.
"""

import json
import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

ORIENTATIONS = 8
HYPOTHESES = 2


class Photometric(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.about = json.dumps(
            {
                "contract": 1,
                "name": "photometric",
                "aggregation": "vis-avg",
                "neighbours": 16,
                "hypotheses": HYPOTHESES,
                "flow_layers": 1,
                "planes": 96,
                "iterations": [{"scale": 8, "step": 0.5}, {"scale": 4, "step": 0.35}, {"scale": 2, "step": 0.15}],
                "licence": "MIT OR Apache-2.0",
                "trained_on": "nothing: hand-made",
                "scores": {},
            }
        )
        self.hypotheses = 2 * HYPOTHESES + 1
        angles = torch.arange(ORIENTATIONS) * (2 * math.pi / ORIENTATIONS)
        self.register_buffer("directions", torch.stack((angles.cos(), angles.sin()), dim=1))  # (8, 2)
        self.register_buffer("luminance", torch.tensor([0.299, 0.587, 0.114]).view(1, 3, 1, 1))
        # How fast the worth of a match falls with 1 − NCC, coarse and at 1/2, 1/4, 1/8.
        self.coarse_kernel = 3.0
        self.flow_kernel = [4.0, 4.0, 8.0]
        self.flow_weight = [1.0, 1.0, 0.2]
        # Semi-global aggregation: penalties of a step of one plane and of a jump, and the sharpness of
        # the probabilities made of the aggregated costs.
        self.small_step = 0.04
        self.jump = 0.6
        self.coarse_sharpness = 50.0
        self.flow_sharpness = 25.0

    @torch.jit.export
    def manifest(self) -> str:
        return self.about

    @torch.jit.export
    def set_manifest(self, about: str) -> None:
        self.about = about

    @torch.jit.export
    def encode_coarse(self, images: Tensor) -> Tensor:
        half = F.avg_pool2d(self.grey(images), 2)
        return self.gradient_descriptor(half, 4)

    @torch.jit.export
    def encode_flow(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        half = F.avg_pool2d(self.grey(images), 2)
        quarter = F.avg_pool2d(half, 2)
        return self.patches(half), self.patches(quarter), self.gradient_descriptor(half, 4)

    @torch.jit.export
    def relate(self, ref: Tensor, src: Tensor, depth: Tensor) -> Tensor:
        return self.kernel(ref, src, self.coarse_kernel)

    @torch.jit.export
    def visibility(self, pooled: Tensor) -> Tensor:
        raise RuntimeError("only vis-var has visibility masks")

    @torch.jit.export
    def regularize(self, volume: Tensor) -> Tensor:
        """(B, 1, D, h, w) mean similarities → (B, D, h, w) costs."""
        costs = 1.0 - volume[:, 0]
        return torch.stack([self.semi_global(costs[b]) for b in range(costs.shape[0])]) * self.coarse_sharpness

    @torch.jit.export
    def relate_flow(self, ref: Tensor, src: Tensor) -> Tensor:
        similarities = []
        begin = 0
        for level, channels in enumerate([25, 25, 9 * 8]):
            a, b = ref[:, begin : begin + channels], src[:, begin : begin + channels]
            similarities.append(self.kernel(a, b, self.flow_kernel[level]))
            begin += channels
        return torch.cat(similarities, dim=1)  # (B, 3, P)

    @torch.jit.export
    def flow(self, features: Tensor, neighbours: Tensor) -> Tensor:
        """Scores −Σ similarity, averaged over those neighbours that are the same hypothesis of their pixel."""
        similarity = features[:, 0] * self.flow_weight[0]
        for level in range(1, 3):
            similarity = similarity + features[:, level] * self.flow_weight[level]
        b, p, k = neighbours.shape
        own = torch.arange(p, device=neighbours.device) % self.hypotheses
        along = (neighbours % self.hypotheses == own[None, :, None]).to(similarity.dtype)  # (B, P, k)
        near = similarity.gather(1, neighbours.view(b, p * k)).view(b, p, k)
        mean = (near * along).sum(dim=2) / along.sum(dim=2).clamp(min=1.0)
        return -self.flow_sharpness * mean

    def grey(self, images: Tensor) -> Tensor:
        return (images * self.luminance).sum(dim=1, keepdim=True)

    def patches(self, grey: Tensor) -> Tensor:
        """5×5 patches of zero mean and unit length: (B, 1, h, w) → (B, 25, h, w)."""
        b, _, h, w = grey.shape
        stacked = F.unfold(F.pad(grey, [2, 2, 2, 2], mode="replicate"), 5).view(b, 25, h, w)
        centred = stacked - stacked.mean(dim=1, keepdim=True)
        return centred / (centred.square().sum(dim=1, keepdim=True) + 25 * 1e-4).sqrt()

    def gradient_descriptor(self, grey: Tensor, stride: int) -> Tensor:
        """Histograms of oriented gradients of 3×3 cells of side `stride`: (B, 72, h/stride, w/stride)."""
        padded = F.pad(grey, [1, 1, 1, 1], mode="replicate")
        dx = padded[:, :, 1:-1, 2:] - padded[:, :, 1:-1, :-2]
        dy = padded[:, :, 2:, 1:-1] - padded[:, :, :-2, 1:-1]
        d = self.directions
        oriented = F.relu(dx * d[:, 0].view(1, -1, 1, 1) + dy * d[:, 1].view(1, -1, 1, 1)).square()
        oriented = oriented / (oriented.mean(dim=1, keepdim=True) + 1e-6).sqrt()
        cells = F.avg_pool2d(oriented, stride)
        b, c, h, w = cells.shape
        around = F.unfold(F.pad(cells, [1, 1, 1, 1], mode="replicate"), 3).view(b, c * 9, h, w)
        centred = around - around.mean(dim=1, keepdim=True)
        return centred / (centred.square().sum(dim=1, keepdim=True) + 1e-4).sqrt()

    def kernel(self, ref: Tensor, src: Tensor, sharpness: float) -> Tensor:
        """exp(−sharpness · (1 − NCC)): 1 for a perfect match, nearly 0 for none. Channels become one."""
        ncc = (ref * src).sum(dim=1, keepdim=True) * torch.rsqrt(
            (ref.square().sum(dim=1, keepdim=True) + 1e-3) * (src.square().sum(dim=1, keepdim=True) + 1e-3)
        )
        return torch.exp(sharpness * (ncc - 1.0))

    def semi_global(self, costs: Tensor) -> Tensor:
        """The mean over four directions of the cheapest paths' costs: (D, h, w) → (D, h, w)."""
        rows = self.paths(costs)
        columns = self.paths(costs.transpose(1, 2)).transpose(1, 2)
        return 0.25 * (rows + columns)

    def paths(self, costs: Tensor) -> Tensor:
        """Paths from the left and from the right, summed: (D, h, w) → (D, h, w)."""
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
