"""`photometric`: a handcrafted network with the same contract. Nothing is learned.

It is a classical plane-sweep matcher. Coarse stage: descriptors of oriented gradients at 1/8, similarity to each
source view by normalised cross-correlation (NCC) with a robust kernel, the mean over the views, and semi-global
aggregation along the image's rows and columns (Hirschmüller, PAMI 2008). Flow stage: normalised patches at 1/2 and
1/4 and the descriptors at 1/8, the same robust mean, averaged over neighbouring points of the same hypothesis.

A source view that does not see the point matches badly there and adds almost nothing to the mean of the robust
kernel, and two views that do see it suffice. In this sense the aggregation is "vis-avg".
"""

import json

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from matcher import DESCRIPTOR_CHANNELS, GradientMatcher, similarity

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
                "trained_on": "nothing: handcrafted",
                "scores": {},
            }
        )
        self.hypotheses = 2 * HYPOTHESES + 1
        self.matcher = GradientMatcher()
        # At 1/2, 1/4 and 1/8: channels, sharpness of the robust kernel, and weight of the similarity.
        self.flow_channels = [25, 25, DESCRIPTOR_CHANNELS]
        self.flow_kernel = [4.0, 4.0, 8.0]
        self.flow_weight = [1.0, 1.0, 0.2]
        # The factor of the scores, so that softmax(−scores) is a probability.
        self.flow_sharpness = 25.0

    @torch.jit.export
    def manifest(self) -> str:
        return self.about

    @torch.jit.export
    def set_manifest(self, about: str) -> None:
        self.about = about

    @torch.jit.export
    def encode_coarse(self, images: Tensor) -> Tensor:
        return self.matcher.descriptors(images)

    @torch.jit.export
    def encode_flow(self, images: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        half = F.avg_pool2d(self.matcher.grey(images), 2)
        quarter = F.avg_pool2d(half, 2)
        return self.patches(half), self.patches(quarter), self.matcher.descriptors(images)

    @torch.jit.export
    def relate(self, ref: Tensor, src: Tensor, depth: Tensor) -> Tensor:
        return self.matcher.similarity(ref, src)

    @torch.jit.export
    def visibility(self, pooled: Tensor) -> Tensor:
        raise RuntimeError("only vis-var has visibility masks")

    @torch.jit.export
    def regularize(self, volume: Tensor) -> Tensor:
        """Similarities averaged over the views (B, 1, D, h, w) → costs (B, D, h, w)."""
        return self.matcher.costs(volume[:, 0])

    @torch.jit.export
    def relate_flow(self, ref: Tensor, src: Tensor) -> Tensor:
        similarities = []
        begin = 0
        for level, channels in enumerate(self.flow_channels):
            a, b = ref[:, begin : begin + channels], src[:, begin : begin + channels]
            similarities.append(similarity(a, b, self.flow_kernel[level]))
            begin += channels
        return torch.cat(similarities, dim=1)  # (B, 3, P)

    @torch.jit.export
    def flow(self, features: Tensor, neighbours: Tensor) -> Tensor:
        """Scores: minus the sharpness times the weighted sum of the similarities at the three levels, averaged over the
        neighbours that have the same hypothesis index as the point."""
        similarity = features[:, 0] * self.flow_weight[0]
        for level in range(1, 3):
            similarity = similarity + features[:, level] * self.flow_weight[level]
        b, p, k = neighbours.shape
        own = torch.arange(p, device=neighbours.device) % self.hypotheses
        along = (neighbours % self.hypotheses == own[None, :, None]).to(similarity.dtype)  # (B, P, k)
        near = similarity.gather(1, neighbours.view(b, p * k)).view(b, p, k)
        mean = (near * along).sum(dim=2) / along.sum(dim=2).clamp(min=1.0)
        return -self.flow_sharpness * mean

    def patches(self, grey: Tensor) -> Tensor:
        """5×5 patches, normalised to zero mean and unit length: (B, 1, h, w) → (B, 25, h, w)."""
        b, _, h, w = grey.shape
        stacked = F.unfold(F.pad(grey, [2, 2, 2, 2], mode="replicate"), 5).view(b, 25, h, w)
        centred = stacked - stacked.mean(dim=1, keepdim=True)
        return centred / (centred.square().sum(dim=1, keepdim=True) + 25 * 1e-4).sqrt()
